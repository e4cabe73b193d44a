"""Absolute position after each row."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gusjob.frontend.parse.forms import Column
from gusjob.frontend.resolve.columns import ResolvedColumns, filled, last_set
from gusjob.kinematics.arrays import Bools, Floats, running_sum
from gusjob.kinematics.geometry import SAME_POINT_MM, SAME_POINT_PULSE

if TYPE_CHECKING:  # Start-up time: most jobs have no FRAME.
    from gusjob.frontend.resolve.frames import Frames

_STAYS_PULSE = 1e-6


def positions(columns: ResolvedColumns, frames: Frames | None) -> tuple[Floats, Floats]:
    """Absolute position after each row, pulse, not rounded. `frames`: None if the job has none."""
    return _with_closed_circles(columns, *_positions(columns, frames))


def _with_closed_circles(columns: ResolvedColumns, x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """The positions with the end of an arc at its start where only float noise is between them."""
    arcs = np.flatnonzero(columns.is_arc)
    stays = np.ones(len(arcs), dtype=np.bool_)
    moved = np.zeros(len(arcs), dtype=np.bool_)
    for values, pulses_per_mm in zip((x, y), columns.machine.pulses_per_mm, strict=True):
        distance = np.abs(values[arcs] - np.where(arcs > 0, values[arcs - 1], 0.0))
        stays &= distance < min(SAME_POINT_MM * pulses_per_mm, SAME_POINT_PULSE)
        moved |= distance > 0
    if not (stays & moved).any():
        return x, y
    open_rows = columns.moves.copy()
    open_rows[arcs[stays]] = False
    return filled(np.where(open_rows, x, np.nan), 0.0), filled(np.where(open_rows, y, np.nan), 0.0)


def _positions(columns: ResolvedColumns, frames: Frames | None) -> tuple[Floats, Floats]:
    """Absolute position after each row, pulse, as written."""
    x, y = (_axis_words(columns, column, axis) for axis, column in enumerate((Column.X, Column.Y)))
    relative = columns.relative()
    if frames is None:
        return _axis_positions(x, relative), _axis_positions(y, relative)
    from gusjob.frontend.resolve.frames import positions_in_frames

    moves = np.flatnonzero(columns.moves)
    frame = columns.frame()[moves]
    is_relative = relative[moves] if relative is not None else np.zeros(len(moves), dtype=np.bool_)
    px, py = positions_in_frames(x[moves], y[moves], is_relative, frame, frames)
    # Mapping into a frame and back costs the last bits; a position that stays (a full circle) must stay exactly.
    before_x, before_y = np.concatenate([[0.0], px[:-1]]), np.concatenate([[0.0], py[:-1]])
    stays = np.hypot(px - before_x, py - before_y) < _STAYS_PULSE
    found = []
    for values in (np.where(stays, np.nan, px), np.where(stays, np.nan, py)):
        spread = np.full(len(columns.op), np.nan)
        spread[moves] = values
        found.append(filled(spread, 0.0))
    return found[0], found[1]


def _axis_words(columns: ResolvedColumns, column: Column, axis: int) -> Floats:
    """X or Y of moves, pulse; NaN where an axis is left out."""
    if not columns.has(column):
        return np.broadcast_to(np.float64(np.nan), len(columns.op))
    words = columns.length(column, axis)  # An array of its own.
    np.copyto(words, np.nan, where=~columns.moves)
    return words


def _axis_positions(words: Floats, relative: Bools | None) -> Floats:
    """Absolute position on an axis after each row, pulse, where there is no frame."""
    if len(words) and words.strides == (0,):
        return np.broadcast_to(np.float64(0.0), len(words))
    if relative is None:
        return filled(words, 0.0)
    given = ~np.isnan(words)
    sums = running_sum(np.where(relative & given, words, 0.0))[1:]
    base = last_set(given & ~relative)
    return np.where(base >= 0, words[base] - sums[base], 0.0) + sums
