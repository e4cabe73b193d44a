"""Canonical layout: lines, blocks, comments, line ends."""

from __future__ import annotations

import pytest
from support.formatting import comments, formatted
from support.tools import ROOT

from gusjob.diagnostics.model import has_errors
from gusjob.frontend.expand.program import MAX_NESTING
from gusjob.frontend.format import format_text, formatter
from gusjob.frontend.format.statement import canonical
from gusjob.frontend.scan import shapes
from gusjob.frontend.scan.shapes import MAX_LINE


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("line x10 y=20", "LINE X 10 Y 20"),
        ("Line\tX = - 5.50Y+.5", "LINE X -5.50 Y +.5"),
        ("LINE X 1e3 Y 1E-3", "LINE X 1e3 Y 1E-3"),
        ("LINE Y 2 X 1 END 3 VEL 2", "LINE Y 2 X 1 END 3 VEL 2"),
        ("LINE X 007 Y 5.", "LINE X 007 Y 5."),
        ("VEL=18000MM/MIN", "VEL 18000mm/min"),
        ("acc 5M/S2", "ACC 5m/s2"),
        ("LASER MODE DUTY2 CARRIER20KHZ MIN 1%", "LASER MODE DUTY2 CARRIER 20kHz MIN 1%"),
        ("LASER STANDBY FREQ5hz DUTY2", "LASER STANDBY FREQ 5Hz DUTY 2"),
        ("LASER STANDBY FREQ5DUTY3 CHANNEL1", "LASER STANDBY FREQ 5 DUTY 3 CHANNEL 1"),
        ("LASER PREVOLT 400MV", "LASER PREVOLT 400mV"),
        (
            "laser distance ref x0y0 ratio x.1y.1 min1max 9 source=planned",
            "LASER DISTANCE REF X 0 Y 0 RATIO X .1 Y .1 MIN 1 MAX 9 SOURCE PLANNED",
        ),
        ("SKYWRITE MODE2TIMELAG 250US nprev=auto", "SKYWRITE MODE 2 TIMELAG 250us NPREV AUTO"),
        ("LET Pitch=2*( 3-n )", "LET Pitch = 2 * (3 - n)"),
        ("let a = - b+-c--d", "LET a = -b + -c - -d"),
        ("LINE X(a*-b ** - 2/c%d) Y - ( a+1 )", "LINE X (a * -b ** -2 / c % d) Y -(a + 1)"),
        ("LET a = min ( 1,2 ,max(3, 4))", "LET a = min(1, 2, max(3, 4))"),
        ("if not(a<=1)AND b!=2 Or c==3", "IF not (a <= 1) and b != 2 or c == 3"),
        ("IF ((a))>0", "IF ((a)) > 0"),
        ("repeat n*2 as i", "REPEAT n * 2 AS i"),
        ("for I from-1 to(n) step +.5", "FOR I FROM -1 TO (n) STEP +.5"),
        ("def Box ( w,h )", "DEF Box(w, h)"),
        ("call Box( 1,- 2 )", "CALL Box(1, -2)"),
        ("call Box ()", "CALL Box()"),
        ("CALL Box", "CALL Box"),
        ('include"a  B.job"', 'INCLUDE "a  B.job"'),
        ("frame shift x1y2 rotate30DEG scale=.5", "FRAME SHIFT X 1 Y 2 ROTATE 30deg SCALE .5"),
        ("LASER ON  ;Text  as\tit is \t", "LASER ON  ;Text  as\tit is"),
        ("\t// alone", "// alone"),
        ("WAIT//", "WAIT  //"),
    ],
)
def test_a_line(written: str, expected: str) -> None:
    assert formatted(written) == expected + "\n"
    assert formatted(expected + "\n") == expected + "\n"


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("LET a = 5 % (n)", "LET a = 5 % (n)"),
        ("LET a = 5 % -3", "LET a = 5 % -3"),
        ("LET a = 5 % .5", "LET a = 5 % .5"),
        ("LET a = 5 % 3", "LET a = 5 % 3"),
        ("LET a = 5% + 3%", "LET a = 5% + 3%"),
        ("LET a = 5mm / min(n, 2)", "LET a = 5mm / min(n, 2)"),
        ("LET a = 5mm / s", "LET a = 5mm / s"),
        ("LET a = 5MM/S", "LET a = 5mm/s"),
        ("LET a = 5pulse / ms2", "LET a = 5pulse / ms2"),
        ("LET a = 5mm/3", "LET a = 5mm / 3"),
        ("LET a = n/s", "LET a = n / s"),
        ("LET a = 5mm / S3", "LET a = 5mm / S3"),
    ],
)
def test_operators_do_not_become_units(written: str, expected: str) -> None:
    assert formatted(written) == expected + "\n"


def test_lines_of_one_shape_that_differ() -> None:
    """One shape, once a unit, once divided by a name."""
    expected = {2: "LET a = 5mm/s2", 3: "LET a = 5mm / S3"}
    for order in ((2, 3), (3, 2)):
        lines = [f"LET a = 5MM/S{n}" for n in order]
        assert formatted("\n".join(lines)).split("\n")[:2] == [expected[n] for n in order]
        lines = [f"LET a = 5mm / s{n}" for n in order]
        assert formatted("\n".join(lines)).split("\n")[:2] == lines


BEFORE = """

\t
def a
; in it
for i from 0 to 3
if i==1
      ; deep
line x(i)
  else
wait

 // of else
end


;two

end


FRAME
END
end
LASER ON
   end"""
AFTER = """DEF a
  ; in it
  FOR i FROM 0 TO 3
    IF i == 1
      ; deep
      LINE X (i)
    ELSE
      WAIT

      // of else
    END


    ;two

  END


  FRAME
  END
END
LASER ON
END
"""


