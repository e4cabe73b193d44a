"""Frames as maps between pulses: scale, then rotate, then shift in mm, with any pulses per mm of the axes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.ranges import Membership, Range
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp
from gusjob.frontend.resolve.columns import ResolvedColumns
from gusjob.ir.arcs import DrawnArcs
from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints, distinct, running_sum
from gusjob.kinematics.geometry import arcs_by_either, sin_cos_deg

SCALE_RANGE = Range(name="frame scale", unit="", low=1e-6, high=1e6, section="job language")
"""Size of a frame, with the frames around it: in a smaller one no field is left, in a larger one no pulse."""

_GROUPS_AT_ONCE = 32_768
"""As numbers of Python they need much memory."""


class Frames(Struct, frozen=True, kw_only=True, eq=False):
    """Maps x' = a x + b y + e, y' = c x + d y + f from a frame to the machine, in pulse.

    All columns are (frames + 1,); frame 0 is the machine itself. `scale`: the frame's size in mm. `written_scale`: the
    same with a SCALE that makes it too large or too small, which `scale` leaves out.
    """

    a: Floats
    b: Floats
    c: Floats
    d: Floats
    e: Floats
    f: Floats
    scale: Floats
    written_scale: Floats

    def to_machine(self, frame: Ints | int, x: Floats | float, y: Floats | float) -> tuple[Floats, Floats]:
        """Map points of a frame to the machine."""
        return (
            np.asarray(self.a[frame] * x + self.b[frame] * y + self.e[frame]),
            np.asarray(self.c[frame] * x + self.d[frame] * y + self.f[frame]),
        )

    def vectors_to_frame(self, frame: Ints | int, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Map vectors of the machine to a frame: points without the shift."""
        determinant = self.a[frame] * self.d[frame] - self.b[frame] * self.c[frame]
        return (
            np.asarray((self.d[frame] * x - self.b[frame] * y) / determinant),
            np.asarray((self.a[frame] * y - self.c[frame] * x) / determinant),
        )

    def vectors_to_machine(self, frame: Ints | int, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Map vectors of a frame to the machine: points without the shift."""
        return self.a[frame] * x + self.b[frame] * y, self.c[frame] * x + self.d[frame] * y


def frames_of(columns: ResolvedColumns, parent: Ints) -> Frames:
    """All frames of a job, each within those around it. `parent`: for each frame (from 1) the one around it, or 0."""
    rows = np.flatnonzero(columns.op == RowOp.FRAME)
    number = columns.raw(Column.FRAME)[rows].astype(np.int64)
    px, py = columns.machine.pulses_per_mm
    shift_x, shift_y = (
        np.nan_to_num(columns.length(column, axis)[rows]) for axis, column in enumerate((Column.X, Column.Y))
    )
    sine, cosine = sin_cos_deg(np.nan_to_num(columns.raw(Column.VALUE)[rows]))
    count = len(parent)
    level = _levels(parent)
    size, written, own_scale = _scales(columns.raw(Column.RATIO)[rows], number, parent, level)
    scale = own_scale[number]
    a, b, c, d = np.ones(count), np.zeros(count), np.zeros(count), np.ones(count)
    e, f = np.zeros(count), np.zeros(count)
    a[number], b[number] = scale * cosine, -scale * sine * (px / py)
    c[number], d[number] = scale * sine * (py / px), scale * cosine
    e[number], f[number] = shift_x, shift_y
    # From the outside in: a frame is finished when the one around it is.
    for one in range(1, int(level.max(initial=0)) + 1):
        own = np.flatnonzero(level == one)
        around = parent[own]
        a[own], b[own], c[own], d[own], e[own], f[own] = (
            a[around] * a[own] + b[around] * c[own],
            a[around] * b[own] + b[around] * d[own],
            c[around] * a[own] + d[around] * c[own],
            c[around] * b[own] + d[around] * d[own],
            a[around] * e[own] + b[around] * f[own] + e[around],
            c[around] * e[own] + d[around] * f[own] + f[around],
        )
    return Frames(a=a, b=b, c=c, d=d, e=e, f=f, scale=size, written_scale=written)


def _levels(parent: Ints) -> Ints:
    """How many frames are around each one."""
    level = np.zeros(len(parent), dtype=np.int64)
    above = parent
    while np.any(above > 0):
        level += above > 0
        above = np.where(above > 0, parent[above], 0)
    return level


def _scales(written: Floats, number: Ints, parent: Ints, level: Ints) -> tuple[Floats, Floats, Floats]:
    """Size of each frame; the same with its own SCALE in any case; and its own SCALE, 1 if that leaves SCALE_RANGE.

    Args:
        written: The SCALE of each FRAME, NaN where it has none.
        number: The frame that each of them begins.
        parent: For each frame (from 1) the one around it, or 0.
        level: How many frames are around each one.
    """
    own_scale = np.ones(len(parent))
    own_scale[number] = np.where(np.isnan(written) | ~(written > 0), 1.0, written)
    size, total = np.ones(len(parent)), np.ones(len(parent))
    for one in range(int(level.max(initial=0)) + 1):
        own = np.flatnonzero(level == one)
        own = own[own > 0]
        around = size[parent[own]]
        total[own] = around * own_scale[own]
        own_scale[own] = np.where(SCALE_RANGE.classify(total[own]) == Membership.INSIDE, own_scale[own], 1.0)
        size[own] = around * own_scale[own]
    return size, total, own_scale


def positions_in_frames(x: Floats, y: Floats, relative: Bools, frame: Ints, frames: Frames) -> tuple[Floats, Floats]:
    """Machine positions after each move, pulse.

    Within a frame an axis that is left out keeps its position as seen from that frame.

    Args:
        x: Words in the frame's own pulses, NaN where left out, (n,).
        y: The same.
        relative: Whether they are relative to the current position, (n,).
        frame: Frame of each move, (n,).
        frames: All frames.
    """
    n = len(x)
    if not n:
        return np.zeros(0), np.zeros(0)
    begins = np.concatenate([[True], frame[1:] != frame[:-1]])
    first = np.maximum.accumulate(np.where(begins, np.arange(n), 0))
    in_frame, is_open = [], []
    for words in (x, y):
        given = ~np.isnan(words)
        sums = running_sum(np.where(relative & given, words, 0.0))
        base = np.maximum.accumulate(np.where(given & ~relative, np.arange(n), -1))
        known = base >= first
        # Relative to the last absolute word in this frame, or to the position at which the path entered it.
        since = sums[1:] - np.where(known, sums[base + 1], sums[first])
        in_frame.append(np.where(known, words[base], 0.0) + since)
        is_open.append(~known)
    group = np.cumsum(begins) - 1
    starts = np.flatnonzero(begins)
    # The position of entry matters only where a frame's moves begin relative, or with one axis alone.
    needed = distinct(group[is_open[0] | is_open[1]])
    enter_x, enter_y = _entries(needed, starts, in_frame, is_open, frame, frames)
    local_x = in_frame[0] + np.where(is_open[0], enter_x[group], 0.0)
    local_y = in_frame[1] + np.where(is_open[1], enter_y[group], 0.0)
    return frames.to_machine(frame, local_x, local_y)


def _entries(
    needed: Ints, starts: Indices, in_frame: list[Floats], is_open: list[Bools], frame: Ints, frames: Frames
) -> tuple[Floats, Floats]:
    """Position at which the path enters each group of moves in one frame, as seen from that frame; 0 if not needed.

    Each may depend on the one before it, so they are found one by one, in numbers of Python, not of numpy: those take
    ten times as long.
    """
    enter_x, enter_y = [0.0] * len(starts), [0.0] * len(starts)
    rows = (
        row
        for begin in range(0, len(needed), _GROUPS_AT_ONCE)
        for row in _entered(needed[begin : begin + _GROUPS_AT_ONCE], starts, in_frame, is_open, frame, frames)
    )
    for one, a, b, c, d, e, f, x, y, open_x, open_y, own_a, own_b, own_c, own_d, own_e, own_f, size in rows:
        before_x = before_y = 0.0
        if one:
            x, y = x + (enter_x[one - 1] if open_x else 0.0), y + (enter_y[one - 1] if open_y else 0.0)
            before_x, before_y = a * x + b * y + e, c * x + d * y + f
        before_x, before_y = before_x - own_e, before_y - own_f
        enter_x[one] = (own_d * before_x - own_b * before_y) / size
        enter_y[one] = (own_a * before_y - own_c * before_x) / size
    return np.array(enter_x), np.array(enter_y)


def _entered(
    groups: Ints, starts: Indices, in_frame: list[Floats], is_open: list[Bools], frame: Ints, frames: Frames
) -> Iterator[tuple[Any, ...]]:
    """For each group: the map, position and openness of the move before it, its own map and that map's determinant."""
    last, own = np.maximum(starts[groups] - 1, 0), frame[starts[groups]]
    maps = (frames.a, frames.b, frames.c, frames.d, frames.e, frames.f)
    determinant = frames.a[own] * frames.d[own] - frames.b[own] * frames.c[own]
    before = (*(column[frame[last]] for column in maps), *(column[last] for column in (*in_frame, *is_open)))
    columns: tuple[npt.NDArray[Any], ...] = (groups, *before, *(column[own] for column in maps), determinant)
    return zip(*(column.tolist() for column in columns), strict=True)


def bent_arcs(path: Path, at: Indices, frames: Frames, frame: Ints, pulses_per_mm: tuple[float, float]) -> DrawnArcs:
    """The arcs at rows `at` as the circles that they are in the pulses of their frames, without the frames' shift."""
    before = np.concatenate([[0.0], path.x])[at], np.concatenate([[0.0], path.y])[at]
    x1, y1 = frames.vectors_to_frame(frame, path.x[at], path.y[at])
    cx, cy = frames.vectors_to_frame(frame, path.cx[at], path.cy[at])
    radius, by_radius = path.radius[at] / frames.scale[frame], path.op[at] == Op.ARC_RADIUS
    ends = (*frames.vectors_to_frame(frame, *before), x1, y1)
    px, py = pulses_per_mm
    return DrawnArcs(
        arcs=arcs_by_either(ends, cx, cy, radius, path.ccw[at], by_radius),
        ends=ends,
        by_radius=by_radius,
        written=radius,
        mm_x=frames.scale[frame] / px,
        mm_y=frames.scale[frame] / py,
    )
