"""When each laser emits: switch commands to emission intervals. Exact edges, no ticks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.clock import Clock
from gusjob.simulate.spans import Spans
from gusjob.simulate.state import Program


@dataclass(frozen=True, slots=True, kw_only=True)
class Emission:
    """Emission intervals of one channel in time order, (k,): stage, start and end on the clock's axis, ms.

    An end may lie behind its stage's end (off delay): that light shines at rest, before the next stage starts.
    `lit_at_end`: the light is still on when all is done. `on_row`, `off_row` (k,): the buffered GT_BufLaserOn that
    opened and the GT_BufLaserOff that closed each, as index into the stream; -1 where none did. Of merged intervals the
    first one's on and the last one's off. `switch`: when the switch is on, delays included; the same but with FPK.
    `carried`: of those, the ones that were on before their stage.
    """

    stage: Indices
    start_ms: Floats
    end_ms: Floats
    lit_at_end: bool
    on_row: Indices
    off_row: Indices
    switch: Spans
    carried: Bools


@dataclass(frozen=True, slots=True, kw_only=True)
class _Commands:
    """Commands that change the switch, in order, (c,). Time -inf: on when the stage starts. Row -1: not buffered."""

    stage: Indices
    time: Floats
    on: Bools
    row: Indices

    def pick(self, at: Indices | Bools) -> _Commands:
        return _Commands(**{name: getattr(self, name)[at] for name in self.__slots__})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Spans:
    """Emission in the making, (k,). `carried`: it was on before its stage; `has_off`: a command closes it."""

    stage: Indices
    start: Floats
    end: Floats
    carried: Bools
    has_off: Bools
    on_row: Indices
    off_row: Indices

    def pick(self, at: Indices | Bools) -> _Spans:
        return _Spans(**{name: getattr(self, name)[at] for name in self.__slots__})

    def merged(self) -> _Spans:
        """Intervals of no length dropped, those that meet or overlap within a stage joined."""
        spans = self.pick(self.start < self.end)
        if len(spans.start) < 2:
            return spans
        fresh = np.ones(len(spans.start), dtype=np.bool_)
        fresh[1:] = (spans.start[1:] > spans.end[:-1]) | (spans.stage[1:] != spans.stage[:-1])
        first = np.flatnonzero(fresh)
        last = spans.pick(np.append(first[1:], len(fresh)) - 1)
        return replace(spans.pick(first), end=last.end, has_off=last.has_off, off_row=last.off_row)


def emission(calls: BufferedCalls, clock: Clock, program: Program, channel: int) -> Emission:
    """Intervals in which a channel emits.

    An on edge comes on_delay behind its moment, an off edge off_delay; edges that meet or cross merge. With FPK the
    emission starts its gap behind the on edge and ends its off delay behind the off edge. A switch set at rest, and
    an edge still under way when a stage ends, have come to pass when the next stage starts.
    """
    stages = program.stages
    starts, ends = clock.stage_start(), clock.stage_end()
    commands, lit = _commands(calls, clock, program, channel)
    lasers = [stage.lasers[channel] for stage in stages]
    on_delay = np.array([laser.on_delay_us for laser in lasers]) / US_PER_MS
    off_delay = np.array([laser.off_delay_us for laser in lasers]) / US_PER_MS
    gap = np.array([laser.fpk_us[1] if laser.fpk_us else 0.0 for laser in lasers]) / US_PER_MS
    late = np.array([laser.fpk_us[2] if laser.fpk_us else 0.0 for laser in lasers]) / US_PER_MS

    # Every on opens an interval; the next command of its stage (an off) closes it, or the stage's end does.
    opens = np.flatnonzero(commands.on)
    opening, following = commands.pick(opens), commands.pick(np.minimum(opens + 1, len(commands.on) - 1))
    stage, carried = opening.stage, np.isneginf(opening.time)
    has_off = (opens + 1 < len(commands.on)) & (following.stage == stage)
    spans = _Spans(
        stage=stage,
        start=np.where(carried, -np.inf, opening.time + on_delay[stage]),
        end=np.where(has_off, following.time + off_delay[stage], np.inf),
        carried=carried,
        has_off=has_off,
        on_row=opening.row,
        off_row=np.where(has_off, following.row, -1),
    ).merged()
    stage = spans.stage
    begin, finish = np.maximum(spans.start, starts[stage]), np.where(spans.has_off, spans.end, ends[stage])
    real = begin < finish  # An on edge still under way at its stage's end belongs to the next.
    switch = Spans(stage=stage[real], start_ms=begin[real], end_ms=finish[real])
    carried = spans.carried[real]
    spans = replace(
        spans,
        start=np.where(spans.carried, spans.start, spans.start + gap[stage]),
        end=np.where(spans.has_off, spans.end + late[stage], ends[stage]),
    ).merged()
    # Light that was on before its stage is counted from the stage's start.
    spans = replace(spans, start=np.maximum(spans.start, starts[spans.stage])).merged()
    return Emission(
        stage=spans.stage,
        start_ms=spans.start,
        end_ms=spans.end,
        lit_at_end=lit,
        on_row=spans.on_row,
        off_row=spans.off_row,
        switch=switch,
        carried=carried,
    )


def _commands(calls: BufferedCalls, clock: Clock, program: Program, channel: int) -> tuple[_Commands, bool]:
    """The commands that change the switch, and whether it is on at the end."""
    kind = calls.kind[clock.rows]
    mine = np.flatnonzero(((kind == Buffered.ON) | (kind == Buffered.OFF)) & (calls.channel[clock.rows] == channel))
    stage, boundary, on = clock.stage_of_row[mine], clock.boundary[mine], kind[mine] == Buffered.ON
    times, row = clock.times_ms[boundary] if len(mine) else np.empty(0), clock.rows[mine]
    rank = np.full(len(mine), 1, dtype=np.int8)
    extra: list[tuple[int, float, bool, int]] = []
    lit = False
    last_on = _last_in_stage(stage, on, len(program.stages))
    start = clock.stage_start()
    for number, run in enumerate(program.stages):
        for action in run.at_rest:
            if action.channel == channel and action.power is None:
                lit = action.on
        if lit:
            extra.append((number, -np.inf, True, 0))
        moving = [a for a in run.moving if a.channel == channel and a.power is None]
        extra += [(number, float(start[number]), a.on, 2) for a in moving]
        buffered = last_on[number]
        late = _has_later(stage, times, number, float(start[number]))
        if moving and (buffered is None or not late):
            lit = moving[-1].on
        elif buffered is not None:
            lit = buffered
    for action in program.at_end:
        if action.channel == channel and action.power is None:
            lit = action.on
    if extra:
        stage = np.concatenate([stage, np.array([e[0] for e in extra], dtype=stage.dtype)])
        times = np.concatenate([times, np.array([e[1] for e in extra])])
        on = np.concatenate([on, np.array([e[2] for e in extra])])
        rank = np.concatenate([rank, np.array([e[3] for e in extra], dtype=np.int8)])
        row = np.concatenate([row, np.full(len(extra), -1, dtype=row.dtype)])
    commands = _Commands(stage=stage, time=times, on=on, row=row)
    if extra:
        commands = commands.pick(np.lexsort((rank, times, stage)))
    if len(on):
        before = np.concatenate([[False], commands.on[:-1]])
        before[1:][np.diff(commands.stage) != 0] = False
        commands = commands.pick(commands.on != before)
    return commands, lit


def _last_in_stage(stage: Indices, on: Bools, count: int) -> list[bool | None]:
    behind = np.searchsorted(stage, np.arange(count), side="right")
    before = np.searchsorted(stage, np.arange(count), side="left")
    return [bool(on[b - 1]) if b > a else None for a, b in zip(before.tolist(), behind.tolist(), strict=True)]


def _has_later(stage: Indices, times: Floats, number: int, start: float) -> bool:
    last = int(np.searchsorted(stage, number, side="right")) - 1
    return last >= 0 and bool(stage[last] == number) and bool(times[last] > start)
