"""Laser-on, laser-off and power where the beam is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from oracles import skywriting as ref
from oracles.skywriting import Sky, Step
from support.skywriting import BEAM, FAST, HEAD_MM, LATE, compiled, head, marked, ran
from support.tools import MACHINE, calls_of, run_job

from gusjob.config.machine import Scanner, ScannerModel


@pytest.mark.parametrize("circle", ["ARC CW I 0 J -3.9", "ARC CCW I 0.065", "ARC CW I 2 J 1"])
@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("start", ["X 28.009 Y -16.057", "X 28 Y -16", "X 0.003 Y 1.001", "X -0.007 Y 0.009"])
def test_a_full_circle_is_runwhole(circle: str, mode: int, start: str) -> None:
    top = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 100\nACC 1000000\n"
    body = f"JUMP {start}\nLASER ON\n{circle}\nLASER OFF\n"
    run = run_job(top + f"SKYWRITE MODE {mode} TIMELAG 174us\n" + body)
    radius = {"-3.9": 3.9, "0.065": 0.065, "1": math.sqrt(5)}[circle.split()[-1]]
    assert sum(run.column("ch0_emission_ms")) == pytest.approx(2 * math.pi * radius / 0.1, abs=0.05)


@pytest.mark.parametrize("shift", [-100.0, 0.0, 100.0])
def test_the_laser_stays_on_at_a_flat_corner(shift: float) -> None:
    """Off and on again where the path continues: the laser stays on, as at any flat corner of mode 3."""
    sky = Sky(mode=3, timelag=250.0, shift=shift)
    steps = marked(marked(head(sky), (15000.0, 5000.0)), (25000.0, 5000.0))
    stream, _ = compiled(ref.job_text(steps))
    emission = ran(stream).channels[0].emission
    total = float((emission.end_ms - emission.start_ms).sum())
    assert len(emission.start_ms) == 1
    assert total == pytest.approx(20.0 - shift / 1000, abs=2 * BEAM / FAST)


@pytest.mark.parametrize("first", [0, 1])
def test_another_channel_from_a_flat_corner_on(first: int) -> None:
    """One goes off TIMELAG behind the corner, the other on TIMELAG (and SHIFT) behind it."""
    sky = Sky(mode=3, timelag=250.0, shift=20.0)
    steps = [*head(sky), Step(op="power", value=50.0, channel=1), Step(op="on", channel=first)]
    steps += [Step(op="line", at=(15000.0, 5000.0)), Step(op="off", channel=first), Step(op="on", channel=1 - first)]
    steps += [Step(op="line", at=(25000.0, 5000.0)), Step(op="off", channel=1 - first)]
    trace = ran(compiled(ref.job_text(steps))[0])
    one, other = trace.channels[first].emission, trace.channels[1 - first].emission
    begin, end = one.start_ms[0] - 0.27, other.end_ms[0] - 0.25
    assert one.end_ms[0] == pytest.approx(begin + 10.0 + 0.25, abs=2 * BEAM / FAST)
    assert other.start_ms[0] == pytest.approx(begin + 10.0 + 0.27, abs=2 * BEAM / FAST)
    assert end == pytest.approx(begin + 20.0, abs=2 * BEAM / FAST)


def test_each_stage_has_its_own_laser_delay() -> None:
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\n"
    for x, (on, off) in ((5, (20, 30)), (20, (100, 180)), (40, (0, 240))):
        text += f"LASER DELAY ON {on} OFF {off}\nJUMP X {x}\nLASER ON\nLINE X {x + 5}\nLASER OFF\nJUMP X {x + 9}\n"
    found = run_job(text, LATE).report.marks
    assert found is not None
    assert found["on_error_um"] == pytest.approx([0, 0, 0], abs=1e-6)
    assert found["off_error_um"] == pytest.approx([0, 0, 0], abs=1e-6)


def test_laser_on_is_at_the_start_of_a_full_circle_not_at_its_end() -> None:
    """A quarter of a pulse behind S, which is E too."""
    text = HEAD_MM.replace("VEL 1000", "VEL 500") + "SKYWRITE MODE 2 TIMELAG 0.5us NPREV 10 NPOST 10\nJUMP X 5\n"
    emission = ran(compiled(text + "LASER ON\nARC CCW I 1 J 0\nLASER OFF\nJUMP X 0\n")[0]).channels[0].emission
    assert emission.end_ms - emission.start_ms == pytest.approx([math.tau / 0.5], abs=0.02)


def test_a_first_pulse_killer_that_is_off_again_delays_nothing() -> None:
    found = run_job(
        "LASER MODE FREQUENCY WIDTH 5us MAX 100\nLASER FPK WIDTH 20 GAP 0 OFFDELAY 90\nLASER FPK OFF\n"
        "SKYWRITE MODE 2 TIMELAG 250us\nLASER POWER 30\nVEL 800\nACC 500000\n"
        "JUMP X 5\nLASER ON\nLINE X 9\nLASER OFF\nJUMP X 0\n",
        replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    assert found.report.marks is not None
    assert found.report.marks["off_error_um"] == pytest.approx([0], abs=1)


def test_each_channel_has_its_own_delays() -> None:
    """Channel 1 is set while channel 0 waits: neither delays the other."""
    found = run_job(
        "LASER MODE DUTY CARRIER 10\nLASER MODE DUTY CARRIER 10 CHANNEL 1\nLASER DELAY ON 5 OFF 5\n"
        "LASER DELAY ON 200 OFF 210 CHANNEL 1\nLASER POWER 50\nLASER POWER 20 CHANNEL 1\nVEL 800\nACC 500000\n"
        "SKYWRITE MODE 3 TIMELAG 250us NPREV 60 NPOST 60\nJUMP X 5\nLASER ON\nLINE X 9\nLASER ON CHANNEL 1\nLINE X 12\n"
        "LASER OFF\nLASER OFF CHANNEL 1\nJUMP X 0\n",
        replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    marks = found.report.marks
    assert marks is not None
    assert marks["channel"].tolist() == [0, 1]
    assert marks["length_mm"] == pytest.approx([7, 3], abs=2e-3)
    assert np.abs(marks["on_error_um"]).max() <= 1
    assert np.abs(marks["off_error_um"]).max() <= 1


@pytest.mark.parametrize(
    "sky", ["MODE 1 TIMELAG 1000us", "MODE 2 TIMELAG 250us NPOST 2", "MODE 3 TIMELAG 400us SHIFT 90us"]
)
@pytest.mark.parametrize(
    "mark",
    [
        "LASER ON\n{on}LINE X 8\n{on}LINE X 12 Y 1\n{on}LASER OFF\n",
        "LASER ON\nLINE X 8\nLINE X 12 Y 1\nLASER OFF\n{off}",
        "LASER ON\nLINE X 8\nLASER OFF\n{off}JUMP X 12\n{off}LASER ON\n{on}LINE X 16\nLASER OFF\n{off}DWELL 5\n{off}",
    ],
)  # fmt: skip
def test_a_switch_that_changes_nothing_moves_no_edge(sky: str, mark: str) -> None:
    """Otherwise one that stays would switch on behind a laser-off that was moved, and off before it."""
    top = HEAD_MM + f"SKYWRITE {sky}\nLASER POWER 40\nJUMP X 2\n"
    spare, plain = (top + mark.format(on=on, off=off) for on, off in (("LASER ON\n", "LASER OFF\n"), ("", "")))
    assert calls_of(spare) == calls_of(plain)


def test_a_laser_off_before_the_first_laser_on_stays() -> None:
    """An earlier program may have left the laser on."""
    job = (
        HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\nLASER POWER 40\nLASER OFF\nJUMP X 2\nLASER ON\nLINE X 8\nLASER OFF\n"
    )
    assert sum("BufLaserOff" in call for call in calls_of(job)) == 2


def test_a_stage_of_switches_alone_keeps_them() -> None:
    """A LASER OFF for a laser that is off, behind a WAIT: nothing is moved there, and the stage is not empty."""
    job = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\nLASER ON\nLINE X 10\nLASER OFF\nWAIT\nLASER OFF\n"
    assert calls_of(job)[-3:] == ["GT_CrdClear(1,0)", "GT_BufLaserOff(1,0,0)", "GT_CrdStart(1,0)"]
