"""Emission intervals from switches, delays and FPK. Numbers by hand."""

from __future__ import annotations

import pytest
from support.tools import MARK, run_job, run_listing

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


def test_emission_through_a_wait_continues_from_the_first_moment() -> None:
    ran = run_job(MARK + "LASER DELAY ON 300 OFF 500\nLASER POWER 10\nLASER ON\nLINE X 1\nWAIT\nLINE X 2\nLASER OFF\n")
    # 1 mm at 100 mm/s, 10000 mm/s2: 20 ms. Stage 1 from 0.3 ms on; stage 2 all of it and 0.5 ms after it.
    assert ran.column("ch0_emission_ms") == pytest.approx([19.7, 20.5])


def test_the_off_delay_of_a_stage_emits_at_rest_and_counts_for_its_segment() -> None:
    ran = run_job(MARK + "LASER DELAY ON 0 OFF 500\nLASER POWER 10\nLASER ON\nLINE X 1\nLASER OFF\nWAIT\nLINE X 2\n")
    assert ran.column("ch0_emission_ms") == pytest.approx([20.5, 0])
    assert [int(k) for k in ran.column("kind")] == [0, 1]


def test_delays_apply_to_the_immediate_switch_of_a_moving_stage() -> None:
    text = "GT_SetLevelDelay(0,500,0)\n" + LINE + "GT_CrdStart(1,0)\nGT_SetHSIOOpt(1,0)\nGT_BufLaserOff(1,0,0)\n"
    assert run_listing(text).column("ch0_emission_ms") == pytest.approx([2024.5])
    at_rest = "GT_SetLevelDelay(0,500,0)\nGT_SetHSIOOpt(1,0)\n" + LINE + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    assert run_listing(at_rest).column("ch0_emission_ms") == pytest.approx([2025])


def test_emission_in_a_stage_without_motion_belongs_to_no_segment() -> None:
    ran = run_listing(HEAD + "GT_BufLaserOn(1,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n")
    assert len(ran.report) == 0
    assert ran.report.totals["channels"][0]["emission_ms"] == 0


def test_emission_before_any_motion_does_not_follow_velocity() -> None:
    ran = run_listing(
        "GT_SetLevelDelay(700,0,0)\nGT_BufLaserPrfFollow(1,0.5,10,90,0,0)\nGT_BufLaserOn(1,0,0)\n"
        "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\nGT_CrdStatus(1,run,segment,0)\n" + LINE + "GT_CrdStart(1,0)\n"
    )
    (channel,) = ran.report.totals["channels"]
    assert channel["before_motion_power_ms"] == pytest.approx(7)
    assert ran.column("ch0_emission_ms") == [0]


def test_switch_and_emission_with_fpk() -> None:
    """On at 0 and off at 2025 ms, delays 30 and 40 us: the switch; the emission 20 us and 50 us after it."""
    text = (
        HEAD
        + "GT_SetLevelDelay(40,30,0)\nGT_EnaFPK(10,20,50,0)\nGT_BufLaserPrfCmd(1,50,0,0)\nGT_BufLaserOn(1,0,0)\n"
        + LINE
        + "GT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    trace, _ = simulate_stream(read_listing(source)[0], Machine(), is_listing=True)
    assert trace is not None
    emission = trace.channels[0].emission
    assert [*emission.switch.start_ms, *emission.switch.end_ms] == pytest.approx([0.03, 2025.04])
    assert [*emission.start_ms, *emission.end_ms] == pytest.approx([0.05, 2025.09])
    assert emission.carried.tolist() == [False]
