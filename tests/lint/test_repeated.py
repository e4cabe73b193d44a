"""Marks that are made twice, in part or from elsewhere: closed forms, and random lines against exact fractions."""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations
from random import Random

import pytest
from support.tools import MACHINE, MARK, diagnostics_in, job_of

from gusjob.diagnostics.model import Collector
from gusjob.lint import repeated
from gusjob.lint.context import lint_context
from gusjob.lint.reporter import Reporter

HEAD = MARK + "LASER POWER 30\n"
ON, OFF = "LASER ON\n", "LASER OFF\n"
CIRCLE = f"{ON}ARC CW I 5 J 0\n{OFF}"
"""About (5, 0), from (0, 0)."""


def twice(path: str, head: str = HEAD) -> list[int]:
    """Lines of the path, from 1, that are reported."""
    first = len(head.splitlines())
    return [line - first for line, code in diagnostics_in(head + path) if code == "GJ407"]


def lengths(path: str) -> list[float]:
    job = job_of(HEAD + path)
    context = lint_context(job, MACHINE)
    report = Reporter(context, Collector(job.name))
    repeated.marked_twice(context, report)
    return [f.fields["length"] for f in report.collector.found]


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        (f"{ON}ARC CW X 10 Y 0 R 7\nARC CCW X 0 Y 0 R 7\n{OFF}", [3]),  # Burnt back.
        (f"{ON}ARC CW X 10 Y 0 R -7\nARC CCW X 0 Y 0 R -7\n{OFF}", [3]),
        (f"{ON}ARC CW X 10 Y 0 R 7\nARC CW X 0 Y 0 R 7\n{OFF}", []),  # A lens: the other side.
        (f"{ON}ARC CW X 10 Y 0 R 7\n{OFF}JUMP X 0 Y 0\n{ON}ARC CW X 10 Y 0 R -7\n{OFF}", []),
        (CIRCLE + CIRCLE.replace("CW", "CCW"), [5]),  # In the other direction.
        (f"{CIRCLE}JUMP X 5 Y 5\n{ON}ARC CW I 0 J -5\n{OFF}", [6]),  # From another start point.
        (f"{CIRCLE}JUMP X 5 Y 5\n{ON}ARC CCW I 0 J -5\n{OFF}", [6]),
        (f"{CIRCLE}JUMP X 5 Y 5\n{ON}ARC CW X 10 Y 0 I 0 J -5\n{OFF}", [6]),  # A quarter of it.
        (f"{CIRCLE}JUMP X 1 Y 0\n{ON}ARC CW I 4 J 0\n{OFF}", []),  # A smaller one.
        (f"{CIRCLE}JUMP X 0.02 Y 0\n{ON}ARC CW I 5 J 0\n{OFF}", []),  # Beside it.
        (f"{ON}LINE X 10 Y 5\n{OFF}JUMP X 4 Y 2\n{ON}LINE X 20 Y 10\n{OFF}", [6]),
        (f"{ON}LINE X 10 Y 5\n{OFF}JUMP X 4 Y 2\n{ON}LINE X 2 Y 1\n{OFF}", [6]),  # Inside it.
        (f"{ON}LINE X 10 Y 5\n{OFF}JUMP X 12 Y 6\n{ON}LINE X 20 Y 10\n{OFF}", []),  # Behind it.
        (f"{ON}LINE X 10\nLINE X 4\n{OFF}", [3]),
        (f"{ON}LINE X 10\n{OFF}JUMP X 9.9\n{ON}LINE X 20\n{OFF}", []),  # 0.1 mm joins marks.
        (f"{ON}LINE X 10\n{OFF}JUMP X 9.89\n{ON}LINE X 20\n{OFF}", [6]),
        (f"{ON}LINE X 10\n{OFF}LASER POWER 40\nJUMP X 4\n{ON}LINE X 20\n{OFF}", []),  # With another power.
        (f"{ON}LINE X 10\n{OFF}VEL 50\nJUMP X 4\n{ON}LINE X 20\n{OFF}", []),
        (f"{ON}LINE X 10\n{OFF}JUMP X 5 Y -5\n{ON}LINE Y 5\n{OFF}", []),  # A cross.
        (f"{ON}LINE X 1\nLINE X 2\nLINE X 3\nLINE Y 1\nLINE X 2\nLINE Y 0\n{OFF}", []),  # Shared end points.
        # Steps of 0.05 mm under a line of 10 mm: each overlap is short, that of all of them is not.
        (f"{ON}FOR x FROM 0.05 TO 2 STEP 0.05\nLINE X (x)\nEND\n{OFF}JUMP X 10\n{ON}LINE X 1\n{OFF}", [8]),
        (f"FRAME ROTATE 33\n{ON}LINE X 10\n{OFF}JUMP X 14\n{ON}LINE X 6\n{OFF}END\n", [7]),
        (f"REPEAT 3\nJUMP X 0\n{ON}LINE X 10\n{OFF}END\n", []),  # Passes.
        (f"FOR x FROM 0 TO 3 STEP 1\nJUMP X (x)\n{ON}LINE X (x+2)\n{OFF}END\n", []),  # Of one statement.
        # The end of a contour goes on over its begin, so that it closes; from elsewhere it would not.
        (f"{ON}LINE X 10\nLINE Y 10\nLINE X 0\nLINE Y 0\nLINE X 1\n{OFF}", []),
        (f"{CIRCLE.replace(OFF, '')}ARC CW X 5 Y 5 I 5 J 0\n{OFF}", []),
        (f"{ON}LINE X 10\nLINE Y 10\nLINE X 0\nLINE Y 0\n{OFF}{ON}LINE X 1\n{OFF}", [8]),
    ],
)
def test_what_is_marked_twice(path: str, expected: list[int]) -> None:
    assert twice(path) == expected


