"""What the C library does with the memory of freed arrays."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""Numbers of the parameters in glibc's mallopt()."""
_LARGEST_BYTES = 32 << 20
"""The highest threshold that glibc takes."""
_KEPT_BYTES = 4 << 20


def reuse_freed_arrays() -> None:
    """Make glibc keep the memory of freed arrays for the next ones.

    Otherwise it returns each large one to the system, which has to clear the memory before it gives it out again: that
    takes up to half of the time of a job of a million statements. Not more than 4 MB are kept at the end of the heap.
    """
    mallopt = _glibc("mallopt")
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGEST_BYTES)
        mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


def return_free_memory() -> None:
    """Make glibc return what many small arrays have taken: it keeps their pages between those still in use."""
    malloc_trim = _glibc("malloc_trim")
    if malloc_trim is not None:
        malloc_trim(0)


def _glibc(name: str) -> Callable[..., int] | None:
    """Find a function of glibc; None with another C library."""
    return getattr(ctypes.CDLL(None), name, None) if sys.platform == "linux" else None
