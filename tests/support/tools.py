"""Shortcuts for tests: from a text to a job, to calls or to a report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

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
    trace, diagnostics = simulate_stream(stream, machine, is_listing=True)
    assert trace is not None
    return Ran(make_report(trace, machine), [*read_diagnostics, *diagnostics])


def run_job(text: str, machine: Machine = MACHINE) -> Ran:
    """Compile and interpret a job."""
    trace, diagnostics = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    return Ran(make_report(trace, machine), diagnostics)
