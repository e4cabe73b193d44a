"""Arcs at their ends and on unequal axes: what is sent is what was drawn, against the plain reference."""

from __future__ import annotations

import math
import os
from decimal import Decimal
from random import Random

import pytest
from oracles.arcs import TURN, DrawnArc, Piece, pieces_of, random_arc, sweep_between, top
from support.tools import MARK, calls_of, diagnostics_in, path_calls, run_job, run_listing

from gusjob.config.machine import Machine

SEEDS = int(os.environ.get("ARC_SEEDS", "400"))
"""Set it high to search for long."""
NEAR_PULSE = 4.0
"""Ends and centre round by 0.71 pulse each, a chord is within 1 um; on a circle this adds up."""
FIELD = (-1e5, 1e5)
MACHINE = Machine(field_x_mm=FIELD, field_y_mm=FIELD)
UNEQUAL = Machine(pulses_per_mm=(1000.0, 800.0))
PULSES = "UNITS PULSE\nVEL 10\nACC 1\n"
ALLOWED = {"GJ508", "GJ517"}


def machine_of(drawn: DrawnArc) -> Machine:
    return Machine(field_x_mm=FIELD, field_y_mm=FIELD, pulses_per_mm=drawn.pulses_per_mm)


def may_be_taken_for_a_circle(piece: Piece) -> bool:
    return piece.centre is not None and 0 < abs(piece.end - piece.start) <= 2 and abs(piece.sweep) <= math.pi


def check_sent(drawn: DrawnArc, calls: list[str]) -> None:
    """The curve that is sent lies on the one that was drawn, and is as long."""
    sent = pieces_of(calls)[1:]
    assert sent
    points = drawn.points(360)
    off = max(min(piece.distance(point) for piece in sent) for point in points)
    assert off <= NEAR_PULSE, (off, calls[:4])
    length, expected = sum(piece.length for piece in sent), drawn.length_pulse()
    assert abs(length - expected) <= 4 * NEAR_PULSE + expected * 1e-4, (length, expected, calls[:4])
    # Chords of an arc smaller than a pulse may be taken for anything; others go the same way round.
    assert not any(may_be_taken_for_a_circle(piece) for piece in sent), calls[:4]


@pytest.mark.parametrize("block", range(8))
def test_what_is_sent_is_what_was_drawn(block: int) -> None:
    for seed in range(block, SEEDS, 8):
        drawn = random_arc(Random(seed))
        machine = machine_of(drawn)
        codes = {code for _, code in diagnostics_in(drawn.text, machine)}
        if "GJ505" in codes and " R " in drawn.text and drawn.length_pulse() < 0.1:
            continue  # By radius, and an end that is the start.
        assert codes <= ALLOWED, (seed, codes, drawn.text)
        calls = path_calls(drawn.text, machine)
        try:
            check_sent(drawn, calls)
        except AssertionError as error:
            raise AssertionError(f"{seed}: {error}\n{drawn.text}{drawn.pulses_per_mm}") from error


@pytest.mark.parametrize("seed", range(0, SEEDS, 16))
def test_its_listing_has_no_impossible_arc(seed: int) -> None:
    drawn = random_arc(Random(seed))
    machine = machine_of(drawn)
    codes = {code for _, code in diagnostics_in(drawn.text, machine)}
    if codes <= ALLOWED:
        found = run_listing("\n".join(calls_of(drawn.text, machine)) + "\n", machine)
        assert {d.rule.code for d in found.diagnostics} & {"GJ714", "GJ504", "GJ709"} == set(), drawn.text


# By radius, over the whole range of radius, chord and turn.


