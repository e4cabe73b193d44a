"""What the commands share: reading a file on its machine, showing diagnostics, writing results."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NoReturn

import click

from gusjob import rules
from gusjob.backend import JOURNAL_START
from gusjob.checks import check as check_job
from gusjob.diagnostics import Diagnostic, Severity, Span, has_errors, printable
from gusjob.job import Job
from gusjob.machine import SCANNER_FORM, Budget, Machine, Scanner, parse_scanner
from gusjob.profile import find_profile, read_machine
from gusjob.syntax import Source, is_listing, locate_calls, read_job, read_listing, read_source

if TYPE_CHECKING:  # Start-up time is part of the tool: `check` needs neither calls nor planner.
    from gusjob.interpreter import Trace
    from gusjob.stream import Stream

machine_option = click.option(
    "--machine",
    "machine_path",
    type=click.Path(path_type=Path),
    help="Machine profile (TOML). Default: gusjob.toml in the job's folder or above it, else the documented defaults.",
)


def _scanner(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Scanner | None:
    """A scanner from the command line."""
    if text is None:
        return None
    scanner = parse_scanner(text)
    if isinstance(scanner, str):
        raise click.BadParameter(scanner)
    return scanner


scanner_option = click.option(
    "--scanner",
    callback=_scanner,
    metavar="MODEL:TIME",
    help="How the mirrors lag behind the command, in place of the profile's scanner: to see where the beam really is "
    f"while the laser is on. {SCANNER_FORM}.",
)
file_argument = click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
output_option = click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Write to this file instead of standard output."
)


@dataclass(slots=True, kw_only=True)
class Loaded:
    """A file that was read and judged. `unreadable`: it (or its profile) could not be read at all."""

    path: Path
    machine: Machine = field(default_factory=Machine)
    source: Source | None = None
    job: Job | None = None
    stream: Stream | None = None
    faults: list[Diagnostic] = field(default_factory=list)
    unreadable: bool = False
    profile: Path | None = None
    journal: bool = False
    """It is the journal of a run."""
    sources: dict[str, Source] = field(default_factory=dict)

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

    def text_of(self, span: Span, path: str) -> str:
        """The source line of a span in this file, in its profile, or in a file that it includes."""
        if span.path and self.job is not None:
            return self.job.text_of(span)
        source = self.sources.get(path)
        return source.line(span.line) if source is not None else ""


def load(path: Path, machine_path: Path | None, *, scanner: Scanner | None = None) -> Loaded:
    """Read a job or listing with its machine profile; a job is checked, a listing is read.

    `scanner`: in place of the profile's.
    """
    loaded = Loaded(path=path)
    source, faults = read_source(path)
    if source is None:
        loaded.faults, loaded.unreadable = faults, True
        return loaded
    loaded.journal = source.data.startswith(JOURNAL_START)
    loaded.source, loaded.sources[source.name] = source, source
    profile = loaded.profile = machine_path or find_profile(path)
    if profile is not None:
        loaded.machine, loaded.faults = read_machine(profile)
        if loaded.faults:
            text, _ = read_source(profile)
            loaded.unreadable = text is None
            if text is not None:
                loaded.sources[text.name] = text
            return loaded
    if scanner is not None:
        loaded.machine = replace(loaded.machine, scanner=scanner)
    if loaded.journal:
        from gusjob.backend.sent import sent_calls

        loaded.stream, loaded.faults = sent_calls(source)
        loaded.unreadable = loaded.stream is None
        return loaded
    if is_listing(source):
        loaded.stream, loaded.faults = read_listing(source)
        return loaded
    loaded.job, loaded.faults = read_job(source, loaded.machine)
    # After a line that can't be read the state of what follows is unknown, but most of it can still be judged.
    loaded.faults = in_order([*loaded.faults, *check_job(loaded.job, loaded.machine)])
    return loaded


def in_order(faults: list[Diagnostic]) -> list[Diagnostic]:
    """By place: the file's own first, then those of the files that it includes."""
    return sorted(faults, key=lambda f: (f.span.path, f.span.line, f.span.column))


def compiled(loaded: Loaded) -> Stream | None:
    """The calls of a loaded file; None if an error forbids it. Faults that only the planner sees are added."""
    if loaded.stream is not None or loaded.job is None or has_errors(loaded.faults):
        return None if has_errors(loaded.faults) else loaded.stream
    from gusjob.planner import compile_job

    stream, faults = compile_job(loaded.job, loaded.machine)
    loaded.faults = in_order([*loaded.faults, *faults])
    return None if has_errors(faults) else stream


def interpreted(loaded: Loaded) -> Trace | None:
    """The run of a loaded file; None if an error forbids it. What the run finds is added to its faults."""
    stream = compiled(loaded)
    if stream is None:
        return None
    from gusjob.interpreter import interpret

    trace, faults = interpret(stream, loaded.machine, foreign=loaded.foreign)
    interpreted_faults(loaded, [*faults, *budget_faults(loaded, trace)])
    return trace


