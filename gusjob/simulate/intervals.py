"""Intervals of time within stages."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from gusjob.kinematics.arrays import Floats, Indices


class Intervals(Struct, frozen=True, kw_only=True, eq=False):
    """Intervals of time, (k,): stage number of each, start and end on the schedule's time axis, ms."""

    stage: Indices
    start_ms: Floats
    end_ms: Floats

    def blocks(self, size: int) -> Iterator[Intervals]:
        """Yield the intervals in order, at most `size` at a time."""
        for first in range(0, len(self.stage), size):
            block = slice(first, first + size)
            yield Intervals(stage=self.stage[block], start_ms=self.start_ms[block], end_ms=self.end_ms[block])
