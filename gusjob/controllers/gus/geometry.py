"""Geometry of buffered calls."""

from __future__ import annotations

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.kinematics.arrays import Bools, Floats, Indices, before, fill_gaps, rows_of
from gusjob.kinematics.geometry import Segments, arcs_by_either, segments

_ROUNDING_PULSE = 1e-6


def call_segments(
    calls: BufferedCalls,
    row: Indices,
    dwell: Bools,
    start: tuple[float, float] = (0.0, 0.0),
    origin: tuple[Floats, Floats] | None = None,
) -> Segments:
    """Make the segments of consecutive motions and dwells from the coordinates of their calls.

    Args:
        calls: Buffered calls.
        row: Rows of the motions and dwells, (m,).
        dwell: Which of them are dwells, (m,); a dwell stays where it is.
        start: Where the first one starts, pulse.
        origin: The origin of each one's coordinate system on the machine, x and y, (m,) pulse; None: all at 0.
    """
    place = rows_of(row)
    (x0, x1), (y0, y1) = (
        _ends(values, place, dwell, begin, None if origin is None else origin[axis])
        for axis, (values, begin) in enumerate(((calls.x, start[0]), (calls.y, start[1])))
    )
    kind = calls.kind[place]
    at = np.flatnonzero((kind == Buffered.ARC_CENTRE) | (kind == Buffered.ARC_RADIUS))
    # After a stop an origin need not be whole: a circle ends where it starts but for rounding.
    near = np.hypot(x1[at] - x0[at], y1[at] - y0[at]) < _ROUNDING_PULSE
    ends, row = (x0[at], y0[at], np.where(near, x0[at], x1[at]), np.where(near, y0[at], y1[at])), row[at]
    # p and q are the centre's offset from the start, or p is the radius.
    p, q, by_radius = calls.p[row], calls.q[row], kind[at] == Buffered.ARC_RADIUS
    arcs = arcs_by_either(ends, x0[at] + p, y0[at] + q, p, calls.r[row] == 1, by_radius)
    return segments(x0, y0, x1, y1, at, arcs)


def _ends(
    values: Floats, rows: Indices | slice, dwell: Bools, start: float, origin: Floats | None
) -> tuple[Floats, Floats]:
    """Return where consecutive motions and dwells start and end on an axis. Arguments as those of call_segments."""
    if origin is None and isinstance(rows, slice) and not dwell.any():
        return before(values, rows, start), values[rows]
    # Each starts where the one before it ends: both are parts of one array.
    points = np.empty(len(dwell) + 1)
    points[0], points[1:] = start, values[rows]
    if origin is not None:
        points[1:] += origin
    fill_gaps(points[1:], np.flatnonzero(dwell), start)
    return points[:-1], points[1:]
