"""Durations, velocities and lengths of segments. Numbers by hand."""

from __future__ import annotations

import pytest
from support.tools import MACHINE, MARK, recorded_stream, run_job, run_listing, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream


def test_a_start_above_the_velocity_slows_down_first() -> None:
    ran = run_listing("GT_LnXY(1,10000,0,50,2,50,0)\nGT_LnXY(1,20000,0,20,2,0,0)\nGT_CrdStart(1,0)\n")
    # 50 to 20 in 15 ms and 525 pulse; 20 to 0 in 10 ms and 100; 9375 at 20.
    assert ran.column("duration_ms")[1] == pytest.approx(15 + 10 + 9375 / 20)
    assert ran.column("vel_max_mm_s")[1] == pytest.approx(50)
    assert "GJ705" in ran.codes()


def test_a_dwell_stops_the_motion_not_the_emission() -> None:
    ran = run_job(MARK + "LASER POWER 10\nLINE X 1\nLASER ON\nDWELL 25\nLASER OFF\nLINE X 2\n")
    assert [int(k) for k in ran.column("kind")] == [1, 4, 1]
    assert ran.column("ch0_emission_ms") == pytest.approx([0, 25, 0])
    assert ran.column("x_mm") == [1, 1, 2]
    assert ran.column("vel_max_mm_s")[1] == 0


def test_length_of_an_arc_on_unequal_axes_is_an_ellipse() -> None:
    # Half axes 10 mm and 20 mm: 96.884482205477 mm (complete elliptic integral, tables).
    ran = run_listing("GT_ArcXYC(1,0,0,10000,0,1,50,2,0,0)\nGT_CrdStart(1,0)\n", Machine(pulses_per_mm=(1000, 500)))
    assert ran.column("length_mm") == pytest.approx([96.88448220547674], rel=1e-12)


@pytest.mark.parametrize("vel_acc", ["1e-320,1", "1,1e-320", "1e-9,1"])
def test_a_run_that_never_ends_is_too_long(vel_acc: str) -> None:
    """Its time may be more than a float holds."""
    stream = recorded_stream(f"GT_LnXY(1,9000,0,{vel_acc},0,0)\nGT_CrdStart(1,0)\n")
    trace, diagnostics = simulate_stream(stream, MACHINE, is_listing=True)
    assert trace is None
    assert diagnostics[-1].rule.code == "GJ713"


def test_so_is_that_of_a_job() -> None:
    trace, diagnostics = simulate_stream(stream_of(MARK + "VEL 1e-8\nLASER POWER 10\nJUMP X 2\n"), MACHINE)
    assert trace is None
    assert diagnostics[-1].rule.code == "GJ713"
