"""Find the file of a library whose name has no folder, so that the system searched for it."""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path
from typing import Any

from gusjob.controllers.gus.driver.library import Library

_LONGEST_PATH = 32_768
"""Characters of the longest path on Windows."""


class _SymbolInfo(ctypes.Structure):
    """Dl_info of dladdr."""

    _fields_ = (
        ("file", ctypes.c_char_p),
        ("base", ctypes.c_void_p),
        ("symbol", ctypes.c_char_p),
        ("address", ctypes.c_void_p),
    )


def file_of(library: Library) -> Path | None:
    """Return the file that a library was loaded from; None if it is not known."""
    if (named := Path(library.path)).is_file():
        return named
    found = _module_file(library.handle) if sys.platform == "win32" else _symbol_file(library)
    return Path(found) if found and Path(found).is_file() else None


def _module_file(handle: Any) -> str:
    """Return the file of a loaded module on Windows, '' if it is not known."""
    if sys.platform != "win32":
        return ""
    text = ctypes.create_unicode_buffer(_LONGEST_PATH)
    find = ctypes.windll.kernel32.GetModuleFileNameW
    find.argtypes = [ctypes.c_void_p, ctypes.c_wchar_p, ctypes.c_ulong]
    return text.value if find(handle._handle, text, _LONGEST_PATH) else ""


def _symbol_file(library: Library) -> str:
    """Return the file that has a library's calls, '' if it is not known."""
    function: Any = next(iter(library.functions.values()))
    info = _SymbolInfo()
    try:
        found = ctypes.CDLL(None).dladdr(ctypes.cast(function, ctypes.c_void_p), ctypes.byref(info))
    except (AttributeError, OSError, TypeError):  # A system without dladdr.
        return ""
    return os.fsdecode(info.file) if found and info.file else ""
