"""Held power of one channel: its integral over every segment, over any interval, and its value at any moment.

Power that does not change between two settings is integrated as it is; power that follows velocity or distance is
summed over the controller's ticks (ticks.py).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, counted
from gusjob.kinematics.schedule import Schedule
from gusjob.simulate.beam import Beam
from gusjob.simulate.emission import Emission
from gusjob.simulate.events import LaserState
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import PowerSettings, PowerTimeline, limited
from gusjob.simulate.ticks import SampledPower

_BLOCK_PARTS = 1 << 17
"""Parts that are sampled at once: bounds the memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentEmission:
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Integrals:
    """Integrals over parts of segments, (p,) each."""

    time: Floats
    energy: Floats
    lowest: Floats
    highest: Floats
    clamped: Floats
    unpowered: Bools

    def pick(self, at: Bools) -> _Integrals:
        return _Integrals(**{name: getattr(self, name)[at] for name in self.__slots__})


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldPower:
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
        schedule = self.motion.schedule
        segment, start, end, _ = self._cut(emission.intervals)
        body = self._moving(segment, start, end, _duration(schedule, segment, start, end))
        ends, some = schedule.stage_end(), len(emission.stage)
        tail = np.flatnonzero(emission.end_ms > ends[emission.stage]) if some else np.empty(0, dtype=np.intp)
        tail_stage = emission.stage[tail]
        tail_segment = schedule.stage_first[tail_stage + 1] - 1
        tail_start = np.maximum(emission.start_ms[tail], ends[tail_stage])
        rest = self._at_rest(tail_segment, tail_stage, tail_start, emission.end_ms[tail])
        before_motion = tail_segment < 0
        lost = float(rest.energy[before_motion].sum()) if before_motion.any() else 0.0
        parts = [(segment, body), (tail_segment[~before_motion], rest.pick(~before_motion))]
        return _by_segment(parts, len(self.motion)), lost

    def integral(self, intervals: Intervals) -> Floats:
        """Integrate over intervals, (k,) unit * ms, whether the laser emits or not."""
        return np.concatenate([np.empty(0), *map(self._block_integral, intervals.blocks(_BLOCK_PARTS))])

    def value(self, stage: Indices, time: Floats) -> Floats:
        """Power at moments of stages, (k,), whether the laser emits or not."""
        blocks = [slice(first, first + _BLOCK_PARTS) for first in range(0, len(time), _BLOCK_PARTS)]
        return np.concatenate([np.empty(0), *(self._block_value(stage[block], time[block]) for block in blocks)])

    def _block_integral(self, intervals: Intervals) -> Floats:
        schedule, count = self.motion.schedule, len(intervals.stage)
        segment, start, end, which = self._cut(intervals)
        energy = self._moving(segment, start, end, end - start).energy
        total = np.bincount(which, weights=energy, minlength=count).astype(np.float64)
        limit = schedule.stage_end()[intervals.stage]
        tail = np.flatnonzero(intervals.end_ms > limit)
        if len(tail):
            stage, start = intervals.stage[tail], np.maximum(intervals.start_ms[tail], limit[tail])
            last = schedule.stage_first[stage + 1] - 1
            total[tail] += self._at_rest(last, stage, start, intervals.end_ms[tail]).energy
        return total

    def _block_value(self, stage: Indices, time: Floats) -> Floats:
        schedule = self.motion.schedule
        segment = schedule.segment_at(stage, time)
        timeline = self.timeline
        ended = time >= schedule.stage_end()[stage]
        event = np.where(ended, timeline.last_of(stage), timeline.in_force(segment, time))
        settings, _ = self._settings(event, stage)
        value, _ = limited(settings, settings.low, None)
        for at, sampled in self._sampled(settings, segment, stage, event, time, time):
            value[at] = sampled.at_start()
        return value

    def _cut(self, intervals: Intervals) -> tuple[Indices, Floats, Floats, Indices]:
        """Cut intervals at segment ends, and where another power is set within a segment; as _cut."""
        segment, start, end, which = _cut(self.motion.schedule, intervals)
        inside = self.timeline.time_ms[self.timeline.inside]
        if not len(inside):
            return segment, start, end, which
        first = np.searchsorted(inside, start, side="right")
        counts = np.maximum(np.searchsorted(inside, end, side="left") - first, 0)
        part, number = counted(counts + 1)
        # Part k of a part begins at its k-th moment inside and ends at the next one.
        begins = np.append(-np.inf, inside)[np.where(number > 0, first[part] + number, 0)]
        ends = np.append(inside, np.inf)[np.where(number < counts[part], first[part] + number, len(inside))]
        cut_start, cut_end = np.maximum(start[part], begins), np.minimum(end[part], ends)
        real = cut_start < cut_end
        return segment[part][real], cut_start[real], cut_end[real], which[part][real]

    def _settings(self, event: Indices, stage: Indices) -> tuple[PowerSettings, Bools]:
        """Settings of parts, and whether no power is set yet (then the lowest that the mode allows)."""
        events = self.timeline.events
        low = events.low[event]
        unset = np.isnan(low)
        modes_low = np.array([laser.low for laser in self.lasers])
        modes_high = np.array([laser.high for laser in self.lasers])
        settings = PowerSettings(
            low=np.where(unset, 0.0, low),
            ratio=events.ratio[event],
            high=events.high[event],
            mode_low=modes_low[stage],
            mode_high=modes_high[stage],
            stage=stage,
        )
        return settings, unset

    def _moving(self, segment: Indices, start: Floats, end: Floats, time: Floats) -> _Integrals:
        """Integrate over parts of segments."""
        stage = self.motion.schedule.stage[segment]
        return self._integrate(segment, stage, self.timeline.in_force(segment, start), start, end, time)

    def _at_rest(self, segment: Indices, stage: Indices, start: Floats, end: Floats) -> _Integrals:
        """Integrate over intervals after the end of a stage; `segment`: its last, or -1."""
        return self._integrate(segment, stage, self.timeline.last_of(stage), start, end, end - start)

    def _integrate(
        self, segment: Indices, stage: Indices, event: Indices, start: Floats, end: Floats, time: Floats
    ) -> _Integrals:
        settings, unset = self._settings(event, stage)
        value, clamped = limited(settings, settings.low, None)
        result = _Integrals(
            time=time,
            energy=value * time,
            lowest=value,
            highest=value.copy(),
            clamped=np.where(clamped, time, 0.0),
            unpowered=unset,
        )
        for at, sampled in self._sampled(settings, segment, stage, event, start, end):
            result.energy[at], result.lowest[at], result.highest[at], result.clamped[at] = sampled.integrate()
        return result

    def _sampled(
        self,
        settings: PowerSettings,
        segment: Indices,
        stage: Indices,
        event: Indices,
        start: Floats,
        end: Floats,
    ) -> Iterator[tuple[Indices, SampledPower]]:
        """Yield the parts whose power is sampled at ticks, a block at a time."""
        by_distance = np.array([laser.follows_distance for laser in self.lasers], dtype=np.bool_)
        # Before the first segment of all there is neither velocity nor distance.
        at_distance = by_distance[stage] & (segment >= 0)
        dynamic = np.flatnonzero(((settings.ratio > 0) & (segment >= 0)) | at_distance)
        for first in range(0, len(dynamic), _BLOCK_PARTS):
            at = dynamic[first : first + _BLOCK_PARTS]
            yield (
                at,
                SampledPower(
                    motion=self.motion,
                    beam=self.beam,
                    lasers=self.lasers,
                    period_ms=self.period_ms,
                    settings=settings.pick(at),
                    by_distance=at_distance[at],
                    segment=segment[at],
                    stage=stage[at],
                    set_at=self._set_at(event[at], stage[at]),
                    start=start[at],
                    end=end[at],
                ),
            )

    def _set_at(self, event: Indices, stage: Indices) -> Floats:
        """Moments at which power events took effect; at the earliest the stage's start."""
        return np.maximum(self.timeline.time_ms[event], self.motion.schedule.stage_start()[stage])


