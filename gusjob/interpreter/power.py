"""How much each laser emits: power held from tick to tick, and its integral over every segment.

Order of limits: base power (direct, or follow clamped to its max), distance term added and clamped to its limits,
then the mode's limits. Power that does not change between calls is integrated as it is; following is summed over the
ticks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.interpreter.clock import Clock
from gusjob.interpreter.path import Motion
from gusjob.interpreter.state import LaserState, Program
from gusjob.interpreter.switch import Emission
from gusjob.stream import Buffered, BufferedCalls

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]

CLAMPED = 1e-9
"""Relative distance beyond a limit from which a power counts as held by it: rounding, not physics."""

_ON_TICK = 1e-9
"""Share of a period by which a moment may miss a tick and still lie on it: rounding."""

_CHUNK_TICKS = 1 << 15
_BLOCK_PIECES = 1 << 17


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCalls:
    """Power calls of one channel in order, (e,): the number of the timed call before which each acts, and what it sets.

    low: direct power, or the follow minimum; ratio 0: direct; high: follow maximum (inf if direct). NaN low: no
    power set yet.
    """

    boundary: Indices
    stage: Indices
    low: Floats
    ratio: Floats
    high: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Power settings per piece, (p,) each. `distance`: whether a distance term is added, with its own limits."""

    low: Floats
    ratio: Floats
    high: Floats
    mode_low: Floats
    mode_high: Floats
    laser: Indices
    """Stage whose distance settings hold."""

    def pick(self, at: Indices | Bools) -> Setting:
        """The settings at indices or a mask."""
        return Setting(**{name: getattr(self, name)[at] for name in self.__slots__})


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


def power_calls(calls: BufferedCalls, clock: Clock, program: Program, channel: int) -> PowerCalls:
    """Every power and follow call of a channel, buffered or immediate, in the order in which they act."""
    kind = calls.kind[clock.rows]
    mine = np.flatnonzero(
        ((kind == Buffered.POWER) | (kind == Buffered.FOLLOW)) & (calls.channel[clock.rows] == channel)
    )
    rows = clock.rows[mine]
    follow = calls.kind[rows] == Buffered.FOLLOW
    stage, boundary = clock.stage_of_row[mine], clock.boundary[mine]
    low = np.where(follow, calls.q[rows], calls.p[rows])
    ratio = np.where(follow, calls.p[rows], 0.0)
    high = np.where(follow, calls.r[rows], np.inf)
    rank = np.full(len(mine), 1, dtype=np.int8)
    extra: list[tuple[int, int, float, int]] = [(-1, 0, float("nan"), 0)]
    for number, run in enumerate(program.stages):
        first = int(clock.stage_first[number])
        extra += [(number, first, a.power, 0) for a in run.at_rest if a.channel == channel and a.power is not None]
        extra += [(number, first, a.power, 2) for a in run.moving if a.channel == channel and a.power is not None]
    more = len(extra)
    stage = np.concatenate([np.array([e[0] for e in extra], dtype=np.intp), stage])
    boundary = np.concatenate([np.array([e[1] for e in extra], dtype=np.intp), boundary])
    low = np.concatenate([np.array([e[2] for e in extra]), low])
    ratio = np.concatenate([np.zeros(more), ratio])
    high = np.concatenate([np.full(more, np.inf), high])
    rank = np.concatenate([np.array([e[3] for e in extra], dtype=np.int8), rank])
    if more > 1:
        # At rest before what is buffered; while moving behind what is buffered before the first motion.
        order = np.lexsort((rank, boundary, stage))
        stage, boundary = stage[order], boundary[order]
        low, ratio, high = low[order], ratio[order], high[order]
    return PowerCalls(boundary=boundary, stage=stage, low=low, ratio=ratio, high=high)


def emitted(
    motion: Motion, emission: Emission, powers: PowerCalls, lasers: list[LaserState], period_ms: float
) -> tuple[Emitted, float]:
    """What a channel emits in each timed call, and the power * ms of light that belongs to none (no motion at all)."""
    integrator = _Integrator(motion=motion, powers=powers, lasers=lasers, period_ms=period_ms)
    clock = motion.clock
    count = len(clock.row)
    cell, start, end = _cut(clock, emission)
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


