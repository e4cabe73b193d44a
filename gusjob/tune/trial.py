"""A trial: a job with a statement put into it, compiled and simulated."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from gusjob.config.machine import Machine
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.frontend import Source, read_job
from gusjob.i18n.phrases import Phrase
from gusjob.ir.job import Job
from gusjob.ir.setup import LaserDelay, SkyWrite
from gusjob.lint import check
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.marks import marking_totals, marks_of
from gusjob.tune.edit import with_statement

CLOSED_FORM, SEARCH = Phrase("closed form"), Phrase("search in the simulator")
"""Method by which a statement was found."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TuneRun:
    """A job, checked and simulated. `trace`: None if the job has errors. `marking`: as in a report's totals."""

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


def run_text(source: Source, machine: Machine, *, with_marks: bool = True) -> TuneRun:
    """Read, check and simulate a job's text. `with_marks`: also compute mark quality."""
    job, diagnostics = read_job(source, machine)
    return run_job(source, job, [*diagnostics, *check(job, machine)], machine, with_marks=with_marks)


def run_job(
    source: Source, job: Job, diagnostics: list[Diagnostic], machine: Machine, *, with_marks: bool = True
) -> TuneRun:
    """Simulate a job that was read and checked. `diagnostics`: those of the check."""
    trace, marking = None, list[dict[str, Any]]()
    if not has_errors(diagnostics):
        stream, more = compile_job(job, machine)
        diagnostics = [*diagnostics, *more]
        if not has_errors(more):
            trace, more = simulate_stream(stream, machine)
            if trace is not None and with_marks:
                marking = marking_totals(trace, marks_of(trace, machine))
            elif trace is None:
                diagnostics = [
                    *diagnostics,
                    *(replace(f, span=job.locate(f.span.line, ""), path=source.name) for f in more),
                ]
    return TuneRun(source=source, job=job, trace=trace, diagnostics=diagnostics, marking=marking)


def try_statement(
    run: TuneRun,
    machine: Machine,
    kind: type[LaserDelay | SkyWrite],
    channel: int,
    statement: str,
    how: str,
    *,
    with_marks: bool = True,
) -> TuneResult | str:
    """Put a statement into a job and simulate it; return the reason if the statement can't be put in."""
    source = with_statement(run.source, run.job, kind, channel, statement)
    if isinstance(source, str):
        return source
    return TuneResult(statement=statement, how=how, run=run_text(source, machine, with_marks=with_marks))


def emitting_channel(run: TuneRun, channel: int) -> ChannelTrace | str:
    """Return the channel's trace if it has any emission, else the reason."""
    channels = run.trace.channels if run.trace is not None else ()
    found = next((c for c in channels if c.channel == channel and len(c.emission.stage)), None)
    return found or Phrase("channel {channel} has no mark in this job", channel=channel)


def first_pulse_killer_us(emitter: ChannelTrace) -> tuple[float, float]:
    """Return gap and off delay of the first pulse killer at the channel's first emission."""
    times = emitter.lasers[int(emitter.emission.stage[0])].fpk_us
    return (times[1], times[2]) if times else (0.0, 0.0)
