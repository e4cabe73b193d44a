"""Pass: whole pulses. Each coordinate is rounded half to even from its absolute value, so errors do not accumulate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.geometry import NO_ARCS, Arcs, Ends, arcs_by_either, segments
from gusjob.planner.plan import QuantizedPath, SkyRows, StagedPath, next_phase


def quantize(staged: StagedPath, sky: SkyRows) -> QuantizedPath:
    """Make segments between whole pulses, with velocity and acceleration along each segment's own direction."""
    path, timed = staged.path, staged.timed
    # + 0.0: a coordinate of -0 is 0.
    x1, y1 = np.rint(path.x[timed]) + 0.0, np.rint(path.y[timed]) + 0.0
    x0, y0 = np.concatenate([[0.0], x1[:-1]]), np.concatenate([[0.0], y1[:-1]])
    arc_at = np.flatnonzero(path.is_arc[timed])
    arcs = NO_ARCS
    if len(arc_at):
        path, arc_at = _kept_arcs(path, timed, arc_at, (x0, y0, x1, y1))
        ends = (x0[arc_at], y0[arc_at], x1[arc_at], y1[arc_at])
        rows = timed[arc_at]
        arcs = _arcs(path, rows, ends, np.rint(path.cx[rows]), np.rint(path.cy[rows]))
    vel, acc, end = path.vel[timed], path.acc[timed], path.end[timed]
    if not staged.machine.equal_axes:
        scale = direction_scale(x1 - x0, y1 - y0, arc_at, staged.machine.pulses_per_mm)
        vel = np.where(path.vel_in_mm[timed], vel * scale, vel)
        acc = np.where(path.acc_in_mm[timed], acc * scale, acc)
        end = np.where(path.end_in_mm[timed], end * scale, end)
    return next_phase(
        QuantizedPath,
        replace(staged, path=path),
        segments=segments(x0, y0, x1, y1, arc_at, arcs),
        vel=vel,
        acc=acc,
        forced_end=end,
        sky=sky,
    )


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


def _kept_arcs(path: Path, timed: Indices, arc_at: Indices, ends: Ends) -> tuple[Path, Indices]:
    """Find the arcs that are still arcs in whole pulses; returns the path, and which timed rows they are.

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
    return path, arc_at[keep]


def _arcs(path: Path, rows: Indices, ends: Ends, cx: Floats, cy: Floats) -> Arcs:
    """The arcs at some rows, by centre or by radius as they were written."""
    return arcs_by_either(ends, cx, cy, path.radius[rows], path.ccw[rows], path.op[rows] == Op.ARC_RADIUS)
