"""A report as markdown, for a comment on a pull request: bounded, and with a user's text that can't act in it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np

from gusjob.diagnostics import Diagnostic, figure, printable
from gusjob.report.compare import Comparison, segment_rows, totals_rows, verdict
from gusjob.report.marks import MARKING_WORDS, marking_unit
from gusjob.report.match import Rows
from gusjob.report.rows import Report, SegmentKind

MAX_CHARACTERS = 65_000
"""A comment on GitHub holds 65,536."""
MAX_ROWS = 40
MAX_DIAGNOSTICS = 30
_MAX_NAME = 150
_MAX_MESSAGE = 300
_HEADS = {"line": "line", "kind": "kind", "x_mm": "x mm", "y_mm": "y mm", "length_mm": "mm", "duration_ms": "ms",
          "vel_mean_mm_s": "mm/s"}  # fmt: skip
_RUNS = {"run_in_mm": "run-ins mm", "run_out_mm": "run-outs mm"}
_CHANNEL_HEADS = {"emission_ms": "on ms", "power_min": "min", "power_mean": "mean", "power_max": "max",
                  "power_ms": "power*ms", "joules": "J"}  # fmt: skip


def report_markdown(
    report: Report | None,
    faults: Sequence[Diagnostic],
    *,
    name: str,
    summary: bool = False,
    comparison: Comparison | None = None,
) -> str:
    """Totals, comparison, diagnostics, and the segments unless `summary`; no report means that the job was not run."""
    lines = [f"## {code(name)}", ""]
    lines += ["Not run: it has errors.", ""] if report is None else _totals(report)
    lines += _comparison(comparison) if comparison is not None else []
    lines += _diagnostics(faults)
    lines += [] if summary or report is None else _segments(report)
    return _bounded(lines)


def code(text: str, most: int = _MAX_NAME) -> str:
    """A user's text as a code span, in which no markup, link or mention acts; a long one is cut."""
    shown = printable(text)
    shown = (shown if len(shown) <= most else shown[: most - 3] + "...") or " "
    fence = "`" * (1 + max(map(len, re.findall("`+", shown)), default=0))
    blank = " " if "`" in shown else ""
    return f"{fence}{blank}{shown}{blank}{fence}"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]], left: int = 1) -> Iterator[str]:
    """A table: `left` columns of words, then figures. A user's text has no place in it: a pipe would end its cell."""
    names = list(head)
    yield _row(names)
    yield _row(["---"] * left + ["---:"] * (len(names) - left))
    yield from map(_row, rows)
    yield ""


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _totals(report: Report) -> Iterator[str]:
    totals = report.totals
    runs = {name: head for name, head in _RUNS.items() if totals.get(name)}
    names = ("duration_ms", "mark_mm", "jump_mm", *runs)
    figures = [*(figure(totals[name]) for name in names), figure(report.period_us)]
    yield from _table(
        ["segments", "stages", "ms", "marks mm", "jumps mm", *runs.values(), "period us"],
        [[str(totals["segments"]), str(totals["stages"]), *figures]],
        left=0,
    )
    sums = ("emission_ms", "power_ms", "power_max", "joules", "clamped_ms")
    rows = [
        [str(one["channel"]), one["unit"], *(figure(one[name]) for name in sums), _while_off(one["off_output"])]
        for one in totals["channels"]
    ]
    if rows:
        yield from _table(
            ["channel", "unit", "on ms", "unit*ms", "highest", "J", "held by a limit ms", "while off"], rows, left=2
        )
    yield from _marking(totals)
    for channel in dict.fromkeys(entry["channel"] for entry in totals["channels"] if entry["lit_at_end"]):
        yield from (f"**Channel {channel} is left ON.**", "")


