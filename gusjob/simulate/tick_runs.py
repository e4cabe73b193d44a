"""Runs of ticks, and sums of the power at their ticks."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import PowerSettings

ON_TICK = 1e-9
"""Share of a period by which a moment may miss a tick and still count as on it: rounding."""

_NOT_COLUMNS = ("settings", "period_ms")


def ticks_before(time: Floats, period: float) -> Floats:
    """Number of ticks before each time; a tick at the time itself does not count, rounding aside."""
    ticks = time / period
    return np.asarray(np.ceil(ticks - ON_TICK - ticks * 1e-15))


class TickRuns(Struct, frozen=True, kw_only=True, eq=False):
    """Ticks that follow each other within one segment and under one setting, (r,); no run is empty.

    `count`: number of ticks. `since_ms`: from the segment's start to the first tick. `left_ms`: from the last tick to
    the segment's end. `first_ms`: the first tick. Counts and times are relative to the segment: late in a long job no
    digits are lost. `still`: nothing moves, in a dwell or after the stage's end.
    """

    settings: PowerSettings
    segment: Indices
    count: Floats
    first_ms: Floats
    since_ms: Floats
    left_ms: Floats
    still: Bools
    period_ms: float

    def pick(self, at: Indices | slice) -> TickRuns:
        """Pick some of the runs."""
        columns = {name: getattr(self, name) for name in self.__struct_fields__ if name not in _NOT_COLUMNS}
        picked = {name: column[at] for name, column in columns.items()}
        return TickRuns(settings=self.settings.pick(at), period_ms=self.period_ms, **picked)

    def parts(self, run: Indices, skipped: Floats, count: Floats) -> TickRuns:
        """Take `count` ticks of some runs, after the first `skipped`."""
        skipped_ms = skipped * self.period_ms
        return TickRuns(
            settings=self.settings.pick(run),
            segment=self.segment[run],
            count=count,
            first_ms=self.first_ms[run] + skipped_ms,
            since_ms=self.since_ms[run] + skipped_ms,
            left_ms=self.left_ms[run] + (self.count[run] - skipped - count) * self.period_ms,
            still=self.still[run],
            period_ms=self.period_ms,
        )

    def rising(self, motion: Motion) -> Floats:
        """Number of ticks in the first phase, (r,): up to the highest velocity, or down to it."""
        rise = np.ceil((motion.schedule.profile.rise_ms[self.segment] - self.since_ms) / self.period_ms)
        return np.where(self.still, 0.0, np.clip(rise, 0.0, self.count))

    def falling(self, motion: Motion, rising: Floats) -> Floats:
        """Number of ticks in the last phase, (r,)."""
        fall = np.ceil((motion.schedule.profile.fall_ms[self.segment] - self.left_ms) / self.period_ms)
        return np.where(self.still, 0.0, np.clip(fall, 0.0, self.count - rising))


class RunSums(Struct, frozen=True, kw_only=True, eq=False):
    """Power at the ticks of runs, (r,): its sum, the lowest and the highest, and that of the last tick.

    `held`: number of ticks at which a limit clamps the power. `last_held`: whether the last is one of these.
    """

    total: Floats
    lowest: Floats
    highest: Floats
    last: Floats
    held: Floats
    last_held: Bools

    @classmethod
    def empty(cls, count: int) -> RunSums:
        """Make room for runs."""
        return cls(
            **{name: np.empty(count, np.bool_ if name == "last_held" else np.float64) for name in cls.__struct_fields__}
        )

    def put(self, at: Indices | slice, sums: RunSums) -> None:
        """Set the sums of some of the runs."""
        for name in self.__struct_fields__:
            getattr(self, name)[at] = getattr(sums, name)

    def joined(self, run: Indices) -> RunSums:
        """Join runs of the same number, which follow each other; the numbers have no gap."""
        begins = np.flatnonzero(np.diff(run, prepend=-1))
        if len(begins) == len(run):
            return self
        ends = np.append(begins[1:], len(run)) - 1
        return RunSums(
            total=np.add.reduceat(self.total, begins),
            lowest=np.minimum.reduceat(self.lowest, begins),
            highest=np.maximum.reduceat(self.highest, begins),
            last=self.last[ends],
            held=np.add.reduceat(self.held, begins),
            last_held=self.last_held[ends],
        )
