"""The Python interface of gusjob, for programs and notebooks: read a job, list its diagnostics, simulate it.

    import gusjob

    job = gusjob.read("jobs/co2_cut.job")
    for diagnostic in job.diagnostics:
        print(diagnostic.line, diagnostic.code, diagnostic.message)
    run = job.simulate()
    print(run.totals["duration_ms"], run.frame())
    run.plot(by="energy")

Problems of a job are data (`diagnostics`), not exceptions. A job with errors has no calls and no simulation: the
methods for them raise JobError. The diagnostics are those of `gusjob check`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from html import escape
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Scanner, parse_scanner
from gusjob.controllers.control import Control
from gusjob.diagnostics.model import Diagnostic, Severity, has_errors
from gusjob.diagnostics.select import EMPTY_LAYER
from gusjob.frontend.overrides import checked_overrides
from gusjob.i18n.language import set_language
from gusjob.i18n.phrases import Phrase, localized, plural
from gusjob.inputs import open_input
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.pipeline import (
    Checked,
    Compiled,
    FileResult,
    Origin,
    Rejected,
    Simulated,
    compile_calls,
    compile_written,
    examine,
    load,
    run_request,
    selected,
    simulate,
)

if TYPE_CHECKING:
    import polars
    from matplotlib.figure import Figure

    from gusjob.hardware.progress import Progress
    from gusjob.hardware.run import RunPlan
    from gusjob.report.rows import Report

__all__ = [
    "Control",
    "ControllerRun",
    "JobError",
    "JobFile",
    "ReportedDiagnostic",
    "Simulation",
    "read",
    "read_text",
    "run_on",
    "set_language",
]

TableColumns = dict[str, npt.NDArray[Any]]
"""A table: equally long columns by name."""


class JobError(Exception):
    """A job has errors, so it has no calls and no simulation.

    Attributes:
        diagnostics: Everything that was found, a tuple of ReportedDiagnostic.
    """

    def __init__(self, name: str, diagnostics: tuple[ReportedDiagnostic, ...]) -> None:
        errors = [diagnostic for diagnostic in diagnostics if diagnostic.severity == "error"]
        first = Phrase(": {fault}", fault=str(errors[0])) if errors else ""
        count = len(errors)
        found = plural(count, Phrase("{count} error", count=count), Phrase("{count} errors", count=count))
        super().__init__(localized(Phrase("{name} has {errors}{first}", name=name, errors=found, first=first)))
        self.diagnostics = diagnostics
        self._name = name

    def __reduce__(self) -> tuple[type[JobError], tuple[str, tuple[ReportedDiagnostic, ...]]]:
        """Make the error from its arguments when a process passes it to another one."""
        return type(self), (self._name, self.diagnostics)


class ReportedDiagnostic(Struct, frozen=True, kw_only=True):
    """One problem of a job, at its position in the source.

    Attributes:
        path: The file, which may be an included one or the machine profile.
        line: Line, from 1.
        column: Column in characters, from 1.
        severity: "error", "warning" or "note".
        code: The rule's code, such as "GJ402"; `gusjob explain GJ402` describes it.
        message: The text, in English or in the language that `set_language` selected before the diagnostics were read.
        count: Number of loop iterations and routine calls in which it occurs.
    """

    path: str
    line: int
    column: int
    severity: Literal["error", "warning", "note"]
    code: str
    message: str
    count: int = 1

    def __str__(self) -> str:
        severity = Severity(self.severity).localized
        return f"{self.path}:{self.line}:{self.column}: {severity}[{self.code}]: {self.message}"


def read(
    path: str | Path,
    *,
    machine: str | Path | None = None,
    scanner: str | None = None,
    overrides: Mapping[str, str | float] | None = None,
) -> JobFile:
    """Read and check a job, a listing of calls, or the journal of a run.

    Args:
        path: The file: a job (.job), a listing or C program (.gts, .c), or a journal.
        machine: The machine profile; by default gusjob.toml beside the file or above it.
        scanner: Model of the beam's lag, used instead of the profile's, such as "first-order:250us".
        overrides: Values by name, each in place of that of the job's first LET of this name, as -D of the commands: a
            number, or a text that may be the right side of a LET, such as "60%" or "2*pitch". A name that the job does
            not set with LET is an error in `diagnostics` (GJ160).

    Returns:
        The file with its diagnostics. A file with errors is returned, too.

    Raises:
        FileNotFoundError, PermissionError, IsADirectoryError: The file or the profile can't be opened.
        OSError: It is not text, or too large.
        ValueError: `scanner` is not a scanner model, or a name or value of `overrides` is none.
    """
    profile = None if machine is None else Path(machine)
    loaded = load(Path(path), profile, scanner=_scanner(scanner), overrides=_overrides(overrides))
    return JobFile(_readable(loaded, loaded.path, loaded.profile))


def read_text(
    text: str,
    *,
    name: str | Path = "text.job",
    machine: str | Path | None = None,
    scanner: str | None = None,
    overrides: Mapping[str, str | float] | None = None,
) -> JobFile:
    """Read and check a job or listing from a string.

    Args:
        text: The job or listing.
        name: Name of a file, which need not exist. Its extension decides whether the text is a job or a listing. Files
            are included relative to it, and the machine profile is searched for in its folder and above.
        machine: The machine profile; by default gusjob.toml beside `name` or above it.
        scanner: As for `read`.
        overrides: As for `read`.

    Returns:
        The text with its diagnostics.

    Raises:
        OSError: The profile can't be read, or the text contains NUL characters or surrogates.
        ValueError: `scanner` is not a scanner model, or a name or value of `overrides` is none.
    """
    profile = None if machine is None else Path(machine)
    data = text.encode(errors="surrogatepass")
    loaded = load(Path(name), profile, scanner=_scanner(scanner), data=data, overrides=_overrides(overrides))
    return JobFile(_readable(loaded, loaded.profile))


def run_on(
    job: JobFile | str | Path,
    *,
    confirm: bool | Callable[[RunPlan], bool],
    library: str | Path = "",
    abi: str = "",
    mode: Literal["job", "no-laser", "frame"] = "job",
    journal: str | Path | None = None,
    resume: str | Path | None = None,
    from_line: int | str | None = None,
    control: Control | None = None,
    on_progress: Callable[[Progress], None] | None = None,
) -> ControllerRun:
    """Run a job on a controller through the vendor's library, as `gusjob run --backend gts` does.

    However the run ends, the laser is switched off, the motion is stopped, the laser is switched off again, and the
    controller is closed. Call this function in the main thread: only there Ctrl+C and SIGTERM can stop the run.

    Args:
        job: The job, or its file. A file is read with the overrides of the run that is continued.
        confirm: True, or a function that gets the plan of the run and returns True. Without confirmation no laser is
            switched on. To find where a killed run was interrupted, the controller is opened and its motion stopped
            before a function is called.
        library: The vendor's library; by default that of the machine profile.
        abi: Its ABI, "gus", "gts" or "gts-multi"; by default that of the machine profile.
        mode: "job"; "no-laser" for the whole motion without any laser call; "frame" for one pass around the bounding
            box of the marks, without laser.
        journal: The journal's file, which must not exist; by default a name beside the job.
        resume: The journal of a run that is to be continued.
        from_line: Begin at this line: a number, or "FILE:N" for a line of an included file.
        control: Stops or pauses the run from a callback or another thread.
        on_progress: Called with the progress several times a second, in the calling thread. An exception in it stops
            the run and is raised after the shutdown.

    Returns:
        How the run ended. Faults of the hardware are diagnostics in it, not exceptions.

    Raises:
        JobError: The job has errors, also those that only its simulation finds.
        OSError: A file can't be read.
        ValueError: `job` is a journal, the mode or ABI is unknown, or options exclude each other.
    """
    from gusjob.config.machine import Abi
    from gusjob.hardware.outcome import Ending
    from gusjob.hardware.progress import report_to
    from gusjob.hardware.request import Refusal, RunMode, RunOptions, read_recorded_run
    from gusjob.hardware.run import run_on as run_request_on

    recorded = None if resume is None else read_recorded_run(Path(resume))
    options = RunOptions(
        library=str(library),
        abi=Abi(abi) if abi else None,
        mode=RunMode(mode),
        journal=None if journal is None else Path(journal),
        resume=None if isinstance(recorded, Refusal) else recorded,
        from_line=None if from_line is None else str(from_line),
    )
    if isinstance(recorded, Refusal):
        return ControllerRun(ending=Ending.REFUSED.value, reason=recorded.localized)
    if not isinstance(job, JobFile):
        job = read(job, overrides=None if recorded is None else recorded.overrides)
    request = run_request(job._runnable(), options)
    watch = None if on_progress is None else report_to(on_progress)
    outcome = run_request_on(request, confirm=confirm, control=control, watch=watch)
    return ControllerRun(
        ending=outcome.ending.value,
        reason="" if outcome.refusal is None else outcome.refusal.localized,
        diagnostics=tuple(map(_reported, outcome.diagnostics)),
        journal=outcome.journal,
        location=outcome.location,
        elapsed_s=outcome.elapsed_s,
        is_safe=outcome.is_safe,
        state=outcome.state.value,
    )


class ControllerRun(Struct, frozen=True, kw_only=True):
    """How a run on a controller ended.

    Attributes:
        ending: "done": the whole job was run. "nothing-left": the recorded run was already complete.
            "failed": the run was stopped or a fault occurred. "declined": `confirm` did not return True.
            "unconfirmed": `confirm` is neither True nor a function. "refused": the request can't be run. "busy":
            another run uses the controller or continues the journal; `diagnostics` names its process. "invalid": the
            library does not fit, or the calls have errors.
        reason: Why the request was refused or not confirmed, else "".
        diagnostics: Faults and other problems, at lines of the job.
        journal: The journal's file; None if no journal was written.
        location: FILE:N that a failed run reached, "" if it did not begin.
        elapsed_s: Time from the start of the journal to the end of the run, s.
        is_safe: Whether calls confirmed that every laser is off and nothing moves, or no call was made. If not, check
            the machine.
        state: "off": calls confirmed that every laser is off and nothing moves. "untouched": no call was made, but
            perhaps one off call whose effect is not confirmed. "unknown": a laser may be on, or the axes may move.
    """

    ending: str
    reason: str = ""
    diagnostics: tuple[ReportedDiagnostic, ...] = ()
    journal: Path | None = None
    location: str = ""
    elapsed_s: float = 0.0
    is_safe: bool = True
    state: str = "untouched"


class JobFile:
    """A job, listing or journal that was read and checked."""

    def __init__(self, loaded: Checked | Rejected) -> None:
        self._loaded = loaded

    @property
    def path(self) -> Path:
        """The file."""
        return self._loaded.path

    @property
    def overrides(self) -> dict[str, str]:
        """The values that were given in place of those of the job's LETs, as texts by name."""
        return dict(self._loaded.overrides)

    @cached_property
    def _examined(self) -> FileResult:
        examined = examine(self._loaded) if isinstance(self._loaded, Checked) else self._loaded
        return selected(examined, EMPTY_LAYER)

    @property
    def diagnostics(self) -> tuple[ReportedDiagnostic, ...]:
        """Everything that `gusjob check` reports, by position; those of a simulation are in `Simulation`.

        Rules that the profile's [check] leaves out are not among them; their errors still prevent calls and simulation.
        """
        return tuple(map(_reported, self._examined.diagnostics))

    @property
    def faults(self) -> tuple[ReportedDiagnostic, ...]:
        """Former name of `diagnostics`, removed in 0.2."""
        return self.diagnostics

    @property
    def is_clean(self) -> bool:
        """Whether there is no error: `gusjob check` exits with 0."""
        return not has_errors(self._examined.diagnostics)

    @cached_property
    def _compiled(self) -> Checked | Rejected:
        return compile_calls(self._loaded) if isinstance(self._loaded, Checked) else self._loaded

    def calls(self) -> list[str]:
        """List the controller's calls, one a string, as `gusjob compile` prints them.

        Raises:
            JobError: The job has errors.
        """
        from gusjob.controllers.gus.listing import listing

        compiled = self._compiled
        if isinstance(self._loaded, Checked) and self._loaded.is_listing:
            compiled = compile_written(self._loaded)
        if not isinstance(compiled, Compiled):
            raise JobError(str(self.path), tuple(map(_reported, compiled.diagnostics)))
        return "".join(listing(compiled.stream)).splitlines()

    @cached_property
    def _simulated(self) -> Checked | Rejected:
        return simulate(self._compiled) if isinstance(self._compiled, Checked) else self._compiled

    def simulate(self) -> Simulation:
        """Run the calls on the built-in simulator.

        Returns:
            Time, velocity and laser power of every segment.

        Raises:
            JobError: The job has errors. (A listing with calls that the controller would refuse is simulated: these
                calls have no effect.)
        """
        if not isinstance(self._simulated, Simulated):
            raise JobError(str(self.path), tuple(map(_reported, self._simulated.diagnostics)))
        return Simulation(self._simulated)

    def _runnable(self) -> Simulated:
        """The simulation of a job that may be run on hardware."""
        if isinstance(self._loaded, Checked) and self._loaded.origin is Origin.JOURNAL:
            raise ValueError(f"{self.path} is the journal of a run: pass it as resume, with the job")
        if not isinstance(self._simulated, Simulated) or has_errors(self._simulated.diagnostics):
            raise JobError(str(self.path), tuple(map(_reported, self._simulated.diagnostics)))
        return self._simulated

    def __repr__(self) -> str:
        return f"<gusjob.JobFile {self.path}: {_counts(self._examined.diagnostics)}>"

    def _repr_html_(self) -> str:
        """Table of the diagnostics, for notebooks."""
        rows = [(d.path, d.line, d.column, d.severity, d.code, d.message) for d in self.diagnostics]
        return _html_table(repr(self)[1:-1], ("path", "line", "column", "severity", "code", "message"), rows)


