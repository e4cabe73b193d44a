"""gusjob check --fix: each fix against a text worked out by hand, what is refused, and that nothing else changes."""

from __future__ import annotations

import os
import re
import shutil
import sys
import unicodedata
from collections import Counter
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner, Result
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.faulty import BAD, bad_files
from support.job_writer import Writer
from support.tools import MARK, ROOT, stream_in

from gusjob.cli import cli, fixes
from gusjob.controllers.gus.listing import listing
from gusjob.diagnostics.fixes import FIXES, FixResult, apply, apply_fixes
from gusjob.diagnostics.fixes.characters import normalized
from gusjob.diagnostics.fixes.syntax import corrected
from gusjob.diagnostics.model import Severity, has_errors
from gusjob.diagnostics.rules import RULES
from gusjob.frontend import check_text
from gusjob.frontend.parse import keyword_case
from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.kinematics.units import UNITS
from gusjob.pipeline import Checked, FileResult, examine, load

EXAMPLES = int(os.environ.get("PROPERTY_EXAMPLES", "40"))
LIT = MARK + "LASER POWER 30\nLASER ON\n"


def check(data: bytes, path: Path = Path("x.job"), profile: Path | None = None) -> Checked:
    loaded = load(path, profile, data=data)
    assert isinstance(loaded, Checked)
    return loaded


def checked(text: str | bytes) -> Checked:
    return examine(check(text if isinstance(text, bytes) else text.encode()))


def with_a_misread_line(found: Checked, text: str) -> Checked:
    """The same with one more error, that of the last line of a text."""
    return replace(found, diagnostics=(*found.diagnostics, checked(text).diagnostics[0]))


def fix(text: str | bytes, *codes: str) -> FixResult:
    return apply_fixes(checked(text), check, lambda diagnostic: not codes or diagnostic.rule.code in codes)


def after(text: str, *codes: str) -> str:
    return fix(text, *codes).data.decode()


def codes_of(loaded: FileResult) -> list[str]:
    return [diagnostic.rule.code for diagnostic in loaded.diagnostics]


def serious(loaded: FileResult) -> Counter[tuple[str, int]]:
    """Errors and warnings with their lines, and how often each comes."""
    found: Counter[tuple[str, int]] = Counter()
    for diagnostic in loaded.diagnostics:
        if diagnostic.severity is not Severity.NOTE:
            found[diagnostic.rule.code, diagnostic.span.line] += diagnostic.count
    return found


# Each fix.


@pytest.mark.parametrize(
    ("before", "wanted"),
    [
        (LIT + "LINE X 1\n", LIT + "LINE X 1\nLASER OFF\n"),
        (LIT + "LINE X 1", LIT + "LINE X 1\nLASER OFF"),
        (LIT + "LINE X 1\n\n \n", LIT + "LINE X 1\nLASER OFF\n\n \n"),
        (LIT + "LINE X 1 ; end\n; of it", LIT + "LINE X 1 ; end\n; of it\nLASER OFF"),
        (LIT.replace("\n", "\r\n") + "LINE X 1\r\n\r\n", LIT.replace("\n", "\r\n") + "LINE X 1\r\nLASER OFF\r\n\r\n"),
        (LIT.replace("\n", "\r\n") + "LINE X 1", LIT.replace("\n", "\r\n") + "LINE X 1\r\nLASER OFF"),
        ("CHANNEL 1\n" + LIT + "LINE X 1\n", "CHANNEL 1\n" + LIT + "LINE X 1\nLASER OFF CHANNEL 1\n"),
        (
            LIT + "channel 1\n" + LIT + "LINE X 1",
            LIT + "CHANNEL 1\n" + LIT + "LINE X 1\nLASER OFF CHANNEL 0\nLASER OFF CHANNEL 1",
        ),
        (MARK + "LASER POWER 30\nREPEAT 2\nLASER ON\nLINE X 1\nLASER OFF\nEND\nLASER ON\nLINE X 2\n",
         MARK + "LASER POWER 30\nREPEAT 2\nLASER ON\nLINE X 1\nLASER OFF\nEND\nLASER ON\nLINE X 2\nLASER OFF\n"),
        (MARK + "LASER POWER 30\nDEF f()\nLASER ON\nLINE X 1\nEND\nCALL f()\n",
         MARK + "LASER POWER 30\nDEF f()\nLASER ON\nLINE X 1\nEND\nCALL f()\nLASER OFF\n"),
    ],
)  # fmt: skip
def test_light_left_on(before: str, wanted: str) -> None:
    assert "GJ401" in codes_of(checked(before))
    assert after(before) == wanted
    assert not has_errors(fix(before).loaded.diagnostics)


def test_two_channels_are_two_faults() -> None:
    """Whichever of them was on first."""
    for first, then in ((0, 1), (1, 0)):
        done = fix(f"CHANNEL {first}\n{LIT}CHANNEL {then}\n{LIT}LINE X 1\n")
        assert done.count == 2
        assert done.data.endswith(b"LINE X 1\nLASER OFF CHANNEL 0\nLASER OFF CHANNEL 1\n")