def radii() -> list[tuple[float, float, float, int]]:
    """Pulses per mm, R, chord and direction: chords just below 2 R and far below, angles of all kinds."""
    rng, found = Random(7), []
    for pulses in (100.0, 500.0, 1000.0, 20000.0):
        for radius_mm in (0.003, 0.05, 1.0, 50.0, 140.0, 3000.0, 50000.0):
            for below_um in (0.0, 1e-6, 0.01, 0.3, 1.0, 2.0, 30.0, 1e3, 5e4):
                chord = min(2 * radius_mm - below_um / 1000, 190.0)
                if chord * pulses >= 4 and radius_mm * pulses < 1e9:
                    found += [(pulses, sign * radius_mm, chord, rng.randrange(360)) for sign in (1, -1)]
    return found


@pytest.mark.parametrize("pulses", [100.0, 500.0, 1000.0, 20000.0])
def test_a_radius_keeps_the_top(pulses: float) -> None:
    machine = Machine(pulses_per_mm=(pulses, pulses), field_x_mm=FIELD, field_y_mm=FIELD)
    by_radius = 0
    for scale, radius, chord, degrees in radii():
        if scale != pulses:
            continue
        x, y = chord * math.cos(math.radians(degrees)), chord * math.sin(math.radians(degrees))
        text = f"VEL 1\nACC 1\nARC CCW X {x!r} Y {y!r} R {radius!r}\n"
        assert {code for _, code in diagnostics_in(text, machine)} <= {"GJ508"}, text
        (call, *more) = path_calls(text, machine)
        size = max(abs(radius), math.hypot(x, y) / 2)
        exact = top(
            Decimal(math.copysign(size * pulses, radius)), (Decimal(x * pulses) ** 2 + Decimal(y * pulses) ** 2)
        )
        (piece, *_) = pieces_of([call])
        if call.startswith("GT_ArcXYR") and not more:
            by_radius += 1
            r = Decimal(call.split(",")[3])
            squared = Decimal(int(piece.end.real)) ** 2 + Decimal(int(piece.end.imag)) ** 2
            assert 4 * r * r >= squared, (text, call)
            assert (r > 0) == (radius > 0), (text, call)
            assert abs(top(r, squared) - exact) <= 1, (text, call, exact)
        elif call.startswith("GT_ArcXYC") and not more:
            assert piece.centre is not None
            height = abs(piece.start - piece.centre) * (1 - math.cos(piece.sweep / 2))
            assert abs(height - float(exact)) <= 3, (text, call, exact)
    assert by_radius > 20


def test_a_chord_a_little_below_two_radii_keeps_its_top() -> None:
    """500 pulse/mm: the chord of 49999.5 pulse rounds to 50000, twice the radius; the arc is lower by 112 pulses."""
    machine = Machine(pulses_per_mm=(500.0, 500.0))
    (call,) = path_calls("VEL 1\nACC 1\nARC CW X 99.999 R 50\n", machine)
    r = Decimal(call.split(",")[3])
    exact = 25000 - math.sqrt(25000**2 - (99.999 * 250) ** 2)
    assert float(top(r, Decimal(50000) ** 2)) == pytest.approx(exact, abs=1)


# Ends that are the start, or nearly so.


@pytest.mark.parametrize(
    "arc",
    [
        "LINE X 0.3\nARC CCW X (0.1+0.2) I 5",
        "ARC CW X 1e-7 Y -1e-7 I 5 J 1",
        "FRAME ROTATE 30 SHIFT X 0.1 SCALE 0.7\nLINE X 0.3 Y 0.7\nARC CCW X (0.1+0.2) Y (7*0.1) I 5 J 1\nEND",
        "COORDS REL\nLINE X 0.1\nLINE X 0.2\nCOORDS ABS\nARC CW X 0.3 Y 0 I 0 J 5",
    ],
)
def test_float_noise_at_the_end_is_a_full_circle(arc: str) -> None:
    calls = path_calls(MARK + arc + "\n")
    piece = pieces_of(calls)[-1]
    assert piece.end == piece.start
    assert abs(piece.sweep) == TURN
    assert piece.length > 1000 * TURN


def test_an_arc_by_radius_that_ends_at_its_start_but_for_noise_is_refused() -> None:
    assert diagnostics_in(MARK + "LINE X 0.3\nARC CW X (0.1+0.2) R 5\n") == [(5, "GJ505")]


