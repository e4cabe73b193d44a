"""Pass: whole pulses. Each coordinate is rounded half to even from its absolute value, so errors do not accumulate.

Directions are those before rounding. Rounding moves each point by half a pulse at most, but it turns a segment of a few
pulses by any angle: corners between rounded points would slow down a smooth path and cut its marks.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gusjob.ir.intent import RunKind
from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.geometry import NO_ARCS, Arcs, Ends, Unrounded, arcs_by_either, segments
from gusjob.planner.plan import QuantizedPath, SkyRows, StagedPath, next_phase


def quantize(staged: StagedPath, sky: SkyRows) -> QuantizedPath:
    """Make segments between whole pulses, with velocity and acceleration along each segment's own direction."""
    path, timed = staged.path, staged.timed
    x, y = path.x[timed], path.y[timed]
    # + 0.0: a coordinate of -0 is 0.
    x1, y1 = np.rint(x) + 0.0, np.rint(y) + 0.0
    x0, y0 = np.concatenate([[0.0], x1[:-1]]), np.concatenate([[0.0], y1[:-1]])
    arc_at = np.flatnonzero(path.is_arc[timed])
    arcs = exact = NO_ARCS
    if len(arc_at):
        path, arc_at, exact = _kept_arcs(path, timed, arc_at, (x0, y0, x1, y1))
        ends = (x0[arc_at], y0[arc_at], x1[arc_at], y1[arc_at])
        rows = timed[arc_at]
        arcs = _arcs(path, rows, ends, np.rint(path.cx[rows]), np.rint(path.cy[rows]))
    dx, dy = np.diff(x, prepend=0.0), np.diff(y, prepend=0.0)
    if len(sky.events):
        _turn_to_marks(staged, sky, dx, dy)
    lines_and_arcs = segments(x0, y0, x1, y1, arc_at, arcs, Unrounded(dx=dx, dy=dy, arcs=exact))
    vel, acc, end = path.vel[timed], path.acc[timed], path.end[timed]
    if not staged.machine.equal_axes:
        along_x, along_y = lines_and_arcs.start_x.copy(), lines_and_arcs.start_y.copy()
        along_x[arc_at], along_y[arc_at] = dx[arc_at], dy[arc_at]
        scale = direction_scale(along_x, along_y, staged.machine.pulses_per_mm)
        vel = np.where(path.vel_in_mm[timed], vel * scale, vel)
        acc = np.where(path.acc_in_mm[timed], acc * scale, acc)
        end = np.where(path.end_in_mm[timed], end * scale, end)
    return next_phase(
        QuantizedPath,
        replace(staged, path=path),
        segments=lines_and_arcs,
        vel=vel,
        acc=acc,
        forced_end=end,
        sky=sky,
    )


def _turn_to_marks(staged: StagedPath, sky: SkyRows, dx: Floats, dy: Floats) -> None:
    """Turn straight runs of sky writing, and pieces of straight marks, in place into the direction of their marks.

    They end at whole pulses.

    Args:
        dx, dy: From the start to the end of each timed row, (m,) pulse.
    """
    timed, written = staged.timed, staged.job.path
    row = staged.origin[timed]
    straight = (staged.path.op[timed] == Op.LINE) & (written.op[row] == Op.LINE)
    at = np.flatnonzero((sky.run_of(timed) != RunKind.NONE) & straight)
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


def direction_scale(dx: Floats, dy: Floats, pulses_per_mm: tuple[float, float]) -> Floats:
    """Pulses per mm along each segment, divided by X's: velocities are in pulses of X.

    For a line only: arcs that are left here are circles in pulses.
    """
    px, py = pulses_per_mm
    length_mm, chord = np.hypot(dx / px, dy / py), np.hypot(dx, dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(length_mm > 0, chord / length_mm / px, 1.0)


def _kept_arcs(path: Path, timed: Indices, arc_at: Indices, ends: Ends) -> tuple[Path, Indices, Arcs]:
    """Find the arcs that are still arcs in whole pulses: the path, which timed rows they are, and they before rounding.

    Where both ends round to one pulse, an arc of more than half a turn is a full circle, about its centre whatever its
    form was; a shorter one has no length, and neither has an arc whose centre rounds to its start: both become lines.
    """
    rows = timed[arc_at]
    x0, y0, x1, y1 = (values[arc_at] for values in ends)
    exact = _arcs(path, rows, path.ends(rows), path.cx[rows], path.cy[rows])
    by_radius = path.op[rows] == Op.ARC_RADIUS
    one_pulse = (x0 == x1) & (y0 == y1)
    full = one_pulse & (np.abs(exact.sweep) > np.pi)
    no_radius = (~by_radius | full) & (np.rint(exact.cx) == x0) & (np.rint(exact.cy) == y0)
    keep = (full | ~one_pulse) & ~no_radius
    turned = full & by_radius
    if turned.any():
        op, cx, cy = path.op.copy(), path.cx.copy(), path.cy.copy()
        at = rows[turned]
        op[at], cx[at], cy[at] = Op.ARC_CENTRE, exact.cx[turned], exact.cy[turned]
        path = replace(path, op=op, cx=cx, cy=cy)
    return path, arc_at[keep], exact.pick(np.flatnonzero(keep))


def _arcs(path: Path, rows: Indices, ends: Ends, cx: Floats, cy: Floats) -> Arcs:
    """The arcs at some rows, by centre or by radius as they were written."""
    return arcs_by_either(ends, cx, cy, path.radius[rows], path.ccw[rows], path.op[rows] == Op.ARC_RADIUS)