@pytest.mark.parametrize(
    ("before", "wanted"),
    [
        ("LASER DELAY ON 60us OFF 50us", "LASER DELAY ON 60us OFF 60us"),
        ("LASER DELAY OFF=50 ON=60 ; why", "LASER DELAY OFF=60 ON=60 ; why"),
        ("LASER DELAY ON 6e1us OFF 0.05ms", "LASER DELAY ON 6e1us OFF 6e1us"),
        ("LASER DELAY OFF50ON60us", "LASER DELAY OFF60us ON60us"),
        ("LASER DELAY ON60OFF50CHANNEL 1", "LASER DELAY ON60OFF60CHANNEL 1"),
        ("LASER DELAY ON + 60 OFF 050", "LASER DELAY ON + 60 OFF + 60"),
    ],
)
def test_off_delay_below_on_delay(before: str, wanted: str) -> None:
    before, wanted = f"WAIT\n  {before}\nWAIT\n", f"WAIT\n  {wanted}\nWAIT\n"
    assert codes_of(checked(before)).count("GJ306") == 1
    assert after(before) == wanted


def test_comments_that_allow_stay() -> None:
    """Somebody has written a reason; it may hold again."""
    for comment in ("; allow GJ404", "; allow GJ4: why", "; allow GJ401: why", "; allow GJ404: why"):
        assert after(f"DWELL 1 {comment}\n") == f"DWELL 1 {comment}\n"


@pytest.mark.parametrize(
    ("before", "wanted"),
    [
        ("line X 10 y=20mm ; line x", "LINE X 10 Y=20mm ; line x"),
        ("Laser\tmode  duty2 carrier20khz min 1%", "LASER\tMODE  DUTY2 CARRIER20khz MIN 1%"),
        ("laser standby freq5hz duty2", "LASER STANDBY FREQ5hz DUTY2"),
        ("LET a = min(Pi1, 2) // let", ""),
        ("let x = 2", "LET x = 2"),
        ("line X (x) Y (min(x, 1mm*x)/1mm)", "LINE X (x) Y (min(x, 1mm*x)/1mm)"),
        ("if x > 1 AND not x == 3 or 1 < 2", "IF x > 1 AND not x == 3 or 1 < 2"),
        ("for i from 0 to x step 1", "FOR i FROM 0 TO x STEP 1"),
        ("repeat 2 as i", "REPEAT 2 AS i"),
        ('include "line x.job"', 'INCLUDE "line x.job"'),
        ("vel 1E3Mm/S", "VEL 1E3Mm/S"),
        ("WAIT ; é\nwait ; wait é", "WAIT ; é\nWAIT ; wait é"),
        ("skywrite mode 2 timelag 100us nprev auto", "SKYWRITE MODE 2 TIMELAG 100us NPREV AUTO"),
    ],
)
def test_words_in_capitals(before: str, wanted: str) -> None:
    """Words and nothing else: no blank, name, unit, function or comment."""
    words = dict(keyword_case.in_upper_case(before.encode()))
    lines = before.split("\n")
    for number, code in words.items():
        lines[number - 1] = code.decode() + lines[number - 1][len(code.decode()) :]
    assert "\n".join(lines) == (wanted or before)
    assert bool(words) == bool(wanted)


def test_small_words_are_said_once_and_counted() -> None:
    text = "WAIT\nline X 1 ; vel\nLINE x 2\nVEL 1mm/s\nLINE X 3\nline X 14\n"
    notes = [f for f in checked(text).diagnostics if f.rule.code == "GJ143"]
    assert [(f.span.line, f.span.column, f.span.end_column, f.count) for f in notes] == [(2, 1, 5, 3)]
    assert notes[0].fields == {"word": "line", "meant": "LINE"}
    assert "GJ143" not in codes_of(checked("LINE X (x + min(x, y)) ; line\nVEL 1mm/s\nQQ x\nwait wait\n"))
    columns = [
        (f.span.column, f.span.end_column) for f in checked("LINE X 1 y 2\n").diagnostics if f.rule.code == "GJ143"
    ]
    assert columns == [(10, 11)]


@pytest.mark.parametrize(
    ("before", "wanted"),
    [
        ("ＬＩＮＥ　Ｘ１０．５　Ｙ＝－２", "LINE X10.5 Y=-2"),
        ("VEL 100；速度，ＬＩＮＥ", "VEL 100;速度，ＬＩＮＥ"),
        ("VEL 100 ; 速度；", "VEL 100 ; 速度；"),
        ("VEL 100／／速度；", "VEL 100//速度；"),
        ("；全部", ";全部"),
        ("　", " "),
        ("LET a = min（1，2）", "LET a = min(1,2)"),
        ("LET a = 2×(3÷4)−1", "LET a = 2*(3/4)-1"),
        ("IF 1 ≤ 2", "IF 1 <= 2"),
        ("VEL 100mm／s", "VEL 100mm/s"),
        ("ACC 5m/s²", "ACC 5m/s2"),
        ("LINE X 1 ACC 9mm/S²  Y 2", "LINE X 1 ACC 9mm/S2  Y 2"),
        ("LASER DELAY ON 50µs OFF 60μs", "LASER DELAY ON 50us OFF 60us"),
        ("FRAME ROTATE 30°", "FRAME ROTATE 30deg"),
        ("LASER POWER 30％", "LASER POWER 30%"),
        ("INCLUDE “ａ；b，.job”；c", 'INCLUDE "ａ；b，.job";c'),
        ("LINE X 10 mm", "LINE X 10mm"),
        ("LINE X 10 mm Y 2 \t um VEL 500 mm/s ACC 5 m/s2", "LINE X 10mm Y 2um VEL 500mm/s ACC 5m/s2"),
        ("LASER POWER 50 %", "LASER POWER 50%"),
        ("LINE X (2*5 mm)", "LINE X (2*5mm)"),
        ("LASER MODE DUTY CARRIER 10 KHZ", "LASER MODE DUTY CARRIER 10KHZ"),
        ("IF n = 1", "IF n == 1"),
        ("if n=1 and m＝2", "if n==1 and m==2"),
        ("IF n ＝＝ 1；一", "IF n == 1;一"),
    ],
)
def test_lines_that_read_then(before: str, wanted: str) -> None:
    assert corrected(before) == wanted
    assert corrected(before + "\r") == wanted + "\r"


