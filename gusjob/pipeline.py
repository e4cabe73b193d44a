"""Steps from a file to its simulation: Parsed -> Checked -> Compiled -> Simulated.

Each phase takes the result of the one before and returns a new one with more in it; nothing is changed in place. Where
diagnostics forbid the next phase, the same result comes back with these diagnostics added. The commands, the editor
server and the Python interface all take this way.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar, cast

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Budget, Machine, Scanner
from gusjob.config.profile import Profile, find_profile, read_profile
from gusjob.controllers.gus import GUS
from gusjob.controllers.journal import JOURNAL_START
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Rule, Severity, Span, has_errors
from gusjob.diagnostics.select import RuleSelection, SelectionLayer
from gusjob.diagnostics.suppress import NO_SUPPRESSIONS, Suppressions
from gusjob.i18n.phrases import Phrase
from gusjob.ir.overrides import NO_OVERRIDES, Overrides

if TYPE_CHECKING:  # Start-up time is part of the tool: each step imports what it needs, and a help text needs no step.
    from gusjob.controllers.gus.calls import Stream
    from gusjob.frontend import Source
    from gusjob.hardware.request import RunOptions, RunRequest
    from gusjob.ir.job import Job
    from gusjob.simulate import Trace

_P = TypeVar("_P", bound="Parsed")

_OF_JOBS = ("GJ2", "GJ3", "GJ4", "GJ5")
"""Prefixes of the rules that a job is checked by before it runs."""
_OF_JOURNALS = (rules.PULSE_TOO_WIDE, rules.CARRIER_TOO_FAST, rules.OFF_DELAY_BELOW_ON)
"""Those of them that hold for a journal, too: without them its report would show a power that no laser emits.

The machine profile may have changed since, and a journal may be of calls that no job was checked for.
"""
_LARGE_BYTES = 1_000_000
"""From this size of a text on memory matters."""


class Origin(Enum):
    """Kind of file that the calls or statements come from."""

    JOB = "job"
    LISTING = "listing"
    JOURNAL = "journal"


class FileResult(Struct, frozen=True, kw_only=True, eq=False):
    """Result for one file: its machine, the selection of rules, and its diagnostics, by position.

    `profile`: the machine profile that was read, None for the defaults. `sources`: the texts that spans point into, by
    name. `overrides`: values in place of those of a job's LETs.
    """

    path: Path
    machine: Machine = field(default_factory=Machine)
    selection: RuleSelection = field(default_factory=RuleSelection)
    profile: Path | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    sources: Mapping[str, Source] = field(default_factory=lambda: MappingProxyType({}))
    overrides: Overrides = field(default_factory=lambda: NO_OVERRIDES)

    @property
    def is_unreadable(self) -> bool:
        """Whether the file or its profile could not be read at all (exit status 2)."""
        return False

    @property
    def files(self) -> tuple[tuple[str, int], ...]:
        """Name and number of lines of each file that a job consists of, if there are several."""
        return ()

    @property
    def included_paths(self) -> tuple[Path, ...]:
        """The files that INCLUDEs of a job name, whether or not they could be read."""
        return ()

    @property
    def inputs(self) -> list[Path]:
        """Every file that the result depends on."""
        return [self.path, *self.included_paths, *([self.profile] if self.profile else [])]

    def text_of(self, span: Span, path: str) -> str:
        """The source line of a span in this file, in its profile, or in a file that it includes."""
        source = self.sources.get(path)
        return source.line(span.line) if source is not None else ""


class Rejected(FileResult, frozen=True, kw_only=True, eq=False):
    """A file that was not parsed: it, or its profile, can't be read, or the profile has errors."""

    unreadable: bool = False

    @property
    def is_unreadable(self) -> bool:
        """Whether the file or its profile could not be read at all (exit status 2)."""
        return self.unreadable


