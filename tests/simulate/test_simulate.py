"""What the interpreter does with calls that are odd, refused, immediate or made while motion runs. Numbers by hand.

The power of every segment against an independent reference is in test_reference.py.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.tools import MARK, run_job, run_listing, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.frontend import check_text, read_listing

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_CrdClear(1,0)
"""
LINE = "GT_LnXY(1,100000,0,50,2,0,0)\n"
"""2025 ms from 0."""


def test_immediate_power_while_moving_acts_behind_what_is_buffered_before_the_motion() -> None:
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


def test_the_mode_stays_while_moving() -> None:
    ran = run_listing(
        HEAD + "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n" + LINE
        + "GT_CrdStart(1,0)\nGT_LaserPowerMode(0,40,0,0)\nGT_BufLaserOff(1,0,0)\n"
    )  # fmt: skip
    assert "GT_LaserPowerMode returns 1" in " ".join(f.message for f in ran.diagnostics)
    assert ran.column("ch0_power_max") == [50]


def test_a_refused_call_has_no_effect() -> None:
    ran = run_listing(
        HEAD + "GT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + "GT_BufLaserPrfCmd(1,101,0,0)\nGT_LnXY(1,5,0,0,2,0,0)\n"
        + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )  # fmt: skip
    assert ran.column("ch0_power_max") == [50]
    assert [f.fields["code"] for f in ran.diagnostics if f.rule.code == "GJ701"] == [7, 7]


def test_mode_limits_clamp_and_time_is_counted() -> None:
    ran = run_listing(
        "GT_LaserPowerMode(2,5,1,0)\nGT_BufLaserPrfCmd(1,7,0,0)\nGT_BufLaserOn(1,0,0)\n" + LINE
        + "GT_BufLaserPrfCmd(1,0.5,0,0)\nGT_LnXY(1,0,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )  # fmt: skip
    assert ran.column("ch0_power_max") == [5, 1]
    assert ran.column("ch0_clamped_ms") == pytest.approx([2025, 2025])


def test_a_new_mode_forgets_the_power() -> None:
    ran = run_listing(
        HEAD + "GT_LaserPrfCmd(50,0)\nGT_LaserPowerMode(2,10,2,0)\nGT_BufLaserOn(1,0,0)\n" + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )  # fmt: skip
    assert ran.column("ch0_power_max") == [2]
    assert "GJ712" in ran.codes()
    kept = run_listing(
        HEAD + "GT_LaserPrfCmd(50,0)\nGT_LaserPowerMode(0,90,0,0)\nGT_BufLaserOn(1,0,0)\n" + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )  # fmt: skip
    assert kept.column("ch0_power_max") == [50]


def test_switch_readings() -> None:
    ran = run_listing(
        "GT_GetHSIOOpt(&v,0)\nGT_SetHSIOOpt(1,0)\nGT_GetHSIOOpt(&v,0)\nGT_GetHSIOOpt(&v,1)\nGT_BufLaserOff(1,0,0)\n"
        + LINE + "GT_BufLaserOn(1,0,0)\nGT_CrdStart(1,0)\nGT_GetHSIOOpt(&v,0)\nGT_CrdStatus(1,run,segment,0)\n"
        "GT_GetHSIOOpt(&v,0)\nGT_SetHSIOOpt(0,0)\n"
    )  # fmt: skip
    readings = [(r["line"], r["value"]) for r in ran.report.notes["readings"]]
    assert readings == [(1, 0), (3, 1), (4, 0), (9, 0), (11, 1)]


def test_light_between_stages_shines_on_from_the_first_moment() -> None:
    ran = run_job(MARK + "LASER DELAY ON 300 OFF 500\nLASER POWER 10\nLASER ON\nLINE X 1\nWAIT\nLINE X 2\nLASER OFF\n")
    # 1 mm at 100 mm/s, 10000 mm/s2: 20 ms. Stage 1 from 0.3 ms on; stage 2 all of it and 0.5 ms behind it.
    assert ran.column("ch0_emission_ms") == pytest.approx([19.7, 20.5])


def test_the_off_edge_of_a_stage_shines_at_rest_and_counts_there() -> None:
    ran = run_job(MARK + "LASER DELAY ON 0 OFF 500\nLASER POWER 10\nLASER ON\nLINE X 1\nLASER OFF\nWAIT\nLINE X 2\n")
    assert ran.column("ch0_emission_ms") == pytest.approx([20.5, 0])
    assert [int(k) for k in ran.column("kind")] == [0, 1]


def test_delays_apply_to_the_immediate_switch_of_a_moving_stage() -> None:
    text = "GT_SetLevelDelay(0,500,0)\n" + LINE + "GT_CrdStart(1,0)\nGT_SetHSIOOpt(1,0)\nGT_BufLaserOff(1,0,0)\n"
    assert run_listing(text).column("ch0_emission_ms") == pytest.approx([2024.5])
    at_rest = "GT_SetLevelDelay(0,500,0)\nGT_SetHSIOOpt(1,0)\n" + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    assert run_listing(at_rest).column("ch0_emission_ms") == pytest.approx([2025])


def test_both_coordinate_systems_in_turn() -> None:
    ran = run_listing(
        LINE + "GT_CrdStart(1,0)\nGT_CrdStatus(1,run,segment,0)\nGT_LnXY(2,0,1000,50,2,0,1)\nGT_CrdStart(2,2)\n"
    )
    assert ran.column("stage") == [1, 2]
    assert "GJ703" not in ran.codes()


def test_syn_vel_max_holds_the_velocity() -> None:
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
            HEAD + crd + "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
            + f"GT_SetLaserDisRatio({ratio},0,100,0)\n" + tail
        )  # fmt: skip
        assert ran.column("ch0_power_max") == pytest.approx([top], abs=0.001)