@pytest.mark.parametrize(
    "line",
    [
        "LINE X 1O", "LNE X 1", "LINE X pitch", "LINE X 5²", "LINE X (s²)", "LET areas² = 3",
        "LINE X ½", "LINE X １ X ２", "WAIT。", "LINE X：5",
        "LINE X (n1 mm)", "VEL 5 mm", "LINE X 5 mm/s", "LET a == 1", "IF a =< 1", "IF a => 1", "IF a === 1",
        "INCLUDE “a.job",
        "LINE X 5 mmm", "LINE X mm", "５LINE", "LASER POWER 1e30 %", "LINE Xx １", "ＱＱ", "LINE X 1 5 mm",
    ],
)  # fmt: skip
def test_lines_that_need_a_guess(line: str) -> None:
    assert corrected(line) is None
    assert after(f"WAIT\n{line}\nWAIT\n") == f"WAIT\n{line}\nWAIT\n"


def test_full_width_is_what_unicode_says() -> None:
    """Of every ASCII character the one that Unicode calls its compatibility form."""
    for c in range(0xFF01, 0xFF5F):
        meant = unicodedata.normalize("NFKC", chr(c))
        if meant not in ';"/':
            assert normalized(f"A{chr(c)}B") == f"A{meant}B"
    assert normalized("A；Ｂ") == "A;Ｂ"
    assert normalized("A／Ｂ") == "A/B"
    assert normalized("A／／Ｂ") == normalized("A/／Ｂ") == "A//Ｂ"
    assert normalized("＂Ｂ＂Ｂ") == '"Ｂ"B'
    assert normalized("　") == unicodedata.normalize("NFKC", "　")


def test_time_lag_of_nothing() -> None:
    text = MARK + "LASER POWER 30\n  SKYWRITE MODE 2 TIMELAG {} SHIFT 5 ; off\nLASER ON\nLINE X 1\nLASER OFF\n"
    for zero in ("0", "0us", "0.0ms", "-0"):
        before = text.replace("{}", zero)
        if "GJ805" in codes_of(checked(before)):
            assert after(before) == text.replace("SKYWRITE MODE 2 TIMELAG {} SHIFT 5", "SKYWRITE OFF")
            assert calls(fix(before).loaded) == calls(checked(before))
    assert "GJ805" in codes_of(checked(text.replace("{}", "0us")))
    for other in ("0.1us", "(0)", "0.0001ms"):
        before = text.replace("{}", other)
        assert "GJ805" in codes_of(checked(before))
        assert after(before) == before


def test_all_at_once() -> None:
    before = (
        "\ufefflaser mode duty carrier 10 kHz\r\nVEL 100\r\nACC 5000；加速\r\nlaser delay on 60us off 50us\r\n"
        "laser power 30\r\nLASER ON\r\nLINE X 1 mm Y　２\r\n\r\n"
    )
    wanted = (
        "LASER MODE DUTY CARRIER 10kHz\r\nVEL 100\r\nACC 5000;加速\r\nLASER DELAY ON 60us OFF 60us\r\n"
        "LASER POWER 30\r\nLASER ON\r\nLINE X 1mm Y 2\r\nLASER OFF\r\n\r\n"
    )
    done = fix(before)
    assert done.data.decode() == wanted
    assert codes_of(done.loaded) == []
    assert done.count == 6


# What is refused.


@pytest.mark.parametrize(
    "text",
    [
        LIT + "LINE X 1\nREPEAT 2\nDWELL 1\n",  # It would land in the block.
        LIT + "LINE X 1\nDEF f()\nWAIT\n",
        LIT + "LINE X 1\nLASER 0FF\n",  # It may be there.
        LIT + "LINE X 1\nCALL of()\n",
        "WAIT\nLASER DELAY ON (50 + 10) OFF 50\n",
        "LET d = 50\nLASER DELAY ON 60 OFF (d)\nLASER DELAY ON (d) OFF (d)\n",
        "GT_BufLaserOn(1,0,0);\n",
    ],
)
def test_refused(text: str) -> None:
    loaded = checked(text)
    assert codes_of(loaded)
    done = apply_fixes(loaded, check, lambda _: True)
    assert (done.data.decode(), done.count) == (text, 0)
    assert done.loaded is loaded


def test_a_fix_that_causes_another_problem_is_rejected() -> None:
    """Light that is off again at once marks nothing: perhaps the LASER ON is too much. The others are made."""
    text = MARK + "LASER POWER 30\nLASER DELAY ON 60 OFF 50\nLINE X 1\nlaser ON\n"
    done = fix(text)
    assert done.data.decode() == text.replace("OFF 50", "OFF 60").replace("laser", "LASER")
    assert codes_of(done.loaded) == ["GJ401"]
    assert done.count == 2


