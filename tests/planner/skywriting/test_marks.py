"""Which motions are one mark, and how fast they are."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace
from support.skywriting import HEAD_MM, compiled, moves_of, ran
from support.tools import MACHINE, run_job

from gusjob.config.machine import Machine, Scanner, ScannerModel
from gusjob.diagnostics.model import Severity


def test_the_chords_of_an_arc_are_one_mark() -> None:
    """An arc that becomes chords is run in and out of once, in modes 1 and 2 too."""
    machine = Machine(pulses_per_mm=(1000.0, 800.0))
    text = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 100\nACC 1000000\nSKYWRITE MODE 2 TIMELAG 250us\nLASER ON\n"
    stream, localized = compiled(text + "ARC CCW X 2 Y 2 I 0 J 2\nLASER OFF\n", machine)
    assert [f.rule.code for f in localized if f.severity is Severity.ERROR] == []
    trace = ran(stream, machine)
    assert len(trace.channels[0].emission.start_ms) == 1


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("arc", ["ARC CCW X 20 Y 10 R 5", "ARC CW I 5 J 2"])
def test_an_arc_on_unequal_axes_is_at_speed_all_the_way(arc: str, mode: int) -> None:
    """It becomes chords, but stays one mark: 50 % at 1000 mm/s are 50 %*ms/mm everywhere."""
    machine = replace(MACHINE, pulses_per_mm=(1000.0, 800.0))
    found = run_job(
        "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 1000\nACC 500000\n"
        f"SKYWRITE MODE {mode} TIMELAG 250us\nJUMP X 20 Y 0\nLASER ON\n{arc}\nLASER OFF\nJUMP X 0\n",
        replace(machine, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    assert found.report.marks is not None
    assert len(found.report.marks["line"]) == 1
    assert found.report.marks["power_per_mm_peak"] == pytest.approx([50], rel=5e-3)
    assert found.report.marks["power_per_mm_rms_pct"] == pytest.approx([0], abs=0.1)
    assert abs(found.report.marks["off_error_um"][0]) < 2


@pytest.mark.parametrize(("x", "y"), [(7, 3), (1.1, 5.3), (3, 7), (-2.3, 9.1), (8, 1), (5, -9)])
def test_straight_on_is_flat_for_any_limit(x: float, y: float) -> None:
    text = f"SKYWRITE MODE 3 TIMELAG 250us LIMIT 1\nLASER ON\nLINE X {x} Y {y}\nLINE X {2 * x} Y {2 * y}\nLASER OFF\n"
    assert len(moves_of(compiled(HEAD_MM + text)[0]).at) == len(
        moves_of(compiled(HEAD_MM + text.replace("LIMIT 1", "LIMIT 0.9"))[0]).at
    )


def test_each_iteration_of_a_loop_is_a_mark_of_its_own() -> None:
    """Lines of one statement are no pieces of an arc: each has its run-in of 880 um."""
    text = "SKYWRITE MODE 2 TIMELAG 250us\nLASER ON\nREPEAT 3 AS k\nLINE X (5 * k + 5) Y (k * k)\nEND\nLASER OFF\n"
    assert len(ran(compiled(HEAD_MM + text)[0]).channels[0].emission.start_ms) == 3


@pytest.mark.parametrize("radius", [0.5, 2.0])
def test_chords_of_an_arc_are_slowed_as_the_arc_is(radius: float) -> None:
    """v^2/r stays within the machine's acceleration at the narrowest point, where X has the finer pulses."""
    machine = replace(MACHINE, pulses_per_mm=(1000.0, 800.0))
    text = HEAD_MM.replace("1000\n", "9000\n").replace("1000000", "5000000") + "SKYWRITE MODE 2 TIMELAG 250us\n"
    found = run_job(f"{text}JUMP X 20\nLASER ON\nARC CCW I {radius} J 0\nLASER OFF\nJUMP X 0\n", machine).report.marks
    assert found is not None
    fastest = math.sqrt(machine.max_acceleration_pulse_per_ms2 * radius / 1000)
    assert 50 / fastest <= found["power_per_mm_mid"][0] <= 1.08 * 50 / fastest
    assert found["power_per_mm_rms_pct"][0] < 1


def test_a_wait_separates_marks_that_go_straight_on() -> None:
    text = HEAD_MM + "SKYWRITE MODE 3 TIMELAG 250us\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\nWAIT\nLASER ON\n"
    emission = ran(compiled(text + "LINE X 20\nLASER OFF\nJUMP X 0\n")[0]).channels[0].emission
    assert emission.end_ms - emission.start_ms == pytest.approx([5, 10], abs=2e-3)
