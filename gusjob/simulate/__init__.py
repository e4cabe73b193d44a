"""Simulation: events of any controller to a trace of motion, emission and power."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from gusjob.config.machine import MAX_TICKS, Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.beam import Beam
from gusjob.simulate.checks import emission_diagnostics, motion_diagnostics, path_diagnostics
from gusjob.simulate.emission import emission_of
from gusjob.simulate.events import ChannelEvents, Events
from gusjob.simulate.kinds import segment_kinds
from gusjob.simulate.motion import Motion, motion_of
from gusjob.simulate.power import HeldPower
from gusjob.simulate.power_settings import power_timeline
from gusjob.simulate.trace import ChannelTrace, Trace

__all__ = ["MAX_TICKS", "ChannelTrace", "Trace", "simulate"]

_COARSE_TICKS = 100_000
"""Ticks of a coarse simulation: no diagnostic depends on how often power is sampled."""


def simulate(
    events: Events, machine: Machine, *, is_listing: bool = False, coarse: bool = False
) -> tuple[Trace | None, list[Diagnostic]]:
    """Simulate the events of a controller on a machine.

    Args:
        events: What the controller does with its calls.
        machine: Period, scanner, field and look-ahead.
        is_listing: The calls do not come from the planner: check corners and field, too.
        coarse: Only the diagnostics are of interest: sample power at fewer ticks.

    Returns:
        The trace, or None if the run is too long to be simulated; and the diagnostics.
    """
    motion = motion_of(events)
    diagnostics = motion_diagnostics(events, motion.schedule)
    ticks = float(motion.schedule.times_ms[-1]) * US_PER_MS / machine.period_us
    if not ticks <= MAX_TICKS:
        return None, [*diagnostics, _too_long(events, motion, ticks)]
    if is_listing:
        diagnostics += path_diagnostics(events, motion, machine)
    period_us = machine.period_us * max(1.0, ticks / _COARSE_TICKS) if coarse else machine.period_us
    beam = Beam(motion=motion, scanner=None if coarse else machine.scanner)
    channels = tuple(_channel_trace(channel, events, motion, beam, period_us) for channel in events.channels)
    for channel in channels:
        diagnostics += emission_diagnostics(channel, events)
    trace = Trace(
        name=events.name,
        period_us=machine.period_us,
        line=events.motion.line,
        call=events.motion.call,
        stage_line=np.array([stage.line for stage in events.stages], dtype=np.int32),
        motion=motion,
        beam=beam,
        channels=channels,
        readings=tuple(sorted(_readings(channels), key=lambda reading: reading[0])),
        kind=segment_kinds(events.motion.dwell, events.motion.run_kind, (c.emission for c in channels)),
        is_sky_written=events.motion.run_kind is not None,
        duty2_switch=machine.duty2_switch,
    )
    return trace, diagnostics


def _readings(channels: Iterable[ChannelTrace]) -> Iterator[tuple[int, int, int]]:
    """Yield the readings of all switches: (line, channel, value)."""
    for channel in channels:
        for line, on in channel.emission.readings:
            yield line, channel.channel, int(on)


def _too_long(events: Events, motion: Motion, ticks: float) -> Diagnostic:
    longest = int(np.argmax(motion.schedule.duration_ms))
    fields = {"duration": float(motion.schedule.times_ms[-1]), "ticks": ticks, "limit": float(MAX_TICKS)}
    span = Span(line=int(events.motion.line[longest]))
    return Diagnostic(rule=rules.RUN_TOO_LONG, span=span, fields=fields, path=events.name)


def _channel_trace(
    channel: ChannelEvents, events: Events, motion: Motion, beam: Beam, period_us: float
) -> ChannelTrace:
    lasers = tuple(stage.lasers[channel.channel] for stage in events.stages)
    emission = emission_of(channel, events, motion.schedule)
    power = HeldPower(
        motion=motion,
        beam=beam,
        timeline=power_timeline(channel, events, motion.schedule),
        lasers=lasers,
        period_ms=period_us / US_PER_MS,
    )
    emitted, before_motion = power.emitted(emission)
    return ChannelTrace(
        channel=channel.channel,
        lasers=lasers,
        laser_at_end=channel.laser_at_end,
        switch=channel.switch,
        emission=emission,
        power=power,
        emitted=emitted,
        before_motion_power_ms=before_motion,
    )