def test_bad_ones_are_found_among_many(monkeypatch: pytest.MonkeyPatch) -> None:
    """By halves, where nothing says which of them it is."""
    lines = [f"LASER DELAY ON {i} OFF 5 ; {i}" for i in range(100, 164)]
    asked: list[bytes] = []

    def strict(data: bytes) -> FileResult:
        asked.append(data)
        found = check(data)
        for bad in (b"OFF 107", b"OFF 140", b"OFF 141"):
            if bad in data:
                found = with_a_misread_line(found, "\n" * 200 + "QQ\n")
        return found

    text = "\n".join(lines)
    done = apply_fixes(checked(text), strict, lambda _: True)
    bad = (107, 140, 141)
    assert done.data.decode().split("\n") == [
        line if i in bad else line.replace("OFF 5", f"OFF {i}") for i, line in enumerate(lines, 100)
    ]
    assert done.count == 61
    assert len(asked) < 40
    monkeypatch.setattr(apply, "MAX_CHECKS", 3)
    few = apply_fixes(checked(text), strict, lambda _: True)
    assert few.count < 61


def test_what_is_in_an_included_file_stays(tmp_path: Path) -> None:
    (tmp_path / "part.job").write_text("LASER DELAY ON 60 OFF 50\nline X 1\n")
    path = tmp_path / "top.job"
    path.write_text(MARK + 'INCLUDE "part.job"\nLASER DELAY ON 6 OFF 5\n')
    ran = gusjob("--fix", path)
    assert (tmp_path / "part.job").read_text() == "LASER DELAY ON 60 OFF 50\nline X 1\n"
    assert path.read_text() == MARK + 'INCLUDE "part.job"\nLASER DELAY ON 6 OFF 6\n'
    assert re.search(r"part.job:1:\d+: warning\[GJ306\]", ran.stdout)
    assert gusjob("--fix", tmp_path / "part.job").exit_code == 1  # Alone it has no VEL.
    assert (tmp_path / "part.job").read_text() == "LASER DELAY ON 60 OFF 60\nLINE X 1\n"


def test_a_light_from_an_included_file_stays_on(tmp_path: Path) -> None:
    (tmp_path / "part.job").write_text("LASER ON\n")
    path = tmp_path / "top.job"
    path.write_text(MARK + 'LASER POWER 3\nINCLUDE "part.job"\nLINE X 1\n')
    before = path.read_text()
    assert "GJ401" in gusjob("--fix", path).stdout
    assert path.read_text() == before


def test_faults_that_others_hide_are_no_new_ones() -> None:
    """A line that is read again, and a job that can be planned again, say what they could not say before."""
    text = LIT + "LASER ON；\nLINE X 500\nLINE X 5 END 50\n"
    done = fix(text)
    assert done.data.decode() == LIT + "LASER ON;\nLINE X 500\nLINE X 5 END 50\n"
    assert sorted(codes_of(done.loaded)) == ["GJ401", "GJ408", "GJ503"]
    done = fix(LIT + "LINE X 5 END 50\n")
    assert done.data.decode() == LIT + "LINE X 5 END 50\nLASER OFF\n"
    assert codes_of(done.loaded) == ["GJ510"]


@pytest.mark.parametrize("rest", ["LINE X 500\n", "LASER POWER 200\n", "LASER OFF CHANNEL 2\n"])
def test_light_stays_on_where_something_else_is_wrong(rest: str) -> None:
    """The file may be a part, or the LASER OFF be the statement that is wrong."""
    text = LIT + "LINE X 1\n" + rest
    assert has_errors(checked(text).diagnostics)
    assert after(text) == text


@pytest.mark.parametrize(
    ("part", "main", "include"),
    [
        ("part.job", "main.job", "part.job"),
        ("parts/a.job", "main.job", "./parts/a.job"),
        ("parts/a.job", "jobs/main.job", "..\\parts\\a.job"),
        ("deep/parts/a.job", "main.job", "deep/parts/a.job"),
    ],
)
def test_a_part_may_leave_the_light_on(tmp_path: Path, part: str, main: str, include: str) -> None:
    """It is clean where it is included: a LASER OFF at its end would leave half of the job unmarked."""
    text = LIT + "LINE X 1\n"
    for name in (part, main):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
    put(tmp_path, part, text)
    assert "1 fixed" in gusjob("--fix", tmp_path / part).stderr
    put(tmp_path, part, text)
    put(tmp_path, main, f'WAIT\nINCLUDE "{include}"\nLINE Y 10\nLASER OFF\n')
    if "/" in main:  # A job may only include what lies in its folder: this one is a part itself.
        put(tmp_path, "top.job", f'INCLUDE "{main}"\n')
    ran = gusjob("--fix", tmp_path)
    assert "0 fixed" in ran.stderr
    assert (tmp_path / part).read_text() == text


def test_every_fix_has_a_rule() -> None:
    assert set(FIXES) <= set(RULES)


# Time.


def test_a_shape_is_asked_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def counted(code: str) -> list[tuple[int, int]]:
        asked.append(code)
        return lower_case_keywords(code)

    lower_case_keywords = keyword_case.lower_case_keywords
    monkeypatch.setattr(keyword_case, "lower_case_keywords", counted)
    text = "\n".join(f"laser power {i}\nline X {i}.5mm" for i in range(20_000)).encode()
    assert sum(1 for _ in keyword_case.in_upper_case(text)) == 40_000
    assert len(asked) == 2
    assert not read_job_text(checked(b"LINE X 1mm ; line\nVEL 5mm/s\n").source).has_lower_case