def test_distance_follow_on_an_arc_and_the_order_of_limits() -> None:
    # Base 50, 0.5 % per mm: on a circle of 10 mm about (10,0) x runs 0..20: 50..60; distance MAX 58, mode MAX 57.
    text = (
        "LASER MODE DUTY CARRIER 10 MAX 57\nLASER DISTANCE REF X 0 Y 0 RATIO X 0.5 Y 0 MIN 10 MAX 58\n"
        "VEL 100\nACC 10000\nLASER POWER 50\nLASER ON\nARC CCW I 10 J 0\nLASER OFF\n"
    )
    ran = run_job(text, Machine(period_us=10))
    assert ran.column("ch0_power_min") == pytest.approx([50], abs=1e-6)
    assert ran.column("ch0_power_max") == [57]
    # x = 10 - 10*cos(a) is above 14 mm (57 %) on acos(0.4)/pi of the way round, at constant speed.
    share = math.acos(0.4) / math.pi
    held = 2 * math.pi * 10 * share / 100 * 1000
    assert ran.column("ch0_clamped_ms") == pytest.approx([held], abs=0.05)


def test_a_start_above_the_velocity_slows_down_first() -> None:
    ran = run_listing("GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,20000,0,20,2,0,0)\nGT_CrdStart(1,0)\n")
    # 50 to 20 in 15 ms and 525 pulse; 20 to 0 in 10 ms and 100; 9375 at 20.
    assert ran.column("duration_ms")[1] == pytest.approx(15 + 10 + 9375 / 20)
    assert ran.column("vel_max_mm_s")[1] == pytest.approx(50)
    assert "GJ705" in ran.codes()


def test_velocity_follow_in_a_segment_that_slows_first() -> None:
    text = (
        "GT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\nGT_BufLaserPrfFollow(1,1,1,90,0,0)\n"
        "GT_LnXY(1,10000,0,50,2,50,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,20000,0,20,2,0,0)\nGT_BufLaserOff(1,0,0)\n"
        "GT_CrdStart(1,0)\n"
    )
    ran = run_listing(text, Machine(period_us=1))
    # The integral of velocity is the length: 10000 + 1 * duration, up to half a tick of ramp.
    duration = ran.column("duration_ms")[1]
    assert ran.column("ch0_power_ms")[1] == pytest.approx(10_000 + duration, rel=1e-5)


