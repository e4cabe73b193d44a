"""When each laser emits: switch commands to emission intervals. Exact edges, no ticks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.interpreter.clock import Clock
from gusjob.interpreter.state import Program
from gusjob.stream import Buffered, BufferedCalls
from gusjob.units import US_PER_MS

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class Emission:
    """Emission intervals of one channel in time order, (k,): stage, start and end on the clock's axis, ms.

    An end may lie behind its stage's end (off delay): that light shines at rest, before the next stage starts.
    `lit_at_end`: the light is still on when all is done.
    """

    stage: Indices
    start_ms: Floats
    end_ms: Floats
    lit_at_end: bool


def emission(calls: BufferedCalls, clock: Clock, program: Program, channel: int) -> Emission:
    """Intervals in which a channel emits.

    An on edge comes on_delay behind its moment, an off edge off_delay; edges that meet or cross merge. With FPK the
    emission starts its gap behind the on edge and ends its off delay behind the off edge. A switch set at rest, and
    an edge still under way when a stage ends, have come to pass when the next stage starts.
    """
    stages = program.stages
    starts, ends = clock.stage_start(), clock.stage_end()
    command_stage, command_time, command_on, lit = _commands(calls, clock, program, channel)
    lasers = [stage.lasers[channel] for stage in stages]
    on_delay = np.array([laser.on_delay_us for laser in lasers]) / US_PER_MS
    off_delay = np.array([laser.off_delay_us for laser in lasers]) / US_PER_MS
    gap = np.array([laser.fpk_us[1] if laser.fpk_us else 0.0 for laser in lasers]) / US_PER_MS
    late = np.array([laser.fpk_us[2] if laser.fpk_us else 0.0 for laser in lasers]) / US_PER_MS

    # Every on opens an interval; the next command of its stage (an off) closes it, or the stage's end does.
    opens = np.flatnonzero(command_on)
    stage = command_stage[opens]
    carried = np.isneginf(command_time[opens])
    has_off = np.zeros(len(opens), dtype=np.bool_)
    if len(command_on):
        following = np.minimum(opens + 1, len(command_on) - 1)
        has_off = (opens + 1 < len(command_on)) & (command_stage[following] == stage)
        closes = np.where(has_off, command_time[following] + off_delay[stage], np.inf)
    else:
        closes = np.empty(0)
    opened = np.where(carried, -np.inf, command_time[opens] + on_delay[stage])
    stage, opened, closes, carried, has_off = _merge(stage, opened, closes, carried, has_off)
    opened = np.where(carried, opened, opened + gap[stage])
    closes = np.where(has_off, closes + late[stage], ends[stage])
    stage, opened, closes, carried, has_off = _merge(stage, opened, closes, carried, has_off)
    # Light that was on before its stage is counted from the stage's start.
    stage, opened, closes, _, _ = _merge(stage, np.maximum(opened, starts[stage]), closes, carried, has_off)
    return Emission(stage=stage, start_ms=opened, end_ms=closes, lit_at_end=lit)


def _commands(
    calls: BufferedCalls, clock: Clock, program: Program, channel: int
) -> tuple[Indices, Floats, npt.NDArray[np.bool_], bool]:
    """(stage, time, on) of the commands that change the switch, in order, and whether it is on at the end.

    Time -inf: the light is on already when the stage starts.
    """
    kind = calls.kind[clock.rows]
    mine = np.flatnonzero(((kind == Buffered.ON) | (kind == Buffered.OFF)) & (calls.channel[clock.rows] == channel))
    stage, boundary, on = clock.stage_of_row[mine], clock.boundary[mine], kind[mine] == Buffered.ON
    times = clock.times[boundary] if len(mine) else np.empty(0)
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
        order = np.lexsort((rank, times, stage))
        stage, times, on = stage[order], times[order], on[order]
    if len(on):
        before = np.concatenate([[False], on[:-1]])
        before[1:][np.diff(stage) != 0] = False
        changes = on != before
        stage, times, on = stage[changes], times[changes], on[changes]
    return stage, times, on, lit


def _last_in_stage(stage: Indices, on: npt.NDArray[np.bool_], count: int) -> list[bool | None]:
    behind = np.searchsorted(stage, np.arange(count), side="right")
    before = np.searchsorted(stage, np.arange(count), side="left")
    return [bool(on[b - 1]) if b > a else None for a, b in zip(before.tolist(), behind.tolist(), strict=True)]


def _has_later(stage: Indices, times: Floats, number: int, start: float) -> bool:
    last = int(np.searchsorted(stage, number, side="right")) - 1
    return last >= 0 and bool(stage[last] == number) and bool(times[last] > start)


def _merge(
    stage: Indices,
    start: Floats,
    end: Floats,
    carried: npt.NDArray[np.bool_],
    has_off: npt.NDArray[np.bool_],
) -> tuple[Indices, Floats, Floats, npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Intervals of no length dropped, those that meet or overlap within a stage joined."""
    keep = start < end
    stage, start, end, carried, has_off = stage[keep], start[keep], end[keep], carried[keep], has_off[keep]
    if len(start) < 2:
        return stage, start, end, carried, has_off
    fresh = np.ones(len(start), dtype=np.bool_)
    fresh[1:] = (start[1:] > end[:-1]) | (stage[1:] != stage[:-1])
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(start)) - 1
    return stage[first], start[first], end[last], carried[first], has_off[last]
