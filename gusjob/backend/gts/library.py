"""Loads a vendor's library and resolves every call that is needed, before the first one is made."""

from __future__ import annotations

import ctypes
import os
import struct
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from gusjob import rules
from gusjob.backend.gts.abi import ABI_PROFILES, Prototype, prototypes
from gusjob.diagnostics import NOWHERE, Diagnostic, Rule, printable
from gusjob.machine import Abi

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
    handle = opened(path)
    if isinstance(handle, str):
        return None, [_fault(rules.NO_LIBRARY, path, reason=handle)]
    known = prototypes(abi, card)
    if hint := other_family(handle, abi):
        return None, [_fault(rules.WRONG_ABI, path, abi=abi, reason=hint[0], hint=hint[1])]
    missing = [known[name].symbol for name in sorted(needed) if not has_symbol(handle, known[name].symbol)]
    if missing:
        hint_text = ": it is no Googol library, or one of another series" if len(missing) > 3 else ""
        fields = {"abi": abi, "symbols": ", ".join(missing), "hint": hint_text}
        return None, [_fault(rules.NO_SYMBOLS, path, **fields)]
    functions = {name: bound(handle, known[name]) for name in known if has_symbol(handle, known[name].symbol)}
    return Library(path=path, abi=abi, prototypes=known, functions=functions, handle=handle), []


def opened(path: str) -> Any | str:
    """The library's handle, or why it can't be loaded."""
    try:
        if sys.platform == "win32":
            return ctypes.WinDLL(path)  # __stdcall
        return ctypes.CDLL(path)
    except OSError as error:
        return _why(path, error)


def _why(path: str, error: OSError) -> str:
    text = printable(str(error))
    if getattr(error, "winerror", None) == 193 or "wrong ELF class" in text or "incompatible architecture" in text:
        return f"it is not for this Python, which has {BITS} bits; install a Python of the library's kind ({text})"
    if os.path.dirname(path) and not os.path.exists(path):  # noqa: PTH110, PTH120  (a bare name is no path of ours)
        return "there is no such file"
    if getattr(error, "winerror", None) == 126:
        return f"it, or a library that it needs, was not found; the vendor's driver may not be installed ({text})"
    return text


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
    better = [Abi.GTS, Abi.GTS_MULTI] if abi is Abi.GUS else [Abi.GUS]
    return f"it has {foreign} and no {own}", f"; try --abi {' or '.join(better)}"


def bound(handle: Any, prototype: Prototype) -> Callable[..., int]:
    """A call with its types set, in a function object of its own."""
    function: Any = handle[prototype.symbol]
    function.argtypes, function.restype = prototype.argtypes, ctypes.c_short
    found: Callable[..., int] = function
    return found


def _fault(rule: Rule, library: str, **fields: object) -> Diagnostic:
    return Diagnostic(rule=rule, span=NOWHERE, fields={"library": printable(library), **fields})
