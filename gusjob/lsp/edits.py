"""Answers that change a text: its layout, and quick fixes."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from lsprotocol import types as lsp

from gusjob.diagnostics import rules
from gusjob.diagnostics.fixes import MENDS, key_of, mended
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.statements import strip_comment
from gusjob.i18n.phrases import Phrase, localized
from gusjob.lsp.asked import Asked
from gusjob.lsp.asked import key_of as place_key
from gusjob.lsp.desk import Desk
from gusjob.lsp.judge import replacement
from gusjob.lsp.text import Text, utf8
from gusjob.pipeline import Checked, FileResult, examine, load

_BOM = b"\xef\xbb\xbf"

# Layout.


def laid_out(asked: Asked) -> list[lsp.TextEdit] | None:
    """The edit that lays a job out as `gusjob fmt` does; none where it can't be read or is so already."""
    from gusjob.frontend.format import formatted

    text = asked.task.text
    if asked.is_listing:
        return None
    old = text.data.decode("utf-8", "replace")
    new, _ = formatted(old)
    if new is None or new == old:
        return []
    return [_edit(text, utf8(new))]


def _edit(text: Text, new: bytes) -> lsp.TextEdit:
    """What differs between two texts, in whole lines: the editor's cursor and marks stay where they are."""
    old = text.data
    first = old.rfind(b"\n", 0, _common(old, new)) + 1
    shorter = min(len(old), len(new)) - first
    behind = _common(old[len(old) - shorter :][::-1], new[len(new) - shorter :][::-1])
    cut = old.find(b"\n", len(old) - behind) + 1 if behind else 0
    behind = len(old) - cut if cut else 0
    place = lsp.Range(start=text.position(first), end=text.position(len(old) - behind))
    return lsp.TextEdit(range=place, new_text=new[first : len(new) - behind].decode())


def _common(a: bytes, b: bytes) -> int:
    """How many bytes two texts begin with in common."""
    length = min(len(a), len(b))
    differ = np.frombuffer(a, dtype=np.uint8, count=length) != np.frombuffer(b, dtype=np.uint8, count=length)
    return int(np.argmax(differ)) if differ.any() else length


# Quick fixes.


def fixes(asked: Asked, place: lsp.Range) -> list[lsp.CodeAction] | None:
    """For diagnostics at a place whose hint names one replacement: that one; else the mend of `gusjob check --fix`."""
    if asked.judged is None:
        return None
    text, found, mending = asked.task.text, list[lsp.CodeAction](), _Mending(asked)
    for diagnostic in asked.judged.diagnostics:
        if diagnostic.span.path or diagnostic.path != asked.judged.top or diagnostic.rule is rules.MORE:
            continue
        where = text.range(diagnostic.span)
        if place_key(where.end) < place_key(place.start) or place_key(place.end) < place_key(where.start):
            continue
        meant = replacement(diagnostic, text)
        edit = _replaced(text, where, meant["old"], meant["new"]) if meant else None
        if edit is None:
            found += mending.action(diagnostic)
            continue
        found.append(
            lsp.CodeAction(
                title=f"Replace {meant['old']} by {meant['new']}",
                kind=lsp.CodeActionKind.QuickFix,
                edit=lsp.WorkspaceEdit(changes={asked.task.uri: [edit]}),
                is_preferred=True,
            )
        )
    return found


MAX_MENDS = 8
"""So many mends are looked for at a place: each is proved, which takes as long as judging the text."""


@dataclass(slots=True)
class _Mending:
    """The mends of one text; nothing is judged before there is a diagnostic that has one."""

    asked: Asked
    looked_for: int = 0
    before: FileResult | None = None

    def action(self, diagnostic: Diagnostic) -> list[lsp.CodeAction]:
        """What `gusjob check --fix` would make of one diagnostic, if it would."""
        task, judged = self.asked.task, self.asked.judged
        own = judged is not None and task.path is not None and judged.top == str(task.path)
        if diagnostic.rule.code not in MENDS or not own or self.looked_for >= MAX_MENDS:
            return []
        self.looked_for += 1
        if self.before is None:
            loaded = self.loaded(task.text.data)
            self.before = examine(loaded) if isinstance(loaded, Checked) else loaded
        if not isinstance(self.before, Checked):
            return []
        key = key_of(diagnostic)
        done = mended(self.before, self.loaded, lambda other: key_of(other) == key)
        if not done.count:
            return []
        bom = _BOM * task.text.data.startswith(_BOM)
        edit = lsp.WorkspaceEdit(changes={task.uri: [_edit(task.text, bom + done.data)]})
        title = localized(Phrase("Mend: {title}", title=Phrase(diagnostic.rule.title)))
        return [lsp.CodeAction(title=title, kind=lsp.CodeActionKind.QuickFix, edit=edit, is_preferred=True)]

    def loaded(self, data: bytes) -> FileResult:
        """A text in the place of the editor's, with all that is open beside it."""
        task = self.asked.task
        assert task.path is not None
        return load(Desk(task.open_texts).path(task.path), None, data=data)


def _replaced(text: Text, where: lsp.Range, old: str, new: str) -> lsp.TextEdit | None:
    """An edit of the one place where a word stands in a diagnostic's line; None if there are two."""
    first = int(text.starts[where.start.line])
    line = text.line(where.start.line)
    pattern = r"\s+".join(re.escape(part) for part in old.split())
    matches = list(re.finditer(rf"(?<!\w){pattern}(?!\w)" if old[:1].isalnum() else pattern, strip_comment(line)))
    start, end = text.offset(where.start), text.offset(where.end)
    offsets = [(first + len(line[: m.start()].encode()), first + len(line[: m.end()].encode())) for m in matches]
    inside = [(a, b) for a, b in offsets if a < max(end, start + 1) and b > start]
    if len(inside) != 1:
        return None
    a, b = inside[0]
    return lsp.TextEdit(range=lsp.Range(start=text.position(a), end=text.position(b)), new_text=new)
