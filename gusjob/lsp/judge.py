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

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Severity, Span
from gusjob.diagnostics.select import NOTHING_ASKED
from gusjob.frontend import check_text
from gusjob.frontend.parse.statements import COMPARED
from gusjob.i18n.phrases import Phrase, printable, said
from gusjob.lsp.desk import Desk, uri_of
from gusjob.lsp.text import Text
from gusjob.pipeline import Loaded, load, look_closer, selected
from gusjob.pipeline import judge as judge_source

SOURCE = "gusjob"
MAX_SHOWN = 500
"""So many faults of a file are sent. An editor that is sent all of ten thousand does nothing else for a second."""

_SEVERITIES = {
    Severity.ERROR: DiagnosticSeverity.Error,
    Severity.WARNING: DiagnosticSeverity.Warning,
    Severity.NOTE: DiagnosticSeverity.Information,
}
_UNUSED = {rules.NEVER_READ.code, rules.NEVER_CALLED.code}


@dataclass(slots=True)
class Judged:
    """All faults of a text. `files`: resolved paths of what it includes."""

    top: str
    faults: list[Diagnostic]
    desk: Desk
    profile: Path | None = None
    bad_profile: bool = False
    files: frozenset[str] = field(default_factory=frozenset)


def judge(name: str, path: Path | None, data: bytes, desk: Desk) -> Judged:
    """Judge a text that may not be saved yet. `path` is where it would be; None: nowhere."""
    if path is None:
        return Judged(top=name, faults=_homeless(name, data), desk=desk)
    loaded = load(desk.path(path), None)
    desk.watch_for_profile(path)
    if loaded.profile is not None and loaded.job is None and loaded.stream is None and loaded.faults:
        return Judged(top=name, faults=loaded.faults, desk=desk, profile=loaded.profile, bad_profile=True)
    look_closer(loaded)
    own = {str(path.resolve()), *([str(loaded.profile.resolve())] if loaded.profile else [])}
    files = frozenset(desk.read) - own
    faults = selected(loaded, NOTHING_ASKED)
    return Judged(top=name, faults=faults, desk=desk, profile=loaded.profile, files=files)


def _homeless(name: str, data: bytes) -> list[Diagnostic]:
    """What is wrong with a text that is no file: it has no profile, and nothing to include."""
    source, faults = check_text(data, name)
    if source is None:
        return faults
    loaded = Loaded(path=Path(name), source=source)
    judge_source(loaded, source)
    look_closer(loaded)
    return loaded.faults


@dataclass(slots=True)
class Places:
    """Where the faults of one look stand for the editor. `uris`: of open files, by resolved path."""

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
    """The faults of a look by the URI of the file that each stands in. Included files are there if nothing is wrong,
    too: what was shown before is to go."""
    judged = places.judged
    found: dict[str, list[Shown]] = {places.uri: []}
    for name in judged.files:
        found.setdefault(places.uris.get(name) or uri_of(Path(name)), [])
    for fault in judged.faults:
        uri, text = places.file(fault.span.path or fault.path)
        mine = found.setdefault(uri, [])
        if len(mine) < MAX_SHOWN:
            mine.append(_shown(fault, text, places))
    if judged.bad_profile:
        found[places.uri] = [_pointer(judged, places)]
    return found


def _shown(fault: Diagnostic, text: Text, places: Places) -> Shown:
    unused = fault.rule.code in _UNUSED
    related = [
        DiagnosticRelatedInformation(location=places.location(r.span, fault.path), message=printable(r.said))
        for r in fault.remarks
    ]
    return Shown(
        range=text.range(fault.span),
        message=printable(fault.said_with_count),
        severity=DiagnosticSeverity.Hint if unused else _SEVERITIES[fault.severity],
        code=fault.rule.code,
        source=SOURCE,
        tags=[DiagnosticTag.Unnecessary] if unused else None,
        related_information=related or None,
        data=replacement(fault, text) or None,
    )


def _pointer(judged: Judged, places: Places) -> Shown:
    """A profile that can't be used: said in the job, too, since nothing else is said of it."""
    first = judged.faults[0]
    profile = judged.profile.name if judged.profile else ""
    there = DiagnosticRelatedInformation(
        location=places.location(first.span, first.path), message=printable(first.said)
    )
    return Shown(
        range=places.text.range(Span(line=1)),
        message=said(Phrase("not checked: {profile}: {why}", profile=profile, why=printable(first.said))),
        severity=DiagnosticSeverity.Error,
        code=first.rule.code,
        source=SOURCE,
        related_information=[there],
    )


def replacement(fault: Diagnostic, text: Text) -> dict[str, str]:
    """The one word to put in the place of another, where a fault's hint names it: {'old': ..., 'new': ...}."""
    hint = fault.fields.get("hint", "")
    old = str(next((fault.fields[k] for k in ("found", "name", "word", "call") if k in fault.fields), "")).strip("'")
    if not old or not isinstance(hint, Phrase):
        return {}
    if new := hint.fields.get("near"):
        return {"old": old, "new": new.lower() if old.islower() and new.isupper() else new}
    if hint == COMPARED:
        return {"old": old, "new": "=="}
    if glued := hint.fields.get("glued"):
        return {"old": f"{glued.removesuffix(old)} {old}", "new": glued}
    return {}
