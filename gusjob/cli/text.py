"""A diagnostic as text: path:line:col: error[GJ201]: message, with a caret under the source line."""

from __future__ import annotations

import unicodedata

import click

from gusjob.diagnostics import Diagnostic, printable
from gusjob.syntax import Source

_MAX_SHOWN = 160
_COLORS = {"error": "red", "warning": "yellow", "note": "cyan"}


def width(text: str) -> int:
    """Columns that a text takes on a terminal (wide characters take two)."""
    return sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def diagnostic_text(fault: Diagnostic, source: Source | None, *, color: bool) -> str:
    """One diagnostic, with its source line where there is one."""
    span, severity = fault.span, fault.severity.value
    head = f"{printable(fault.path)}:{span.line}:{span.column}: "
    label = (
        click.style(f"{severity}[{fault.rule.code}]", fg=_COLORS[severity], bold=True)
        if color
        else f"{severity}[{fault.rule.code}]"
    )
    text = f"{head}{label}: {printable(fault.message)}"
    line = printable(source.line(span.line)) if source is not None and span.end_column else ""
    if not line.strip() or len(line) > _MAX_SHOWN:
        return text
    number = f"{span.line:>5}"
    start = span.column - 1
    marks = max(width(line[start : max(span.end_column - 1, start + 1)]), 1)
    return f"{text}\n{number} | {line}\n      | {' ' * width(line[:start])}{'^' * marks}"