class Parsed(FileResult, frozen=True, kw_only=True, eq=False):
    """A file that was read: a job's statements, or the calls of a listing or journal."""

    source: Source
    content: Job | Stream
    origin: Origin
    suppressions: Suppressions = NO_SUPPRESSIONS

    @property
    def job(self) -> Job | None:
        """The job, None for a listing or journal."""
        return None if self.is_listing else cast("Job", self.content)

    @property
    def listing_calls(self) -> Stream | None:
        """The calls of a listing or journal, None for a job."""
        return cast("Stream", self.content) if self.is_listing else None

    @property
    def is_listing(self) -> bool:
        """Whether the calls come from a listing or journal, not from our planner."""
        return self.origin is not Origin.JOB

    @property
    def files(self) -> tuple[tuple[str, int], ...]:
        """Name and number of lines of each file that a job consists of, if there are several."""
        return () if self.job is None else self.job.files

    @property
    def included_paths(self) -> tuple[Path, ...]:
        """The files that INCLUDEs of a job name, whether or not they could be read."""
        return () if self.job is None else self.job.included_paths

    def text_of(self, span: Span, path: str) -> str:
        """The source line of a span in this file, in its profile, or in a file that it includes."""
        if span.path and self.job is not None:
            return self.job.text_of(span)
        return FileResult.text_of(self, span, path)


class Checked(Parsed, frozen=True, kw_only=True, eq=False):
    """A parsed file after the lint rules of a job."""


class Compiled(Checked, frozen=True, kw_only=True, eq=False):
    """A checked file without errors, and its calls, in place of the path of its job."""

    stream: Stream


class Simulated(Compiled, frozen=True, kw_only=True, eq=False):
    """A compiled file and the trace of its run."""

    trace: Trace


