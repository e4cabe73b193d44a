"""A diagnostic as text: path:line:col: error[GJ201]: message, with a caret under the source line."""

from __future__ import annotations

import unicodedata
from collections.abc import Callable

import click

from gusjob.diagnostics import Diagnostic, Span, printable

_MAX_SHOWN = 160
_COLORS = {"error": "red", "warning": "yellow", "note": "cyan"}


def width(text: str) -> int:
    """Columns that a text takes on a terminal (wide characters take two)."""
    return sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


TextOf = Callable[[Span, str], str]
"""The source line of a span in a text of a name; '' where there is none."""


def diagnostic_text(fault: Diagnostic, text_of: TextOf, *, color: bool) -> str:
    """One diagnostic and the other places that matter, each with its source line where there is one."""
    severity = fault.severity.value
    times = f" ({fault.count:,} times)" if fault.count > 1 else ""
    label = _label(f"{severity}[{fault.rule.code}]", severity, color=color)
    parts = [_placed(fault.span, fault.path, f"{label}: {printable(fault.message)}{times}", text_of)]
    note = _label("note", "note", color=color)
    parts += [_placed(r.span, fault.path, f"{note}: {printable(r.message)}", text_of) for r in fault.remarks]
    return "\n".join(parts)


def _label(text: str, severity: str, *, color: bool) -> str:
    return click.style(text, fg=_COLORS[severity], bold=True) if color else text


def _placed(span: Span, path: str, said: str, text_of: TextOf) -> str:
    """What is said of a place, and the place itself with a caret."""
    text = f"{printable(span.path or path)}:{span.line}:{span.column}: {said}"
    line = printable(text_of(span, path)) if span.end_column else ""
    if not line.strip() or len(line) > _MAX_SHOWN:
        return text
    start = span.column - 1
    marks = max(width(line[start : max(span.end_column - 1, start + 1)]), 1)
    return f"{text}\n{span.line:>5} | {line}\n      | {' ' * width(line[:start])}{'^' * marks}"
