"""Levels of the controller's laser outputs (M 一.1, 一.2, 三.1), window of time by window of time.

Each channel has an energy line and a switch line, both differential, and an analog output:

    energy  PWM0 (PWM2): + is high at rest and low while energy is put out; duty is the low part of the period
    switch  PWM1 (PWM3): + is high with the laser off, low with it on; with FPK it carries that pulse instead
    analog  AO0 (AO1):   volts, in analog mode; the energy line is at rest then

Where M is silent: the first period of the carrier begins with the emission; a period keeps the duty that it began with;
in frequency mode the phase continues when the frequency changes; the end of an emission cuts its pulse short; the FPK
pulse has the level of "on"; in duty mode 2 the switch line keeps one level while the mode is in force, that of the
profile's duty2_switch (config/machine.py:Duty2Switch has both readings of M); the standby pulse begins anew when an
emission ends; pulses continue over a change of stage that changes none of their settings; during emission in a duty
mode without GT_LaserOutFrq, or in frequency mode without GT_SetPulseWidth, the energy line is unknown.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.ranges import PowerMode
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints, counted
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.events import LaserState
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.outputs.output_intervals import (
    OutputEmission,
    OutputOff,
    output_emission,
    output_off,
    output_switch,
)
from gusjob.simulate.outputs.output_time import OutputTime, output_time_of
from gusjob.simulate.outputs.steps import PowerSteps, power_steps

NS_PER_MS = 1e6
_WINDOW_PULSES = 50_000
"""Pulses that are computed at once: bounds the memory."""
_WINDOW_MS = 500.0
_MARGIN_MS = 2e-6
_ROUNDING_MS = 1e-7
"""A period that begins at a power event has that event's power, whatever the rounding."""
_SAME_PHASE = 1e-9
"""Share of a period by which rounding may put a pulse before its moment."""


class Level(IntEnum):
    """Level of a + line."""

    LOW = 0
    HIGH = 1
    UNKNOWN = 2


class Edges(Struct, frozen=True, kw_only=True, eq=False):
    """Edges of a line in a window: its value at the start, then changes, (n,): moment in ns, new value."""

    first: float
    time_ns: Ints
    value: Floats


class Window(Struct, frozen=True, kw_only=True):
    """Edges of the outputs in an interval (start, end], ns.

    `lines`: + lines and analog outputs by name, in order.
    """

    interval_ns: tuple[int, int]
    lines: dict[str, Edges]


class _Pulses(Struct, frozen=True, kw_only=True, eq=False):
    """Low pulses of a + line, (n,) ms in order, none reaching into the next; `unknown`: the level is unknown there."""

    start: Floats
    end: Floats
    unknown: Bools


def line_names(channel: int) -> tuple[str, str, str]:
    """Names of the energy, switch and analog output of a channel (M 一.1)."""
    return f"PWM{2 * channel}", f"PWM{2 * channel + 1}", f"AO{channel}"


def windows_of(trace: Trace, start_ms: float = 0.0, end_ms: float | None = None) -> Iterator[Window]:
    """Yield the outputs of all channels from `start_ms` to `end_ms` (None: the end) in small windows."""
    time = output_time_of(trace)
    lines = [_ChannelOutputs(trace=trace, time=time, channel=channel) for channel in trace.channels]
    stop = time.total_ms if end_ms is None else min(end_ms, time.total_ms)
    rate = max([sum(line.highest_khz for line in lines), _WINDOW_PULSES / _WINDOW_MS])
    size_ns = max(round(_WINDOW_PULSES / rate * NS_PER_MS), 1)
    at_ns, stop_ns = round(start_ms * NS_PER_MS), round(stop * NS_PER_MS)
    while True:
        end_ns = min(at_ns + size_ns, stop_ns)
        named = {name: edges for line in lines for name, edges in line.window(at_ns, end_ns)}
        yield Window(interval_ns=(at_ns, end_ns), lines=named)
        if end_ns >= stop_ns:
            return
        at_ns = end_ns


