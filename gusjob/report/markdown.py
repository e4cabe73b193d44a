"""A report as markdown, for a comment on a pull request: its length is limited, and user text can't contain markup."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np

from gusjob.diagnostics.model import Diagnostic
from gusjob.i18n.phrases import Phrase, figure, localized, printable
from gusjob.ir.overrides import NO_OVERRIDES, Overrides, overrides_text
from gusjob.kinematics.arrays import Indices
from gusjob.report.answer import Answer, answer_of
from gusjob.report.compare import Comparison
from gusjob.report.compare_text import outcome_lines, segment_rows, totals_rows
from gusjob.report.rows import Report, kind_for_people, while_off
from gusjob.simulate.quality.marks import MARKING_WORDS, marking_unit

MAX_CHARACTERS = 65_000
"""Limit of the text; GitHub's for a comment is 65,536."""
MAX_ROWS = 40
MAX_DIAGNOSTICS = 30
_MAX_NAME = 150
_MAX_MESSAGE = 300
_HEADS = {
    "line": Phrase("line"),
    "kind": Phrase("kind"),
    "x_mm": "x mm",
    "y_mm": "y mm",
    "length_mm": "mm",
    "duration_ms": "ms",
    "vel_mean_mm_s": "mm/s",
}
_RUNS = {"run_in_mm": Phrase("run-ins mm"), "run_out_mm": Phrase("run-outs mm")}
_CHANNEL_HEADS = {
    "emission_ms": Phrase("on ms"),
    "power_min": Phrase("min"),
    "power_mean": Phrase("mean"),
    "power_max": Phrase("max"),
    "power_ms": Phrase("power·ms"),
    "joules": "J",
}
_TOTAL_HEADS = (Phrase("segments"), Phrase("stages"), "ms", Phrase("marks mm"), Phrase("jumps mm"))
_CHANNEL_TOTAL_HEADS = (
    Phrase("channel"),
    Phrase("unit"),
    Phrase("on ms"),
    Phrase("unit·ms"),
    Phrase("highest"),
    "J",
    Phrase("limited ms"),
    Phrase("while off"),
)
_MARKING_HEADS = (
    Phrase("channel"),
    Phrase("marking"),
    Phrase("unit"),
    Phrase("marks"),
    Phrase("worst"),
    Phrase("typical"),
)
_MOVED_HEADS = (Phrase("total"), Phrase("unit"), Phrase("old"), Phrase("new"), Phrase("change"))


def report_markdown(
    report: Report | None,
    diagnostics: Sequence[Diagnostic],
    *,
    name: str,
    summary: bool = False,
    comparison: Comparison | None = None,
    only_changes: bool = False,
    overrides: Overrides = NO_OVERRIDES,
) -> str:
    """Format totals, comparison, diagnostics and, unless `summary`, segments.

    The comparison comes first, with its verdict; then the answer. `report`: None if the job was not run.
    `only_changes`: the comparison alone. `overrides`: the values of LETs that the job was read with.
    """
    lines = [f"## {code(name)}", ""]
    lines += [f"-D {code(overrides_text(overrides))}", ""] if overrides else []
    lines += _comparison(comparison) if comparison is not None else []
    if only_changes and comparison is not None:
        return _bounded(lines)
    if report is None:
        lines += [localized(Phrase("Not run: the job has errors.")), ""]
    else:
        lines += _answer(answer_of(report, diagnostics))
        lines += _totals(report)
    lines += _diagnostics(diagnostics)
    lines += [] if summary or report is None else _segments(report)
    return _bounded(lines)


def _answer(answer: Answer) -> Iterator[str]:
    """Yield the headline, and a list of what stands out."""
    yield f"**{' · '.join(map(localized, answer.headline))}**"
    yield ""
    for finding in answer.findings:
        place = f" {code(localized(finding.place))}" if finding.line else ""
        yield f"- {localized(finding.name)}{place}: {localized(finding.text)}"
    yield from [""] if answer.findings else []


def code(text: str, most: int = _MAX_NAME) -> str:
    """Format user text as a code span, in which markup, links and mentions have no effect; cut a long one."""
    shown = printable(text)
    shown = (shown if len(shown) <= most else shown[: most - 3] + "...") or " "
    fence = "`" * (1 + max(map(len, re.findall("`+", shown)), default=0))
    blank = " " if "`" in shown else ""
    return f"{fence}{blank}{shown}{blank}{fence}"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]], left: int = 1) -> Iterator[str]:
    """Yield a table: `left` columns of texts, then numbers. No user text: a pipe in it would end the cell."""
    names = [localized(name) for name in head]
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
        [*_TOTAL_HEADS, *runs.values(), Phrase("period us")],
        [[str(totals["segments"]), str(totals["stages"]), *figures]],
        left=0,
    )
    sums = ("emission_ms", "power_ms", "power_max", "joules", "clamped_ms")
    rows = [
        [
            str(entry["channel"]),
            entry["unit"],
            *(figure(entry[name]) for name in sums),
            localized(while_off(entry["off_output"])),
        ]
        for entry in totals["channels"]
    ]
    if rows:
        yield from _table(_CHANNEL_TOTAL_HEADS, rows, left=2)
    yield from _marking(totals)
    for channel in dict.fromkeys(entry["channel"] for entry in totals["channels"] if entry["lit_at_end"]):
        left_on = Phrase("Channel {channel} is left ON.", channel=channel)
        yield from (f"**{localized(left_on)}**", "")