def budget_faults(loaded: Loaded, trace: Trace | None) -> list[Diagnostic]:
    """What of a run is above the profile's budget."""
    if trace is None or loaded.machine.budget == Budget():
        return []
    from gusjob.report.budget import over_budget

    return over_budget(trace, loaded.machine)


def interpreted_faults(loaded: Loaded, faults: list[Diagnostic]) -> None:
    """Add what the interpreter found, with spans."""
    if loaded.source is not None:
        if loaded.journal:  # Their lines are the job's; what ends within a segment was stopped there.
            found = [f for f in faults if f.rule is not rules.STOPS_HARD]
        elif loaded.job is None:
            found = locate_calls(faults, loaded.source)
        else:
            # What the check has said of a line already is not said again of the line's calls.
            found = [replace(f, span=loaded.job.locate(f.span.line, "")) for f in faults]
            said = {(f.rule.code, f.file, f.span.line) for f in loaded.faults}
            found = [f for f in found if (f.rule.code, f.file, f.span.line) not in said]
        loaded.faults = in_order([*loaded.faults, *found])


@dataclass(slots=True, kw_only=True)
class Verdict:
    """What files come to together: 0 clean, 1 an error (or a warning with strict), 2 something could not be read."""

    strict: bool = False
    exit_code: int = 0

    def add(self, loaded: Loaded) -> None:
        """One more file."""
        failed = has_errors(loaded.faults)
        failed |= self.strict and any(f.severity is Severity.WARNING for f in loaded.faults)
        self.exit_code = max(self.exit_code, 2 if loaded.unreadable else int(failed))


def exit_code(loaded: Loaded) -> int:
    """0 clean, 1 an error, 2 it could not be read."""
    verdict = Verdict()
    verdict.add(loaded)
    return verdict.exit_code


def show(loaded: Loaded, *, err: bool = True, notes: bool = True) -> None:
    """Print diagnostics with their source lines."""
    from gusjob.cli.text import diagnostic_text

    stream = sys.stderr if err else sys.stdout
    color = stream is not None and stream.isatty()  # A closed stream is None.
    for fault in loaded.faults:
        if notes or fault.severity is not Severity.NOTE:
            click.echo(diagnostic_text(fault, loaded.text_of, color=color), err=err, color=color)


def write(pieces: Iterable[bytes], output: Path | None, *, sources: Iterable[Path] = ()) -> None:
    """Write bytes to a file or to standard output; exits with 2 if they can't be written.

    A file is there whole or not at all: until it is, an older one stays. `sources` are never written over.
    """
    try:
        if output is None:
            if sys.stdout is not None:
                _write_all(pieces, sys.stdout.buffer)
        elif output.exists() and any(source.exists() and output.samefile(source) for source in sources):
            stop(f"{output}: this is a file that was read; name another one with -o")
        elif output.exists() and not output.is_file():
            with output.open("wb") as file:  # A device or a pipe.
                _write_all(pieces, file)
        else:
            _replace(output.resolve(), pieces)
    except BrokenPipeError:  # Whoever reads has seen enough.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123  (for the interpreter's own flush)
    except OSError as error:
        stop(f"{output or 'standard output'}: can't write: {(error.strerror or 'unknown error').lower()}")


def _replace(output: Path, pieces: Iterable[bytes]) -> None:
    """Write beside a file, then put it in its place."""
    if output.exists():
        output.open("ab").close()  # What may not be written over is not replaced either.
    handle, name = tempfile.mkstemp(prefix=".gusjob-", dir=output.parent)
    beside = Path(name)
    try:
        with open(handle, "wb") as file:  # noqa: PTH123  (a handle has no path)
            _write_all(pieces, file)
        beside.chmod(output.stat().st_mode & 0o7777 if output.exists() else 0o666 & ~_umask())
        beside.replace(output)
    except KeyboardInterrupt:
        stop(f"{output}: interrupted; nothing was written")
    finally:
        beside.unlink(missing_ok=True)


def _umask() -> int:
    """What new files may not have; it can't be asked for without being set."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def need(extra: str, module: str, *, to: str) -> None:
    """See to it that an extra is installed; leaves with 2 and the line that installs it if not."""
    try:
        import_module(module)
    except ImportError:
        stop(f'to {to}, install the extra "{extra}": python -m pip install "gusjob[{extra}]"')


def refuse_terminal(form: str, output: Path | None) -> None:
    """What is not for reading is not poured out over a terminal."""
    if output is None and sys.stdout is not None and sys.stdout.isatty():
        raise click.UsageError(f"{form} is not for a terminal: name a file with -o")


def stop(message: str) -> NoReturn:
    """Say why, and leave with 2."""
    click.echo(f"gusjob: {printable(message)}", err=True)
    sys.exit(2)


def _write_all(pieces: Iterable[bytes], file: BinaryIO) -> None:
    for piece in pieces:
        file.write(piece)
    file.flush()
