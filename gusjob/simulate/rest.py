"""Times at which a laser is on while nothing moves: before, between and after the stages.

Only calls that are not buffered can end such a time. When they were made is known only if a recorder wrote it down.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
from msgspec import Struct

from gusjob.simulate.events import Events, ImmediateAction, LaserState
from gusjob.simulate.trace import ChannelTrace, Trace


class OnAtRest(Struct, frozen=True, kw_only=True):
    """A laser that is switched on at rest, or left on by a stage, until it is switched off or the next stage starts.

    `line`: of the call that switched it on, or that started the stage. `time_ms`: NaN if it is not known, or has no
    end. `power`: in force when it begins, in the unit of `laser`, without distance follow; NaN if none is set.
    `by_calls`: calls at rest switch it on and off.
    """

    line: int
    time_ms: float
    power: float
    laser: LaserState
    by_calls: bool


class _Rest(Struct, frozen=True, kw_only=True):
    """The time between two stages: the actions in it, and what is in force before them.

    `line`: of the start of the stage before. `begin_ms`, `end_ms`: on the clock of the calls, NaN if not known.
    """

    line: int
    begin_ms: float
    end_ms: float
    on: bool
    power: float
    before: LaserState
    after: LaserState
    actions: list[ImmediateAction]

    def times_on(self) -> Iterator[OnAtRest]:
        """Find when the laser is on."""
        begun = -1 if self.on else None  # Number of the action that switched it on, -1: it was on before.
        powers, mode_change = [self.power], -1
        for i, action in enumerate(self.actions):
            powers.append(powers[-1] if action.power is None else action.power)
            mode_change = i if action.power is not None and math.isnan(action.power) else mode_change
        for i, action in enumerate(self.actions):
            if action.on and begun is None:
                begun = i
            elif action.on is False and begun is not None:
                yield self._between(begun, action.clock_ms, powers, mode_change, by_calls=begun >= 0)
                begun = None
        if begun is not None:
            yield self._between(begun, self.end_ms, powers, mode_change, by_calls=False)

    def _between(self, begun: int, end_ms: float, powers: list[float], mode_change: int, *, by_calls: bool) -> OnAtRest:
        begin_ms = self.begin_ms if begun < 0 else self.actions[begun].clock_ms
        return OnAtRest(
            line=self.line if begun < 0 else self.actions[begun].line,
            time_ms=end_ms - begin_ms,
            power=powers[begun + 1],
            laser=self.before if begun < mode_change else self.after,
            by_calls=by_calls,
        )


def times_on_at_rest(channel: ChannelTrace, events: Events, trace: Trace) -> Iterator[OnAtRest]:
    """Find when a channel is on while nothing moves, in order."""
    stages, schedule, timeline = events.stages, trace.schedule, channel.power.timeline
    starts, ends = schedule.stage_start().tolist(), schedule.stage_end().tolist()
    powers = timeline.events.low[timeline.last_of(np.arange(-1, len(stages)))].tolist()
    lasers = [LaserState(), *channel.lasers, channel.laser_at_end]
    buffered = _last_buffered(channel, trace)
    on, line, end_ms, late = False, 0, math.nan, list[ImmediateAction]()
    for number, actions in enumerate([*(stage.at_rest for stage in stages), events.at_end]):
        is_last = number == len(stages)
        rest = _Rest(
            line=line,
            begin_ms=end_ms,
            end_ms=math.nan if is_last else stages[number].start_ms,
            on=on,
            power=powers[number],
            before=lasers[number],
            after=lasers[number + 1],
            actions=[*late, *_of(channel, actions)],
        )
        yield from rest.times_on()
        if is_last:
            return
        stage, start, end = stages[number], starts[number], ends[number]
        line = stage.line
        end_ms = stage.start_ms + end - start if math.isnan(stage.rest_ms) else stage.rest_ms
        moving = _of(channel, stage.moving)
        late = [action for action in moving if action.clock_ms > end_ms]
        moment, on = buffered.get(number, (-math.inf, _last(rest.actions, on)))
        in_time = (action for action in moving if not action.clock_ms > end_ms)
        on = _last((action for action in in_time if action.moment(start, end) >= moment), on)


def _of(channel: ChannelTrace, actions: Iterable[ImmediateAction]) -> list[ImmediateAction]:
    return [action for action in actions if action.channel == channel.channel]


def _last(actions: Iterable[ImmediateAction], on: bool) -> bool:
    """Return whether the switch is on after actions; `on`: before them."""
    for action in actions:
        on = on if action.on is None else action.on
    return on


def _last_buffered(channel: ChannelTrace, trace: Trace) -> dict[int, tuple[float, bool]]:
    """Return the last buffered switch of each stage that has one: ms and on."""
    switch = channel.switch
    last = np.flatnonzero(np.diff(switch.stage, append=-1) != 0)
    times = trace.schedule.times_ms[switch.segment[last]]
    values = zip(times.tolist(), switch.on[last].tolist(), strict=True)
    return dict(zip(switch.stage[last].tolist(), values, strict=True))
