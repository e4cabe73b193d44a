"""Load a vendor's library and resolve every call that is needed, before the first one is made."""

from __future__ import annotations

import ctypes
import os
import stat
import struct
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from msgspec import Struct

from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver.abi import ABI_PROFILES, Prototype, prototypes
from gusjob.controllers.gus.driver.elf import is_truncated
from gusjob.controllers.gus.driver.headers import misfit
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Rule
from gusjob.i18n.phrases import Phrase, printable, reason_of
from gusjob.inputs import NAMED_PIPE

BITS = 8 * struct.calcsize("P")
"""Bits of this Python: a library must have the same."""
NOT_FOUND = Phrase("there is no such file")
_PATH_VARIABLE = {"linux": "LD_LIBRARY_PATH", "darwin": "DYLD_LIBRARY_PATH"}.get(sys.platform, "")
"""Where the user can add folders to those that the loader searches for a bare name."""
_UNKNOWN = "cannot open shared object file: No such file or directory"
"""glibc's text for the library itself, not for one that it needs."""


class Library(Struct, frozen=True, kw_only=True):
    """A loaded library: its calls by the manual's name, ready to be called with all of their arguments."""

    path: str
    abi: Abi
    prototypes: dict[str, Prototype]
    functions: dict[str, Callable[..., int]]
    handle: Any

    @property
    def abi_title(self) -> str:
        """A phrase that describes the ABI."""
        return ABI_PROFILES[self.abi].title


def abi_titles() -> dict[Abi, str]:
    """Return a phrase that describes each ABI."""
    return {abi: profile.title for abi, profile in ABI_PROFILES.items()}


def load_library(path: str, abi: Abi, card: int, needed: Iterable[str]) -> tuple[Library | None, list[Diagnostic]]:
    """Load a library with the calls that are needed. Loading it makes no call.

    Args:
        path: a file, or a bare name for the system's search.
        abi: the ABI that it should have.
        card: number of the card.
        needed: calls by the manual's name.

    Returns:
        The library, or None with diagnostics that say why not.
    """
    handle = open_library(path)
    if isinstance(handle, str):
        return None, [_diagnostic(rules.NO_LIBRARY, path, reason=handle)]
    known = prototypes(abi, card)
    if hint := other_family(handle, abi):
        return None, [_diagnostic(rules.WRONG_ABI, path, abi=abi, reason=hint[0], hint=hint[1])]
    missing = [known[name].symbol for name in sorted(needed) if not has_symbol(handle, known[name].symbol)]
    if missing:
        hint_text = Phrase(": it is not a Googol library, or one of another series") if len(missing) > 3 else ""
        fields = {"abi": abi, "symbols": ", ".join(missing), "hint": hint_text}
        return None, [_diagnostic(rules.NO_SYMBOLS, path, **fields)]
    functions = {name: bind(handle, known[name]) for name in known if has_symbol(handle, known[name].symbol)}
    return Library(path=path, abi=abi, prototypes=known, functions=functions, handle=handle), []


def open_library(path: str) -> Any | str:
    """Return the library's handle, or a text that says why it can't be loaded."""
    try:
        if why := _refusal(path):
            return why
    except OSError as error:
        return reason_of(error)
    try:
        if sys.platform == "win32":
            return ctypes.WinDLL(path)  # __stdcall
        return ctypes.CDLL(path)
    except OSError as error:
        return _load_error(path, printable(str(error)))
    except UnicodeDecodeError as error:  # The loader's text has bytes of a name, or of a language, as they are.
        return _load_error(path, printable(error.object.decode("utf-8", "backslashreplace")))


def _refusal(path: str) -> str:
    """Return why a file is not passed to the loader; '' if it is."""
    if not path or "\0" in path:
        return NOT_FOUND
    for file in _files_tried(path):
        mode = file.stat().st_mode
        if not stat.S_ISREG(mode):
            return _kind(mode)
    return Phrase("the file is truncated") if is_truncated(path) else ""


def _files_tried(path: str) -> list[Path]:
    """Return the existing files that the loader may open: for a bare name also those in the folders of the user."""
    entries = os.environ.get(_PATH_VARIABLE, "").split(os.pathsep) if _PATH_VARIABLE and Path(path).name == path else []
    paths = [Path(path), *(Path(entry) / path for entry in entries if entry)]
    return [file for file in paths if _is_there(file)]


def _is_there(path: Path) -> bool:
    """Return whether there is a file, or may be one in a folder that the user can't read."""
    try:
        path.stat()
    except (FileNotFoundError, NotADirectoryError, ValueError):
        return False
    except OSError:
        pass
    return True


def _kind(mode: int) -> Phrase:
    """Return what a file is that is not a regular one: opening a pipe or a device could block forever."""
    if stat.S_ISDIR(mode):
        return Phrase("it is a folder, not a library")
    if stat.S_ISFIFO(mode):
        return NAMED_PIPE
    return Phrase("it is a socket, not a file") if stat.S_ISSOCK(mode) else Phrase("it is a device, not a file")


def _load_error(path: str, text: str) -> str:
    """Translate the loader's error message. For a library of another processor glibc says that there is no file."""
    files = _files_tried(path)
    if why := next(filter(None, map(misfit, files)), ""):
        return why
    if any(part in text for part in ("[WinError 193]", "wrong ELF class", "incompatible architecture")):
        return Phrase(
            "it is not for this Python, which has {bits} bits; install a Python with as many bits as the "
            "library ({text})",
            bits=BITS,
            text=text,
        )
    if not files and (Path(path).name != path or text == f"{printable(path)}: {_UNKNOWN}"):
        return NOT_FOUND
    if "one of its dependencies" in text:
        return Phrase(
            "it, or a library that it needs, was not found; the vendor's driver may not be installed ({text})",
            text=text,
        )
    return text


def has_symbol(handle: Any, symbol: str) -> bool:
    """Return whether a library exports a symbol."""
    try:
        handle[symbol]
    except (AttributeError, UnicodeDecodeError):  # The latter as in open_library.
        return False
    return True


def other_family(handle: Any, abi: Abi) -> tuple[str, str] | None:
    """Detect a library of the other family (GUS or GTS).

    Returns:
        Why it is of the other family and what to try instead; None if nothing shows that it is.
    """
    profile = ABI_PROFILES[abi]
    if not has_symbol(handle, profile.other_symbol) or has_symbol(handle, profile.own_symbol):
        return None
    reason = Phrase("it has {foreign} and no {own}", foreign=profile.other_symbol, own=profile.own_symbol)
    if abi is Abi.GUS:
        return reason, Phrase("; try --abi {one} or {other}", one=Abi.GTS, other=Abi.GTS_MULTI)
    return reason, Phrase("; try --abi {abi}", abi=Abi.GUS)


def bind(handle: Any, prototype: Prototype) -> Callable[..., int]:
    """Return a call with its types set, as a function object of its own."""
    function: Any = handle[prototype.symbol]
    function.argtypes, function.restype = prototype.argtypes, ctypes.c_short
    found: Callable[..., int] = function
    return found


def _diagnostic(rule: Rule, library: str, **fields: object) -> Diagnostic:
    return Diagnostic(rule=rule, span=NOWHERE, fields={"library": printable(library), **fields})
