"""Switch points of simple marks: straight, with a run-in and a run-out of their own, one channel's laser on.

Such a mark is at mark speed from its first point to the end of the constant part of its run-out, whatever follows.
Where both switches come in this time, their points follow from times alone. The others are found when all velocities
are planned (place_switches.py): how a run-out brakes depends on the motion behind it.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import QuantizedPath
from gusjob.planner.skywriting.marks import Marks
from gusjob.planner.skywriting.switch_events import OFF, ON, delays_us

_NEAR_PULSE = 0.75
"""A point that is nearer to an end than this may round to it."""

_BRAKES_PULSE = 0.05
"""By how much braking may shift a switch point that counts as at mark speed: the times of AUTO are rounded."""


class SwitchLeg(IntEnum):
    """Position of a switch: at the start of the mark, inside it, at its end, or in the run-out."""

    START = 0
    MARK = 1
    END = 2
    RUN_OUT = 3


class SwitchPositions(Struct, frozen=True, kw_only=True, eq=False):
    """Switch points of one kind, (m,) for the timed rows: SwitchLeg, and the position in whole pulses."""

    leg: npt.NDArray[np.int8]
    x: Floats
    y: Floats


class SimpleMarkSwitches(Struct, frozen=True, kw_only=True, eq=False):
    """Laser-on and laser-off of one channel for the timed rows, (m,), where they are `known`."""

    known: Bools
    on: SwitchPositions
    off: SwitchPositions


def simple_mark_switches(
    quantized: QuantizedPath, marks: Marks, run_out_ends: tuple[Floats, Floats], channel: int
) -> SimpleMarkSwitches:
    """Compute the switch points of a channel's simple marks.

    Args:
        run_out_ends: x and y of the end of each timed row's run-out, (m,) pulse.
    """
    segments = quantized.segments
    known = marks.begins & marks.ends & marks.on_alone(channel)
    known[segments.arc_at] = False
    at = np.flatnonzero(known)
    late_us = delays_us(quantized)[marks.stage[at], channel]
    on_us, off_us = marks.on_us[at] - late_us[:, ON], marks.lag_us[at] - late_us[:, OFF]
    vel, acc, length = marks.vel[at], marks.acc[at], segments.length[at]
    off_ms = off_us / US_PER_MS + length / vel
    end_x, end_y = run_out_ends[0][at], run_out_ends[1][at]
    out_length = np.hypot(end_x - segments.x1[at], end_y - segments.y1[at])
    flat = length + out_length - vel * vel / (2 * acc)
    on_distance, off_distance = vel * on_us / US_PER_MS, vel * off_ms
    steady = np.maximum(on_us / US_PER_MS, off_ms) <= flat / vel + np.sqrt(2 * _BRAKES_PULSE / acc)
    steady &= np.minimum(on_distance, off_distance) > -_NEAR_PULSE
    long_enough = length > 2 * _NEAR_PULSE
    emits = marks.on_us[at] - marks.lag_us[at] < length / vel * US_PER_MS
    steady &= np.maximum(on_distance, off_distance) < length + out_length - _NEAR_PULSE
    known[at] = steady & long_enough & emits & (off_distance - on_distance > 2 * _NEAR_PULSE)

    def positions(distance: Floats) -> SwitchPositions:
        count = len(known)
        found = SwitchPositions(leg=np.zeros(count, dtype=np.int8), x=np.zeros(count), y=np.zeros(count))
        near, far = distance >= length - _NEAR_PULSE, distance >= length + _NEAR_PULSE
        leg = SwitchLeg.START + (distance >= _NEAR_PULSE) + near + far
        out = leg == SwitchLeg.RUN_OUT
        x0, y0 = np.where(out, segments.x1[at], segments.x0[at]), np.where(out, segments.y1[at], segments.y0[at])
        x1, y1 = np.where(out, end_x, segments.x1[at]), np.where(out, end_y, segments.y1[at])
        share = np.where(out, distance - length, distance) / np.maximum(np.where(out, out_length, length), 1.0)
        found.leg[at] = leg
        found.x[at], found.y[at] = np.rint(x0 + (x1 - x0) * share) + 0.0, np.rint(y0 + (y1 - y0) * share) + 0.0
        return found

    return SimpleMarkSwitches(known=known, on=positions(on_distance), off=positions(off_distance))