def _cut(clock: Clock, emission: Emission) -> tuple[Indices, Floats, Floats]:
    """Emission cut at the segments' ends, within the stages' motion: (timed call, start, end) of each piece."""
    if not len(emission.stage) or not len(clock.row):
        empty = np.empty(0)
        return np.empty(0, dtype=np.intp), empty, empty
    limit = clock.stage_end()[emission.stage]
    start, end = np.minimum(emission.start_ms, limit), np.minimum(emission.end_ms, limit)
    first = np.searchsorted(clock.times[1:], start, side="right")
    last = np.searchsorted(clock.times[:-1], end, side="left")
    first = np.maximum(first, clock.stage_first[emission.stage])
    last = np.minimum(last, clock.stage_first[emission.stage + 1])
    counts = np.where(start < end, np.maximum(last - first, 0), 0)
    which = np.repeat(np.arange(len(counts)), counts)
    cell = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts) + first[which]
    cut_start = np.maximum(start[which], clock.times[cell])
    cut_end = np.minimum(end[which], clock.times[cell + 1])
    real = cut_start < cut_end
    return (cell, cut_start, cut_end) if real.all() else (cell[real], cut_start[real], cut_end[real])


def _whole(clock: Clock, cell: Indices, start: Floats, end: Floats) -> Floats:
    """Length of each piece: the segment's own duration where it covers all of it, so that no digits are lost."""
    covers = (start <= clock.times[cell]) & (end >= clock.times[cell + 1])
    return np.where(covers, clock.duration_ms[cell], end - start)


@dataclass(slots=True, kw_only=True)
class _Integrator:
    motion: Motion
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
        far = np.array([laser.follows_distance for laser in self.lasers], dtype=np.bool_)
        # Before the first motion nothing moves and nothing is away from anywhere.
        by_distance = far[stage] & (cell >= 0)
        dynamic = ((setting.ratio > 0) & (cell >= 0)) | by_distance
        value, held = limited(setting, setting.low, None)
        result = _Pieces(
            time=time,
            energy=value * time,
            lowest=value,
            highest=value.copy(),
            clamped=np.where(held, time, 0.0),
            unpowered=unset,
        )
        dynamic_at = np.flatnonzero(dynamic)
        for block in range(0, len(dynamic_at), _BLOCK_PIECES):
            at = dynamic_at[block : block + _BLOCK_PIECES]
            ticked = _Ticks(
                integrator=self,
                setting=setting.pick(at),
                by_distance=by_distance[at],
                cell=cell[at],
                stage=stage[at],
                moment=self.moment(event[at], stage[at]),
                start=start[at],
                end=end[at],
            )
            result.energy[at], result.lowest[at], result.highest[at], result.clamped[at] = ticked.integrate()
        return result

    def moment(self, event: Indices, stage: Indices) -> Floats:
        """When the power call in force acted; at the earliest the stage's start."""
        clock = self.motion.clock
        boundary = np.minimum(self.powers.boundary[event], len(clock.times) - 1)
        return np.maximum(clock.times[boundary], clock.stage_start()[stage])


def limited(setting: Setting, base: Floats, distance: tuple[Floats, Floats, Floats] | None) -> tuple[Floats, Bools]:
    """Base power through all limits, and where one of them held it. `distance`: (term, its min, its max)."""
    value = np.minimum(base, setting.high)
    held = base > setting.high * (1 + CLAMPED)
    if distance is not None:
        term, low, high = distance
        raw = value + term
        value = np.clip(raw, low, high)
        held = held | _beyond(raw, low, high)
    mode_low, mode_high = setting.mode_low, setting.mode_high
    held = held | _beyond(value, mode_low, mode_high)
    return np.minimum(np.maximum(value, mode_low), mode_high), held


def _beyond(value: Floats, low: Floats, high: Floats) -> Bools:
    slack = CLAMPED * (1 + np.abs(value))
    return np.asarray((value < low - slack) | (value > high + slack))


def _ticks_before(time: Floats, period: float) -> Floats:
    """How many ticks lie before a time; one that lies on it but for rounding does not."""
    ticks = time / period
    return np.asarray(np.ceil(ticks - _ON_TICK - ticks * 1e-15))


