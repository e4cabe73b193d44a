"""The request of a run on hardware, and why it can be refused."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from enum import StrEnum
from pathlib import Path

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.journal.reader import RecordedRun, read_journal
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.i18n.phrases import Phrase, localized, printable, reason_of
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.simulate import Trace


class RunMode(StrEnum):
    """The part of a job that is run."""

    JOB = "job"
    NO_LASER = "no-laser"
    """The whole motion without any laser call."""
    FRAME = "frame"
    """Once round the bounding box of the marks, without laser."""

    @property
    def option(self) -> str:
        """The command line's option for it, '' for the whole job; journals record it."""
        return "" if self is RunMode.JOB else f"--{self.value}"


class RunOptions(Struct, frozen=True, kw_only=True):
    """Options of a run on hardware.

    Attributes:
        library: The vendor's library, a file or a bare name for the system's search; '' for the profile's.
        abi: Its ABI; None for the profile's.
        mode: What of the job is run.
        journal: The journal's file, which must not exist; None for a name beside the job.
        resume: The recorded run that is to be continued.
        from_line: Begin at this line: "N" in the job's own file, "FILE:N" in one that it includes.

    Raises:
        ValueError: Options that exclude each other.
    """

    library: str = ""
    abi: Abi | None = None
    mode: RunMode = RunMode.JOB
    journal: Path | None = None
    resume: RecordedRun | None = None
    from_line: str | None = None

    def __post_init__(self) -> None:
        if self.resume is not None and self.from_line is not None:
            raise ValueError("resume and from_line both say where to begin")
        if self.mode is RunMode.FRAME and (self.resume is not None or self.from_line is not None):
            raise ValueError("a frame is a run of its own: it takes neither resume nor from_line")


def _same_line(line: int) -> Span:
    return Span(line=line)


class RunRequest(Struct, frozen=True, kw_only=True):
    """A job to run on a controller.

    Attributes:
        path: The job's file: it names the job, and the journal is written beside it.
        stream: The job's calls.
        trace: Their simulation.
        machine: The machine profile.
        options: The options of the run.
        overrides: The values of LETs that the job was compiled with.
        locate: Converts a line of the calls to a span in the job or in a file that it includes.
        report: Converts diagnostics of a simulation to those that are reported, as the pipeline does for the job.
    """

    path: Path
    stream: Stream
    trace: Trace
    machine: Machine
    options: RunOptions = field(default_factory=RunOptions)
    overrides: Overrides = field(default_factory=lambda: NO_OVERRIDES)
    locate: Callable[[int], Span] = _same_line
    report: Callable[[list[Diagnostic]], Iterable[Diagnostic]] = list

    def located(self, diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
        """Convert diagnostics of a run, which have lines of the calls, to the job's spans."""
        return tuple(replace(d, span=self.locate(d.span.line), path=str(self.path)) for d in diagnostics)

    def location(self, line: int) -> str:
        """Return FILE:N for a line of the calls, safe for a terminal."""
        span = self.locate(line)
        return printable(f"{span.path or self.path.name}:{span.line}")

    def location_of_row(self, row: int) -> str:
        """Return FILE:N for a row of the stream, '' if the stream is empty."""
        lines = self.stream.buffered.line
        return self.location(int(lines[min(row, len(lines) - 1)])) if len(lines) else ""


class Refusal(Struct, frozen=True, kw_only=True):
    """Why a request can't be run. `reason`: a phrase; `subject`: the option or file that it is about, or ''."""

    reason: str
    subject: str = ""

    @property
    def localized(self) -> str:
        """The reason in the user's language, with its subject."""
        text = localized(self.reason)
        return f"{self.subject}: {text}" if self.subject else text


def read_recorded_run(path: Path) -> RecordedRun | Refusal:
    """Read the journal of a run that is to be continued."""
    try:
        found = read_journal(path)
    except OSError as error:
        reason = Phrase("can't read the journal: {reason}", reason=reason_of(error))
        return Refusal(reason=reason, subject=str(path))
    return Refusal(reason=found) if isinstance(found, str) else found
