"""Answers that change a text: its layout, and quick fixes."""

from __future__ import annotations

import re

import numpy as np
from lsprotocol import types as lsp

from gusjob import rules
from gusjob.lsp.asked import Asked, key_of
from gusjob.lsp.judge import replacement
from gusjob.lsp.text import Text, utf8
from gusjob.syntax.statements import strip_comment

# Layout.


def laid_out(asked: Asked) -> list[lsp.TextEdit] | None:
    """The edit that lays a job out as `gusjob fmt` does; none where it can't be read or is so already."""
    from gusjob.layout import formatted

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
    """For faults at a place whose hint names one replacement: that one."""
    if asked.judged is None:
        return None
    text, found = asked.task.text, []
    for fault in asked.judged.faults:
        if fault.span.path or fault.path != asked.judged.top or fault.rule is rules.MORE:
            continue
        where = text.range(fault.span)
        if key_of(where.end) < key_of(place.start) or key_of(place.end) < key_of(where.start):
            continue
        meant = replacement(fault, text)
        edit = _replaced(text, where, meant["old"], meant["new"]) if meant else None
        if edit is None:
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


def _replaced(text: Text, where: lsp.Range, old: str, new: str) -> lsp.TextEdit | None:
    """An edit of the one place where a word stands in a fault's line; None if there are two."""
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