def _marking(totals: dict[str, Any]) -> Iterator[str]:
    """Yield worst and typical value of each mark quality measure that is not 0."""
    rows = [
        [
            str(entry["channel"]),
            localized(word),
            marking_unit(name, entry["unit"]),
            str(entry["marks"]),
            figure(entry["worst"][name]),
            figure(entry["typical"][name]),
        ]
        for entry in totals["marking"] or ()
        for name, word in MARKING_WORDS.items()
        if entry["worst"][name]
    ]
    if rows:
        yield from _table(_MARKING_HEADS, rows, left=3)


def _comparison(comparison: Comparison) -> Iterator[str]:
    first, *others = map(localized, outcome_lines(comparison))
    title = Phrase("Against {report}", report=code(comparison.path))
    outcome = Phrase("{outcome}.", outcome=first[:1].upper() + first[1:])
    yield from (f"### {localized(title)}", "", localized(outcome), "")
    yield from (f"- {line}" for line in others)
    yield from [""] if others else []
    if comparison.totals:
        yield from _table(_MOVED_HEADS, totals_rows(comparison), left=2)
    if comparison.segments is not None and not comparison.same:
        head, *rows = segment_rows(comparison.segments, MAX_ROWS)
        if rows:
            yield from _table(head, rows, left=3)


def _diagnostics(diagnostics: Sequence[Diagnostic]) -> Iterator[str]:
    if not diagnostics:
        return
    head = Phrase("Diagnostics")
    yield from (f"### {localized(head)}", "")
    for diagnostic in islice(diagnostics, MAX_DIAGNOSTICS):
        place = code(f"{diagnostic.path}:{diagnostic.span.line}")
        message = code(diagnostic.localized, _MAX_MESSAGE)
        yield f"- {diagnostic.severity.localized} {diagnostic.rule.code} {place} {message}"
    if len(diagnostics) > MAX_DIAGNOSTICS:
        more = Phrase("{count} more", count=len(diagnostics) - MAX_DIAGNOSTICS)
        yield f"- {localized(more)}"
    yield ""


def _segments(report: Report) -> Iterator[str]:
    count = len(report)
    if not count:
        return
    rows = np.arange(count) if count <= MAX_ROWS else _select_rows(report)
    some = Phrase(
        "{shown} of {count} segments: the longest in time and those with most energy", shown=len(rows), count=count
    )
    title = some if count > MAX_ROWS else Phrase("Segments")
    yield from (f"### {localized(title)}", "")
    channels = [
        name
        for name, column in report.columns.items()
        if name[4:] in _CHANNEL_HEADS and name.startswith("ch") and not np.isnan(column).all()
    ]
    names = [*_HEADS, *channels]
    of_channels = (Phrase("ch{channel} {what}", channel=name[2], what=_CHANNEL_HEADS[name[4:]]) for name in channels)
    head = [Phrase("segment"), *_HEADS.values(), *of_channels]
    yield from _table(head, ([str(row + 1), *(_cell(report, name, row) for name in names)] for row in rows.tolist()))


def _cell(report: Report, name: str, row: int) -> str:
    value = report.columns[name][row]
    return kind_for_people(int(value)) if name == "kind" else figure(float(value))


def _select_rows(report: Report) -> Indices:
    """Select rows, in order: half of them those with the longest duration, half those with most energy."""
    energies = [column for name, column in report.columns.items() if name.endswith("_power_ms")]
    chosen = [_largest(report.columns["duration_ms"], MAX_ROWS // 2)]
    chosen += [_largest(energy, MAX_ROWS // 2 // len(energies)) for energy in energies]
    return np.unique(np.concatenate(chosen))


def _largest(column: np.ndarray[tuple[int, ...], np.dtype[np.float64]], most: int) -> Indices:
    """Return the indices of the largest values above 0; of equal ones the first."""
    order = np.argsort(-column, kind="stable")[:most]
    return order[column[order] > 0]


def _bounded(lines: Iterable[str]) -> str:
    """Join the lines; drop the last ones if the text is too long."""
    text = "\n".join(lines).rstrip("\n") + "\n"
    if len(text) <= MAX_CHARACTERS:
        return text
    kept = text[: MAX_CHARACTERS - 100].rsplit("\n", 1)[0]
    more = text.count("\n", len(kept)) - 1
    left_out = Phrase("{count} more lines are left out to fit into a comment.", count=more)
    return f"{kept}\n\n{localized(left_out)}\n"
