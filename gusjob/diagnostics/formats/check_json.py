"""Diagnostics as JSON, gusjob-check/1."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import orjson
from msgspec import Struct, field

from gusjob.diagnostics.formats.text import TextOf
from gusjob.diagnostics.model import Diagnostic, Remark, Span

CHECK_SCHEMA = "gusjob-check/1"


class CheckJson(Struct, kw_only=True):
    """The diagnostics of all files.

    `by_rule`: the number of diagnostics of each rule, if it is to be written. `overrides`: values in place of those of
    the jobs' LETs.
    """

    by_rule: Counter[str] | None = None
    overrides: Mapping[str, str] = field(default_factory=dict)
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def add(self, path: Path, diagnostics: Iterable[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file."""
        self.diagnostics += diagnostics

    def to_bytes(self) -> bytes:
        """Return the JSON text."""
        check: dict[str, Any] = {
            "schema": CHECK_SCHEMA,
            "diagnostics": [diagnostic_object(diagnostic) for diagnostic in self.diagnostics],
        }
        if self.overrides:
            check["overrides"] = dict(self.overrides)
        if self.by_rule is not None:
            check["statistics"] = dict(self.by_rule)
        return orjson.dumps(check, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)


def diagnostic_object(diagnostic: Diagnostic) -> dict[str, Any]:
    """Return a diagnostic as it is in the JSON; `count` and `notes` are left out if they add nothing."""
    found: dict[str, Any] = {
        "path": diagnostic.file,
        **_position(diagnostic.span),
        "severity": diagnostic.severity.value,
        "code": diagnostic.rule.code,
        "message": diagnostic.message,
    }
    if diagnostic.count > 1:
        found["count"] = diagnostic.count
    if diagnostic.remarks:
        found["notes"] = [_note(remark, diagnostic.path) for remark in diagnostic.remarks]
    return found


def _note(remark: Remark, path: str) -> dict[str, Any]:
    return {"path": remark.span.path or path, **_position(remark.span), "message": remark.message}


def _position(span: Span) -> dict[str, int]:
    return {
        "line": span.line,
        "column": span.column,
        "end_line": max(span.end_line, span.line),
        "end_column": max(span.end_column, span.column),
    }
