"""Loads a vendor's library and resolves every call that is needed, before the first one is made."""

from __future__ import annotations

import ctypes
import struct
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver.abi import ABI_PROFILES, Prototype, prototypes
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Rule
from gusjob.i18n.phrases import Phrase, printable

BITS = 8 * struct.calcsize("P")
"""Of this Python: a library must have the same."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Library:
    """A loaded library: its calls by the manual's name, ready to be called with all of their arguments."""

    path: str
    abi: Abi
    prototypes: dict[str, Prototype]
    functions: dict[str, Callable[..., int]]
    handle: Any


def load_library(path: str, abi: Abi, card: int, needed: Iterable[str]) -> tuple[Library | None, list[Diagnostic]]:
    """A library with the calls that are needed, or why not. Loading it makes no call.

    `path`: a file, or a bare name for the system's search.
    """
    handle = open_library(path)
    if isinstance(handle, str):
        return None, [_diagnostic(rules.NO_LIBRARY, path, reason=handle)]
    known = prototypes(abi, card)
    if hint := other_family(handle, abi):
        return None, [_diagnostic(rules.WRONG_ABI, path, abi=abi, reason=hint[0], hint=hint[1])]
    missing = [known[name].symbol for name in sorted(needed) if not has_symbol(handle, known[name].symbol)]
    if missing:
        hint_text = Phrase(": it is no Googol library, or one of another series") if len(missing) > 3 else ""
        fields = {"abi": abi, "symbols": ", ".join(missing), "hint": hint_text}
        return None, [_diagnostic(rules.NO_SYMBOLS, path, **fields)]
    functions = {name: bind(handle, known[name]) for name in known if has_symbol(handle, known[name].symbol)}
    return Library(path=path, abi=abi, prototypes=known, functions=functions, handle=handle), []


def open_library(path: str) -> Any | str:
    """The library's handle, or why it can't be loaded."""
    try:
        if why := _refusal(path):
            return why
        if sys.platform == "win32":
            return ctypes.WinDLL(path)  # __stdcall
        return ctypes.CDLL(path)
    except OSError as error:
        return _load_error(path, printable(str(error)))


NOT_FOUND = Phrase("there is no such file")


def _refusal(path: str) -> str:
    """Why a file is not even given to the loader; '' if nothing is against it."""
    if not path or "\0" in path:
        return NOT_FOUND
    if Path(path).is_dir():
        return Phrase("it is a folder, not a library")
    return Phrase("the file is cut short") if _cut_short(path) else ""


def _load_error(path: str, text: str) -> str:
    """What the loader's words mean."""
    if any(sign in text for sign in ("[WinError 193]", "wrong ELF class", "incompatible architecture")):
        return Phrase(
            "it is not for this Python, which has {bits} bits; install a Python of the library's kind ({text})",
            bits=BITS,
            text=text,
        )
    if (Path(path).name != path and not Path(path).exists()) or text == f"{printable(path)}: {_UNKNOWN}":
        return NOT_FOUND
    if "one of its dependencies" in text:
        return Phrase(
            "it, or a library that it needs, was not found; the vendor's driver may not be installed ({text})",
            text=text,
        )
    return text


_UNKNOWN = "cannot open shared object file: No such file or directory"  # Of the library itself, not of one it needs.


def _cut_short(path: str) -> bool:
    """Whether an ELF file ends before the parts that it names. The loader maps these and would kill us with SIGBUS."""
    if not Path(path).is_file():
        return False
    size = Path(path).stat().st_size
    with Path(path).open("rb") as file:
        head = file.read(64)
        if head[:4] != b"\x7fELF":
            return False
        if len(head) < 64:
            return True
        order, wide = ">" if head[5] == 2 else "<", head[4] == 2
        (table,) = struct.unpack_from(order + ("Q" if wide else "I"), head, 32 if wide else 28)
        entry, count = struct.unpack_from(order + "HH", head, 54 if wide else 42)
        if table + entry * count > size:
            return True
        file.seek(table)
        rows = file.read(entry * count)
    # Elf64_Phdr: type, flags, offset, vaddr, paddr, filesz; Elf32_Phdr: type, offset, vaddr, paddr, filesz.
    form, at, length = ("IIQQQQ", 2, 5) if wide else ("IIIII", 1, 4)
    if entry < struct.calcsize(order + form):
        return False
    parts = (struct.unpack_from(order + form, rows, i * entry) for i in range(count))
    return any(part[at] + part[length] > size for part in parts if part[0] == _PT_LOAD)


_PT_LOAD = 1


def has_symbol(handle: Any, symbol: str) -> bool:
    """Whether a library exports a symbol."""
    try:
        handle[symbol]
    except AttributeError:
        return False
    return True


def other_family(handle: Any, abi: Abi) -> tuple[str, str] | None:
    """Why a library is of the other family (GUS or GTS), and what to write instead; None if nothing says so."""
    foreign, own = ABI_PROFILES[abi].foreign
    if not has_symbol(handle, foreign) or has_symbol(handle, own):
        return None
    reason = Phrase("it has {foreign} and no {own}", foreign=foreign, own=own)
    if abi is Abi.GUS:
        return reason, Phrase("; try --abi {one} or {other}", one=Abi.GTS, other=Abi.GTS_MULTI)
    return reason, Phrase("; try --abi {abi}", abi=Abi.GUS)


def bind(handle: Any, prototype: Prototype) -> Callable[..., int]:
    """A call with its types set, in a function object of its own."""
    function: Any = handle[prototype.symbol]
    function.argtypes, function.restype = prototype.argtypes, ctypes.c_short
    found: Callable[..., int] = function
    return found


def _diagnostic(rule: Rule, library: str, **fields: object) -> Diagnostic:
    return Diagnostic(rule=rule, span=NOWHERE, fields={"library": printable(library), **fields})
