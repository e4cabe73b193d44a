"""Held power of one channel: its integral over every segment, over any interval, and its value at any moment.

Power that does not change between two settings is integrated as it is; power that follows velocity or distance is
summed over the controller's ticks (ticks.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TypeVar

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices, counted, rows_of, where_true
from gusjob.kinematics.schedule import Schedule
from gusjob.simulate.beam import Beam
from gusjob.simulate.emission import Emission
from gusjob.simulate.events import LaserState
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import PowerSettings, PowerTimeline, StageLasers, limited, stage_lasers
from gusjob.simulate.ticks import SampledPower

_Values = TypeVar("_Values", Floats, Bools)
_BLOCK_PARTS = 1 << 15
"""Parts that are integrated at once: their columns fit in the processor's cache."""


class SegmentEmission(Struct, frozen=True, kw_only=True, eq=False):
    """Emission of one channel in each segment, (m,).

    Emission time in ms, integral of power (unit * ms), lowest and highest power while emitting (NaN if none), time in
    which a limit clamped the power, ms. `unpowered`: the laser emits while no power is set.
    """

    emission_ms: Floats
    power_ms: Floats
    power_min: Floats
    power_max: Floats
    clamped_ms: Floats
    unpowered: Bools


class _Parts(Struct, frozen=True, kw_only=True, eq=False):
    """Parts of intervals in order, (p,): the segment of each, start and end in ms, and the interval that it is of.

    None reaches over the end of its segment, or over a power that is set within it.
    """

    segment: Indices
    start: Floats
    end: Floats
    which: Indices

    def pick(self, at: Bools) -> _Parts:
        return _Parts(segment=self.segment[at], start=self.start[at], end=self.end[at], which=self.which[at])


class _Integrals(Struct, frozen=True, kw_only=True, eq=False):
    """Integrals over parts of segments, (p,) each."""

    time: Floats
    energy: Floats
    lowest: Floats
    highest: Floats
    clamped: Floats
    unpowered: Bools

    @classmethod
    def empty(cls, time: Floats, unpowered: Bools) -> _Integrals:
        """Make room for integrals."""
        energy, lowest, highest, clamped = (np.empty(len(time)) for _ in range(4))
        return cls(time=time, energy=energy, lowest=lowest, highest=highest, clamped=clamped, unpowered=unpowered)

    def pick(self, at: Bools) -> _Integrals:
        return _Integrals(**{name: getattr(self, name)[at] for name in self.__struct_fields__})


