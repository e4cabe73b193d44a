"""Pass: whole pulses. Each coordinate is rounded half to even from its absolute value, so errors do not accumulate.

Directions are those before rounding. Rounding moves each point by half a pulse at most, but it turns a segment of a few
pulses by any angle: corners between rounded points would slow down a smooth path and cut its marks.
"""

from __future__ import annotations

import numpy as np

from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.intent import RunKind
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Floats, Indices, blocks, picked, rows_of
from gusjob.kinematics.geometry import (
    CLOSE_ENDS_PULSE,
    NO_ARCS,
    NO_CHORDS,
    Arcs,
    Chords,
    Ends,
    Unrounded,
    arcs_by_either,
    segments,
)
from gusjob.kinematics.units import acceleration_pulse_per_ms2, velocity_pulse_per_ms
from gusjob.planner.plan import QuantizedPath, SkyRows, StagedPath, next_phase

_NO_LENGTH, _NO_TURN = 1e-12, 1e-12
_SMALL_PULSE = 10.0
"""Radius above which an arc of two pulses is as long as its chord."""


def quantize(staged: StagedPath, sky: SkyRows) -> QuantizedPath:
    """Make segments between whole pulses, with velocity and acceleration along each segment's own direction."""
    path, timed = staged.path, staged.timed
    rows = rows_of(timed)
    x, y = path.x[rows], path.y[rows]
    (x0, x1), (y0, y1) = _whole(x), _whole(y)
    arc_at = np.flatnonzero(path.is_arc[timed])
    arcs = exact = NO_ARCS
    if len(arc_at):
        before = np.concatenate([[0.0], x[:-1]]), np.concatenate([[0.0], y[:-1]])
        arc_at, exact = _kept_arcs(staged, arc_at, (*before, x, y), (x0, y0, x1, y1))
        ends = (x0[arc_at], y0[arc_at], x1[arc_at], y1[arc_at])
        arc = timed[arc_at]
        cx, cy, by_radius = np.rint(path.cx[arc]), np.rint(path.cy[arc]), path.op[arc] == Op.ARC_RADIUS
        arcs = arcs_by_either(ends, cx, cy, path.radius[arc], path.ccw[arc], by_radius)
    dx, dy = np.diff(x, prepend=0.0), np.diff(y, prepend=0.0)
    if len(sky.events):
        _turn_to_marks(staged, sky, dx, dy)
    chords = _chords(staged, sky, (x - dx, y - dy, x, y)) if staged.job.path.is_arc.any() else NO_CHORDS
    unrounded = Unrounded(dx=dx, dy=dy, arcs=exact, chords=chords)
    lines_and_arcs = segments(x0, y0, x1, y1, arc_at, arcs, unrounded)
    vel, acc, end = picked(path.vel, rows), picked(path.acc, rows), picked(path.end, rows)
    if not staged.machine.equal_axes:
        machine = staged.machine
        along_x, along_y = lines_and_arcs.start_direction(np.arange(len(timed)))
        along_x[chords.at], along_y[chords.at] = dx[chords.at], dy[chords.at]
        scale = direction_scale(along_x, along_y, arc_at, machine.pulses_per_mm)
        # The motion goes between whole pulses: there, too, it stays within the limits.
        rounded = direction_scale(x1 - x0, y1 - y0, arc_at, machine.pulses_per_mm)
        px = machine.pulses_per_mm[0]
        fastest = velocity_pulse_per_ms(machine.max_velocity_mm_s, px) * rounded
        strongest = acceleration_pulse_per_ms2(machine.max_acceleration_mm_s2, px) * rounded
        vel = np.where(path.vel_in_mm[timed], np.minimum(vel * scale, fastest), vel)
        acc = np.where(path.acc_in_mm[timed], np.minimum(acc * scale, strongest), acc)
        end = np.where(path.end_in_mm[timed], np.minimum(end * scale, fastest), end)
    return next_phase(
        QuantizedPath,
        staged,
        segments=lines_and_arcs,
        vel=vel,
        acc=acc,
        forced_end=end,
        sky=sky,
    )


def _whole(values: Floats) -> tuple[Floats, Floats]:
    """Round the ends of segments to whole pulses: their starts and ends, two parts of one column."""
    points = np.zeros(len(values) + 1)
    np.rint(values, out=points[1:])
    points += 0.0  # A coordinate of -0 is 0.
    return points[:-1], points[1:]


def _turn_to_marks(staged: StagedPath, sky: SkyRows, dx: Floats, dy: Floats) -> None:
    """Turn straight runs of sky writing, and pieces of straight marks, in place into the direction of their marks.

    They end at whole pulses.

    Args:
        dx, dy: From the start to the end of each timed row, (m,) pulse.
    """
    timed, written = staged.timed, staged.job.path
    row = staged.origin[timed]
    straight = (staged.path.op[timed] == Op.LINE) & (written.op[row] == Op.LINE)
    turned = np.flatnonzero((sky.run_of(timed) != RunKind.NONE) & straight)
    for block in blocks(len(turned)):
        at = turned[block]
        x0, y0, x1, y1 = written.ends(row[at])
        mark_x, mark_y = x1 - x0, y1 - y0
        mark_length = np.hypot(mark_x, mark_y)
        moves = mark_length > 0
        at = at[moves]
        scale = np.hypot(dx[at], dy[at]) / mark_length[moves]
        mark_x, mark_y = mark_x[moves] * scale, mark_y[moves] * scale
        # Mode 1 also goes back.
        back = mark_x * dx[at] + mark_y * dy[at] < 0
        dx[at], dy[at] = np.where(back, -mark_x, mark_x), np.where(back, -mark_y, mark_y)


