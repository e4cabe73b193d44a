"""How much each laser emits: the integral of its power over every segment.

Power that does not change between calls is integrated as it is; following is summed over the ticks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, counted
from gusjob.simulate.beam import Beam
from gusjob.simulate.clock import Clock
from gusjob.simulate.emission import Emission
from gusjob.simulate.path import Motion
from gusjob.simulate.settings import PowerCalls, Setting, limited
from gusjob.simulate.spans import Spans
from gusjob.simulate.state import LaserState
from gusjob.simulate.ticks import Ticks

_BLOCK_PIECES = 1 << 17
"""Pieces that are ticked at once: bounds the memory."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Emitted:
    """Per timed call, (m,): what one channel emitted.

    Emission in ms, integral of power (unit * ms), lowest and highest power while emitting (NaN if none), time in
    which a limit held it, ms. `unpowered`: light was on while no power had been set.
    """

    emission_ms: Floats
    power_ms: Floats
    power_min: Floats
    power_max: Floats
    clamped_ms: Floats
    unpowered: Bools


def emitted(
    motion: Motion, beam: Beam, emission: Emission, powers: PowerCalls, lasers: list[LaserState], period_ms: float
) -> tuple[Emitted, float]:
    """What a channel emits in each timed call, and the power * ms of light that belongs to none (no motion at all)."""
    integrator = _Integrator(motion=motion, beam=beam, powers=powers, lasers=lasers, period_ms=period_ms)
    clock = motion.clock
    count = len(clock.row)
    cell, start, end, _ = _cut(clock, emission.stage, emission.start_ms, emission.end_ms)
    body = integrator.pieces(cell, start, end, _whole(clock, cell, start, end))
    ends = clock.stage_end()
    tail = np.flatnonzero(emission.end_ms > ends[emission.stage]) if len(emission.stage) else np.empty(0, dtype=np.intp)
    tail_stage = emission.stage[tail]
    tail_cell = clock.stage_first[tail_stage + 1] - 1
    tail_start = np.maximum(emission.start_ms[tail], ends[tail_stage])
    rest = integrator.tails(tail_cell, tail_stage, tail_start, emission.end_ms[tail])
    homeless = tail_cell < 0
    lost = float(rest.energy[homeless].sum()) if homeless.any() else 0.0
    parts = [(cell, body), (tail_cell[~homeless], rest.pick(~homeless))]
    return _gather(parts, count), lost


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pieces:
    """Integrals over pieces of emission, (p,) each."""

    time: Floats
    energy: Floats
    lowest: Floats
    highest: Floats
    clamped: Floats
    unpowered: Bools

    def pick(self, at: Bools) -> _Pieces:
        return _Pieces(**{name: getattr(self, name)[at] for name in self.__slots__})


def integrals(
    motion: Motion, beam: Beam, powers: PowerCalls, lasers: list[LaserState], period_ms: float, spans: Spans
) -> Floats:
    """Integral of held power over spans of time, (k,), unit * ms; behind its stage's end the light shines at rest."""
    integrator = _Integrator(motion=motion, beam=beam, powers=powers, lasers=lasers, period_ms=period_ms)
    return np.concatenate([np.empty(0), *map(integrator.over, spans.blocks(_BLOCK_PIECES))])


def held_power(
    motion: Motion,
    beam: Beam,
    powers: PowerCalls,
    lasers: list[LaserState],
    period_ms: float,
    stage: Indices,
    time: Floats,
) -> Floats:
    """Power held at moments of stages, (k,), through all limits, whether light is on or not."""
    integrator = _Integrator(motion=motion, beam=beam, powers=powers, lasers=lasers, period_ms=period_ms)
    parts = [slice(first, first + _BLOCK_PIECES) for first in range(0, len(time), _BLOCK_PIECES)]
    return np.concatenate([np.empty(0), *(integrator.held(stage[part], time[part]) for part in parts)])


def _cut(clock: Clock, stage: Indices, begin: Floats, finish: Floats) -> tuple[Indices, Floats, Floats, Indices]:
    """Spans cut at the segments' ends, within the stages' motion: (timed call, start, end, span) of each piece."""
    if not len(stage) or not len(clock.row):
        empty, none = np.empty(0), np.empty(0, dtype=np.intp)
        return none, empty, empty, none
    limit = clock.stage_end()[stage]
    start, end = np.minimum(begin, limit), np.minimum(finish, limit)
    first = np.searchsorted(clock.times_ms[1:], start, side="right")
    last = np.searchsorted(clock.times_ms[:-1], end, side="left")
    first = np.maximum(first, clock.stage_first[stage])
    last = np.minimum(last, clock.stage_first[stage + 1])
    counts = np.where(start < end, np.maximum(last - first, 0), 0)
    which, number = counted(counts)
    cell = first[which] + number
    cut_start = np.maximum(start[which], clock.times_ms[cell])
    cut_end = np.minimum(end[which], clock.times_ms[cell + 1])
    real = cut_start < cut_end
    if real.all():
        return cell, cut_start, cut_end, which
    return cell[real], cut_start[real], cut_end[real], which[real]


def _whole(clock: Clock, cell: Indices, start: Floats, end: Floats) -> Floats:
    """Length of each piece: the segment's own duration where it covers all of it, so that no digits are lost."""
    covers = (start <= clock.times_ms[cell]) & (end >= clock.times_ms[cell + 1])
    return np.where(covers, clock.duration_ms[cell], end - start)