class _ChannelOutputs:
    """The three outputs of one channel."""

    trace: Trace
    time: OutputTime
    channel: ChannelTrace
    lasers: tuple[LaserState, ...]
    emission: OutputEmission
    off: OutputOff
    switch: tuple[Ints, Floats]
    periods_before: Floats
    """Periods of emission in frequency mode since its pulse train began, (k,)."""
    highest_khz: float
    lead_ms: float
    """A pulse that begins by so much before a window may reach into it."""

    def __init__(self, *, trace: Trace, time: OutputTime, channel: ChannelTrace) -> None:
        self.trace, self.time, self.channel, self.lasers = trace, time, channel, channel.lasers
        self.emission = output_emission(channel, time)
        self.off = output_off(channel, self.emission, time)
        start, end = output_switch(channel, time, trace.duty2_switch)
        self.switch = _levels(_Pulses(start=start, end=end, unknown=np.zeros(len(start), dtype=np.bool_)))
        self.periods_before = self._periods_before()
        rates = [_highest_khz(laser) for laser in channel.lasers]
        self.highest_khz = max([*rates, float(self.off.khz.max(initial=0.0))])
        slowest = [1 / laser.carrier_khz for laser in channel.lasers if laser.carrier_khz and _is_duty(laser)]
        slowest += [laser.pulse_width_us / US_PER_MS for laser in channel.lasers if laser.mode is PowerMode.FREQUENCY]
        slowest += [1 / float(khz) for khz in np.unique(self.off.khz) if khz]
        self.lead_ms = max(slowest, default=0.0)

    def _periods_before(self) -> Floats:
        """Count the periods of each emission's pulse train before it: kHz * ms are periods."""
        emission = self.emission
        if (emission.first == np.arange(len(emission.first))).all():
            return np.zeros(len(emission.first))
        shift = self.time.shift_ms[emission.stage]
        whole = Intervals(stage=emission.stage, start_ms=emission.start - shift, end_ms=emission.end - shift)
        turned = self.channel.power.integral(whole)
        total = np.cumsum(turned) - turned
        return np.asarray(total - total[emission.first])

    def window(self, start_ns: int, end_ns: int) -> Iterator[tuple[str, Edges]]:
        """Yield the edges of the three outputs in a window, by name."""
        energy, switch, analog = line_names(self.channel.channel)
        # Rounding may move an edge over a window's ends.
        start, end = start_ns / NS_PER_MS - _MARGIN_MS, end_ns / NS_PER_MS + _MARGIN_MS
        yield energy, changes(*_levels(self.energy(start, end)), float(Level.HIGH), start_ns, end_ns)
        yield switch, changes(*self.switch, float(Level.HIGH), start_ns, end_ns)
        yield analog, changes(*self.analog(start, end), 0.0, start_ns, end_ns)

    def energy(self, start: float, end: float) -> _Pulses:
        """Low pulses of the energy line that are in a window, or reach into it."""
        parts = [self.standby(start, end), *self.duty(start, end), *self.frequency(start, end)]
        begin = np.concatenate([part.start for part in parts])
        order = np.argsort(begin, kind="stable")
        return _Pulses(
            start=begin[order],
            end=np.concatenate([part.end for part in parts])[order],
            unknown=np.concatenate([part.unknown for part in parts])[order],
        )

    def in_window(self, start: float, end: float, modes: tuple[PowerMode, ...]) -> Indices:
        """Emission of some modes in a window."""
        emission = self.emission
        first = int(np.searchsorted(emission.end, start - self.lead_ms))
        stop = int(np.searchsorted(emission.start, end, side="right"))
        of_mode = np.array([laser.power_mode in modes for laser in self.lasers], dtype=np.bool_)
        at = np.arange(first, max(first, stop))
        return at[of_mode[emission.stage[at]]]

    def standby(self, start: float, end: float) -> _Pulses:
        """Standby pulses (M 二.2: while off, in the PWM modes)."""
        off = self.off
        first = int(np.searchsorted(off.end, start - self.lead_ms, side="right"))
        stop = int(np.searchsorted(off.start, end, side="right"))
        at = np.arange(first, max(first, stop))
        at = at[off.khz[at] > 0]
        return _carrier(off.start[at], off.end[at], off.khz[at], off.pct[at], start - self.lead_ms, end)

    def duty(self, start: float, end: float) -> Iterator[_Pulses]:
        """Emission in a duty mode: periods of the carrier from its start on."""
        emission, at = self.emission, self.in_window(start, end, (PowerMode.DUTY, PowerMode.DUTY2))
        at = np.unique(emission.first[at])  # A train's periods continue over a change of stage.
        khz = np.array([laser.carrier_khz or 0.0 for laser in self.lasers])[emission.stage[at]]
        begin, finish, known = emission.start[at], emission.end[emission.last[at]], khz > 0
        yield _unknown(begin[~known], finish[~known])
        begin, finish, khz = begin[known], finish[known], khz[known]
        which, period_start = _periods(begin, finish, khz, start - self.lead_ms, end)
        moment = period_start + _ROUNDING_MS
        stage = self.time.stage_at(moment)
        pct = self.channel.power.value(stage, moment - self.time.shift_ms[stage])
        yield _low_parts(period_start, finish[which], 1 / khz[which], pct)

    def frequency(self, start: float, end: float) -> Iterator[_Pulses]:
        """Emission in frequency mode: a pulse of fixed width at every whole phase."""
        emission, at = self.emission, self.in_window(start, end, (PowerMode.FREQUENCY,))
        widths = np.array([laser.pulse_width_us for laser in self.lasers]) / US_PER_MS
        known = widths[emission.stage[at]] > 0
        yield _unknown(emission.start[at[~known]], emission.end[at[~known]])
        at = at[known]
        begin, stage = emission.start[at], emission.stage[at]
        since = np.maximum(begin, start - self.lead_ms)
        steps = self.steps(stage, since, np.minimum(emission.end[at], end))
        if not len(steps.value):
            return
        shift = self.time.shift_ms[stage]
        turned = steps.value * steps.length_ms
        total = np.cumsum(turned) - turned
        since_train = self.periods_before[at] + self.channel.power.integral(
            Intervals(stage=stage, start_ms=begin - shift, end_ms=since - shift)
        )
        phase = total - total[np.searchsorted(steps.which, steps.which)] + since_train[steps.which]
        low = np.ceil(phase - _SAME_PHASE)
        step, number = counted((np.ceil(phase + turned - _SAME_PHASE) - low).astype(np.intp))
        fired = steps.start_ms[step] + np.maximum(low[step] + number - phase[step], 0.0) / steps.value[step]
        of = at[steps.which[step]]
        stop = np.minimum(fired + widths[emission.stage[of]], emission.end[emission.last[of]])
        stop = np.minimum(stop, np.append(fired[1:], np.inf))
        yield _Pulses(start=fired, end=stop, unknown=np.zeros(len(fired), dtype=np.bool_))

    def analog(self, start: float, end: float) -> tuple[Ints, Floats]:
        """Volts from moments on, in analog mode: held power or, while off, the pre-voltage (M 二.2). Otherwise 0."""
        emission, at = self.emission, self.in_window(start, end, (PowerMode.ANALOG,))
        first = int(np.searchsorted(self.off.end, start))
        stop = int(np.searchsorted(self.off.start, end, side="right"))
        off = np.arange(first, max(first, stop))
        steps = self.steps(emission.stage[at], np.maximum(emission.start[at], start), np.minimum(emission.end[at], end))
        other = self.in_window(start, end, tuple(mode for mode in PowerMode if mode is not PowerMode.ANALOG))
        time = np.concatenate([steps.start_ms, self.off.start[off], emission.start[other]])
        volts = np.concatenate([steps.value, self.off.volts[off], np.zeros(len(other))])
        order = np.argsort(time, kind="stable")
        return to_ns(time[order]), volts[order]

    def steps(self, stage: Indices, start: Floats, end: Floats) -> PowerSteps:
        """Steps of held power in intervals of output time."""
        shift = self.time.shift_ms[stage]
        steps = power_steps(
            self.trace, self.channel, Intervals(stage=stage, start_ms=start - shift, end_ms=end - shift)
        )
        return steps.shifted(shift[steps.which])


