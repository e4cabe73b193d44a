"""Immediate calls at a known time while a stage moves. Numbers by hand, or from a path that is cut at that time."""

from __future__ import annotations

import random

import pytest
from support.tools import Ran, recorded_stream, run_listing, run_stream

from gusjob.config.machine import Machine

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,10,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(1,0)
"""
POWER, ON, OFF = "GT_BufLaserPrfCmd(1,50,0,0)\n", "GT_BufLaserOn(1,0,0)\n", "GT_BufLaserOff(1,0,0)\n"
LINE = "GT_LnXY(1,100000,0,50,2,0,0)\n"
"""2025 ms from 0: 25 ms and 625 pulse up to 50 pulse/ms, and down."""
BACK = "GT_LnXY(1,0,0,50,2,0,0)\n"
START = "[1000] GT_CrdStart(1,0)\n"


def recorded(*parts: str, machine: Machine | None = None) -> Ran:
    return run_stream(recorded_stream("".join(parts)), machine or Machine())


def test_a_power_acts_from_its_time_on() -> None:
    ran = recorded(HEAD, POWER, ON, LINE, OFF, START, "[1100] GT_LaserPrfCmd(20,0)\n[1400] GT_LaserPrfCmd(80,0)\n")
    assert ran.column("ch0_power_ms") == pytest.approx([50 * 100 + 20 * 300 + 80 * 1625])
    assert (ran.column("ch0_power_min"), ran.column("ch0_power_max")) == ([20], [80])
    assert ran.column("ch0_emission_ms") == pytest.approx([2025])


def test_a_power_acts_in_the_segment_that_runs_then_and_in_those_after_it() -> None:
    parts = HEAD, POWER, ON, LINE, BACK, "GT_BufLaserPrfCmd(1,30,0,0)\n", LINE, OFF, START
    ran = recorded(*parts, "[4000] GT_LaserPrfCmd(20,0)\n")
    assert ran.column("ch0_power_ms") == pytest.approx([50 * 2025, 50 * 975 + 20 * 1050, 30 * 2025])


def test_at_the_joint_of_two_segments_it_comes_after_what_is_buffered() -> None:
    parts = HEAD, POWER, ON, LINE, "GT_BufLaserPrfCmd(1,30,0,0)\n", BACK, OFF, START
    assert recorded(*parts, "[3025] GT_LaserPrfCmd(20,0)\n").column("ch0_power_ms") == pytest.approx([101250, 40500])
    before = recorded(*parts, "[3024] GT_LaserPrfCmd(20,0)\n")
    assert before.column("ch0_power_ms") == pytest.approx([101200 + 20, 30 * 2025])


def test_a_power_ends_a_follow() -> None:
    """While it follows with 1 % for each pulse/ms, the integral of the power is the length: 625 + 50*75 pulse."""
    follow = "GT_BufLaserFollowRatio(1,1,0,90,0,0)\n"
    parts = HEAD, follow, ON, LINE, OFF, START, "[1100] GT_LaserPrfCmd(20,0)\n"
    ran = recorded(*parts, machine=Machine(period_us=10))
    assert ran.column("ch0_power_ms") == pytest.approx([625 + 50 * 75 + 20 * 1925], rel=1e-5)


def test_a_power_holds_in_the_next_stage() -> None:
    parts = HEAD, POWER, ON, LINE, OFF, START, "[1025] GT_LaserPrfCmd(20,0)\nAT_REST(1)\n"
    ran = recorded(*parts, ON, BACK, OFF, "[9000] GT_CrdStart(1,0)\n")
    assert ran.column("ch0_power_ms") == pytest.approx([50 * 25 + 20 * 2000, 20 * 2025])


def test_a_power_after_the_end_is_that_of_the_emission_at_rest() -> None:
    """An off delay of 10 ms: the emission after the end has the new power."""
    parts = "GT_SetLevelDelay(10000,0,0)\n", HEAD, POWER, ON, LINE, OFF, START, "[3025.5] GT_LaserPrfCmd(20,0)\n"
    assert recorded(*parts).column("ch0_power_ms") == pytest.approx([50 * 2025 + 20 * 10])


def test_the_switch_acts_at_its_time_with_its_delays() -> None:
    """Off 300 us late, on 100 us late."""
    parts = "GT_SetLevelDelay(300,100,0)\n", HEAD, POWER, LINE, START
    switches = (
        "[1100] GT_SetHSIOOpt(1,0)\n[1200] GT_SetHSIOOpt(0,0)\n[1400] GT_SetHSIOOpt(1,0)\n[1500] GT_SetHSIOOpt(0,0)\n"
    )
    ran = recorded(*parts, switches)
    assert ran.column("ch0_emission_ms") == pytest.approx([2 * 100.2])
    assert ran.column("ch0_power_ms") == pytest.approx([50 * 200.4])


def test_a_switch_in_a_stage_is_no_switch_at_its_start() -> None:
    """There the laser would be switched on twice."""
    parts = HEAD, POWER, ON, LINE, OFF, BACK, START
    assert recorded(*parts, "[1100] GT_SetHSIOOpt(0,0)\n[1200] GT_SetHSIOOpt(1,0)\n").codes() == []
    retraced = recorded(HEAD, POWER, LINE, BACK, START, "[1100] GT_SetHSIOOpt(1,0)\nAT_REST(1)\n")
    assert retraced.codes() == ["GJ708"]


def test_the_switch_acts_between_those_that_are_buffered() -> None:
    parts = HEAD, POWER, ON, LINE, ON, BACK, OFF, START
    off = recorded(*parts, "[1500] GT_SetHSIOOpt(0,0)\n")
    assert off.column("ch0_emission_ms") == pytest.approx([500, 2025])
    late = recorded(*parts, "[1500] GT_SetHSIOOpt(0,0)\n[4000] GT_SetHSIOOpt(0,0)\n")
    assert late.column("ch0_emission_ms") == pytest.approx([500, 975])


def test_the_last_switch_is_that_of_the_next_stage() -> None:
    stages = HEAD, POWER, ON, LINE, OFF, BACK, START, "{}AT_REST(1)\n", LINE, "[9000] GT_CrdStart(1,0)\n"
    text = "".join(stages).split("{}")
    assert len(text) == 2
    early = recorded("[1500] GT_SetHSIOOpt(1,0)\n".join(text))
    assert early.column("ch0_emission_ms") == pytest.approx([2025, 0, 0])
    late = recorded("[4025] GT_SetHSIOOpt(1,0)\n".join(text))
    assert late.column("ch0_emission_ms") == pytest.approx([2025, 1025, 2025])


def test_a_reading_is_that_of_its_time() -> None:
    reading = "GT_GetHSIOOpt(&v,0)\n"
    ran = recorded(
        HEAD, POWER, LINE, ON, BACK, OFF, LINE, START, "[2000] ", reading, "[3026] ", reading,
        "[3500] GT_SetHSIOOpt(0,0)\n[3501] ", reading, "[4000] GT_SetHSIOOpt(1,0)\n[4001] ", reading,
        "[5051] ", reading, "AT_REST(1)\n", reading,
    )  # fmt: skip
    assert [r["value"] for r in ran.report.notes["readings"]] == [0, 1, 0, 1, 0, 0]


def test_a_time_of_the_call_alone_places_nothing() -> None:
    parts = HEAD, POWER, ON, LINE, OFF, "GT_CrdStart(1,0)\n", "[1100] GT_LaserPrfCmd(20,0)\n"
    assert recorded(*parts).column("ch0_power_ms") == pytest.approx([20 * 2025])


@pytest.mark.parametrize(
    "call", ["GT_SetLevelDelay(500,200,0)", "GT_SetLaserDisRatio({1,0,0,0},10,90,0)", "GT_LaserOutFrq(30,0)"]
)
def test_a_setting_is_in_force_for_the_whole_stage_with_a_warning(call: str) -> None:
    distance = "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
    parts = distance, HEAD, POWER, ON, LINE, OFF, START
    ran = recorded(*parts, f"[1500] {call}\n")
    reason = "the coordinate system is moving; the simulation uses the setting for the whole stage"
    assert [d.message for d in ran.diagnostics] == [f"{call.partition('(')[0]}: {reason}"]
    at_rest = recorded(distance, call, "\n", HEAD, POWER, ON, LINE, OFF, START)
    assert ran.column("ch0_power_ms") == at_rest.column("ch0_power_ms")
    # What is in force already changes nothing.
    again = recorded(distance, call, "\n", HEAD, POWER, ON, LINE, OFF, START, f"[1500] {call}\n")
    assert [d.message for d in again.diagnostics if call.startswith("GT_Set")] == []


@pytest.mark.parametrize("seed", range(12))
def test_random_powers_and_switches_are_as_on_a_path_that_is_cut_there(seed: int) -> None:
    """While the velocity is constant a call at a time is a buffered call at a place: 50 pulse for each ms."""
    chance = random.Random(seed)
    distance = (
        "GT_SetLaserDisMode(1,0,{20000,0,0,0},{1000,1000,1000,1000},0)\nGT_SetLaserDisRatio({0.5,0,0,0},15,70,0)\n"
        if chance.random() < 0.5
        else ""
    )
    delays = f"GT_SetLevelDelay({chance.randrange(900)},{chance.randrange(900)},0)\n"
    first = "GT_BufLaserPrfFollow(1,0.9,5,80,0,0)\n" if chance.random() < 0.5 else POWER
    timed, cut = "", ""
    times = sorted(chance.choices([25 + n / 10 for n in range(19750)], k=8))
    for time in times:
        value = chance.randrange(10, 90)
        immediate, buffered = chance.choice(
            [
                (f"GT_LaserPrfCmd({value},0)", f"GT_BufLaserPrfCmd(1,{value},0,0)"),
                ("GT_SetHSIOOpt(1,0)", "GT_BufLaserOn(1,0,0)"),
                ("GT_SetHSIOOpt(0,0)", "GT_BufLaserOff(1,0,0)"),
            ]
        )
        timed += f"[{1000 + time}] {immediate}\n"
        cut += f"GT_LnXY(1,{round(625 + 50 * (time - 25))},0,50,2,50,0)\n{buffered}\n"
    machine = Machine(period_us=chance.choice([250, 100, 70]))
    found = recorded(delays, distance, HEAD, first, ON, LINE, START, timed, machine=machine)
    cut_text = delays + distance + HEAD + first + ON + cut + "GT_LnXY(1,100000,0,50,2,0,0)\nGT_CrdStart(1,0)\n"
    wanted = run_listing(cut_text, machine)
    for name in ("ch0_emission_ms", "ch0_power_ms", "ch0_clamped_ms"):
        assert sum(found.column(name)) == pytest.approx(sum(wanted.column(name)), rel=1e-9, abs=1e-6), name