@dataclass(slots=True, kw_only=True)
class _Integrator:
    motion: Motion
    beam: Beam
    powers: PowerCalls
    lasers: list[LaserState]
    period_ms: float

    def setting(self, event: Indices, stage: Indices) -> tuple[Setting, Bools]:
        """Settings per piece, and whether no power was set yet (then the lowest that the mode allows)."""
        low = self.powers.low[event]
        unset = np.isnan(low)
        modes_low = np.array([laser.low for laser in self.lasers])
        modes_high = np.array([laser.high for laser in self.lasers])
        setting = Setting(
            low=np.where(unset, 0.0, low),
            ratio=self.powers.ratio[event],
            high=self.powers.high[event],
            mode_low=modes_low[stage],
            mode_high=modes_high[stage],
            laser=stage,
        )
        return setting, unset

    def pieces(self, cell: Indices, start: Floats, end: Floats, time: Floats) -> _Pieces:
        """Pieces within motion."""
        stage = self.motion.clock.stage[cell]
        event = np.searchsorted(self.powers.boundary, cell, side="right") - 1
        return self.integrate(cell, stage, event, start, end, time)

    def tails(self, cell: Indices, stage: Indices, start: Floats, end: Floats) -> _Pieces:
        """Light behind the end of a stage's motion, at rest there."""
        event = np.searchsorted(self.powers.stage, stage, side="right") - 1
        return self.integrate(cell, stage, event, start, end, end - start)

    def integrate(
        self, cell: Indices, stage: Indices, event: Indices, start: Floats, end: Floats, time: Floats
    ) -> _Pieces:
        setting, unset = self.setting(event, stage)
        value, held = limited(setting, setting.low, None)
        result = _Pieces(
            time=time,
            energy=value * time,
            lowest=value,
            highest=value.copy(),
            clamped=np.where(held, time, 0.0),
            unpowered=unset,
        )
        for at, ticks in self.ticked(setting, cell, stage, event, start, end):
            result.energy[at], result.lowest[at], result.highest[at], result.clamped[at] = ticks.integrate()
        return result

    def ticked(
        self, setting: Setting, cell: Indices, stage: Indices, event: Indices, start: Floats, end: Floats
    ) -> Iterator[tuple[Indices, Ticks]]:
        """The pieces whose power is sampled, some at a time."""
        far = np.array([laser.follows_distance for laser in self.lasers], dtype=np.bool_)
        # Before the first motion nothing moves and nothing is away from anywhere.
        by_distance = far[stage] & (cell >= 0)
        dynamic_at = np.flatnonzero(((setting.ratio > 0) & (cell >= 0)) | by_distance)
        for block in range(0, len(dynamic_at), _BLOCK_PIECES):
            at = dynamic_at[block : block + _BLOCK_PIECES]
            yield (
                at,
                Ticks(
                    motion=self.motion,
                    beam=self.beam,
                    lasers=self.lasers,
                    period_ms=self.period_ms,
                    setting=setting.pick(at),
                    by_distance=by_distance[at],
                    cell=cell[at],
                    stage=stage[at],
                    moment=self.moment(event[at], stage[at]),
                    start=start[at],
                    end=end[at],
                ),
            )

    def held(self, stage: Indices, time: Floats) -> Floats:
        """Power held at moments."""
        clock = self.motion.clock
        cell = clock.segment_at(stage, time)
        at_rest = time >= clock.stage_end()[stage]
        last_event = np.searchsorted(self.powers.stage, stage, side="right") - 1
        event = np.where(at_rest, last_event, np.searchsorted(self.powers.boundary, cell, side="right") - 1)
        setting, _ = self.setting(event, stage)
        value, _ = limited(setting, setting.low, None)
        for at, ticks in self.ticked(setting, cell, stage, event, time, time):
            value[at] = ticks.held()
        return value

    def over(self, spans: Spans) -> Floats:
        """Integral over spans, behind the end of motion too."""
        clock, count = self.motion.clock, len(spans.stage)
        cell, start, end, which = _cut(clock, spans.stage, spans.start_ms, spans.end_ms)
        energy = self.pieces(cell, start, end, end - start).energy
        total = np.bincount(which, weights=energy, minlength=count).astype(np.float64)
        limit = clock.stage_end()[spans.stage]
        tail = np.flatnonzero(spans.end_ms > limit)
        if len(tail):
            stage, start = spans.stage[tail], np.maximum(spans.start_ms[tail], limit[tail])
            total[tail] += self.tails(clock.stage_first[stage + 1] - 1, stage, start, spans.end_ms[tail]).energy
        return total

    def moment(self, event: Indices, stage: Indices) -> Floats:
        """When the power call in force acted; at the earliest the stage's start."""
        clock = self.motion.clock
        boundary = np.minimum(self.powers.boundary[event], len(clock.times_ms) - 1)
        return np.maximum(clock.times_ms[boundary], clock.stage_start()[stage])


def _gather(parts: list[tuple[Indices, _Pieces]], count: int) -> Emitted:
    """Pieces summed up per timed call."""

    def total(name: str) -> Floats:
        sums = np.zeros(count)
        for cell, pieces in parts:
            if len(cell):
                sums += np.bincount(cell, weights=getattr(pieces, name), minlength=count)
        return sums

    lowest, highest = np.full(count, np.inf), np.full(count, -np.inf)
    unpowered = np.zeros(count, dtype=np.bool_)
    for cell, pieces in parts:
        np.minimum.at(lowest, cell, pieces.lowest)
        np.maximum.at(highest, cell, pieces.highest)
        unpowered[cell[pieces.unpowered]] = True
    time = total("time")
    none = time <= 0
    lowest[none], highest[none] = np.nan, np.nan
    return Emitted(
        emission_ms=time,
        power_ms=total("energy"),
        power_min=lowest,
        power_max=highest,
        clamped_ms=total("clamped"),
        unpowered=unpowered,
    )
