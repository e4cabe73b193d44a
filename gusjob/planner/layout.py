"""Pass: whole pulses. Each coordinate is rounded half to even from its absolute value, so nothing accumulates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.geometry import NO_ARCS, Arcs, Ends, arcs_by_either, segments
from gusjob.planner.plan import Plan


def layout(state: Plan) -> Plan:
    """Segments between whole pulses; velocity and acceleration along each segment's own direction.

    What is laid out already stays as it is.
    """
    if state.segments is not None:
        return state
    path, machine, timed = state.path, state.machine, state.timed
    # + 0.0: a coordinate of -0 is 0.
    x1, y1 = np.rint(path.x[timed]) + 0.0, np.rint(path.y[timed]) + 0.0
    x0, y0 = np.concatenate([[0.0], x1[:-1]]), np.concatenate([[0.0], y1[:-1]])
    arc_at = np.flatnonzero((path.op[timed] == Op.ARC_CENTRE) | (path.op[timed] == Op.ARC_RADIUS))
    arcs = NO_ARCS
    if len(arc_at):
        path, arc_at = _kept_arcs(path, timed, arc_at, (x0, y0, x1, y1))
        arcs = _whole_arcs(path, timed[arc_at], (x0[arc_at], y0[arc_at], x1[arc_at], y1[arc_at]))
    laid = segments(x0, y0, x1, y1, arc_at, arcs)
    scale = np.ones(len(timed))
    if not machine.equal_axes:
        # Pulses per mm along the segment, against X's, in which velocities stand (arcs left here are circles
        # in pulses).
        px, py = machine.pulses_per_mm
        length_mm = np.hypot((x1 - x0) / px, (y1 - y0) / py)
        chord = np.hypot(x1 - x0, y1 - y0)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(length_mm > 0, chord / length_mm / px, 1.0)
    return replace(
        state,
        path=path,
        segments=laid,
        vel=np.where(path.vel_in_mm[timed], path.vel[timed] * scale, path.vel[timed]),
        acc=np.where(path.acc_in_mm[timed], path.acc[timed] * scale, path.acc[timed]),
        vel_end=np.where(path.end_in_mm[timed], path.end[timed] * scale, path.end[timed]),
    )


def _kept_arcs(path: Path, timed: Indices, arc_at: Indices, ends: Ends) -> tuple[Path, Indices]:
    """Arcs that are still arcs in whole pulses.

    Where both ends fall on one pulse, an arc of more than half a turn is a full circle, about its centre whatever its
    form was; a shorter one has no length, and so has an arc whose centre falls on its start: both become lines.
    """
    rows = timed[arc_at]
    x0, y0, x1, y1 = (values[arc_at] for values in ends)
    meant = _picked(path, rows, _unrounded_ends(path, rows), path.cx[rows], path.cy[rows])
    one_pulse = (x0 == x1) & (y0 == y1)
    full = one_pulse & (np.abs(meant.sweep) > np.pi)
    by_centre = (path.op[rows] == Op.ARC_CENTRE) | full
    no_radius = by_centre & (np.rint(meant.cx) == x0) & (np.rint(meant.cy) == y0)
    keep = (full | ~one_pulse) & ~no_radius
    turned = rows[full & (path.op[rows] == Op.ARC_RADIUS)]
    if len(turned):
        op, cx, cy = path.op.copy(), path.cx.copy(), path.cy.copy()
        closed = full & (path.op[rows] == Op.ARC_RADIUS)
        op[turned], cx[turned], cy[turned] = Op.ARC_CENTRE, meant.cx[closed], meant.cy[closed]
        path = replace(path, op=op, cx=cx, cy=cy)
    return path, arc_at[keep]


def _whole_arcs(path: Path, rows: Indices, ends: Ends) -> Arcs:
    return _picked(path, rows, ends, np.rint(path.cx[rows]), np.rint(path.cy[rows]))


def _unrounded_ends(path: Path, rows: Indices) -> Ends:
    before_x, before_y = np.concatenate([[0.0], path.x]), np.concatenate([[0.0], path.y])
    return before_x[rows], before_y[rows], path.x[rows], path.y[rows]


def _picked(path: Path, rows: Indices, ends: Ends, cx: Floats, cy: Floats) -> Arcs:
    """The arcs at rows, by centre or by radius as they were written."""
    by_radius = path.op[rows] == Op.ARC_RADIUS
    return arcs_by_either(ends, cx, cy, path.radius[rows], path.ccw[rows], by_radius)