def test_blocks_and_blank_lines() -> None:
    assert formatted(BEFORE) == AFTER
    assert formatted(BEFORE.replace("\n\n\n", "\n \n\n\t\n\n") + "\n\n\n") == AFTER


def test_an_end_without_a_block() -> None:
    assert formatted("END\n  END\nIF 1 == 1\nWAIT\nEND\n") == "END\nEND\nIF 1 == 1\n  WAIT\nEND\n"


def test_comments_stay_aligned() -> None:
    text = """VEL=5       ; kept
LINE X(1*2) ; where
WAIT
DWELL 100   // they are
LINE X   1       ; alone
LINE X -123.5 ;moved
WAIT          ;on
ACC 1 ; a
"""
    expected = """VEL 5           ; kept
LINE X (1 * 2)  ; where
WAIT
DWELL 100       // they are
LINE X 1  ; alone
LINE X -123.5  ;moved
WAIT           ;on
ACC 1  ; a
"""
    assert formatted(text) == expected
    assert formatted(expected) == expected
    assert formatted("VEL 5        ; a\nWAIT         ; b\n") == "VEL 5        ; a\nWAIT         ; b\n"


def test_columns_are_characters() -> None:
    text = 'INCLUDE "\u00e9\u00e9.job"  ; a\nWAIT              ; b\n'
    assert formatted(text) == text


def test_aligned_with_tabs() -> None:
    assert formatted("VEL 5\t\t; a\nJUMPVEL 5\t; b\n") == "VEL 5           ; a\nJUMPVEL 5       ; b\n"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ""),
        (" \n\t\n", ""),
        ("\ufeff", "\ufeff"),
        ("\ufeffwait", "\ufeffWAIT\n"),
        ("wait\r\nwait\nwait", "WAIT\r\nWAIT\r\nWAIT\r\n"),
        ("wait\nwait\r\n\r\nwait\r\n", "WAIT\nWAIT\n\nWAIT\n"),
        ("wait\rvel 5 ; a\rwait\r\r\n", "WAIT\nVEL 5  ; a\nWAIT\n"),
        ("wait\r\nwait\rwait", "WAIT\r\nWAIT\r\nWAIT\r\n"),
        ("wait ; é\nline x1;é", "WAIT  ; é\nLINE X 1  ;é\n"),
    ],
)
def test_ends(text: str, expected: str) -> None:
    assert formatted(text) == expected
    assert formatted(expected) == expected


def test_indent_of_deep_blocks_is_bounded() -> None:
    deep = "IF 1 == 1\n" * 5000
    lines = formatted(deep).splitlines()
    assert lines[MAX_NESTING].index("I") == lines[-1].index("I") == 2 * MAX_NESTING


@pytest.mark.parametrize(
    "text",
    [
        "LET a = " + "1 + " * 2000 + "1 ;" + "c" * 1980,
        "VEL 5".ljust(2000)
        + ";"
        + "b" * 7900
        + "\n"
        + ("LET c=" + "1+" * 990 + "1").ljust(2000)
        + "; c\nVEL 5".ljust(2000)
        + "; d",
        "IF 1==1\n;" + "c" * (MAX_LINE - 1) + "\nEND",
        "VEL 5 ; a" + "\nVEL 5 ;" + "b" * (MAX_LINE - 20) + "\nLET c=" + "1+" * 2000 + "1",
        "VEL 5" + " " * 4500 + ";" + "b" * 5000 + "\nLET c=" + "1+" * 2246 + "1 ; a\n",
    ],
)
def test_no_line_becomes_too_long(text: str) -> None:
    once = formatted(text)
    assert formatted(once) == once
    assert comments(once) == comments(text)


def test_a_line_that_would_become_too_long_stays() -> None:
    text = "  LET  a=" + "1+" * ((MAX_LINE - 11) // 2) + "1"
    assert formatted(text + " \nvel 5\n") == text + "\nVEL 5\n"


@pytest.mark.parametrize("text", ["LINE X 1\nQQ\n", "LINE X\n", "VEL 1e16\n", "wait\nLINE X 1 X 2\n", "a\0", "\ud800"])
def test_a_text_that_can_not_be_parsed_has_errors(text: str) -> None:
    result, diagnostics = format_text(text)
    assert result is None
    assert has_errors(diagnostics)


def test_many_errors_are_counted() -> None:
    _, diagnostics = format_text("QQ\n" * 3000)
    assert [f.rule.code for f in diagnostics] == ["GJ102"] * 1000 + ["GJ005"]


def test_each_shape_is_formatted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise a job of a million lines takes minutes."""
    calls: list[str] = []

    def counted(text: str) -> tuple[str, str]:
        calls.append(text)
        return canonical(text)

    monkeypatch.setattr(formatter, "canonical", counted)
    count, localized = 20_000, "; " + "more than a chunk " * 6 + "."
    lines = [f"line x{i}.5y-{i}  acc{i}mm/s2 {localized}\nLASER on" for i in range(count)]
    result = formatted("\n".join(lines)).splitlines()
    assert len(calls) == 2
    assert [line.split(";")[0].rstrip() for line in result[::2]] == [
        f"LINE X {i}.5 Y -{i} ACC {i}mm/s2" for i in range(count)
    ]
    assert comments("\n".join(result)) == [localized] * count
    assert len("\n".join(lines)) > shapes.CHUNK


def test_the_example_jobs_are_formatted() -> None:
    for path in (ROOT / "jobs").rglob("*.job"):
        assert formatted(path.read_text(encoding="utf-8")) == path.read_text(encoding="utf-8"), path
