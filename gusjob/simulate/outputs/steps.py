"""Held power as steps: it changes at power events and, where it follows velocity or distance, at ticks."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gusjob.kinematics.arrays import Floats, Indices, counted
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.intervals import Intervals


class PowerSteps(Struct, frozen=True, kw_only=True, eq=False):
    """Held power in intervals, (n,): the interval of each step, its start and length in ms, and its power."""

    which: Indices
    start_ms: Floats
    length_ms: Floats
    value: Floats

    def shifted(self, shift_ms: Floats) -> PowerSteps:
        """The same steps, each later by `shift_ms`, (n,)."""
        return replace(self, start_ms=self.start_ms + shift_ms)


def power_steps(trace: Trace, channel: ChannelTrace, intervals: Intervals) -> PowerSteps:
    """Find the steps of a channel's held power in intervals, in order; each interval begins with one."""
    number = np.arange(len(intervals.stage))
    parts = [(number, intervals.start_ms), _events(trace, channel, intervals)]
    if channel.power.follows:
        parts.append(ticks_in(trace, intervals))
    which, time = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.lexsort((time, which))
    which, time = which[order], time[order]
    real = time < intervals.end_ms[which]
    real[1:] &= (time[1:] > time[:-1]) | (which[1:] != which[:-1])
    which, time = which[real], time[real]
    end = intervals.end_ms[which]
    continues = which[1:] == which[:-1]
    end[:-1][continues] = time[1:][continues]
    value = channel.power.value(intervals.stage[which], time)
    return PowerSteps(which=which, start_ms=time, length_ms=end - time, value=value)


def ticks_in(trace: Trace, intervals: Intervals) -> tuple[Indices, Floats]:
    """(interval, ms) of every tick in intervals; ticks count from their stage's start."""
    origin, period = trace.schedule.stage_start()[intervals.stage], trace.period_ms
    first = np.ceil((intervals.start_ms - origin) / period - 1e-9)
    count = np.maximum(np.ceil((intervals.end_ms - origin) / period - 1e-9) - first, 0.0).astype(np.intp)
    which, number = counted(count)
    return which, origin[which] + (first[which] + number) * period


def _events(trace: Trace, channel: ChannelTrace, intervals: Intervals) -> tuple[Indices, Floats]:
    """(interval, ms) of every power event that acts within intervals."""
    timeline = channel.power.timeline
    moments, events = timeline.time_ms, timeline.events
    first = np.searchsorted(moments, intervals.start_ms, side="right")
    stop = np.searchsorted(moments, intervals.end_ms, side="left")
    count = np.maximum(stop - first, 0)
    which, number = counted(count)
    at = first[which] + number
    mine = events.stage[at] == intervals.stage[which]
    return which[mine], moments[at[mine]]
