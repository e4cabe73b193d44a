"""Held power as steps: it changes at power calls and, where it follows something, at ticks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gusjob.kinematics.arrays import Floats, Indices, counted
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.spans import Spans


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """Power held over spans, (n,): which span each step lies in, its start and length in ms, the power in it."""

    which: Indices
    start_ms: Floats
    length_ms: Floats
    value: Floats

    def later(self, shift_ms: Floats) -> Steps:
        """The same, each later by (n,) ms."""
        return replace(self, start_ms=self.start_ms + shift_ms)


def steps_of(trace: Trace, channel: ChannelTrace, spans: Spans) -> Steps:
    """The steps of a channel's held power in spans, in order; each span begins with one."""
    number = np.arange(len(spans.stage))
    parts = [(number, spans.start_ms), _calls(trace, channel, spans)]
    if follows(channel):
        parts.append(ticks_in(trace, spans))
    which, time = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.lexsort((time, which))
    which, time = which[order], time[order]
    real = time < spans.end_ms[which]
    real[1:] &= (time[1:] > time[:-1]) | (which[1:] != which[:-1])
    which, time = which[real], time[real]
    behind = spans.end_ms[which]
    goes_on = which[1:] == which[:-1]
    behind[:-1][goes_on] = time[1:][goes_on]
    value = trace.held_power(channel, spans.stage[which], time)
    return Steps(which=which, start_ms=time, length_ms=behind - time, value=value)


def follows(channel: ChannelTrace) -> bool:
    """Whether the power of a channel may change at ticks."""
    return bool((channel.powers.ratio > 0).any()) or any(laser.follows_distance for laser in channel.lasers)


def ticks_in(trace: Trace, spans: Spans) -> tuple[Indices, Floats]:
    """(span, ms) of every tick in spans; ticks count from their stage's start."""
    origin, period = trace.clock.stage_start()[spans.stage], trace.period_ms
    first = np.ceil((spans.start_ms - origin) / period - 1e-9)
    count = np.maximum(np.ceil((spans.end_ms - origin) / period - 1e-9) - first, 0.0).astype(np.intp)
    which, number = counted(count)
    return which, origin[which] + (first[which] + number) * period


def _calls(trace: Trace, channel: ChannelTrace, spans: Spans) -> tuple[Indices, Floats]:
    """(span, ms) of every power call that acts within spans."""
    clock, powers = trace.clock, channel.powers
    moments = clock.times_ms[np.minimum(powers.boundary, len(clock.times_ms) - 1)]
    first = np.searchsorted(moments, spans.start_ms, side="right")
    behind = np.searchsorted(moments, spans.end_ms, side="left")
    count = np.maximum(behind - first, 0)
    which, number = counted(count)
    at = first[which] + number
    mine = powers.stage[at] == spans.stage[which]
    return which[mine], moments[at[mine]]
