"""Marks that are too short for their velocity, against the triangle: from rest to rest the peak is sqrt(a*L).

1000 pulse/mm: 400 mm/s is 400 pulse/ms, 20000 mm/s2 is 20 pulse/ms2. 400 mm/s take 400^2/20000 = 8 mm.
"""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from msgspec.structs import replace
from support.tools import MACHINE

from gusjob.config.machine import Machine
from gusjob.config.profile import Profile
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend import check_text
from gusjob.pipeline import Checked, Parsed, check, examine, parse_source

HEAD = "LASER MODE DUTY CARRIER 10\nLASER POWER 30\nVEL 400\nACC 20000\n"


def found(text: str, machine: Machine = MACHINE) -> list[Diagnostic]:
    """Everything that `check` finds about short marks."""
    source, _ = check_text((HEAD + text).encode(), "a.job")
    assert source is not None
    parsed = parse_source(source, path=Path("a.job"), profile=Profile(machine=machine))
    assert isinstance(parsed, Parsed)
    examined: Checked = examine(check(parsed))
    return [d for d in examined.diagnostics if d.rule.code == "GJ516"]


def mark(path: str) -> str:
    return f"LASER ON\n{path}\nLASER OFF\n"


def values(text: str, machine: Machine = MACHINE) -> list[tuple[int, float, float, float, float]]:
    """Line (after the head), velocity reached, velocity set, length, and length that would do."""
    names = ("value", "velocity", "actual", "least")
    return [(d.span.line - 4, *(d.fields[name] for name in names)) for d in found(text, machine)]


# Chords of 0.29 mm that turn by 0.0196 rad: the corners allow 5/0.0196 = 255 mm/s, and between them it is hardly more.
_CIRCLE = "\n".join(
    f"LINE X {15 * math.cos(t):.4f} Y {15 * math.sin(t):.4f}" for t in [math.tau / 320 * k for k in range(1, 321)]
)
_SMOOTH = "\n".join(f"LINE X {k / 10}" for k in range(1, 200))
_ALL = "LOOKAHEAD OFF\n"

SHORT = [
    ("a triangle", mark("LINE X 0.5"), [(2, math.sqrt(20000 * 0.5), 400, 0.5, 8)]),
    ("an arc", mark("ARC CCW X 1 R 0.5"), [(2, math.sqrt(20000 * math.pi / 2), 400, math.pi / 2, 8)]),
    ("89 %", mark("LINE X 6.4"), [(2, math.sqrt(20000 * 6.4), 400, 6.4, 8)]),
    ("90 %", mark("LINE X 6.5"), []),
    ("many short segments", mark("\n".join(f"LINE X {k / 10}" for k in range(1, 6))), [(2, 100, 400, 0.5, 8)]),
    ("a long smooth polyline", mark(_SMOOTH), []),
    # At each corner it stops: 0.1 mm.
    ("LOOKAHEAD OFF", _ALL + mark(_SMOOTH), [(3, math.sqrt(20000 * 0.1), 400, 0.1, 8)]),
    ("a long side is enough", mark("LINE X 8\nLINE Y 0.5\nLINE X 7.5"), []),
    ("corners that slow", "JUMP X 15\n" + mark(_CIRCLE), []),
    # A rest before and after, whatever the jump does: v0 = v1 = 0.
    ("a dwell in it", mark("LINE X 0.5\nDWELL 2\nLINE X 1"), [(2, 100, 400, 0.5, 8)]),
    # The first part ends at 100 mm/s, to which it accelerates in 0.25 mm: the second part starts and ends with it.
    (
        "a velocity of its own",
        mark("LINE X 5 VEL 100\nLINE X 5.5 VEL 400\nLINE X 10 VEL 100"),
        [(3, math.sqrt(100**2 + 20000 * 0.5), 400, 0.5, (400**2 - 100**2) / 20000)],
    ),
    # END 200 at its end: up to 200 take 1 mm.
    ("END", mark("LINE X 1 END 200\nLINE X 3 VEL 200 END 0"), [(2, 200, 400, 1, (400**2 - 200**2 / 2) / 20000)]),
    ("ACC in the job", mark("LINE X 0.5") + "ACC 400000\nJUMP X 0\n" + mark("LINE Y 0.5"), [(2, 100, 400, 0.5, 8)]),
    ("UNITS PULSE", "UNITS PULSE\n" + mark("LINE X 500"), [(3, 100, 400, 500, 8000)]),
    # The first speeds up to sqrt(2*a*0.5), the second slows down from there.
    (
        "two marks in a row",
        mark("LINE X 0.5") + mark("LINE X 1"),
        [(line, math.sqrt(20000), 400, 0.5, (400**2 - 20000 / 2) / 20000) for line in (2, 5)],
    ),
    ("the jumps", "LINE X 0.5\nJUMP Y 0.5\n" + mark("LINE Y 9"), []),
    ("follow", "LASER FOLLOW MIN 1 MAX 90 AT 400mm/s\n" + mark("LINE X 0.5"), []),
    (
        "follow, then not",
        "LASER FOLLOW MIN 1 MAX 90 AT 400mm/s\nLASER POWER 30\n" + mark("LINE X 0.5"),
        [(4, 100, 400, 0.5, 8)],
    ),
    ("a switch at rest", "LASER ON NOW\nLINE X 0.5\nLASER OFF NOW\n", [(2, 100, 400, 0.5, 8)]),
    ("mode 1", "SKYWRITE MODE 1 TIMELAG 100us\n" + mark("LINE X 0.5\nLINE Y 0.5"), []),
    ("mode 2", "SKYWRITE MODE 2 TIMELAG 100us\n" + mark("LINE X 0.5\nLINE Y 0.5"), []),
    ("mode 3", "SKYWRITE MODE 3 TIMELAG 100us\n" + mark("LINE X 0.5\nLINE Y 0.5"), []),
    # The run-ins bring the ends to 100 mm/s, but not the middle to 400.
    (
        "inside a sky-written mark",
        "SKYWRITE MODE 3 TIMELAG 100us\n" + mark("LINE X 5 VEL 100\nLINE X 5.5 VEL 400\nLINE X 10 VEL 100"),
        [(4, math.sqrt(100**2 + 20000 * 0.5), 400, 0.5, (400**2 - 100**2) / 20000)],
    ),
]  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), [s[1:] for s in SHORT], ids=[s[0] for s in SHORT])
def test_a_mark_reaches_what_its_length_allows(
    text: str, expected: list[tuple[int, float, float, float, float]]
) -> None:
    assert values(text) == [pytest.approx(row, rel=1e-3) for row in expected]


