"""One cause gives one error: statements of sound jobs, damaged in each typical way, have their own error and no other.

PROPERTY_EXAMPLES raises the number of damaged jobs; 100000 tries them all.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest
from support.tools import MARK, ROOT

from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords
from gusjob.frontend.parse.statement_parser import strip_comment
from gusjob.pipeline import Checked, load

EXAMPLES = int(os.environ.get("PROPERTY_EXAMPLES", "40"))
FILES = sorted([*(ROOT / "tests" / "good").glob("*.job"), *(ROOT / "jobs").rglob("*.job")])
TOKEN = re.compile(r'"[^"]*"|[A-Za-z_]\w*|[0-9.]+(?:[a-zA-Z%][\w/%]*)?|\([^()]*(?:\([^()]*\)[^()]*)*\)|\S')
NUMBER = re.compile(r"([0-9.]+)([a-zA-Z%].*)?$")
LIT = MARK + "LASER POWER 30\nLASER ON\n"

TWO_CAUSES = (
    ("huge", r"JUMP X .* Y"),  # In a rotated frame both words leave the field.
    ("zero", r"LASER POWER .* CHANNEL 0"),  # The power of one channel is given to the other.
    ("negative", r"ARC"),  # The arc ends elsewhere, and the next line marks the same line or nothing.
)
"""Damages that are two errors: kind of damage, and the line."""


def damages(line: str) -> Iterator[tuple[str, str]]:
    """The line with one word misspelt, missing or doubled, or one number missing, wrong or in a wrong unit."""
    code = strip_comment(line)
    known = keywords(JOB_GRAMMAR)
    tokens = [(m.start(), m.end(), m[0]) for m in TOKEN.finditer(code)]
    for i, (start, end, text) in enumerate(tokens):
        if text.upper() in known:
            changes = [("letter", text[:-1]), *([("drop", "")] if i else [])]
            if i and i + 1 < len(tokens):
                changes.append(("double", f"{text} {tokens[i + 1][2]} {text}"))
        elif found := NUMBER.match(text):
            value, unit = found[1], found[2] or ""
            wrong = "mm" if unit == "V" else "V"
            changes = [("missing", ""), ("huge", f"{value}e9{unit}"), ("zero", f"0{unit}"), ("unit", value + wrong)]
            changes += [("blank", f"{value} kg"), ("negative", f"-{text}")]
        else:
            continue
        for kind, new in changes:
            yield kind, code[:start] + new + code[end:] + line[len(code) :]


def serious(path: Path, lines: list[str]) -> list[Diagnostic]:
    loaded = load(path, data="\n".join(lines).encode())
    assert isinstance(loaded, Checked)
    return [found for found in loaded.diagnostics if found.severity is not Severity.NOTE]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_damaged_statement_has_one_error(path: Path) -> None:
    lines = path.read_text(encoding="utf-8").split("\n")
    assert serious(path, lines) == []
    every = [(n, kind, new) for n, line in enumerate(lines) for kind, new in damages(line)]
    for n, kind, new in Random(path.stem).sample(every, min(EXAMPLES // 2, len(every))):
        if any(kind == other and re.match(line, new.strip()) for other, line in TWO_CAUSES):
            continue
        found = serious(path, [*lines[:n], new, *lines[n + 1 :]])
        own = [d for d in found if d.span.line == n + 1 and d.severity is Severity.ERROR]
        if own:  # Otherwise the damaged statement is correct in itself.
            assert [d.message for d in found if d not in own] == [] or all(
                d.span.line == n + 1 and d.severity is Severity.WARNING for d in found if d not in own
            ), (kind, new)
            assert len(own) == 1, (kind, new)


HEADER = "LASER MODE DUTY CARRIER 10\nVEL 100\nACC 5000\nLASER POWER 30\nLASER ON\nLINE X 5\nLASER OFF\n"


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("LASER MODE DUTY CARRIER 10", "LASER MODE DUTY"),
        ("LASER MODE DUTY CARRIER 10", "LASER MODE DUTY CARRIER 1e6"),
        ("LASER MODE DUTY CARRIER 10", "LASER MODE DUTTY CARRIER 10"),
        ("LASER MODE DUTY CARRIER 10", "MODE DUTY CARRIER 10"),
        ("LASER OFF", "LASER OF"),
        ("LASER OFF", "LASR OFF"),
        ("LASER OFF", "LASEROFF"),
        ("LASER ON", "LASER ONN"),
        ("LASER POWER 30", "LASER POWER 30mm"),
        ("LASER POWER 30", "LASER POWR 30"),
        ("VEL 100", "VEL 100mmm/s"),
        ("ACC 5000", "AC 5000"),
        ("LINE X 5", "LINE X 5000\nLINE Y 1\nLINE Y 2"),
        ("LINE X 5", "LINE X 1O\nARC CW X 50 Y 3 R 1"),
        ("LINE X 5", "LET a =\nLINE X (a)\nARC CW X 50 Y 3 R 1"),
        ("LINE X 5", "LETT a = 3\nLINE X (a)"),
        ("LINE X 5", "a = 3\nLINE X (a)"),
        ("LINE X 5", 'INCLUDE "no_such.job"\nLINE X (a)\nCALL f(3)'),
        ("LINE X 5", "DEF f(a, a)\nLINE X (a)\nEND\nCALL f(3)"),
        ("LINE X 5", "CALL f(3)\nARC CW X 50 Y 3 R 1"),
        ("LINE X 5", "REPEAT 3 AS\nLINE X (i) Y 3\nEND"),
        ("LINE X 5", "FORR i FROM 1 TO 3\nLINE X (i) Y 3\nEND"),
        ("LINE X 5", "IF 1 = 1\nLINE X 3 Y 3\nELSE\nLASER OFF\nEND"),
        ("LINE X 5", "WHILE 1 == 1\nLINE X 3\nEND"),
        ("LINE X 5", "REPEAT 3\nLINE X 3\nEDN"),
        ("LINE X 5", "FRAME SCALE\nLINE X 300 Y 3\nEND"),
        ("LINE X 5", "UNITS PULS\nLINE X 10000"),
        ("LINE X 5", "COORDS RELL\nLINE X 149\nLINE X 149"),
        ("VEL 100", "CHANNEL 2\nVEL 100"),
        ("VEL 100", "CHANEL 1\nVEL 100"),
    ],
)
def test_a_faulty_statement_counts_as_present(before: str, after: str) -> None:
    text = HEADER.replace(before, after, 1)
    assert text != HEADER
    found = serious(Path("a.job"), text.splitlines())
    assert [d.severity for d in found] == [Severity.ERROR], [d.message for d in found]


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        (LIT + "LINE X 1O\nLINE X 5\n", {"GJ101", "GJ401"}),
        (LIT + "LASER OF\nLASER ON\nLINE X 5\n", {"GJ101", "GJ401"}),
        (MARK + "LINE Y 1O\nLINE X 500\n", {"GJ101", "GJ503"}),
        (MARK + "QQ\nLASER POWER 101\n", {"GJ102", "GJ201"}),
        ("VELL 100\nLINE X 5\n", {"GJ102", "GJ502"}),
        ("LASER MODE DUTY\nLASER ON CHANNEL 1\nLASER OFF CHANNEL 1\n", {"GJ104"}),
        ("LASER MODE DUTY CHANNEL 0\nLASER ON CHANNEL 1\nLASER OFF CHANNEL 1\n", {"GJ104", "GJ309"}),
        (LIT + "LINE X 500\nLINE X 600\nLASER OFF\n", {"GJ503"}),
    ],
)
def test_other_causes_are_still_reported(text: str, codes: set[str]) -> None:
    assert {d.rule.code for d in serious(Path("a.job"), text.splitlines())} == codes
