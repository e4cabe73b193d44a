"""Edits of a text: formatting and quick fixes."""

from __future__ import annotations

import re

import numpy as np
from lsprotocol import types as lsp
from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.diagnostics.fixes import FIXES, apply_fixes, key_of
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.statement_parser import strip_comment
from gusjob.i18n.phrases import Phrase, localized
from gusjob.lsp.diagnostics import replacement
from gusjob.lsp.query import Query, position_key
from gusjob.lsp.text import Text, utf8
from gusjob.lsp.workspace import Workspace
from gusjob.pipeline import Checked, FileResult, examine, load

_BOM = b"\xef\xbb\xbf"

# Formatting.


def format_edits(query: Query) -> list[lsp.TextEdit] | None:
    """Return the edit that formats a job as `gusjob fmt` does.

    Returns:
        None for a listing; an empty list if the job has a syntax error or is formatted already.
    """
    from gusjob.frontend.format import format_text

    text = query.task.text
    if query.is_listing:
        return None
    old = text.data.decode("utf-8", "replace")
    new, _ = format_text(old)
    if new is None or new == old:
        return []
    return [_changed_lines_edit(text, utf8(new))]


def _changed_lines_edit(text: Text, new: bytes) -> lsp.TextEdit:
    """Return the edit of the lines that differ, so that the editor's cursor and marks stay where they are."""
    old = text.data
    first = old.rfind(b"\n", 0, _common_prefix(old, new)) + 1
    shorter = min(len(old), len(new)) - first
    common_end = _common_prefix(old[len(old) - shorter :][::-1], new[len(new) - shorter :][::-1])
    cut = old.find(b"\n", len(old) - common_end) + 1 if common_end else 0
    common_end = len(old) - cut if cut else 0
    changed = lsp.Range(start=text.position(first), end=text.position(len(old) - common_end))
    return lsp.TextEdit(range=changed, new_text=new[first : len(new) - common_end].decode())


def _common_prefix(a: bytes, b: bytes) -> int:
    """Return the length of the common beginning of two texts, bytes."""
    length = min(len(a), len(b))
    differ = np.frombuffer(a, dtype=np.uint8, count=length) != np.frombuffer(b, dtype=np.uint8, count=length)
    return int(np.argmax(differ)) if differ.any() else length


# Quick fixes.


def quick_fixes(query: Query, selected_range: lsp.Range) -> list[lsp.CodeAction] | None:
    """Return fixes for the diagnostics in a range.

    A diagnostic whose hint names one replacement gets that one, others the fix of `gusjob check --fix`.
    """
    if query.diagnosis is None:
        return None
    text, found, fix_finder = query.task.text, list[lsp.CodeAction](), _FixFinder(query)
    for diagnostic in query.diagnosis.diagnostics:
        if diagnostic.span.path or diagnostic.path != query.diagnosis.top or diagnostic.rule is rules.NOT_LISTED:
            continue
        span = text.range(diagnostic.span)
        if position_key(span.end) < position_key(selected_range.start) or position_key(
            selected_range.end
        ) < position_key(span.start):
            continue
        words = replacement(diagnostic, text)
        edit = _word_edit(text, span, words["old"], words["new"]) if words else None
        if edit is None:
            found += fix_finder.action(diagnostic)
            continue
        found.append(
            lsp.CodeAction(
                title=f"Replace {words['old']} with {words['new']}",
                kind=lsp.CodeActionKind.QuickFix,
                edit=lsp.WorkspaceEdit(changes={query.task.uri: [edit]}),
                is_preferred=True,
            )
        )
    return found


MAX_FIXES = 8
"""Maximum number of fixes that are tried for a range: each is verified, which takes as long as checking the text."""


class _FixFinder(Struct):
    """The fixes of one text. The text is checked when the first diagnostic that has a fix is met."""

    query: Query
    tried: int = 0
    before: FileResult | None = None

    def action(self, diagnostic: Diagnostic) -> list[lsp.CodeAction]:
        """Return the fix of `gusjob check --fix` for a diagnostic, if there is one."""
        task, diagnosis = self.query.task, self.query.diagnosis
        own = diagnosis is not None and task.path is not None and diagnosis.top == str(task.path)
        if diagnostic.rule.code not in FIXES or not own or self.tried >= MAX_FIXES:
            return []
        self.tried += 1
        if self.before is None:
            loaded = self.load(task.text.data)
            self.before = examine(loaded) if isinstance(loaded, Checked) else loaded
        if not isinstance(self.before, Checked):
            return []
        key = key_of(diagnostic)
        fixed = apply_fixes(self.before, self.load, lambda other: key_of(other) == key)
        if not fixed.count:
            return []
        bom = _BOM * task.text.data.startswith(_BOM)
        edit = lsp.WorkspaceEdit(changes={task.uri: [_changed_lines_edit(task.text, bom + fixed.data)]})
        title = localized(Phrase("Fix: {title}", title=Phrase(diagnostic.rule.title)))
        return [lsp.CodeAction(title=title, kind=lsp.CodeActionKind.QuickFix, edit=edit, is_preferred=True)]

    def load(self, data: bytes) -> FileResult:
        """Load a text in place of the editor's, with all other open texts."""
        task = self.query.task
        assert task.path is not None
        return load(Workspace(task.open_texts).path(task.path), None, data=data)


def _word_edit(text: Text, span: lsp.Range, old: str, new: str) -> lsp.TextEdit | None:
    """Return the edit of a word in a diagnostic's line; None unless it occurs exactly once."""
    first = int(text.starts[span.start.line])
    line = text.line(span.start.line)
    pattern = r"\s+".join(re.escape(part) for part in old.split())
    matches = list(re.finditer(rf"(?<!\w){pattern}(?!\w)" if old[:1].isalnum() else pattern, strip_comment(line)))
    start, end = text.offset(span.start), text.offset(span.end)
    offsets = [(first + len(line[: m.start()].encode()), first + len(line[: m.end()].encode())) for m in matches]
    inside = [(a, b) for a, b in offsets if a < max(end, start + 1) and b > start]
    if len(inside) != 1:
        return None
    a, b = inside[0]
    return lsp.TextEdit(range=lsp.Range(start=text.position(a), end=text.position(b)), new_text=new)
