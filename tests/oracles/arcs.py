"""A plain reference of arcs: random ones as drawn, and the curves that calls draw, in complex numbers and Decimal.

A point is a complex number. An arc is drawn in a plane in which it is a circle: the mm of the machine, or the pulses of
its frame, where X and Y may have different pulses per mm; from there it is mapped to the machine's pulses. It shares no
code with the package.
"""

from __future__ import annotations

import cmath
import math
import re
from dataclasses import dataclass
from decimal import Decimal, localcontext
from itertools import pairwise
from random import Random

TURN = math.tau
ALL_SCALES = ((1000.0, 1000.0), (500.0, 500.0), (1000.0, 800.0), (655.36, 500.0), (400.0, 1000.0))


@dataclass(frozen=True)
class Piece:
    """A line (no centre), or an arc of a circle: from, to, and by how much it turns."""

    start: complex
    end: complex
    centre: complex | None = None
    sweep: float = 0.0

    @property
    def length(self) -> float:
        if self.centre is None:
            return abs(self.end - self.start)
        return abs(self.start - self.centre) * abs(self.sweep)

    def at(self, share: float) -> complex:
        if self.centre is None:
            return self.start + (self.end - self.start) * share
        return self.centre + (self.start - self.centre) * cmath.rect(1.0, self.sweep * share)

    def distance(self, point: complex) -> float:
        """Distance of a point from the piece."""
        ends = min(abs(point - self.start), abs(point - self.end))
        if self.centre is None:
            along = self.end - self.start
            if not along:
                return ends
            share = ((point - self.start) * along.conjugate()).real / abs(along) ** 2
            return abs(point - self.at(share)) if 0 <= share <= 1 else ends
        radius, arm = abs(self.start - self.centre), point - self.centre
        if not radius or not arm:
            return min(ends, abs(abs(arm) - radius))
        turned = cmath.phase(arm / (self.start - self.centre)) * math.copysign(1, self.sweep)
        return abs(abs(arm) - radius) if turned % TURN <= abs(self.sweep) else ends


def sweep_between(start: complex, end: complex, centre: complex, *, ccw: bool) -> float:
    """By how much an arc turns; a full circle if it ends where it starts."""
    if start == end:
        return TURN if ccw else -TURN
    turned = cmath.phase((end - centre) / (start - centre)) % TURN
    return turned if ccw else turned - TURN


def centre_of(start: complex, end: complex, radius: float, *, ccw: bool) -> complex:
    """The centre of an arc by radius: > 0 the short way, < 0 the long way round."""
    half = abs(end - start) / 2
    height = math.sqrt(max(radius * radius - half * half, 0.0))
    side = 1 if ccw == (radius > 0) else -1
    return (start + end) / 2 + side * height * 1j * (end - start) / abs(end - start)


CALL = re.compile(r"(GT_LnXY|GT_ArcXYC|GT_ArcXYR)\(1,(.*)\)")


def pieces_of(calls: list[str]) -> list[Piece]:
    """The curves that calls draw, from 0, 0."""
    here, found = 0j, list[Piece]()
    for call in calls:
        match = CALL.fullmatch(call)
        assert match is not None, call
        numbers = [float(n) for n in match[2].split(",")]
        to = complex(numbers[0], numbers[1])
        if match[1] == "GT_LnXY":
            found.append(Piece(here, to))
        elif match[1] == "GT_ArcXYC":
            centre = here + complex(numbers[2], numbers[3])
            found.append(Piece(here, to, centre, sweep_between(here, to, centre, ccw=numbers[4] == 1)))
        else:
            centre = centre_of(here, to, numbers[2], ccw=numbers[3] == 1)
            found.append(Piece(here, to, centre, sweep_between(here, to, centre, ccw=numbers[3] == 1)))
        here = to
    return found


def top(radius: Decimal, chord_squared: Decimal) -> Decimal:
    """Height of an arc by radius over its chord, to 60 digits."""
    with localcontext() as context:
        context.prec = 60
        rest = max(radius * radius - chord_squared / 4, Decimal(0)).sqrt()
        return abs(radius) - rest if radius > 0 else abs(radius) + rest