@dataclass(slots=True, kw_only=True)
class _Ticks:
    """Pieces whose power is sampled: at the moment of the power call, then at every tick, and held in between."""

    integrator: _Integrator
    setting: Setting
    by_distance: Bools
    cell: Indices
    stage: Indices
    moment: Floats
    start: Floats
    end: Floats

    def integrate(self) -> tuple[Floats, Floats, Floats, Floats]:
        """(integral, lowest, highest, time held by a limit) per piece."""
        period = self.integrator.period_ms
        origin = self.integrator.motion.clock.stage_start()[self.stage]
        first = _ticks_before(self.start - origin, period)
        behind = _ticks_before(self.end - origin, period)
        count = np.maximum(behind - first, 0).astype(np.intp)
        first_tick = origin + first * period
        # Up to the first tick inside: what was sampled at the last tick, or at the power call if that came later.
        head = np.where(count > 0, first_tick, self.end) - self.start
        sampled_at = np.maximum(np.maximum(origin + (first - 1) * period, self.moment), origin)
        value, held = self.sample(self.cell_at(sampled_at), sampled_at, self.setting, self.by_distance)
        with_head = head > _ON_TICK * period
        energy = np.where(with_head, value * head, 0.0)
        clamped = np.where(with_head & held, head, 0.0)
        lowest, highest = np.where(with_head, value, np.inf), np.where(with_head, value, -np.inf)
        ticked = np.flatnonzero(count > 0)
        last_width = self.end - (origin + (behind - 1) * period)
        runs = _Runs(ticks=self, pieces=ticked, first=first_tick[ticked], count=count[ticked], last=last_width[ticked])
        runs.add(energy, lowest, highest, clamped)
        return energy, lowest, highest, clamped

    def cell_at(self, time: Floats) -> Indices:
        """The timed call that runs at a moment of a piece's stage: its own, or an earlier one."""
        clock = self.integrator.motion.clock
        found = np.searchsorted(clock.times[:-1], time, side="right") - 1
        first, last = clock.stage_first[self.stage], clock.stage_first[self.stage + 1] - 1
        return np.maximum(np.minimum(found, np.minimum(self.cell, last)), np.minimum(first, last))

    def sample(self, cell: Indices, time: Floats, setting: Setting, by_distance: Bools) -> tuple[Floats, Bools]:
        """Power at moments, through all limits, and where a limit held it."""
        motion = self.integrator.motion
        base = setting.low
        if (setting.ratio > 0).any():
            base = base + setting.ratio * motion.velocity(cell, time)
        if not by_distance.any():
            return limited(setting, base, None)
        return limited(setting, base, self.distance(cell, time, setting.laser))

    def distance(self, cell: Indices, time: Floats, stage: Indices) -> tuple[Floats, Floats, Floats]:
        """Distance term and its limits (M 五.2): ratio per mm from the reference, summed over the axes."""
        x, y = self.integrator.motion.position(cell, time)
        term = np.zeros(len(x))
        low, high = np.full(len(x), -np.inf), np.full(len(x), np.inf)
        for number in np.unique(stage).tolist():
            laser = self.integrator.lasers[number]
            if not laser.follows_distance:
                continue
            at = slice(None) if (stage[0] == stage).all() else stage == number
            places = self.integrator.motion.axis_positions(number, x[at], y[at])
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

    ticks: _Ticks
    pieces: Indices
    first: Floats
    """Time of each run's first tick."""
    count: Indices
    last: Floats
    """How long each run's last tick is held, ms; the others are held a period."""

    def add(self, energy: Floats, lowest: Floats, highest: Floats, clamped: Floats) -> None:
        """Add the runs to their pieces' results."""
        period = self.ticks.integrator.period_ms
        # A run longer than a chunk is cut.
        parts = np.maximum(-(-self.count // _CHUNK_TICKS), 1)
        run = np.repeat(np.arange(len(parts)), parts)
        part = np.arange(len(run)) - np.repeat(np.cumsum(parts) - parts, parts)
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
        motion, period = ticks.integrator.motion, ticks.integrator.period_ms
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
