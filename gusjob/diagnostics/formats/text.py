"""Diagnostics as text: `path:line:col: error[GJ201]: message`, with a caret under the source line."""

from __future__ import annotations

from collections.abc import Callable

from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.i18n.phrases import printable
from gusjob.i18n.width import width

TextOf = Callable[[Span, str], str]
"""Return the source line of a span in the text of a path; '' if there is none."""

_MAX_LINE = 160
"""Longer source lines are not shown."""
_BOLD, _RESET = "\033[1m", "\033[0m"
_COLORS = {Severity.ERROR: "\033[31m", Severity.WARNING: "\033[33m", Severity.NOTE: "\033[36m"}
"""Red, yellow and cyan."""


def diagnostic_text(diagnostic: Diagnostic, text_of: TextOf, *, color: bool) -> str:
    """Format a diagnostic and its remarks, each with its source line if there is one."""
    label = _label(f"{diagnostic.severity.localized}[{diagnostic.rule.code}]", diagnostic.severity, color=color)
    message = f"{label}: {printable(diagnostic.localized_with_count)}"
    note = _label(Severity.NOTE.localized, Severity.NOTE, color=color)
    lines = [_with_source(diagnostic.span, diagnostic.path, message, text_of)]
    lines += [
        _with_source(remark.span, diagnostic.path, f"{note}: {printable(remark.localized)}", text_of)
        for remark in diagnostic.remarks
    ]
    return "\n".join(lines)


def _label(text: str, severity: Severity, *, color: bool) -> str:
    return f"{_COLORS[severity]}{_BOLD}{text}{_RESET}" if color else text


def _with_source(span: Span, path: str, message: str, text_of: TextOf) -> str:
    """Format a message with its position and, if the span has an end, its source line and a caret."""
    text = f"{printable(span.path or path)}:{span.line}:{span.column}: {message}"
    line = printable(text_of(span, path)) if span.end_column else ""
    if not line.strip() or len(line) > _MAX_LINE:
        return text
    start = span.column - 1
    carets = max(width(line[start : max(span.end_column - 1, start + 1)]), 1)
    return f"{text}\n{span.line:>5} | {line}\n      | {' ' * width(line[:start])}{'^' * carets}"
