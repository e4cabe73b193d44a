"""When a channel's light and its switch are on, and what the laser gets while it is off, in the time of the wires."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.controllers.gus.ranges import PowerMode
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace
from gusjob.simulate.outputs.timeline import Timeline
from gusjob.simulate.state import LaserState


@dataclass(frozen=True, slots=True, kw_only=True)
class Lit:
    """Light of a channel, (k,) in order: stage, start and end, ms on the wires.

    Light that goes on over a change of stage lasts through the wait between them. `first`, `last`: of the lights that
    are one to a pulse train, since nothing that makes its pulses changed between them, the first and the last.
    """

    stage: Indices
    start: Floats
    end: Floats
    first: Indices
    last: Indices


@dataclass(frozen=True, slots=True, kw_only=True)
class Off:
    """Time without light, (k,): start and end, ms on the wires; the standby pulse in it (0 kHz: none), volts in it."""

    start: Floats
    end: Floats
    khz: Floats
    pct: Floats
    volts: Floats


def lit_of(channel: ChannelTrace, timeline: Timeline) -> Lit:
    """When a channel shines."""
    shine, shift = channel.emission, timeline.shift_ms
    stage = shine.stage
    start, end = shine.start_ms + shift[stage], shine.end_ms + shift[stage]
    goes_on = (stage[1:] != stage[:-1]) & (shine.start_ms[1:] == shine.end_ms[:-1])
    goes_on &= (shine.off_row[:-1] < 0) & (shine.on_row[1:] < 0)
    end[:-1][goes_on] = start[1:][goes_on]
    trains = [_train(laser) for laser in channel.lasers]
    number = np.array([trains.index(train) for train in trains], dtype=np.intp)[stage] if trains else stage
    fresh = np.ones(len(stage), dtype=np.bool_)
    fresh[1:] = ~goes_on | (number[1:] != number[:-1])
    first = np.flatnonzero(fresh)
    of_train = np.cumsum(fresh) - 1
    last = np.append(first[1:], len(stage)) - 1 if len(stage) else first
    return Lit(stage=stage, start=start, end=end, first=first[of_train], last=last[of_train])


def _train(laser: LaserState) -> tuple[PowerMode, float | None, float]:
    """What a pulse train is made with."""
    return laser.power_mode, laser.carrier_khz, laser.pulse_width_us


def switch_of(channel: ChannelTrace, timeline: Timeline) -> tuple[Floats, Floats]:
    """When a channel's switch line says on, (k,) ms on the wires: start and end; with FPK, its pulses (M 二.2)."""
    switch, carried, shift = channel.emission.switch, channel.emission.carried, timeline.shift_ms
    stage = switch.stage
    start, end = switch.start_ms + shift[stage], switch.end_ms + shift[stage]
    goes_on = carried[1:] & (stage[1:] != stage[:-1]) & (switch.start_ms[1:] == switch.end_ms[:-1])
    end[:-1][goes_on] = start[1:][goes_on]
    if not len(stage):
        return start, end
    fpk = np.array([laser.fpk_us is not None for laser in channel.lasers])[stage]
    width = np.array([laser.fpk_us[0] if laser.fpk_us else 0.0 for laser in channel.lasers])[stage] / US_PER_MS
    end = np.where(fpk, start + width, end)
    # The pulse of light that was on before its stage is past; in duty mode 2 the line says nothing.
    shown = ~(fpk & carried) & np.array([laser.power_mode is not PowerMode.DUTY2 for laser in channel.lasers])[stage]
    start, end = start[shown], end[shown]
    return start, np.minimum(end, np.append(start[1:], np.inf))


def off_of(channel: ChannelTrace, lit: Lit, timeline: Timeline) -> Off:
    """The time between light, cut where the standby pulse or the pre-voltage changes."""
    stages = np.arange(len(timeline.start_ms))
    # The time before each light of a stage, and behind its last.
    stage = np.concatenate([lit.stage, stages])
    order = np.lexsort((np.concatenate([np.zeros(len(lit.stage)), np.ones(len(stages))]), stage))
    stage = stage[order]
    end = np.concatenate([lit.start, timeline.end_ms])[order]
    begin = np.concatenate([timeline.start_ms[:1], np.concatenate([lit.end, timeline.end_ms])[order][:-1]])
    real = begin < end
    real[-1:] |= not channel.emission.lit_at_end  # What it gets when all is done is seen at the very end.
    begin, end, stage = begin[real], end[real], stage[real]
    outputs = np.array([_off_output(laser) for laser in channel.lasers]).reshape(-1, 3)[stage]
    fresh = np.ones(len(begin), dtype=np.bool_)
    fresh[1:] = (begin[1:] != end[:-1]) | (outputs[1:] != outputs[:-1]).any(axis=1)
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(fresh)) - 1 if len(first) else first
    khz, pct, volts = outputs[first].T
    return Off(start=begin[first], end=end[last], khz=khz, pct=pct, volts=volts)


def _off_output(laser: LaserState) -> tuple[float, float, float]:
    """Standby pulse (kHz, %) and volts while a laser is off (M 二.2)."""
    if laser.power_mode.is_pwm:
        return (*(laser.standby or (0.0, 0.0)), 0.0)
    return 0.0, 0.0, laser.prevoltage_v or 0.0
