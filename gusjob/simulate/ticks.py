"""Power that follows velocity or distance: sampled when it is set and at every tick, held in between, integrated.

Sums over ticks are closed where the power is a simple function of the tick's number: always under velocity follow
(velocity_follow.py), and under distance follow on lines as long as no limit is met (distance_follow.py). Elsewhere
every tick is computed.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices, counted, rows_of, where_true
from gusjob.simulate.beam import Beam
from gusjob.simulate.distance_follow import distance_sums
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import PowerSettings, StageLasers, limited
from gusjob.simulate.tick_runs import ON_TICK, RunSums, TickRuns, ticks_before
from gusjob.simulate.velocity_follow import velocity_sums

_CHUNK_TICKS = 1 << 15
"""Ticks that are computed at once: they fit in the processor's cache."""


class SampledPower(Struct, kw_only=True):
    """Parts of segments whose power is sampled, (p,): at `set_at` (ms), when it is set, then at every tick.

    `origin`: start of each part's stage, ms.
    """

    motion: Motion
    beam: Beam
    lasers: StageLasers
    period_ms: float
    settings: PowerSettings
    segment: Indices
    origin: Floats
    set_at: Floats
    start: Floats
    end: Floats

    def integrate(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Integrate each part: (integral, lowest, highest power, clamped time), (p,) each."""
        period, origin = self.period_ms, self.origin
        first, stop = ticks_before(self.start - origin, period), ticks_before(self.end - origin, period)
        count, first_tick = stop - first, origin + first * period
        has_ticks = count > 0
        # Up to the first tick inside: the sample of the last tick, or of the setting if that came later.
        head = np.where(has_ticks, first_tick, self.end) - self.start
        value, held = self._held_from(first - 1)
        with_head = head > ON_TICK * period
        energy = np.where(with_head, value * head, 0.0)
        clamped = np.where(with_head & held, head, 0.0)
        lowest, highest = np.where(with_head, value, np.inf), np.where(with_head, value, -np.inf)
        if not has_ticks.any():
            return energy, lowest, highest, clamped
        ticked = where_true(has_ticks)
        last_tick = (origin + (stop - 1) * period)[ticked]
        # The last tick is held up to the end of the part, all others for a period.
        short = period - (self.end[ticked] - last_tick)
        sums = self._sums(self._runs(ticked, count[ticked], first_tick[ticked], last_tick))
        energy[ticked] += sums.total * period - sums.last * short
        clamped[ticked] += sums.held * period - np.where(sums.last_held, short, 0.0)
        lowest[ticked] = np.minimum(lowest[ticked], sums.lowest)
        highest[ticked] = np.maximum(highest[ticked], sums.highest)
        return energy, lowest, highest, clamped

    def at_start(self) -> Floats:
        """Power held at each part's start, (p,)."""
        ticks = (self.start - self.origin) / self.period_ms
        return self._held_from(np.floor(ticks + ON_TICK + ticks * 1e-15))[0]

    def _held_from(self, tick: Floats) -> tuple[Floats, Bools]:
        """Power that a tick of each part samples, or its setting if that came later; whether a limit clamped it."""
        moment = np.maximum(np.maximum(self.origin + tick * self.period_ms, self.set_at), self.origin)
        return self.sample(self._segment_at(moment), moment, self.settings)

    def _segment_at(self, time: Floats) -> Indices:
        """Segment that runs at a moment of each part's stage: the part's own, or an earlier one."""
        schedule, segment = self.motion.schedule, self.segment
        times, stages = schedule.times_ms, self.settings.stage
        begun = times[segment] <= time
        if begun.all():
            return segment
        found = np.where(begun, segment, segment - 1)
        far = np.flatnonzero(~begun & (times[found] > time))
        found[far] = np.searchsorted(times[:-1], time[far], side="right") - 1
        first, last = schedule.stage_first[stages], schedule.stage_first[stages + 1] - 1
        return np.maximum(np.minimum(found, np.minimum(segment, last)), np.minimum(first, last))

    def _runs(self, part: Indices | slice, count: Floats, first_tick: Floats, last_tick: Floats) -> TickRuns:
        """Make the runs of parts with ticks inside."""
        schedule, segment = self.motion.schedule, self.segment[part]
        rows = rows_of(segment)
        begin, duration = schedule.times_ms[rows], schedule.duration_ms[rows]
        return TickRuns(
            settings=self.settings.pick(part),
            segment=segment,
            count=count,
            first_ms=first_tick,
            # By rounding, a tick may lie a little before its segment.
            since_ms=np.maximum(first_tick - begin, 0.0),
            left_ms=np.maximum(duration - (last_tick - begin), 0.0),
            still=schedule.dwell[rows] | (self.start[part] >= schedule.times_ms[1:][rows]),
            period_ms=self.period_ms,
        )

    def _sums(self, runs: TickRuns) -> RunSums:
        """Sum up the power of runs."""
        by_distance = self.lasers.by_distance[runs.settings.stage]
        if not by_distance.any():
            return velocity_sums(self.motion, runs)
        arcs, _ = self.motion.segments.arcs_among(runs.segment)
        curved = np.zeros(len(by_distance), dtype=np.bool_)
        curved[arcs] = True
        follows_beam = self.lasers.actual[runs.settings.stage] & ~self.beam.is_planned
        by_ticks = by_distance & (follows_beam | (curved & ~runs.still))
        sums = RunSums.empty(len(by_distance))
        if (at := np.flatnonzero(~by_distance)).size:
            sums.put(at, velocity_sums(self.motion, runs.pick(at)))
        if (at := np.flatnonzero(by_ticks)).size:
            sums.put(at, self.by_ticks(runs.pick(at)))
        if (at := np.flatnonzero(by_distance & ~by_ticks)).size:
            sums.put(at, distance_sums(self.motion, self.lasers, runs.pick(at), self.by_ticks))
        return sums

    def by_ticks(self, runs: TickRuns) -> RunSums:
        """Sum up the power of runs tick by tick, a chunk of ticks at a time."""
        parts = np.ceil(runs.count / _CHUNK_TICKS).astype(np.intp)
        run, number = counted(parts)
        skipped = (number * _CHUNK_TICKS).astype(np.float64)
        count = np.minimum(runs.count[run] - skipped, _CHUNK_TICKS)
        pieces, sums = runs.parts(run, skipped, count), RunSums.empty(len(run))
        chunk = (np.cumsum(count) - 1) // _CHUNK_TICKS
        edges = np.flatnonzero(np.diff(chunk)) + 1
        for a, b in zip([0, *edges.tolist()], [*edges.tolist(), len(run)], strict=True):
            at = np.arange(a, b)
            sums.put(at, self._tick_sums(pieces.pick(at)))
        return sums.joined(run)

    def _tick_sums(self, runs: TickRuns) -> RunSums:
        size = runs.count.astype(np.intp)
        which, number = counted(size)
        time = runs.first_ms[which] + number * self.period_ms
        value, held = self.sample(runs.segment[which], time, runs.settings.pick(which))
        begins = np.cumsum(size) - size
        ends = begins + size - 1
        return RunSums(
            total=np.add.reduceat(value, begins),
            lowest=np.minimum.reduceat(value, begins),
            highest=np.maximum.reduceat(value, begins),
            last=value[ends],
            held=np.add.reduceat(held.astype(np.float64), begins),
            last_held=held[ends],
        )

    def sample(self, segment: Indices, time: Floats, settings: PowerSettings) -> tuple[Floats, Bools]:
        """Power at moments, after all limits, and where a limit clamped it."""
        base = settings.low
        if (settings.ratio > 0).any():
            base = base + settings.ratio * self.motion.velocity(segment, time)
        has_term = self.lasers.by_distance[settings.stage].any()
        return limited(settings, base, self._distance_term(segment, time, settings.stage) if has_term else None)

    def _distance_term(self, segment: Indices, time: Floats, stage: Indices) -> tuple[Floats, Floats, Floats]:
        """Distance term and its limits (M 五.2): ratio per mm from the reference, summed over the axes."""
        lasers = self.lasers
        x, y = self.motion.position(segment, time)
        seen = np.flatnonzero(lasers.actual[stage])
        if len(seen) and not self.beam.is_planned:
            x[seen], y[seen] = self.beam.position(stage[seen], time[seen])
        term = lasers.constant[stage] + lasers.per_x[stage] * np.abs(x - lasers.reference_x[stage])
        term += lasers.per_y[stage] * np.abs(y - lasers.reference_y[stage])
        return term, lasers.low[stage], lasers.high[stage]
