"""What the controller's laser outputs carry (M 一.1, 一.2, 三.1), window of time by window of time.

Each channel has an energy line and a switch line, both differential, and an analog output:

    energy  PWM0 (PWM2): + rests high and is low while energy is put out; duty is the low part of the period
    switch  PWM1 (PWM3): + is high with the laser off, low with it on; with FPK it carries that pulse instead
    analog  AO0 (AO1):   volts, in analog mode; the energy line rests then

Where M is silent: the first period of the carrier begins with the light; a period keeps the duty that it began with;
in frequency mode the phase goes on when the frequency changes; light that ends cuts its pulse short; the FPK pulse has
the level of "on"; in duty mode 2 the + line of the switch is high; the standby pulse begins anew when light ends, and
goes on over a change of stage; without GT_LaserOutFrq the energy line is unknown while a duty mode shines.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from gusjob.columns import counted
from gusjob.interpreter import ChannelTrace, Trace
from gusjob.interpreter.spans import Spans
from gusjob.interpreter.state import LaserState
from gusjob.limits import PowerMode
from gusjob.signals.steps import Steps, steps_of
from gusjob.signals.timeline import Timeline, timeline_of
from gusjob.units import US_PER_MS

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Times = npt.NDArray[np.int64]

NS_PER_MS = 1e6
_WINDOW_PULSES = 50_000
"""Pulses that are worked on at once: bounds the memory."""
_WINDOW_MS = 500.0
_ROUNDING_MS = 1e-7
"""A period that begins with a power call has that call's power, whatever rounding says."""
_SAME_PHASE = 1e-9
"""Part of a period by which rounding may put a pulse before its moment."""


class Level(IntEnum):
    """Of a + line."""

    LOW = 0
    HIGH = 1
    UNKNOWN = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Edges:
    """A line from a window's start on: its first value, then changes, (n,): moment in ns, new value."""

    first: float
    time_ns: Times
    value: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Window:
    """Some time of the outputs, [start, end) ns. `lines`: + lines and analog outputs by name, in order."""

    span_ns: tuple[int, int]
    lines: dict[str, Edges]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pulses:
    """Low parts of a + line, (n,) ms in order, none reaching into the next; `unknown`: nobody knows the level there."""

    start: Floats
    end: Floats
    unknown: npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Off:
    """Time without light, (k,): start and end, ms on the wires; the standby pulse in it (0 kHz: none), volts in it."""

    start: Floats
    end: Floats
    khz: Floats
    pct: Floats
    volts: Floats


def line_names(channel: int) -> tuple[str, str, str]:
    """Energy, switch and analog output of a channel (M 一.1)."""
    return f"PWM{2 * channel}", f"PWM{2 * channel + 1}", f"AO{channel}"


def windows_of(trace: Trace, start_ms: float = 0.0, end_ms: float | None = None) -> Iterator[Window]:
    """The outputs of all channels from `start_ms` to `end_ms` (the end), in windows that stay small."""
    timeline = timeline_of(trace)
    lines = [_Channel(trace=trace, timeline=timeline, channel=channel) for channel in trace.channels]
    stop = timeline.total_ms if end_ms is None else min(end_ms, timeline.total_ms)
    rate = max([sum(line.highest_khz for line in lines), _WINDOW_PULSES / _WINDOW_MS])
    size, at = _WINDOW_PULSES / rate, start_ms
    while True:
        end = min(at + size, stop)
        # What happens at the very end is seen.
        span_ns = round(at * NS_PER_MS), round(end * NS_PER_MS) + int(end >= stop)
        named = {name: edges for line in lines for name, edges in line.window(at, end, span_ns)}
        yield Window(span_ns=span_ns, lines=named)
        if end >= stop:
            return
        at = end


