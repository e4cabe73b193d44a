"""Which segment of an earlier report is which of this one.

Segments are matched by source line, the k-th segment of a line with the k-th of that line. Where lines came or went,
the numbers of those behind them shift; then lines are matched in their order, if more segments keep their end point so.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints
from gusjob.report.earlier import Columns

_SAME_PLACE_MM = 1e-6


def matched_rows(old: Columns, new: Columns) -> tuple[Indices, Indices, bool]:
    """Matched rows, in the order of the new ones; whether line numbers had to be mapped.

    Of the ways to map lines the one that matches most segments, those that keep their place counted twice.
    """
    here, there = _places(old), _places(new)
    best, best_score = (np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp), False), -1
    for attempt, lines in enumerate(_line_maps(old, new)):
        old_row, new_row = _joined(lines, new["line"])
        in_place = int((here[old_row] == there[new_row]).all(axis=1).sum())
        if len(new_row) + in_place > best_score:
            best, best_score = (old_row, new_row, attempt > 0), len(new_row) + in_place
        if in_place == min(len(here), len(there)):
            break
    return best


def _places(columns: Columns) -> Floats:
    """End points, [rows, 2]; those within a nanometre are one."""
    with np.errstate(over="ignore"):
        return np.rint(np.column_stack([columns["x_mm"], columns["y_mm"]]) / _SAME_PLACE_MM)


def _line_maps(old: Columns, new: Columns) -> Iterator[Ints]:
    """For each old row the line that its own may be in the new report, -1 for none; the simplest map first."""
    yield old["line"]
    _, old_first, old_number, old_count = np.unique(
        old["line"], return_index=True, return_inverse=True, return_counts=True
    )
    new_lines, new_first, new_count = np.unique(new["line"], return_index=True, return_counts=True)
    if len(old_count) == len(new_count):
        yield new_lines[old_number]
    old_marks = np.column_stack([_places(old)[old_first], old_count])
    new_marks = np.column_stack([_places(new)[new_first], new_count])
    yield np.append(new_lines, -1)[_aligned(old_marks, new_marks)[old_number]]


def _aligned(old: Floats, new: Floats) -> Indices:
    """For each old line, told by its marks, the number of the new one; -1 for none.

    Sure are the equal ends of both jobs, and between them what each has once. Where equally many lines lie between two
    sure ones they were edited in place.
    """
    fewer = min(len(old), len(new))
    head = _run((old[:fewer] == new[:fewer]).all(axis=1))
    tail = _run((old[::-1][: fewer - head] == new[::-1][: fewer - head]).all(axis=1))
    i, j = _once(old[head : len(old) - tail], new[head : len(new) - tail])
    ends = np.arange(-1, head), np.arange(-tail, 1)
    i, j = (np.concatenate([ends[0], head + at, len(all_) + ends[1]]) for at, all_ in ((i, old), (j, new)))
    line = np.arange(len(old))
    before = np.searchsorted(i, line, side="right") - 1
    edited = (np.diff(i) == np.diff(j))[before] | (line == i[before])
    return np.where(edited, j[before] + line - i[before], -1)


def _once(old: Floats, new: Floats) -> tuple[Indices, Indices]:
    """Where lines stand whose place each side has once; those that changed their order are left out."""
    places = np.concatenate([old, new])[:, :2].copy().view(np.complex128)[:, 0]  # One number sorts fast.
    _, which = np.unique(places, return_inverse=True)
    sides = which[: len(old)], which[len(old) :]
    once = np.logical_and(*(np.bincount(side, minlength=len(places) + 1) == 1 for side in sides))
    i, j = (np.flatnonzero(once[side]) for side in sides)
    j = j[np.argsort(sides[1][j])][np.argsort(np.argsort(sides[0][i]))]
    forward, backward = j == np.maximum.accumulate(j), j == np.minimum.accumulate(j[::-1])[::-1]
    in_order = forward if forward.sum() >= backward.sum() else backward
    return i[in_order], j[in_order]


def _run(equal: Bools) -> int:
    """How many are true from the start."""
    return int(np.append(equal, False).argmin())


def _joined(old_line: Ints, new_line: Ints) -> tuple[Indices, Indices]:
    """Indices of the k-th segment of a line and of the k-th of the same line, in the order of the new ones."""
    if np.array_equal(old_line, new_line):
        rows = np.arange(len(new_line))
        return rows, rows
    _, number = np.unique(np.concatenate([old_line, new_line]), return_inverse=True)
    old_key, new_key = (
        part * len(number) + _occurrence(part) for part in (number[: len(old_line)], number[len(old_line) :])
    )
    _, old_row, new_row = np.intersect1d(old_key, new_key, assume_unique=True, return_indices=True)
    order = np.argsort(new_row)
    return old_row[order], new_row[order]


def _occurrence(line: Indices) -> Indices:
    """How often the same line stood before."""
    order = np.argsort(line, kind="stable")
    in_order = line[order]
    times = np.empty_like(line)
    times[order] = np.arange(len(line)) - np.searchsorted(in_order, in_order)
    return times