def test_a_dwell_stops_and_shines() -> None:
    ran = run_job(MARK + "LASER POWER 10\nLINE X 1\nLASER ON\nDWELL 25\nLASER OFF\nLINE X 2\n")
    assert [int(k) for k in ran.column("kind")] == [1, 4, 1]
    assert ran.column("ch0_emission_ms") == pytest.approx([0, 25, 0])
    assert ran.column("x_mm") == [1, 1, 2]
    assert ran.column("vel_max_mm_s")[1] == 0


def test_a_stage_without_motion_is_light_of_no_segment() -> None:
    ran = run_listing(HEAD + "GT_BufLaserOn(1,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n")
    assert len(ran.report) == 0
    assert ran.report.totals["channels"][0]["emission_ms"] == 0


def test_light_before_any_motion_follows_nothing() -> None:
    ran = run_listing(
        "GT_SetLevelDelay(700,0,0)\nGT_BufLaserPrfFollow(1,0.5,10,90,0,0)\nGT_BufLaserOn(1,0,0)\n"
        "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\nGT_CrdStatus(1,run,segment,0)\n" + LINE + "GT_CrdStart(1,0)\n"
    )
    (channel,) = ran.report.totals["channels"]
    assert channel["before_motion_power_ms"] == pytest.approx(7)
    assert ran.column("ch0_emission_ms") == [0]


def test_a_distance_ratio_before_its_mode_has_no_effect() -> None:
    ratio = "GT_SetLaserDisRatio({1,0,0,0},0,100,0)\n"
    mode = "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
    tail = "GT_BufLaserPrfCmd(1,10,0,0)\nGT_BufLaserOn(1,0,0)\n" + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    assert run_listing(HEAD + ratio + mode + tail).column("ch0_power_max") == [10]
    assert run_listing(HEAD + mode + ratio + tail).column("ch0_power_max") == pytest.approx([100], abs=0.01)


