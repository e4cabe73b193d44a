"""Power that follows velocity or distance: sampled when it is set and at every tick, held in between, integrated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, counted
from gusjob.simulate.beam import Beam
from gusjob.simulate.events import LaserState
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import PowerSettings, limited

_ON_TICK = 1e-9
"""Share of a period by which a moment may miss a tick and still count as on it: rounding."""

_CHUNK_TICKS = 1 << 15
"""Ticks that are computed at once: they fit in the processor's cache."""


def _ticks_before(time: Floats, period: float) -> Floats:
    """Number of ticks before each time; a tick at the time itself does not count, rounding aside."""
    ticks = time / period
    return np.asarray(np.ceil(ticks - _ON_TICK - ticks * 1e-15))


@dataclass(slots=True, kw_only=True)
class SampledPower:
    """Parts of segments whose power is sampled, (p,): at `set_at` (ms), when it is set, then at every tick."""

    motion: Motion
    beam: Beam
    lasers: Sequence[LaserState]
    period_ms: float
    settings: PowerSettings
    by_distance: Bools
    segment: Indices
    stage: Indices
    set_at: Floats
    start: Floats
    end: Floats

    def integrate(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Integrate each part: (integral, lowest, highest power, clamped time), (p,) each."""
        period = self.period_ms
        origin = self.motion.schedule.stage_start()[self.stage]
        first = _ticks_before(self.start - origin, period)
        stop = _ticks_before(self.end - origin, period)
        count = np.maximum(stop - first, 0).astype(np.intp)
        first_tick = origin + first * period
        # Up to the first tick inside: the sample of the last tick, or of the setting if that came later.
        head = np.where(count > 0, first_tick, self.end) - self.start
        sampled_at = np.maximum(np.maximum(origin + (first - 1) * period, self.set_at), origin)
        value, held = self.sample(self._segment_at(sampled_at), sampled_at, self.settings, self.by_distance)
        with_head = head > _ON_TICK * period
        energy = np.where(with_head, value * head, 0.0)
        clamped = np.where(with_head & held, head, 0.0)
        lowest, highest = np.where(with_head, value, np.inf), np.where(with_head, value, -np.inf)
        ticked = np.flatnonzero(count > 0)
        last_width = self.end - (origin + (stop - 1) * period)
        runs = _TickRuns(
            sampled=self, part=ticked, first=first_tick[ticked], count=count[ticked], last=last_width[ticked]
        )
        runs.add(energy, lowest, highest, clamped)
        return energy, lowest, highest, clamped

    def at_start(self) -> Floats:
        """Power held at each part's start, (p,)."""
        origin = self.motion.schedule.stage_start()[self.stage]
        ticks = (self.start - origin) / self.period_ms
        tick = np.floor(ticks + _ON_TICK + ticks * 1e-15)
        sampled_at = np.maximum(np.maximum(origin + tick * self.period_ms, self.set_at), origin)
        return self.sample(self._segment_at(sampled_at), sampled_at, self.settings, self.by_distance)[0]

    def _segment_at(self, time: Floats) -> Indices:
        """Segment that runs at a moment of each part's stage: the part's own, or an earlier one."""
        schedule = self.motion.schedule
        found = np.searchsorted(schedule.times_ms[:-1], time, side="right") - 1
        first, last = schedule.stage_first[self.stage], schedule.stage_first[self.stage + 1] - 1
        return np.maximum(np.minimum(found, np.minimum(self.segment, last)), np.minimum(first, last))

    def sample(
        self, segment: Indices, time: Floats, settings: PowerSettings, by_distance: Bools
    ) -> tuple[Floats, Bools]:
        """Power at moments, after all limits, and where a limit clamped it."""
        motion = self.motion
        base = settings.low
        if (settings.ratio > 0).any():
            base = base + settings.ratio * motion.velocity(segment, time)
        if not by_distance.any():
            return limited(settings, base, None)
        return limited(settings, base, self._distance_term(segment, time, settings.stage))

    def _distance_term(self, segment: Indices, time: Floats, stage: Indices) -> tuple[Floats, Floats, Floats]:
        """Distance term and its limits (M 五.2): ratio per mm from the reference, summed over the axes."""
        x, y = self.motion.position(segment, time)
        term = np.zeros(len(x))
        low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        for number in np.unique(stage).tolist():
            laser = self.lasers[number]
            if not laser.follows_distance:
                continue
            at = slice(None) if (stage[0] == stage).all() else stage == number
            seen = self.beam.position(stage[at], time[at]) if laser.distance_actual else (x[at], y[at])
            positions = self.motion.axis_positions(number, *seen)
            for position, reference, scale, ratio in zip(
                positions, laser.reference_pulse, laser.scale_pulse_per_mm, laser.ratio_per_mm, strict=True
            ):
                if ratio:
                    term[at] += ratio * np.abs(position - reference) / scale
            if laser.distance_limits is not None:
                low[at], high[at] = laser.distance_limits
        return term, low, high


@dataclass(slots=True, kw_only=True)
class _TickRuns:
    """Runs of whole ticks, (r,), one for each part with ticks inside."""

    sampled: SampledPower
    part: Indices
    first: Floats
    """Time of each run's first tick."""
    count: Indices
    last: Floats
    """Time for which each run's last tick is held, ms; the others are held for a period."""

    def add(self, energy: Floats, lowest: Floats, highest: Floats, clamped: Floats) -> None:
        """Add the runs to the results of their parts, a chunk at a time."""
        period = self.sampled.period_ms
        # A run longer than a chunk is cut.
        parts = np.maximum(-(-self.count // _CHUNK_TICKS), 1)
        run, number = counted(parts)
        size = np.minimum(self.count[run] - number * _CHUNK_TICKS, _CHUNK_TICKS)
        begin = self.first[run] + number * _CHUNK_TICKS * period
        final = np.where(number == parts[run] - 1, self.last[run], period)
        chunk = (np.cumsum(size) - 1) // _CHUNK_TICKS
        edges = np.flatnonzero(np.diff(chunk)) + 1
        for a, b in zip([0, *edges.tolist()], [*edges.tolist(), len(run)], strict=True):
            if a == b:
                continue
            part = self.part[run[a:b]]
            value, held, begins = self._values(part, begin[a:b], size[a:b])
            ends = begins + size[a:b] - 1
            width_less = period - final[a:b]
            np.add.at(energy, part, np.add.reduceat(value, begins) * period - value[ends] * width_less)
            np.minimum.at(lowest, part, np.minimum.reduceat(value, begins))
            np.maximum.at(highest, part, np.maximum.reduceat(value, begins))
            if held is not None:
                count_held = np.add.reduceat(held.astype(np.float64), begins)
                np.add.at(clamped, part, count_held * period - held[ends] * width_less)

    def _values(self, part: Indices, begin: Floats, size: Indices) -> tuple[Floats, Bools | None, Indices]:
        """Power at every tick of some runs, where a limit clamped it (None: nowhere), and each run's first index."""
        begins = np.cumsum(size) - size
        steps = np.arange(int(size.sum()), dtype=np.float64) - np.repeat(begins.astype(np.float64), size)
        sampled = self.sampled
        motion, period = sampled.motion, sampled.period_ms
        settings, segment = sampled.settings, sampled.segment[part]
        if sampled.by_distance[part].any() or motion.starts_above_peak(segment):
            which = np.repeat(np.arange(len(part)), size)
            time, each = begin[which] + steps * period, part[which]
            value, held = sampled.sample(segment[which], time, settings.pick(each), sampled.by_distance[each])
            return value, held, begins
        # Velocity follow alone: power is the lowest of three straight lines, each a constant and a slope per tick.
        rise, fall, slope, peak = motion.velocity_lines(segment, begin)
        ratio, low = settings.ratio[part], settings.low[part]
        rise, fall, slope, peak = low + ratio * rise, low + ratio * fall, ratio * slope * period, low + ratio * peak
        grown = np.repeat(slope, size)
        grown *= steps
        value = np.repeat(rise, size)
        value += grown
        down = np.repeat(fall, size)
        down -= grown
        np.minimum(value, down, out=value)
        np.minimum(value, np.repeat(peak, size), out=value)
        top = np.minimum(settings.high[part], settings.mode_high[part])
        if (peak <= top).all() and (low >= settings.mode_low[part]).all():
            return value, None, begins
        clipped, held = limited(settings.pick(np.repeat(part, size)), value, None)
        return clipped, held, begins
