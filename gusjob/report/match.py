"""Matching of the segments of two reports.

Segments are matched by source line, the k-th segment of a line with the k-th of that line. Inserted or removed lines
shift the numbers of all following lines; then lines are matched in their order, if more segments keep their end point.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints
from gusjob.report.earlier import Columns

_SAME_POINT_MM = 1e-6


def matched_rows(old: Columns, new: Columns) -> tuple[Indices, Indices, bool]:
    """Match the segments of two reports.

    Of several line maps the one with most matched segments is used; segments that keep their end point count twice.

    Returns:
        Rows of `old`, rows of `new` (in this order), and whether line numbers had to be mapped.
    """
    old_points, new_points = _end_points(old), _end_points(new)
    best, best_score = (np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp), False), -1
    for attempt, lines in enumerate(_line_map_candidates(old, new)):
        old_row, new_row = _join_rows(lines, new["line"])
        unmoved = int((old_points[old_row] == new_points[new_row]).all(axis=1).sum())
        if len(new_row) + unmoved > best_score:
            best, best_score = (old_row, new_row, attempt > 0), len(new_row) + unmoved
        if unmoved == min(len(old_points), len(new_points)):
            break
    return best


def _end_points(columns: Columns) -> Floats:
    """Return the end points in whole nanometres, (n, 2)."""
    with np.errstate(over="ignore"):
        return np.rint(np.column_stack([columns["x_mm"], columns["y_mm"]]) / _SAME_POINT_MM)


def _line_map_candidates(old: Columns, new: Columns) -> Iterator[Ints]:
    """Yield maps of the old rows to line numbers of the new report, -1 for none; the simplest map first."""
    yield old["line"]
    _, old_first, old_number, old_count = np.unique(
        old["line"], return_index=True, return_inverse=True, return_counts=True
    )
    new_lines, new_first, new_count = np.unique(new["line"], return_index=True, return_counts=True)
    if len(old_count) == len(new_count):
        yield new_lines[old_number]
    old_features = np.column_stack([_end_points(old)[old_first], old_count])
    new_features = np.column_stack([_end_points(new)[new_first], new_count])
    yield np.append(new_lines, -1)[_align_lines(old_features, new_features)[old_number]]


def _align_lines(old: Floats, new: Floats) -> Indices:
    """Map each old line to the index of the new one; -1 for none. Lines are compared by their features.

    Certain matches are the common beginning and end of both jobs, and between them the lines whose features occur once
    in each. Equally many lines between two certain matches were edited in place.
    """
    fewer = min(len(old), len(new))
    head = _count_leading((old[:fewer] == new[:fewer]).all(axis=1))
    tail = _count_leading((old[::-1][: fewer - head] == new[::-1][: fewer - head]).all(axis=1))
    i, j = _unique_matches(old[head : len(old) - tail], new[head : len(new) - tail])
    ends = np.arange(-1, head), np.arange(-tail, 1)
    i, j = (np.concatenate([ends[0], head + at, len(all_) + ends[1]]) for at, all_ in ((i, old), (j, new)))
    line = np.arange(len(old))
    before = np.searchsorted(i, line, side="right") - 1
    edited = (np.diff(i) == np.diff(j))[before] | (line == i[before])
    return np.where(edited, j[before] + line - i[before], -1)


def _unique_matches(old: Floats, new: Floats) -> tuple[Indices, Indices]:
    """Match lines whose end point occurs once on each side, without those that changed their order."""
    points = np.concatenate([old, new])[:, :2].copy().view(np.complex128)[:, 0]  # One number sorts fast.
    _, which = np.unique(points, return_inverse=True)
    side_points = which[: len(old)], which[len(old) :]
    once = np.logical_and(*(np.bincount(side, minlength=len(points) + 1) == 1 for side in side_points))
    i, j = (np.flatnonzero(once[side]) for side in side_points)
    j = j[np.argsort(side_points[1][j])][np.argsort(np.argsort(side_points[0][i]))]
    forward, backward = j == np.maximum.accumulate(j), j == np.minimum.accumulate(j[::-1])[::-1]
    in_order = forward if forward.sum() >= backward.sum() else backward
    return i[in_order], j[in_order]


def _count_leading(equal: Bools) -> int:
    """Count the leading true values."""
    return int(np.append(equal, False).argmin())


def _join_rows(old_line: Ints, new_line: Ints) -> tuple[Indices, Indices]:
    """Match the k-th segment of a line with the k-th of the same line, in the order of the new ones."""
    if np.array_equal(old_line, new_line):
        rows = np.arange(len(new_line))
        return rows, rows
    _, number = np.unique(np.concatenate([old_line, new_line]), return_inverse=True)
    old_key, new_key = (
        part * len(number) + _occurrence_numbers(part) for part in (number[: len(old_line)], number[len(old_line) :])
    )
    _, old_row, new_row = np.intersect1d(old_key, new_key, assume_unique=True, return_indices=True)
    order = np.argsort(new_row)
    return old_row[order], new_row[order]


def _occurrence_numbers(line: Indices) -> Indices:
    """Count the earlier occurrences of the same line."""
    order = np.argsort(line, kind="stable")
    in_order = line[order]
    times = np.empty_like(line)
    times[order] = np.arange(len(line)) - np.searchsorted(in_order, in_order)
    return times
