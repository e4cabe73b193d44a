"""Lasers that are on while nothing moves (GJ726). Times by hand."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.tools import MARK, ROOT, find_diagnostics, recorded_stream, run_job, run_stream, stream_in

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.pipeline import examine_file

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,10,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(1,0)
GT_LaserPrfCmd(50,0)
"""
"""6 lines."""
ON, OFF, LINE = "GT_BufLaserOn(1,0,0)\n", "GT_BufLaserOff(1,0,0)\n", "GT_LnXY(1,100000,0,50,2,0,0)\n"
"""2025 ms."""
SWITCH_ON, SWITCH_OFF = "GT_SetHSIOOpt(1,0)\n", "GT_SetHSIOOpt(0,0)\n"
START, WAIT = "GT_CrdStart(1,0)\n", "GT_CrdStatus(1,run,segment,0)\n"
NO_ROW = "the report has no row for it"


def found(*parts: str, rule: str = "GJ726") -> list[tuple[int, str]]:
    """Lines and messages of the rule."""
    diagnostics = find_diagnostics(recorded_stream("".join(parts)), Machine())
    return [(d.span.line, d.message) for d in diagnostics if d.rule.code == rule]


def on(time: str, power: str = "50 %", channel: int = 0) -> str:
    return f"the laser of channel {channel} is on at rest for {time} ms ({power}): {NO_ROW}"


def test_a_laser_that_is_switched_on_and_off_at_rest() -> None:
    assert found(HEAD, "[1] " + SWITCH_ON, "[501] " + SWITCH_OFF) == [(7, on("500"))]
    again = "[502] " + SWITCH_ON, "[502.1] " + SWITCH_OFF
    assert found(HEAD, "[1] " + SWITCH_ON, "[501] " + SWITCH_OFF, *again) == [(7, on("500")), (9, on("0.1"))]


def test_a_second_switch_on_changes_nothing() -> None:
    assert found(HEAD, "[1] " + SWITCH_ON, "[2] " + SWITCH_ON, "[5] " + SWITCH_OFF, "[6] " + SWITCH_OFF) == [
        (7, on("4"))
    ]


@pytest.mark.parametrize("rest", ["[3025] AT_REST(1)\n", "AT_REST(1)\n", ""], ids=["at", "no time", "none"])
def test_a_laser_that_a_stage_leaves_on(rest: str) -> None:
    """From 1000 + 2025 ms on."""
    text = HEAD + ON + LINE + "[1000] " + START + rest
    assert found(text, "[3125] " + SWITCH_OFF) == [(9, on("100"))]
    assert found(text, "[3025.2] " + SWITCH_OFF) == []
    assert found(text, "[2000] " + SWITCH_OFF) == [] or rest


def test_the_recorder_knows_when_the_motion_has_ended() -> None:
    """It ran empty in between, so it took longer than the path alone."""
    text = HEAD + ON + LINE + "[1000] " + START + "[3500] AT_REST(1)\n"
    assert found(text, "[3550] " + SWITCH_OFF) == [(9, on("50"))]


def test_a_laser_that_stays_on_until_the_next_stage() -> None:
    text = HEAD + ON + LINE + "[1000] " + START + "[3025] AT_REST(1)\n" + "GT_LnXY(1,0,0,50,2,0,0)\n" + OFF
    assert found(text, "[3500] " + START) == [(9, on("475"))]
    # Both times are known: nothing else is said about it.
    assert found(text, "[3500] " + START, rule="GJ405") == []
    untimed = HEAD + ON + LINE + START + WAIT + "GT_LnXY(1,0,0,50,2,0,0)\n" + OFF + START
    assert found(untimed) == []
    assert [line for line, _ in found(untimed, rule="GJ405")] == [10]


def test_a_stop_leaves_the_laser_on() -> None:
    """25 ms from 50 pulse/ms to rest."""
    text = HEAD + ON + LINE + "[1000] " + START + "[2025] GT_Stop(256,0)\n"
    assert found(text, "[2150] " + SWITCH_OFF) == [(9, on("100"))]
    assert found(text, "[2040] " + SWITCH_OFF) == []


def test_a_laser_that_is_switched_on_or_off_during_the_motion() -> None:
    stage = HEAD + LINE + "[1000] " + START
    assert found(stage, "[2000] " + SWITCH_ON, "[3025] AT_REST(1)\n", "[4025] " + SWITCH_OFF) == [(8, on("1000"))]
    assert found(stage, "[2000] " + SWITCH_ON, "[2100] " + SWITCH_OFF, "[4000] AT_REST(1)\n") == []
    buffered = HEAD + ON + LINE + OFF + LINE + "[1000] " + START
    assert found(buffered, "[2000] " + SWITCH_OFF, "[5000] AT_REST(1)\n", "[5025] " + SWITCH_OFF) == []
    assert found(buffered, "[2000] " + SWITCH_ON, "[5000] AT_REST(1)\n", "[5025] " + SWITCH_OFF) == []


