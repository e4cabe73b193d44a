"""The formats that programs read: a writer collects the diagnostics of all files and is written at the end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

from gusjob.diagnostics.formats.text import TextOf
from gusjob.diagnostics.model import Diagnostic


class DiagnosticsWriter(Protocol):
    """A format that programs read."""

    def add(self, path: Path, diagnostics: Sequence[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file.

        Args:
            path: The file.
            diagnostics: Its diagnostics, in order.
            text_of: Returns the source line of a span.
            readable: Whether the file could be read at all.
        """

    def to_bytes(self) -> bytes:
        """Return everything that was added, in the format."""


def writer_for(
    form: str, *, strict: bool, by_rule: Counter[str] | None, overrides: Mapping[str, str] | None = None
) -> DiagnosticsWriter | None:
    """Return the writer of a format, or None for `text`, which is shown file by file.

    Args:
        form: `text`, `json`, `sarif` or `junit`.
        strict: Whether warnings fail (in JUnit).
        by_rule: The number of diagnostics of each rule, for JSON with statistics.
        overrides: Values in place of those of the jobs' LETs, for JSON.
    """
    match form:  # A format is imported when it is needed: start-up time is part of the tool.
        case "json":
            from gusjob.diagnostics.formats.check_json import CheckJson

            return CheckJson(by_rule=by_rule, overrides=overrides or {})
        case "sarif":
            from gusjob.diagnostics.formats.sarif import SarifLog

            return SarifLog()
        case "junit":
            from gusjob.diagnostics.formats.junit import JUnitReport

            return JUnitReport(strict=strict)
        case _:
            return None