class HeldPower(Struct, frozen=True, kw_only=True, dict=True):
    """Held power of one channel: the power that it emits with while it emits.

    `timeline`: all power settings in order. `lasers`: state in each stage.
    """

    motion: Motion
    beam: Beam
    timeline: PowerTimeline
    lasers: tuple[LaserState, ...]
    period_ms: float

    @property
    def follows(self) -> bool:
        """Whether the power may change at ticks."""
        return bool((self.timeline.events.ratio > 0).any()) or any(laser.follows_distance for laser in self.lasers)

    def emitted(self, emission: Emission) -> tuple[SegmentEmission, float]:
        """Integrate over emission intervals, segment by segment.

        Emission after a stage's end counts for its last segment, as at rest there.

        Returns:
            The emission of each segment, and the integral of the power (unit * ms) that is emitted before the first
            segment of all.
        """
        schedule, totals, lost = self.motion.schedule, _SegmentTotals.zeros(len(self.motion)), 0.0
        for parts in self._parts(emission.intervals):
            totals.add(parts.segment, self._moving(parts, _duration(schedule, parts)))
        for stage, parts in self._tails(emission.intervals):
            rest, in_motion = self._at_rest(stage, parts), parts.segment >= 0
            lost += float(rest.energy[~in_motion].sum())
            totals.add(parts.segment[in_motion], rest.pick(in_motion))
        return totals.result(), lost

    def integral(self, intervals: Intervals) -> Floats:
        """Integrate over intervals, (k,) unit * ms, whether the laser emits or not."""
        total = np.zeros(len(intervals.stage))
        for parts in self._parts(intervals):
            # The parts of an interval follow each other.
            _add(total, parts.which, self._moving(parts, parts.end - parts.start).energy)
        for stage, parts in self._tails(intervals):
            total[parts.which] += self._at_rest(stage, parts).energy
        return total

    def value(self, stage: Indices, time: Floats) -> Floats:
        """Power at moments of stages, (k,), whether the laser emits or not."""
        value = np.empty(len(time))
        for first in range(0, len(time), _BLOCK_PARTS):
            block = slice(first, first + _BLOCK_PARTS)
            value[block] = self._block_value(stage[block], time[block])
        return value

    def _block_value(self, stage: Indices, time: Floats) -> Floats:
        segment = self.motion.schedule.segment_at(stage, time)
        timeline = self.timeline
        ended = time >= self._stage_end[stage]
        event = np.where(ended, timeline.last_of(stage), timeline.in_force(segment, time))
        settings, _ = self._settings(event, stage)
        value, _ = limited(settings, settings.low, None)
        sampled = self._is_sampled(settings, segment)
        if sampled.any():
            at = where_true(sampled)
            value[at] = self._sampled(at, settings, segment, event, time, time).at_start()
        return value

    @cached_property
    def _stage_lasers(self) -> StageLasers:
        return stage_lasers(self.lasers, self.motion.axes)

    @cached_property
    def _stage_start(self) -> Floats:
        return self.motion.schedule.stage_start()

    @cached_property
    def _stage_end(self) -> Floats:
        return self.motion.schedule.stage_end()

    def _parts(self, intervals: Intervals) -> Iterator[_Parts]:
        """Yield the parts of intervals within the stages' motion, a block at a time."""
        inside = self.timeline.time_ms[self.timeline.inside]
        for parts in _cut(self.motion.schedule, intervals):
            yield _cut_inside(parts, inside) if len(inside) else parts

    def _tails(self, intervals: Intervals) -> Iterator[tuple[Indices, _Parts]]:
        """Yield what of intervals is after the end of their stages, a block at a time: the stages and the parts.

        Their segment is the last of the stage, -1 before all motion.
        """
        limit = self._stage_end[intervals.stage]
        tails = np.flatnonzero(intervals.end_ms > limit)
        for first in range(0, len(tails), _BLOCK_PARTS):
            which = tails[first : first + _BLOCK_PARTS]
            stage = intervals.stage[which]
            yield (
                stage,
                _Parts(
                    segment=self.motion.schedule.stage_first[stage + 1] - 1,
                    start=np.maximum(intervals.start_ms[which], limit[which]),
                    end=intervals.end_ms[which],
                    which=which,
                ),
            )

    def _settings(self, event: Indices, stage: Indices) -> tuple[PowerSettings, Bools]:
        """Settings of parts, and whether no power is set yet (then the lowest that the mode allows)."""
        events, lasers = self.timeline.events, self._stage_lasers
        low = events.low[event]
        unset = np.isnan(low)
        low[unset] = 0.0
        settings = PowerSettings(
            low=low,
            ratio=events.ratio[event],
            high=events.high[event],
            mode_low=lasers.mode_low[stage],
            mode_high=lasers.mode_high[stage],
            stage=stage,
        )
        return settings, unset

    def _moving(self, parts: _Parts, time: Floats) -> _Integrals:
        """Integrate over parts of segments."""
        stage = self.motion.schedule.stage[parts.segment]
        return self._integrate(parts, stage, self.timeline.in_force(parts.segment, parts.start), time)

    def _at_rest(self, stage: Indices, parts: _Parts) -> _Integrals:
        """Integrate over parts after the end of their stages."""
        return self._integrate(parts, stage, self.timeline.last_of(stage), parts.end - parts.start)

    def _integrate(self, parts: _Parts, stage: Indices, event: Indices, time: Floats) -> _Integrals:
        settings, unset = self._settings(event, stage)
        sampled = self._is_sampled(settings, parts.segment)
        if not sampled.all():
            direct = _direct(settings, time, unset)
            if not sampled.any():
                return direct
        else:
            direct = _Integrals.empty(time, unset)
        at = where_true(sampled)
        found = self._sampled(at, settings, parts.segment, event, parts.start, parts.end).integrate()
        direct.energy[at], direct.lowest[at], direct.highest[at], direct.clamped[at] = found
        return direct

    def _is_sampled(self, settings: PowerSettings, segment: Indices) -> Bools:
        """Find the parts whose power is sampled at ticks."""
        follows = (settings.ratio > 0) | self._stage_lasers.by_distance[settings.stage]
        # Before the first segment of all there is neither velocity nor distance.
        return np.asarray(follows & (segment >= 0))

    def _sampled(
        self,
        at: Indices | slice,
        settings: PowerSettings,
        segment: Indices,
        event: Indices,
        start: Floats,
        end: Floats,
    ) -> SampledPower:
        """Sample the power of some of the parts."""
        origin = self._stage_start[settings.stage[at]]
        return SampledPower(
            motion=self.motion,
            beam=self.beam,
            lasers=self._stage_lasers,
            period_ms=self.period_ms,
            settings=settings.pick(at),
            segment=segment[at],
            origin=origin,
            # A setting takes effect at the earliest at the stage's start.
            set_at=np.maximum(self.timeline.time_ms[event[at]], origin),
            start=start[at],
            end=end[at],
        )


def _direct(settings: PowerSettings, time: Floats, unset: Bools) -> _Integrals:
    """Integrate power that does not change."""
    value, clamped = limited(settings, settings.low, None)
    return _Integrals(
        time=time,
        energy=value * time,
        lowest=value,
        highest=value.copy(),
        clamped=np.where(clamped, time, 0.0),
        unpowered=unset,
    )


