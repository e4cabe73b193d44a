"""Array aliases of the whole package, and sums and groups of arrays.

A column is a one-dimensional array with one entry a row.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Indices = npt.NDArray[np.intp]
"""Row numbers of another column."""
Bools = npt.NDArray[np.bool_]
_Number = TypeVar("_Number", bound=np.generic)
BLOCK_ROWS = 1 << 15
"""Rows that are computed at a time where what is made on the way is large: it fits in the processor's cache."""


def counted(counts: Indices) -> tuple[Indices, Indices]:
    """Number the members of groups that follow each other.

    Args:
        counts: Size of each group, (n,).

    Returns:
        The group of each member and its number within the group from 0, both (sum of counts,).
    """
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)


def follow_each_other(rows: Indices) -> bool:
    """Whether each of some row numbers is the one after the one before it: then a slice has these rows."""
    return len(rows) > 0 and int(rows[-1]) - int(rows[0]) == len(rows) - 1 and bool((rows[1:] > rows[:-1]).all())


def picked(column: npt.NDArray[_Number], rows: Indices | slice) -> npt.NDArray[_Number]:
    """Pick the values at some rows; a column with one value for all rows (stride 0) stays so and takes no memory.

    So do values at one row that is picked many times.
    """
    if isinstance(rows, slice) or not len(column) or not len(rows):
        return column[rows]
    if column.strides == (0,):
        return np.broadcast_to(column[:1], len(rows))
    return np.broadcast_to(column[rows[:1]], len(rows)) if rows.strides == (0,) else column[rows]


