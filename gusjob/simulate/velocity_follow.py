"""Sums of power under velocity follow, without a term for each tick.

The velocity of a segment rises or falls to its peak, stays there, and falls: so does the power at the ticks. Each phase
is an arithmetic series, and a limit cuts its lower or its upper end off.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, rows_of
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import BaseLimits, PowerSettings, base_limits
from gusjob.simulate.tick_runs import RunSums, TickRuns


class _Series(Struct, frozen=True, kw_only=True, eq=False):
    """Arithmetic series, (r,): lowest value, step > 0, number of values. Where values fall, they count backwards."""

    bottom: Floats
    step: Floats
    count: Floats

    def pick(self, at: Bools) -> _Series:
        return _Series(bottom=self.bottom[at], step=self.step[at], count=self.count[at])

    def top(self) -> Floats:
        """The highest value; without any, -inf."""
        return np.where(self.count > 0, self.bottom + (self.count - 1) * self.step, -np.inf)

    def total(self) -> Floats:
        return np.asarray(self.count * (self.bottom + (self.count - 1) * self.step / 2))

    def below(self, limit: Floats) -> Floats:
        """Number of values below a limit."""
        return np.asarray(np.clip(np.ceil((limit - self.bottom) / self.step), 0.0, self.count))

    def above(self, limit: Floats) -> Floats:
        """Number of values above a limit."""
        return np.asarray(self.count - np.clip(np.floor((limit - self.bottom) / self.step) + 1, 0.0, self.count))

    def limited_total(self, lowest: Floats, highest: Floats) -> Floats:
        """Sum of the values, each kept within limits."""
        low, high = self.below(lowest), self.above(highest)
        count = np.maximum(self.count - low - high, 0.0)
        inside = count * (self.bottom + (low + (count - 1) / 2) * self.step)
        # Where the limits meet, no value is inside, and a value on both counts once.
        return np.asarray(low * lowest + inside + (self.count - low - count) * highest)


class _BaseSeries(Struct, frozen=True, kw_only=True, eq=False):
    """Base power at the ticks of runs: the first phase, the last one, and `level` at `level_count` ticks between."""

    first: _Series
    last: _Series
    level: Floats
    level_count: Floats
    slows: Bools
    """The first phase falls."""

    def pick(self, at: Bools) -> _BaseSeries:
        return _BaseSeries(
            first=self.first.pick(at),
            last=self.last.pick(at),
            level=self.level[at],
            level_count=self.level_count[at],
            slows=self.slows[at],
        )

    def lowest(self) -> Floats:
        level = np.where(self.level_count > 0, self.level, np.inf)
        for series in (self.first, self.last):
            level = np.minimum(level, np.where(series.count > 0, series.bottom, np.inf))
        return level

    def highest(self) -> Floats:
        level = np.where(self.level_count > 0, self.level, -np.inf)
        return np.maximum(np.maximum(level, self.first.top()), self.last.top())

    def at_last(self) -> Floats:
        """Base power at the last tick."""
        risen = np.where(self.slows, self.first.bottom, self.first.top())
        return np.where(self.last.count > 0, self.last.bottom, np.where(self.level_count > 0, self.level, risen))

    def total(self) -> Floats:
        return np.asarray(self.first.total() + self.level_count * self.level + self.last.total())

    def limited_total(self, limits: BaseLimits) -> Floats:
        """Sum of the power after its limits."""
        low, high = limits.lowest, limits.highest
        level = self.level_count * np.clip(self.level, low, high)
        return np.asarray(self.first.limited_total(low, high) + level + self.last.limited_total(low, high))

    def held(self, limits: BaseLimits) -> Floats:
        """Number of ticks at which a limit clamps the power."""
        low, high = limits.below, limits.above
        held = np.where((self.level < low) | (self.level > high), self.level_count, 0.0)
        for series in (self.first, self.last):
            held += np.minimum(series.below(low) + series.above(high), series.count)
        return held


def velocity_sums(motion: Motion, runs: TickRuns) -> RunSums:
    """Sum up the power of runs under velocity follow, or of direct power."""
    base = _base_series(motion, runs)
    total, last, lowest, highest = base.total(), base.at_last(), base.lowest(), base.highest()
    held, last_held = np.zeros(len(total)), np.zeros(len(total), dtype=np.bool_)
    settings = runs.settings
    met = (highest > np.minimum(settings.high, settings.mode_high)) | (lowest < settings.mode_low)
    if met.any():
        limits, base = base_limits(settings.pick(met)), base.pick(met)
        with np.errstate(invalid="ignore", over="ignore"):
            total[met], held[met] = base.limited_total(limits), base.held(limits)
        last_held[met] = (last[met] < limits.below) | (last[met] > limits.above)
        for column in (last, lowest, highest):
            column[met] = np.clip(column[met], limits.lowest, limits.highest)
    return RunSums(total=total, lowest=lowest, highest=highest, last=last, held=held, last_held=last_held)


def _base_series(motion: Motion, runs: TickRuns) -> _BaseSeries:
    """Compute the base power of runs."""
    profile, at, settings = motion.schedule.profile, rows_of(runs.segment), runs.settings
    start, peak, acc = profile.start[at], profile.peak[at], profile.acc[at]
    rising = runs.rising(motion)
    falling = runs.falling(motion, rising)
    gained = acc * runs.since_ms
    first, slows = start + gained, start > peak
    if slows.any():
        # The lowest is the last.
        lost = gained + acc * runs.period_ms * np.maximum(rising - 1, 0.0)
        first = np.where(slows, start - lost, first)
    step = np.maximum(settings.ratio * acc * runs.period_ms, np.finfo(np.float64).tiny)
    return _BaseSeries(
        first=_Series(bottom=_power(settings, first), step=step, count=rising),
        last=_Series(bottom=_power(settings, profile.end[at] + acc * runs.left_ms), step=step, count=falling),
        level=_power(settings, np.where(runs.still, 0.0, peak)),
        level_count=runs.count - rising - falling,
        slows=slows,
    )


def _power(settings: PowerSettings, velocity: Floats) -> Floats:
    return np.asarray(settings.low + settings.ratio * velocity)
