"""Spans of time in stages."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from gusjob.kinematics.arrays import Floats, Indices


@dataclass(frozen=True, slots=True, kw_only=True)
class Spans:
    """Spans of time in stages, (k,): stage numbers, start and end on the clock's axis, ms."""

    stage: Indices
    start_ms: Floats
    end_ms: Floats

    def blocks(self, size: int) -> Iterator[Spans]:
        """Some at a time, in order."""
        for first in range(0, len(self.stage), size):
            part = slice(first, first + size)
            yield Spans(stage=self.stage[part], start_ms=self.start_ms[part], end_ms=self.end_ms[part])