def test_a_distance_ratio_of_zero_still_has_its_limits() -> None:
    ran = run_listing(
        HEAD + "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
        + "GT_SetLaserDisRatio({0,0,0,0},10,20,0)\nGT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )  # fmt: skip
    assert ran.column("ch0_power_ms") == pytest.approx([20 * 2025])
    assert ran.column("ch0_clamped_ms") == pytest.approx([2025])


def test_length_of_an_arc_on_unequal_axes_is_an_ellipse() -> None:
    # Half axes 10 mm and 20 mm: 96.884482205477 mm (complete elliptic integral, tables).
    ran = run_listing("GT_ArcXYC(1,0,0,10000,0,1,50,2,0,0)\nGT_CrdStart(1,0)\n", Machine(pulses_per_mm=(1000, 500)))
    assert ran.column("length_mm") == pytest.approx([96.88448220547674], rel=1e-12)


def test_output_while_off() -> None:
    pwm = run_listing("GT_LaserPowerMode(0,100,0,0)\nGT_SetWaitPulse(1,5,10,0)\n")
    assert pwm.report.totals["channels"][0]["off_output"] == {"standby_khz": 5, "standby_pct": 10}
    analog = run_listing("GT_LaserPowerMode(2,10,0,0)\nGT_SetPreVltg(1,0.5,0)\n")
    assert analog.report.totals["channels"][0]["off_output"] == {"prevoltage_v": 0.5}
    off = run_listing("GT_LaserPowerMode(0,100,0,0)\nGT_SetWaitPulse(1,5,10,0)\nGT_SetWaitPulse(0,0,0,0)\n")
    assert off.report.totals["channels"][0]["off_output"] is None
    assert "GJ701" not in off.codes()


def test_duty2_emits_by_command_as_duty_does() -> None:
    text = MARK + "LASER POWER 40\nLASER ON\nLINE X 1\nLASER OFF\n"
    plain, high = run_job(text), run_job(text.replace("DUTY", "DUTY2"))
    assert high.column("ch0_power_ms") == plain.column("ch0_power_ms") == pytest.approx([800])


def test_two_units_on_one_channel_are_two_totals() -> None:
    ran = run_job(MARK + "LASER POWER 40\nLASER ON\nLINE X 1\nLASER OFF\nLASER MODE ANALOG\nLASER POWER 3\nLASER ON\nLINE X 2\nLASER OFF\n")  # fmt: skip  # noqa: E501
    assert [(c["unit"], c["power_ms"]) for c in ran.report.totals["channels"]] == [
        ("%", pytest.approx(800)),
        ("V", pytest.approx(60)),
    ]


def test_velocity_follow_over_a_million_ticks_equals_the_sum() -> None:
    # One segment of 100 s at a period of 50 us: 2 million ticks, cut into many runs.
    text = MARK + "LASER FOLLOW RATIO 0.3 MIN 5 MAX 20\nLASER ON\nLINE X 145 VEL 1.45 ACC 1\nLASER OFF\n"
    stream = stream_of(text)
    trace, _ = simulate_stream(stream, Machine(period_us=50))
    assert trace is not None
    duration = float(trace.schedule.times_ms[-1])
    ticks = np.arange(int(duration / 0.05) + 1) * 0.05
    ticks = ticks[ticks < duration]
    acc = 1 * 1000 / 1e6
    vel = np.minimum(np.minimum(acc * ticks, 1.45), acc * (duration - ticks))
    held = np.diff(np.append(ticks, duration))
    expected = math.fsum(np.minimum(0.3 * vel + 5, 20) * held)
    assert trace.channels[0].emitted.power_ms[0] == pytest.approx(expected, rel=1e-10)


def test_power_held_at_moments() -> None:
    """Follow 2 * v + 10 up to 100, at 2 pulse/ms2; then direct, which holds behind the end too."""
    text = HEAD + "GT_BufLaserPrfFollow(1,2,10,100,0,0)\n" + LINE + "GT_BufLaserPrfCmd(1,33,0,0)\nGT_BufDelay(1,5,0)\n"
    source, _ = check_text((text + "GT_CrdStart(1,0)\n").encode(), "test.gts")
    assert source is not None
    trace, _ = simulate_stream(read_listing(source)[0], Machine(), is_listing=True)
    assert trace is not None
    channel = trace.channels[0]
    time = np.array([0.0, 0.2499, 0.25, 0.3, 0.5, 22.3, 22.75, 1000, 2024.9, 2025, 2030, 9999])
    # 2 * 2 pulse/ms2 * 0.25 ms = 1 % a tick; 100 % from v = 45 on, at 22.5 ms; v falls below 45 at 2002.5 ms.
    held = [10, 10, 11, 11, 12, 10 + 89, 100, 100, 11, 33, 33, 33]
    assert channel.power.value(np.zeros(len(time), dtype=np.intp), time) == pytest.approx(held)


def test_the_switch_and_the_light_with_fpk() -> None:
    """On at 0 and off at 2025 ms, delays 30 and 40 us: the switch; the light 20 us and 50 us behind it."""
    text = (
        HEAD + "GT_SetLevelDelay(40,30,0)\nGT_EnaFPK(10,20,50,0)\nGT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )  # fmt: skip
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    trace, _ = simulate_stream(read_listing(source)[0], Machine(), is_listing=True)
    assert trace is not None
    shine = trace.channels[0].emission
    assert [*shine.switch.start_ms, *shine.switch.end_ms] == pytest.approx([0.03, 2025.04])
    assert [*shine.start_ms, *shine.end_ms] == pytest.approx([0.05, 2025.09])
    assert shine.carried.tolist() == [False]
