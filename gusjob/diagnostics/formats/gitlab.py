"""Diagnostics as a Code Quality report, which GitLab shows in merge requests.

GitLab requires `description`, `fingerprint`, `severity` and `location`, and shows findings of one fingerprint as one.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import orjson
from msgspec import Struct, field

from gusjob.diagnostics.formats.fingerprints import Fingerprints
from gusjob.diagnostics.formats.repository import Seen, repository_path
from gusjob.diagnostics.formats.text import TextOf
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.i18n.phrases import printable

TOP_VARIABLE = "CI_PROJECT_DIR"
_SEVERITIES = {Severity.ERROR: "major", Severity.WARNING: "minor", Severity.NOTE: "info"}
_UNREADABLE = "blocker"
"""Severity of a file that can't be read, and so was not checked."""


class GitLabReport(Struct, kw_only=True):
    """An object for each diagnostic."""

    findings: list[dict[str, Any]] = field(default_factory=list)
    seen: Seen = field(default_factory=Seen)
    fingerprints: Fingerprints = field(default_factory=Fingerprints)

    def add(self, path: Path, diagnostics: Iterable[Diagnostic], text_of: TextOf, *, readable: bool) -> None:
        """Add the diagnostics of a file. `readable`: the file could be checked at all."""
        for diagnostic in diagnostics:
            file = repository_path(path, diagnostic, TOP_VARIABLE)
            if not self.seen.is_new(diagnostic, file):
                continue
            code = diagnostic.rule.code
            finding = {
                "description": f"{code}: {printable(diagnostic.localized_with_count)}",  # GitLab shows no check_name.
                "check_name": code,
                "fingerprint": self.fingerprints.of(diagnostic, file, text_of),
                "severity": _SEVERITIES[diagnostic.severity] if readable else _UNREADABLE,
                "location": {"path": file, "lines": {"begin": diagnostic.span.line}},
            }
            self.findings.append(finding)

    def to_bytes(self) -> bytes:
        """Return the JSON text."""
        return orjson.dumps(self.findings, option=orjson.OPT_INDENT_2 | orjson.OPT_APPEND_NEWLINE)
