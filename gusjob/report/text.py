"""A report as text for people: the answer first, then, if they are wanted, totals and tables.

The answer is laid out here, without rich: a short run prints nothing else, and start-up time is part of the tool.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from gusjob.diagnostics.model import Severity
from gusjob.i18n.phrases import localized, printable
from gusjob.i18n.width import padded, wrapped
from gusjob.i18n.width import width as columns_of
from gusjob.ir.overrides import overrides_text
from gusjob.report.answer import Answer, Finding
from gusjob.report.rows import Report

UNLIMITED = 400
"""Width of a text that is not for a terminal: wide enough for two channels, so that no number is cut."""
_LEAST_WIDTH = 40
_LEAST_TEXT_WIDTH = 16
"""Narrower texts of findings go on lines of their own, below name and place."""
_BETWEEN = " · "
_BOLD, _DIM = "1", "2"
_STATUS = {None: "1;32", Severity.WARNING: "1;33", Severity.ERROR: "1;31"}
"""Codes of the terminal's styles: bold green, yellow, red."""


def report_text(
    report: Report, answer: Answer, *, tables: bool = False, width: int = UNLIMITED, color: bool = False
) -> str:
    """Format a report for people.

    Args:
        report: The report.
        answer: Its answer.
        tables: Add the totals and tables of segments and marks; of a long table the first and last rows.
        width: Columns of the terminal.
        color: Use colors and styles of a terminal.
    """
    width = max(width, _LEAST_WIDTH)

    def styled(text: str, code: str) -> str:
        return f"\x1b[{code}m{text}\x1b[0m" if color else text

    overrides = f"  -D {overrides_text(report.overrides)}" if report.overrides else ""
    status, *others = map(localized, answer.headline)
    headline = _joined([status, *others], width, indent="")
    lines = [
        styled(printable(report.job) + overrides, _BOLD),  # A path stays whole.
        styled(status, _STATUS[answer.worst]) + headline[len(status) :],
        *(styled(line, _DIM) for line in _joined(map(localized, answer.setting), width, indent="  ").split("\n")),
        *_finding_lines(answer.findings, width),
    ]
    text = "".join(line.rstrip() + "\n" for line in lines)
    if not tables:
        return text
    from gusjob.report.table import tables_text

    return f"{text}\n{tables_text(report, width=width, color=color)}"


def _joined(parts: Iterable[str], width: int, indent: str) -> str:
    """Join parts with dots; break lines between parts only."""
    lines = [""]
    for part in parts:
        longer = f"{lines[-1]}{_BETWEEN}{part}" if lines[-1] else indent + part
        if lines[-1] and columns_of(longer) > width:
            lines.append(f"  {part}")
        else:
            lines[-1] = longer
    return "\n".join(lines)


def _finding_lines(findings: Iterable[Finding], width: int) -> Iterator[str]:
    """Lay out what stands out: name, line, text. Names and lines stay whole."""
    rows = [("  " + localized(f.name), localized(f.place), localized(f.text)) for f in findings]
    if not rows:
        return
    of_name, of_place = (max(map(columns_of, cells)) + 2 for cells in [*zip(*rows, strict=True)][:2])
    left = width - of_name - of_place
    for name, place, text in rows:
        if left < _LEAST_TEXT_WIDTH:
            yield f"{name}  {place}"
            yield from (f"    {line}" for line in _folded(text, width - 4))
        else:
            first, *others = _folded(text, left)
            yield padded(name, of_name) + padded(place, of_place) + first
            yield from (" " * (of_name + of_place) + line for line in others)


def _folded(text: str, columns: int) -> Iterator[str]:
    """Break a text into lines; where it has no blanks it is broken, not cut."""
    if columns_of(text) <= columns:
        yield text
        return
    for line in wrapped(text, columns).split("\n"):
        part = ""
        for character in line:
            if columns_of(part + character) > columns:
                yield part
                part = ""
            part += character
        yield part
