"""Geometry of runs: beyond the ends of marks, on their own line or circle, to whole pulses, never too short."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import TURN, Arcs, Segments

_HALF_DIAGONAL_PULSE = 0.7072
"""Largest shift of a point by rounding to whole pulses: half the diagonal of a pulse."""
_LONGER_PULSE = (0.0, 0.75, 1.5, 2.25, 3.0, 4.0)
"""Additions that are tried until an arc whose ends and centre are rounded is long enough."""


class Runs(Struct, frozen=True, kw_only=True, eq=False):
    """Runs at one end of the marks `at`, (k,) each: along the mark's own line or circle to (x, y), in whole pulses.

    A run that is longer than half its circle leaves the circle at (x, y), straight to (far_x, far_y): `leaves`.
    """

    at: Indices
    x: Floats
    y: Floats
    leaves: Bools
    far_x: Floats
    far_y: Floats


def runs_of(segments: Segments, at: Indices, length_pulse: Floats, *, ahead: bool) -> Runs:
    """Compute the runs of some marks.

    Args:
        segments: Segments of all timed rows, (m,).
        at: Numbers of the marks among them, (k,).
        length_pulse: Length of each run, (k,).
        ahead: Beyond the end of the marks (run-out); else before their start (run-in).
    """
    from_x, from_y = (segments.x1[at], segments.y1[at]) if ahead else (segments.x0[at], segments.y0[at])
    direction = 1.0 if ahead else -1.0
    dx, dy = segments.end_direction(at) if ahead else segments.start_direction(at)
    x, y = _straight(from_x, from_y, direction * dx, direction * dy, length_pulse)
    far_x, far_y, leaves = x, y, np.zeros(len(at), dtype=np.bool_)
    on_arc, arcs = segments.arcs_among(at)
    if len(on_arc):
        sense = np.sign(arcs.sweep) * direction
        begin = arcs.angle + (arcs.sweep if ahead else 0.0)
        half_turn = np.pi * arcs.radius
        along = np.minimum(length_pulse[on_arc], half_turn)
        x[on_arc], y[on_arc] = _on_circles(arcs, begin, sense, along, from_x[on_arc], from_y[on_arc], ahead=ahead)
        rest = length_pulse[on_arc] - along
        leaves[on_arc] = rest > 0
        angle = begin + sense * along / arcs.radius
        far_x, far_y = x.copy(), y.copy()
        far_x[on_arc], far_y[on_arc] = _straight(
            x[on_arc], y[on_arc], -np.sin(angle) * sense, np.cos(angle) * sense, rest
        )
    return Runs(at=at, x=x, y=y, leaves=leaves, far_x=far_x, far_y=far_y)


def _on_circles(
    arcs: Arcs, begin: Floats, sense: Floats, length: Floats, from_x: Floats, from_y: Floats, *, ahead: bool
) -> tuple[Floats, Floats]:
    """Whole pulses at least a length away along circles, measured as the arcs about their rounded centres."""
    cx, cy = np.rint(arcs.cx), np.rint(arcs.cy)
    here = np.arctan2(from_y - cy, from_x - cx)
    x, y = from_x.copy(), from_y.copy()
    short = np.ones(len(x), dtype=np.bool_)
    for longer in _LONGER_PULSE:
        angle = begin + sense * (length + longer) / arcs.radius
        x[short] = (np.rint(arcs.cx + arcs.radius * np.cos(angle)) + 0.0)[short]
        y[short] = (np.rint(arcs.cy + arcs.radius * np.sin(angle)) + 0.0)[short]
        sweep = ((np.arctan2(y - cy, x - cx) - here) * sense) % TURN
        radius = np.hypot(from_x - cx, from_y - cy) if ahead else np.hypot(x - cx, y - cy)
        short &= sweep * radius < length
    return x, y


def _straight(x: Floats, y: Floats, dx: Floats, dy: Floats, length: Floats) -> tuple[Floats, Floats]:
    """Whole pulses at least a length away in a direction: a run-in that rounding shortens would miss its velocity."""
    to_x, to_y = np.rint(x + dx * length), np.rint(y + dy * length)
    short = np.hypot(to_x - x, to_y - y) < length - 1e-6
    more = length + _HALF_DIAGONAL_PULSE
    return (
        np.where(short, np.rint(x + dx * more), to_x) + 0.0,
        np.where(short, np.rint(y + dy * more), to_y) + 0.0,
    )