@dataclass(slots=True)
class _Channel:
    """The three outputs of one channel."""

    trace: Trace
    timeline: Timeline
    channel: ChannelTrace
    lit: Spans
    off: _Off
    switch: tuple[Times, Floats]
    lasers: tuple[LaserState, ...]
    highest_khz: float
    lead_ms: float

    def __init__(self, *, trace: Trace, timeline: Timeline, channel: ChannelTrace) -> None:
        self.trace, self.timeline, self.channel, self.lasers = trace, timeline, channel, channel.lasers
        shine, shift = channel.emission, timeline.shift_ms
        self.lit = Spans(
            stage=shine.stage,
            start_ms=shine.start_ms + shift[shine.stage],
            end_ms=shine.end_ms + shift[shine.stage],
        )
        self.off = _times_off(self.lit, timeline, channel.lasers)
        self.switch = _settings(_switch_pulses(channel, timeline))
        rates = [_highest_khz(laser) for laser in channel.lasers]
        self.highest_khz = max([*rates, float(self.off.khz.max(initial=0.0))])
        slowest = [1 / laser.carrier_khz for laser in channel.lasers if laser.carrier_khz and _is_duty(laser)]
        slowest += [laser.pulse_width_us / US_PER_MS for laser in channel.lasers if laser.mode is PowerMode.FREQUENCY]
        slowest += [1 / float(khz) for khz in np.unique(self.off.khz) if khz]
        self.lead_ms = max(slowest, default=0.0)
        """A pulse that begins by so much before a window may reach into it."""

    def window(self, start: float, end: float, span_ns: tuple[int, int]) -> Iterator[tuple[str, Edges]]:
        """Edges of the three outputs in a window, ms and ns."""
        energy, switch, analog = line_names(self.channel.channel)
        yield energy, changes(*_settings(self.energy(start, end)), float(Level.HIGH), *span_ns)
        yield switch, changes(*self.switch, float(Level.HIGH), *span_ns)
        yield analog, self.analog(start, end, span_ns)

    def energy(self, start: float, end: float) -> _Pulses:
        """Low parts of the energy line that lie in a window, or reach into it."""
        parts = [self.standby(start, end), *self.duty(start, end), *self.frequency(start, end)]
        begin = np.concatenate([part.start for part in parts])
        order = np.argsort(begin, kind="stable")
        return _Pulses(
            start=begin[order],
            end=np.concatenate([part.end for part in parts])[order],
            unknown=np.concatenate([part.unknown for part in parts])[order],
        )

    def in_window(self, start: float, end: float, modes: tuple[PowerMode, ...]) -> Indices:
        """Light of some modes in a window."""
        lit = self.lit
        first = int(np.searchsorted(lit.end_ms, start - self.lead_ms, side="right"))
        behind = int(np.searchsorted(lit.start_ms, end, side="right"))
        of_mode = np.array([laser.power_mode in modes for laser in self.lasers], dtype=np.bool_)
        at = np.arange(first, max(first, behind))
        return at[of_mode[lit.stage[at]]]

    def standby(self, start: float, end: float) -> _Pulses:
        """Standby pulses (M 二.2: while off, in the PWM modes)."""
        off = self.off
        first = int(np.searchsorted(off.end, start - self.lead_ms, side="right"))
        behind = int(np.searchsorted(off.start, end, side="right"))
        at = np.arange(first, max(first, behind))
        at = at[off.khz[at] > 0]
        return _carrier(off.start[at], off.end[at], off.khz[at], off.pct[at], start - self.lead_ms, end)

    def duty(self, start: float, end: float) -> Iterator[_Pulses]:
        """Light in a duty mode: periods of the carrier from its start on."""
        at = self.in_window(start, end, (PowerMode.DUTY, PowerMode.DUTY2))
        stage = self.lit.stage[at]
        khz = np.array([laser.carrier_khz or 0.0 for laser in self.lasers])[stage] if len(at) else np.empty(0)
        begin, finish = self.lit.start_ms[at], self.lit.end_ms[at]
        known = khz > 0
        yield _Pulses(start=begin[~known], end=finish[~known], unknown=np.ones(int((~known).sum()), dtype=np.bool_))
        at, begin, finish, khz, stage = at[known], begin[known], finish[known], khz[known], stage[known]
        which, period_start = _periods(begin, finish, khz, start - self.lead_ms, end)
        pct = self.held(stage[which], period_start)
        yield _low_parts(period_start, finish[which], 1 / khz[which], pct)

    def frequency(self, start: float, end: float) -> Iterator[_Pulses]:
        """Light in frequency mode: a pulse of fixed width whenever the phase comes round."""
        at = self.in_window(start, end, (PowerMode.FREQUENCY,))
        begin, finish, stage = self.lit.start_ms[at], self.lit.end_ms[at], self.lit.stage[at]
        since = np.maximum(begin, start - self.lead_ms)
        steps = self.steps(stage, since, np.minimum(finish, end))
        if not len(steps.value):
            return
        shift = self.timeline.shift_ms[stage]
        cycles = Spans(stage=stage, start_ms=begin - shift, end_ms=since - shift)
        turned = steps.value * steps.length_ms
        total = np.cumsum(turned)
        before = (total - turned)[np.searchsorted(steps.which, steps.which)]
        base = self.trace.power_ms(self.channel, cycles)  # kHz * ms: periods since the light came on.
        phase = total - turned - before + base[steps.which]
        low = np.ceil(phase - _SAME_PHASE)
        count = (np.ceil(phase + turned - _SAME_PHASE) - low).astype(np.intp)
        step, number = counted(count)
        fired = steps.start_ms[step] + np.maximum(low[step] + number - phase[step], 0.0) / steps.value[step]
        width = np.array([laser.pulse_width_us for laser in self.lasers])[stage[steps.which[step]]] / US_PER_MS
        dark = np.append(fired[1:], np.inf)
        stop = np.minimum(np.minimum(fired + width, finish[steps.which[step]]), dark)
        yield _Pulses(start=fired, end=stop, unknown=np.zeros(len(fired), dtype=np.bool_))

    def analog(self, start: float, end: float, span_ns: tuple[int, int]) -> Edges:
        """Volts: held power under light, the pre-voltage without, in analog mode (M 二.2); else 0."""
        at = self.in_window(start, end, (PowerMode.ANALOG,))
        first = int(np.searchsorted(self.off.end, start, side="right"))
        behind = int(np.searchsorted(self.off.start, end, side="right"))
        dark = np.arange(first, max(first, behind))
        steps = self.steps(
            self.lit.stage[at], np.maximum(self.lit.start_ms[at], start), np.minimum(self.lit.end_ms[at], end)
        )
        other = self.in_window(start, end, tuple(mode for mode in PowerMode if mode is not PowerMode.ANALOG))
        time = np.concatenate([steps.start_ms, self.off.start[dark], self.lit.start_ms[other]])
        volts = np.concatenate([steps.value, self.off.volts[dark], np.zeros(len(other))])
        order = np.argsort(time, kind="stable")
        return changes(np.rint(time[order] * NS_PER_MS).astype(np.int64), volts[order], 0.0, *span_ns)

    def held(self, stage: Indices, time: Floats) -> Floats:
        """Held power at moments on the wires."""
        return self.trace.held_power(self.channel, stage, time - self.timeline.shift_ms[stage] + _ROUNDING_MS)

    def steps(self, stage: Indices, start: Floats, end: Floats) -> Steps:
        """Held power over spans on the wires."""
        shift = self.timeline.shift_ms[stage]
        steps = steps_of(self.trace, self.channel, Spans(stage=stage, start_ms=start - shift, end_ms=end - shift))
        return steps.later(shift[steps.which])