def direction_scale(dx: Floats, dy: Floats, arc_at: Indices, pulses_per_mm: tuple[float, float]) -> Floats:
    """Pulses per mm along each segment, divided by X's: velocities are in pulses of X.

    Arcs that are left here are circles in pulses. They run at one velocity in pulses, which is another one in mm in
    each direction: the axis with the fewest pulses per mm counts, so that nowhere it is more mm/s than written.
    """
    px, py = pulses_per_mm
    length_mm, chord = np.hypot(dx / px, dy / py), np.hypot(dx, dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(length_mm > 0, chord / length_mm / px, 1.0)
    scale[arc_at] = min(px, py) / px
    return scale


def _kept_arcs(staged: StagedPath, arc_at: Indices, unrounded: Ends, ends: Ends) -> tuple[Indices, Arcs]:
    """Find the arcs that are still arcs in whole pulses: which timed rows they are, and they as drawn.

    The others become lines.

    Sky writing adds arcs and splits them. A part that rounding leaves without a length, or that could be taken for
    a full circle, is none.

    Args:
        unrounded, ends: Ends of all timed rows before and after rounding, (m,) pulse each. The row before an arc in the
            path may be a switch that has not moved with it.
    """
    path, rows = staged.path, staged.timed[arc_at]
    (a0, b0, a1, b1), (x0, y0, x1, y1) = ([values[arc_at] for values in given] for given in (unrounded, ends))
    exact = _drawn_arcs(staged, rows, (a0, b0, a1, b1))
    chord, is_short = np.hypot(x1 - x0, y1 - y0), np.abs(exact.sweep) <= np.pi
    no_radius = (path.op[rows] == Op.ARC_CENTRE) & (np.rint(exact.cx) == x0) & (np.rint(exact.cy) == y0)
    like_line = is_short & ((chord == 0) | ((chord <= CLOSE_ENDS_PULSE) & (exact.radius > _SMALL_PULSE)))
    keep = np.flatnonzero(~like_line & ~no_radius)
    return arc_at[keep], exact.pick(keep)


def _drawn_arcs(staged: StagedPath, rows: Indices, ends: Ends) -> Arcs:
    """The arcs at some rows as they were drawn, between their unrounded ends.

    The radius of an arc that is sent by its radius fits the rounded ends: near half a turn it is another arc between
    the unrounded ones.
    """
    path, written, origin = staged.path, staged.job.path, staged.origin[rows]
    fitted = path.op[rows] == Op.ARC_RADIUS
    cx, cy = (np.where(fitted, w[origin], p[rows]) for w, p in ((written.cx, path.cx), (written.cy, path.cy)))
    by_radius = fitted & (written.op[origin] == Op.ARC_RADIUS)
    return arcs_by_either(ends, cx, cy, written.radius[origin], path.ccw[rows], by_radius)


def _chords(staged: StagedPath, sky: SkyRows, ends: Ends) -> Chords:
    """Find the lines in place of arcs, and the directions of these.

    Args:
        ends: Unrounded ends of all timed rows, (m,) pulse each.
    """
    written, rows = staged.job.path, staged.origin[staged.timed]
    is_chord = (staged.path.op[staged.timed] == Op.LINE) & written.is_arc[rows]
    at = np.flatnonzero(is_chord & (sky.run_of(staged.timed) == RunKind.NONE))
    if not len(at):
        return NO_CHORDS
    arc_rows, which = np.unique(rows[at], return_inverse=True)
    drawn, (px, py) = drawn_arcs(written, arc_rows, staged.machine), staged.machine.pulses_per_mm
    # Circles in their own unit, of which these are the pulses.
    unit_x, unit_y = (drawn.mm_x * px)[which], (drawn.mm_y * py)[which]
    cx, cy, sense = drawn.arcs.cx[which], drawn.arcs.cy[which], np.sign(drawn.arcs.sweep)[which]
    x0, y0, x1, y1 = (values[at] for values in ends)
    directions = []
    for x, y in ((x0, y0), (x1, y1)):
        along_x, along_y = -sense * (y / unit_y - cy) * unit_x, sense * (x / unit_x - cx) * unit_y
        size = np.maximum(np.hypot(along_x, along_y), _NO_LENGTH)
        directions += [along_x / size, along_y / size]
    start_x, start_y, end_x, end_y = directions
    turn = np.abs(np.arctan2(start_x * end_y - start_y * end_x, start_x * end_x + start_y * end_y))
    length = np.hypot(x1 - x0, y1 - y0)
    radius = np.where(length > 0, length / np.maximum(turn, _NO_TURN), np.inf)
    continues = (np.diff(at, append=-1) == 1) & (np.diff(which, append=-1) == 0)
    return Chords(at=at, start_x=start_x, start_y=start_y, end_x=end_x, end_y=end_y, radius=radius, continues=continues)
