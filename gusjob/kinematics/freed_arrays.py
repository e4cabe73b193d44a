"""What the C library does with the memory of freed arrays."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Numbers of the parameters in glibc's mallopt()."""
_LARGE_BYTES, _KEPT_BYTES = 1 << 20, 4 << 20
"""Bytes of an array that is returned; and of smaller ones that are kept, since the next chunk needs them again."""


def return_freed_arrays() -> None:
    """Make glibc return large arrays to the system when they are freed.

    Otherwise it keeps those of up to 32 MB for later ones: a third of the memory that a job of a million statements
    takes. Other C libraries return them anyway.
    """
    mallopt = _glibc("mallopt")
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


def return_free_memory() -> None:
    """Make glibc return what many small arrays have taken: it keeps their pages between those still in use."""
    malloc_trim = _glibc("malloc_trim")
    if malloc_trim is not None:
        malloc_trim(0)


def _glibc(name: str) -> Callable[..., int] | None:
    """Find a function of glibc; None with another C library."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
