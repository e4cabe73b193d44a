"""Places in a text, and changes of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gusjob.diagnostics.model import Diagnostic
from gusjob.kinematics.arrays import Indices
from gusjob.pipeline import Checked


@dataclass(frozen=True, slots=True, order=True)
class Edit:
    """From byte `start` up to `end` of a text stands `new` instead."""

    start: int
    end: int
    new: bytes


Edits = tuple[Edit, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mend:
    """What takes a diagnostic away: edits of one text, made together or not at all."""

    diagnostic: Diagnostic
    edits: Edits


@dataclass(slots=True)
class Look:
    """A job that was judged, and the places in its text."""

    loaded: Checked
    data: bytes
    _starts: Indices | None = field(default=None, repr=False)

    def start(self, line: int) -> int:
        """The byte at which a line (from 1) begins."""
        if self._starts is None:
            ends = np.flatnonzero(np.frombuffer(self.data, dtype=np.uint8) == 10)
            self._starts = np.concatenate([[0], ends + 1])
        return int(self._starts[line - 1])

    def line(self, line: int) -> str:
        """The text of a line, without its end; a CR in front of it stays."""
        start = self.start(line)
        end = self.data.find(b"\n", start)
        return self.data[start : len(self.data) if end < 0 else end].decode()

    def edit(self, line: int, column: int, end_column: int, new: str) -> Edit:
        """What stands between two columns (from 1, the end behind) becomes something else."""
        text, start = self.line(line), self.start(line)
        return Edit(
            start + len(text[: column - 1].encode()), start + len(text[: end_column - 1].encode()), new.encode()
        )


def edited(data: bytes, edits: list[Edit]) -> bytes:
    """A text with edits that do not overlap; lines that are put in at the same place in the order of their words."""
    pieces, at = [], 0
    for edit in sorted(edits):
        pieces += [data[at : edit.start], edit.new]
        at = edit.end
    return b"".join([*pieces, data[at:]])


def apart(mends: list[Mend]) -> list[Mend]:
    """As many mends as can be made at once: of two that overlap the first."""
    kept: list[Mend] = []
    behind = 0
    for mend in sorted(mends, key=lambda m: m.edits[0].start):
        if mend.edits[0].start >= behind:
            behind = mend.edits[-1].end
            kept.append(mend)
    return kept
