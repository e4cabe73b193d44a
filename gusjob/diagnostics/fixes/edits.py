"""Edits of a text, and the context in which a fix computes them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from gusjob.diagnostics.model import Diagnostic
from gusjob.kinematics.arrays import Indices
from gusjob.pipeline import Checked


class Edit(Struct, frozen=True, order=True):
    """Replace the bytes from `start` up to `end` of a text by `new`."""

    start: int
    end: int
    new: bytes


Edits = tuple[Edit, ...]


class Fix(Struct, frozen=True, kw_only=True):
    """Edits that together remove a diagnostic."""

    diagnostic: Diagnostic
    edits: Edits


class FixContext(Struct):
    """A checked job with its text, in which fixes look up lines and positions.

    `correct_line`: returns a line that can't be read without its slips, None if that is not enough.
    """

    loaded: Checked
    data: bytes
    correct_line: Callable[[str], str | None]
    _starts: Indices | None = None

    def start(self, line: int) -> int:
        """Return the byte offset at which a line (from 1) begins."""
        if self._starts is None:
            ends = np.flatnonzero(np.frombuffer(self.data, dtype=np.uint8) == 10)
            self._starts = np.concatenate([[0], ends + 1])
        return int(self._starts[line - 1])

    def line(self, line: int) -> str:
        """Return the text of a line without its LF; a CR before it stays."""
        start = self.start(line)
        end = self.data.find(b"\n", start)
        return self.data[start : len(self.data) if end < 0 else end].decode()

    def edit(self, line: int, column: int, end_column: int, new: str) -> Edit:
        """Return the edit that replaces the text between two columns of a line (from 1, the end exclusive)."""
        text, start = self.line(line), self.start(line)
        return Edit(
            start + len(text[: column - 1].encode()), start + len(text[: end_column - 1].encode()), new.encode()
        )


def apply_edits(data: bytes, edits: list[Edit]) -> bytes:
    """Apply edits that do not overlap. Lines inserted at the same position are sorted by their text."""
    parts, at = [], 0
    for edit in sorted(edits):
        parts += [data[at : edit.start], edit.new]
        at = edit.end
    return b"".join([*parts, data[at:]])


def without_overlaps(fixes: list[Fix]) -> list[Fix]:
    """Return the fixes that can be applied together: the first one of two that overlap."""
    kept: list[Fix] = []
    end = 0
    for fix in sorted(fixes, key=lambda f: f.edits[0].start):
        if fix.edits[0].start >= end:
            end = fix.edits[-1].end
            kept.append(fix)
    return kept
