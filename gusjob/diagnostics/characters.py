"""Report characters that hide text: in jobs, listings and machine profiles."""

from __future__ import annotations

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, Severity, Span
from gusjob.i18n.characters import LINE_ENDS, code_point, hidden_characters

_LAST_CONTROL = "\x9f"


def report_hidden(data: bytes, path: str) -> list[Diagnostic]:
    """Report each character of a text that hides text.

    Args:
        data: UTF-8, lines ended by LF or CR LF.
        path: The text that the diagnostics are about.
    """
    collector = Collector(path)
    line, start = 1, 0
    for offset, character in hidden_characters(data):
        line += data.count(b"\n", start, offset)
        start = max(start, data.rfind(b"\n", start, offset) + 1)
        column = len(data[start:offset].decode("utf-8", "surrogatepass")) + 1
        span = Span(line=line, column=column, end_line=line, end_column=column + 1)
        collector.add(_rule(character), span, {"character": code_point(character)})
    return collector.finish(rules.NOT_LISTED)


def without_consequences(found: list[Diagnostic]) -> list[Diagnostic]:
    """Leave out the other errors of lines with characters that hide text: one cause gives one diagnostic."""
    lines = {_line(diagnostic) for diagnostic in found if diagnostic.rule.code == rules.HIDDEN_TEXT.code}
    return [d for d in found if d.rule.code == rules.HIDDEN_TEXT.code or not _is_consequence(d, lines)]


def _is_consequence(diagnostic: Diagnostic, lines: set[tuple[str, int]]) -> bool:
    return diagnostic.severity is Severity.ERROR and _line(diagnostic) in lines


def _line(diagnostic: Diagnostic) -> tuple[str, int]:
    return diagnostic.span.path, diagnostic.span.line


def _rule(character: str) -> Rule:
    if character in LINE_ENDS:
        return rules.HIDDEN_TEXT
    return rules.HIDDEN_BY_CONTROL if character <= _LAST_CONTROL else rules.HIDDEN_BY_DIRECTION