def _is_duty(laser: LaserState) -> bool:
    return laser.power_mode in (PowerMode.DUTY, PowerMode.DUTY2)


def _highest_khz(laser: LaserState) -> float:
    """The fastest that a laser pulses under light."""
    if _is_duty(laser):
        return laser.carrier_khz or 0.0
    return laser.high if laser.mode is PowerMode.FREQUENCY else 0.0


def _times_off(lit: Spans, timeline: Timeline, lasers: tuple[LaserState, ...]) -> _Off:
    """The time between light, cut where the standby pulse or pre-voltage changes."""
    stages = np.arange(len(timeline.start_ms))
    # The time before each light of a stage, and behind its last.
    stage = np.concatenate([lit.stage, stages])
    order = np.lexsort((np.concatenate([np.zeros(len(lit.stage)), np.ones(len(stages))]), stage))
    stage = stage[order]
    end = np.concatenate([lit.start_ms, timeline.end_ms])[order]
    begin = np.concatenate([timeline.start_ms[:1], np.concatenate([lit.end_ms, timeline.end_ms])[order][:-1]])
    khz, pct, volts = (np.array(values) for values in zip(*map(_off_output, lasers), strict=True)) if lasers else _NONE
    real = begin < end
    begin, end, stage = begin[real], end[real], stage[real]
    khz, pct, volts = khz[stage], pct[stage], volts[stage]
    fresh = np.ones(len(begin), dtype=np.bool_)
    for values in (khz, pct, volts):
        fresh[1:] &= values[1:] == values[:-1]
    fresh[1:] = ~(fresh[1:] & (begin[1:] == end[:-1]))
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(fresh)) - 1 if len(first) else first
    return _Off(start=begin[first], end=end[last], khz=khz[first], pct=pct[first], volts=volts[first])


