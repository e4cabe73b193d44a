"""Loops, names, routines and frames: calls and positions worked out by hand."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from msgspec.structs import replace
from support.tools import MACHINE, MARK, calls_of, diagnostics_in, path_calls

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend import check_text, read_job, read_source
from gusjob.lint import check

UNEQUAL = Machine(pulses_per_mm=(1000.0, 500.0))
Points = list[tuple[int, int]]


def ends(text: str, machine: Machine = MACHINE) -> Points:
    """Where each motion ends, pulse."""
    calls = path_calls(MARK + text, machine)
    return [(int(x), int(y)) for x, y in (c.split(",")[1:3] for c in calls if not c.startswith("GT_BufDelay"))]


def xs(text: str) -> list[int]:
    """The same, X alone."""
    return [x for x, _ in ends(text)]


def diagnostics(text: str, machine: Machine = MACHINE) -> list[Diagnostic]:
    """Everything that reading and checking find."""
    source, _ = check_text((MARK + text).encode(), "test.job")
    assert source is not None
    job, found = read_job(source, machine)
    return [*found, *check(job, machine)]


def codes(text: str, machine: Machine = MACHINE) -> list[tuple[int, str]]:
    """Line (1 is the first after the head) and code of each diagnostic."""
    return [(f.span.line - MARK.count("\n"), f.rule.code) for f in diagnostics(text, machine)]


# Expressions.


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1+2*3", 7),
        ("(1+2)*3", 9),
        ("10-4-3", 3),
        ("64/4/2", 8),
        ("2**3**2/64", 8),
        ("-2**2", -4),
        ("2**-1", 0.5),
        ("-2*-3", 6),
        ("2 - -3", 5),
        ("7 % 3", 1),
        ("-7 % 3", 2),
        ("7 % -3", -2),
        ("7.5%2", 1.5),
        ("round(0.5)", 0),
        ("round(1.5)", 2),
        ("round(2.5)", 2),
        ("floor(-1.5)", -2),
        ("ceil(-1.5)", -1),
        ("abs(-3)", 3),
        ("min(3)", 3),
        ("max(3, 5, 4)", 5),
        ("min(3, 5, max(1, 2))", 2),
        ("sqrt(16)", 4),
        ("hypot(3, 4)", 5),
        ("cos(90)", 0),
        ("1e15*sin(180)", 0),
        ("1e15*cos(-270)", 0),
        ("sin(-90)", -1),
        ("1e15*tan(360)", 0),
        ("sin(30)", 0.5),
        ("sin(30deg)", 0.5),
        ("atan2(1, -1)", 135),
        ("1000*pi/1000", 3.142),
        ("1e1 + .5 + 5.", 15.5),
        ("2000um + 1mm", 3),
        ("500pulse*2", 1),
        ("6 / 2mm * 0 + 1", None),
        ("6mm / 2", 3),
        ("(6mm) / (2mm)", 3),
        ("6mm/2mm", 3),
        ("1/0", None),
        ("0*(1/0)", None),
        ("min(1/0, 3)", None),
        ("5/(1/0)", None),
        ("sqrt(-1)", None),
        ("(-8)**0.5", None),
        ("0**-1", None),
        ("5 % 0", None),
        ("10**400", None),
        ("tan(90)", None),
        ("1mm + 1", None),
        ("1mm * 1mm", None),
        ("sqrt(4mm)", None),
        ("5us", None),
    ],
)
def test_expressions(expression: str, value: float | None) -> None:
    if value is None:
        assert codes(f"LINE X ({expression})\n") in [[(1, "GJ122")], [(1, "GJ123")], [(1, "GJ203")]]
    else:
        assert ends(f"LINE X ({expression})\n") == [(round(value * 1000), 0)]


@pytest.mark.parametrize(
    ("condition", "so"),
    [
        ("1 < 2", True),
        ("2 <= 2 and 2 >= 2", True),
        ("1 == 2 or 2 != 2", False),
        ("not 1 == 2", True),
        ("not 1 == 1 or 1 == 1", True),
        ("1 == 1 or 1 == 1 and 1 == 2", True),
        ("(1 == 1 OR 1 == 1) AND NOT 1 == 1", False),
        ("1mm < 2000um", True),
        ("0.1 + 0.2 == 0.3", False),
    ],
)
def test_conditions(condition: str, so: bool) -> None:
    assert xs(f"IF {condition}\nLINE X 1\nELSE\nLINE X 2\nEND\n") == [1000 if so else 2000]


def test_a_value_takes_the_unit_that_is_in_force_where_it_is_used() -> None:
    text = "LET n = 500\nLET m = 2mm\nLINE X (n/100) Y (m)\nUNITS PULSE\nLINE X (n) Y (m)\n"
    assert ends(text) == [(5000, 2000), (500, 2000)]
    text = "LET v = 100mm/s\nVEL (v*2)\nLINE X 1\nUNITS PULSE\nVEL (v/2)\nLINE X 100\nVEL (20+5)\nLINE X 200\n"
    assert [c.split(",")[3] for c in path_calls(MARK + text)] == ["200", "50", "25"]


# Loops.


def test_a_square_by_for() -> None:
    text = "FOR k FROM 1 TO 4\nLINE X (10*cos(90*k)) Y (10*sin(90*k))\nEND\n"
    assert ends(text) == [(0, 10000), (-10000, 0), (0, -10000), (10000, 0)]


@pytest.mark.parametrize("count", [0, 1, 2, 3, 4, 5, 6, 100])
def test_repeat_counts_from_zero(count: int) -> None:
    text = f"REPEAT {count} AS i\nLINE X (i/10) Y (i % 3)\nEND\nLINE X -1 Y 0\n"
    assert ends(text) == [(100 * i, 1000 * (i % 3)) for i in range(count)] + [(-1000, 0)]


def test_for_includes_both_ends_and_accumulates_nothing() -> None:
    assert xs("FOR v FROM 0 TO 1 STEP 0.1\nLINE X (v)\nEND\n") == [100 * k for k in range(11)]
    assert xs("FOR v FROM 0 TO 100 STEP 0.1\nLINE X (v)\nEND\n")[-1] == 100000
    assert xs("FOR v FROM 3 TO 1 STEP -1\nLINE X (v)\nEND\n") == [3000, 2000, 1000]
    assert xs("FOR v FROM 1 TO 2 STEP 0.3\nLINE X (v)\nEND\n") == [1000, 1300, 1600, 1900]
    assert xs("FOR v FROM 5 TO 5\nLINE X (v)\nEND\n") == [5000]
    assert xs("FOR v FROM 2 TO 1\nLINE X (v)\nEND\nLINE X 7\n") == [7000]
    assert xs("FOR v FROM 1mm TO 3000um STEP 1mm\nLINE X (v)\nEND\n") == [1000, 2000, 3000]


@pytest.mark.parametrize(
    ("head", "code"),
    [
        ("REPEAT 2.5", "GJ124"),
        ("REPEAT -1", "GJ124"),
        ("REPEAT 3mm", "GJ122"),
        ("FOR v FROM 1 TO 2 STEP 0", "GJ124"),
        ("FOR v FROM 1mm TO 2", "GJ122"),
        ("REPEAT n", "GJ121"),
    ],
)
def test_loops_that_cannot_be_counted(head: str, code: str) -> None:
    assert codes(f"{head}\nLINE X 1\nEND\n")[0] == (1, code)


def test_a_raster_of_two_loops() -> None:
    text = "FOR row FROM 0 TO 9\nIF row % 2 == 0\nJUMP X 0 Y (row)\nLINE X 20\nELSE\nJUMP X 20 Y (row)\nLINE X 0\n"
    text += "END\nEND\n"
    expected = []
    for row in range(10):
        sides = (0, 20000) if row % 2 == 0 else (20000, 0)
        expected += [(x, 1000 * row) for x in sides]
    assert ends(text) == expected


def test_values_carried_from_one_iteration_to_the_next() -> None:
    fibonacci = "LET a = 0\nLET b = 1\nREPEAT 10\nLET t = a+b\nLET a = b\nLET b = t\nLINE X (a)\nEND\n"
    assert xs(fibonacci) == [1000 * n for n in (1, 1, 2, 3, 5, 8, 13, 21, 34, 55)]
    collatz = "LET n = 6\nREPEAT 8\nIF n % 2 == 0\nLET n = n/2\nELSE\nLET n = 3*n+1\nEND\nLINE X (n)\nEND\n"
    assert xs(collatz) == [1000 * n for n in (3, 10, 5, 16, 8, 4, 2, 1)]
    growing = "LET a = 1\nREPEAT 20 AS i\nLET a = a*1.1+i\nEND\nLINE X (a/10)\n"
    a = 1.0
    for i in range(20):
        a = a * 1.1 + i
    assert xs(growing) == [round(a * 100)]


def test_all_statements_in_a_loop() -> None:
    text = "REPEAT 2 AS i\nLASER POWER (10*(i+1))\nLASER ON\nLINE X (i+1) VEL (50+i)\nLASER OFF\nDWELL (5*(i+1))\nEND\n"
    assert [c for c in calls_of(MARK + "LOOKAHEAD OFF\n" + text) if "_Buf" in c or "Ln" in c] == [
        "GT_BufLaserPrfCmd(1,10,0,0)",
        "GT_BufLaserOn(1,0,0)",
        "GT_LnXY(1,1000,0,50,10,0,0)",
        "GT_BufLaserOff(1,0,0)",
        "GT_BufDelay(1,5,0)",
        "GT_BufLaserPrfCmd(1,20,0,0)",
        "GT_BufLaserOn(1,0,0)",
        "GT_LnXY(1,2000,0,51,10,0,0)",
        "GT_BufLaserOff(1,0,0)",
        "GT_BufDelay(1,10,0)",
    ]


def test_a_setup_statement_in_a_loop_makes_stages() -> None:
    calls = calls_of(MARK + "REPEAT 3 AS i\nLASER DELAY ON (10*i) OFF (10*i+50)\nLINE X (i+1)\nEND\n")
    assert [c for c in calls if "Delay" in c] == [f"GT_SetLevelDelay({10 * i + 50},{10 * i},0)" for i in range(3)]
    assert len([c for c in calls if "CrdStart" in c]) == 3


def test_a_name_set_in_a_loop_keeps_its_value() -> None:
    text = "REPEAT 2\nCOORDS REL\nUNITS PULSE\nLINE X 100\nEND\nLINE X 7\n"
    assert xs(text) == [100, 200, 207]


# Names.


def test_a_loop_variable_hides_a_name() -> None:
    for count in (3, 6):
        text = f"LET i = 7\nREPEAT {count} AS i\nLINE X (i)\nEND\nLINE X (i)\n"
        assert xs(text) == [*(1000 * k for k in range(count)), 7000]
        text = f"FOR i FROM 1 TO 2\nFOR i FROM 5 TO {4 + count}\nLINE X (i)\nEND\nLINE X (i)\nEND\n"
        inner = [1000 * k for k in range(5, 5 + count)]
        assert xs(text) == [*inner, 1000, *inner, 2000]
    assert codes("REPEAT 3 AS i\nLINE X (i)\nEND\nLINE Y (i)\n") == [(4, "GJ121")]


def test_a_name_set_in_a_block_keeps_its_value() -> None:
    assert xs("REPEAT 5 AS i\nLET a = i*2\nEND\nIF a == 8\nLET b = 3\nELSE\nLET b = 4\nEND\nLINE X (a+b)\n") == [11000]
    assert codes("REPEAT 0\nLET a = 1\nEND\nLINE X (a)\n")[-1] == (4, "GJ121")


def test_a_routine_has_its_own_names() -> None:
    text = "LET a = 1\nLET b = 2\nDEF r(a)\nLET b = a*10\nLINE X (a) Y (b)\nEND\nCALL r(5)\nLINE X (a) Y (b)\n"
    assert ends(text) == [(5000, 50000), (1000, 2000)]
    assert codes("DEF r\nLET inner = 1\nLINE X (inner)\nEND\nCALL r\nLINE X (inner)\n") == [(6, "GJ121")]


def test_a_routine_reads_the_names_of_the_job() -> None:
    text = "DEF r\nLINE X (a)\nLET a = a+1\nLINE X (a)\nEND\nLET a = 1\nCALL r\nLET a = 5\nCALL r\nLINE X (a)\n"
    assert xs(text) == [1000, 2000, 5000, 6000, 5000]


def test_a_name_set_in_one_branch_of_a_routine() -> None:
    text = "LET a = 9\nDEF r(n)\nIF n > 2\nLET a = n\nEND\nLINE X (a)\nEND\nREPEAT 6 AS i\nCALL r(i)\nEND\n"
    assert xs(text) == [9000, 9000, 9000, 3000, 4000, 5000]


def test_names_of_one_letter_may_be_words_of_motion() -> None:
    assert ends("LET x = 2\nLET y = 3\nLET r = 1\nLINE X (x+r) Y (y)\nLINE X(y)Y(x)\n") == [(3000, 3000), (3000, 2000)]
    assert codes("LET line = 2\n") == [(1, "GJ108")]


# Routines.


def test_calls_before_the_routine_and_without_values() -> None:
    assert ends("CALL r\nDEF r()\nLINE X 1\nEND\nCALL r()\n") == [(1000, 0), (1000, 0)]


def test_a_long_run_of_calls() -> None:
    text = "COORDS REL\nDEF stair(a, b)\nLINE X (a)\nLINE Y (b)\nEND\n"
    text += "".join(f"CALL stair({k}/10, -{k}/100)\n" for k in range(40))
    text += "LINE X 1\nCALL stair(1, 2)\n"
    expected, x, y = [], 0, 0
    for k in range(40):
        x += 100 * k
        expected.append((x, y))
        y -= 10 * k
        expected.append((x, y))
    expected += [(x + 1000, y), (x + 2000, y), (x + 2000, y + 2000)]
    assert ends(text) == expected


KOCH = """COORDS REL
DEF koch(n, s)
  IF n == 0
    LINE X (s)
  ELSE
    CALL koch(n-1, s/3)
    FRAME ROTATE 60
      CALL koch(n-1, s/3)
    END
    FRAME ROTATE -60
      CALL koch(n-1, s/3)
    END
    CALL koch(n-1, s/3)
  END
