"""Diagnostics as workflow commands of GitHub Actions, which shows them as annotations of the changed lines.

What the runner takes: the properties file, line, endLine, col, endColumn and title; columns only where line and endLine
are equal; `%`, CR and LF escaped in the message, in properties also `:` and `,`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from msgspec import Struct, field

from gusjob.diagnostics.formats.repository import Seen, repository_path
from gusjob.diagnostics.formats.text import TextOf
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.i18n.phrases import printable

TOP_VARIABLE = "GITHUB_WORKSPACE"
_COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.NOTE: "notice"}
_IN_MESSAGE = str.maketrans({"%": "%25", "\r": "%0D", "\n": "%0A"})
_IN_PROPERTY = _IN_MESSAGE | str.maketrans({":": "%3A", ",": "%2C"})


class GitHubAnnotations(Struct, kw_only=True):
    """A line for each diagnostic."""

    lines: list[str] = field(default_factory=list)
    seen: Seen = field(default_factory=Seen)

    def add(self, path: Path, diagnostics: Iterable[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file."""
        for diagnostic in diagnostics:
            file = repository_path(path, diagnostic, TOP_VARIABLE)
            if self.seen.is_new(diagnostic, file):
                self.lines.append(_command(diagnostic, file))

    def to_bytes(self) -> bytes:
        """Return the lines."""
        return "".join(f"{line}\n" for line in self.lines).encode()


def _command(diagnostic: Diagnostic, file: str) -> str:
    properties = {"file": file, **_position(diagnostic.span), "title": diagnostic.rule.code}
    written = ",".join(f"{name}={str(value).translate(_IN_PROPERTY)}" for name, value in properties.items())
    return f"::{_COMMANDS[diagnostic.severity]} {written}::{_message(diagnostic, file).translate(_IN_MESSAGE)}"


def _position(span: Span) -> dict[str, int]:
    end_line = max(span.end_line, span.line)
    position = {"line": span.line, "endLine": end_line}
    if span.end_column and end_line == span.line:
        position |= {"col": span.column, "endColumn": max(span.end_column, span.column)}
    return position


def _message(diagnostic: Diagnostic, file: str) -> str:
    """Begin with the position: the log of a step shows only the message."""
    span = diagnostic.span
    lines = [f"{file}:{span.line}:{span.column}: {diagnostic.localized_with_count}"]
    for remark in diagnostic.remarks:
        place = f"{remark.span.path or diagnostic.path}:{remark.span.line}:{remark.span.column}"
        lines.append(f"{Severity.NOTE.localized}: {place}: {remark.localized}")
    return "\n".join(map(printable, lines))