def _is_duty(laser: LaserState) -> bool:
    return laser.power_mode in (PowerMode.DUTY, PowerMode.DUTY2)


def _highest_khz(laser: LaserState) -> float:
    """Highest pulse frequency of a laser while emitting."""
    if _is_duty(laser):
        return laser.carrier_khz or 0.0
    return laser.high if laser.mode is PowerMode.FREQUENCY else 0.0


def _periods(begin: Floats, finish: Floats, khz: Floats, since: float, until: float) -> tuple[Indices, Floats]:
    """Find the starts of a carrier's periods in intervals, cut to a window: (interval, ms)."""
    low = np.maximum(np.floor((since - begin) * khz), 0.0)
    high = np.ceil((np.minimum(finish, until) - begin) * khz - _SAME_PHASE)
    # A window's end may be a period's start: it belongs to both windows, and is cut off there.
    count = np.maximum(high - low + (finish > until), 0.0).astype(np.intp)
    which, number = counted(count)
    return which, begin[which] + (low[which] + number) / khz[which]


def _unknown(start: Floats, end: Floats) -> _Pulses:
    """Intervals in which the pulses are not known."""
    return _Pulses(start=start, end=end, unknown=np.ones(len(start), dtype=np.bool_))


def _low_parts(period_start: Floats, finish: Floats, period: Floats, pct: Floats) -> _Pulses:
    """Low part of periods, duty in %."""
    real = (pct > 0) & (period_start < finish)
    start, end = period_start[real], np.minimum(period_start + period * pct / 100, finish)[real]
    return _Pulses(start=start, end=end, unknown=np.zeros(len(start), dtype=np.bool_))


