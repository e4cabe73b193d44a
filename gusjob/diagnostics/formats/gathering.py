"""Diagnostics in forms for programs: files are added as they are judged, and all is written at the end."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

from gusjob.diagnostics.model import Diagnostic
from gusjob.pipeline import FileResult


class Gathering(Protocol):
    """A format for programs: files are added as they are judged, and it is written at the end."""

    def add(self, loaded: FileResult) -> None:
        """One more file."""

    def written(self) -> bytes:
        """All of it."""


def gathering(form: str, *, strict: bool, by_rule: Counter[str] | None) -> Gathering | None:
    """What gathers diagnostics for a format; nothing for text, which is shown at once."""
    match form:
        case "json":
            return _Json(by_rule=by_rule)
        case "sarif":
            return _Sarif()
        case "junit":
            return _JUnit(strict)
        case _:
            return None


@dataclass(slots=True, kw_only=True)
class _Json:
    by_rule: Counter[str] | None
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def add(self, loaded: FileResult) -> None:
        self.diagnostics += loaded.diagnostics

    def written(self) -> bytes:
        from gusjob.report.files import check_json

        return check_json(self.diagnostics, None if self.by_rule is None else dict(self.by_rule)) + b"\n"


class _Sarif:
    def __init__(self) -> None:
        from gusjob.diagnostics.formats.sarif import SarifLog

        self._log = SarifLog()

    def add(self, loaded: FileResult) -> None:
        self._log.add(loaded.path, loaded.diagnostics, loaded.text_of, readable=not loaded.is_unreadable)

    def written(self) -> bytes:
        return self._log.written()


class _JUnit:
    def __init__(self, strict: bool) -> None:
        from gusjob.diagnostics.formats.junit import JUnitReport

        self._report = JUnitReport(strict=strict)

    def add(self, loaded: FileResult) -> None:
        from gusjob.cli.text import diagnostic_text

        def describe(diagnostic: Diagnostic) -> str:
            return diagnostic_text(diagnostic, loaded.text_of, color=False)

        self._report.add(loaded.path, loaded.diagnostics, describe, readable=not loaded.is_unreadable)

    def written(self) -> bytes:
        return self._report.written()