def with_constant(column: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
    """Return a column with one value for all rows as one that takes no memory (stride 0), any other as it is."""
    if column.strides == (0,) or not len(column) or column[0] != column[-1] or not (column == column[0]).all():
        return column
    return np.broadcast_to(column[0], len(column))


def unrepeated(column: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
    """Return the first value of a column with one value for all rows (stride 0), all of any other."""
    return column[:1] if column.strides == (0,) else column


def joined(parts: Sequence[npt.NDArray[_Number]]) -> npt.NDArray[_Number]:
    """Concatenate one or more parts of a column; if all have the same one value for all rows, the column has it, too.

    Args:
        parts: The parts, with stride 0 where one value holds for all rows.
    """
    filled = [part for part in parts if len(part)]
    if filled and all(part.strides == (0,) and part[0] == filled[0][0] for part in filled):
        return np.broadcast_to(filled[0][0], sum(map(len, filled)))
    return np.concatenate(parts)


def before(column: Floats, rows: Indices | slice, start: float) -> Floats:
    """Return the values in the row before each of some rows that follow each other in a sequence.

    Args:
        column: The column.
        rows: The rows, (n,).
        start: What comes before the first of them. If the row before it has this value, nothing is copied.
    """
    if isinstance(rows, slice) and rows.start and column[rows.start - 1] == start:
        return column[rows.start - 1 : rows.stop - 1]
    found = np.empty(len(column[rows]))
    found[:1], found[1:] = start, column[rows][:-1]
    return found


def changes(values: npt.NDArray[_Number]) -> Bools:
    """Find the values that are not the one before them, (n,); the first is one."""
    found = np.ones(len(values), dtype=np.bool_)
    found[1:] = values[1:] != values[:-1]
    return found


def fill_gaps(column: npt.NDArray[_Number], gaps: Indices, start: _Number | float) -> None:
    """Give each of some rows the value of the row before it, in place; `start` where there is none.

    Args:
        column: The column, (n,).
        gaps: The rows, ascending.
        start: The value of gaps at the beginning.
    """
    if not len(gaps):
        return
    # Each run of gaps has the value before it.
    is_first = np.diff(gaps, prepend=-2) != 1
    before = gaps[is_first] - 1
    value = np.where(before >= 0, column[before], start)
    column[gaps] = value[np.cumsum(is_first) - 1]


def carried(values: npt.NDArray[_Number], rows: Indices, count: int, start: _Number | float) -> npt.NDArray[_Number]:
    """Carry values, each set at one of some ascending rows, on to the next row: (count,); `start` before the first."""
    found = np.empty(count, dtype=values.dtype)
    first = int(rows[0]) if len(rows) else count
    found[:first] = start
    found[first:] = np.repeat(values, np.diff(rows, append=count))
    return found


def rows_of(numbers: Indices) -> Indices | slice:
    """Return row numbers as a slice if they follow each other: it takes rows of columns without a copy.

    Args:
        numbers: Row numbers, (n,), none below 0.
    """
    return slice(int(numbers[0]), int(numbers[-1]) + 1) if follow_each_other(numbers) else numbers


def where_true(mask: Bools) -> Indices | slice:
    """Return where a mask is true; all of it as a slice, which copies nothing."""
    return slice(None) if mask.all() else np.flatnonzero(mask)


def blocks(count: int) -> Iterator[slice]:
    """Yield the rows of columns of `count` rows, a block at a time: what is made of a block takes little memory."""
    for first in range(0, count, BLOCK_ROWS):
        yield slice(first, min(first + BLOCK_ROWS, count))


_BUCKET_BITS, _SPREADS = 20, np.uint64(0x9E3779B97F4A7C15)


def repeated(keys: npt.NDArray[np.uint64]) -> Indices:
    """Find the rows whose key another row has, too, ascending.

    Args:
        keys: The keys, (n,).
    """
    short = np.empty(len(keys), dtype=np.uint32)  # Sorted in half of the time; a few different keys have the same one.
    for part in blocks(len(keys)):
        short[part] = (keys[part] * _SPREADS) >> np.uint64(32)
    ordered = np.sort(short)
    several = ordered[1:][ordered[1:] == ordered[:-1]]
    del ordered
    if not len(several):
        return np.empty(0, dtype=np.intp)
    bucket = np.uint32(32 - _BUCKET_BITS)
    is_wanted = np.zeros(1 << _BUCKET_BITS, dtype=np.bool_)
    is_wanted[several >> bucket] = True
    short >>= bucket
    rows = np.flatnonzero(is_wanted[short])
    del short
    order = rows[np.argsort(keys[rows], kind="stable")]
    found = keys[order]
    same = found[1:] == found[:-1]
    return np.sort(order[np.append(same, False) | np.append(False, same)])


def distinct(values: npt.NDArray[_Number]) -> npt.NDArray[_Number]:
    """Sort values without NaN, each once, as np.unique does, which imports numpy.ma for that.

    Args:
        values: The values, (n,).
    """
    ordered: npt.NDArray[_Number] = np.sort(values)
    is_repeated = np.zeros(len(ordered), dtype=np.bool_)
    is_repeated[1:] = ordered[1:] == ordered[:-1]
    once: npt.NDArray[_Number] = ordered[~is_repeated]
    return once


def median(values: Floats) -> float:
    """Return the median of one or more values, NaN if one is NaN, as np.median does, which imports numpy.ma for that.

    Args:
        values: The values, (n,).
    """
    middle = [(len(values) - 1) // 2, len(values) // 2]
    ordered = np.partition(values, [*middle, len(values) - 1])  # NaN comes last.
    return float(ordered[-1] if np.isnan(ordered[-1]) else ordered[middle].mean())


def running_sum(values: Floats) -> Floats:
    """Sum the values before each element, and all of them at the end.

    A plain cumsum of a million durations is off by 1e-7 ms. Here each value is split into a whole number of small
    steps, which int64 sums exactly, and a remainder so small that the rounding of its sum does not matter.

    Args:
        values: The values, (n,).

    Returns:
        The sums, (n+1,), each exact to one rounding. With a value that is not finite, plain sums.
    """
    top = max(float(values.max(initial=0.0)), -float(values.min(initial=0.0))) * max(len(values), 1)
    sums = np.zeros(len(values) + 1)
    if top == 0.0:
        return sums
    if not np.isfinite(top):
        np.cumsum(values, out=sums[1:])
        return sums
    step = 2.0 ** (np.ceil(np.log2(top)) - 61)
    steps, rest = 0, 0.0
    for part in blocks(len(values)):
        whole = np.rint(values[part] / step)
        behind = np.cumsum(whole.astype(np.int64)) + steps
        left = np.cumsum(np.append(rest, values[part] - whole * step))[1:]
        sums[1:][part] = left + behind * step
        steps, rest = int(behind[-1]), float(left[-1])
    return sums


def hashed(columns: list[Floats]) -> npt.NDArray[np.uint64]:
    """Hash the rows of some columns: equal rows have equal hashes, others hardly ever."""
    mixed = np.zeros(len(columns[0]), dtype=np.uint64)
    for column in columns:
        # -0 is 0. A column with one value for all rows is hashed as one value.
        bits = unrepeated(column) + 0.0
        mixed ^= bits.view(np.uint64)
        mixed *= np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def mixed(hashes: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Mix all bits of hashes, so that sums of them are hashes, too (the finalizer of splitmix64)."""
    found = hashes.copy()
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        found ^= found >> np.uint64(shift)
        found *= np.uint64(factor)
    return found ^ (found >> np.uint64(31))