def _cut(schedule: Schedule, intervals: Intervals) -> tuple[Indices, Floats, Floats, Indices]:
    """Cut intervals at segment ends, within the stages' motion.

    Returns:
        Of each part: its segment, start and end in ms, and the interval that it belongs to.
    """
    stage = intervals.stage
    if not len(stage) or not len(schedule.stage):
        empty, none = np.empty(0), np.empty(0, dtype=np.intp)
        return none, empty, empty, none
    limit = schedule.stage_end()[stage]
    start, end = np.minimum(intervals.start_ms, limit), np.minimum(intervals.end_ms, limit)
    first = np.searchsorted(schedule.times_ms[1:], start, side="right")
    stop = np.searchsorted(schedule.times_ms[:-1], end, side="left")
    first = np.maximum(first, schedule.stage_first[stage])
    stop = np.minimum(stop, schedule.stage_first[stage + 1])
    counts = np.where(start < end, np.maximum(stop - first, 0), 0)
    which, number = counted(counts)
    segment = first[which] + number
    cut_start = np.maximum(start[which], schedule.times_ms[segment])
    cut_end = np.minimum(end[which], schedule.times_ms[segment + 1])
    real = cut_start < cut_end
    if real.all():
        return segment, cut_start, cut_end, which
    return segment[real], cut_start[real], cut_end[real], which[real]


def _duration(schedule: Schedule, segment: Indices, start: Floats, end: Floats) -> Floats:
    """Duration of each part; where it is the whole segment, the segment's own, so that no digits are lost."""
    whole = (start <= schedule.times_ms[segment]) & (end >= schedule.times_ms[segment + 1])
    return np.where(whole, schedule.duration_ms[segment], end - start)


def _by_segment(parts: list[tuple[Indices, _Integrals]], count: int) -> SegmentEmission:
    """Sum up parts by their segments."""

    def total(name: str) -> Floats:
        sums = np.zeros(count)
        for segment, integrals in parts:
            if len(segment):
                sums += np.bincount(segment, weights=getattr(integrals, name), minlength=count)
        return sums

    lowest, highest = np.full(count, np.inf), np.full(count, -np.inf)
    unpowered = np.zeros(count, dtype=np.bool_)
    for segment, integrals in parts:
        np.minimum.at(lowest, segment, integrals.lowest)
        np.maximum.at(highest, segment, integrals.highest)
        unpowered[segment[integrals.unpowered]] = True
    time = total("time")
    none = time <= 0
    lowest[none], highest[none] = np.nan, np.nan
    return SegmentEmission(
        emission_ms=time,
        power_ms=total("energy"),
        power_min=lowest,
        power_max=highest,
        clamped_ms=total("clamped"),
        unpowered=unpowered,
    )
