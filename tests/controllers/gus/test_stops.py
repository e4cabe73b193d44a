"""GT_Stop and GT_Reset at a known time while a stage moves. Numbers by hand."""

from __future__ import annotations

import math
import random

import pytest
from support.tools import Ran, recorded_stream, run_stream

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,10,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(1,0)
GT_SetLevelDelay(0,0,0)
"""
ON, OFF = "GT_BufLaserPrfCmd(1,50,0,0); GT_BufLaserOn(1,0,0)\n", "GT_BufLaserOff(1,0,0)\n"
LINE = "GT_LnXY(1,100000,0,50,2,0,0)\n"
"""2025 ms from 0: 25 ms and 625 pulse up to 50 pulse/ms, and down."""
START, REST, AGAIN = "[1000] GT_CrdStart(1,0)\n", "AT_REST(1)\n", "[9000] GT_CrdStart(1,0)\n"


def smooth(time_ms: float) -> str:
    return f"[{1000 + time_ms}] GT_Stop(256,0)\n"


def abrupt(time_ms: float) -> str:
    return f"[{1000 + time_ms}] GT_Stop(256,256)\n"


def recorded(*parts: str) -> Ran:
    return run_stream(recorded_stream("".join(parts)))


def found(*parts: str) -> list[tuple[str, str]]:
    """The diagnostics of a run, code and message."""
    _, diagnostics = simulate_stream(recorded_stream("".join(parts)), Machine(), is_listing=True)
    return [(d.rule.code, d.message) for d in diagnostics]


def test_the_motion_slows_down_from_the_stop_and_goes_on_from_there() -> None:
    """At 1025 ms at 50,625 pulse; 25 ms and 625 pulse down. Then 48,750 pulse: 950 ms at velocity and two ramps."""
    ran = recorded(HEAD, LINE, START, smooth(1025), REST, AGAIN)
    assert ran.column("stage") == [1, 1, 2]
    assert ran.column("line") == [7, 7, 7]
    assert ran.column("x_mm") == pytest.approx([50.625, 51.25, 100])
    assert ran.column("duration_ms") == pytest.approx([1025, 25, 1000])
    assert [d.message for d in ran.diagnostics] == []


def test_a_stop_leaves_the_laser_as_it_is() -> None:
    ran = recorded(HEAD, ON, LINE, OFF, START, smooth(1025), REST, AGAIN)
    assert ran.column("ch0_emission_ms") == pytest.approx([1025, 25, 1000])
    warning = "GT_Stop: the laser of channel 0 stays on: a stop does not switch it off"
    assert [d.message for d in ran.diagnostics if d.rule.code == "GJ702"] == [warning]
    off = recorded(HEAD, ON, LINE, OFF, START, smooth(1025), "[2030] GT_SetHSIOOpt(0,0)\n", REST, AGAIN)
    assert off.column("ch0_emission_ms") == pytest.approx([1025, 5, 0])
    assert [d.message for d in off.diagnostics] == []


def test_an_abrupt_stop_stops_at_once() -> None:
    ran = recorded(HEAD, LINE, START, abrupt(1025), REST, AGAIN)
    assert ran.column("x_mm") == pytest.approx([50.625, 100])
    assert ran.column("duration_ms") == pytest.approx([1025, 49375 / 50 + 25])
    assert [d.rule.code for d in ran.diagnostics] == ["GJ706"]


def test_an_abrupt_stop_on_the_way_to_rest() -> None:
    """10 ms after the stop: from 50 to 30 pulse/ms, 400 pulse. Then 48,975 pulse: at velocity and two ramps."""
    ran = recorded(HEAD, LINE, START, smooth(1025), abrupt(1035), REST, AGAIN)
    assert ran.column("x_mm") == pytest.approx([50.625, 51.025, 100])
    assert ran.column("duration_ms") == pytest.approx([1025, 10, 48975 / 50 + 25])
    (stop,) = ran.diagnostics
    assert (stop.rule.code, stop.fields["value"]) == ("GJ706", pytest.approx(30))
    # At the same time as the smooth one, and after its end.
    assert recorded(HEAD, LINE, START, smooth(1025), abrupt(1025)).column("x_mm") == pytest.approx([50.625])
    assert recorded(HEAD, LINE, START, smooth(1025), abrupt(1051)).column("x_mm") == pytest.approx([50.625, 51.25])


def test_a_reset_on_the_way_to_rest() -> None:
    ran = recorded(HEAD, LINE, START, smooth(1025), "[2035] GT_Reset()\n")
    assert ran.column("x_mm") == pytest.approx([50.625, 51.025])


def test_an_abrupt_stop_while_the_path_slows_down() -> None:
    """The smooth stop at 2010 ms leaves nothing; 5 ms later 20 pulse/ms: 25 + 100 pulse before the end, 100 of them."""
    ran = recorded(HEAD, LINE, START, smooth(2010), abrupt(2015), REST, AGAIN)
    assert ran.column("x_mm") == pytest.approx([99.775, 99.9, 100])
    assert ran.column("duration_ms") == pytest.approx([2010, 5, 2 * math.sqrt(100 / 2)])


def test_an_abrupt_stop_after_several_segments_on_the_way_to_rest() -> None:
    """Lines of 100 pulse: 15 ms after the stop, 525 pulse on."""
    lines = "".join(f"GT_LnXY(1,{x},0,50,2,{0 if x == 100000 else 50},0)\n" for x in range(100, 100100, 100))
    ran = recorded(HEAD, lines, START, smooth(1025.5), abrupt(1040.5), REST, AGAIN)
    stage, x_mm, duration = ran.column("stage"), ran.column("x_mm"), ran.column("duration_ms")
    first = stage.index(2)
    assert (x_mm[first - 1], x_mm[first]) == pytest.approx((51.175, 51.2))
    assert sum(duration[:first]) == pytest.approx(1040.5)
    assert sum(ran.column("length_mm")) == pytest.approx(100)


def test_what_is_buffered_between_two_stops_runs_after_the_rest() -> None:
    more = "GT_LnXY(1,0,0,50,2,0,0)\n"
    for time_ms, x_mm in ((1025, [50.625, 51.025, 100, 0]), (2010, [99.775, 99.975, 100, 0])):
        ran = recorded(HEAD, LINE, START, smooth(time_ms), more, abrupt(time_ms + 10), REST, AGAIN)
        assert ran.column("x_mm") == pytest.approx(x_mm)


def test_the_same_stop_again_changes_nothing() -> None:
    once, twice = (
        recorded(HEAD, LINE, START, stops, REST, AGAIN) for stops in (smooth(1025), smooth(1025) + smooth(1030))
    )
    assert twice.column("x_mm") == once.column("x_mm")
    assert twice.column("duration_ms") == once.column("duration_ms")
    assert twice.diagnostics == []


def test_the_decelerations_of_stops() -> None:
    """10 pulse/ms2: 5 ms, 125 pulse. 100 pulse/ms2: 0.5 ms, 12.5 pulse."""
    dec = "GT_SetCrdStopDec(1,10,100)\n"
    assert recorded(HEAD, dec, LINE, START, smooth(1025)).column("x_mm") == pytest.approx([50.625, 50.75])
    ran = recorded(HEAD, dec, LINE, START, abrupt(1025))
    assert ran.column("x_mm") == pytest.approx([50.625, 50.6375])
    assert ran.column("duration_ms") == pytest.approx([1025, 0.5])


def test_a_stop_that_is_slower_than_the_path() -> None:
    """1 pulse/ms2: 1250 pulse. At 1990 ms 1125 pulse are left, the last 625 of them at 2 pulse/ms2."""
    dec = "GT_SetCrdStopDec(1,1,100)\n"
    assert recorded(HEAD, dec, LINE, START, smooth(1025)).column("x_mm") == pytest.approx([50.625, 51.875])
    text = "GT_Stop stops coordinate system 1 while it moves, and what runs then is not known: "
    reason = "the deceleration of GT_SetCrdStopDec is below that of the path"
    assert found(HEAD, dec, LINE, START, smooth(1990)) == [("GJ725", text + reason)]


@pytest.mark.parametrize(
    ("time_ms", "x_mm", "duration_ms"),
    [(10, [0.1, 0.2], [10, 10]), (2010, [99.775, 100], [2010, 15]), (2025, [100], [2025]), (2500, [100], [2025])],
    ids=["while it speeds up", "while it slows down", "at its end", "after its end"],
)
def test_a_stop_outside_of_the_constant_velocity(time_ms: float, x_mm: list[float], duration_ms: list[float]) -> None:
    ran = recorded(HEAD, LINE, START, smooth(time_ms))
    assert ran.column("x_mm") == pytest.approx(x_mm)
    assert ran.column("duration_ms") == pytest.approx(duration_ms)


def test_the_way_to_rest_may_have_many_segments() -> None:
    """Lines of 100 pulse at constant velocity: half of one is left at the stop, and 575 pulse of the next ones."""
    lines = "".join(f"GT_LnXY(1,{x},0,50,2,{0 if x == 100000 else 50},0)\n" for x in range(100, 100100, 100))
    ran = recorded(HEAD, lines, START, smooth(1025.5), REST, AGAIN)
    stage = ran.column("stage")
    x_mm, duration = ran.column("x_mm"), ran.column("duration_ms")
    assert x_mm[stage.index(2) - 1] == pytest.approx(51.275)
    assert sum(d for d, s in zip(duration, stage, strict=True) if s == 1) == pytest.approx(1050.5)
    assert x_mm[stage.index(2)] == pytest.approx(51.3)
    assert sum(ran.column("length_mm")) == pytest.approx(100)


def test_what_is_buffered_between_segments_comes_in_its_turn() -> None:
    """From 625 pulse before the joint, 25 ms are needed for 625 pulse: the motion ends at the joint or behind it."""
    parts = HEAD, "GT_LnXY(1,50625,0,50,2,50,0)\n", ON, LINE, OFF, START
    ran = recorded(*parts, smooth(1020), REST, AGAIN)
    assert ran.column("x_mm") == pytest.approx([50.375, 50.625, 51, 100])
    emission = ran.column("ch0_emission_ms")
    assert emission == pytest.approx([0, 0, *ran.column("duration_ms")[2:]])
    before = recorded(*parts, smooth(1000), REST, AGAIN)
    assert before.column("x_mm") == pytest.approx([49.375, 50, 50.625, 100])
    assert before.column("ch0_emission_ms")[:3] == pytest.approx([0, 0, 0])


def test_a_dwell_is_cancelled() -> None:
    ran = recorded(HEAD, "GT_BufDelay(1,100,0)\n", LINE, START, smooth(30), REST, AGAIN)
    assert ran.column("stage") == [1, 2]
    assert ran.column("duration_ms") == pytest.approx([30, 2025])


def test_before_a_dwell_the_motion_stops_as_it_would_anyway() -> None:
    parts = HEAD, "GT_LnXY(1,50625,0,50,2,50,0)\n", "GT_BufDelay(1,100,0)\n", LINE, START
    ran = recorded(*parts, smooth(1020), REST, AGAIN)
    assert ran.column("x_mm") == pytest.approx([50.375, 50.625, 50.625, 100])
    assert ran.column("stage") == [1, 1, 2, 2]


@pytest.mark.parametrize("arc", ["GT_ArcXYC(1,0,0,20000,0,1,50,2,0,0)", "GT_ArcXYR(1,40000,0,20000,0,50,2,0,0)"])
def test_an_arc_goes_on_along_its_circle(arc: str) -> None:
    whole = recorded(HEAD, arc, "\n", START)
    ran = recorded(HEAD, arc, "\n", START, smooth(625), REST, AGAIN)
    assert ran.column("length_mm")[:2] == pytest.approx([30.625, 0.625])
    assert sum(ran.column("length_mm")) == pytest.approx(whole.column("length_mm")[0])
    # On the circle about 20 mm, 0.
    radius = [math.hypot(x - 20, y) for x, y in zip(ran.column("x_mm"), ran.column("y_mm"), strict=True)]
    assert radius == pytest.approx([20, 20, 20])
    assert [d.message for d in ran.diagnostics] == []


def test_the_origin_and_the_least_time_at_constant_velocity() -> None:
    """1000 pulse at 1 pulse/ms2 with 50 ms at v = sqrt(1625) - 25: the stop comes in the middle of them."""
    head = HEAD.replace(",0,1,{0,0,", ",50,1,{7000,0,")
    top = math.sqrt(1625) - 25
    ran = recorded(head, "GT_LnXY(1,0,0,50,2,0,0)\nGT_LnXY(1,1000,0,50,1,0,0)\n", START)
    begin = ran.column("start_ms")[1]
    stopped = recorded(head, "GT_LnXY(1,0,0,50,2,0,0)\nGT_LnXY(1,1000,0,50,1,0,0)\n", START, smooth(begin + top + 25))
    assert stopped.column("x_mm") == pytest.approx([7, 7.5, 7.5 + top * top / 2000])
    assert stopped.column("duration_ms")[1:] == pytest.approx([top + 25, top])


def test_starts_and_calls_after_a_stop() -> None:
    refused = ("GJ701", "GT_CrdStart returns 1: the coordinate system is moving already")
    early = HEAD, LINE, START, smooth(1025), "[2049] GT_CrdStart(1,0)\n"
    left = ("GJ702", "GT_Stop: 1 buffered calls are left in the FIFO and never run")
    assert found(*early) == [refused, left]
    assert found(HEAD, LINE, START, smooth(1025), "[2051] GT_CrdStart(1,0)\n") == []
    cleared = found(HEAD, LINE, START, smooth(1025), "[2051] GT_CrdClear(1,0)\n")
    assert cleared == [("GJ702", "GT_CrdClear: 1 buffered calls are cleared and never run")]
    more = "GT_LnXY(1,0,0,50,2,0,0)\n"
    ran = recorded(HEAD, LINE, START, smooth(1025), more, "[2051] GT_CrdStart(1,0)\n")
    assert ran.column("x_mm") == pytest.approx([50.625, 51.25, 100, 0])


def test_what_is_not_known_is_an_error() -> None:
    text = "GT_Stop stops coordinate system 1 while it moves, and what runs then is not known: "
    axis = "[1100] GT_Stop(1,0)\n"
    assert found(HEAD, LINE, START, axis) == [("GJ725", text + "it stops an axis, not the coordinate system")]
    twice = smooth(1025), "[2026] GT_SetCrdStopDec(1,10,10)\n", abrupt(1030)
    other = text + "it is stopping already, with another deceleration"
    assert ("GJ725", other) in found(HEAD, LINE, START, *twice)
    unknown = "GT_CrdStart(1,0)\n", smooth(1025)
    assert found(HEAD, LINE, *unknown) == [("GJ725", text + "this listing does not say when")]
    # Another system and its axes are at rest.
    assert found(HEAD, LINE, START, "[1100] GT_Stop(524,0)\n") == []


def test_a_reset_stops_and_switches_off() -> None:
    again = HEAD + LINE + "[9000] GT_CrdStart(1,0)\n"
    ran = recorded(HEAD, ON, LINE, OFF, START, "[2025] GT_Reset()\n", again)
    assert ran.column("x_mm") == pytest.approx([50.625, 100])
    assert ran.column("ch0_emission_ms") == pytest.approx([1025, 0])
    assert [d.message for d in ran.diagnostics if d.rule.code == "GJ702"] == [
        "GT_Reset: 2 buffered calls are cleared and never run",
        "GT_Reset: the switch goes off; modes, limits, delays and coordinate systems set before are lost",
    ]


@pytest.mark.parametrize("seed", range(20))
def test_random_paths_with_stops_are_as_long_as_without(seed: int) -> None:
    chance = random.Random(seed)
    lines = list[str]()
    for _ in range(chance.randrange(1, 30)):
        x, y = chance.randrange(-50000, 50000), chance.randrange(-50000, 50000)
        vel, acc = chance.choice([20, 50, 80]), chance.choice([1, 2, 5])
        end = chance.choice([0, 10, 20])
        lines.append(
            chance.choice(
                [
                    f"GT_LnXY(1,{x},{y},{vel},{acc},{end},0)",
                    f"GT_ArcXYC(1,{x},{y},{chance.randrange(1, 9000)},500,{seed % 2},{vel},{acc},{end},0)",
                    f"GT_LnXYG0(1,{x},{y},{vel},{acc},0)",
                ]
            )
        )
        if lines[-1].startswith("GT_Arc"):  # A full circle ends where it begins.
            ends = [line.split("(")[1].split(",")[1:3] for line in lines[:-1]]
            at = ",".join(ends[-1]) if ends else "0,0"
            lines[-1] = lines[-1].replace(f"(1,{x},{y},", f"(1,{at},")
    text = HEAD + ON + "\n".join(lines) + "\n" + OFF
    whole = recorded(text, START)
    total = sum(whole.column("duration_ms"))
    stops, clock = "[0] GT_CrdStart(1,0)\n", 0.0
    for _ in range(4):
        after = chance.uniform(0, total / 3)
        stops += f"[{clock + after:.4f}] GT_Stop(256,{chance.choice([0, 0, 256])})\n"
        if chance.random() < 0.5:
            stops += f"[{clock + after + chance.uniform(0, 20):.4f}] GT_Stop(256,256)\n"
        clock += 10 * total
        stops += f"[{clock:.4f}] GT_CrdStart(1,0)\n"
    ran = recorded(text, stops)
    assert max(ran.column("stage")) > 1
    assert sum(ran.column("length_mm")) == pytest.approx(sum(whole.column("length_mm")), rel=1e-9)
    assert (ran.column("x_mm")[-1], ran.column("y_mm")[-1]) == (whole.column("x_mm")[-1], whole.column("y_mm")[-1])
    assert sum(ran.column("ch0_emission_ms")) == pytest.approx(sum(ran.column("duration_ms")))
    assert {d.rule.code for d in ran.diagnostics} <= {"GJ516", "GJ702", "GJ704", "GJ705", "GJ706", "GJ707", "GJ726"}