_NONE = (np.empty(0), np.empty(0), np.empty(0))


def _off_output(laser: LaserState) -> tuple[float, float, float]:
    """Standby pulse (kHz, %) and volts while a laser is off."""
    if laser.power_mode.is_pwm:
        return (*(laser.standby or (0.0, 0.0)), 0.0)
    return 0.0, 0.0, laser.prevoltage_v or 0.0


def _switch_pulses(channel: ChannelTrace, timeline: Timeline) -> _Pulses:
    """When the switch's + line is low."""
    switch = channel.emission.switch
    stage, shift = switch.stage, timeline.shift_ms[switch.stage]
    start, end = switch.start_ms + shift, switch.end_ms + shift
    if len(stage):
        width = np.array([laser.fpk_us[0] if laser.fpk_us else 0.0 for laser in channel.lasers])[stage] / US_PER_MS
        fpk = np.array([laser.fpk_us is not None for laser in channel.lasers])[stage]
        end = np.where(fpk, start + width, end)
        # One that began at rest is past when the motion starts.
        shown = ~(fpk & channel.emission.carried)
        shown &= np.array([laser.power_mode is not PowerMode.DUTY2 for laser in channel.lasers])[stage]
        start, end = start[shown], end[shown]
        end = np.minimum(end, np.append(start[1:], np.inf))
    return _Pulses(start=start, end=end, unknown=np.zeros(len(start), dtype=np.bool_))


def _periods(begin: Floats, finish: Floats, khz: Floats, since: float, until: float) -> tuple[Indices, Floats]:
    """Starts of a carrier's periods in spans, cut to a window: (span, ms)."""
    low = np.maximum(np.floor((since - begin) * khz), 0.0)
    high = np.ceil((np.minimum(finish, until) - begin) * khz - _SAME_PHASE)
    # A window's end may be a period's start: it belongs to both windows, and is cut off there.
    count = np.maximum(high - low + (finish > until), 0.0).astype(np.intp)
    which, number = counted(count)
    return which, begin[which] + (low[which] + number) / khz[which]


def _low_parts(period_start: Floats, finish: Floats, period: Floats, pct: Floats) -> _Pulses:
    """The low part of periods, duty in %."""
    lit = (pct > 0) & (period_start < finish)
    start, end = period_start[lit], np.minimum(period_start + period * pct / 100, finish)[lit]
    return _Pulses(start=start, end=end, unknown=np.zeros(len(start), dtype=np.bool_))


def _carrier(begin: Floats, finish: Floats, khz: Floats, pct: Floats, since: float, until: float) -> _Pulses:
    which, period_start = _periods(begin, finish, khz, since, until)
    return _low_parts(period_start, finish[which], 1 / khz[which], pct[which])


def _settings(pulses: _Pulses) -> tuple[Times, Floats]:
    """A + line's edges in order, (2n,): moment in ns, level from there on."""
    low = np.where(pulses.unknown, float(Level.UNKNOWN), float(Level.LOW))
    time = np.stack([pulses.start, pulses.end], axis=1).ravel()
    level = np.stack([low, np.full(len(low), float(Level.HIGH))], axis=1).ravel()
    return np.rint(time * NS_PER_MS).astype(np.int64), level


def changes(time: Times, value: Floats, rest: float, start_ns: int, end_ns: int) -> Edges:
    """Settings in order as changes in [start, end) ns: of several at one moment the last counts, of equal ones the
    first. `rest`: before all."""
    first, behind = np.searchsorted(time, start_ns, side="right"), np.searchsorted(time, end_ns, side="left")
    before = float(value[first - 1]) if first else rest
    time, value = time[first:behind], value[first:behind]
    settled = np.ones(len(time), dtype=np.bool_)
    settled[:-1] = time[1:] != time[:-1]
    time, value = time[settled], value[settled]
    changed = value != np.concatenate([[before], value])[:-1]
    return Edges(first=before, time_ns=time[changed], value=value[changed])
