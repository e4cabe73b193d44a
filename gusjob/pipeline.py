"""A file with its machine profile: read, judged, compiled, run. What commands, editors and programs share."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gusjob.config.machine import Budget, Machine, Scanner
from gusjob.config.profile import find_profile, read_machine
from gusjob.controllers.journal import JOURNAL_START
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Severity, Span, has_errors
from gusjob.diagnostics.select import SelectionLayer
from gusjob.diagnostics.suppress import Suppressions
from gusjob.frontend import Source, check_text, is_listing, locate_calls, read_job, read_listing, read_source
from gusjob.frontend.files import may_be_a_part
from gusjob.frontend.source import shown_name
from gusjob.ir.job import Job
from gusjob.lint import check as check_job

if TYPE_CHECKING:  # Start-up time is part of the tool: `check` needs neither calls nor planner.
    from gusjob.controllers.gus.calls import Stream
    from gusjob.simulate import Trace


@dataclass(slots=True, kw_only=True)
class Loaded:
    """A file that was read and judged. `unreadable`: it (or its profile) could not be read at all."""

    path: Path
    machine: Machine = field(default_factory=Machine)
    source: Source | None = None
    job: Job | None = None
    stream: Stream | None = None
    diagnostics: list[Diagnostic] = field(default_factory=list)
    unreadable: bool = False
    profile: Path | None = None
    journal: bool = False
    """It is the journal of a run."""
    sources: dict[str, Source] = field(default_factory=dict)
    allowances: Suppressions = field(default_factory=Suppressions)

    @property
    def inputs(self) -> list[Path]:
        """Every file that was read."""
        return [self.path, *(Path(name) for name, _ in self.files), *([self.profile] if self.profile else [])]

    @property
    def foreign(self) -> bool:
        """Whether the calls come from a listing."""
        return self.stream is not None and self.job is None

    @property
    def files(self) -> tuple[tuple[str, int], ...]:
        """The files that a job is made of, if they are more than one."""
        return self.job.files if self.job is not None else ()

    def add(self, diagnostics: list[Diagnostic]) -> None:
        """More diagnostics: with the severities of the profile, and without those that a comment allows."""
        left = self.allowances.without_allowed(self.machine.selection.weighed(diagnostics))
        # Where the listed ones are allowed, those that are not listed must not go unseen.
        seen = [f.at_least(self._hidden(f)) if f.rule is rules.MORE else f for f in left]
        self.diagnostics = in_order([*self.diagnostics, *seen])

    def _hidden(self, more: Diagnostic) -> Severity:
        """How heavy diagnostics are that are counted, and may be others than those that are allowed."""
        rule = rules.RULES.get(str(more.fields["code"]))
        return rule.severity if rule and rule.code in self.allowances.allowed() else Severity.NOTE

    def text_of(self, span: Span, path: str) -> str:
        """The source line of a span in this file, in its profile, or in a file that it includes."""
        if span.path and self.job is not None:
            return self.job.text_of(span)
        source = self.sources.get(path)
        return source.line(span.line) if source is not None else ""


def load(path: Path, machine_path: Path | None, *, scanner: Scanner | None = None, data: bytes | None = None) -> Loaded:
    """Read a job or listing with its machine profile; a job is checked, a listing is read.

    `scanner`: in place of the profile's. `data`: in place of the file's content, for a text that is not on the disk.
    """
    loaded = Loaded(path=path)
    source, diagnostics = read_source(path) if data is None else check_text(data, shown_name(path), path)
    if source is None:
        loaded.diagnostics, loaded.unreadable = diagnostics, True
        return loaded
    loaded.journal = source.data.startswith(JOURNAL_START)
    loaded.source, loaded.sources[source.name] = source, source
    profile = loaded.profile = machine_path or find_profile(path)
    if profile is not None:
        loaded.machine, loaded.diagnostics = read_machine(profile)
        if loaded.diagnostics:
            text, _ = read_source(profile)
            loaded.unreadable = text is None
            if text is not None:
                loaded.sources[text.name] = text
            return loaded
    if scanner is not None:
        loaded.machine = replace(loaded.machine, scanner=scanner)
    if loaded.journal:
        from gusjob.hardware.journal_stream import journal_stream

        loaded.stream, loaded.diagnostics = journal_stream(source)
        loaded.unreadable = loaded.stream is None
        return loaded
    judge(loaded, source)
    return loaded


def judge(loaded: Loaded, source: Source) -> None:
    """Read a job or listing for the loaded machine; a job is checked, too."""
    loaded.allowances.add(source.name, source.data, top=True)
    if is_listing(source):
        loaded.stream, diagnostics = read_listing(source)
        loaded.add(diagnostics)
        return
    loaded.job, diagnostics = read_job(source, loaded.machine)
    for name, data in loaded.job.included:
        loaded.allowances.add(name, data, top=False)
    # After a line that can't be read the state of what follows is unknown, but most of it can still be judged.
    loaded.add([*diagnostics, *check_job(loaded.job, loaded.machine)])


def look_closer(loaded: Loaded) -> None:
    """Add what reading and checking alone do not see: of a listing what the controller would say, of a job what only
    the planner can tell, and what is above the budget."""
    if loaded.machine.budget != Budget():
        interpreted(loaded)
    elif loaded.stream is not None:
        from gusjob.simulate import find_diagnostics

        simulation_diagnostics(loaded, find_diagnostics(loaded.stream, loaded.machine))
    elif loaded.job is not None and (loaded.job.has_forced_ends or loaded.job.sky_writes):
        compiled(loaded)
    loaded.add(_idle_allowances(loaded))


def _idle_allowances(loaded: Loaded) -> list[Diagnostic]:
    """Comments that allow what can't be allowed or is not there. After an error not all has been looked for."""
    if loaded.source is None or loaded.journal:
        return []
    clean = not has_errors(loaded.diagnostics)
    not_listed = {str(diagnostic.fields["code"]) for diagnostic in loaded.diagnostics if diagnostic.rule is rules.MORE}
    ran = loaded.foreign or loaded.machine.budget != Budget()
    # What hangs on an entry of the profile may be right on another machine.
    asks = {"GJ515": loaded.machine.host_calls_per_s is not None, "GJ813": loaded.machine.scanner is not None}

    def judged(code: str) -> bool:
        return clean and code not in not_listed and asks.get(code, ran or not code.startswith("GJ7"))

    found = loaded.allowances.diagnostics(loaded.source.name, judged)
    idle = any(diagnostic.rule is rules.ALLOWS_NOTHING for diagnostic in found)
    if idle and may_be_a_part(loaded.path):  # What it allows may come about where it is included.
        return [diagnostic for diagnostic in found if diagnostic.rule is not rules.ALLOWS_NOTHING]
    return found


