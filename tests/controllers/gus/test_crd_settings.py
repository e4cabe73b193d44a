"""GT_SetCrdPrm: limits of velocity and acceleration, least time at constant velocity, origin. Numbers by hand."""

from __future__ import annotations

import math

import pytest
from support.tools import Ran, run_listing

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
"""
WAIT = "GT_CrdStatus(1,run,segment,0)\n"


def system(
    *, vel_max: float = 500, acc_max: float = 10, even_time: int = 0, sets_origin: int = 1, origin: str = "0,0,0"
) -> str:
    """GT_SetCrdPrm of coordinate system 1: X is axis 1, Y axis 2."""
    limits = f"{vel_max},{acc_max},{even_time},{sets_origin}"
    return f"GT_SetCrdPrm(1,{{2,{{1,2,0,0,0,0,0,0}},{limits},{{{origin},0,0,0,0,0}}}})\n"


def stage(*lines: str) -> str:
    """A stage of lines, each given as X, Y and velocity, acceleration, end velocity."""
    return "GT_CrdClear(1,0)\n" + "".join(f"GT_LnXY(1,{line},0)\n" for line in lines) + "GT_CrdStart(1,0)\n"


def messages(ran: Ran) -> list[tuple[int, str, str]]:
    return [(d.span.line, d.rule.code, d.message) for d in ran.diagnostics]


def test_the_largest_acceleration_limits_all_segments() -> None:
    """10,000 pulse at 50 pulse/ms: 200 ms at velocity and one ramp more, of 5 ms at 10, of 100 ms at 0.5 pulse/ms2."""
    free = run_listing(HEAD + system() + stage("10000,0,50,10,0"))
    assert free.column("duration_ms") == pytest.approx([205])
    assert messages(free) == []
    limited = run_listing(HEAD + system(acc_max=0.5) + stage("10000,0,50,10,0"))
    assert limited.column("duration_ms") == pytest.approx([300])
    text = "the segment's acceleration: it is above synAccMax of GT_SetCrdPrm, which limits it"
    assert messages(limited) == [(6, "GJ702", text)]


def test_the_least_time_at_constant_velocity_lowers_the_peak() -> None:
    """Up and down at 1 pulse/ms2 take v*v pulse of the 1000, the 50 ms in between 50*v: v = sqrt(1625) - 25."""
    triangle = run_listing(HEAD + system() + stage("1000,0,50,1,0"))
    assert triangle.column("vel_max_mm_s") == pytest.approx([math.sqrt(1000)])
    even = run_listing(HEAD + system(even_time=50) + stage("1000,0,50,1,0"))
    peak = math.sqrt(1625) - 25
    assert peak == pytest.approx(15.31, abs=0.01)
    assert even.column("vel_max_mm_s") == pytest.approx([peak])
    assert even.column("duration_ms") == pytest.approx([2 * peak + 50])


def test_a_segment_that_is_long_enough_keeps_its_velocity() -> None:
    """10,000 pulse at 50 pulse/ms and 1 pulse/ms2: 2500 pulse up and down, 150 ms at velocity."""
    ran = run_listing(HEAD + system(even_time=150) + stage("10000,0,50,1,0"))
    assert ran.column("duration_ms") == pytest.approx([250])


def test_the_origin_moves_the_path_on_the_machine() -> None:
    """The machine's field is -150..150 mm, of 1000 pulse each."""
    ran = run_listing(HEAD + system(origin="100000,-50000,0") + stage("60000,0,50,10,0"))
    assert (ran.column("x_mm"), ran.column("y_mm")) == ([160], [-50])
    # The machine is at 0, 0 when it is switched on: the path begins there.
    assert ran.column("length_mm") == pytest.approx([math.hypot(160, 50)])
    assert [(line, code) for line, code, _ in messages(ran)] == [(6, "GJ709")]


def test_the_origin_is_where_the_machine_is_unless_the_program_gives_one() -> None:
    first = HEAD + system(origin="1000,2000,0") + stage("3000,4000,50,10,0") + WAIT
    here = run_listing(first + system(sets_origin=0, origin="9000,9000,0") + stage("500,0,50,10,0"))
    assert (here.column("x_mm"), here.column("y_mm")) == ([4, 4.5], [6, 6])
    given = run_listing(first + system(origin="9000,9000,0") + stage("500,0,50,10,0"))
    assert (given.column("x_mm"), given.column("y_mm")) == ([4, 9.5], [6, 9])
    at_power_up = run_listing(HEAD + system(sets_origin=0, origin="9000,9000,0") + stage("500,0,50,10,0"))
    assert at_power_up.column("x_mm") == [0.5]


def test_an_arc_has_its_centre_relative_to_its_start_whatever_the_origin() -> None:
    text = HEAD + system(origin="5000,0,0") + "GT_CrdClear(1,0)\nGT_LnXY(1,0,0,50,10,0,0)\n"
    ran = run_listing(text + "GT_ArcXYC(1,2000,0,1000,0,0,50,10,0,0)\nGT_CrdStart(1,0)\n")
    assert ran.column("x_mm") == [5, 7]
    assert ran.column("length_mm") == pytest.approx([5, math.pi])
    assert messages(ran) == []


def test_distance_follow_reads_positions_of_the_axes_on_the_machine() -> None:
    """1 % for each mm from axis 1 at 4 mm; the dwell is at 1 mm of a system whose origin is at 5 mm: 10 + 2 %."""
    text = (
        HEAD
        + "GT_SetLaserDisMode(1,0,{4000,0,0,0},{1000,1000,1000,1000},0)\nGT_SetLaserDisRatio({1,0,0,0},0,100,0)\n"
        + system(origin="5000,0,0")
        + "GT_CrdClear(1,0)\nGT_BufLaserPrfCmd(1,10,0,0)\nGT_LnXY(1,1000,0,50,10,0,0)\n"
        + "GT_BufLaserOn(1,0,0)\nGT_BufDelay(1,10,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    )
    assert run_listing(text).column("ch0_power_mean")[1] == pytest.approx(12)
