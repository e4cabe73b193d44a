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


def without_consequences(found: list[Diagnostic], hidden: list[Diagnostic]) -> list[Diagnostic]:
    """Join the diagnostics of a text's statements and of its characters: one cause gives one diagnostic."""
    lines = {diagnostic.span.line for diagnostic in hidden if diagnostic.rule.code == rules.HIDDEN_TEXT.code}
    errors = {diagnostic.span.line for diagnostic in found if diagnostic.severity is Severity.ERROR}
    if not lines & errors:
        return [*found, *hidden]
    return [d for d in found if d.span.line not in lines or d.severity is not Severity.ERROR] + hidden


def _rule(character: str) -> Rule:
    if character in LINE_ENDS:
        return rules.HIDDEN_TEXT
    return rules.HIDDEN_BY_CONTROL if character <= _LAST_CONTROL else rules.HIDDEN_BY_DIRECTION
