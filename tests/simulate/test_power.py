"""Held power: limits, follow, ticks. Numbers by hand; the reference is compared with in test_power_oracle.py."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.tools import MARK, run_job, run_listing, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.frontend import check_text, read_listing
from gusjob.simulate.tick_runs import RunSums
from gusjob.simulate.ticks import SampledPower

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_CrdClear(1,0)
"""
LINE = "GT_LnXY(1,100000,0,50,2,0,0)\n"
"""2025 ms from 0."""


def test_mode_limits_clamp_and_time_is_counted() -> None:
    ran = run_listing(
        "GT_LaserPowerMode(2,5,1,0)\nGT_BufLaserPrfCmd(1,7,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_BufLaserPrfCmd(1,0.5,0,0)\nGT_LnXY(1,0,0,50,2,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert ran.column("ch0_power_max") == [5, 1]
    assert ran.column("ch0_clamped_ms") == pytest.approx([2025, 2025])


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


def test_a_distance_ratio_of_zero_still_has_its_limits() -> None:
    ran = run_listing(
        HEAD
        + "GT_SetLaserDisMode(1,0,{0,0,0,0},{1000,1000,1000,1000},0)\n"
        + "GT_SetLaserDisRatio({0,0,0,0},10,20,0)\nGT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert ran.column("ch0_power_ms") == pytest.approx([20 * 2025])
    assert ran.column("ch0_clamped_ms") == pytest.approx([2025])


def test_duty2_emits_by_command_as_duty_does() -> None:
    text = MARK + "LASER POWER 40\nLASER ON\nLINE X 1\nLASER OFF\n"
    plain, high = run_job(text), run_job(text.replace("DUTY", "DUTY2"))
    assert high.column("ch0_power_ms") == plain.column("ch0_power_ms") == pytest.approx([800])


def test_two_units_on_one_channel_are_two_totals() -> None:
    first = "LASER POWER 40\nLASER ON\nLINE X 1\nLASER OFF\n"
    ran = run_job(MARK + first + "LASER MODE ANALOG\nLASER POWER 3\nLASER ON\nLINE X 2\nLASER OFF\n")
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


def test_a_follow_late_in_a_long_job_loses_no_digits() -> None:
    """After 2.7 hours, ten million ticks of 1 us: 1000 of them up, 1000 down, each step 0.002 pulse/ms."""
    wait = "GT_BufDelay(1,16383,0)\n" * 600
    text = HEAD + wait + "GT_BufLaserPrfFollow(1,10,5,100,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,20000,0,2,2,0,0)\n"
    ran = run_listing(text + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n", Machine(period_us=1))
    # 1 ms over 1 pulse, 9999 ms over 19998 pulse, 1 ms over 1 pulse. The ramps sum up to 1000 steps each.
    ramps = 2 * 1000 * 5 + 10 * 0.002 * (sum(range(1000)) + sum(range(1, 1001)))
    expected = (ramps + 9_999_000 * 25) / 1000
    assert ran.column("ch0_power_ms")[-1] == pytest.approx(expected, rel=1e-11)
    assert ran.column("ch0_power_min")[-1] == pytest.approx(5, abs=1e-6)
    assert ran.column("ch0_power_max")[-1] == pytest.approx(25)


def test_a_dwell_after_an_abrupt_stop_has_no_velocity() -> None:
    """25 ms up to 50 pulse/ms, 1987.5 ms at it; the dwell begins on tick 8050 and is at the lowest power."""
    text = HEAD + "GT_BufLaserPrfFollow(1,1,5,100,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,100000,0,50,2,50,0)\n"
    ran = run_listing(text + "GT_BufDelay(1,10,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n")
    assert ran.column("ch0_power_ms")[1] == pytest.approx(50)
    assert ran.column("ch0_power_max")[1] == pytest.approx(5)


@pytest.mark.parametrize(("period_us", "highest"), [(600, 60.96), (750, 60.9375)])
def test_velocity_and_distance_follow_turn_between_two_ticks(period_us: float, highest: float) -> None:
    """60 + v - x with v = 2t, x = t^2: the top is at 1 ms; the highest tick is at 1.2 ms, or at 0.75 ms."""
    distance = "GT_SetLaserDisMode(1,0,{0,0,0,0},{1,1,1,1},0)\nGT_SetLaserDisRatio({-1,0,0,0},0,100,0)\n"
    text = HEAD + distance + "GT_BufLaserPrfFollow(1,1,60,100,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,50,0,10,2,0,0)\n"
    ran = run_listing(text + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n", Machine(period_us=period_us))
    assert ran.column("ch0_power_max") == [pytest.approx(highest, rel=1e-12)]


@pytest.mark.parametrize(
    "setting",
    [
        "LASER FOLLOW RATIO 0.001 MIN 5 MAX 90\n",
        "LASER DISTANCE REF X 3 Y -2 RATIO X 0.5 Y 0.2 MIN 0 MAX 100\nLASER POWER 40\n",
        "LASER DISTANCE REF X 3 Y -2 RATIO X 0.5 Y 0.2 MIN 0 MAX 100\nLASER FOLLOW MIN 5 MAX 50 AT 100mm/s\n",
        "LASER DISTANCE REF X 3 Y -2 RATIO X 0.5 Y 0.2 MIN 0 MAX 7 SOURCE ACTUAL\nLASER POWER 40\n",
    ],
)
def test_no_tick_is_computed_where_power_is_a_function_of_its_number(
    setting: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def by_ticks(*_: object) -> RunSums:
        raise AssertionError("computed tick by tick")

    monkeypatch.setattr(SampledPower, "by_ticks", by_ticks)
    text = MARK + setting + "LASER ON\nLINE X 10 Y 3\nLINE X -4 Y -20\nDWELL 3\nLASER OFF\n"
    assert all(energy > 0 for energy in run_job(text).column("ch0_power_ms"))


def test_power_held_at_moments() -> None:
    """Follow 2 * v + 10 up to 100, at 2 pulse/ms2; then direct, which holds after the end too."""
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
