"""Which ABI a library fits, found without making a call; and what to do with one that fits none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from msgspec import Struct, field

from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver.abi import ABI_PROFILES, prototypes
from gusjob.controllers.gus.driver.library import BITS, NOT_FOUND, has_symbol, open_library, other_family
from gusjob.controllers.gus.driver.requirements import LASER_CALLS, RUN_CALLS
from gusjob.i18n.phrases import Phrase, printable

_CALLS = (*RUN_CALLS, *LASER_CALLS)


class VendorLibrary(Struct, frozen=True, kw_only=True):
    """A library that was found or named.

    `abis`: those that it fits; `missing`: the symbols that it lacks for another one, if they are few; `reason`: why it
    can't be loaded, or fits none; `next_steps`: what to do about that.
    """

    path: str
    loaded: bool
    reason: str = ""
    abis: tuple[Abi, ...] = ()
    missing: Mapping[Abi, tuple[str, ...]] = field(default_factory=dict)
    next_steps: tuple[str, ...] = ()


def inspect_library(path: str) -> VendorLibrary:
    """Load a library (a path, or a bare name for the system's search) and find the ABIs that it fits."""
    shown = printable(path)
    handle: Any = open_library(path)
    if isinstance(handle, str):
        reason = handle if isinstance(handle, Phrase) else handle.removeprefix(f"{shown}: ")
        return VendorLibrary(path=shown, loaded=False, reason=reason, next_steps=_next_steps(reason))
    missing = {abi: _missing(handle, abi) for abi in Abi}
    abis = tuple(abi for abi in Abi if not missing[abi])
    near = {abi: symbols for abi, symbols in missing.items() if symbols and len(symbols) <= len(_CALLS) // 2}
    if abis:
        return VendorLibrary(path=shown, loaded=True, abis=abis, missing=near)
    return _unfitting(shown, near)


def _unfitting(shown: str, near: Mapping[Abi, tuple[str, ...]]) -> VendorLibrary:
    """Describe a library that fits no ABI. `near`: symbols that it lacks for an ABI, where those are few."""
    if near:
        reason = Phrase("calls are missing that every laser job needs")
        step = Phrase("ask the vendor for the library with laser calls")
    else:
        reason = Phrase("it does not have the calls of a Googol library")
        step = Phrase("name another one with --library")
    return VendorLibrary(path=shown, loaded=True, reason=reason, missing=near, next_steps=(step,))


def _missing(handle: Any, abi: Abi) -> tuple[str, ...]:
    """Return the symbols that a library lacks for an ABI, with the family's own if it is of the other family."""
    known = prototypes(abi, 0)
    missing = tuple(known[name].symbol for name in _CALLS if not has_symbol(handle, known[name].symbol))
    return (*missing, ABI_PROFILES[abi].own_symbol) if other_family(handle, abi) else missing


_NEXT_STEPS: tuple[tuple[tuple[str, ...], str], ...] = (
    ((NOT_FOUND, "not a file"), Phrase("name the library's file with --library, or write its path into gusjob.toml")),
    (("a folder",), Phrase("name the library in it with --library")),
    (
        ("this Python needs",),
        Phrase("get the library for this system and processor from the vendor"),
    ),
    (
        ("which has", "WinError 193"),
        Phrase(
            "the library must have this Python's {bits} bits: get that one from the vendor, or install gusjob with a "
            "Python of {others} bits",
            bits=BITS,
            others=96 - BITS,
        ),
    ),
    (
        ("ermission denied", "WinError 5]", "Operation not permitted", "failed to map segment"),
        Phrase(
            "give your user permission to read and execute it (Linux: chmod a+rx FILE; not on a disk mounted noexec)"
        ),
    ),
    (
        ("one of its dependencies", "WinError 126", "WinError 127"),
        Phrase(
            "install the vendor's driver package, which has what this library needs, or put the vendor's other DLLs "
            "into its folder"
        ),
    ),
    (
        ("cannot open shared object", "undefined symbol", "image not found", "Library not loaded"),
        Phrase("install what the library needs: `ldd FILE` (macOS: `otool -L FILE`) shows it"),
    ),
    (
        ("truncated", "invalid ELF header", "file too short", "not a mach-o file", "slice is not valid"),
        Phrase("copy it again from the vendor's package, the one for this system"),
    ),
)
"""What to do, by parts of the reason; the first that matches."""


def _next_steps(reason: str) -> tuple[str, ...]:
    found = (step for parts, step in _NEXT_STEPS if any(part in reason for part in parts))
    return tuple(found)[:1]