def selected(loaded: Loaded, asked: SelectionLayer) -> list[Diagnostic]:
    """The diagnostics that count by the profile's [check] and by what is asked for; what makes a file unreadable
    does."""
    if loaded.unreadable or (loaded.source is not None and loaded.job is None and loaded.stream is None):
        return loaded.diagnostics
    return [diagnostic for diagnostic in loaded.diagnostics if loaded.machine.selection.wants(diagnostic, asked)]


def in_order(diagnostics: list[Diagnostic]) -> list[Diagnostic]:
    """By place: the file's own first, then those of the files that it includes."""
    return sorted(diagnostics, key=lambda f: (f.span.path, f.span.line, f.span.column))


def compiled(loaded: Loaded) -> Stream | None:
    """The calls of a loaded file; None if an error forbids it. Diagnostics that only the planner sees are added."""
    if loaded.stream is not None or loaded.job is None or has_errors(loaded.diagnostics):
        return None if has_errors(loaded.diagnostics) else loaded.stream
    from gusjob.planner import compile_job

    stream, diagnostics = compile_job(loaded.job, loaded.machine)
    loaded.add(diagnostics)
    loaded.stream = None if has_errors(loaded.diagnostics) else stream
    return loaded.stream


def interpreted(loaded: Loaded) -> Trace | None:
    """The run of a loaded file; None if an error forbids it. What the run finds is added to its diagnostics."""
    stream = compiled(loaded)
    if stream is None:
        return None
    from gusjob.simulate import interpret

    trace, diagnostics = interpret(stream, loaded.machine, foreign=loaded.foreign)
    simulation_diagnostics(loaded, [*diagnostics, *budget_diagnostics(loaded, trace)])
    return trace


def budget_diagnostics(loaded: Loaded, trace: Trace | None) -> list[Diagnostic]:
    """What of a run is above the profile's budget."""
    if trace is None or loaded.machine.budget == Budget():
        return []
    from gusjob.simulate.quality.budget import over_budget

    return over_budget(trace, loaded.machine)


def simulation_diagnostics(loaded: Loaded, diagnostics: list[Diagnostic]) -> None:
    """Add what the interpreter found, with spans."""
    if loaded.source is not None:
        if loaded.journal:  # Their lines are the job's; what ends within a segment was stopped there.
            found = [f for f in diagnostics if f.rule is not rules.STOPS_HARD]
        elif loaded.job is None:
            found = locate_calls(diagnostics, loaded.source)
        else:
            # What the check has said of a line already is not said again of the line's calls.
            found = [replace(f, span=loaded.job.locate(f.span.line, "")) for f in diagnostics]
            said = {(f.rule.code, f.file, f.span.line) for f in loaded.diagnostics}
            found = [f for f in found if (f.rule.code, f.file, f.span.line) not in said]
        loaded.add(found)