def test_many_fixes_are_proved_together() -> None:
    """One check for as many diagnostics as are listed at once."""
    count = 1500
    text = "\n".join(f"LASER DELAY ON {i + 9} OFF {i}" for i in range(count))
    asked: list[int] = []

    def counted(data: bytes) -> FileResult:
        asked.append(1)
        return check(data)

    done = apply_fixes(checked(text), counted, lambda _: True)
    assert done.count == count
    assert done.data.decode() == "\n".join(f"LASER DELAY ON {i + 9} OFF {i + 9}" for i in range(count))
    assert len(asked) == 2


def test_lines_that_differ_in_numbers_only_are_fixed_together(monkeypatch: pytest.MonkeyPatch) -> None:
    """Far more lines than are listed: one check of the fixed text, and one line of each form is corrected."""
    count = 6000
    rows = [
        ("LINE X {0} mm Y {1} mm ; a {0}", "LINE X {0}mm Y {1}mm ; a {0}"),
        ("IF {0} = {1}", "IF {0} == {1}"),
        ("END # of {0}", "END ; of {0}"),
        ("VEL {0}.5 mm/s；{1}", "VEL {0}.5mm/s;{1}"),
        ("ACC {0} mm/s2", "ACC {0}mm/s2"),
        ("LINE X {0} foo", "LINE X {0} foo"),
        ("ACC {0} mm/s3", "ACC {0} mm/s3"),
    ]
    lines = [(old.format(i, i + 1), new.format(i, i + 1)) for i in range(count // 5) for old, new in rows[:5]]
    lines += [(old.format(i), new.format(i)) for i in range(3) for old, new in rows[5:]]
    asked: list[int] = []
    tried: list[str] = []

    def counted(data: bytes) -> FileResult:
        asked.append(1)
        return check(data)

    def corrected_one(text: str) -> str | None:
        tried.append(text)
        return corrected(text)

    monkeypatch.setattr("gusjob.diagnostics.fixes.similar_lines.corrected", corrected_one)
    done = apply_fixes(checked("\n".join(old for old, _ in lines)), counted, lambda _: True)
    assert done.data.decode().split("\n") == [new for _, new in lines]
    assert done.count == count
    assert len(asked) <= 2
    assert len(tried) <= len(rows)


def test_a_fix_keeps_the_line_ends_of_the_file(tmp_path: Path) -> None:
    """A CR alone stays one where the line is not changed."""
    path = tmp_path / "a.job"
    path.write_bytes(b"WAIT\rDWELL 5 ms ; a\r\nDWELL 6 ms\n\rWAIT")
    assert gusjob("--fix", path).exit_code == 0
    assert path.read_bytes() == b"WAIT\rDWELL 5ms ; a\r\nDWELL 6ms\n\rWAIT"


def test_a_search_without_success_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(apply, "MAX_CHECKS", 10)
    asked: list[int] = []

    def refuses(data: bytes) -> FileResult:
        asked.append(1)
        found = check(data)
        return with_a_misread_line(found, "\n" * 300 + "QQ\n")

    text = "\n".join(f"LASER DELAY ON {i + 9} OFF {i}" for i in range(200))
    done = apply_fixes(checked(text), refuses, lambda _: True)
    assert (done.count, done.data.decode()) == (0, text)
    assert len(asked) == 10


# Random jobs.

_UNIT = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
_OFF = re.compile(r"\s*LASER OFF(?: CHANNEL \d)?(?=\s|$)", re.IGNORECASE)


def code_of(line: str) -> str:
    return re.split(r";|//", line)[0]


def wide(rng: Random, text: str) -> str:
    """A text as an input method writes it."""
    share = rng.choice((0.1, 0.5, 1.0))
    found = [
        c if rng.random() > share or not c.isascii() or c == "\t" else "　" if c == " " else chr(ord(c) + 0xFEE0)
        for c in text
    ]
    return "".join(found)


def damaged(rng: Random, line: str) -> str:
    """A line with problems that have a fix and keep their meaning."""
    code = code_of(line)
    behind = line[len(code) :]
    match rng.randrange(5):
        case 0:
            return code.lower() + behind
        case 1:
            start = behind.replace(";", "；", 1) if behind.startswith(";") and rng.random() < 0.5 else behind
            return wide(rng, code) + start
        case 2 if "(" not in code and not code.upper().lstrip().startswith(("LET", "IF", "FOR", "REPEAT")):
            units = re.sub(rf"(?<=[0-9.])({_UNIT})(?![a-z0-9_])", r" \1", code, flags=re.IGNORECASE)
            return units.replace("us", rng.choice(("us", "µs"))) + behind
        case 3 if code.upper().lstrip().startswith("IF "):
            return code.replace("==", "=") + behind
        case _:
            return line


_TIME = r"(-?[0-9.]+(?:e[+-]?\d+)?(?:us)?)(?![\w.])"


def with_delays_raised(lines: list[str], at: set[int]) -> list[str]:
    """The change that the fix of GJ306 makes, made by hand in these lines (from 1) where both are numbers."""
    found = list(lines)
    for number in at:
        line = lines[number - 1]
        on = re.search(rf"\bON[ =]*{_TIME}", code_of(line), re.IGNORECASE)
        off = re.search(rf"\bOFF[ =]*{_TIME}", code_of(line), re.IGNORECASE)
        if on and off:
            found[number - 1] = line[: off.start(1)] + on[1] + line[off.end(1) :]
    return found


def calls(loaded: FileResult) -> str:
    stream = stream_in(loaded)
    return "" if stream is None else "".join(listing(stream))


@pytest.mark.slow
@given(st.integers(0, 2**32))
@settings(max_examples=EXAMPLES, phases=(Phase.explicit, Phase.reuse, Phase.generate), deadline=None)
def test_random_jobs(seed: int) -> None:
    rng = Random(seed)
    text = Writer(rng, odd=rng.choice((0, 0, 80))).job()
    whole = checked(text)
    assert whole.source is not None
    if read_job_text(whole.source).diagnostics:  # Something odd that can't be read.
        return
    original = text.splitlines()
    cut = len(original)
    if not has_errors(whole.diagnostics) and rng.random() < 0.6:  # Leave the light on.
        while cut and _OFF.fullmatch(code_of(original[cut - 1]).rstrip()):
            cut -= 1
        dark = checked("\n".join(original[:cut]) + "\n")
        # Where a LASER OFF has a warning of its own, it is not put there again.
        fair = codes_of(dark).count("GJ401") == len(original) - cut and not serious(whole) - serious(dark)
        cut = cut if fair else len(original)
    left_lit = checked("\n".join(original[:cut]) + "\n")
    broken = [damaged(rng, line) if rng.random() < 0.3 else line for line in original[:cut]]
    end = rng.choice(("\n", "\r\n"))
    last = rng.choice(("", end))
    before = end.join(broken) + last
    done = fix(before)
    # Fixing again changes nothing.
    again = fix(done.data)
    assert (again.data, again.count) == (done.data, 0)
    # It reads as the undamaged job, but for what is announced.
    left = {f.span.line for f in done.loaded.diagnostics if f.rule.code == "GJ306"}
    told = {f.span.line for f in whole.diagnostics if f.rule.code == "GJ306"}
    wanted = with_delays_raised(original, told - left)
    still = {f.fields["channel"] for f in done.loaded.diagnostics if f.rule.code == "GJ401"}
    lit = sorted(f.fields["channel"] for f in left_lit.diagnostics if f.rule.code == "GJ401")
    wanted = wanted[:cut] + [f"LASER OFF CHANNEL {channel}" for channel in lit if channel not in still]
    made = done.data.decode().replace("\r\n", "\n").split("\n")
    for got, want in zip(made[:cut], wanted[:cut], strict=True):
        if "TIMELAG" in want.upper() and "TIMELAG" not in got:  # Which was 0.
            assert "SKYWRITE OFF" in got
        else:
            assert got.upper() == want.upper()
    assert bool(last) == done.data.endswith(b"\n")
    assert done.data.count(b"\r\n") == (done.data.count(b"\n") if end == "\r\n" else 0)
    reference = checked("\n".join(wanted) + "\n")
    assert "GJ143" not in codes_of(done.loaded)
    known = serious(reference)
    for code, line in list(known):
        if code == "GJ805" and (code, line) not in serious(done.loaded):
            del known[code, line]
    assert serious(done.loaded) == known
    assert calls(done.loaded) == calls(reference)


def test_most_random_jobs_are_fixed() -> None:
    """Else the test above would test little."""
    found: Counter[str] = Counter()
    for seed in range(60):
        rng = Random(seed)
        lines = [damaged(rng, line) for line in Writer(rng).job().splitlines()]
        loaded = checked("\n".join(lines))
        found += Counter(set(codes_of(loaded)) - set(codes_of(apply_fixes(loaded, check, lambda _: True).loaded)))
    assert min(found[code] for code in ("GJ101", "GJ102", "GJ143", "GJ306")) > 2


FILES = sorted(p for folder in ("jobs", "tests/good", "tests/bad") for p in (ROOT / folder).rglob("*.job"))


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
def test_files_lose_nothing_but_the_fault(path: Path) -> None:
    profile = path.with_suffix(".machine.toml")
    profile_or_none = profile if profile.exists() else None

    def check_there(data: bytes) -> FileResult:
        return load(path, profile_or_none, data=data)

    loaded = examine(check(path.read_bytes(), path, profile_or_none))
    done = apply_fixes(loaded, check_there, lambda _: True)
    if "bad" not in path.parts:
        assert (done.count, done.data) == (0, loaded.source.data)
        return
    read_before = not any(f.rule.code in ("GJ101", "GJ102") for f in loaded.diagnostics)
    if read_before and not has_errors(loaded.diagnostics):
        assert not serious(done.loaded) - serious(loaded)
        if not {"GJ306"} & set(codes_of(loaded)):
            assert calls(done.loaded) == calls(loaded)
    again = apply_fixes(done.loaded, check_there, lambda _: True)
    assert (again.count, again.data) == (0, done.data)


# The command.


def gusjob(*args: object) -> Result:
    return CliRunner().invoke(cli, ["check", *map(str, args)], catch_exceptions=False)


def put(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.parent.mkdir(exist_ok=True, parents=True)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


LEFT = LIT + "LINE X 1\n"
DONE = LEFT + "LASER OFF\n"


def test_fix_writes_and_shows_what_is_left(tmp_path: Path) -> None:
    path = put(
        tmp_path, "a.job", b"\xef\xbb\xbf" + (LEFT + "laser off\nLASER POWER 200\n").replace("\n", "\r\n").encode()
    )
    ran = gusjob("--fix", path)
    assert path.read_bytes() == b"\xef\xbb\xbf" + (LEFT + "LASER OFF\nLASER POWER 200\n").replace("\n", "\r\n").encode()
    assert ran.exit_code == 1
    assert "GJ143" not in ran.stdout
    assert "a.job:8:13: error[GJ201]" in ran.stdout
    assert ran.stderr.splitlines()[-1].endswith("; 1 fixed")
    path.write_text(LEFT)
    ran = gusjob("--fix", path)
    assert (ran.exit_code, ran.stdout, ran.stderr) == (0, "", "1 file: clean; 1 fixed\n")
    assert path.read_text() == DONE
    os.utime(path, (1, 1))
    ran = gusjob("--fix", path)
    assert (ran.exit_code, ran.stderr) == (0, "1 file: clean; 0 fixed\n")
    assert path.stat().st_mtime == 1


def test_diff_writes_nothing(tmp_path: Path) -> None:
    path = put(tmp_path, "a.job", LEFT)
    put(tmp_path, "b.job", DONE)
    ran = gusjob("--diff", tmp_path)
    assert ran.exit_code == 1
    assert ran.stdout == f"--- {path}\n+++ {path}\n@@ -4,3 +4,4 @@\n LASER POWER 30\n LASER ON\n LINE X 1\n+LASER OFF\n"
    assert ran.stderr == "2 files: clean; 1 can be fixed\n"
    assert path.read_text() == LEFT
    assert gusjob("--diff", "--fix", tmp_path).stdout == ran.stdout
    assert path.read_text() == LEFT
    ran = gusjob("--diff", tmp_path / "b.job")
    assert (ran.exit_code, ran.stdout) == (0, "")
    other = put(tmp_path, "c.job", "LINE X 1\n")
    ran = gusjob("--diff", other)  # Nothing to fix: diagnostics as in check, none in the patch.
    assert (ran.exit_code, ran.stdout) == (1, "")
    assert "GJ501" in ran.stderr


def test_the_diff_has_both_ends() -> None:
    from gusjob.frontend.format.unified_diff import unified_diff

    def shown(before: bytes, new: bytes) -> list[str]:
        return b"".join(unified_diff("a", before, new)).decode().splitlines()[2:]

    assert shown(b"A", b"A\nB") == [
        "@@ -1,1 +1,2 @@", "-A", "\\ No newline at end of file", "+A", "+B", "\\ No newline at end of file",
    ]  # fmt: skip
    assert shown(b"A\n", b"A\nB\n") == ["@@ -1,1 +1,2 @@", " A", "+B"]
    assert shown(b"A\n\n", b"A\nB\n\n") == ["@@ -1,2 +1,3 @@", " A", "-", "+B", "+"]


def test_only_selected_rules_are_fixed(tmp_path: Path) -> None:
    text = LEFT.replace("VEL", "vel") + "LASER DELAY ON 60 OFF 50\n"
    path = put(tmp_path, "a.job", text)
    gusjob("--fix", "--select", "GJ306", path)
    assert path.read_text() == text.replace("OFF 50", "OFF 60")
    gusjob("--fix", "--ignore", "GJ401,GJ143", path)
    assert path.read_text() == text.replace("OFF 50", "OFF 60")
    ran = gusjob("--diff", "--ignore", "GJ4", path)
    assert "+VEL 100" in ran.stdout
    assert "LASER OFF" not in ran.stdout
    gusjob("--fix", "--ignore", "GJ143", path)
    assert path.read_text() == text.replace("OFF 50", "OFF 60") + "LASER OFF\n"


def test_fix_with_formats(tmp_path: Path) -> None:
    path = put(tmp_path, "a.job", LEFT)
    assert gusjob("--diff", "--format", "json", path).exit_code == 2
    assert gusjob("--diff", "--statistics", path).exit_code == 2
    assert path.read_text() == LEFT
    ran = gusjob("--fix", "--format", "json", path)
    assert ran.exit_code == 0
    assert '"diagnostics":[]' in ran.stdout.replace(" ", "").replace("\n", "")
    assert ran.stderr.splitlines()[-1].endswith("; 1 fixed")
    assert path.read_text() == DONE


def test_folders_and_the_same_file_twice(tmp_path: Path) -> None:
    for name in ("in/a.job", "in/b.JOB", "in/deep/c.job", "in/.hidden/d.job"):
        put(tmp_path, name, LEFT)
    listed = put(tmp_path, "in/a.gts", "gt_buflaseron(1,0,0);\nGT_BufDelay(1,010,0);\n")
    ran = gusjob("--fix", tmp_path / "in", tmp_path / "in" / "a.job", tmp_path / "in" / ".." / "in" / "a.job")
    assert ran.stderr.splitlines()[-1].startswith("4 files:")
    assert ran.stderr.splitlines()[-1].endswith("; 3 fixed")
    assert (tmp_path / "in/deep/c.job").read_text() == (tmp_path / "in/b.JOB").read_text() == DONE
    assert (tmp_path / "in/.hidden/d.job").read_text() == LEFT
    assert listed.read_text() == "gt_buflaseron(1,0,0);\nGT_BufDelay(1,010,0);\n"


def test_a_profile_with_faults_is_not_touched(tmp_path: Path) -> None:
    path, profile = put(tmp_path, "a.job", LEFT), put(tmp_path, "gusjob.toml", "pulses = 3\n")
    assert gusjob("--fix", path).exit_code == 1
    assert path.read_text() == LEFT
    assert profile.read_text() == "pulses = 3\n"


def test_a_file_that_changes_meanwhile_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path, "a.job", LEFT)

    def saves(data: bytes, name: str, where: Path | None = None) -> object:
        path.write_text("; mine\n")
        return check_text(data, name, where)

    monkeypatch.setattr("gusjob.frontend.check_text", saves)
    ran = gusjob("--fix", path)
    assert ran.exit_code == 2
    assert f"gusjob: {path}: can't write: the file was changed in the meantime" in ran.stderr
    assert "GJ401" in ran.stdout
    assert ran.stderr.splitlines()[-1].endswith("; 0 fixed")
    assert path.read_text() == "; mine\n"


@pytest.mark.skipif(sys.platform == "win32", reason="links and permissions of POSIX")
def test_links_stay_and_what_may_not_be_written_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = put(tmp_path, "far/a.job", LEFT)
    link = tmp_path / "link.job"
    link.symlink_to(path)
    assert gusjob("--fix", link).exit_code == 0
    assert link.is_symlink()
    assert path.read_text() == DONE
    path.write_text(LEFT)
    path.chmod(0o444)
    # Who may write all can't be refused otherwise.
    monkeypatch.setattr(os, "access", lambda _path, mode, **_options: mode != os.W_OK)
    ran = gusjob("--fix", path)
    assert (ran.exit_code, path.read_text()) == (2, LEFT)
    assert "can't write: permission denied" in ran.stderr
    assert gusjob("--diff", path).exit_code == 1


def test_a_line_too_long_is_left_alone() -> None:
    text = "wait ;" + "c" * MAX_LINE + "\nwait\n"
    done = fix(text)
    assert done.data.decode() == text.replace("\nwait", "\nWAIT")


# The number of fixes in the summary of a check without --fix.


@pytest.mark.parametrize("name", [path.name for path in bad_files() if path.suffix == ".job"])
def test_the_summary_says_how_many_fixes_there_are(tmp_path: Path, name: str) -> None:
    """As many as --fix makes then."""
    folder = tmp_path / "bad"
    shutil.copytree(BAD, folder)
    profile = (folder / name).with_suffix(".machine.toml")
    machine = ["--machine", profile] if profile.exists() else []
    before = gusjob(*machine, folder / name).stderr.splitlines()[-1]
    promised = re.search(r"; (\d+) can be corrected with --fix$", before)
    after = gusjob(*machine, "--fix", folder / name).stderr.splitlines()[-1]
    assert after.endswith(f"; {promised[1] if promised else 0} fixed")


def test_some_of_the_bad_files_can_be_fixed(tmp_path: Path) -> None:
    text = "laser mode duty carrier 10 kHz\n" + LIT.partition("\n")[2] + "LASER DELAY ON 60 OFF 50\nLINE X 1\nQQ\n"
    path = put(tmp_path, "a.job", text)
    assert gusjob(path).stderr.endswith("; 3 can be corrected with --fix\n")
    assert gusjob("--ignore", "GJ143", path).stderr.endswith("; 2 can be corrected with --fix\n")
    assert gusjob("--select", "GJ102", path).stderr.endswith("\n")
    assert "--fix" not in gusjob("--select", "GJ102", path).stderr


def test_a_clean_or_large_file_is_checked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Path] = []

    def counted(path: Path, *_: object, **__: object) -> FileResult:
        asked.append(path)
        raise AssertionError

    monkeypatch.setattr(fixes, "load", counted)
    assert gusjob(put(tmp_path, "a.job", DONE)).stderr == "1 file: clean\n"
    large = gusjob(put(tmp_path, "b.job", LEFT + "; why\n" * 50_000))
    assert large.stderr == "1 file: 1 error; --fix may correct some\n"
    assert not asked


@pytest.mark.parametrize(
    ("text", "fixed"),
    [
        ("LASER MODE DUＴＹ2 CARRIER 10kHz\n", "LASER MODE DUTY2 CARRIER 10kHz\n"),
        ("LASER MODE ＤＵＴＹ２ CARRIER 10kHz\n", "LASER MODE DUTY2 CARRIER 10kHz\n"),
        ("ACC 5000mm／s2\n" * 2, "ACC 5000mm/s2\n" * 2),
        ("LASER POWER 1.5e+０1\n", "LASER POWER 1.5e+01\n"),
        ("LASER POWER 1.5e－0１\n", "LASER POWER 1.5e-01\n"),
        ("LASER POWER 1.5Ｅ+1\n", "LASER POWER 1.5E+1\n"),
        ("LINE X 5 VEL 40mm/s ACC 5000mm／ｓ2\n" * 2, "LINE X 5 VEL 40mm/s ACC 5000mm/s2\n" * 2),
        ("LINE X 5 VEL 1ｍ/s ACC 5m/ｓ² END 3mm／s\n" * 2, "LINE X 5 VEL 1m/s ACC 5m/s2 END 3mm/s\n" * 2),
    ],
)
def test_full_width_words_with_digits_keep_the_numbers_behind_them(text: str, fixed: str) -> None:
    assert after(text) == fixed