@dataclass(frozen=True)
class DrawnArc:
    """A job of a LINE and an ARC, and the curve that the ARC is on the machine, in pulses: `curve` in its own plane."""

    text: str
    pulses_per_mm: tuple[float, float]
    curve: Piece
    turn: complex
    shift: complex
    in_pulses: bool

    def machine(self, point: complex) -> complex:
        """Map a point of the arc's plane to the machine's pulses: scale and rotate in mm, then shift."""
        px, py = self.pulses_per_mm
        mm = complex(point.real / px, point.imag / py) if self.in_pulses else point
        mm = mm * self.turn + self.shift
        return complex(mm.real * px, mm.imag * py)

    def points(self, count: int) -> list[complex]:
        return [self.machine(self.curve.at(k / count)) for k in range(count + 1)]

    def length_pulse(self, count: int = 720) -> float:
        found = self.points(count)
        return sum(abs(b - a) for a, b in pairwise(found))


def random_arc(rng: Random) -> DrawnArc:
    """An arc of any size and turn, in mm or in pulses, by centre or by radius, in a frame or not."""
    scales = rng.choice(ALL_SCALES)
    in_pulses = rng.random() < 0.5
    unit = 1000.0 if in_pulses else 1.0
    radius = unit * 10 ** rng.uniform(-3.5, 2)
    kind = rng.randrange(7)
    # Ends that are farther apart than what may be noise: see the cases by hand.
    near = min(max(10 ** rng.uniform(-9, -1), 1e-5 * unit / radius), 0.5)
    sweep = (TURN, TURN - near, near, math.pi + near, math.pi - near, math.pi, rng.uniform(0.01, TURN))[kind]
    ccw = rng.random() < 0.5
    start = unit * complex(round(rng.uniform(-9, 9), 3), round(rng.uniform(-9, 9), rng.choice((0, 3, 7))))
    centre = start + cmath.rect(radius, rng.uniform(0, TURN))
    curve = Piece(start, start, centre, sweep if ccw else -sweep)
    end = start if kind == 0 else curve.at(1.0)
    if in_pulses and radius > 3 and rng.random() < 0.5:  # Whole pulses of a circle: often what a program writes.
        start, centre = complex(round(start.real), round(start.imag)), complex(round(centre.real), round(centre.imag))
        curve = Piece(start, start, centre, curve.sweep)
        end = start if kind == 0 else curve.at(1.0)
    way = f"ARC {'CCW' if ccw else 'CW'}"
    noise = complex(rng.choice((0.0, 1e-7, -1e-7)), rng.choice((0.0, 1e-7, 1e-12))) * unit
    if kind == 0 or rng.random() < 0.5:
        to = "" if kind == 0 and rng.random() < 0.5 else _words("XY", end + (noise if kind == 0 else 0))
        arc = f"{way} {to} {_words('IJ', centre - start)}"
    else:
        radius = math.copysign(abs(start - centre), 1 if sweep <= math.pi else -1)
        arc = f"{way} {_words('XY', end)} R {radius!r}"
    turn, shift, frame = 1 + 0j, 0j, ""
    if rng.random() < 0.4:
        degrees, scale = rng.choice((0.0, 30.0, 90.0, 180.0, -123.4)), rng.choice((1.0, 0.5, 1.25))
        shift = complex(rng.choice((0.0, 1.3333)), rng.choice((0.0, -2.5)))
        turn = cmath.rect(scale, math.radians(degrees))
        moved = f"SHIFT X {shift.real!r}mm Y {shift.imag!r}mm"
        frame = f"FRAME {moved} ROTATE {degrees!r} SCALE {scale!r}\n"
    body = f"LINE {_words('XY', start)}\n{arc}\n"
    head = "UNITS PULSE\nVEL 50\nACC 5\n" if in_pulses else "VEL 50\nACC 5000\n"
    text = head + frame + body + ("END\n" if frame else "")
    return DrawnArc(text, scales, curve, turn, shift, in_pulses)


def _words(names: str, value: complex) -> str:
    return f"{names[0]} {value.real!r} {names[1]} {value.imag!r}"