@pytest.mark.parametrize("text", [mark("LINE X 0.5"), mark("LINE X 1\nLINE Y 1\nLINE X 0"), SHORT[10][1]])
def test_what_the_message_says_would_do_does(text: str) -> None:
    (diagnostic,) = found(text)
    acc = float(diagnostic.fields["remedy"].fields["value"])
    assert found(text.replace("LASER ON", f"ACC {acc * 1.001}\nLASER ON")) == []
    assert found(text.replace("LASER ON", f"ACC {acc * 0.75}\nLASER ON")) != []


def test_an_acceleration_above_the_machines_is_not_proposed() -> None:
    (diagnostic,) = found(mark("LINE X 0.5"), replace(MACHINE, max_acceleration_mm_s2=300_000))
    assert "a lower velocity" in diagnostic.message
    (diagnostic,) = found(mark("LINE X 0.5"), replace(MACHINE, max_acceleration_mm_s2=320_000))
    assert "an acceleration of 320000 mm/s2" in diagnostic.message


@pytest.mark.parametrize("path", ["LINE X 0.5", "LINE Y 0.5", "LINE X 0.3 Y 0.4"])
def test_where_the_axes_differ_it_is_the_same_in_mm(path: str) -> None:
    machine = replace(MACHINE, pulses_per_mm=(1000.0, 500.0))
    assert values(mark(path), machine) == [pytest.approx((2, 100, 400, 0.5, 8), rel=1e-3)]


def test_a_loop_has_one_diagnostic_with_a_count() -> None:
    (diagnostic,) = found("REPEAT 5 AS i\nJUMP X 0 Y (i)\n" + mark("LINE X 0.5") + "END\n")
    assert diagnostic.count == 5


def test_both_lasers_on_one_path_have_one_diagnostic() -> None:
    head = "CHANNEL 1\nLASER MODE DUTY CARRIER 10\nLASER POWER 30\nCHANNEL 0\n"
    both = "LASER ON CHANNEL 0\nLASER ON CHANNEL 1\nLINE X 0.5\nLASER OFF CHANNEL 0\nLASER OFF CHANNEL 1\n"
    assert [d.count for d in found(head + both)] == [1]
    assert len(found(head + both + "JUMP X 0\nLASER ON CHANNEL 1\nLINE Y 0.5\nLASER OFF CHANNEL 1\n")) == 2