def _cut(schedule: Schedule, intervals: Intervals) -> Iterator[_Parts]:
    """Cut intervals at segment ends, within the stages' motion, a block of parts at a time."""
    stage = intervals.stage
    if not len(stage) or not len(schedule.stage):
        return
    limit = schedule.stage_end()[stage]
    start, end = np.minimum(intervals.start_ms, limit), np.minimum(intervals.end_ms, limit)
    first = np.searchsorted(schedule.times_ms[1:], start, side="right")
    stop = np.searchsorted(schedule.times_ms[:-1], end, side="left")
    first = np.maximum(first, schedule.stage_first[stage])
    stop = np.minimum(stop, schedule.stage_first[stage + 1])
    counts = np.where(start < end, np.maximum(stop - first, 0), 0)
    behind = np.cumsum(counts)
    for begin in range(0, int(behind[-1]), _BLOCK_PARTS):
        upto = min(begin + _BLOCK_PARTS, int(behind[-1]))
        a, b = np.searchsorted(behind, begin, side="right"), np.searchsorted(behind, upto, side="left") + 1
        before = behind[a:b] - counts[a:b]
        which = np.repeat(np.arange(a, b), np.minimum(behind[a:b], upto) - np.maximum(before, begin))
        segment = np.arange(begin, upto) + (first[a:b] - before)[which - a]
        parts = _Parts(
            segment=segment,
            start=np.maximum(start[which], schedule.times_ms[segment]),
            end=np.minimum(end[which], schedule.times_ms[segment + 1]),
            which=which,
        )
        real = parts.start < parts.end
        yield parts if real.all() else parts.pick(real)


def _cut_inside(parts: _Parts, inside: Floats) -> _Parts:
    """Cut parts where another power is set within their segment; `inside`: these moments, in order, ms."""
    first = np.searchsorted(inside, parts.start, side="right")
    counts = np.maximum(np.searchsorted(inside, parts.end, side="left") - first, 0)
    part, number = counted(counts + 1)
    # Part k of a part begins at its k-th moment inside and ends at the next one.
    begins = np.append(-np.inf, inside)[np.where(number > 0, first[part] + number, 0)]
    ends = np.append(inside, np.inf)[np.where(number < counts[part], first[part] + number, len(inside))]
    cut = _Parts(
        segment=parts.segment[part],
        start=np.maximum(parts.start[part], begins),
        end=np.minimum(parts.end[part], ends),
        which=parts.which[part],
    )
    return cut.pick(cut.start < cut.end)


def _duration(schedule: Schedule, parts: _Parts) -> Floats:
    """Duration of each part; where it is the whole segment, the segment's own, so that no digits are lost."""
    segment, start, end = parts.segment, parts.start, parts.end
    whole = (start <= schedule.times_ms[segment]) & (end >= schedule.times_ms[segment + 1])
    return np.where(whole, schedule.duration_ms[segment], end - start)


class _SegmentTotals(Struct, frozen=True, kw_only=True, eq=False):
    """Integrals summed up by segment, (m,)."""

    time: Floats
    energy: Floats
    lowest: Floats
    highest: Floats
    clamped: Floats
    unpowered: Bools

    @classmethod
    def zeros(cls, count: int) -> _SegmentTotals:
        """Begin with no parts."""
        return cls(
            time=np.zeros(count),
            energy=np.zeros(count),
            lowest=np.full(count, np.inf),
            highest=np.full(count, -np.inf),
            clamped=np.zeros(count),
            unpowered=np.zeros(count, dtype=np.bool_),
        )

    def add(self, segment: Indices, parts: _Integrals) -> None:
        """Add parts; those of a segment follow each other."""
        begins = np.flatnonzero(np.diff(segment, prepend=-1))
        at, single = rows_of(segment[begins]), len(begins) == len(segment)

        def joined(operation: np.ufunc, values: _Values) -> _Values:
            return values if single else np.asarray(operation.reduceat(values, begins))

        self.time[at] += joined(np.add, parts.time)
        self.energy[at] += joined(np.add, parts.energy)
        # What is 0 everywhere takes no memory.
        if parts.clamped.any():
            self.clamped[at] += joined(np.add, parts.clamped)
        self.lowest[at] = np.minimum(self.lowest[at], joined(np.minimum, parts.lowest))
        self.highest[at] = np.maximum(self.highest[at], joined(np.maximum, parts.highest))
        if parts.unpowered.any():
            self.unpowered[at] |= joined(np.logical_or, parts.unpowered)

    def result(self) -> SegmentEmission:
        """Return the emission of each segment."""
        none = self.time <= 0
        self.lowest[none], self.highest[none] = np.nan, np.nan
        return SegmentEmission(
            emission_ms=self.time,
            power_ms=self.energy,
            power_min=self.lowest,
            power_max=self.highest,
            clamped_ms=self.clamped,
            unpowered=self.unpowered,
        )


def _add(total: Floats, which: Indices, values: Floats) -> None:
    """Add values to the totals of their number; those of a number follow each other."""
    if len(which):
        begins = np.flatnonzero(np.diff(which, prepend=-1))
        total[which[begins]] += np.add.reduceat(values, begins)