END
"""


def test_koch() -> None:
    high = round(1000 * math.sqrt(3) / 2)
    assert ends(KOCH + "CALL koch(1, 3)\n") == [(1000, 0), (1500, high), (2000, 0), (3000, 0)]
    curve = ends(KOCH + "CALL koch(4, 81)\n")
    assert len(curve) == 4**4
    assert curve[-1] == (81000, 0)
    assert max(y for _, y in curve) == round(27000 * math.sqrt(3) / 2)


def test_sierpinski() -> None:
    text = (
        "DEF side(n, s)\nIF n == 0\nLINE X 0 Y 0\nLINE X (s)\nLINE Y (s)\nLINE X 0 Y 0\nELSE\nCALL side(n-1, s/2)\n"
        "FRAME SHIFT X (s/2)\nCALL side(n-1, s/2)\nEND\nFRAME SHIFT X (s/2) Y (s/2)\nCALL side(n-1, s/2)\nEND\n"
        "END\nEND\nCALL side(5, 32)\n"
    )
    corners = ends(text)
    assert len(corners) == 4 * 3**5
    # The corners of the triangles are the odd numbers of Pascal's triangle.
    odd = {(1000 * n, 1000 * k) for n in range(32) for k in range(n + 1) if math.comb(n, k) % 2}
    assert set(corners[::4]) == odd


# Frames.


def test_a_rotated_line() -> None:
    assert ends("FRAME ROTATE 90\nLINE X 1\nLINE Y 1\nEND\nLINE X 5\n") == [(0, 1000), (-1000, 1000), (5000, 1000)]


@pytest.mark.parametrize("words", ["SHIFT X 10 Y 0 ROTATE 90 SCALE 2", "SCALE 2 ROTATE 90deg SHIFT X 10mm"])
def test_scale_then_rotate_then_shift(words: str) -> None:
    assert ends(f"FRAME {words}\nLINE X 1 Y 0\nLINE X 1 Y 1\nEND\n") == [(10000, 2000), (8000, 2000)]


def test_frame_in_frame() -> None:
    text = "FRAME SHIFT X 10 ROTATE 90\nFRAME SHIFT X 5\nLINE X 1 Y 0\nEND\nLINE X 1 Y 0\nEND\nLINE X 1 Y 0\n"
    assert ends(text) == [(10000, 6000), (10000, 1000), (1000, 0)]
    assert ends("FRAME SCALE 2\nFRAME SHIFT X 5 ROTATE 90\nLINE X 1 Y 0\nEND\nEND\n") == [(10000, 2000)]


def test_a_ring_of_frames() -> None:
    text = "REPEAT 12 AS k\nFRAME ROTATE (30*k) SHIFT X 1\nLINE X 10 Y 0\nEND\nEND\n"
    turns = [math.radians(30 * k) for k in range(12)]
    assert ends(text) == [(round(1000 + 10000 * math.cos(t)), round(10000 * math.sin(t))) for t in turns]


def test_an_axis_left_out_stays_as_seen_from_the_frame() -> None:
    # At (10, 0) a frame turned by 90 degrees sees (0, -10).
    assert ends("LINE X 10\nFRAME ROTATE 90\nLINE X 5\nLINE Y 0\nEND\n")[1:] == [(10000, 5000), (0, 5000)]
    assert ends("FRAME SHIFT X 10\nLINE X 1\nEND\nLINE Y 2\n") == [(11000, 0), (11000, 2000)]


def test_relative_moves_go_along_the_axes_of_the_frame() -> None:
    text = "COORDS REL\nLINE X 5\nFRAME SHIFT X 99 ROTATE 90 SCALE 3\nLINE X 1\nLINE X 1 Y 1\nEND\nLINE X 1\n"
    assert ends(text) == [(5000, 0), (5000, 3000), (2000, 6000), (3000, 6000)]


def test_a_frame_around_a_call() -> None:
    text = "DEF r(a)\nLINE X (a) Y 0\nFRAME SCALE 2\nLINE X (a) Y 0\nEND\nEND\n"
    text += "FRAME ROTATE 180\nCALL r(3)\nEND\nCALL r(3)\n"
    assert ends(text) == [(-3000, 0), (-6000, 0), (3000, 0), (6000, 0)]


def test_arcs_in_frames() -> None:
    assert path_calls(MARK + "FRAME ROTATE 90\nARC CCW X 10 Y 0 I 5 J 0\nEND\n") == [
        "GT_ArcXYC(1,0,10000,0,5000,1,100,10,0,0)"
    ]
    assert path_calls(MARK + "FRAME SCALE 2 ROTATE 180\nARC CW X 10 R -6\nEND\n") == [
        "GT_ArcXYR(1,-20000,0,-12000,0,100,10,0,0)"
    ]
    # A centre depends on the start alone: it is not shifted.
    assert path_calls(MARK + "LINE X 1\nFRAME SHIFT X 50 Y 50 SCALE 3\nARC CW I 0 J 1\nEND\n")[1:] == [
        "GT_ArcXYC(1,1000,0,0,3000,0,100,10,0,0)"
    ]


@pytest.mark.parametrize("words", ["ROTATE 30", "SHIFT X 7 Y 2 ROTATE 30", "ROTATE 30 SHIFT X 0.1 Y 0.7 SCALE (7/7)"])
@pytest.mark.parametrize("start", ["", "LINE X 2.37 Y 6.9497\n", "LINE X 0.1 Y 0.2\nCOORDS REL\n"])
def test_a_full_circle_in_a_frame_stays_full(words: str, start: str) -> None:
    (call,) = (c for c in path_calls(f"{MARK}{start}FRAME {words}\nARC CW I 3 J 0\nEND\n") if "Arc" in c)
    # 3 mm at 30 degrees; the centre's own pulse and the start's are half a pulse off at most, each.
    i, j = map(int, call.split(",")[3:5])
    assert abs(i - 3000 * math.cos(math.radians(30))) <= 1
    assert abs(j - 1500) <= 1


def test_velocity_is_not_scaled() -> None:
    (call,) = path_calls(MARK + "FRAME SCALE 5\nLINE X 10\nEND\n")
    assert call == "GT_LnXY(1,50000,0,100,10,0,0)"


def test_frames_rotate_mm_not_pulses() -> None:
    assert ends("FRAME ROTATE 90\nLINE X 10\nLINE Y 2\nEND\n", UNEQUAL) == [(0, 5000), (-2000, 5000)]
    assert ends("UNITS PULSE\nVEL 9\nACC 1\nFRAME ROTATE 90\nLINE X 1000\nEND\n", UNEQUAL) == [(0, 500)]
    assert ends("COORDS REL\nFRAME ROTATE 90\nLINE X 1\nLINE X 1\nEND\nLINE Y 1\n", UNEQUAL)[-1] == (0, 1500)


@pytest.mark.parametrize("arc", ["ARC CCW I -1000 J 0", "ARC CCW X -1000 Y 0 R 1000\nARC CCW X 1000 Y 0 R 1000"])
def test_an_arc_in_pulses_is_an_ellipse_in_a_rotated_frame(arc: str) -> None:
    """A circle of 1000 pulses is 1 mm by 2 mm here (500 pulses per mm on Y); scaled by 2 and turned: 4 mm by 2 mm."""
    head = "UNITS PULSE\nVEL 9\nACC 1\nFRAME SHIFT X 2000 ROTATE 90 SCALE 2\nJUMP X 1000 Y 0\n"
    points = ends(f"{head}{arc}\nWAIT\nLINE X 0 Y 0\nEND\n", UNEQUAL)
    assert points[0] == points[-2] == (2000, 1000)
    assert points[-1] == (2000, 0)
    assert len(points) > 40
    for x, y in points[:-1]:
        # On the ellipse within the chord tolerance and half a pulse.
        assert math.hypot((x - 2000) / 4000, y / 1000) == pytest.approx(1, abs=2e-3)
    assert max(x for x, _ in points) == pytest.approx(6000, abs=30)


def test_a_frame_needs_a_size() -> None:
    assert codes("FRAME SCALE 0\nLINE X 1\nEND\n")[0] == (1, "GJ139")
    assert codes("FRAME SCALE (1-2)\nLINE X 1\nEND\n")[0] == (1, "GJ139")


# Diagnostics.


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("REPEAT 2\nLINE X 1\n", [(1, "GJ131")]),
        ("LINE X 1\nEND\n", [(2, "GJ132")]),
        ("ELSE\nLINE X 1\n", [(1, "GJ132")]),
        ("REPEAT 2\nDEF r\nEND\nLINE X 1\nEND\n", [(2, "GJ133")]),
        ("DEF r\nEND\nDEF r\nEND\nCALL r\nLINE X 1\n", [(3, "GJ135")]),
        ("CALL r\nLINE X 1\n", [(1, "GJ136")]),
        ("DEF r(a)\nLINE X (a)\nEND\nCALL r(1, 2)\n", [(4, "GJ137")]),
        ("IF 1\nLINE X 1\nEND\n", [(1, "GJ126")]),
        ("LET a = 1 < 2\n", [(1, "GJ125")]),
        ("LINE X (hyp(1))\n", [(1, "GJ109")]),
        ("LINE X (atan2(1))\n", [(1, "GJ110")]),
        ("LINE X (1 < 2 < 3)\n", [(1, "GJ101")]),
    ],
)
def test_errors_of_blocks_and_expressions(text: str, found: list[tuple[int, str]]) -> None:
    assert [f for f in codes(text) if f[1] not in ("GJ004", "GJ141", "GJ142")] == found


def test_a_diagnostic_has_its_calls_and_iterations() -> None:
    text = "DEF corner(s)\nLINE X (s*100)\nEND\nREPEAT 9 AS k\nCALL corner(k/3)\nEND\n"
    (diagnostic,) = diagnostics(text)
    head = MARK.count("\n")
    assert (diagnostic.rule.code, diagnostic.span.line, diagnostic.count) == ("GJ503", head + 2, 4)
    # 5/3 * 100 mm is the first beyond 150 mm.
    assert [(r.span.line - head, r.message) for r in diagnostic.remarks[:2]] == [
        (5, "called here: s = 1.666666667"),
        (4, "in the iteration where k = 5"),
    ]


def test_a_diagnostic_in_a_routine_of_routines() -> None:
    text = "DEF inner(b)\nLINE X (b + nowhere)\nEND\nDEF outer(a)\nCALL inner(a+1)\nEND\nCALL outer(1)\nLINE X 1\n"
    diagnostic = diagnostics(text)[0]
    head = MARK.count("\n")
    assert (diagnostic.rule.code, diagnostic.span.line) == ("GJ121", head + 2)
    assert [(r.span.line - head, r.message) for r in diagnostic.remarks[:2]] == [
        (5, "called here: b = 2"),
        (7, "called here: a = 1"),
    ]


@pytest.mark.parametrize(
    ("statement", "code"),
    [
        ("LINE X 200", "GJ503"),
        ("LINE X (151+i/1e6)", "GJ503"),
        ("LASER POWER (101+i/1e6)", "GJ201"),
        ("LINE X (zz)", "GJ121"),
        ("LINE X (1/(i-i))", "GJ123"),
        ("VEL (20000+i/1e6)", "GJ504"),
        ("DWELL 0.5", "GJ204"),
    ],
)
def test_one_diagnostic_for_many_iterations(statement: str, code: str) -> None:
    found = [f for f in diagnostics(f"REPEAT 300000 AS i\n{statement}\nEND\nLINE X 1\n") if f.rule.code == code]
    assert [f.count for f in found] == [300_000]
    assert found[0].span.line == MARK.count("\n") + 2


def test_too_much_is_refused() -> None:
    assert "GJ127" in [code for _, code in codes("REPEAT 3000001\nLINE X 1\nEND\n")]
    assert "GJ127" in [code for _, code in codes("REPEAT 1e5\nREPEAT 1e5\nLINE X 1\nEND\nEND\n")]
    assert "GJ128" in [code for _, code in codes("DEF r\nLINE X 1\nCALL r\nEND\nCALL r\n")]


# Files.


def test_an_include_is_read_in_place(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "names.job").write_text('LET a = 3\nINCLUDE "corner.job"\n', encoding="utf-8")
    (tmp_path / "parts" / "corner.job").write_text("DEF corner(n)\nLINE X (n)\nLINE Y (a)\nEND\n", encoding="utf-8")
    top = tmp_path / "top.job"
    top.write_text(MARK + 'INCLUDE "parts/names.job"\nFRAME ROTATE 90\nCALL corner(1)\nEND\n', encoding="utf-8")
    source, _ = read_source(top)
    assert source is not None
    job, found = read_job(source, MACHINE)
    assert found == []
    assert [(round(x), round(y)) for x, y in zip(job.path.x, job.path.y, strict=True)] == [(0, 1000), (-3000, 1000)]
    (tmp_path / "parts" / "names.job").write_text('INCLUDE "../../outside.job"\n', encoding="utf-8")
    source, _ = read_source(top)
    assert source is not None
    assert "GJ138" in [f.rule.code for f in read_job(source, MACHINE)[1]]


@pytest.mark.parametrize("body", ["LET a = a + 1\nWAIT\n", "WAIT\n", "LASER DELAY ON (a) OFF 9\nLET a = a + 1\n"])
def test_too_many_setup_statements(body: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.frontend.expand.ledger.MAX_SETUPS", 3)
    assert "GJ130" in [code for _, code in diagnostics_in(f"LET a = 0\nREPEAT 10\n{body}END\n")]


def test_names_with_leading_zeros_are_others() -> None:
    text = "LET x1 = 1\nLET x01 = 2\n" + "LINE X (x1)\nLINE X (x01)\n" * 3
    assert ends(text) == [(1000, 0), (2000, 0)] * 3


def test_a_name_that_some_iterations_set_is_carried() -> None:
    """Eight iterations: they would run at once if none depended on another."""
    text = "LET a = 1\nREPEAT 8 AS i\nIF i == 5\nLET a = 9\nEND\nLINE X (a) Y (i)\nEND\n"
    assert [x for x, _ in ends(text)] == [1000] * 5 + [9000] * 3


def test_iterations_of_all_loops_together_are_bounded() -> None:
    machine = replace(MACHINE, expansion_max_statements=100)
    assert diagnostics_in("REPEAT 60\nEND\nDWELL 1\n", machine) == []
    assert [code for _, code in diagnostics_in("REPEAT 60\nEND\n" * 2, machine)] == ["GJ127"]


def test_no_error_for_calls_of_a_routine_that_can_not_be_parsed() -> None:
    assert "GJ136" not in [code for _, code in diagnostics_in("DEF f(\nDWELL 1\nEND\nCALL f(1)\n")]


def test_order_is_kept_after_an_arc_that_became_chords() -> None:
    text = "UNITS PULSE\nVEL 9\nACC 1\nFRAME ROTATE 90\nJUMP X 1000\nARC CCW I -1000\nEND\nWAIT\nDWELL 5\n"
    names = [call.split("(")[0] for call in calls_of(text, UNEQUAL)]
    assert names[-4:] == ["GT_CrdStatus", "GT_CrdClear", "GT_BufDelay", "GT_CrdStart"]
    assert "GT_LnXY" not in names[names.index("GT_CrdStatus") :]
