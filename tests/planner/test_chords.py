"""Arcs that become chords: as fast as the arc, in the plan and in what the checks of its listing say."""

from __future__ import annotations

import math
from random import Random

import pytest
from msgspec.structs import replace
from support.tools import MACHINE, Ran, calls_of, run_job, run_listing, stream_of

from gusjob.config.machine import Machine

UNEQUAL = [(1000.0, 800.0), (800.0, 1000.0)]
FAR = (1000.0, 400.0)
"""Pulses change their velocity along a circle by so much that it takes a part of the acceleration."""
HEAD = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\n"


def circle(radius: float, speed: float, acc: float = 1e6, head: str = "") -> str:
    path = f"JUMP X {radius}\nLASER ON\nARC CCW I {-radius} J 0\nLASER OFF\n"
    return f"{HEAD}VEL {speed}\nACC {acc}\n{head}{path}"


def time_of_mark(ran: Ran) -> float:
    return sum(ran.column("duration_ms")[1:])


def listing_of(text: str, machine: Machine) -> Ran:
    return run_listing("\n".join(calls_of(text, machine)), machine)


@pytest.mark.parametrize(
    ("pulses_per_mm", "acc"), [(pulses, acc) for pulses in UNEQUAL for acc in (1e6, 2e5)] + [(FAR, 1e6)]
)
@pytest.mark.parametrize(
    ("radius", "speed"), [(0.5, 100), (0.5, 300), (2, 500), (5, 300), (5, 1000), (50, 100), (50, 1000), (50, 3000)]
)
@pytest.mark.parametrize("head", ["", "LOOKAHEAD OFF\n"])
def test_the_time_of_a_circle(
    pulses_per_mm: tuple[float, float], radius: float, speed: float, acc: float, head: str
) -> None:
    """From rest to rest: circumference / VEL + VEL / ACC. LOOKAHEAD OFF stops at ends of statements, not of chords."""
    machine = Machine(pulses_per_mm=pulses_per_mm)
    text = circle(radius, speed, acc, head)
    length = math.tau * radius
    assert speed**2 / acc < length
    time = time_of_mark(run_job(text, machine))
    assert time == pytest.approx((length / speed + speed / acc) * 1000, rel=0.01)
    assert listing_of(text, machine).codes() == []


@pytest.mark.parametrize(("tolerance_um", "height_um"), [(1.0, 0.1), (0.05, 0.05)])
def test_how_many_chords(tolerance_um: float, height_um: float) -> None:
    """A chord of the angle a is lower than its arc by r*(1 - cos(a/2)): by a tenth of a pulse, or the tolerance."""
    machine = Machine(pulses_per_mm=UNEQUAL[0], chord_tolerance_um=tolerance_um)
    count = run_job(circle(5, 300), machine).report.columns["line"].tolist().count(7)
    assert count == pytest.approx(math.pi / math.acos(1 - height_um / 5000), abs=1)


def test_tangents_of_chords() -> None:
    """A line, half a circle, a line: no corner where they meet, though the chords begin and end with one."""
    path = "LASER ON\nLINE X 5\nARC CCW X 5 Y 4 R 2\nLINE X 0\nLASER OFF\n"
    for pulses_per_mm in ((1000.0, 1000.0), *UNEQUAL):
        machine = Machine(pulses_per_mm=pulses_per_mm)
        text = f"{HEAD}VEL 1000\nACC 1000000\n{path}"
        time = sum(run_job(text, machine).column("duration_ms"))
        assert time == pytest.approx(10 + math.tau + 1, rel=2e-3)
        assert listing_of(text, machine).codes() == []


def test_true_corners_at_chords() -> None:
    """A right angle before and behind half a circle: the velocity vector changes by 5 pulse/ms."""
    text = f"{HEAD}VEL 1000\nACC 1000000\nLASER ON\nLINE Y -2\nARC CCW X 0 Y 2 R 2\nLINE Y 0\nLASER OFF\n"
    for pulses_per_mm in UNEQUAL:
        calls = stream_of(text, Machine(pulses_per_mm=pulses_per_mm)).buffered
        assert calls.vel_end[[2, -3]] == pytest.approx(5 / math.sqrt(2), rel=1e-6)  # Of the line, and the last chord.


