"""Where light comes and goes at simple marks, at once: those that are straight, stand alone and are lit by one channel.

Such a mark is at mark speed from its first point to the end of its run-out's constant part, so the places follow from
times alone. The others wait until all velocities are planned (switch_points.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from gusjob.kinematics.arrays import Bools, Floats
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import Plan
from gusjob.planner.skywriting.marks import Marks
from gusjob.planner.skywriting.timeline import OFF, ON, delays_us

_NEAR_PULSE = 0.75
"""A point so near to an end may be that end, in whole pulses."""


_SLOWEST = 0.2
"""Share of the mark speed below which a whole pulse takes so long that the light may be off: others look at that."""


class Leg(IntEnum):
    """Where a switch stands."""

    START = 0
    MARK = 1
    END = 2
    RUN_OUT = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Side:
    """Where light comes, or goes, (m,) for the timed rows of a plan: Leg, and in whole pulses the point there."""

    leg: npt.NDArray[np.int8]
    x: Floats
    y: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Places:
    """Both sides of one channel's light, (m,) each, where they are `known`."""

    known: Bools
    on: Side
    off: Side


def places_of(state: Plan, marks: Marks, laid: Segments, outs: tuple[Floats, Floats], channel: int) -> Places:
    """The places of a channel's light; `outs`: where run-outs end, pulse."""
    known = marks.begins & marks.ends & marks.lit[channel] & ~marks.lit[1 - channel]
    known[laid.arc_at] = False
    at = np.flatnonzero(known)
    late_us = delays_us(state)[marks.stage[at], channel]
    on_us, off_us = marks.on_us[at] - late_us[:, ON], marks.lag_us[at] - late_us[:, OFF]
    vel, acc, length = marks.vel[at], marks.acc[at], laid.length[at]
    off_ms = off_us / US_PER_MS + length / vel
    out_length = np.hypot(outs[0][at] - laid.x1[at], outs[1][at] - laid.y1[at])
    flat = length + out_length - vel * vel / (2 * acc)
    on_way, on_known = _way(on_us / US_PER_MS, vel, acc, flat)
    off_way, off_known = _way(off_ms, vel, acc, flat)
    long_enough = length > 2 * _NEAR_PULSE
    lights = marks.on_us[at] - marks.lag_us[at] < length / vel * US_PER_MS
    known[at] = on_known & off_known & long_enough & lights & (off_way - on_way > 2 * _NEAR_PULSE)
    sides = []
    for way in (on_way, off_way):
        side = Side(leg=np.zeros(len(known), dtype=np.int8), x=np.zeros(len(known)), y=np.zeros(len(known)))
        # Leg by leg, in their order.
        leg = Leg.START + (way >= _NEAR_PULSE) + (way >= length - _NEAR_PULSE) + (way >= length + _NEAR_PULSE)
        out = leg == Leg.RUN_OUT
        x0, y0 = np.where(out, laid.x1[at], laid.x0[at]), np.where(out, laid.y1[at], laid.y0[at])
        x1, y1 = np.where(out, outs[0][at], laid.x1[at]), np.where(out, outs[1][at], laid.y1[at])
        run = np.where(out, way - length, way)
        share = run / np.maximum(np.where(out, out_length, length), 1.0)
        side.leg[at] = leg
        side.x[at], side.y[at] = np.rint(x0 + (x1 - x0) * share) + 0.0, np.rint(y0 + (y1 - y0) * share) + 0.0
        sides.append(side)
    return Places(known=known, on=sides[0], off=sides[1])


def _way(time_ms: Floats, vel: Floats, acc: Floats, flat: Floats) -> tuple[Floats, Bools]:
    """How far beyond marks' starts the command is a time after it was there, pulse; and whether that is known.

    At speed over a length `flat`, then braking; not before the start, and not near the standstill.
    """
    braking_ms = np.maximum(time_ms - flat / vel, 0.0)
    way = vel * time_ms - acc * braking_ms * braking_ms / 2
    left_ms = vel / acc - braking_ms
    moves = (acc * left_ms > _SLOWEST * vel) & (acc * left_ms * left_ms / 2 > _NEAR_PULSE)
    return way, (way > -_NEAR_PULSE) & (left_ms > 0) & moves
