"""The path in strokes, against closed forms: cuts, emission, and the coarse cuts of long runs."""

from __future__ import annotations

from itertools import pairwise
from math import pi, sqrt

import numpy as np
import pytest
from support.tools import stream_of

from gusjob.config.machine import Laser, Machine, parse_scanner
from gusjob.controllers.gus.model import simulate_stream
from gusjob.view.strokes import Strokes, strokes_of

DUTY = "LOOKAHEAD OFF\nLASER MODE DUTY CARRIER 10\nVEL 100\nACC 10000\n"
"""100 mm/s at 10000 mm/s2: 10 ms and 0.5 mm to speed up, the same to slow down."""


BIN_MM = 0.05


def strokes(text: str, machine: Machine | None = None, fine_strokes: int = 300_000, *, energy: bool = False) -> Strokes:
    machine = machine or Machine()
    trace, _ = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    return strokes_of(trace, machine, fine_strokes, energy=energy)


def test_cut_where_the_velocity_changes_its_law() -> None:
    """10 mm: 0.5 mm up, 9 mm at 100 mm/s, 0.5 mm down."""
    found = strokes(DUTY + "LASER POWER 40\nLASER ON\nLINE X 10\nLASER OFF\n")
    assert found.exact
    assert found.duration_ms == pytest.approx([10, 90, 10])
    assert found.path.x1 == pytest.approx([0.5, 9.5, 10])
    assert found.vel0 == pytest.approx([0, 100, 100])
    assert found.vel1 == pytest.approx([100, 100, 0])
    emission = found.emissions[0]
    assert emission.on.all()
    assert emission.power == pytest.approx([40, 40, 40])


def ramp_ms(mm: float) -> float:
    """Time from rest to a place at 10000 mm/s2."""
    return sqrt(2 * mm / 0.01)


def test_energy_per_mm_in_bins() -> None:
    """In bin k of a ramp the beam is for ramp_ms(k + 1) - ramp_ms(k) bins; in between 40 % / (100 mm/s)."""
    found = strokes(DUTY + "LASER POWER 40\nLASER ON\nLINE X 10\nLASER OFF\n", energy=True)
    emission = found.emissions[0]
    edges = np.array([ramp_ms(k * BIN_MM) for k in range(11)])
    ramp = 40 * np.diff(edges) / BIN_MM
    assert emission.peak_per_mm == pytest.approx(ramp[0])
    for line, value in ((found.path.x1, emission.per_mm), (10 - found.path.x0[::-1], emission.per_mm[::-1])):
        own = line < 0.5 - 1e-9
        edge = np.rint(np.append(0.0, line[own]) / BIN_MM).astype(int)
        means = [ramp[first:last].mean() for first, last in pairwise(edge)]
        assert value[own] == pytest.approx(means)
        assert 4 <= own.sum() <= 10, "cut where it changes"
    between = (found.path.x0 > 0.5) & (found.path.x1 < 9.5 + 1e-6)
    assert emission.per_mm[between] == pytest.approx(400) and between.sum() <= 2
    coarse = strokes(DUTY + "LASER POWER 40\nLASER ON\nLINE X 10\nLASER OFF\n", fine_strokes=1, energy=True)
    assert coarse.emissions[0].per_mm == pytest.approx([40 * 110 / 10]), "else the mean"
    assert coarse.emissions[0].peak_per_mm == pytest.approx(ramp[0])


def test_energy_per_mm_of_a_mark_that_does_not_move() -> None:
    found = strokes(DUTY + "LASER POWER 40\nLASER ON\nDWELL 5\nLASER OFF\nJUMP X 5\n", energy=True)
    assert np.isnan(found.emissions[0].per_mm).all() and np.isnan(found.emissions[0].peak_per_mm).all()


def test_cut_where_emission_begins_and_ends() -> None:
    """An on delay of 25 ms: 0.5 mm + 15 ms * 100 mm/s = 2 mm; off 20 ms behind the line's end, at rest, in a dwell."""
    text = DUTY + "LASER DELAY ON 25000 OFF 45000\nLASER POWER 10\nLASER ON\nLINE X 10\nLASER OFF\nDWELL 60\nLINE X 0\n"
    found = strokes(text)
    emission = found.emissions[0]
    assert found.start_ms[emission.on][0] == pytest.approx(25)
    assert found.path.x0[emission.on][0] == pytest.approx(2)
    dwell = found.row == 1
    assert found.duration_ms[dwell] == pytest.approx([45, 15])
    assert emission.on[dwell].tolist() == [True, False]
    assert emission.power[dwell] == pytest.approx([10, 0])
    # The dwell is at the end of the last bin.
    fine = strokes(text, energy=True)
    assert fine.emissions[0].per_mm[fine.row == 1][0] == pytest.approx(10 * (ramp_ms(BIN_MM) + 45) / BIN_MM)


def test_energy_per_mm_is_of_emission_only() -> None:
    found = strokes(DUTY + "LASER POWER 40\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n", energy=True)
    emission = found.emissions[0]
    assert {row: bool(emission.on[found.row == row].all()) for row in (0, 1)} == {0: False, 1: True}
    assert np.isnan(emission.per_mm[found.row == 0]).all()
    assert np.isfinite(emission.per_mm[found.row == 1]).all()


