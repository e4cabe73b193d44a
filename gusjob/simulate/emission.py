"""Emission intervals of each channel from its switch events. The edges are exact, not rounded to ticks."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.events import ChannelEvents, Events, ImmediateAction
from gusjob.simulate.intervals import Intervals


class Emission(Struct, frozen=True, kw_only=True, eq=False):
    """Emission intervals of one channel in time order, (k,): stage, start and end on the schedule's time axis, ms.

    An end may be after its stage's end (off delay): the laser then emits at rest, before the next stage starts.
    `on_event`, `off_event` (k,): the channel's switch events that opened and closed each interval, -1 where none did;
    of merged intervals the first one's on and the last one's off. `switch`: intervals in which the switch is on, delays
    included; they differ from the emission with FPK. `carried`: of these, the ones that were on before their stage.
    `on_at_end`: the switch is still on after the last stage. `readings`: (line, on) of each reading of the switch.
    `commanded` (m,): segments that run, at least in part, between a commanded on and a commanded off, whatever delays
    and FPK make of them; with sky writing those between the intended start and end of a mark.
    """

    stage: Indices
    start_ms: Floats
    end_ms: Floats
    on_event: Indices
    off_event: Indices
    switch: Intervals
    carried: Bools
    on_at_end: bool
    commanded: Bools
    readings: tuple[tuple[int, bool], ...] = ()

    @property
    def intervals(self) -> Intervals:
        """The intervals alone."""
        return Intervals(stage=self.stage, start_ms=self.start_ms, end_ms=self.end_ms)


class _SwitchChanges(Struct, frozen=True, kw_only=True, eq=False):
    """Changes of the switch in order, (c,). `time` -inf: on when the stage starts. `event` -1: an immediate action."""

    stage: Indices
    time: Floats
    on: Bools
    event: Indices

    def pick(self, at: Indices | Bools) -> _SwitchChanges:
        return _SwitchChanges(**{name: getattr(self, name)[at] for name in self.__struct_fields__})


class _Emitting(Struct, frozen=True, kw_only=True, eq=False):
    """Intervals under construction, (k,). `carried`: on before the stage. `has_off`: a change of the switch ends it."""

    stage: Indices
    start: Floats
    end: Floats
    carried: Bools
    has_off: Bools
    on_event: Indices
    off_event: Indices

    def pick(self, at: Indices | Bools) -> _Emitting:
        return _Emitting(**{name: getattr(self, name)[at] for name in self.__struct_fields__})

    def merged(self) -> _Emitting:
        """Drop empty intervals; join those of a stage that meet or overlap."""
        some = self.pick(self.start < self.end)
        if len(some.start) < 2:
            return some
        fresh = np.ones(len(some.start), dtype=np.bool_)
        fresh[1:] = (some.start[1:] > some.end[:-1]) | (some.stage[1:] != some.stage[:-1])
        first = np.flatnonzero(fresh)
        last = some.pick(np.append(first[1:], len(fresh)) - 1)
        return replace(some.pick(first), end=last.end, has_off=last.has_off, off_event=last.off_event)


def emission_of(channel: ChannelEvents, events: Events, schedule: Schedule) -> Emission:
    """Compute the intervals in which a channel emits.

    An on edge comes the on delay after its moment, an off edge the off delay; edges that meet or cross merge. With FPK
    the emission starts its gap after the on edge and ends its off delay after the off edge. A switch at rest, and an
    edge still delayed when a stage ends, have taken effect when the next stage starts.
    """
    starts, ends = schedule.stage_start(), schedule.stage_end()
    changes, immediate = _changes(channel, events, schedule)
    lasers = [stage.lasers[channel.channel] for stage in events.stages]
    on_delay = np.array([laser.on_delay_us for laser in lasers]) / US_PER_MS
    off_delay = np.array([laser.off_delay_us for laser in lasers]) / US_PER_MS
    gap = np.array([laser.fpk_us[1] if laser.fpk_us else 0.0 for laser in lasers]) / US_PER_MS
    fpk_off_delay = np.array([laser.fpk_us[2] if laser.fpk_us else 0.0 for laser in lasers]) / US_PER_MS

    # Every on opens an interval; the next change of its stage (an off) closes it, or the stage's end does.
    opens = np.flatnonzero(changes.on)
    opening, following = changes.pick(opens), changes.pick(np.minimum(opens + 1, len(changes.on) - 1))
    stage, carried = opening.stage, np.isneginf(opening.time)
    has_off = (opens + 1 < len(changes.on)) & (following.stage == stage)
    emitting = _Emitting(
        stage=stage,
        start=np.where(carried, -np.inf, opening.time + on_delay[stage]),
        end=np.where(has_off, following.time + off_delay[stage], np.inf),
        carried=carried,
        has_off=has_off,
        on_event=opening.event,
        off_event=np.where(has_off, following.event, -1),
    ).merged()
    stage = emitting.stage
    start, end = np.maximum(emitting.start, starts[stage]), np.where(emitting.has_off, emitting.end, ends[stage])
    real = start < end  # An on edge still delayed at its stage's end belongs to the next stage.
    switch = Intervals(stage=stage[real], start_ms=start[real], end_ms=end[real])
    carried = emitting.carried[real]
    emitting = replace(
        emitting,
        start=np.where(emitting.carried, emitting.start, emitting.start + gap[stage]),
        end=np.where(emitting.has_off, emitting.end + fpk_off_delay[stage], ends[stage]),
    ).merged()
    # Emission that was on before its stage counts from the stage's start.
    emitting = replace(emitting, start=np.maximum(emitting.start, starts[emitting.stage])).merged()
    return Emission(
        stage=emitting.stage,
        start_ms=emitting.start,
        end_ms=emitting.end,
        on_event=emitting.on_event,
        off_event=emitting.off_event,
        switch=switch,
        carried=carried,
        on_at_end=immediate.on_at_end,
        commanded=_commanded(changes, channel, schedule),
        readings=tuple(immediate.readings),
    )


def _commanded(changes: _SwitchChanges, channel: ChannelEvents, schedule: Schedule) -> Bools:
    """Find the segments in which the switch is commanded on, (m,)."""
    times, first, opens = schedule.times_ms, schedule.stage_first, np.flatnonzero(changes.on)
    if not len(opens):
        return np.zeros(len(times) - 1, dtype=np.bool_)
    # What is buffered acts between two segments, or belongs to the point that the planner names; the rest has a time.
    buffered = changes.event >= 0
    named = np.append(channel.switch.mark_segment, 0)[changes.event]
    begin, behind = first[changes.stage], first[changes.stage + 1]
    begins = np.where(buffered, named, np.clip(np.searchsorted(times[1:], changes.time, side="right"), begin, behind))
    ends = np.where(buffered, named, np.clip(np.searchsorted(times[:-1], changes.time, side="left"), begin, behind))
    stops = np.append(changes.stage[1:] == changes.stage[:-1], False)  # Otherwise it stays on until its stage ends.
    last = np.where(stops, np.append(ends[1:], 0), behind)[opens]
    start = np.minimum(begins[opens], last)
    count = len(times)
    depth = np.zeros(count, dtype=np.int32)
    np.add.at(depth, start, 1)
    np.subtract.at(depth, last, 1)
    return np.asarray(np.cumsum(depth, out=depth)[:-1] > 0)


def _changes(channel: ChannelEvents, events: Events, schedule: Schedule) -> tuple[_SwitchChanges, _ImmediateSwitches]:
    """Merge buffered and immediate switches; return the changes and what is immediate."""
    switch = channel.switch
    stage, on = switch.stage, switch.on
    time = schedule.times_ms[switch.segment] if len(on) else np.empty(0)
    found = _immediate(channel, events, schedule, time)
    immediate = found.switches
    event, rank = np.arange(len(on)), np.full(len(on), 1, dtype=np.int8)
    if immediate:
        stage = np.concatenate([stage, np.array([e[0] for e in immediate], dtype=stage.dtype)])
        time = np.concatenate([time, np.array([e[1] for e in immediate])])
        on = np.concatenate([on, np.array([e[2] for e in immediate])])
        rank = np.concatenate([rank, np.array([e[3] for e in immediate], dtype=np.int8)])
        event = np.concatenate([event, np.full(len(immediate), -1, dtype=event.dtype)])
    changes = _SwitchChanges(stage=stage, time=time, on=on, event=event)
    if immediate:
        changes = changes.pick(np.lexsort((rank, time, stage)))
    if len(on):
        before = np.concatenate([[False], changes.on[:-1]])
        before[1:][np.diff(changes.stage) != 0] = False
        changes = changes.pick(changes.on != before)
    return changes, found


class _ImmediateSwitches(Struct, kw_only=True):
    """Switches that are not buffered, and those still on when a stage starts: (stage, ms, on, rank).

    The rank orders what acts at one moment: before (0) or after (2) the buffered switches. `readings`: (line, on).
    """

    switches: list[tuple[int, float, bool, int]] = field(default_factory=list)
    readings: list[tuple[int, bool]] = field(default_factory=list)
    on_at_end: bool = False

    def at_rest(self, actions: Iterable[ImmediateAction]) -> None:
        """Add actions at rest of the channel."""
        for action in actions:
            if action.reads:
                self.readings.append((action.line, self.on_at_end))
            elif action.on is not None:
                self.on_at_end = action.on


def _immediate(channel: ChannelEvents, events: Events, schedule: Schedule, time: Floats) -> _ImmediateSwitches:
    """Find the switches that are not buffered, and the readings. `time` (e,): moments of the buffered switches, ms."""
    found = _ImmediateSwitches()
    switch, starts, ends = channel.switch, schedule.stage_start().tolist(), schedule.stage_end().tolist()
    first = np.searchsorted(switch.stage, np.arange(len(events.stages) + 1)).tolist()
    for number, stage in enumerate(events.stages):
        found.at_rest(_of(channel, stage.at_rest))
        if found.on_at_end:
            found.switches.append((number, -np.inf, True, 0))
        begin, end = first[number], first[number + 1]
        begun = begin
        for action in _of(channel, stage.moving):
            moment = action.moment(starts[number], ends[number])
            # The buffered switches up to now come first.
            now = begin + int(np.searchsorted(time[begin:end], moment, side="right"))
            if now > begun:
                begun, found.on_at_end = now, bool(switch.on[now - 1])
            if action.on is not None:
                found.switches.append((number, moment, action.on, 2))
            found.at_rest([action])
        if end > begun:
            found.on_at_end = bool(switch.on[end - 1])
    found.at_rest(_of(channel, events.at_end))
    return found


def _of(channel: ChannelEvents, actions: Iterable[ImmediateAction]) -> list[ImmediateAction]:
    return [action for action in actions if action.channel == channel.channel]