def test_the_length_of_an_overlap() -> None:
    source = f"{ON}LINE X 8 Y 6\n{OFF}JUMP X 4 Y 3\n{ON}LINE X 12 Y 9\n{OFF}"
    assert lengths(source) == [5.0]  # From (4, 3) to (8, 6).
    assert lengths(f"{CIRCLE}JUMP X 5 Y 5\n{ON}ARC CW I 0 J -5\n{OFF}") == [31.416]  # 10 pi.
    assert lengths(f"{CIRCLE}JUMP X 5 Y 5\n{ON}ARC CW X 10 Y 0 I 0 J -5\n{OFF}") == [7.854]


Line = tuple[int, int, int, int]


def overlap(one: Line, other: Line) -> Fraction:
    """Square of the length that two lines between whole points share."""
    (ax, ay, bx, by), (cx, cy, dx, dy) = one, other
    ux, uy = bx - ax, by - ay
    if ux * (cy - ay) != uy * (cx - ax) or ux * (dy - ay) != uy * (dx - ax):
        return Fraction(0)
    size = ux * ux + uy * uy
    shares = sorted(Fraction((x - ax) * ux + (y - ay) * uy, size) for x, y in ((cx, cy), (dx, dy)))
    part = min(Fraction(1), shares[1]) - max(Fraction(0), shares[0])
    return max(part, Fraction(0)) ** 2 * size


def test_random_lines_overlap_where_fractions_say_so() -> None:
    rng, pairs = Random(3), 0
    for _ in range(80):
        lines: list[Line] = []
        while len(lines) < 8:
            a, b = (rng.randrange(5), rng.randrange(5)), (rng.randrange(5), rng.randrange(5))
            if a != b:
                lines.append((*a, *b))
        path = "".join(f"JUMP X {ax} Y {ay}\n{ON}LINE X {bx} Y {by}\n{OFF}" for ax, ay, bx, by in lines)
        found = {(line - 3) // 4 for line in twice(path)}
        shared = {later for (_, one), (later, other) in combinations(enumerate(lines), 2) if overlap(one, other)}
        assert found <= shared
        # Of several on one part not each pair is found, but one is.
        assert bool(found) == bool(shared)
        pairs += len(shared)
    assert pairs > 15


def test_marks_without_a_velocity() -> None:
    assert {code for _, code in diagnostics_in(f"LASER MODE DUTY CARRIER 10\nLASER POWER 30\n{CIRCLE}")} >= {"GJ501"}