def _marking(totals: dict[str, Any]) -> Iterator[str]:
    """Worst and typical of each figure that is not 0."""
    rows = [
        [
            str(entry["channel"]), word, marking_unit(name, entry["unit"]), str(entry["marks"]),
            figure(entry["worst"][name]), figure(entry["typical"][name]),
        ]
        for entry in totals["marking"] or ()
        for name, word in MARKING_WORDS.items()
        if entry["worst"][name]
    ]  # fmt: skip
    if rows:
        yield from _table(["channel", "marking", "unit", "marks", "worst", "typical"], rows, left=3)


def _while_off(output: dict[str, float] | None) -> str:
    return ", ".join(f"{name} {figure(value)}" for name, value in output.items()) if output else ""


def _comparison(comparison: Comparison) -> Iterator[str]:
    first, *others = verdict(comparison)
    yield from (f"### Against {code(comparison.path)}", "", f"{first[0].upper()}{first[1:]}.", "")
    yield from (f"- {line}" for line in others)
    yield from [""] if others else []
    if comparison.totals:
        yield from _table(["total", "unit", "old", "new", "change"], totals_rows(comparison), left=2)
    if comparison.segments is not None and not comparison.same:
        head, *rows = segment_rows(comparison.segments, MAX_ROWS)
        if rows:
            yield from _table(head, rows, left=3)


def _diagnostics(faults: Sequence[Diagnostic]) -> Iterator[str]:
    if not faults:
        return
    yield from ("### Diagnostics", "")
    for fault in islice(faults, MAX_DIAGNOSTICS):
        place = code(f"{fault.path}:{fault.span.line}")
        yield f"- {fault.severity.value} {fault.rule.code} {place} {code(fault.message, _MAX_MESSAGE)}"
    if len(faults) > MAX_DIAGNOSTICS:
        yield f"- {len(faults) - MAX_DIAGNOSTICS} more"
    yield ""


def _segments(report: Report) -> Iterator[str]:
    count = len(report)
    if not count:
        return
    rows = np.arange(count) if count <= MAX_ROWS else _worth_seeing(report)
    some = f"### {len(rows)} of {count} segments: those that take longest, those with most energy"
    yield from (some if count > MAX_ROWS else "### Segments", "")
    channels = [
        name
        for name, column in report.columns.items()
        if name[4:] in _CHANNEL_HEADS and name.startswith("ch") and not np.isnan(column).all()
    ]
    names = [*_HEADS, *channels]
    head = ["segment", *_HEADS.values(), *(f"{name[:3]} {_CHANNEL_HEADS[name[4:]]}" for name in channels)]
    yield from _table(head, ([str(row + 1), *(_cell(report, name, row) for name in names)] for row in rows.tolist()))


def _cell(report: Report, name: str, row: int) -> str:
    value = report.columns[name][row]
    return SegmentKind(int(value)).word if name == "kind" else figure(float(value))


def _worth_seeing(report: Report) -> Rows:
    """Half of the rows for the segments that take longest, half for those with most energy, in order."""
    energies = [column for name, column in report.columns.items() if name.endswith("_power_ms")]
    chosen = [_largest(report.columns["duration_ms"], MAX_ROWS // 2)]
    chosen += [_largest(energy, MAX_ROWS // 2 // len(energies)) for energy in energies]
    return np.unique(np.concatenate(chosen))


def _largest(column: np.ndarray[tuple[int, ...], np.dtype[np.float64]], most: int) -> Rows:
    """Rows of the largest values above 0; of equal ones the first."""
    order = np.argsort(-column, kind="stable")[:most]
    return order[column[order] > 0]


def _bounded(lines: Iterable[str]) -> str:
    """Whole lines, as many as fit."""
    text = "\n".join(lines).rstrip("\n") + "\n"
    if len(text) <= MAX_CHARACTERS:
        return text
    kept = text[: MAX_CHARACTERS - 100].rsplit("\n", 1)[0]
    more = text.count("\n", len(kept)) - 1
    return f"{kept}\n\n{more} more lines do not fit into a comment.\n"