def load(
    path: Path,
    profile_path: Path | None = None,
    *,
    scanner: Scanner | None = None,
    data: bytes | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> Checked | Rejected:
    """Parse and check a file. Arguments as for `parse`."""
    parsed = parse(path, profile_path, scanner=scanner, data=data, overrides=overrides)
    return check(parsed) if isinstance(parsed, Parsed) else parsed


def examine_file(
    path: Path, profile_path: Path | None = None, *, data: bytes | None = None, overrides: Overrides = NO_OVERRIDES
) -> Checked | Rejected:
    """Everything that `gusjob check` reports of a file."""
    loaded = load(path, profile_path, data=data, overrides=overrides)
    return examine(loaded) if isinstance(loaded, Checked) else loaded


def compile_file(
    path: Path, profile_path: Path | None = None, *, data: bytes | None = None, overrides: Overrides = NO_OVERRIDES
) -> Compiled | Checked | Rejected:
    """Load a file and compile it if there are no errors, to be written."""
    loaded = load(path, profile_path, data=data, overrides=overrides)
    return compile_written(loaded) if isinstance(loaded, Checked) else loaded


def compile_written(checked: Checked) -> Compiled | Checked:
    """Compile a file to calls that are written; a listing whose numbers C converts would be another one, unseen."""
    if checked.listing_calls is not None and checked.listing_calls.conversions:
        from gusjob.controllers.gus.arguments import conversion_diagnostics

        return with_simulation(checked, conversion_diagnostics(checked.listing_calls))
    return compile_calls(checked)


def simulate_file(
    path: Path,
    profile_path: Path | None = None,
    *,
    scanner: Scanner | None = None,
    data: bytes | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> Simulated | Checked | Rejected:
    """Load a file and simulate it if there are no errors. Arguments as for `parse`."""
    loaded = load(path, profile_path, scanner=scanner, data=data, overrides=overrides)
    if isinstance(loaded, Checked):
        loaded = compile_calls(loaded)  # The path of the job is not kept.
    return simulate(loaded) if isinstance(loaded, Checked) else loaded


def parse(
    path: Path,
    profile_path: Path | None = None,
    *,
    scanner: Scanner | None = None,
    data: bytes | None = None,
    overrides: Overrides = NO_OVERRIDES,
) -> Parsed | Rejected:
    """Read a job, listing or journal with its machine profile.

    Args:
        path: The file.
        profile_path: The machine profile; None for gusjob.toml beside the file or above it.
        scanner: In place of the profile's.
        data: In place of the file's content, for a text that is not on the disk.
        overrides: Values in place of those of the job's LETs, checked by frontend/overrides.py.
    """
    from gusjob.frontend import Source, check_text, read_source
    from gusjob.frontend.source import shown_name

    source, found = read_source(path) if data is None else check_text(data, shown_name(path), path)
    if source is None:
        return Rejected(path=path, diagnostics=tuple(found), unreadable=True)
    is_large = len(source.data) > _LARGE_BYTES
    if is_large:
        from gusjob.kinematics.freed_arrays import reuse_freed_arrays

        reuse_freed_arrays()
    sources = {source.name: source}
    file = profile_path or find_profile(path)
    profile = Profile() if file is None else read_profile(file)
    if file is not None and profile.diagnostics:
        if profile.text is not None:
            name = shown_name(file)
            sources[name] = Source(name=name, data=profile.text.encode())
        return Rejected(
            path=path,
            machine=profile.machine,
            profile=file,
            diagnostics=profile.diagnostics,
            sources=MappingProxyType(sources),
            unreadable=profile.text is None,
        )
    if scanner is not None:
        profile = replace(profile, machine=replace(profile.machine, scanner=scanner))
    parsed = parse_source(source, path=path, profile=profile, overrides=overrides)
    if is_large:
        from gusjob.kinematics.freed_arrays import return_free_memory

        return_free_memory()
    return parsed


def parse_source(
    source: Source, *, path: Path, profile: Profile, overrides: Overrides = NO_OVERRIDES
) -> Parsed | Rejected:
    """Read a text for the machine of a profile."""
    from gusjob.frontend import is_listing, read_job, read_listing

    common: dict[str, Any] = {
        "path": path,
        "machine": profile.machine,
        "selection": profile.selection,
        "profile": profile.source,
        "sources": MappingProxyType({source.name: source}),
        "overrides": overrides,
    }
    if source.data.startswith(JOURNAL_START):
        from gusjob.hardware.journal_stream import journal_stream

        stream, found = journal_stream(source)
        if stream is None:
            return Rejected(**common, diagnostics=tuple(found), unreadable=True)
        found = [*found, *_no_lets(source, overrides, Phrase("a journal"))]
        return Parsed(**common, source=source, content=stream, origin=Origin.JOURNAL, diagnostics=tuple(found))
    suppressions = NO_SUPPRESSIONS.added(source.name, source.data, top=True)
    if is_listing(source):
        calls, found = read_listing(source, profile.machine.controller.abi)
        parsed = Parsed(**common, source=source, content=calls, origin=Origin.LISTING, suppressions=suppressions)
        return _with_diagnostics(parsed, [*found, *_no_lets(source, overrides, Phrase("a listing"))])
    job, found = read_job(source, profile.machine, overrides)
    for name, text in job.included:
        suppressions = suppressions.added(name, text, top=False)
    parsed = Parsed(**common, source=source, content=job, origin=Origin.JOB, suppressions=suppressions)
    return _with_diagnostics(parsed, found)


def _no_lets(source: Source, overrides: Overrides, what: Phrase) -> list[Diagnostic]:
    """Report overrides for a file that has no LETs. `what`: its kind."""
    if not overrides:
        return []
    return [Diagnostic(rule=rules.OVERRIDE_OF_CALLS, span=NOWHERE, fields={"what": what}, path=source.name)]


def check(parsed: Parsed) -> Checked:
    """Apply the lint rules to a job; a listing has none before it is simulated.

    After a line that can't be read the state of what follows is unknown, but most of it can still be checked.
    """
    checked = _next(Checked, parsed)
    job = parsed.job
    if job is None:
        return checked
    from gusjob.lint import check as lint_job

    return _with_diagnostics(checked, lint_job(job, parsed.machine))


def compile_calls(checked: Checked) -> Compiled | Checked:
    """Plan a job and lower it to calls; the same result, with the planner's diagnostics, if there are errors."""
    if isinstance(checked, Compiled) or has_errors(checked.diagnostics):
        return checked
    if checked.job is None:
        return _next(Compiled, checked, stream=checked.content)
    stream, found = GUS.compile(checked.job, checked.machine)
    planned = _with_diagnostics(checked, found)
    if has_errors(planned.diagnostics):
        return planned
    return _next(Compiled, replace(planned, content=checked.job.without_path()), stream=stream)


def simulate(checked: Checked) -> Simulated | Checked:
    """Compile and simulate a file; the same result, with what was found, if it can't be simulated."""
    compiled = compile_calls(checked)
    if not isinstance(compiled, Compiled) or isinstance(compiled, Simulated):
        return compiled
    trace, found = GUS.simulate(compiled.stream, compiled.machine, is_listing=compiled.is_listing)
    if trace is None:
        return with_simulation(compiled, found)
    if compiled.machine.budget != Budget():
        from gusjob.simulate.quality.budget import over_budget

        found = [*found, *over_budget(trace, compiled.machine)]
    return _next(Simulated, with_simulation(compiled, found), trace=trace)


def examine(checked: Checked) -> Checked:
    """Find everything that `gusjob check` reports.

    Beyond reading and lint: what the controller would return for a listing's calls, what only planning a job can tell,
    whether it runs too long to be simulated, what exceeds the profile's budget, and comments that suppress nothing.
    """
    if checked.machine.budget != Budget():
        checked = simulate(checked)
    elif checked.listing_calls is not None:
        _, found = GUS.simulate(checked.listing_calls, checked.machine, is_listing=True, coarse=True)
        checked = with_simulation(checked, found)
    elif isinstance(checked, Compiled):
        checked = checked if isinstance(checked, Simulated) else _simulated_coarsely(checked)
    elif checked.job is not None and not has_errors(checked.diagnostics):
        from gusjob.lint import Need, need

        needed = need(checked.job, checked.machine)
        if needed is Need.SIMULATION:
            checked = _simulated_coarsely(checked)
        elif needed is Need.PLAN:
            checked = compile_calls(checked)
    return _with_diagnostics(checked, _idle_suppressions(checked))


def _simulated_coarsely(checked: Checked) -> Checked:
    """Add what the simulation finds in a job: whether it can be simulated at all, with few samples of its power."""
    compiled = compile_calls(checked)
    if not isinstance(compiled, Compiled):
        return compiled
    _, found = GUS.simulate(compiled.stream, compiled.machine, coarse=True)
    return with_simulation(compiled, found)


def run_request(simulated: Simulated, options: RunOptions) -> RunRequest:
    """Make the request to run a simulated file on a controller (gusjob.hardware.run.run_on)."""
    from gusjob.hardware.request import RunRequest

    job = simulated.job
    without_diagnostics = replace(simulated, diagnostics=())  # Those of the file are known: what comes is of the run.

    def locate(line: int) -> Span:
        return job.locate(line, "") if job is not None else Span(line=line)

    def report(found: list[Diagnostic]) -> Iterable[Diagnostic]:
        return with_simulation(without_diagnostics, found).diagnostics

    return RunRequest(
        path=simulated.path,
        stream=simulated.stream,
        trace=simulated.trace,
        machine=simulated.machine,
        options=options,
        overrides=simulated.overrides,
        locate=locate,
        report=report,
    )


def selected(result: FileResult, chosen: SelectionLayer) -> FileResult:
    """The result with the diagnostics that count by the profile's [check] and by a choice of rules.

    What keeps a file from being parsed always counts.
    """
    if isinstance(result, Rejected):
        return result
    selection = result.selection
    return replace(result, diagnostics=tuple(f for f in result.diagnostics if selection.selects(f, chosen)))


def in_order(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Sort by position: the file's own first, then those of the files that it includes."""
    return tuple(sorted(diagnostics, key=lambda f: (f.span.path, f.span.line, f.span.column)))


def _next(phase: type[_P], result: Parsed, **more: Any) -> _P:
    """A result of a later phase: all of an earlier one, and what is new."""
    known = {name: getattr(result, name) for name in Parsed.__struct_fields__}
    if isinstance(result, Compiled):
        known["stream"] = result.stream
    return phase(**known, **more)


def _with_diagnostics(result: _P, found: Iterable[Diagnostic]) -> _P:
    """Add diagnostics: with the profile's severities, and without those that a comment suppresses."""
    if result.job is not None and result.job.with_override_notes is not None:
        found = map(result.job.with_override_notes, found)
    left, suppressions = result.suppressions.applied(result.selection.with_severities(list(found)))
    # Where the listed ones are suppressed, those that are only counted must not go unseen.
    seen = [f.at_least(_hidden_severity(f, suppressions)) if f.rule is rules.NOT_LISTED else f for f in left]
    return replace(result, diagnostics=in_order([*result.diagnostics, *seen]), suppressions=suppressions)


def _hidden_severity(more: Diagnostic, suppressions: Suppressions) -> Severity:
    """The severity of diagnostics that are only counted, and may be others than those that are suppressed."""
    rule = rules.RULES.get(str(more.fields["code"]))
    return rule.severity if rule and rule.code in suppressions.used_codes() else Severity.NOTE


def with_simulation(checked: _P, found: Iterable[Diagnostic]) -> _P:
    """Add what the simulation found, at its spans in the source."""
    if checked.origin is Origin.JOURNAL:
        # Their lines are the job's, which its own rules were applied to; what ends within a segment was stopped there.
        return _with_diagnostics(checked, [f for f in found if _holds_for_journal(f.rule)])
    job = checked.job
    if job is None:
        from gusjob.frontend import locate_calls

        if has_errors(checked.diagnostics):  # What seems to be missing may be in a line that can't be read.
            from gusjob.lint import RULES_OF_A_COMPLETE_TEXT

            found = [f for f in found if f.rule not in RULES_OF_A_COMPLETE_TEXT]
        return _with_diagnostics(checked, locate_calls(list(found), checked.source))
    # What is reported of a line already is not reported again of the line's calls.
    known = {(f.rule.code, f.file, f.span.line) for f in checked.diagnostics}
    placed = [replace(f, span=job.locate(f.span.line, "")) for f in found]
    return _with_diagnostics(checked, [f for f in placed if (f.rule.code, f.file, f.span.line) not in known])


def _holds_for_journal(rule: Rule) -> bool:
    return rule in _OF_JOURNALS or (rule is not rules.ABRUPT_STOP and not rule.code.startswith(_OF_JOBS))


def _idle_suppressions(checked: Checked) -> list[Diagnostic]:
    """Comments that suppress what can't be suppressed or is not there. After an error not all has been looked for."""
    if checked.origin is Origin.JOURNAL:
        return []
    clean = not has_errors(checked.diagnostics)
    not_listed = {str(f.fields["code"]) for f in checked.diagnostics if f.rule is rules.NOT_LISTED}
    was_run = checked.is_listing or checked.machine.budget != Budget()
    # What depends on an entry of the profile may be right on another machine.
    needs = {"GJ515": checked.machine.host_calls_per_s is not None, "GJ813": checked.machine.scanner is not None}

    def was_looked_for(code: str) -> bool:
        return clean and code not in not_listed and needs.get(code, was_run or not code.startswith("GJ7"))

    found = checked.suppressions.diagnostics(checked.source.name, was_looked_for)
    if not any(f.rule is rules.UNUSED_SUPPRESSION for f in found):
        return found
    from gusjob.frontend.includes import may_be_included

    if may_be_included(checked.path):  # What it suppresses may occur where the file is included.
        return [f for f in found if f.rule is not rules.UNUSED_SUPPRESSION]
    return found
