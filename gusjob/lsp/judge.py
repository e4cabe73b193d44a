"""What is wrong with a text, as `gusjob check` finds it, and where an editor is to show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lsprotocol.types import (
    Diagnostic as Shown,
)
from lsprotocol.types import (
    DiagnosticRelatedInformation,
    DiagnosticSeverity,
    DiagnosticTag,
    Location,
    PositionEncodingKind,
)

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.diagnostics.select import NOTHING_ASKED
from gusjob.frontend import check_text
from gusjob.frontend.parse.statements import COMPARED
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.lsp.desk import Desk, uri_of
from gusjob.lsp.text import Text
from gusjob.pipeline import Checked, Parsed, Rejected, check, examine, load, parse_source, selected

SOURCE = "gusjob"
MAX_SHOWN = 500
"""So many diagnostics of a file are sent. An editor that is sent all of ten thousand does nothing else for a second."""

_SEVERITIES = {
    Severity.ERROR: DiagnosticSeverity.Error,
    Severity.WARNING: DiagnosticSeverity.Warning,
    Severity.NOTE: DiagnosticSeverity.Information,
}
_UNUSED = {rules.NEVER_READ.code, rules.NEVER_CALLED.code}


@dataclass(slots=True)
class Judged:
    """All diagnostics of a text. `files`: resolved paths of what it includes."""

    top: str
    diagnostics: list[Diagnostic]
    desk: Desk
    profile: Path | None = None
    bad_profile: bool = False
    files: frozenset[str] = field(default_factory=frozenset)


def judge(name: str, path: Path | None, data: bytes, desk: Desk) -> Judged:
    """Judge a text that may not be saved yet. `path` is where it would be; None: nowhere."""
    if path is None:
        return Judged(top=name, diagnostics=_homeless(name, data), desk=desk)
    loaded = load(desk.path(path), None)
    desk.watch_for_profile(path)
    if isinstance(loaded, Rejected) and loaded.profile is not None:
        found = list(loaded.diagnostics)
        return Judged(top=name, diagnostics=found, desk=desk, profile=loaded.profile, bad_profile=True)
    if isinstance(loaded, Checked):
        loaded = examine(loaded)
    own = {str(path.resolve()), *([str(loaded.profile.resolve())] if loaded.profile else [])}
    files = frozenset(desk.read) - own
    diagnostics = list(selected(loaded, NOTHING_ASKED).diagnostics)
    return Judged(top=name, diagnostics=diagnostics, desk=desk, profile=loaded.profile, files=files)


def _homeless(name: str, data: bytes) -> list[Diagnostic]:
    """What is wrong with a text that is no file: it has no profile, and nothing to include."""
    source, diagnostics = check_text(data, name)
    if source is None:
        return diagnostics
    parsed = parse_source(source, path=Path(name), machine=Machine())
    return list((examine(check(parsed)) if isinstance(parsed, Parsed) else parsed).diagnostics)


@dataclass(slots=True)
class Places:
    """Where the diagnostics of one look stand for the editor. `uris`: of open files, by resolved path."""

    judged: Judged
    uri: str
    text: Text
    uris: Mapping[str, str]
    unit: PositionEncodingKind | str
    known: dict[str, tuple[str, Text]] = field(default_factory=dict)

    def file(self, name: str) -> tuple[str, Text]:
        """URI and text of a file by its name in a diagnostic."""
        if name in ("", self.judged.top):
            return self.uri, self.text
        if name not in self.known:
            path = Path(name).resolve()
            try:
                data = self.judged.desk.bytes_of(path)
            except OSError:  # It is gone since.
                data = b""
            self.known[name] = self.uris.get(str(path)) or uri_of(Path(name)), Text(data, self.unit)
        return self.known[name]

    def location(self, span: Span, path: str = "") -> Location:
        """A span in its file."""
        uri, text = self.file(span.path or path)
        return Location(uri=uri, range=text.range(span))


def shown(places: Places) -> dict[str, list[Shown]]:
    """The diagnostics of a look by the URI of the file that each stands in. Included files are there if nothing is
    wrong, too: what was shown before is to go."""
    judged = places.judged
    found: dict[str, list[Shown]] = {places.uri: []}
    for name in judged.files:
        found.setdefault(places.uris.get(name) or uri_of(Path(name)), [])
    for diagnostic in judged.diagnostics:
        uri, text = places.file(diagnostic.span.path or diagnostic.path)
        mine = found.setdefault(uri, [])
        if len(mine) < MAX_SHOWN:
            mine.append(_shown(diagnostic, text, places))
    if judged.bad_profile:
        found[places.uri] = [_pointer(judged, places)]
    return found


def _shown(diagnostic: Diagnostic, text: Text, places: Places) -> Shown:
    unused = diagnostic.rule.code in _UNUSED
    related = [
        DiagnosticRelatedInformation(location=places.location(r.span, diagnostic.path), message=printable(r.localized))
        for r in diagnostic.remarks
    ]
    return Shown(
        range=text.range(diagnostic.span),
        message=printable(diagnostic.localized_with_count),
        severity=DiagnosticSeverity.Hint if unused else _SEVERITIES[diagnostic.severity],
        code=diagnostic.rule.code,
        source=SOURCE,
        tags=[DiagnosticTag.Unnecessary] if unused else None,
        related_information=related or None,
        data=replacement(diagnostic, text) or None,
    )


def _pointer(judged: Judged, places: Places) -> Shown:
    """A profile that can't be used: said in the job, too, since nothing else is said of it."""
    first = judged.diagnostics[0]
    profile = judged.profile.name if judged.profile else ""
    there = DiagnosticRelatedInformation(
        location=places.location(first.span, first.path), message=printable(first.localized)
    )
    return Shown(
        range=places.text.range(Span(line=1)),
        message=localized(Phrase("not checked: {profile}: {why}", profile=profile, why=printable(first.localized))),
        severity=DiagnosticSeverity.Error,
        code=first.rule.code,
        source=SOURCE,
        related_information=[there],
    )


def replacement(diagnostic: Diagnostic, text: Text) -> dict[str, str]:
    """The one word to put in the place of another, where a diagnostic's hint names it: {'old': ..., 'new': ...}."""
    hint = diagnostic.fields.get("hint", "")
    old = str(
        next((diagnostic.fields[k] for k in ("found", "name", "word", "call") if k in diagnostic.fields), "")
    ).strip("'")
    if not old or not isinstance(hint, Phrase):
        return {}
    if new := hint.fields.get("near"):
        return {"old": old, "new": new.lower() if old.islower() and new.isupper() else new}
    if hint == COMPARED:
        return {"old": old, "new": "=="}
    if glued := hint.fields.get("glued"):
        return {"old": f"{glued.removesuffix(old)} {old}", "new": glued}
    return {}
