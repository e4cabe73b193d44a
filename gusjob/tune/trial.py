"""A trial: a job with a statement put into it, compiled and simulated."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.frontend import Source, read_job
from gusjob.i18n.phrases import Phrase
from gusjob.ir.job import Job
from gusjob.ir.setup import LaserDelay, SkyWrite
from gusjob.kinematics.arrays import running_sum
from gusjob.lint import check
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.marks import marking_totals, marks_of
from gusjob.tune.edit import with_statement

CLOSED_FORM, SEARCH = Phrase("closed form"), Phrase("search in the simulator")
"""Method by which a statement was found."""


class EndMeasure(Struct, frozen=True, kw_only=True):
    """Ends of the marks of a channel that calls switch.

    `rms_um`: distance of the beam from the intended start when the emission starts, and from the intended end when it
    ends: RMS over all starts and ends. `emission_ms`: emission of these marks. `duration_ms`: of the run.
    """

    marks: int
    rms_um: float
    emission_ms: float
    duration_ms: float


NO_ENDS = EndMeasure(marks=0, rms_um=0.0, emission_ms=0.0, duration_ms=0.0)
"""Of a channel without marks."""


class TuneRun(Struct, frozen=True, kw_only=True):
    """A job, checked and simulated.

    `trace`: None if the job has errors. `marking`: as in a report's totals. `ends`: by channel.
    """

    source: Source
    job: Job
    trace: Trace | None
    diagnostics: list[Diagnostic]
    marking: list[dict[str, Any]]
    ends: dict[int, EndMeasure] = field(default_factory=dict)


class TuneResult(Struct, frozen=True, kw_only=True):
    """A statement, how it was found and in which range, and the job with it."""

    statement: str
    how: str
    searched: str
    run: TuneRun


def run_text(source: Source, machine: Machine, *, with_marks: bool = True) -> TuneRun:
    """Read, check and simulate a job's text. `with_marks`: also compute mark quality."""
    job, diagnostics = read_job(source, machine)
    return run_job(source, job, [*diagnostics, *check(job, machine)], machine, with_marks=with_marks)


def run_job(
    source: Source, job: Job, diagnostics: list[Diagnostic], machine: Machine, *, with_marks: bool = True
) -> TuneRun:
    """Simulate a job that was read and checked. `diagnostics`: those of the check."""
    trace, marking, ends = None, list[dict[str, Any]](), dict[int, EndMeasure]()
    if not has_errors(diagnostics):
        stream, more = compile_job(job, machine)
        diagnostics = [*diagnostics, *more]
        if not has_errors(more):
            trace, more = simulate_stream(stream, machine)
            if trace is not None and with_marks:
                marks = marks_of(trace, machine)
                marking, ends = marking_totals(trace, marks), _ends(trace, marks)
            elif trace is None:
                diagnostics = [
                    *diagnostics,
                    *(replace(f, span=job.locate(f.span.line, ""), path=source.name) for f in more),
                ]
    return TuneRun(source=source, job=job, trace=trace, diagnostics=diagnostics, marking=marking, ends=ends)


def _ends(trace: Trace, marks: dict[str, npt.NDArray[Any]]) -> dict[int, EndMeasure]:
    """Measure the ends of the marks of each channel; `marks`: the result of marks_of."""
    found, done = dict[int, EndMeasure](), 0
    run = running_sum(trace.segments.length)
    for channel in trace.channels:
        emission = channel.emission
        rows = slice(done, done + len(emission.stage))
        done = rows.stop
        switched = (emission.on_event >= 0) & (emission.off_event >= 0)
        # A point that only the difference of the delays burns is no mark.
        start, end = (np.append(channel.switch.mark_segment, 0)[e] for e in (emission.on_event, emission.off_event))
        switched &= run[end] > run[start]
        if switched.any():
            misses = np.concatenate([marks[name][rows][switched] for name in ("on_miss_um", "off_miss_um")])
            found[channel.channel] = EndMeasure(
                marks=int(switched.sum()),
                rms_um=float(np.sqrt(np.mean(misses * misses))),
                emission_ms=float((emission.end_ms - emission.start_ms)[switched].sum()),
                duration_ms=float(trace.schedule.times_ms[-1]),
            )
    return found


def try_statement(
    run: TuneRun,
    machine: Machine,
    kind: type[LaserDelay | SkyWrite],
    channel: int,
    statement: str,
    how: str,
    searched: str = "",
    *,
    with_marks: bool = True,
) -> TuneResult | str:
    """Put a statement into a job and simulate it; return the reason if the statement can't be put in."""
    source = with_statement(run.source, run.job, kind, channel, statement)
    if isinstance(source, str):
        return source
    return TuneResult(
        statement=statement, how=how, searched=searched, run=run_text(source, machine, with_marks=with_marks)
    )


def emitting_channel(run: TuneRun, channel: int) -> ChannelTrace | str:
    """Return the channel's trace if it has any emission, else the reason."""
    channels = run.trace.channels if run.trace is not None else ()
    found = next((c for c in channels if c.channel == channel and len(c.emission.stage)), None)
    return found or Phrase("channel {channel} has no mark in this job", channel=channel)


def first_pulse_killer_us(emitter: ChannelTrace) -> tuple[float, float]:
    """Return gap and off delay of the first pulse killer at the channel's first emission."""
    times = emitter.lasers[int(emitter.emission.stage[0])].fpk_us
    return (times[1], times[2]) if times else (0.0, 0.0)
