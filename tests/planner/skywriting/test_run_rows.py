"""Run-ins, run-outs and the jumps to and from them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from oracles.skywriting import Sky, Step
from support.skywriting import HEAD_MM, case_of, compiled, diagnostics_of, head, marked, moves_of, must, on_circles

from gusjob.diagnostics.model import Severity


def test_mode_1_begins_at_its_start() -> None:
    """Also behind a mark of mode 2 without a jump in between: its reverse run is no arc from somewhere else."""
    sky = Sky(mode=2, timelag=250.0)
    steps = marked(head(sky), (15000.0, 5000.0))
    steps += [Step(op="sky", sky=replace(sky, mode=1)), Step(op="on")]
    steps += [Step(op="arc", at=(15000.0, 9000.0), centre=(15000.0, 7000.0)), Step(op="off")]
    on_circles(must(case_of(steps)))


@pytest.mark.parametrize(("lag", "furthest"), [(1500, 500), (4000, 4500)])
@pytest.mark.parametrize("then", ["DWELL 20", "WAIT"])
def test_a_run_out_before_a_stop_lasts_until_laser_off(lag: int, furthest: int, then: str) -> None:
    """Down in 1 ms and 500 um, back to E in 1.41 ms more: enough for 1.5 ms, not for 4."""
    text = HEAD_MM + f"SKYWRITE MODE 2 TIMELAG {lag}us NPREV 0 NPOST 0\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
    stream, localized = compiled(text + then + "\nJUMP X 0\n")
    assert [f for f in localized if f.severity is not Severity.NOTE] == []
    assert max(moves_of(stream).at) == (10000.0 + furthest, 0.0)


def test_jumps_at_corners_go_at_the_jumpvel_in_force_there() -> None:
    text = HEAD_MM + "JUMPVEL 3000\nSKYWRITE MODE 2 TIMELAG 250us\nJUMP X 5\nLASER ON\nLINE X 10\n"
    moves = moves_of(compiled(text + "JUMPVEL 2000\nLINE X 10 Y 5\nLASER OFF\nJUMP X 0\n")[0])
    assert [v for v in moves.vel if v != 1000.0] == [3000.0, 2000.0, 2000.0]


def test_a_jump_in_front_of_a_wait_goes_where_it_is_sent() -> None:
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us NPREV 0\nJUMP X 5\nWAIT\nLASER ON\nLINE X 10\nLASER OFF\nJUMP X 0\n"
    assert moves_of(compiled(text)[0]).at[:3] == [(5000.0, 0.0), (4500.0, 0.0), (5000.0, 0.0)]


def test_a_run_in_that_leaves_its_circle_keeps_its_speed() -> None:
    """Half a turn of 63 um is too short to reach 140 mm/s at 100 pulse/ms2: 98 um."""
    text = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 140\nACC 100000\nSKYWRITE MODE 2 TIMELAG 250us\n"
    found = diagnostics_of(text + "JUMP X 5\nLASER ON\nARC CCW I 0.02 J 0\nLASER OFF\nJUMP X 0\n")
    assert [f.rule.code for f in found if f.severity is not Severity.NOTE] == []
