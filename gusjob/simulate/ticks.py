"""Power that follows velocity or distance: sampled at its call and at every tick, held in between, summed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, counted
from gusjob.simulate.beam import Beam
from gusjob.simulate.path import Motion
from gusjob.simulate.settings import Setting, limited
from gusjob.simulate.state import LaserState

_ON_TICK = 1e-9
"""Share of a period by which a moment may miss a tick and still lie on it: rounding."""

_CHUNK_TICKS = 1 << 15
"""Ticks worked on at once: they stay in the processor's cache."""


def _ticks_before(time: Floats, period: float) -> Floats:
    """How many ticks lie before a time; one that lies on it but for rounding does not."""
    ticks = time / period
    return np.asarray(np.ceil(ticks - _ON_TICK - ticks * 1e-15))


@dataclass(slots=True, kw_only=True)
class Ticks:
    """Pieces whose power is sampled: at the moment of the power call, then at every tick, and held in between."""

    motion: Motion
    beam: Beam
    lasers: Sequence[LaserState]
    period_ms: float
    setting: Setting
    by_distance: Bools
    cell: Indices
    stage: Indices
    moment: Floats
    start: Floats
    end: Floats

    def integrate(self) -> tuple[Floats, Floats, Floats, Floats]:
        """(integral, lowest, highest, time held by a limit) per piece."""
        period = self.period_ms
        origin = self.motion.clock.stage_start()[self.stage]
        first = _ticks_before(self.start - origin, period)
        behind = _ticks_before(self.end - origin, period)
        count = np.maximum(behind - first, 0).astype(np.intp)
        first_tick = origin + first * period
        # Up to the first tick inside: what was sampled at the last tick, or at the power call if that came later.
        head = np.where(count > 0, first_tick, self.end) - self.start
        sampled_at = np.maximum(np.maximum(origin + (first - 1) * period, self.moment), origin)
        value, held = self.sample(self.segment_at(sampled_at), sampled_at, self.setting, self.by_distance)
        with_head = head > _ON_TICK * period
        energy = np.where(with_head, value * head, 0.0)
        clamped = np.where(with_head & held, head, 0.0)
        lowest, highest = np.where(with_head, value, np.inf), np.where(with_head, value, -np.inf)
        ticked = np.flatnonzero(count > 0)
        last_width = self.end - (origin + (behind - 1) * period)
        runs = _Runs(ticks=self, pieces=ticked, first=first_tick[ticked], count=count[ticked], last=last_width[ticked])
        runs.add(energy, lowest, highest, clamped)
        return energy, lowest, highest, clamped

    def held(self) -> Floats:
        """Power held at each piece's start."""
        origin = self.motion.clock.stage_start()[self.stage]
        ticks = (self.start - origin) / self.period_ms
        tick = np.floor(ticks + _ON_TICK + ticks * 1e-15)
        sampled_at = np.maximum(np.maximum(origin + tick * self.period_ms, self.moment), origin)
        return self.sample(self.segment_at(sampled_at), sampled_at, self.setting, self.by_distance)[0]

    def segment_at(self, time: Floats) -> Indices:
        """The timed call that runs at a moment of a piece's stage: its own, or an earlier one."""
        clock = self.motion.clock
        found = np.searchsorted(clock.times_ms[:-1], time, side="right") - 1
        first, last = clock.stage_first[self.stage], clock.stage_first[self.stage + 1] - 1
        return np.maximum(np.minimum(found, np.minimum(self.cell, last)), np.minimum(first, last))

    def sample(self, cell: Indices, time: Floats, setting: Setting, by_distance: Bools) -> tuple[Floats, Bools]:
        """Power at moments, through all limits, and where a limit held it."""
        motion = self.motion
        base = setting.low
        if (setting.ratio > 0).any():
            base = base + setting.ratio * motion.velocity(cell, time)
        if not by_distance.any():
            return limited(setting, base, None)
        return limited(setting, base, self.distance(cell, time, setting.laser))

    def distance(self, cell: Indices, time: Floats, stage: Indices) -> tuple[Floats, Floats, Floats]:
        """Distance term and its limits (M 五.2): ratio per mm from the reference, summed over the axes."""
        x, y = self.motion.position(cell, time)
        term = np.zeros(len(x))
        low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        for number in np.unique(stage).tolist():
            laser = self.lasers[number]
            if not laser.follows_distance:
                continue
            at = slice(None) if (stage[0] == stage).all() else stage == number
            seen = self.beam.position(stage[at], time[at]) if laser.distance_actual else (x[at], y[at])
            places = self.motion.axis_positions(number, *seen)
            for place, zero, scale, ratio in zip(
                places, laser.reference_pulse, laser.scale_pulse_per_mm, laser.ratio_per_mm, strict=True
            ):
                if ratio:
                    term[at] += ratio * np.abs(place - zero) / scale
            if laser.distance_limits is not None:
                low[at], high[at] = laser.distance_limits
        return term, low, high


