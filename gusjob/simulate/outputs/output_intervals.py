"""Intervals of emission, of the switch signal and of the laser off, on the time axis of the outputs."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Duty2Switch
from gusjob.controllers.gus.ranges import PowerMode
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace
from gusjob.simulate.events import LaserState
from gusjob.simulate.outputs.output_time import OutputTime

_BEYOND_MS = 1.0
"""A level that is kept at the end of the outputs lasts longer than they do."""


class OutputEmission(Struct, frozen=True, kw_only=True, eq=False):
    """Emission intervals of a channel, (k,) in order: stage, start and end, ms on the outputs.

    Emission that continues over a change of stage lasts through the wait between them. `first`, `last`: the first and
    the last interval of each one's pulse train; a train continues while nothing that shapes its pulses changes.
    """

    stage: Indices
    start: Floats
    end: Floats
    first: Indices
    last: Indices


class OutputOff(Struct, frozen=True, kw_only=True, eq=False):
    """Intervals without emission, (k,): start and end, ms on the outputs, standby pulse (0 kHz: none) and volts."""

    start: Floats
    end: Floats
    khz: Floats
    pct: Floats
    volts: Floats


def output_emission(channel: ChannelTrace, time: OutputTime) -> OutputEmission:
    """Compute the emission of a channel."""
    emission, shift = channel.emission, time.shift_ms
    stage = emission.stage
    start, end = emission.start_ms + shift[stage], emission.end_ms + shift[stage]
    continues = (stage[1:] != stage[:-1]) & (emission.start_ms[1:] == emission.end_ms[:-1])
    continues &= (emission.off_event[:-1] < 0) & (emission.on_event[1:] < 0)
    end[:-1][continues] = start[1:][continues]
    trains = [_train(laser) for laser in channel.lasers]
    number = np.array([trains.index(train) for train in trains], dtype=np.intp)[stage] if trains else stage
    fresh = np.ones(len(stage), dtype=np.bool_)
    fresh[1:] = ~continues | (number[1:] != number[:-1])
    first = np.flatnonzero(fresh)
    of_train = np.cumsum(fresh) - 1
    last = np.append(first[1:], len(stage)) - 1 if len(stage) else first
    return OutputEmission(stage=stage, start=start, end=end, first=first[of_train], last=last[of_train])


def _train(laser: LaserState) -> tuple[PowerMode, float | None, float]:
    """Settings that shape a pulse train."""
    return laser.power_mode, laser.carrier_khz, laser.pulse_width_us


def output_switch(channel: ChannelTrace, time: OutputTime, duty2: Duty2Switch) -> tuple[Floats, Floats]:
    """Compute when a channel's switch signal is on, (k,) ms: start and end; with FPK, its pulses (M 二.2).

    In duty mode 2 the signal does not change: it is on or off as long as the mode is in force.
    """
    switch, carried, shift = channel.emission.switch, channel.emission.carried, time.shift_ms
    stage = switch.stage
    start, end = switch.start_ms + shift[stage], switch.end_ms + shift[stage]
    continues = carried[1:] & (stage[1:] != stage[:-1]) & (switch.start_ms[1:] == switch.end_ms[:-1])
    end[:-1][continues] = start[1:][continues]
    fpk = np.array([laser.fpk_us is not None for laser in channel.lasers], dtype=np.bool_)[stage]
    width = np.array([laser.fpk_us[0] if laser.fpk_us else 0.0 for laser in channel.lasers])[stage] / US_PER_MS
    end = np.where(fpk, start + width, end)
    constant = np.array([laser.power_mode is PowerMode.DUTY2 for laser in channel.lasers], dtype=np.bool_)
    # The pulse of emission that was on before its stage is over.
    shown = ~(fpk & carried) & ~constant[stage]
    start, end = start[shown], end[shown]
    if duty2 is Duty2Switch.ON and constant.any():
        begins = np.flatnonzero(constant & ~np.concatenate([[False], constant[:-1]]))
        ends = np.flatnonzero(constant & ~np.concatenate([constant[1:], [False]]))
        after = np.append(time.start_ms[1:], time.total_ms + _BEYOND_MS)
        start, end = np.concatenate([start, time.start_ms[begins]]), np.concatenate([end, after[ends]])
        order = np.argsort(start, kind="stable")
        start, end = start[order], end[order]
    return start, np.minimum(end, np.append(start[1:], np.inf))


def output_off(channel: ChannelTrace, emission: OutputEmission, time: OutputTime) -> OutputOff:
    """Compute the intervals between emission, cut where the standby pulse or the pre-voltage changes."""
    stages = np.arange(len(time.start_ms))
    # The time before each emission of a stage, and after its last.
    stage = np.concatenate([emission.stage, stages])
    order = np.lexsort((np.concatenate([np.zeros(len(emission.stage)), np.ones(len(stages))]), stage))
    stage = stage[order]
    end = np.concatenate([emission.start, time.end_ms])[order]
    begin = np.concatenate([time.start_ms[:1], np.concatenate([emission.end, time.end_ms])[order][:-1]])
    real = begin < end
    real[-1:] |= not channel.emission.on_at_end  # The final state shows at the very end.
    begin, end, stage = begin[real], end[real], stage[real]
    outputs = np.array([_off_output(laser) for laser in channel.lasers]).reshape(-1, 3)[stage]
    fresh = np.ones(len(begin), dtype=np.bool_)
    fresh[1:] = (begin[1:] != end[:-1]) | (outputs[1:] != outputs[:-1]).any(axis=1)
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(fresh)) - 1 if len(first) else first
    khz, pct, volts = outputs[first].T
    return OutputOff(start=begin[first], end=end[last], khz=khz, pct=pct, volts=volts)


def _off_output(laser: LaserState) -> tuple[float, float, float]:
    """Standby pulse (kHz, %) and volts while a laser is off (M 二.2)."""
    if laser.power_mode.is_pwm:
        return (*(laser.standby or (0.0, 0.0)), 0.0)
    return 0.0, 0.0, laser.prevoltage_v or 0.0
