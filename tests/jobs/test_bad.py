"""Every diagnostic is at its line and nowhere else: `; error: CODE` on a line of a bad file expects just that one."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import pytest
from support.faulty import BAD, bad_files, diagnostics_of_file

from gusjob.diagnostics import rules
from gusjob.diagnostics.formats.text import diagnostic_text
from gusjob.diagnostics.rules import RULES
from gusjob.frontend import check_text, read_job, read_source

_MARK = re.compile(r"(error|warning|note): (GJ\d+)")
Found = Counter[tuple[int, str, str]]

ELSEWHERE = {
    "GJ001",
    "GJ002",
    "GJ003",
    "GJ004",
    "GJ005",
    "GJ006",
    "GJ147",
    "GJ160",
    *(code for code in RULES if code[:3] == "GJ9"),
}
"""Rules about a whole file, with tests of their own below and in test_cli; about -D: tests/frontend/test_overrides.py;
about runs: tests/hardware."""


def expected_in(path: Path) -> Found:
    lines = path.read_text(encoding="utf-8").split("\n")
    return Counter((n, *mark) for n, line in enumerate(lines, 1) for mark in _MARK.findall(line))


@pytest.mark.parametrize("path", bad_files(), ids=lambda p: p.name)
def test_a_file_has_just_the_expected_diagnostics(path: Path) -> None:
    found = Counter((f.span.line, f.severity.value, f.rule.code) for f in diagnostics_of_file(path))
    assert found == expected_in(path)


def test_every_rule_has_a_file() -> None:
    marked = {code for path in bad_files() for _, _, code in expected_in(path)}
    assert marked | ELSEWHERE == set(RULES)
    assert not marked & ELSEWHERE


@pytest.mark.parametrize("path", bad_files(), ids=lambda p: p.name)
def test_messages_and_spans_are_complete(path: Path) -> None:
    """Every template gets all its fields, and every span is within its line."""
    source, _ = read_source(path)
    assert source is not None
    for diagnostic in diagnostics_of_file(path):
        text = diagnostic_text(diagnostic, lambda span, _: source.line(span.line), color=False)
        assert "{" not in diagnostic.message
        assert diagnostic.rule.code in text
        line = source.line(diagnostic.span.line)
        assert 1 <= diagnostic.span.column <= len(line) + 1
        assert diagnostic.span.end_column <= len(line) + 2


def test_a_caret_is_under_the_value() -> None:
    path = BAD / "units.job"
    source, _ = read_source(path)
    assert source is not None
    diagnostic = next(f for f in diagnostics_of_file(path) if f.rule is rules.WRONG_UNIT)
    text = diagnostic_text(diagnostic, lambda span, _: source.line(span.line), color=False).splitlines()
    assert text[1].index("20kHz") == text[2].index("^^^^^")


def test_a_misspelt_word_gets_a_hint() -> None:
    messages = {f.span.line: f.message for f in diagnostics_of_file(BAD / "words.job")}
    assert "did you mean LINE?" in messages[4]


def test_many_diagnostics_are_counted_not_listed() -> None:
    text = "LASER MODE DUTY CARRIER 10\nVEL 1\nACC 1\n" + "LASER POWER 200\n" * 5000 + "QQ 1\n" * 3000
    from gusjob.config.machine import Machine
    from gusjob.lint import check

    source, _ = check_text(text.encode(), "a.job")
    assert source is not None
    job, diagnostics = read_job(source, Machine())
    assert sum(f.rule is rules.UNKNOWN_STATEMENT for f in diagnostics) == 1000
    assert [f.fields["count"] for f in diagnostics if f.rule is rules.NOT_LISTED] == [2000]
    checked = check(job, Machine())
    assert sum(f.rule is rules.OUT_OF_RANGE for f in checked) == 1000
    assert [f.fields["count"] for f in checked if f.rule is rules.NOT_LISTED] == [4000]


@pytest.mark.parametrize(
    ("line", "code"),
    [("LASER POWER 5V", "GJ203"), ("VEL 0", "GJ201"), ("VEL 20000", "GJ504")],
)
def test_every_rule_counts_what_it_does_not_list(line: str, code: str) -> None:
    from gusjob.config.machine import Machine
    from gusjob.lint import check

    source, _ = check_text(f"LASER MODE DUTY CARRIER 10\nVEL 1\nACC 1\n{(line + chr(10)) * 1500}".encode(), "a.job")
    assert source is not None
    found = check(read_job(source, Machine())[0], Machine())
    listed = sum(f.rule.code == code for f in found)
    more = sum(f.fields["count"] for f in found if f.rule is rules.NOT_LISTED and f.fields["code"] == code)
    assert listed == 1000
    assert listed + more == 1500


def test_a_line_that_is_too_long_is_an_error() -> None:
    source, _ = check_text(b"LINE X 1" + b" " * 20_000 + b"Y 2\nQQ\n", "a.job")
    assert source is not None
    from gusjob.config.machine import Machine

    _, diagnostics = read_job(source, Machine())
    assert [(f.rule.code, f.span.line) for f in diagnostics] == [("GJ006", 1), ("GJ102", 2)]