@pytest.mark.parametrize("seed", range(20))
def test_listings_of_fast_circles(seed: int) -> None:
    """Rounding explains their corners, wherever they are and however fast."""
    rng = Random(seed)
    pulses_per_mm = rng.choice([*UNEQUAL, FAR, (500.0, 655.36)])
    machine = replace(
        MACHINE, pulses_per_mm=pulses_per_mm, field_x_mm=(-1e3, 1e3), field_y_mm=(-1e3, 1e3), max_velocity_mm_s=1e4
    )
    radius, turn = 10 ** rng.uniform(-1, 2), rng.uniform(0, math.tau)
    text = f"{HEAD}VEL {10 ** rng.uniform(2.5, 4):.1f}\nACC 1000000\nJUMP X {rng.uniform(-5, 5):.4f}\nLASER ON\n"
    text += f"ARC CW I {radius * math.cos(turn):.5f} J {radius * math.sin(turn):.5f}\nLASER OFF\n"
    assert "GJ707" not in listing_of(text, machine).codes()


@pytest.mark.parametrize("pulses_per_mm", UNEQUAL)
@pytest.mark.parametrize(("radius", "speed"), [(0.5, 2000), (5, 5000)])
def test_where_the_circle_itself_is_too_narrow(pulses_per_mm: tuple[float, float], radius: float, speed: float) -> None:
    """v^2/r counts in pulses: between the times for the finer and for the coarser axis, and no corner is faster."""
    machine = Machine(pulses_per_mm=pulses_per_mm)
    time = time_of_mark(run_job(circle(radius, speed), machine))
    slow, fast = (math.sqrt(1000 * radius / pulses) for pulses in (max(pulses_per_mm), min(pulses_per_mm)))
    ramps = slow / 1.0
    assert math.tau * radius / fast <= time - ramps <= math.tau * radius / slow * 1.01
    assert listing_of(circle(radius, speed), machine).codes() == []


@pytest.mark.parametrize("pulses_per_mm", [(1000.0, 1000.0), *UNEQUAL])
def test_a_circle_that_is_too_short_is_reported_once(pulses_per_mm: tuple[float, float]) -> None:
    """3.1 mm, where 400 mm/s take 8."""
    machine = Machine(pulses_per_mm=pulses_per_mm)
    text = circle(0.5, 400, acc=2e4)
    assert [c for c in listing_of(text, machine).codes() if c == "GJ516"] == ["GJ516"]


def test_chords_of_the_text_on_unequal_axes() -> None:
    """A part of the ramp is no mark of its own, though each chord has a velocity of its own in pulses."""
    angles = [math.tau * k / 500 for k in range(501)]
    lines = "".join(f"LINE X {5 * math.cos(a):.6f} Y {5 * math.sin(a):.6f}\n" for a in angles[1:])
    text = f"{HEAD}VEL 300\nACC 20000\nJUMP X 5\nLASER ON\n{lines}LASER OFF\n"
    for pulses_per_mm in UNEQUAL:
        assert listing_of(text, Machine(pulses_per_mm=pulses_per_mm)).codes() == []


def test_an_arc_that_no_call_keeps() -> None:
    """Its end rounds to the other side of its start: 84 mm of radius in chords, at full velocity."""
    arc = (
        "FRAME SHIFT X 1.3333mm Y 0.0mm SCALE 1.25\nLINE X -6.863 Y 1.0\nLASER ON\n"
        "ARC CW X -6.863046485813669 Y 0.9996712056545682 I 84.15310417852828 J -11.89795599522883\nLASER OFF\nEND\n"
    )
    machine = replace(MACHINE, field_x_mm=(-1e3, 1e3), field_y_mm=(-1e3, 1e3))
    text = f"{HEAD}VEL 1000\nACC 1000000\n{arc}"
    radius = 1.25 * math.hypot(84.15310417852828, 11.89795599522883)
    assert len(stream_of(text, machine).buffered) > 1000
    assert time_of_mark(run_job(text, machine)) == pytest.approx(math.tau * radius + 1, rel=1e-3)
