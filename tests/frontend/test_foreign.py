"""Statements of other languages: each error says what to write instead, and what it says is a statement."""

from __future__ import annotations

import time
from pathlib import Path
from random import Random

import pytest

from gusjob.diagnostics.fixes import apply_fixes
from gusjob.diagnostics.fixes.syntax import corrected
from gusjob.diagnostics.model import has_errors
from gusjob.frontend.parse.statement_parser import parse_statement
from gusjob.pipeline import Checked, examine, load

WRITTEN = [
    ("G1 X10 Y5 F6000", "LINE X 10 Y 5 VEL 100mm/s"),  # F is in mm/min.
    ("G01X-1.5Y+2", "LINE X -1.5 Y 2"),
    ("g1 f600", "VEL 10mm/s"),
    ("G1 F100", "VEL 100mm/min"),  # 1.666... mm/s would be another velocity.
    ("N20 G0 X1 Y2 (to the start)", "JUMP X 1 Y 2"),
    ("G00 Y2 F3000", "JUMP Y 2"),
    ("G2 X1 Y2 I0.5 J-1", "ARC CW X 1 Y 2 I 0.5 J -1"),
    ("G3 X1 Y2 R5 F60", "ARC CCW X 1 Y 2 R 5 VEL 1mm/s"),
    ("G4 S2", "DWELL 2s"),
    ("G4 X2", "DWELL 2s"),
    ("G21", "UNITS MM"),
    ("G90", "COORDS ABS"),
    ("G91", "COORDS REL"),
    ("G28", "JUMP X 0 Y 0"),
    ("M3", "LASER ON"),
    ("M5", "LASER OFF"),
    ("F600", "VEL 10mm/s"),
    ("SPEED 100", "VEL 100mm/s"),
    ("speed = 2 m/s", "VEL 2m/s"),
    ("JUMPSPEED 500", "JUMPVEL 500mm/s"),
    ("POWER 50", "LASER POWER 50%"),
    ("POWER 20kHz", "LASER POWER 20kHz"),
    ("MARK X 1 Y 2", "LINE X 1 Y 2"),
    ("PAUSE 5", "DWELL 5ms"),
    ("WAITMS 5", "DWELL 5ms"),
    ("DELAY 2s", "DWELL 2s"),
    ("FREQ 20", "LASER MODE DUTY CARRIER 20kHz"),
    ("PULSE 10", "LASER MODE FREQUENCY WIDTH 10us"),
    ("pitch = 0.5mm", "LET pitch = 0.5mm"),
    ("a = 3", "LET a = 3"),
    ("LOOP 3", "REPEAT 3"),
    ("NEXT", "END"),
]
SEVERAL = [
    ("G1 X1 Y2 S500", "LINE X 1 Y 2, and LASER POWER before it: the scale of S is not known"),
    ("G4 P500", "DWELL 500ms or DWELL 500s: the unit of P depends on the controller"),
    ("M3 S500", "LASER ON, and LASER POWER with a unit: the scale of S is not known"),
    ("G20", "all numbers in mm: there are no inches (1 inch is 25.4 mm)"),
    ("X10 Y5", "LINE X 10 Y 5 or JUMP X 10 Y 5"),
    ("MOVE X 1 Y 2", "JUMP X 1 Y 2 (laser off) or LINE X 1 Y 2 (laser unchanged)"),
    ("CIRCLE X 1 Y 2 R 3", "JUMP X 4 Y 2, LASER ON, ARC CCW I -3 J 0 and LASER OFF"),
    ("RECT X 1 Y 2 W 10 H 5",
     "JUMP X 1 Y 2, LASER ON, LINE X 11, LINE Y 7, LINE X 1, LINE Y 2 and LASER OFF"),
    ("M30", "nothing: leave the line out"),
    ("G91 G1 X5", "COORDS REL, then LINE X 5"),
    ("G0 X1 Y2 M5", "LASER OFF, then JUMP X 1 Y 2"),
    ("G1 X5 F600 S500 M3",
     "LASER ON, then LINE X 5 VEL 10mm/s, and LASER POWER before it: the scale of S is not known"),
    ("G17 G21 G90 G94", "UNITS MM, then COORDS ABS"),
    ("G20 G1 X1 F60", "all numbers in mm: there are no inches (1 inch is 25.4 mm)"),
    ("G2 X1 Y2 R5 S9", "ARC CW X 1 Y 2 R 5, and LASER POWER before it: the scale of S is not known"),
    ("G1 S500", "LASER POWER with a unit, such as LASER POWER 50%: the scale of S is not known"),
    ("M3 G1", "LASER ON"),
    ("G4", "DWELL and a time, such as DWELL 5ms"),
    ("G1 X1e3", ""),  # Not X 1.
    ("G0 X\u0663", ""),
    ("G17", "nothing: leave the line out"),
]  # fmt: skip


