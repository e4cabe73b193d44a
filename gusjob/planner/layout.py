"""Pass: whole pulses. Each coordinate is rounded half to even from its absolute value, so nothing accumulates."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from gusjob.geometry import NO_ARCS, Arcs, arcs_by_centre, arcs_by_radius, segments
from gusjob.job import Op
from gusjob.planner.plan import Plan


def layout(state: Plan) -> Plan:
    """Segments between whole pulses; velocity and acceleration along each segment's own direction."""
    path, machine, timed = state.path, state.machine, state.timed
    # + 0.0: a coordinate of -0 is 0.
    x1, y1 = np.rint(path.x[timed]) + 0.0, np.rint(path.y[timed]) + 0.0
    x0, y0 = np.concatenate([[0.0], x1[:-1]]), np.concatenate([[0.0], y1[:-1]])
    op = path.op[timed]
    arc_at = np.flatnonzero((op == Op.ARC_CENTRE) | (op == Op.ARC_RADIUS))
    arcs = NO_ARCS
    if len(arc_at):
        rows = timed[arc_at]
        ends = (x0[arc_at], y0[arc_at], x1[arc_at], y1[arc_at])
        # An arc so short that its ends fall on one pulse must not turn into a full circle: it has no length.
        full = (path.x[rows] == np.concatenate([[0.0], path.x])[rows]) & (
            path.y[rows] == np.concatenate([[0.0], path.y])[rows]
        )
        none = (ends[0] == ends[2]) & (ends[1] == ends[3]) & ~full
        by_centre = arcs_by_centre(*ends, np.rint(path.cx[rows]), np.rint(path.cy[rows]), path.ccw[rows])
        by_radius = arcs_by_radius(*ends, path.radius[rows], path.ccw[rows])
        radius_form = op[arc_at] == Op.ARC_RADIUS
        columns = {
            f.name: np.where(radius_form, getattr(by_radius, f.name), getattr(by_centre, f.name)) for f in fields(Arcs)
        }
        if none.any():
            keep = ~none
            arc_at, columns = arc_at[keep], {k: v[keep] for k, v in columns.items()}
        arcs = Arcs(**columns)
    laid = segments(x0, y0, x1, y1, arc_at, arcs)
    scale = np.ones(len(timed))
    if not machine.equal_axes:
        # Pulses per mm along the segment, against X's, in which velocities stand (arcs left here are circles in
        # pulses).
        px, py = machine.pulses_per_mm
        length_mm = np.hypot((x1 - x0) / px, (y1 - y0) / py)
        chord = np.hypot(x1 - x0, y1 - y0)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(length_mm > 0, chord / length_mm / px, 1.0)
    return replace(
        state,
        segments=laid,
        vel=np.where(path.vel_in_mm[timed], path.vel[timed] * scale, path.vel[timed]),
        acc=np.where(path.acc_in_mm[timed], path.acc[timed] * scale, path.acc[timed]),
        vel_end=np.where(path.end_in_mm[timed], path.end[timed] * scale, path.end[timed]),
    )