class Simulation:
    """What the controller does with a job's calls: time, velocity and laser power of every segment."""

    def __init__(self, simulated: Simulated) -> None:
        self._simulated = simulated

    @cached_property
    def _report(self) -> Report:
        from gusjob.report.rows import report_of

        return report_of(self._simulated, marking=True)

    @property
    def diagnostics(self) -> tuple[ReportedDiagnostic, ...]:
        """Diagnostics of the job and of its simulation, by position."""
        return tuple(map(_reported, self._simulated.diagnostics))

    @property
    def faults(self) -> tuple[ReportedDiagnostic, ...]:
        """Former name of `diagnostics`, removed in 0.2."""
        return self.diagnostics

    @property
    def answer(self) -> str:
        """What `gusjob run` prints: one line about the run, then what stands out, each with its line."""
        from gusjob.report.answer import answer_of
        from gusjob.report.text import report_text

        return report_text(self._report, answer_of(self._report, self._simulated.diagnostics))

    @property
    def totals(self) -> dict[str, Any]:
        """Totals of the whole run, as `totals` of `gusjob report --format json`.

        Returns:
            segments: number of motion and dwell calls; stages: number of stages.
            duration_ms: from the first stage's start to the last one's end.
            mark_mm, jump_mm, run_in_mm, run_out_mm: path length by kind of segment.
            channels: a list with an entry for each channel that the job uses:
                channel: 0 or 1; unit: of its power, "%", "kHz" or "V" (with several modes a channel has several
                entries); emission_ms: time of emission; power_ms: integral of the emitted power, unit * ms;
                power_max: highest emitted power, None without emission; power_max_w: the same in watts, None where
                the profile names no rated power; joules: energy, None likewise; clamped_ms: time for which a limit
                clamped the power; before_motion_power_ms: integral of the power emitted before the first motion, which
                is part of no segment; off_output: the output while the laser is off (standby pulse, pre-voltage);
                lit_at_end: whether the laser is left on.
            marking: a list with the quality of the marks by channel and unit: channel, unit, marks (their number),
                worst (largest magnitude) and typical (median magnitude) of each quality column of `marks()`.
        """
        return self._report.totals

    def segments(self) -> TableColumns:
        """One row for each motion or dwell call, in order, as `segments` of the JSON report.

        Returns:
            Columns of equal length:
                line: source line (a listing's own line); file: where several files are involved; stage: from 1.
                kind: "mark", "jump", "run_in", "run_out" or "dwell".
                x_mm, y_mm: end point; length_mm: path length.
                start_ms: from the first stage's start, stages back to back; duration_ms.
                vel_mean_mm_s, vel_max_mm_s: velocity along the path.
                ch0_emission_ms: time of emission of channel 0; ch0_power_min, ch0_power_mean, ch0_power_max:
                    emitted power in the mode's unit, NaN without emission; ch0_power_ms: its integral, unit * ms;
                    ch0_joules: energy, NaN where the rated power is unknown; ch0_clamped_ms: time for which a limit
                    clamped the power. ch1_... likewise; the columns of a channel that the job never uses are absent.
        """
        words = self._report.words
        return {
            name: np.array(words[name])[column] if name in words else column
            for name, column in self._report.columns.items()
        }

    def marks(self) -> TableColumns:
        """One row for each mark (one emission interval of one channel), channel by channel in time order.

        With a scanner model the figures are those of the beam, else those of the commanded path. Power is in the
        mode's unit.

        Returns:
            Columns of equal length (none if no channel is used):
                line: source line where the mark begins; channel: 0 or 1.
                start_ms: start of the emission; length_mm: length of the beam's path during it.
                on_error_um, off_error_um: distance along the path between the start (end) of the emission and the
                    intended start (end) of the mark; negative is before, positive after.
                on_miss_um, off_miss_um: distance between beam and intended point at these moments.
                outside_power_ms: integral of the power emitted outside the intended mark, unit * ms.
                power_per_mm_mid, power_per_mm_peak: median and highest power integral per length, unit * ms / mm.
                power_per_mm_rms_pct: root mean square of its deviation from the median, %.
                corner_miss_um: largest distance by which the beam passes a corner of the path; NaN without corners.
        """
        return dict(self._report.marks or {})

    def ticks(self) -> TableColumns:
        """The whole run tick by tick; `tick_pieces` gives the same in pieces, for runs that do not fit into memory.

        Returns:
            Columns of equal length:
                time_ms: from the first stage's start, off delays between stages included; stage: from 1.
                segment: row of `segments()`, from 0; line: source line.
                x_mm, y_mm: commanded position; vel_mm_s: velocity along the path.
                beam_x_mm, beam_y_mm: position of the beam, with a scanner model only.
                ch0_power: power of channel 0 held until the next tick, in the mode's unit; ch0_on: 1 where the laser
                    emits at the tick; ch0_emission_us: time of emission until the next tick. ch1_... likewise.
                ch0_unit: unit of the power, only where the mode changes.
        """
        pieces = list(self.tick_pieces())
        return {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]} if pieces else {}

    def tick_pieces(self) -> Iterator[TableColumns]:
        """The run tick by tick in pieces of some thousand ticks, each with the columns of `ticks`."""
        from gusjob.report.rows import own_lines
        from gusjob.simulate.outputs.tick_table import tick_table
        from gusjob.tables.columns import CategoryColumn

        trace = self._simulated.trace
        lines, _ = own_lines(trace.line, self._simulated.files)
        for piece in tick_table(trace, self._simulated.machine, lines):
            yield {n: c.texts if isinstance(c, CategoryColumn) else c for n, c in piece.items()}

    def frame(self) -> polars.DataFrame:
        """The segments as a polars data frame, with the columns of `segments`; `.to_pandas()` makes a pandas one.

        Raises:
            ImportError: polars (the extra "data") is not installed.
        """
        import polars

        return polars.DataFrame(self.segments(), nan_to_null=True)

    def plot(self, by: Literal["power", "energy", "velocity", "order"] = "power", channel: int | None = None) -> Figure:
        """Draw the path as `gusjob plot` does.

        Args:
            by: What the color shows: emitted power, energy per mm, velocity, or the order of the segments.
            channel: Only this channel's emission, 0 or 1; None for all.

        Returns:
            A matplotlib figure.

        Raises:
            ImportError: matplotlib (the extra "plot") is not installed.
            ValueError: `by` is not one of these four, or `channel` is neither 0 nor 1.
        """
        from gusjob.view.plot.picture import ColorBy, figure_of

        if by not in list(ColorBy):
            raise ValueError(f"{by!r} is none of {', '.join(ColorBy)}")
        if channel not in (None, 0, 1):
            raise ValueError(f"{channel!r} is no channel: 0 or 1, or None for all")
        return figure_of(self._simulated.trace, self._simulated.machine, by=ColorBy(by), channel=channel)

    def __repr__(self) -> str:
        totals = self.totals
        channels = "".join(
            f", channel {c['channel']}: {c['emission_ms']:.6g} ms emission"
            + (f" up to {c['power_max']:.4g} {c['unit']}" if c["power_max"] is not None else "")
            for c in totals["channels"]
        )
        return (
            f"<gusjob.Simulation {self._simulated.path}: {totals['segments']} segments, "
            f"{totals['duration_ms']:.6g} ms, {totals['mark_mm']:.6g} mm marked{channels}>"
        )

    def _repr_html_(self) -> str:
        """The headline of the answer and a table of the totals, for notebooks."""
        names = ("segments", "duration_ms", "mark_mm", "jump_mm")
        rows = [(name, f"{self.totals[name]:.6g}") for name in names]
        for channel in self.totals["channels"]:
            prefix = f"channel {channel['channel']}"
            rows += [
                (f"{prefix} {name}", "" if channel[name] is None else f"{channel[name]:.6g}")
                for name in ("emission_ms", "power_ms", "power_max", "joules")
            ]
        from gusjob.report.answer import answer_of

        headline = " · ".join(map(localized, answer_of(self._report, self._simulated.diagnostics).headline))
        return _html_table(f"gusjob.Simulation {self._simulated.path}: {headline}", ("total", "value"), rows)