def hint_of(line: str) -> str:
    statement, found = parse_statement(line, 1)
    assert statement is None
    assert [d.rule.code for d in found] == ["GJ102"]
    return found[0].message.partition("; write ")[2]


@pytest.mark.parametrize(("line", "meant"), WRITTEN)
def test_the_statement_to_write(line: str, meant: str) -> None:
    assert hint_of(line) == meant
    assert parse_statement(meant, 1)[1] == []


@pytest.mark.parametrize(("line", "meant"), SEVERAL)
def test_several_statements_or_a_choice(line: str, meant: str) -> None:
    assert hint_of(line) == meant
    assert corrected(line) is None


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("# a b", "; a b"),
        ("  #a ; b", "  ;a ; b"),
        ("(a b)", "; a b"),
        ("%", "; %"),
        ("LINE X 10 # a", "LINE X 10 ; a"),
        ("VEL 500 mm/s # a", "VEL 500mm/s ; a"),
    ],
)
def test_comments_of_other_languages_are_fixed(line: str, wanted: str) -> None:
    assert corrected(line) == wanted
    assert parse_statement(wanted, 1)[1] == []


@pytest.mark.parametrize(("line", "meant"), WRITTEN)
def test_what_may_mark_something_else_is_not_fixed(line: str, meant: str) -> None:
    assert corrected(line) is None


@pytest.mark.parametrize(
    ("line", "glued"),
    [
        ("VEL 500 mm/s", "500mm/s"), ("ACC 5 m/s2", "5m/s2"), ("LASER POWER 50 %", "50%"), ("LINE X 10 mm", "10mm"),
        ("LASER MODE DUTY CARRIER 10 kHz", "10kHz"), ("DWELL 5 ms", "5ms"), ("FRAME ROTATE 30 deg", "30deg"),
        ("LASER PREVOLT 35 mV", "35mV"), ("LINE X 10 VEL 3 pulse/ms", "3pulse/ms"),
    ],
)  # fmt: skip
def test_a_unit_is_written_directly_after_its_number(line: str, glued: str) -> None:
    _, found = parse_statement(line, 1)
    assert found[0].message.endswith(f"; write the unit directly after its number: {glued}")
    fixed = corrected(line)
    assert fixed is not None
    assert glued in fixed


def test_a_unit_with_blanks_inside_is_the_whole_unit() -> None:
    assert parse_statement("VEL 500 mm / s", 1)[1][0].message.endswith("directly after its number: 500mm/s")


def checked(text: str) -> Checked:
    loaded = load(Path("a.job"), data=text.encode())
    assert isinstance(loaded, Checked)
    return examine(loaded)


def test_a_gcode_file_stays_refused() -> None:
    text = "(part)\nG21\nG90\nM3 S500\nG0 X1 Y2\nG1 X5 F600\nM5\nM30\n"
    done = apply_fixes(checked(text), lambda data: load(Path("a.job"), data=data), lambda _: True)
    assert done.data.decode() == text.replace("(part)", "; part")
    assert has_errors(done.loaded.diagnostics)
    assert [d.rule.code for d in done.loaded.diagnostics] == ["GJ102"] * 7


def test_many_lines_of_gcode_are_counted_quickly() -> None:
    """Also where each line has a shape of its own."""
    random = Random(1)
    lines = [f"G1 X{random.random():.3f} Y{random.random():.3f}" for _ in range(100_000)]
    lines += ["# " + "".join(random.choices("abcdefgh ", k=30)) for _ in range(10_000)]
    random.shuffle(lines)
    begin = time.process_time()
    found = checked("\n".join(lines)).diagnostics
    assert time.process_time() - begin < 10
    assert sum(d.rule.code == "GJ102" for d in found) == 1000
    assert [d.fields["count"] for d in found if d.rule.code == "GJ005"] == [109_000]
