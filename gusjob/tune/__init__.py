"""LASER DELAY and SKYWRITE that bring the ends of marks nearest to where they belong, for a scanner and job."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from gusjob.config.machine import Machine, ScannerModel
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.ranges import RUN_STEP_US, SWITCH_DELAY_US, TIMELAG_US
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.frontend import Source, read_job
from gusjob.i18n.phrases import Phrase
from gusjob.ir.job import Job
from gusjob.ir.setup import LaserDelay, SkyWrite, auto_steps
from gusjob.lint import check
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.marks import marking_totals, marks_of
from gusjob.tune.edit import with_statement
from gusjob.tune.search import Band, nearest_delays

CLOSED_FORM, SEARCH = Phrase("closed form"), Phrase("search in the simulator")

_RUN_INS = (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Run-ins that are tried, in tracking errors, as long as the ends come nearer; the first is AUTO's."""
_WORTH_PULSE = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneRun:
    """A job's text, checked and interpreted; `trace` None: it has errors. `marking` as in a report's totals."""

    source: Source
    job: Job
    trace: Trace | None
    diagnostics: list[Diagnostic]
    marking: list[dict[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneResult:
    """A statement, how it was found, and the job with it."""

    statement: str
    how: str
    run: TuneRun


def run_text(source: Source, machine: Machine, *, judged: bool = True) -> TuneRun:
    """A job's text on a machine. `judged`: with the figures of its marks."""
    job, diagnostics = read_job(source, machine)
    return run_job(source, job, [*diagnostics, *check(job, machine)], machine, judged=judged)


def run_job(
    source: Source, job: Job, diagnostics: list[Diagnostic], machine: Machine, *, judged: bool = True
) -> TuneRun:
    """A job that was read and checked, on a machine; `diagnostics`: what was found."""
    trace, marking = None, list[dict[str, Any]]()
    if not has_errors(diagnostics):
        stream, more = compile_job(job, machine)
        diagnostics = [*diagnostics, *more]
        if not has_errors(more):
            trace, more = simulate_stream(stream, machine)
            if trace is not None and judged:
                marking = marking_totals(trace, marks_of(trace, machine))
            elif trace is None:
                diagnostics = [
                    *diagnostics,
                    *(replace(f, span=job.locate(f.span.line, ""), path=source.name) for f in more),
                ]
    return TuneRun(source=source, job=job, trace=trace, diagnostics=diagnostics, marking=marking)


def tune_delays(run: TuneRun, machine: Machine, channel: int) -> TuneResult | str:
    """LASER DELAY of a channel; where there is nothing to tune, the reason."""
    if run.job.has_sky_writing:
        return Phrase("this job uses sky writing, which replaces LASER DELAY; tune it with --skywrite")
    at_once = _without_delays(run, machine, channel)
    if isinstance(at_once, str):
        return at_once
    shining = _emitting_channel(at_once, channel)
    if isinstance(shining, str):
        return shining
    gap_us, late_us = _first_pulse_killer_us(shining)
    assert at_once.trace is not None and machine.scanner is not None
    lag_us = machine.scanner.tracking_error_us
    if lag_us > SWITCH_DELAY_US.high:
        return Phrase(
            "the lag of scanner {scanner} exceeds the largest delay, {most} us",
            scanner=str(machine.scanner),
            most=SWITCH_DELAY_US.high,
        )
    closed = machine.scanner.model is ScannerModel.DELAY or not round(lag_us)
    most_us = 0 if closed else SWITCH_DELAY_US.high + max(gap_us, late_us)
    found = nearest_delays(at_once.trace, machine, shining, slack_pulse=1, most_us=most_us)
    if found is None:
        return Phrase("no mark of channel {channel} is switched by LASER ON and LASER OFF", channel=channel)
    on, off, how = *found, SEARCH
    if closed:
        on = off = Band(first_us=round(lag_us), last_us=round(lag_us), miss_mm=0)
        how = CLOSED_FORM
    on_us, off_us = _choose_delays(_as_delays(on, gap_us), _as_delays(off, late_us), lag_us - gap_us, lag_us - late_us)
    return _try_statement(run, machine, LaserDelay, channel, _delay_statement(run, channel, on_us, off_us), how)


def _without_delays(run: TuneRun, machine: Machine, channel: int) -> TuneRun | str:
    """The job without delays of a channel: those that are wrong may leave nothing of its marks."""
    if not any(isinstance(s.statement, LaserDelay) and s.channel == channel for s in run.job.setups):
        return run
    statement = _delay_statement(run, channel, 0, 0)
    tried = _try_statement(run, machine, LaserDelay, channel, statement, SEARCH, judged=False)
    if isinstance(tried, str):
        return tried
    return tried.run if tried.run.trace is not None else run


def _delay_statement(run: TuneRun, channel: int, on_us: int, off_us: int) -> str:
    return f"LASER DELAY ON {on_us}us OFF {off_us}us" + _channel_word(run, channel)


def _as_delays(band: Band, taken_us: float) -> tuple[int, int]:
    """A band as the controller takes it; what the first pulse killer delays need not be delayed again."""
    most = int(SWITCH_DELAY_US.high)
    first, last = (_within(us - round(taken_us), 0, most) for us in (band.first_us, band.last_us))
    return first, last


def _choose_delays(on: tuple[int, int], off: tuple[int, int], on_aim: float, off_aim: float) -> tuple[int, int]:
    """The last on and the first off of their bands; where off would be below on, the delays that make up for the lag,
    as far as the bands go: neither end stands longer under the light than the other. If even those are the wrong way
    round (M 二.2), one for both, near at both ends if that can be, else at the beginning."""
    if on[1] <= off[0]:
        return on[1], off[0]
    on_us, off_us = _within(round(on_aim), *on), _within(round(off_aim), *off)
    if off_us < on_us:
        low, high = max(on[0], off[0]), min(on[1], off[1])
        on_us = off_us = _within(on_us, low, high) if low <= high else on[0]
    return on_us, off_us


def _within(value: int, low: int, high: int) -> int:
    return min(max(value, low), high)


def tune_sky_writing(run: TuneRun, machine: Machine, channel: int, mode: int | None) -> TuneResult | str:
    """SKYWRITE of a job; where there is nothing to tune, the reason. `mode`: None for the job's own, else 3."""
    shining = _emitting_channel(run, channel)
    if isinstance(shining, str):
        return shining
    assert machine.scanner is not None
    if not round(machine.scanner.tracking_error_us):
        scanner = str(machine.scanner)
        return Phrase("the scanner {scanner} has no lag; there is nothing to tune", scanner=scanner)
    if machine.scanner.tracking_error_us > TIMELAG_US.high:
        return Phrase(
            "the lag of scanner {scanner} exceeds the largest TIMELAG, {most} us",
            scanner=str(machine.scanner),
            most=TIMELAG_US.high,
        )
    statements = (s.statement for s in run.job.setups)
    own = next((s.settings for s in statements if isinstance(s, SkyWrite) and s.settings), None)
    mode = mode or (int(own.mode) if own is not None else 3)
    lag_us, gap_us = round(machine.scanner.tracking_error_us), _first_pulse_killer_us(shining)[0]
    npost = math.ceil(lag_us / RUN_STEP_US)
    # LIMIT says which corners are to be sharp: that is the user's.
    limit = f" LIMIT {own.limit!r}" if own is not None and own.limit_given and (mode == 3 or mode == own.mode) else ""
    if machine.scanner.model is ScannerModel.DELAY:
        nprev = int(auto_steps("NPREV", lag_us))
        statement = _sky_statement(mode, lag_us, -gap_us, nprev, npost) + limit
        return _check_in_effect(_try_statement(run, machine, SkyWrite, channel, statement, CLOSED_FORM))
    best, least_mm = "", math.inf
    for share in _RUN_INS:
        nprev = math.ceil(share * lag_us / RUN_STEP_US)
        statement = _sky_statement(mode, lag_us, -gap_us, nprev, npost) + limit
        tuned = _check_in_effect(_try_statement(run, machine, SkyWrite, channel, statement, SEARCH, judged=False))
        if best and (isinstance(tuned, str) or tuned.run.trace is None):  # A longer run-in finds no room.
            break
        if isinstance(tuned, str) or tuned.run.trace is None:
            return tuned
        shining = _emitting_channel(tuned.run, channel)
        # At speed no two moments are as near as each other.
        found = None
        if not isinstance(shining, str):
            # Later the beam may come by once more, on its way back.
            found = nearest_delays(
                tuned.run.trace, machine, shining, slack_pulse=0, most_us=min(2 * lag_us, TIMELAG_US.high)
            )
        if found is None:
            return Phrase("with {statement} channel {channel} has no mark", channel=channel, statement=tuned.statement)
        on, off = found
        if least_mm - on.miss_mm < _WORTH_PULSE / min(machine.pulses_per_mm):
            break
        least_mm, lag = on.miss_mm, off.first_us
        best = _sky_statement(mode, lag, on.last_us - lag - gap_us, nprev, npost) + limit
    return _try_statement(run, machine, SkyWrite, channel, best, SEARCH)


def _sky_statement(mode: int, timelag_us: float, shift_us: float, nprev: int, npost: int) -> str:
    shift = f" SHIFT {shift_us:g}us" if shift_us else ""
    return f"SKYWRITE MODE {mode} TIMELAG {timelag_us:g}us{shift} NPREV {nprev} NPOST {npost}"


def _check_in_effect(tuned: TuneResult | str) -> TuneResult | str:
    """A job with SKYWRITE, if marks are sky-written with it."""
    if isinstance(tuned, str) or tuned.run.trace is None or tuned.run.trace.run_kind is not None:
        return tuned
    return Phrase(
        "a SKYWRITE OFF before the first mark cancels a SKYWRITE after LASER MODE; write it after that by hand"
    )


def _try_statement(
    run: TuneRun,
    machine: Machine,
    kind: type[LaserDelay | SkyWrite],
    channel: int,
    statement: str,
    how: str,
    *,
    judged: bool = True,
) -> TuneResult | str:
    source = with_statement(run.source, run.job, kind, channel, statement)
    if isinstance(source, str):
        return source
    return TuneResult(statement=statement, how=how, run=run_text(source, machine, judged=judged))


def _emitting_channel(run: TuneRun, channel: int) -> ChannelTrace | str:
    """The channel's trace, if it ever shines."""
    channels = run.trace.channels if run.trace is not None else ()
    found = next((c for c in channels if c.channel == channel and len(c.emission.stage)), None)
    return found or Phrase("channel {channel} has no mark in this job", channel=channel)


def _first_pulse_killer_us(shining: ChannelTrace) -> tuple[float, float]:
    """Gap and off delay of the first pulse killer, where the channel shines first."""
    times = shining.lasers[int(shining.emission.stage[0])].fpk_us
    return (times[1], times[2]) if times else (0.0, 0.0)


def _channel_word(run: TuneRun, channel: int) -> str:
    """Said where more than one channel is spoken of, or it is not the default one."""
    others = any(s.channel != channel for s in run.job.setups) or bool((run.job.path.channel != channel).any())
    return f" CHANNEL {channel}" if channel or others or b"CHANNEL" in run.source.data.upper() else ""
