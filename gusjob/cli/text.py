"""A diagnostic as text: path:line:col: error[GJ201]: message, with a caret under the source line."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable

import click

from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.i18n.phrases import printable

_MAX_SHOWN = 160
_WIDE = r"\u2e80-\ua4cf\uf900-\ufaff\uff00-\uff60"
_BREAKABLE = re.compile(rf"\s*[（《]*(?:[{_WIDE}]|[^\s{_WIDE}]+)[，。；：、！？）》]*\s*")
"""What stays together on a line: a wide character or a word of others, with the marks that belong to it."""
_COLORS = {Severity.ERROR: "red", Severity.WARNING: "yellow", Severity.NOTE: "cyan"}


def width(text: str) -> int:
    """Columns that a text takes on a terminal (wide characters take two)."""
    return sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def padded(text: str, columns: int) -> str:
    """A text with blanks behind it, so many columns wide."""
    return text + " " * (columns - width(text))


def wrapped(text: str, columns: int) -> str:
    """A text in lines of so many columns; a line may break behind any wide character, not before a full stop."""
    lines, used = [""], 0
    for part in _BREAKABLE.findall(text):
        size = width(part.rstrip())
        if used + size > columns and lines[-1]:
            lines.append("")
            used = 0
        lines[-1] += part
        used += width(part)
    return "\n".join(line.rstrip() for line in lines)


TextOf = Callable[[Span, str], str]
"""The source line of a span in a text of a name; '' where there is none."""


def diagnostic_text(diagnostic: Diagnostic, text_of: TextOf, *, color: bool) -> str:
    """One diagnostic and the other places that matter, each with its source line where there is one."""
    label = _label(f"{diagnostic.severity.localized}[{diagnostic.rule.code}]", diagnostic.severity, color=color)
    parts = [
        _placed(diagnostic.span, diagnostic.path, f"{label}: {printable(diagnostic.localized_with_count)}", text_of)
    ]
    note = _label(Severity.NOTE.localized, Severity.NOTE, color=color)
    parts += [
        _placed(r.span, diagnostic.path, f"{note}: {printable(r.localized)}", text_of) for r in diagnostic.remarks
    ]
    return "\n".join(parts)


def _label(text: str, severity: Severity, *, color: bool) -> str:
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