@pytest.mark.parametrize("arc", ["Y 0.0004 I -5 J 0", "X 0.0003 Y 0.0004 R 5", "I 0.0004 J 0"])
def test_a_tiny_arc_stays_tiny_and_is_told(arc: str) -> None:
    text = MARK + f"VEL 0.1\nARC CCW {arc}\n"
    assert diagnostics_in(text) == [(5, "GJ517")]
    assert sum(piece.length for piece in pieces_of(path_calls(text))) == 0


def test_a_circle_of_some_pulses_is_not_told() -> None:
    assert diagnostics_in(MARK + "VEL 0.1\nARC CCW I 0.003 J 0\n") == []


# Unequal axes: a circle in the unit of its I J or R.


@pytest.mark.parametrize(
    ("arc", "call"),
    [
        ("X 1000 Y 1000 I 0 J 1000", "GT_ArcXYC(1,1000,1000,0,1000,1,10,1,0,0)"),
        ("X 0 Y 2000 R 1000", "GT_ArcXYR(1,0,2000,1000,1,10,1,0,0)"),
        ("X 1mm Y 1.25mm I 0 J 1000", "GT_ArcXYC(1,1000,1000,0,1000,1,10,1,0,0)"),
        ("X 1000 Y 1000 I 0mm J 1000", "GT_ArcXYC(1,1000,1000,0,1000,1,10,1,0,0)"),
    ],
)
def test_a_circle_in_pulses_is_sent_as_one(arc: str, call: str) -> None:
    assert diagnostics_in(PULSES + f"ARC CCW {arc}\n", UNEQUAL) == []
    assert path_calls(PULSES + f"ARC CCW {arc}\n", UNEQUAL) == [call]


@pytest.mark.parametrize("arc", ["X 1250 Y 1000 I 0 J 1000", "X 0 Y 2000 R 990", "X 0 Y 0 R 500", "X 5 Y 5 I 0 J 0"])
def test_a_circle_in_mm_is_none_in_pulses(arc: str) -> None:
    assert diagnostics_in(PULSES + f"ARC CCW {arc}\n", UNEQUAL) == [(4, "GJ505")]
    turned = "FRAME ROTATE 30\n" + f"ARC CCW {arc}\nEND\n"
    assert diagnostics_in(PULSES + turned, UNEQUAL) == [(5, "GJ505")]


def test_a_circle_in_mm_becomes_chords() -> None:
    calls = path_calls(PULSES + "ARC CCW X 1mm Y 1mm I 0mm J 1mm\n", UNEQUAL)
    assert len(calls) > 10
    for piece in pieces_of(calls):
        assert abs(abs(complex(piece.end.real / 1000, piece.end.imag / 800 - 1)) - 1) < 0.0008


@pytest.mark.parametrize("units", ["I 1mm J 500", "I 500 J 1mm", "I 500pulse J 1mm"])
def test_a_centre_in_two_units_is_refused(units: str) -> None:
    assert diagnostics_in(PULSES + f"ARC CCW {units}\n", UNEQUAL) == [(4, "GJ518")]
    assert diagnostics_in(PULSES + f"ARC CCW {units}\n") == []


def test_the_field_of_a_circle_in_pulses() -> None:
    """Its top is 3000 pulses of Y up: 3.75 mm; in X it reaches 1.5 mm."""
    text = PULSES + "ARC CCW I 0 J 1500\n"
    for field, codes in (((-1.0, 3.76), []), ((-1.0, 3.74), [(4, "GJ503")])):
        assert diagnostics_in(text, Machine(pulses_per_mm=(1000.0, 800.0), field_y_mm=field)) == codes
    for field, codes in (((-1.51, 1.51), []), ((-1.49, 1.51), [(4, "GJ503")])):
        assert diagnostics_in(text, Machine(pulses_per_mm=(1000.0, 800.0), field_x_mm=field)) == codes


