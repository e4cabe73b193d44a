"""The formats of files: a writer collects the diagnostics of all files and is written at the end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from gusjob.diagnostics.model import Diagnostic

if TYPE_CHECKING:
    from gusjob.diagnostics.formats.text import TextOf


class DiagnosticsWriter(Protocol):
    """A format of a file."""

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


TEXT, LOG = "text", "github"
"""The formats that people read, too: on a terminal, and in a log."""
ENDINGS = {".txt": TEXT, ".json": "json", ".sarif": "sarif", ".sarif.json": "sarif", ".xml": "junit"}
"""Format of an output file by its ending."""
FORMATS = (TEXT, "json", "sarif", "junit", LOG, "gitlab")
WITH_STATISTICS = (TEXT, "json")
"""Formats that can have the number of diagnostics of each rule."""


def writer_for(
    form: str, *, strict: bool, by_rule: Counter[str] | None, overrides: Mapping[str, str] | None = None
) -> DiagnosticsWriter:
    """Return the writer of a format.

    Args:
        form: One of FORMATS.
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
        case _ if form == LOG:
            from gusjob.diagnostics.formats.github import GitHubAnnotations

            return GitHubAnnotations()
        case "gitlab":
            from gusjob.diagnostics.formats.gitlab import GitLabReport

            return GitLabReport()
        case _:
            from gusjob.diagnostics.formats.plain import PlainText

            return PlainText()
