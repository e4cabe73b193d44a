"""Arcs about a centre that is not whole: programs compute it as R*cos, R*sin. Lengths and bounding boxes by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.controller import Row, needs_controller
from support.hardware import Bench, listed, made_calls
from support.tools import recorded_stream, run_listing

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.executor import execute
from gusjob.controllers.gus.geometry import call_segments
from gusjob.controllers.gus.lift import lift
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.path_position import PathPosition
from gusjob.controllers.gus.remainder import remainder_from
from gusjob.ir.path import Op

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,10,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(1,0)
GT_BufLaserPrfCmd(1,50,0,0)
"""
ON, OFF, START, WAIT = (
    "GT_BufLaserOn(1,0,0)\n",
    "GT_BufLaserOff(1,0,0)\n",
    "GT_CrdStart(1,0)\n",
    "GT_CrdStatus(1,r,s,0)\n",
)
HALF = "GT_ArcXYC(1,2469,0,1234.5,0,0,50,2,0,0)\n"
"""A half circle clockwise, from 0, 0."""
TO_RIGHT = "GT_LnXY(1,10000,0,50,2,0,0)\n"
QUARTER = "GT_ArcXYC(1,0,10000,-10000,6e-13,1,50,2,0,0)\n"
"""A quarter circle counter-clockwise, from 10000, 0."""


def test_a_half_circle_about_half_a_pulse() -> None:
    """pi * 1234.5 pulse; at 50 pulse/ms with two ramps of 25 ms, each half as fast on average."""
    ran = run_listing(HEAD + ON + HALF + OFF + START)
    length = math.pi * 1234.5
    assert ran.column("length_mm") == pytest.approx([length / 1000])
    assert ran.column("duration_ms") == pytest.approx([length / 50 + 25])
    assert ran.column("ch0_power_ms") == pytest.approx([50 * (length / 50 + 25)])
    assert ran.diagnostics == []


def test_a_quarter_circle_with_what_cos_leaves_of_0() -> None:
    ran = run_listing(HEAD + TO_RIGHT + ON + QUARTER + OFF + START)
    assert ran.column("length_mm") == pytest.approx([10, 5 * math.pi])
    assert ran.diagnostics == []


def test_its_bounding_box_is_checked() -> None:
    """Its top is 1.2345 mm above its ends."""
    text = HEAD + ON + HALF + OFF + START
    assert run_listing(text, Machine(field_y_mm=(-1, 1.2346))).diagnostics == []
    (found,) = run_listing(text, Machine(field_y_mm=(-1, 1.2334))).diagnostics
    assert (found.rule.code, found.span.line, found.fields["value"]) == ("GJ709", 8, pytest.approx(1.2345))


@pytest.mark.parametrize("centre", ["1073741823.5", "-1073741823.5", "1e300"])
def test_a_centre_out_of_range_is_refused(centre: str) -> None:
    ran = run_listing(HEAD + f"GT_ArcXYC(1,2469,0,{centre},0,0,50,2,0,0)\n" + TO_RIGHT + START)
    assert [(d.rule.code, d.span.line) for d in ran.diagnostics] == [("GJ701", 7)]


def test_a_job_lifted_from_calls_has_the_centre() -> None:
    stream = listed(HEAD + TO_RIGHT + QUARTER + HALF + START)
    path = lift(stream, execute(stream)).path
    arcs = np.flatnonzero(path.op == Op.ARC_CENTRE)
    assert path.cx[arcs].tolist() == [0, 1234.5]
    assert path.cy[arcs].tolist() == [6e-13, 10000]


def test_it_is_written_as_it_was_read() -> None:
    text = HEAD + HALF + TO_RIGHT + QUARTER + START
    assert "".join(listing(listed(text))) == text


def test_the_rest_of_an_arc_keeps_its_centre() -> None:
    """After a sixth of the turn, at 617.25, 1069.1: the head is at whole pulses, the centre stays at 1234.5, 0."""
    stream = listed(HEAD + HALF + START)
    rest = remainder_from(stream, PathPosition(row=1, along_pulse=math.pi * 1234.5 / 3)).stream.buffered
    assert (rest.x[0], rest.y[0]) == (617, 1069)
    (arc,) = np.flatnonzero(rest.p != 0)[-1:]
    assert (617 + rest.p[arc], 1069 + rest.q[arc]) == pytest.approx((1234.5, 0), abs=1e-9)


def test_a_stop_within_an_arc_keeps_its_centre() -> None:
    stream = recorded_stream(HEAD + HALF + "[0] GT_CrdStart(1,0)\n[40] GT_Stop(256,256)\n[50] GT_CrdStart(1,0)\n")
    run = execute(stream).run
    made = run.calls.pick(np.arange(run.sent, len(run.calls)))
    # Speeding up for 25 ms, then 15 ms at velocity: 1375 pulse along the circle.
    angle = math.pi - 1375 / 1234.5
    x, y = 1234.5 + 1234.5 * math.cos(angle), 1234.5 * math.sin(angle)
    assert (made.x[0], made.y[0]) == pytest.approx((x, y))
    assert (made.p[-1] + x, made.q[-1] + y) == pytest.approx((1234.5, 0), abs=1e-9)


@needs_controller
def test_the_driver_sends_it_as_it_is(gus: Bench) -> None:
    assert gus.run(listed(HEAD + HALF + TO_RIGHT + QUARTER + START + WAIT), gus.machine(Machine())).faults == []
    arcs = [call for call in made_calls(gus) if call.startswith("GT_ArcXYC")]
    centres = [tuple(map(float, call.split(",")[3:5])) for call in arcs]
    assert centres == [(1234.5, 0), (-10000, 6e-13)]
    durations = gus.controller.rows()[:, Row.DURATION_MS]
    assert durations[[0, 2]] == pytest.approx([math.pi * 1234.5 / 50 + 25, math.pi * 5000 / 50 + 25], rel=1e-6)


@pytest.mark.parametrize("error", [-1e-9, 1e-9])
@pytest.mark.parametrize("direction", [0, 1])
def test_a_circle_ends_where_it_starts_but_for_rounding(error: float, direction: int) -> None:
    """After a stop an origin need not be whole."""
    calls = listed(f"GT_LnXY(1,3,0,50,2,0,0)\nGT_ArcXYC(1,3,0,0,100,{direction},50,2,0,0)\n").buffered
    none = np.zeros(2)
    found = call_segments(calls, np.arange(2), none > 0, origin=(np.array([0.3, 0.3 + error]), none))
    assert found.length[1] == pytest.approx(math.tau * 100)


@pytest.mark.parametrize("left_pulse", [0.6, 1.0, 1.9])
@pytest.mark.parametrize("degrees", [*range(0, 175, 15), *range(190, 360, 15)])
def test_the_last_pulses_of_an_arc_are_a_line(left_pulse: float, degrees: int) -> None:
    """About the centre a start that rounding moves behind the end would make a full circle of them."""
    x, y = round(5000 * math.cos(math.radians(degrees))), round(5000 * math.sin(math.radians(degrees)))
    stream = listed(HEAD + f"GT_LnXY(1,-5000,0,50,2,0,0)\nGT_ArcXYC(1,{x},{y},5000,0,1,50,2,0,0)\n" + START)
    arc = 2
    length = float(call_segments(stream.buffered, np.array([arc]), np.zeros(1) > 0, (-5000.0, 0.0)).length[0])
    rest = remainder_from(stream, PathPosition(row=arc, along_pulse=length - left_pulse)).stream.buffered
    assert not np.isin(rest.kind, (Buffered.ARC_CENTRE, Buffered.ARC_RADIUS)).any()