def _carrier(begin: Floats, finish: Floats, khz: Floats, pct: Floats, since: float, until: float) -> _Pulses:
    which, period_start = _periods(begin, finish, khz, since, until)
    return _low_parts(period_start, finish[which], 1 / khz[which], pct[which])


def _levels(pulses: _Pulses) -> tuple[Ints, Floats]:
    """Turn pulses of a + line into levels, (2n,): moment in ns, level from there on."""
    low = np.where(pulses.unknown, float(Level.UNKNOWN), float(Level.LOW))
    time = np.stack([pulses.start, pulses.end], axis=1).ravel()
    level = np.stack([low, np.full(len(low), float(Level.HIGH))], axis=1).ravel()
    return to_ns(time), level


def to_ns(time_ms: Floats) -> Ints:
    """Round moments to nanoseconds; halves round the same way, whatever rounding there was before."""
    return np.rint(np.round(time_ms * NS_PER_MS, 3)).astype(np.int64)


def changes(time: Ints, value: Floats, rest: float, start_ns: int, end_ns: int) -> Edges:
    """Reduce values in order to changes in a window: of several at one moment the last counts, of equal ones the first.

    `rest`: the value before the first one.
    """
    first, stop = np.searchsorted(time, [start_ns, end_ns], side="right")
    before = float(value[first - 1]) if first else rest
    time, value = time[first:stop], value[first:stop]
    settled = np.ones(len(time), dtype=np.bool_)
    settled[:-1] = time[1:] != time[:-1]
    time, value = time[settled], value[settled]
    changed = value != np.concatenate([[before], value])[:-1]
    return Edges(first=before, time_ns=time[changed], value=value[changed])
