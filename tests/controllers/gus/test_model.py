"""Effect of calls that are odd, refused, immediate or made while motion runs. Numbers by hand."""

from __future__ import annotations

import pytest
from support.tools import recorded_stream, run_listing, run_stream

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_CrdClear(1,0)
"""
LINE = "GT_LnXY(1,100000,0,50,2,0,0)\n"
"""2025 ms from 0."""


def test_immediate_power_while_moving_acts_after_the_calls_buffered_before_the_motion() -> None:
    text = (
        HEAD
        + "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert run_listing(text).column("ch0_power_ms") == pytest.approx([50 * 2025])
    assert run_listing(text + "GT_LaserPrfCmd(20,0)\n").column("ch0_power_ms") == pytest.approx([20 * 2025])
    waited = text + "GT_CrdStatus(1,run,segment,0)\nGT_LaserPrfCmd(20,0)\n"
    assert run_listing(waited).column("ch0_power_ms") == pytest.approx([50 * 2025])


def test_buffered_calls_join_the_running_stage() -> None:
    text = HEAD + LINE + "GT_CrdStart(1,0)\n"
    more = "GT_BufLaserPrfCmd(1,30,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,0,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\n"
    ran = run_listing(text + more)
    assert ran.column("stage") == [1, 1]
    assert ran.column("ch0_power_ms") == pytest.approx([0, 30 * 2025])
    again = run_listing(text + "GT_CrdStatus(1,run,segment,0)\n" + more + "GT_CrdStart(1,0)\n")
    assert again.column("stage") == [1, 2]
    assert again.column("ch0_power_ms") == pytest.approx([0, 30 * 2025])


def test_a_status_that_was_recorded_with_what_it_read_does_not_wait() -> None:
    text = HEAD + LINE + "GT_CrdStart(1,0)\nGT_CrdStatus(1,1,0,0)\nGT_LnXY(1,0,0,50,2,0,0)\n"
    assert run_stream(recorded_stream(text)).column("stage") == [1, 1]
    waited = text + "AT_REST(1)\nGT_CrdStatus(1,0,2,0)\nGT_LnXY(1,9000,0,50,2,0,0)\nGT_CrdStart(1,0)\n"
    assert run_stream(recorded_stream(waited)).column("stage") == [1, 1, 2]


def test_the_mode_does_not_change_while_moving() -> None:
    ran = run_listing(
        HEAD
        + "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_CrdStart(1,0)\nGT_LaserPowerMode(0,40,0,0)\nGT_BufLaserOff(1,0,0)\n"
    )
    assert "GT_LaserPowerMode returns 1" in " ".join(f.message for f in ran.diagnostics)
    assert ran.column("ch0_power_max") == [50]


def test_a_refused_call_has_no_effect() -> None:
    ran = run_listing(
        HEAD
        + "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + "GT_BufLaserPrfCmd(1,101,0,0)\nGT_LnXY(1,5,0,0,2,0,0)\n"
        + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert ran.column("ch0_power_max") == [50]
    assert [f.fields["code"] for f in ran.diagnostics if f.rule.code == "GJ701"] == [7, 7]


def test_a_new_mode_resets_the_power() -> None:
    ran = run_listing(
        HEAD
        + "GT_LaserPrfCmd(50,0)\nGT_LaserPowerMode(2,10,2,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert ran.column("ch0_power_max") == [2]
    assert "GJ712" in ran.codes()
    kept = run_listing(
        HEAD
        + "GT_LaserPrfCmd(50,0)\nGT_LaserPowerMode(0,90,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert kept.column("ch0_power_max") == [50]


def test_switch_readings() -> None:
    ran = run_listing(
        "GT_GetHSIOOpt(&v,0)\nGT_SetHSIOOpt(1,0)\nGT_GetHSIOOpt(&v,0)\nGT_GetHSIOOpt(&v,1)\nGT_BufLaserOff(1,0,0)\n"
        + LINE
        + "GT_BufLaserOn(1,0,0)\nGT_CrdStart(1,0)\nGT_GetHSIOOpt(&v,0)\nGT_CrdStatus(1,run,segment,0)\n"
        "GT_GetHSIOOpt(&v,0)\nGT_SetHSIOOpt(0,0)\n"
    )
    readings = [(r["line"], r["value"]) for r in ran.report.notes["readings"]]
    assert readings == [(1, 0), (3, 1), (4, 0), (9, 0), (11, 1)]


def test_both_coordinate_systems_in_turn() -> None:
    ran = run_listing(
        LINE + "GT_CrdStart(1,0)\nGT_CrdStatus(1,run,segment,0)\nGT_LnXY(2,0,1000,50,2,0,1)\nGT_CrdStart(2,2)\n"
    )
    assert ran.column("stage") == [1, 2]
    assert "GJ703" not in ran.codes()


def test_syn_vel_max_limits_the_velocity() -> None:
    crd = "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},20,10,0,1,{0,0,0,0,0,0,0,0}})\n"
    ran = run_listing(crd + LINE + "GT_CrdStart(1,0)\n")
    # At 20 pulse/ms: 10 ms up and down (100 pulse each), 99800 at 20.
    assert ran.column("duration_ms") == pytest.approx([20 + 4990])
    assert ran.column("vel_max_mm_s") == pytest.approx([20])


def test_distance_follow_takes_its_axes_from_the_coordinate_system() -> None:
    """profile {0,1,2,..}: X is axis 2, Y axis 3; the ratio of axis 1 then means an axis that stands still."""
    crd = "GT_SetCrdPrm(1,{2,{0,1,2,0,0,0,0,0},1000,10,0,1,{0,0,0,0,0,0,0,0}})\n"
    tail = "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n" + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    for ratio, top in (("{1,0,0,0}", 50), ("{0,0.1,0,0}", 60)):
        ran = run_listing(
            HEAD
            + crd
            + "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
            + f"GT_SetLaserDisRatio({ratio},0,100,0)\n"
            + tail
        )
        assert ran.column("ch0_power_max") == pytest.approx([top], abs=0.001)


def test_a_distance_ratio_before_its_mode_has_no_effect() -> None:
    ratio = "GT_SetLaserDisRatio({1,0,0,0},0,100,0)\n"
    mode = "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
    tail = "GT_BufLaserPrfCmd(1,10,0,0)\nGT_BufLaserOn(1,0,0)\n" + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    assert run_listing(HEAD + ratio + mode + tail).column("ch0_power_max") == [10]
    assert run_listing(HEAD + mode + ratio + tail).column("ch0_power_max") == pytest.approx([100], abs=0.01)


def test_output_while_off() -> None:
    pwm = run_listing("GT_LaserPowerMode(0,100,0,0)\nGT_SetWaitPulse(1,5,10,0)\n")
    assert pwm.report.totals["channels"][0]["off_output"] == {"standby_khz": 5, "standby_pct": 10}
    analog = run_listing("GT_LaserPowerMode(2,10,0,0)\nGT_SetPreVltg(1,0.5,0)\n")
    assert analog.report.totals["channels"][0]["off_output"] == {"prevoltage_v": 0.5}
    off = run_listing("GT_LaserPowerMode(0,100,0,0)\nGT_SetWaitPulse(1,5,10,0)\nGT_SetWaitPulse(0,0,0,0)\n")
    assert off.report.totals["channels"][0]["off_output"] is None
    assert "GJ701" not in off.codes()
