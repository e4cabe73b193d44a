"""Corners that come from the digits of a text: found where rounding makes them, and nowhere else."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from itertools import accumulate
from random import Random

import pytest
from support.tools import MACHINE, job_of, run_job

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import Diagnostic
from gusjob.lint import check

Point = tuple[float, float]


def job(points: Iterable[Point], *, digits: int = 3, speed: float = 300, head: str = "") -> str:
    """A mark through points, in mm."""
    (x, y), *rest = points
    lines = [f"LINE X {x:.{digits}f} Y {y:.{digits}f}" for x, y in rest]
    start = ["LASER MODE DUTY CARRIER 10", "LASER POWER 50", f"VEL {speed}", "ACC 1000000", head]
    return "\n".join([*start, f"JUMP X {x:.{digits}f} Y {y:.{digits}f}", "LASER ON", *lines, "LASER OFF", ""])


def found(text: str, machine: Machine = MACHINE) -> list[Diagnostic]:
    return [d for d in check(job_of(text, machine), machine) if d.rule.code == "GJ521"]


def curve(chord_mm: float, count: int = 3000) -> list[Point]:
    """Chords of a curve that never repeats, of 20 mm radius."""
    angles = [chord_mm / 20 * k for k in range(count)]
    return [((20 + 0.1 * a) * math.cos(a), (20 + 0.1 * a) * math.sin(a)) for a in angles]


def mean_speed(text: str) -> float:
    """Of the mark, after its first tenth, mm/s."""
    report = run_job(text)
    length, time = report.column("length_mm"), report.column("duration_ms")
    first = len(length) // 10
    return sum(length[first:]) / sum(time[first:]) * 1000


@pytest.mark.parametrize(("chord_mm", "digits"), [(0.005, 3), (0.01, 3), (0.02, 3), (0.05, 2), (0.1, 2), (0.004, 4)])
def test_what_digits_cost(chord_mm: float, digits: int) -> None:
    """The velocity is that of the run; more digits, or longer lines, as the message says, are fast."""
    text = job(curve(chord_mm), digits=digits)
    (note,) = found(text)
    assert note.fields["step"] == f"{10**-digits:.{digits}f}"
    assert note.fields["velocity"] == 300
    assert note.fields["value"] == pytest.approx(mean_speed(text), rel=0.15)
    finer = job(curve(chord_mm), digits=len(note.fields["finer"]) - 2)
    longer = job(curve(note.fields["least"], 500), digits=digits)
    for better in (finer, longer):
        assert found(better) == []
    assert mean_speed(finer) > 0.9 * 300


def test_one_note_for_a_long_job() -> None:
    """Stretches of it are looked at."""
    assert len(found(job(curve(0.01, 60_000)))) == 1
    assert found(job(curve(0.01, 60_000), digits=6)) == []


def test_beside_lines_with_more_digits() -> None:
    fine = job(curve(0.01), digits=6).split("LASER ON")[1]
    (note,) = found(job(curve(0.01)) + "JUMP X 20\nLASER ON" + fine)
    assert note.fields["step"] == "0.001"


@pytest.mark.parametrize("pulses_per_mm", [(1000.0, 1000.0), (1000.0, 800.0)])
def test_whole_pulses(pulses_per_mm: tuple[float, float]) -> None:
    machine = Machine(pulses_per_mm=pulses_per_mm)
    head = "UNITS PULSE\nVEL 300\nACC 700"
    points = [(x * 1000, y * 800) for x, y in curve(0.01)]
    (note,) = found(job(points, digits=0, head=head), machine)
    assert (note.fields["step"], note.fields["length"], note.fields["speed"]) == ("1", "pulse", "pulse/ms")
    assert found(job(points, digits=3, head=head), machine) == []


def polar(count: int, radius: Callable[[int], float]) -> list[Point]:
    return [(radius(k) * math.cos(math.tau * k / count), radius(k) * math.sin(math.tau * k / count))
            for k in range(count + 1)]  # fmt: skip


def walk(steps: Iterable[Point]) -> list[Point]:
    return list(accumulate(steps, lambda at, step: (at[0] + step[0], at[1] + step[1]), initial=(0.0, 0.0)))


def wandering(length_mm: float, bend: float) -> list[Point]:
    """Lines that turn by chance."""
    rng = Random(1)
    courses = accumulate(rng.gauss(0, bend) for _ in range(3000))
    return walk((length_mm * math.cos(a), length_mm * math.sin(a)) for a in courses)


SIDES = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
TRUE_CORNERS = {
    "a star": polar(2000, lambda k: 5 + 0.1 * (k % 2)),
    "a zigzag of a step": [(k * 0.01, 0.001 * (k % 2)) for k in range(2000)],
    "a zigzag of two": [(k * 0.02, 0.002 * (k // 2 % 2)) for k in range(2000)],
    "stairs of a step": walk([(0.001, 0.0), (0.0, 0.001)] * 1000),
    "stairs of five": walk([(0.005, 0.0), (0.0, 0.005)] * 1000),
    "stairs of fifty": walk([(0.05, 0.0), (0.0, 0.05)] * 1000),
    "by chance": wandering(0.02, 2.0),
    "by chance, flat": wandering(0.02, 0.1),
    "the outline of an image": walk((0.02 * x, 0.02 * y) for x, y in Random(1).choices(SIDES, k=999)),
    "small octagons": [(i * 0.2 + 0.05 * x, 0.05 * y) for i in range(100) for x, y in polar(8, lambda _: 1.0)],
    "a hatch": [(5.0 * ((k + 1) // 2 % 2), k // 2 * 0.05) for k in range(2000)],
    "a hatch of chords": [((j if k % 2 else 100 - j) * 0.01, k * 0.05) for k in range(30) for j in range(101)],
    "a polygon of 100 sides": polar(100, lambda _: 1.0),
    "a straight line": [(k * 0.01, k * 0.01) for k in range(2000)],
    "measured points": [(k * 0.02, Random(k).gauss(0, 0.001)) for k in range(2000)],
}  # fmt: skip


@pytest.mark.parametrize("name", TRUE_CORNERS)
@pytest.mark.parametrize("digits", [2, 3, 4])
@pytest.mark.parametrize("speed", [300, 1000])
def test_true_corners_are_none_of_digits(name: str, digits: int, speed: float) -> None:
    assert found(job(TRUE_CORNERS[name], digits=digits, speed=speed)) == []


@pytest.mark.parametrize("head", ["LOOKAHEAD OFF", "LOOKAHEAD TIME 100ms"])
def test_where_such_corners_do_not_slow(head: str) -> None:
    """At rest at each end, or through corners of any size."""
    assert found(job(curve(0.01), head=head)) == []


def test_where_it_matters_little() -> None:
    """A tenth of the length."""
    lines = [(x + 40.0, 2.0 * k) for k in range(60) for x in (0.0, 5.0)]
    assert found(job([*curve(0.01), *lines])) == []
