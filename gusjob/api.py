"""gusjob for notebooks and programs: read, check, plan, simulate, look at the result.

    import gusjob

    job = gusjob.read("jobs/co2_cut.job")
    for diagnostic in job.diagnostics:
        print(diagnostic.line, diagnostic.code, diagnostic.message)
    run = job.simulate()
    print(run.totals["duration_ms"], run.frame())
    run.plot(by="energy")

What is wrong with a job is data (`diagnostics`), not an exception: a job with errors has no calls and no run, and
asking for them raises JobError, which names its errors.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Scanner, parse_scanner
from gusjob.diagnostics.model import Diagnostic, Severity, has_errors
from gusjob.i18n.language import set_language
from gusjob.i18n.phrases import Phrase, localized, plural
from gusjob.pipeline import Loaded, compiled, interpreted, load

if TYPE_CHECKING:
    import polars
    from matplotlib.figure import Figure

    from gusjob.controllers.gus.calls import Stream
    from gusjob.report.rows import Report
    from gusjob.simulate import Trace

__all__ = ["Fault", "Job", "JobError", "Run", "read", "set_language"]

Columns = dict[str, npt.NDArray[Any]]


class JobError(Exception):
    """A job has errors, so there is nothing to run. `diagnostics`: all that was found."""

    def __init__(self, name: str, diagnostics: tuple[Fault, ...]) -> None:
        errors = [diagnostic for diagnostic in diagnostics if diagnostic.severity == "error"]
        first = Phrase(": {fault}", diagnostic=str(errors[0])) if errors else ""
        count = len(errors)
        found = plural(count, Phrase("{count} error", count=count), Phrase("{count} errors", count=count))
        super().__init__(localized(Phrase("{name} has {errors}{first}", name=name, errors=found, first=first)))
        self.diagnostics = diagnostics


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """One diagnostic. Lines and columns from 1; `count`: how often it was met in loops and routines.

    `message` is in English, or in the language that gusjob.set_language("zh") has chosen before the diagnostics were
    asked for.
    """

    path: str
    line: int
    column: int
    severity: Literal["error", "warning", "note"]
    code: str
    message: str
    count: int = 1

    def __str__(self) -> str:
        return (
            f"{self.path}:{self.line}:{self.column}: {Severity(self.severity).localized}[{self.code}]: {self.message}"
        )


def read(path: str | Path, *, machine: str | Path | None = None, scanner: str | None = None) -> Job:
    """A job, listing or journal with its machine profile (`machine`: another one than gusjob.toml beside or above it).

    `scanner`: how the beam lags, such as "first-order:250us", in place of the profile's. Raises OSError if the file
    can't be read, ValueError for a scanner that is none.
    """
    lag = _scanner(scanner)
    found = load(Path(path), None if machine is None else Path(machine), scanner=lag)
    if found.unreadable:
        raise OSError("; ".join(str(_fault(diagnostic)) for diagnostic in found.diagnostics))
    return Job(found)


def _scanner(text: str | None) -> Scanner | None:
    if text is None:
        return None
    scanner = parse_scanner(text)
    if isinstance(scanner, str):
        raise ValueError(localized(scanner))
    return scanner


def _fault(diagnostic: Diagnostic) -> Fault:
    severity: dict[Severity, Literal["error", "warning", "note"]] = {
        Severity.ERROR: "error",
        Severity.WARNING: "warning",
        Severity.NOTE: "note",
    }
    return Fault(
        path=diagnostic.file,
        line=diagnostic.span.line,
        column=diagnostic.span.column,
        severity=severity[diagnostic.severity],
        code=diagnostic.rule.code,
        message=diagnostic.localized,
        count=diagnostic.count,
    )


class Job:
    """A file that was read and checked."""

    def __init__(self, loaded: Loaded) -> None:
        self._loaded = loaded

    @property
    def path(self) -> Path:
        """The file."""
        return self._loaded.path

    @property
    def diagnostics(self) -> tuple[Fault, ...]:
        """What was found, by place; planning and simulating may add to it."""
        return tuple(map(_fault, self._loaded.diagnostics))

    @property
    def is_clean(self) -> bool:
        """Whether there is no error."""
        return not has_errors(self._loaded.diagnostics)

    @cached_property
    def _stream(self) -> Stream | None:
        return compiled(self._loaded)

    def calls(self) -> list[str]:
        """The GT_ calls, as gusjob compile prints them. Raises JobError."""
        from gusjob.controllers.gus.listing import listing

        if self._stream is None:
            raise JobError(str(self.path), self.diagnostics)
        return "".join(listing(self._stream)).splitlines()

    @cached_property
    def _trace(self) -> Trace | None:
        return interpreted(self._loaded)

    def simulate(self) -> Run:
        """Run it on the built-in interpreter. Raises JobError."""
        if self._trace is None:
            raise JobError(str(self.path), self.diagnostics)
        return Run(self._loaded, self._trace)


class Run:
    """What the controller would do: every segment's time, speed and laser power."""

    def __init__(self, loaded: Loaded, trace: Trace) -> None:
        self._loaded, self._trace = loaded, trace

    @cached_property
    def _report(self) -> Report:
        from gusjob.report.rows import make_report

        return make_report(self._trace, self._loaded.machine, self._loaded.files, marking=True)

    @property
    def diagnostics(self) -> tuple[Fault, ...]:
        """What was found in the job and in its run."""
        return tuple(map(_fault, self._loaded.diagnostics))

    @property
    def totals(self) -> dict[str, Any]:
        """As `totals` of gusjob report --format json."""
        return self._report.totals

    def segments(self) -> Columns:
        """Columns of the segments, by name, as in the JSON report; words as text."""
        words = self._report.words
        return {
            name: np.array(words[name])[column] if name in words else column
            for name, column in self._report.columns.items()
        }

    def marks(self) -> Columns:
        """How good each mark is, column by column."""
        return dict(self._report.marks or {})

    def frame(self) -> polars.DataFrame:
        """The segments as a data frame (polars; `.to_pandas()` for pandas). Raises ImportError without polars."""
        import polars

        return polars.DataFrame(self.segments(), nan_to_null=True)

    def ticks(self) -> Iterator[Columns]:
        """The run tick by tick, in pieces, as gusjob trace --format csv has it."""
        from gusjob.columns import Words
        from gusjob.report.rows import own_lines
        from gusjob.simulate.outputs.samples import samples

        lines, _ = own_lines(self._trace.line, self._loaded.files)
        for piece in samples(self._trace, self._loaded.machine, lines):
            yield {n: np.array(c.words)[c.codes] if isinstance(c, Words) else c for n, c in piece.items()}

    def plot(self, by: Literal["power", "energy", "velocity", "order"] = "power", channel: int | None = None) -> Figure:
        """The path as a matplotlib figure, as gusjob plot draws it. Raises ImportError without matplotlib."""
        from gusjob.view.plot.picture import ColorBy, figure_of

        if by not in list(ColorBy):
            raise ValueError(f"{by!r} is none of {', '.join(ColorBy)}")
        return figure_of(self._trace, self._loaded.machine, by=ColorBy(by), channel=channel)
