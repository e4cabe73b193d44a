"""Shortcuts for tests: from a text to a job, to calls or to a report."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.frontend import check_text, read_job, read_listing
from gusjob.ir.job import Job
from gusjob.lint import check
from gusjob.pipeline import Checked, Compiled, FileResult, compile_calls
from gusjob.report.rows import Report, make_report

ROOT = Path(__file__).resolve().parents[2]
MACHINE = Machine()

MARK = """LASER MODE DUTY CARRIER 10
VEL 100
ACC 10000
"""
"""The head of a job that can mark."""


def job_of(text: str, machine: Machine = MACHINE) -> Job:
    """Read a job that has no errors."""
    source, _ = check_text(text.encode(), "test.job")
    assert source is not None
    job, diagnostics = read_job(source, machine)
    assert [f.message for f in diagnostics if f.severity is not Severity.NOTE] == []
    return job


def diagnostics_in(text: str, machine: Machine = MACHINE) -> list[tuple[int, str]]:
    """(line, code) of everything that reading, checking and planning find."""
    source, _ = check_text(text.encode(), "test.job")
    assert source is not None
    job, diagnostics = read_job(source, machine)
    return [(f.span.line, f.rule.code) for f in [*diagnostics, *check(job, machine)]]


def stream_of(text: str, machine: Machine = MACHINE) -> Stream:
    """The calls of a job."""
    stream, diagnostics = compile_job(job_of(text, machine), machine)
    assert [f.message for f in diagnostics if f.severity is Severity.ERROR] == []
    return stream


def stream_in(result: FileResult) -> Stream | None:
    """The calls of a file that was checked; None if an error forbids them."""
    compiled = compile_calls(result) if isinstance(result, Checked) else result
    return compiled.stream if isinstance(compiled, Compiled) else None


def calls_of(text: str, machine: Machine = MACHINE) -> list[str]:
    """The listing of a job, line by line."""
    return "".join(listing(stream_of(text, machine))).splitlines()


def path_calls(text: str, machine: Machine = MACHINE) -> list[str]:
    """The motion and dwell calls of a job."""
    return [c for c in calls_of(text, machine) if c.startswith(("GT_LnXY", "GT_Arc", "GT_BufDelay"))]


@dataclass(frozen=True, slots=True)
class Ran:
    """What came out of a run."""

    report: Report
    diagnostics: list[Diagnostic]

    def column(self, name: str) -> list[float]:
        """A column of the report."""
        return [float(v) for v in self.report.columns[name]]

    def codes(self) -> list[str]:
        """Rules that spoke."""
        return [f.rule.code for f in self.diagnostics]


def run_listing(text: str, machine: Machine = MACHINE) -> Ran:
    """Read and interpret calls."""
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    stream, read_diagnostics = read_listing(source)
    ran = run_stream(stream, machine)
    return Ran(ran.report, [*read_diagnostics, *ran.diagnostics])


def run_stream(stream: Stream, machine: Machine = MACHINE) -> Ran:
    """Interpret calls that are not a planner's."""
    trace, diagnostics = simulate_stream(stream, machine, is_listing=True)
    assert trace is not None
    return Ran(make_report(trace, machine), diagnostics)


def find_diagnostics(stream: Stream, machine: Machine = MACHINE) -> list[Diagnostic]:
    """Everything that `check` reports of calls that are not a planner's."""
    return simulate_stream(stream, machine, is_listing=True, coarse=True)[1]


_RECORDED = re.compile(r"(?:\[([0-9.]+)\] )?(.*)")
_READING = re.compile(r"GT_CrdStatus\((\d),(\d+),(\d+),(\d)\)")


def recorded_stream(text: str) -> Stream:
    """Calls as a recorder writes them: [12.5] GT_LnXY(...); AT_REST(1) where the motion has ended."""
    times, lines, readings = dict[int, float](), list[str](), dict[int, tuple[float, ...]]()
    for number, line in enumerate(text.splitlines(), start=1):
        found = _RECORDED.fullmatch(line)
        assert found is not None
        times[number] = float(found[1] or "nan")
        if reading := _READING.fullmatch(found[2]):
            readings[number] = tuple(map(float, reading.groups()))
        lines.append(re.sub(r"AT_REST\((\d)\)", r"GT_CrdStatus(\1,run,segment,0)", found[2]))
        lines[-1] = _READING.sub(r"GT_CrdStatus(\1,run,segment,\4)", lines[-1])
    source, _ = check_text("\n".join(lines).encode(), "test.gts")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert [d.message for d in diagnostics] == []
    calls = (replace(c, time_ms=times[c.line], args=readings.get(c.line, c.args)) for c in stream.calls)
    return replace(stream, calls=tuple(calls))


def run_job(text: str, machine: Machine = MACHINE) -> Ran:
    """Compile and interpret a job."""
    trace, diagnostics = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    return Ran(make_report(trace, machine), diagnostics)