def test_a_laser_that_is_switched_on_before_the_motion_and_off_after_it() -> None:
    stage = HEAD, "[10] " + SWITCH_ON, LINE, "[10.1] " + START, "[2035.1] AT_REST(1)\n"
    assert found(*stage, "[2135.1] " + SWITCH_OFF) == [(9, on("100"))]
    off = *stage, "[2035.2] " + SWITCH_OFF, LINE, "[3000] " + START, "[5000] AT_REST(1)\n"
    assert found(*off, "[5100] " + SWITCH_OFF) == []


def test_the_time_of_a_call_before_the_start_is_none() -> None:
    stage = "\n" + LINE + OFF
    assert found(HEAD, "[10] " + SWITCH_ON, stage, "[10.2] " + START) == []
    assert found(HEAD, "[10] " + SWITCH_ON, stage, "[110] " + START) == [(7, on("100"))]


def test_without_times_only_calls_at_rest_are_reported() -> None:
    text = f"the laser of channel 0 is on at rest (50 %), and this listing does not say how long: {NO_ROW}"
    assert found(HEAD, SWITCH_ON, SWITCH_OFF) == [(7, text)]
    assert found(HEAD, LINE, START, WAIT, SWITCH_ON, "GT_LaserPrfCmd(20,0)\n", SWITCH_OFF) == [(10, text)]
    assert found(HEAD, SWITCH_ON, "GT_Reset()\n") == [(7, text)]
    assert found(HEAD, SWITCH_ON, LINE, START, WAIT, SWITCH_OFF) == []
    assert found(HEAD, ON, LINE, START, WAIT, SWITCH_OFF) == []
    assert found(HEAD, LINE, START, SWITCH_ON, SWITCH_OFF, WAIT) == []


def test_what_nothing_ends_is_left_on() -> None:
    assert found(HEAD, "[1] " + SWITCH_ON) == []
    assert len(found(HEAD, "[1] " + SWITCH_ON, rule="GJ708")) == 1


def test_each_channel_by_itself() -> None:
    second = "[2] GT_SetHSIOOpt(1,1)\n", "[12] GT_SetHSIOOpt(0,1)\n"
    assert found(HEAD, "[1] " + SWITCH_ON, *second, "[31] " + SWITCH_OFF) == [
        (7, on("30")),
        (8, on("10", "no power is set", 1)),
    ]


@pytest.mark.parametrize(
    ("calls", "power"),
    [
        ("GT_LaserPrfCmd(20,0)", "20 %"),
        ("GT_LaserPowerMode(0,40,10,0)", "40 %"),
        ("GT_LaserPowerMode(2,10,0,0)", "no power is set"),
        ("GT_LaserPowerMode(2,10,0,0)\nGT_LaserPrfCmd(2.5,0)", "2.5 V"),
        (
            "GT_SetLaserDisMode(1,0,{0,0,0,0},{1,1,1,1},0)\nGT_SetLaserDisRatio({1,1,0,0},0,100,0)",
            "50 % without distance follow",
        ),
        ("GT_BufLaserPrfFollow(1,1,5,60,0,0)\n" + LINE + "[10] " + START + "AT_REST(1)", "5 %"),
        ("GT_BufLaserPrfCmd(1,35,0,0)\n" + LINE + "[10] " + START + "AT_REST(1)", "35 %"),
    ],
    ids=["immediate", "clamped", "mode", "volts", "distance", "follow", "buffered"],
)
def test_the_power_is_the_one_in_force(calls: str, power: str) -> None:
    text = HEAD + calls + "\n[5000] " + SWITCH_ON
    changed = "GT_LaserPrfCmd(1,0)\nGT_LaserPowerMode(1,2000,0,0)\n"
    assert [message for _, message in found(text, "[5010] " + SWITCH_OFF)] == [on("10", power)]
    if "MODE" not in calls.upper():
        assert [message for _, message in found(text, changed, "[5010] " + SWITCH_OFF)] == [on("10", power)]


def test_beyond_the_limit_they_are_counted() -> None:
    text = HEAD + "".join(f"[{i}] {SWITCH_ON}[{i}.5] {SWITCH_OFF}" for i in range(1200))
    assert len(found(text)) == 1000
    notes = found(text, rule=rules.NOT_LISTED.code)
    assert [message for _, message in notes if "200" in message and "GJ726" in message] != []


def test_jobs_have_no_such_rule() -> None:
    text = MARK + "LASER POWER 30 NOW\nLASER ON NOW\nLASER OFF NOW\nLINE X 1\nWAIT\nLASER ON NOW\nLASER OFF NOW\n"
    assert "GJ726" not in run_job(text).codes()


@pytest.mark.parametrize("path", sorted((ROOT / "jobs").rglob("*.job")), ids=lambda p: p.stem)
def test_the_calls_of_jobs_have_no_emission_at_rest(path: Path) -> None:
    loaded = examine_file(path, None)
    stream = stream_in(loaded)
    assert stream is not None
    assert "GJ726" not in run_stream(stream, loaded.machine).codes()
