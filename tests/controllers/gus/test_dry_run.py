"""Dry runs: no laser call, and the frame."""

from __future__ import annotations

import re

import pytest
from support.controller import Row, needs_controller
from support.hardware import (
    EVERYTHING,
    Bench,
    fresh,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.dry_run import frame, without_laser
from gusjob.controllers.gus.model import simulate_stream

pytestmark = needs_controller


def test_without_laser_there_is_no_call_to_a_laser(gus: Bench) -> None:
    stream = stream_of(EVERYTHING)
    assert gus.run(stream, gus.machine(Machine())).faults == []
    whole = gus.controller.rows()
    fresh(gus)
    assert gus.run(without_laser(stream), gus.machine(Machine())).faults == []
    rows = gus.controller.rows()
    moved = [Row.KIND, Row.DURATION_MS, Row.X1, Row.Y1]
    assert rows[:, moved] == pytest.approx(whole[:, moved])
    assert rows[:, [Row.EMISSION0_MS, Row.EMISSION1_MS]].sum() == 0
    laser = {c for _, c in gus.controller.calls() if re.search("Laser|HSIO|FPK|Pulse|Vltg|Level|AxisMode", c)}
    assert laser == {"GT_SetHSIOOpt(0,0)", "GT_SetHSIOOpt(0,1)"}  # Off is always allowed.


def test_the_frame_is_the_box_of_the_marks(gus: Bench) -> None:
    text = MARK + "LASER POWER 3\nJUMP X 50 Y 50\nJUMP X 0 Y 0\nLASER ON\nARC CCW I 5 J 0\nLINE X -2 Y 3\nLASER OFF\n"
    stream = stream_of(text)
    trace, _ = simulate_stream(stream, Machine())
    assert trace is not None
    framed = frame(stream, trace)
    assert framed is not None
    assert gus.run(framed, gus.machine(Machine())).faults == []
    corners = {(x, y) for x, y in gus.controller.rows()[:, [Row.X1, Row.Y1]].tolist()}
    assert corners == {(-2000, -5000), (10000, -5000), (10000, 5000), (-2000, 5000)}
    assert gus.controller.edges().size == 0
