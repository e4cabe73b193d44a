"""The ways beyond the ends of marks: on their own line or circle, to whole pulses, never too short."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import TURN, Arcs, Segments

_HALF_PULSE = 0.7072
"""By how much a whole pulse may lie beside the point it stands for: half the diagonal."""
_LONGER_PULSE = (0.0, 0.75, 1.5, 2.25, 3.0, 4.0)
"""What is tried to make an arc long enough whose ends and centre are rounded."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Beyond:
    """The way beyond one end of marks `at`, (k,) each: along the mark's own line or circle to (x, y), in whole pulses.

    Where it would go round more than half of its circle it leaves it there, straight on to (far_x, far_y): `leaves`.
    """

    at: Indices
    x: Floats
    y: Floats
    leaves: Bools
    far_x: Floats
    far_y: Floats


def beyond_of(laid: Segments, at: Indices, length: Floats, *, ahead: bool) -> Beyond:
    """The way beyond the ends of marks (`ahead`), or before their starts."""
    from_x, from_y = (laid.x1[at], laid.y1[at]) if ahead else (laid.x0[at], laid.y0[at])
    way = 1.0 if ahead else -1.0
    dx, dy = (laid.end_x[at], laid.end_y[at]) if ahead else (laid.start_x[at], laid.start_y[at])
    x, y = _further(from_x, from_y, way * dx, way * dy, length)
    far_x, far_y, leaves = x, y, np.zeros(len(at), dtype=np.bool_)
    round_, arcs = laid.arcs_among(at)
    if len(round_):
        sense = np.sign(arcs.sweep) * way
        begin = arcs.angle + (arcs.sweep if ahead else 0.0)
        half_turn = np.pi * arcs.radius
        along = np.minimum(length[round_], half_turn)
        x[round_], y[round_] = _along(arcs, begin, sense, along, from_x[round_], from_y[round_], ahead=ahead)
        rest = length[round_] - along
        leaves[round_] = rest > 0
        angle = begin + sense * along / arcs.radius
        far_x, far_y = x.copy(), y.copy()
        far_x[round_], far_y[round_] = _further(
            x[round_], y[round_], -np.sin(angle) * sense, np.cos(angle) * sense, rest
        )
    return Beyond(at=at, x=x, y=y, leaves=leaves, far_x=far_x, far_y=far_y)


def _along(
    arcs: Arcs, begin: Floats, sense: Floats, length: Floats, from_x: Floats, from_y: Floats, *, ahead: bool
) -> tuple[Floats, Floats]:
    """Whole pulses at least a length away along circles, as arcs about their rounded centres measure it."""
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


def _further(x: Floats, y: Floats, dx: Floats, dy: Floats, length: Floats) -> tuple[Floats, Floats]:
    """Whole pulses at least a length away in a direction: a run-in that rounding shortens would miss its speed."""
    to_x, to_y = np.rint(x + dx * length), np.rint(y + dy * length)
    short = np.hypot(to_x - x, to_y - y) < length - 1e-6
    more = length + _HALF_PULSE
    return (
        np.where(short, np.rint(x + dx * more), to_x) + 0.0,
        np.where(short, np.rint(y + dy * more), to_y) + 0.0,
    )
