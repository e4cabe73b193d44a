"""Corners between a jump and the run-in of an arc: the velocity vector changes by what look-ahead allows, no more."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.tools import stream_of

from gusjob.controllers.gus.calls import Buffered

JOB = """LASER MODE DUTY CARRIER 20kHz
VEL 800
ACC 50000
JUMPVEL 4000mm/s
SKYWRITE MODE {mode} TIMELAG 100us
LASER POWER 40
JUMP X {x} Y {y}
LASER ON
ARC CW I -4.802 J -1.395
LASER OFF
"""
JUMP_PULSE_PER_MS = 5.0
"""The profile's default: TIME 5 ms times ACC 1 pulse/ms2."""


@pytest.mark.parametrize("mode", [2, 3])
@pytest.mark.parametrize(("x", "y"), [(7.151, -12.458), (-3.2, 8.9), (12.0, 3.0), (-9.0, -9.5)])
def test_the_corner_into_a_run_in_on_an_arc(mode: int, x: float, y: float) -> None:
    calls = stream_of(JOB.format(mode=mode, x=x, y=y)).buffered
    at = int(np.flatnonzero(calls.kind == Buffered.ARC_CENTRE)[0])
    jump_x, jump_y = float(calls.x[at - 1]), float(calls.y[at - 1])
    length = math.hypot(jump_x, jump_y)
    # From the centre to the start of the arc it is (-i, -j); clockwise the tangent there is (-j, i).
    i, j = float(calls.p[at]), float(calls.q[at])
    radius = math.hypot(i, j)
    change = math.hypot(-j / radius - jump_x / length, i / radius - jump_y / length)
    assert calls.vel_end[at - 1] * change == pytest.approx(JUMP_PULSE_PER_MS, rel=2e-3)
