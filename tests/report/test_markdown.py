"""`report --format markdown`: what it says, that it fits into a comment, and that a user's text does nothing in it."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from support.tools import MARK, run_job

from gusjob.cli import cli
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.diagnostics.rules import RULES
from gusjob.report.compare import compare
from gusjob.report.earlier import EarlierReport
from gusjob.report.markdown import MAX_CHARACTERS, code, report_markdown
from gusjob.report.rows import Report

TEXT = MARK + "LASER POWER 50\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"


def gusjob(*args: object) -> Result:
    return CliRunner().invoke(cli, [str(a) for a in args], catch_exceptions=False)


def written(tmp_path: Path, text: str, name: str = "x.job") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def cells(text: str, head: str) -> list[list[str]]:
    """The rows of the table whose head begins with this word."""
    lines = text.splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith(f"| {head} |"))
    body = lines[first + 2 :]
    rows = body[: next((i for i, line in enumerate(body) if not line), len(body))]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]


def test_a_report(tmp_path: Path) -> None:
    job = written(tmp_path, TEXT)
    result = gusjob("report", job, "--format", "markdown")
    assert (result.exit_code, result.stderr) == (0, "")
    text = result.stdout
    assert text.startswith(f"## `{job}`\n")
    # As in test_cli: 5 mm of jump and 5 mm of mark, 55 ms each, half power.
    assert cells(text, "segments") == [["2", "1", "110", "5", "5", "250"]]
    assert cells(text, "channel")[0][:6] == ["0", "%", "55", "2750", "50", "-"]
    rows = cells(text, "segment")
    assert [row[:4] for row in rows] == [["1", "5", "jump", "5"], ["2", "7", "mark", "10"]]
    assert rows[1][-5:] == ["55", "50", "50", "50", "2750"]
    summary = gusjob("report", job, "--format", "markdown", "--summary").stdout
    assert "| segment |" not in summary
    assert text.startswith(summary)


def test_all_rows_of_a_table_are_equally_wide(tmp_path: Path) -> None:
    text = gusjob("report", written(tmp_path, TEXT), "--format", "markdown").stdout
    for table in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        assert len({line.count("|") for line in table.splitlines()}) == 1


def test_diagnostics_stand_with_their_place(tmp_path: Path) -> None:
    warned = written(tmp_path, MARK + "LASER DELAY ON 20 OFF 10\nLASER POWER 5\nLASER ON\nLINE X 1\nLASER OFF\n")
    result = gusjob("report", warned, "--format", "markdown")
    assert f"- warning GJ306 `{warned}:4` `off delay 10 us" in result.stdout
    assert result.stderr == ""


def test_a_job_with_errors_is_reported_and_not_run(tmp_path: Path) -> None:
    bad = written(tmp_path, MARK + "LASER POWER 120\n")
    result = gusjob("report", bad, "--format", "markdown")
    assert result.exit_code == 1
    assert "Not run" in result.stdout
    assert f"- error GJ201 `{bad}:4`" in result.stdout
    assert "| " not in result.stdout
    assert "GJ201" in result.stderr
    unread = gusjob("report", tmp_path / "none.job", "--format", "markdown")
    assert (unread.exit_code, unread.stdout) == (2, "")


def test_the_comparison_is_a_section(tmp_path: Path) -> None:
    job, out = written(tmp_path, TEXT), tmp_path / "old.json"
    gusjob("report", job, "--format", "json", "-o", out)
    same = gusjob("report", job, "--format", "markdown", "--against", out)
    assert same.exit_code == 0
    assert f"### Against `{out}`\n\nSAME within 1 %.\n" in same.stdout
    written(tmp_path, TEXT.replace("POWER 50", "POWER 60"))
    result = gusjob("report", job, "--format", "markdown", "--against", out, "--summary")
    assert result.exit_code == 1
    assert ["channel 0 power_max", "%", "50", "60", "+16.7 %"] in cells(result.stdout, "total")
    assert result.stdout.index("### Against") < result.stdout.index("**OK, no warnings · ")
    only = gusjob("report", job, "--format", "markdown", "--against", out, "--only-changes").stdout
    assert only == result.stdout[: result.stdout.index("**OK, no warnings · ")].rstrip("\n") + "\n"
    assert cells(result.stdout, "segment") == [["2", "7", "mark", "50 -> 60 +16.7 %", "2750 -> 3300 +16.7 %"]]


def test_a_long_job_shows_the_longest_and_the_most_energetic() -> None:
    steps = "".join(f"LINE X {x % 2}\n" for x in range(1, 101))
    text = (
        MARK
        + f"LASER POWER 10\nLASER ON\n{steps}LINE X 90\nLASER OFF\nJUMP X -90\nLASER ON\nLASER POWER 90\nLINE X -89.5\n"
    )
    shown = report_markdown(run_job(text + "LASER OFF\n").report, [], name="x.job")
    rows = cells(shown, "segment")
    assert len(rows) <= 40
    assert "of 103 segments" in shown
    lines = [int(row[1]) for row in rows]
    assert lines == sorted(lines)
    # The long mark, the jump back, and the short one with 90 %.
    assert {106, 108, 111} <= set(lines)


# A user's text.

HOSTILE = [
    "a|b.job", "`x`", "``", "`", "<script>alert(1)</script>", "a\nb\n# c", "@everyone", "[x](http://a.b)", "#12",
    "![](http://x.y)", "http://evil.example/", "a\r\n\r\n| x |", "\x1b[31m", "\u202eabc", "", " ", "```\n@x\n```",
    "-->", "&lt;", "\\`@x`",
]  # fmt: skip


def spans_only(line: str, prefix: str) -> bool:
    """Whether a line is this prefix and then nothing but code spans, read as CommonMark reads them."""
    rest = line.removeprefix(prefix)
    while rest:
        fence = re.match("`+", rest)
        if fence is None:
            return False
        ends = [m.end() for m in re.finditer("`+", rest[fence.end() :]) if len(m[0]) == len(fence[0])]
        if not ends:
            return False
        rest = rest[fence.end() + ends[0] :].removeprefix(" ")
    return line.startswith(prefix)


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_names_and_messages_are_inert(text: str) -> None:
    rule = RULES["GJ112"]
    diagnostic = Diagnostic(rule=rule, span=Span(line=3), fields={"call": text, "hint": ""}, path=text)
    made = report_markdown(None, [diagnostic], name=text).splitlines()
    assert len(made) == 7
    assert spans_only(made[0], "## ")
    assert spans_only(made[6], "- error GJ112 ")


@given(st.text())
def test_any_text_is_one_code_span(text: str) -> None:
    line = code(text)
    assert "\n" not in line
    assert spans_only(line, "")
    assert len(line) <= 2 * 150 + 10
    assert line.startswith("`")


def test_one_span_stays_one() -> None:
    assert code("a`b``c") == "``` a`b``c ```"
    assert code("x" * 200) == "`" + "x" * 147 + "...`"
    assert not spans_only("`a` @b `c`", "")


# The bound.


def widest(rows: int) -> Report:
    """Every figure as wide as figures get, two channels, three units each."""
    report = run_job(MARK + "LASER POWER 50\nLASER ON\nLINE X 1\nLASER OFF\n").report
    columns = {name: np.resize(column, rows) for name, column in report.columns.items()}
    columns |= {name.replace("ch0", "ch1"): column for name, column in columns.items() if name.startswith("ch0")}
    for number, (name, column) in enumerate(columns.items()):
        if name not in ("line", "kind", "stage"):
            columns[name] = (
                np.full(len(column), -1.23456e-105 * (number + 1)) if "ms" not in name else column * 1.23456e105
            )
    columns["line"] = np.arange(rows) + 2**52
    one = {**report.totals["channels"][0], "off_output": {"standby_khz": 1.23456e-105, "standby_pct": 1.23456e-105}}
    entries = [{**one, "channel": channel, "unit": unit} for channel in (0, 1) for unit in ("%", "kHz", "V")]
    return Report(
        job="x", period_us=250, totals={**report.totals, "channels": entries}, columns=columns, notes=report.notes
    )


def test_it_always_fits_into_a_comment() -> None:
    report = widest(100)
    diagnostic = Diagnostic(
        rule=RULES["GJ112"], span=Span(line=3), fields={"call": "`@x" * 9999, "hint": ""}, path="/`" * 999
    )
    old = {name: column * 2 if name not in ("line", "kind") else column for name, column in report.columns.items()}
    earlier = EarlierReport(path="`" * 999, job="", totals={}, columns=old)
    text = report_markdown(report, [diagnostic] * 1000, name="`|" * 999, comparison=compare(report, earlier, 0.0))
    assert len(text) <= MAX_CHARACTERS < 65_536
    assert "- 970 more" in text
    assert "60 more" in text


def test_what_does_not_fit_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gusjob.report.markdown.MAX_CHARACTERS", 700)
    whole = report_markdown(None, [], name="x")
    assert "left out" not in whole
    diagnostic = Diagnostic(rule=RULES["GJ112"], span=Span(line=3), fields={"call": "QQ", "hint": ""}, path="x.job")
    text = report_markdown(None, [diagnostic] * 25, name="x")
    listed = text.count("- error")
    assert len(text) <= 700
    assert 0 < listed < 25
    assert text.endswith(f"\n\n{25 - listed} more lines are left out to fit into a comment.\n")
