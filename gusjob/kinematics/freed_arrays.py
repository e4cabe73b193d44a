"""What the C library does with the memory of freed arrays."""

from __future__ import annotations

import ctypes
import sys

_M_MMAP_THRESHOLD = -3
"""Number of the parameter in glibc's mallopt()."""
_LARGE_BYTES = 1 << 20


def return_freed_arrays() -> None:
    """Make glibc return large arrays to the system when they are freed.

    Otherwise it keeps those of up to 32 MB for later ones: a third of the memory that a job of a million statements
    takes. Other C libraries return them anyway.
    """
    if sys.platform != "linux":
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)
