"""Line ends, characters that hide text, and letters outside ASCII: all of Unicode, in jobs, listings and profiles."""

from __future__ import annotations

import re
import sys
import unicodedata
from pathlib import Path
from random import Random

import pytest

from gusjob.config.profile import parse_profile
from gusjob.diagnostics.characters import report_hidden
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.format import format_text
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, LISTING_GRAMMAR, parser
from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.frontend.parse.statement_parser import parse_statement
from gusjob.frontend.source import Source
from gusjob.i18n.characters import quoted
from gusjob.pipeline import Parsed, examine_file

BIDI_CONTROLS = {0x61C, 0x200E, 0x200F, *range(0x202A, 0x202F), *range(0x2066, 0x206A)}
"""Unicode's PropList.txt, Bidi_Control."""
EVERY = [chr(c) for c in range(1, sys.maxunicode + 1) if not 0xD800 <= c < 0xE000]
JOB = """LASER MODE DUTY CARRIER 10kHz
VEL 100 ; of the ink
ACC 10000
LASER POWER 40 ; base
LASER POWER 10
LASER ON
LINE X 10 mm ; a slip
LINE X 10 Y 5
LASER OFF
LASER ON ; allow GJ404: it only warms up
DWELL 5
LASER OFF
"""
LISTING = "GT_CrdClear(1,0); // base\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,1,2,x,4,0,0);\n/* a\nb */ GT_CrdStart(1,0);\n"
PROFILE = 'name = "a" # the name\nperiod_us = 0\n[[laser]]\nchannel = 7\n'


def found_in(text: str, name: str = "a.job") -> list[Diagnostic]:
    return list(examine_file(Path("/nowhere") / name, data=text.encode()).diagnostics)


def placed(diagnostics: list[Diagnostic]) -> list[tuple[str, int, int, int, str]]:
    return [(d.rule.code, d.span.line, d.span.column, d.span.end_column, d.message) for d in diagnostics]


def with_ends(text: str, rng: Random) -> str:
    """The same lines with other ends."""
    ends = rng.choice((["\r"], ["\r", "\n"], ["\r", "\r\n", "\n"]))
    return re.sub("\n", lambda _: rng.choice(ends), text)


@pytest.mark.parametrize("seed", range(20))
def test_lines_end_at_cr_lf_and_both(seed: int) -> None:
    """LF, CR LF and CR end the same lines, in jobs, listings and profiles."""
    rng = Random(seed)
    job, listing, profile = (with_ends(text, rng) for text in (JOB, LISTING, PROFILE))
    # A CR before an LF is one end: no line of these texts is empty, so each end is one of its own.
    assert placed(found_in(job)) == placed(found_in(JOB))
    assert placed(found_in(listing, "a.gts")) == placed(found_in(LISTING, "a.gts"))
    assert placed(list(parse_profile(profile).diagnostics)) == placed(list(parse_profile(PROFILE).diagnostics))
    assert {d.rule.code for d in found_in(JOB)} >= {"GJ101"}
    good, bad = JOB.replace("10 mm", "10mm"), job.replace("10 mm", "10mm")
    formatted, _ = format_text(bad)
    assert formatted is not None
    assert formatted.replace("\r\n", "\n") == format_text(good)[0]


def test_the_statement_behind_a_cr_counts() -> None:
    """`LASER POWER 40 ; base<CR>LASER POWER 10` is two statements."""
    text = read_job_text(Source(name="a.job", data=b"LASER POWER 40 ; base\rLASER POWER 10\n\r\rWAIT"))
    assert text.rows.line.tolist() == [1, 2, 5]


def test_a_source_keeps_what_was_written() -> None:
    source = Source(name="a.job", data=b"A\rB\r\nC\n\rD")
    assert (source.data, source.as_written) == (b"A\nB\r\nC\n\nD", b"A\rB\r\nC\n\rD")
    assert source.lines_as_written() == [b"A\r", b"B\r\n", b"C\n", b"\r", b"D"]
    assert [source.line(n) for n in range(1, 6)] == ["A", "B", "C", "", "D"]
    plain = Source(name="a.job", data=b"A\r\nB\n")
    assert plain.as_written is plain.data


def hides(character: str) -> bool:
    """By Unicode's categories: controls but the tab and line ends, separators of lines, and Bidi_Control."""
    if character in "\t\n\r":
        return False
    return unicodedata.category(character) in ("Cc", "Zl", "Zp") or ord(character) in BIDI_CONTROLS


def test_every_character_that_hides_text_is_reported_in_comments() -> None:
    data = "".join(f"; {c}\n" for c in EVERY if c not in "\n\r").encode()
    expected = [c for c in EVERY if hides(c)]
    found = report_hidden(data, "a.job")
    assert [d.fields["character"] for d in found] == [f"U+{ord(c):04X}" for c in expected]
    assert {(d.span.column, d.span.end_column, d.rule.code) for d in found} == {(3, 4, "GJ007")}
    lines = [c for c in EVERY if c not in "\n\r"]
    assert [lines[d.span.line - 1] for d in found] == expected