def _overrides(values: Mapping[str, str | float] | None) -> Overrides:
    if not values:
        return NO_OVERRIDES
    found = checked_overrides((name, _override_text(value)) for name, value in values.items())
    if isinstance(found, Phrase):
        raise ValueError(localized(found))
    return found


def _override_text(value: str | float) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real) or not np.isfinite(value):
        raise ValueError(f"{value!r} is no value of a LET: pass a number, or a text such as '60%'")
    return str(int(value)) if isinstance(value, Integral) else repr(float(value))


def _scanner(text: str | None) -> Scanner | None:
    if text is None:
        return None
    scanner = parse_scanner(text)
    if isinstance(scanner, str):
        raise ValueError(localized(scanner))
    return scanner


def _readable(loaded: Checked | Rejected, *files: Path | None) -> Checked | Rejected:
    """Raise what opening its files raises, where a job or its profile can't be read."""
    if not loaded.is_unreadable:
        return loaded
    for path in files:
        if path is not None:
            with open_input(path):
                pass
    raise OSError("; ".join(str(_reported(diagnostic)) for diagnostic in loaded.diagnostics))


def _reported(diagnostic: Diagnostic) -> ReportedDiagnostic:
    severities: dict[Severity, Literal["error", "warning", "note"]] = {
        Severity.ERROR: "error",
        Severity.WARNING: "warning",
        Severity.NOTE: "note",
    }
    return ReportedDiagnostic(
        path=diagnostic.file,
        line=diagnostic.span.line,
        column=diagnostic.span.column,
        severity=severities[diagnostic.severity],
        code=diagnostic.rule.code,
        message=diagnostic.localized,
        count=diagnostic.count,
    )


def _counts(diagnostics: tuple[Diagnostic, ...]) -> str:
    """'2 errors, 1 warning', or 'clean'."""
    counts = [(severity.value, sum(d.severity is severity for d in diagnostics)) for severity in Severity]
    return ", ".join(f"{count} {name}{'s' if count > 1 else ''}" for name, count in counts if count) or "clean"


def _html_table(caption: str, head: tuple[str, ...], rows: list[tuple[Any, ...]]) -> str:
    cells = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join("<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><caption>{escape(caption)}</caption><tr>{cells}</tr>{body}</table>"