def test_following_is_cut_at_the_ticks() -> None:
    """Power is 0.4 * v at the last tick (v in pulse/ms), and v grows by 2.5 pulse/ms a tick."""
    found = strokes(DUTY + "LASER FOLLOW RATIO 0.4 MIN 0 MAX 100\nLASER ON\nLINE X 10\nLASER OFF\n")
    rise = found.start_ms < 10 - 1e-9
    assert found.duration_ms[rise] == pytest.approx(np.full(40, 0.25))
    assert found.emissions[0].power[rise] == pytest.approx(0.4 * np.arange(40) * 2.5)


def test_strokes_follow_one_another() -> None:
    found = strokes(DUTY + "LASER POWER 10\nLASER ON\nLINE X 4\nARC CCW I 0 J 3\nDWELL 2\nLASER OFF\nJUMP X 0 Y 0\n")
    for end, begin in ((found.path.x1, found.path.x0), (found.path.y1, found.path.y0)):
        assert end[:-1] == pytest.approx(begin[1:], abs=1e-9)
    assert (found.start_ms + found.duration_ms)[:-1] == pytest.approx(found.start_ms[1:])
    assert sorted(set(found.row.tolist())) == [0, 1, 2, 3]


@pytest.mark.parametrize(("most", "sagitta_mm"), [(300_000, 5 * (1 - np.cos(0.05))), (10, 5 * (1 - np.cos(0.3)))])
def test_chords_are_near_their_arc(most: int, sagitta_mm: float) -> None:
    """Cut in equal times: where it goes twice as fast as on the mean, chords are twice as long."""
    found = strokes(DUTY + "LASER POWER 10\nLASER ON\nARC CW I 5 J 0\nLASER OFF\n", fine_strokes=most)
    assert found.exact is (most > 10)
    middle = np.hypot((found.path.x0 + found.path.x1) / 2 - 5, (found.path.y0 + found.path.y1) / 2)
    assert (5 - middle).max() <= sagitta_mm
    assert found.path.length_mm.sum() == pytest.approx(2 * pi * 5, rel=0.01)


def test_a_long_run_keeps_segments_and_emission() -> None:
    """Cut coarsely: velocity is the highest of the segment, energy is still exact."""
    text = DUTY + "LASER FOLLOW RATIO 0.4 MIN 0 MAX 100\nLASER ON\nLINE X 10\nLASER OFF\nLINE Y 0.5\n"
    fine, coarse = strokes(text), strokes(text, fine_strokes=20)
    assert (fine.exact, coarse.exact) == (True, False)
    assert coarse.row.tolist() == [0, 1]
    assert coarse.vel0 == pytest.approx([100, 70.71067811865476])  # 0.5 mm are too short: v = sqrt(a * s).
    assert coarse.vel1 == pytest.approx(coarse.vel0)
    energy = [float((s.emissions[0].power * s.duration_ms).sum()) for s in (fine, coarse)]
    assert energy[0] == pytest.approx(energy[1])


def test_the_beam_is_late() -> None:
    """delay:5ms at 100 mm/s: 0.5 mm behind; the emission is there."""
    scanner = parse_scanner("delay:5ms")
    assert not isinstance(scanner, str)
    found = strokes(DUTY + "LASER POWER 10\nLASER ON\nLINE X 10\nLASER OFF\n", Machine(scanner=scanner))
    assert found.beam is not None
    assert found.actual is found.beam
    steady = (found.start_ms >= 15) & (found.start_ms + found.duration_ms <= 100)
    assert found.path.x1[steady] - found.beam.x1[steady] == pytest.approx(np.full(int(steady.sum()), 0.5))


def test_two_channels_with_units_and_watts() -> None:
    text = (
        DUTY + "LASER POWER 50\nLASER ON\nLINE X 10\nLASER OFF\nLASER MODE ANALOG CHANNEL 1\n"
        "LASER POWER 5 CHANNEL 1\nLASER ON CHANNEL 1\nLINE X 0\nLASER OFF CHANNEL 1\n"
        "LASER MODE ANALOG\nLASER POWER 2\nLASER ON\nLINE X 10\nLASER OFF\n"
    )
    found = strokes(text, Machine(lasers=(Laser(channel=0, rated_w=30.0),)))
    first, second = found.emissions
    assert (first.channel, first.units, second.channel, second.units) == (0, ("%", "V"), 1, ("%", "V"))
    assert [first.on[found.row == row].all() for row in range(3)] == [True, False, True]
    assert [second.on[found.row == row].all() for row in range(3)] == [False, True, False]
    assert [first.units[u] for u in first.unit[first.on]] == ["%"] * 3 + ["V"] * 3
    # 30 W at 100 %: 0.3 W a percent; 3 W a volt.
    assert first.joules_per_unit_ms[first.on] == pytest.approx([3e-4] * 3 + [3e-3] * 3)
    assert np.isnan(second.joules_per_unit_ms).all()


@pytest.mark.parametrize("text", ["LASER MODE DUTY CARRIER 10\n", "DWELL 5\n"])
def test_without_motion(text: str) -> None:
    found = strokes(text)
    assert len(found.row) == (1 if text.startswith("DWELL") else 0)
    assert found.path.length_mm.sum() == 0
