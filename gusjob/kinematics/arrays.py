"""Array aliases of the whole package, and arrays of unequal groups.

A column is a one-dimensional array with one entry a row.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Indices = npt.NDArray[np.intp]
"""Row numbers of another column."""
Bools = npt.NDArray[np.bool_]


def counted(counts: Indices) -> tuple[Indices, Indices]:
    """Number the members of groups that stand in a row.

    Args:
        counts: Size of each group, (n,).

    Returns:
        The group of each member and its number within the group from 0, both (sum of counts,).
    """
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
