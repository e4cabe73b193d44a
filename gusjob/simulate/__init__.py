"""Stream to Trace: what the controller does with the calls, whoever wrote them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.model import run_program
from gusjob.controllers.gus.ranges import FIFO_SLOTS, PowerMode
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.beam import beam_of
from gusjob.simulate.clock import Clock, path_diagnostics, run_clock
from gusjob.simulate.emission import emission
from gusjob.simulate.path import Motion
from gusjob.simulate.power import emitted
from gusjob.simulate.settings import power_calls
from gusjob.simulate.state import Program
from gusjob.simulate.trace import ChannelTrace, Trace

__all__ = ["MAX_TICKS", "ChannelTrace", "Trace", "find_faults", "interpret"]


MAX_TICKS = 10_000_000_000
"""A run of more ticks is refused: nobody would wait for it."""


_COARSE_TICKS = 100_000
"""So many ticks are enough where only diagnostics are asked for: none of them hangs on how often power is sampled."""


def find_diagnostics(stream: Stream, machine: Machine) -> list[Diagnostic]:
    """What the controller would say to a listing."""
    return interpret(stream, machine, foreign=True, coarse=True)[1]


def interpret(
    stream: Stream, machine: Machine, *, foreign: bool = False, coarse: bool = False
) -> tuple[Trace | None, list[Diagnostic]]:
    """Run a stream on a machine; None if it would take too long to be interpreted.

    `foreign`: not from our planner, so its corners and its field are looked at too. `coarse`: only the diagnostics are
    asked for; power is not sampled at every tick.
    """
    program = run_program(stream, has_scanner=machine.scanner is not None)
    calls = stream.buffered
    clock, diagnostics = run_clock(calls, program, stream.name)
    diagnostics = [*program.diagnostics, *diagnostics]
    ticks = float(clock.times_ms[-1]) * US_PER_MS / machine.period_us
    if ticks > MAX_TICKS:
        longest = int(np.argmax(clock.duration_ms))
        fields = {"duration": float(clock.times_ms[-1]), "ticks": ticks, "limit": float(MAX_TICKS)}
        span = Span(line=int(calls.line[clock.row[longest]]))
        return None, [*diagnostics, Diagnostic(rule=rules.TOO_LONG, span=span, fields=fields, path=stream.name)]
    if foreign:
        diagnostics += path_diagnostics(calls, clock, machine, stream.name)
        diagnostics += _full_fifos(calls.line, program, stream.name)
    period_us = machine.period_us * max(1.0, ticks / _COARSE_TICKS) if coarse else machine.period_us
    motion = Motion(clock=clock, program=program)
    beam = beam_of(motion, None if coarse else machine.scanner)
    channels = []
    for channel in program.channels:
        lasers = [stage.lasers[channel] for stage in program.stages]
        shine = emission(calls, clock, program, channel)
        powers = power_calls(calls, clock, program, channel)
        done, lost = emitted(motion, beam, shine, powers, lasers, period_us / US_PER_MS)
        trace = ChannelTrace(
            channel=channel,
            lasers=tuple(lasers),
            at_end=program.lasers[channel],
            emission=shine,
            powers=powers,
            emitted=done,
            lost_power_ms=lost,
            lit_at_end=shine.lit_at_end,
        )
        channels.append(trace)
        diagnostics += _emission_diagnostics(trace, clock, calls.line, program, stream.name)
    trace_all = Trace(
        name=stream.name,
        period_us=machine.period_us,
        line=calls.line[clock.row],
        clock=clock,
        motion=motion,
        beam=beam,
        channels=tuple(channels),
        readings=program.readings,
        intent=stream.intent,
    )
    return trace_all, diagnostics


def _full_fifos(lines: npt.NDArray[np.int32], program: Program, path: str) -> list[Diagnostic]:
    """Stages of which more calls are sent before GT_CrdStart than a FIFO holds (sister)."""
    found = []
    for stage in program.stages:
        waiting = stage.parts[: stage.waiting]
        if sum(map(len, waiting)) > FIFO_SLOTS:
            line = int(lines[np.concatenate(waiting)[FIFO_SLOTS]])
            fields = {"count": FIFO_SLOTS + 1, "slots": FIFO_SLOTS}
            found.append(Diagnostic(rule=rules.FIFO_FULL, span=Span(line=line), fields=fields, path=path))
    return found


def _emission_diagnostics(
    trace: ChannelTrace, clock: Clock, lines: npt.NDArray[np.int32], program: Program, path: str
) -> list[Diagnostic]:
    diagnostics: list[Diagnostic] = []
    row = clock.row

    def add(rule: Rule, line: int, **fields: object) -> None:
        diagnostics.append(
            Diagnostic(rule=rule, span=Span(line=line), fields={"channel": trace.channel, **fields}, path=path)
        )

    dark = np.flatnonzero(trace.emitted.unpowered)
    if len(dark):
        add(rules.LIT_UNPOWERED, int(lines[row[dark[0]]]))
    lit = np.flatnonzero(trace.emitted.emission_ms > 0)
    if len(lit):
        laser = trace.lasers[int(clock.stage[lit[0]])]
        if laser.mode is None:
            add(rules.LISTING_NO_MODE, int(lines[row[lit[0]]]))
        if laser.mode in (PowerMode.DUTY, PowerMode.DUTY2) and laser.carrier_khz is None:
            reason = Phrase("light in a duty mode without a carrier; GT_LaserOutFrq must be called (M 二.2)")
            diagnostics.append(
                Diagnostic(
                    rule=rules.ACCEPTED_ODD,
                    span=Span(line=int(lines[row[lit[0]]])),
                    fields={"call": "GT_LaserOutFrq", "reason": reason},
                    path=path,
                )
            )
    if trace.lit_at_end:
        last = max([int(lines[row[-1]])] if len(row) else [1], default=1)
        last = max([last, *(a.line for a in program.at_end if a.channel == trace.channel and a.on)])
        add(rules.LISTING_LEFT_ON, last)
    return diagnostics
