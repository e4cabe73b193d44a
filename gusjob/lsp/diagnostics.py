"""The diagnostics of a text, as `gusjob check` finds them, and their locations for the editor."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from lsprotocol.types import (
    Diagnostic as LspDiagnostic,
)
from lsprotocol.types import (
    DiagnosticRelatedInformation,
    DiagnosticSeverity,
    DiagnosticTag,
    Location,
    PositionEncodingKind,
)
from msgspec import Struct, field

from gusjob.config.profile import Profile
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.diagnostics.select import EMPTY_LAYER
from gusjob.frontend import check_text
from gusjob.frontend.parse.syntax_errors import COMPARISON_HINT
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.lsp.text import Text
from gusjob.lsp.workspace import Workspace, uri_of
from gusjob.pipeline import Checked, Parsed, Rejected, check, examine, load, parse_source, selected

SOURCE = "gusjob"
MAX_SHOWN = 500
"""Maximum number of diagnostics that are sent for a file: an editor needs a second to show ten thousand."""

_SEVERITIES = {
    Severity.ERROR: DiagnosticSeverity.Error,
    Severity.WARNING: DiagnosticSeverity.Warning,
    Severity.NOTE: DiagnosticSeverity.Information,
}
_UNUSED = {rules.UNUSED_NAME.code, rules.UNUSED_ROUTINE.code}


class Diagnosis(Struct):
    """All diagnostics of a text.

    Attributes:
        top: Name of the text.
        diagnostics: Those of the text, its included files and its machine profile.
        workspace: The files that were read.
        profile: The machine profile.
        bad_profile: Whether the profile has errors; then the text is not checked.
        files: Resolved paths of the included files.
    """

    top: str
    diagnostics: list[Diagnostic]
    workspace: Workspace
    profile: Path | None = None
    bad_profile: bool = False
    files: frozenset[str] = field(default_factory=frozenset)


def diagnose(name: str, path: Path | None, data: bytes, workspace: Workspace) -> Diagnosis:
    """Check a text that may not be saved yet. `path`: its file; None if it has none."""
    if path is None:
        return Diagnosis(top=name, diagnostics=_check_unsaved(name, data), workspace=workspace)
    loaded = load(workspace.path(path), None)
    workspace.watch_for_profile(path)
    if isinstance(loaded, Rejected) and loaded.profile is not None:
        found = list(loaded.diagnostics)
        return Diagnosis(top=name, diagnostics=found, workspace=workspace, profile=loaded.profile, bad_profile=True)
    if isinstance(loaded, Checked):
        loaded = examine(loaded)
    own = {str(path.resolve()), *([str(loaded.profile.resolve())] if loaded.profile else [])}
    files = frozenset(workspace.read) - own
    diagnostics = list(selected(loaded, EMPTY_LAYER).diagnostics)
    return Diagnosis(top=name, diagnostics=diagnostics, workspace=workspace, profile=loaded.profile, files=files)


def _check_unsaved(name: str, data: bytes) -> list[Diagnostic]:
    """Check a text that has no file: it has no machine profile, and can't include files."""
    source, diagnostics = check_text(data, name)
    if source is None:
        return diagnostics
    parsed = parse_source(source, path=Path(name), profile=Profile())
    return list((examine(check(parsed)) if isinstance(parsed, Parsed) else parsed).diagnostics)


class SourceLocations(Struct):
    """Locations of diagnostics for the editor. `uris`: URIs of open files by resolved path."""

    diagnosis: Diagnosis
    uri: str
    text: Text
    uris: Mapping[str, str]
    unit: PositionEncodingKind | str
    known: dict[str, tuple[str, Text]] = field(default_factory=dict)

    def file(self, name: str) -> tuple[str, Text]:
        """Return URI and text of a file by its name in a diagnostic."""
        if name in ("", self.diagnosis.top):
            return self.uri, self.text
        if name not in self.known:
            path = Path(name).resolve()
            try:
                data = self.diagnosis.workspace.bytes_of(path)
            except OSError:  # It was deleted since.
                data = b""
            self.known[name] = self.uris.get(str(path)) or uri_of(Path(name)), Text(data, self.unit)
        return self.known[name]

    def location(self, span: Span, path: str = "") -> Location:
        """Return the location of a span."""
        uri, text = self.file(span.path or path)
        return Location(uri=uri, range=text.range(span))


def lsp_diagnostics(locations: SourceLocations) -> dict[str, list[LspDiagnostic]]:
    """Convert diagnostics for the editor, by URI of their file.

    An included file without diagnostics has an empty list, so that the editor removes earlier ones.
    """
    diagnosis = locations.diagnosis
    found: dict[str, list[LspDiagnostic]] = {locations.uri: []}
    for name in diagnosis.files:
        found.setdefault(locations.uris.get(name) or uri_of(Path(name)), [])
    for diagnostic in diagnosis.diagnostics:
        uri, text = locations.file(diagnostic.span.path or diagnostic.path)
        in_file = found.setdefault(uri, [])
        if len(in_file) < MAX_SHOWN:
            in_file.append(_lsp_diagnostic(diagnostic, text, locations))
    if diagnosis.bad_profile:
        found[locations.uri] = [_profile_diagnostic(diagnosis, locations)]
    return found


def _lsp_diagnostic(diagnostic: Diagnostic, text: Text, locations: SourceLocations) -> LspDiagnostic:
    unused = diagnostic.rule.code in _UNUSED
    related = [
        DiagnosticRelatedInformation(
            location=locations.location(r.span, diagnostic.path), message=printable(r.localized)
        )
        for r in diagnostic.remarks
    ]
    return LspDiagnostic(
        range=text.range(diagnostic.span),
        message=printable(diagnostic.localized_with_count),
        severity=DiagnosticSeverity.Hint if unused else _SEVERITIES[diagnostic.severity],
        code=diagnostic.rule.code,
        source=SOURCE,
        tags=[DiagnosticTag.Unnecessary] if unused else None,
        related_information=related or None,
        data=replacement(diagnostic, text) or None,
    )


def _profile_diagnostic(diagnosis: Diagnosis, locations: SourceLocations) -> LspDiagnostic:
    """Report an unusable machine profile in the job, which is not checked then."""
    first = diagnosis.diagnostics[0]
    profile = diagnosis.profile.name if diagnosis.profile else ""
    in_profile = DiagnosticRelatedInformation(
        location=locations.location(first.span, first.path), message=printable(first.localized)
    )
    return LspDiagnostic(
        range=locations.text.range(Span(line=1)),
        message=localized(Phrase("not checked: {profile}: {why}", profile=profile, why=printable(first.localized))),
        severity=DiagnosticSeverity.Error,
        code=first.rule.code,
        source=SOURCE,
        related_information=[in_profile],
    )


def replacement(diagnostic: Diagnostic, text: Text) -> dict[str, str]:
    """Return the one word that replaces another if the diagnostic's hint names it: {'old': ..., 'new': ...}."""
    hint = diagnostic.fields.get("hint", "")
    old = str(
        next((diagnostic.fields[k] for k in ("found", "name", "word", "call") if k in diagnostic.fields), "")
    ).strip("'")
    if not old or not isinstance(hint, Phrase):
        return {}
    if new := hint.fields.get("near"):
        return {"old": old, "new": new.lower() if old.islower() and new.isupper() else new}
    if hint == COMPARISON_HINT:
        return {"old": old, "new": "=="}
    if glued := hint.fields.get("glued"):
        return {"old": f"{glued.removesuffix(old)} {old}", "new": glued}
    return {}