@pytest.mark.parametrize("character", [c for c in EVERY[:0x3000] if hides(c)])
def test_one_diagnostic_for_one_character(character: str) -> None:
    """In the code, in a comment, in a string and alone on a line; in jobs, listings and profiles."""
    for text in ("LINE X 1{}Y 2\n", "WAIT ; a{}b\n", 'INCLUDE "a{}b"\n', "{}\n", "WAIT{}\n"):
        errors = [d for d in found_in(text.format(character)) if d.severity.value == "error"]
        assert [d.rule.code for d in errors] == ["GJ007"], text
    for text in ("GT_CrdClear(1,{}0);\n", "GT_CrdClear(1,0); // a{}b\n", 'char s[] = "a{}b";\n', "/* {} */\n"):
        errors = [d for d in found_in(text.format(character), "a.gts") if d.severity.value == "error"]
        assert [d.rule.code for d in errors] == ["GJ007"], text
    for text in ('name = "a{}b"\n', "# a{}b\n", "period_us = {}250\n"):
        assert [d.rule.code for d in parse_profile(text.format(character)).diagnostics] == ["GJ007"], text


def test_no_letter_outside_ascii_is_one_of_a_keyword() -> None:
    """All terminals of the grammars against all of Unicode: only a string in quotes has others."""
    others = "".join(c for c in EVERY if not c.isascii())
    for grammar in (JOB_GRAMMAR, LISTING_GRAMMAR):
        lark = parser(grammar)
        flags = lark.options.g_regex_flags
        for terminal in lark.terminals:
            pattern = re.compile(terminal.pattern.to_regexp(), flags)
            if terminal.name != "ELIDED":  # Dots between calls.
                assert pattern.search(others) is None, terminal.name
        # Within a word: each letter of a pattern with /i takes its two cases only.
        for letter in "abcdefghijklmnopqrstuvwxyz":
            assert len(re.findall(letter, "".join(EVERY), flags | re.IGNORECASE)) == 2


def is_odd(character: str) -> bool:
    """Characters that Python may take for a letter, digit or blank of ASCII."""
    folded = {character.casefold(), character.upper(), character.lower(), unicodedata.normalize("NFKC", character)}
    like_ascii = any(any(c.isascii() for c in text) for text in folded)
    return not character.isascii() and (character.isspace() or character.isdecimal() or like_ascii)


ODD = [c for c in EVERY if is_odd(c)]
ODD_PLACES = ("LINE X 1{}", "LINE X{}1", "{}LINE X 1", "L{}NE X 1", "LINE{}X 1", "LINE X {}", "LINE X 1{}m Y 2", "{}")


@pytest.mark.parametrize("place", ODD_PLACES)
def test_the_scan_and_the_parser_agree_on_odd_characters(place: str) -> None:
    """A line of each odd character: none can be read, neither by lark nor by the scan of line shapes."""
    assert len(ODD) > 1000
    letters = [c for c in ODD if unicodedata.normalize("NFKC", c) in ("s", "S", "k", "K", "i", "I")]
    some = [*letters, *Random(place).sample(ODD, 250)]
    lines = [place.format(c) for c in some]
    statements = [parse_statement(line, 1) for line in lines]
    assert all(statement is None and found for statement, found in statements)
    text = read_job_text(Source(name="a.job", data="\n".join(["LINE X 1", *lines, "LINE X 2"]).encode()))
    assert text.diagnostics_not_listed == 0
    assert [d.span.line for d in text.diagnostics if d.rule.code != "GJ007"] == [
        number for number, c in enumerate(some, 2) if not hides(c)
    ]


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("mm", "'mm'"),
        ("a b", "'a b'"),
        ("\u00a0", "U+00A0 (NO-BREAK SPACE)"),
        ("\u200b", "U+200B (ZERO WIDTH SPACE)"),
        ("\x07", "U+0007"),
        ("\u0425", "'\u0425' (U+0425)"),
        ("L\u0131NE", "'L\u0131NE' (U+0131)"),
        ("a\u00a0b", "'a<U+00A0>b'"),
        ("\u3164", "U+3164 (HANGUL FILLER)"),
    ],
)
def test_what_is_not_seen_is_named(text: str, shown: str) -> None:
    assert quoted(text) == shown


def test_a_clean_text_of_another_script_stays() -> None:
    text = "WAIT ; 激光 é 😀 \u3000 — “a” \u200b\u200d\ufe0f\n"
    assert not found_in(text)
    assert isinstance(examine_file(Path("/nowhere/a.job"), data=text.encode()), Parsed)
