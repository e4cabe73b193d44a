"""LASER DELAY and SKYWRITE that bring the ends of marks nearest to where they belong, for a scanner and job."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from gusjob.checks import check
from gusjob.diagnostics import Diagnostic, has_errors
from gusjob.interpreter import ChannelTrace, Trace, interpret
from gusjob.job import Job, LaserDelay, SkyWrite
from gusjob.limits import AUTO_SHARE, RUN_STEP_US, SWITCH_DELAY_US
from gusjob.machine import Machine, ScannerModel
from gusjob.planner import compile_job
from gusjob.report.marks import marking_totals, marks_of
from gusjob.syntax import Source, read_job
from gusjob.tune.edit import with_statement
from gusjob.tune.search import nearest

CLOSED_FORM, SEARCH = "closed form", "search on the interpreter"

_RUN_INS = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Run-ins that are tried, in tracking errors, as long as the ends come nearer; the first is AUTO's."""
_WORTH_PULSE = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """A job's text, checked and interpreted; `trace` None: it has errors. `marking` as in a report's totals."""

    source: Source
    job: Job
    trace: Trace | None
    faults: list[Diagnostic]
    marking: list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Tuned:
    """A statement, how it was found, and the job with it."""

    statement: str
    how: str
    run: Run


def run_text(source: Source, machine: Machine) -> Run:
    """A job's text on a machine."""
    job, faults = read_job(source, machine)
    faults = [*faults, *check(job, machine)]
    trace, marking = None, list[dict[str, Any]]()
    if not has_errors(faults):
        stream, more = compile_job(job, machine)
        faults = [*faults, *more]
        if not has_errors(more):
            trace, _ = interpret(stream, machine)
            marking = [] if trace is None else marking_totals(trace, marks_of(trace, machine))
    return Run(source=source, job=job, trace=trace, faults=faults, marking=marking)


def tune_delays(run: Run, machine: Machine, channel: int) -> Tuned | str:
    """LASER DELAY of a channel; where there is nothing to tune, the reason."""
    if run.job.sky_writes:
        return "this job is sky-written, which makes up for LASER DELAY: tune SKYWRITE (--skywrite)"
    shining = _shining(run, channel)
    if isinstance(shining, str):
        return shining
    gap_us, late_us = _killer_us(shining)
    assert run.trace is not None and machine.scanner is not None
    if machine.scanner.model is ScannerModel.DELAY:
        on_us = off_us = round(machine.scanner.tracking_error_us)
        how = CLOSED_FORM
    else:
        found = nearest(run.trace, machine, shining, slack_pulse=1)
        if found is None:
            return f"no mark of channel {channel} is switched by LASER ON and LASER OFF"
        on_us, off_us, how = found.on_us, found.off_us, SEARCH
    # What the first pulse killer delays need not be delayed again; off stays at or above on (M 二.2).
    on_us = min(max(on_us - round(gap_us), 0), int(SWITCH_DELAY_US.high))
    off_us = min(max(off_us - round(late_us), on_us), int(SWITCH_DELAY_US.high))
    statement = f"LASER DELAY ON {on_us}us OFF {off_us}us" + _channel_word(run, channel)
    return _tried(run, machine, LaserDelay, channel, statement, how)


def tune_sky_writing(run: Run, machine: Machine, channel: int, mode: int | None) -> Tuned | str:
    """SKYWRITE of a job; where there is nothing to tune, the reason. `mode`: None for the job's own, else 3."""
    shining = _shining(run, channel)
    if isinstance(shining, str):
        return shining
    assert machine.scanner is not None
    own = next((s.what.settings for s in run.job.setups if isinstance(s.what, SkyWrite) and s.what.settings), None)
    mode = mode or (int(own.mode) if own is not None else 3)
    lag_us, gap_us = round(machine.scanner.tracking_error_us), _killer_us(shining)[0]
    npost = math.ceil(lag_us / RUN_STEP_US)
    if machine.scanner.model is ScannerModel.DELAY:
        nprev = math.floor(AUTO_SHARE["NPREV"] * lag_us + 0.5)
        statement = _sky_statement(mode, lag_us, -gap_us, nprev, npost)
        return _tried(run, machine, SkyWrite, channel, statement, CLOSED_FORM)
    best, least_mm = "", math.inf
    for share in _RUN_INS:
        nprev = math.ceil(share * lag_us / RUN_STEP_US)
        tuned = _tried(run, machine, SkyWrite, channel, _sky_statement(mode, lag_us, -gap_us, nprev, npost), SEARCH)
        if isinstance(tuned, str) or tuned.run.trace is None:
            return tuned
        shining = _shining(tuned.run, channel)
        # At speed no two moments are as near as each other.
        found = None if isinstance(shining, str) else nearest(tuned.run.trace, machine, shining, slack_pulse=0)
        if found is None:
            return f"no mark of channel {channel} is left with {tuned.statement}"
        if least_mm - found.on_miss_mm < _WORTH_PULSE / min(machine.pulses_per_mm):
            break
        least_mm = found.on_miss_mm
        best = _sky_statement(mode, found.off_us, found.on_us - found.off_us - gap_us, nprev, npost)
    return _tried(run, machine, SkyWrite, channel, best, SEARCH)


def _sky_statement(mode: int, timelag_us: float, shift_us: float, nprev: int, npost: int) -> str:
    shift = f" SHIFT {shift_us:g}us" if shift_us else ""
    return f"SKYWRITE MODE {mode} TIMELAG {timelag_us:g}us{shift} NPREV {nprev} NPOST {npost}"


def _tried(
    run: Run, machine: Machine, kind: type[LaserDelay | SkyWrite], channel: int, statement: str, how: str
) -> Tuned | str:
    source = with_statement(run.source, run.job, kind, channel, statement)
    if isinstance(source, str):
        return source
    return Tuned(statement=statement, how=how, run=run_text(source, machine))


def _shining(run: Run, channel: int) -> ChannelTrace | str:
    """The channel's trace, if it ever shines."""
    channels = run.trace.channels if run.trace is not None else ()
    found = next((c for c in channels if c.channel == channel and len(c.emission.stage)), None)
    return found or f"channel {channel} marks nothing in this job"


def _killer_us(shining: ChannelTrace) -> tuple[float, float]:
    """Gap and off delay of the first pulse killer, where the channel shines first."""
    times = shining.lasers[int(shining.emission.stage[0])].fpk_us
    return (times[1], times[2]) if times else (0.0, 0.0)


def _channel_word(run: Run, channel: int) -> str:
    """Said where more than one channel is spoken of, or it is not the default one."""
    others = any(s.channel != channel for s in run.job.setups) or bool((run.job.path.channel != channel).any())
    return f" CHANNEL {channel}" if channel or others else ""