@pytest.mark.parametrize("arc", ["ARC CW I -38938 J 9156", "ARC CW X -38938 Y 9156 R 80000"])
@pytest.mark.parametrize("scales", [(655.36, 500.0), (500.0, 655.36)])
def test_a_velocity_in_mm_is_nowhere_exceeded_on_a_circle_in_pulses(arc: str, scales: tuple[float, float]) -> None:
    """Along the axis with fewer pulses per mm it is as written: 500 pulse/mm * 9999 mm/s."""
    machine = Machine(pulses_per_mm=scales, field_x_mm=FIELD, field_y_mm=FIELD)
    text = f"UNITS PULSE\nVEL 9999mm/s\nACC 0.04\n{arc}\n"
    assert diagnostics_in(text, machine) == []
    (call,) = path_calls(text, machine)
    assert float(call.split(",")[6 if "XYC" in call else 5]) == pytest.approx(4999.5)
    found = run_listing("\n".join(calls_of(text, machine)) + "\n", machine)
    assert "GJ504" not in {d.rule.code for d in found.diagnostics}


# Listings.

LISTING = """GT_SetCrdPrm(1,{{2,{{1,2,0,0,0,0,0,0}},500,10,0,1,{{0,0,0,0,0,0,0,0}}}})
GT_CrdClear(1,0)
{calls}
GT_CrdStart(1,0)
"""


@pytest.mark.parametrize(
    ("call", "length", "told"),
    [
        ("GT_ArcXYC(1,0,0,5000,0,1,50,2,0,0)", TURN * 5000, False),
        ("GT_ArcXYC(1,0,-1,5000,0,1,50,2,0,0)", 1, True),
        ("GT_ArcXYC(1,0,1,5000,0,1,50,2,0,0)", TURN * 5000 - 1, False),
        ("GT_ArcXYC(1,1,0,5000,0,1,50,2,0,0)", 0, True),
        ("GT_ArcXYC(1,0,0,1e-12,0,1,50,2,0,0)", 0, True),
        ("GT_ArcXYR(1,0,0,5000,1,50,2,0,0)", 0, True),
        ("GT_ArcXYR(1,10000,0,4999.9,1,50,2,0,0)", math.pi * 5000, True),
        ("GT_ArcXYR(1,10000,0,5000,1,50,2,0,0)", math.pi * 5000, False),
        ("GT_ArcXYR(1,10000,0,-5000,1,50,2,0,0)", math.pi * 5000, False),
    ],
)
def test_degenerate_arcs_of_listings_are_told(call: str, length: float, told: bool) -> None:
    found = run_listing(LISTING.format(calls=call))
    assert found.column("length_mm") == pytest.approx([length / 1000], abs=2e-6)
    assert ("GJ714" in found.codes()) == told


def test_a_full_circle_is_run_as_one() -> None:
    assert run_job(MARK + "ARC CCW X 1e-7 I 5\n").column("length_mm") == [pytest.approx(10 * math.pi)]


def test_the_reference_of_sweeps() -> None:
    """The reference itself, by hand."""
    assert sweep_between(1 + 0j, 1j, 0j, ccw=True) == pytest.approx(math.pi / 2)
    assert sweep_between(1 + 0j, 1j, 0j, ccw=False) == pytest.approx(-1.5 * math.pi)
    assert sweep_between(1 + 0j, 1 + 0j, 0j, ccw=False) == -TURN


@pytest.mark.parametrize("radius_mm", [99999, 1e5, 3e5])
def test_an_arc_without_a_height_makes_no_warning(radius_mm: float) -> None:
    """The radius of its top is infinite: no arc is made of it."""
    text = f"LINE X 6.848181438 Y 29.226777306\nARC CW X 6.849181438 Y 29.227777306 R {radius_mm}\n"
    assert path_calls(MARK + text)[-1].startswith("GT_LnXY(1,6849,29228,")