@dataclass(slots=True, kw_only=True)
class _Runs:
    """Runs of whole ticks, chunk by chunk: a chunk stays in the processor's cache."""

    ticks: Ticks
    pieces: Indices
    first: Floats
    """Time of each run's first tick."""
    count: Indices
    last: Floats
    """How long each run's last tick is held, ms; the others are held a period."""

    def add(self, energy: Floats, lowest: Floats, highest: Floats, clamped: Floats) -> None:
        """Add the runs to their pieces' results."""
        period = self.ticks.period_ms
        # A run longer than a chunk is cut.
        parts = np.maximum(-(-self.count // _CHUNK_TICKS), 1)
        run, part = counted(parts)
        size = np.minimum(self.count[run] - part * _CHUNK_TICKS, _CHUNK_TICKS)
        begin = self.first[run] + part * _CHUNK_TICKS * period
        final = np.where(part == parts[run] - 1, self.last[run], period)
        chunk = (np.cumsum(size) - 1) // _CHUNK_TICKS
        edges = np.flatnonzero(np.diff(chunk)) + 1
        for a, b in zip([0, *edges.tolist()], [*edges.tolist(), len(run)], strict=True):
            if a == b:
                continue
            piece = self.pieces[run[a:b]]
            value, held, begins = self.values(piece, begin[a:b], size[a:b])
            ends = begins + size[a:b] - 1
            width_less = period - final[a:b]
            np.add.at(energy, piece, np.add.reduceat(value, begins) * period - value[ends] * width_less)
            np.minimum.at(lowest, piece, np.minimum.reduceat(value, begins))
            np.maximum.at(highest, piece, np.maximum.reduceat(value, begins))
            if held is not None:
                count_held = np.add.reduceat(held.astype(np.float64), begins)
                np.add.at(clamped, piece, count_held * period - held[ends] * width_less)

    def values(self, piece: Indices, begin: Floats, size: Indices) -> tuple[Floats, Bools | None, Indices]:
        """Power at every tick of some runs, where a limit held it (None: nowhere), and where each run begins."""
        begins = np.cumsum(size) - size
        steps = np.arange(int(size.sum()), dtype=np.float64) - np.repeat(begins.astype(np.float64), size)
        ticks = self.ticks
        motion, period = ticks.motion, ticks.period_ms
        setting, cell = ticks.setting, ticks.cell[piece]
        if ticks.by_distance[piece].any() or motion.slows_first(cell):
            which = np.repeat(np.arange(len(piece)), size)
            time, each = begin[which] + steps * period, piece[which]
            value, held = ticks.sample(cell[which], time, setting.pick(each), ticks.by_distance[each])
            return value, held, begins
        # Velocity follow alone: power is the lowest of three straight lines, each a constant and a slope per tick.
        rise, fall, slope, peak = motion.lines(cell, begin)
        ratio, low = setting.ratio[piece], setting.low[piece]
        rise, fall, slope, peak = low + ratio * rise, low + ratio * fall, ratio * slope * period, low + ratio * peak
        grown = np.repeat(slope, size)
        grown *= steps
        value = np.repeat(rise, size)
        value += grown
        down = np.repeat(fall, size)
        down -= grown
        np.minimum(value, down, out=value)
        np.minimum(value, np.repeat(peak, size), out=value)
        top = np.minimum(setting.high[piece], setting.mode_high[piece])
        if (peak <= top).all() and (low >= setting.mode_low[piece]).all():
            return value, None, begins
        clipped, held = limited(setting.pick(np.repeat(piece, size)), value, None)
        return clipped, held, begins
