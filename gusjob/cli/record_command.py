"""gusjob record."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gusjob.cli.common import stop
from gusjob.cli.completion import complete_files
from gusjob.cli.endings import output_format
from gusjob.cli.language import Command
from gusjob.cli.quiet import is_quiet, quiet_option, summarize
from gusjob.cli.standard_input import file_path
from gusjob.config.machine import Abi
from gusjob.i18n.phrases import Phrase, all_of, localized, plural, printable

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from gusjob.record.build import Target
    from gusjob.record.recording import Fault, Recording, RecordOptions

_HOW_TO_USE = (
    Phrase("Windows: put the stand-in beside the program, and move the vendor's library to another folder."),
    Phrase("Linux: put its folder into LD_LIBRARY_PATH. macOS: into DYLD_LIBRARY_PATH."),
    Phrase("The stand-in reads these environment variables:"),
)
_VARIABLES = {
    "GUSJOB_RECORD": Phrase("the listing; by default calls.gts in the program's current folder, then calls.2.gts"),
    "GUSJOB_RECORD_TIME": Phrase("fast (default) or real"),
    "GUSJOB_RECORD_FAULTS": Phrase("calls that fail: NAME:N:CODE,NAME:N+:CODE"),
    "GUSJOB_RECORD_DI": Phrase("what GT_GetDi reads; default: {bits}", bits=0),
    "GUSJOB_RECORD_LIMIT": Phrase("longest listing in bytes; default: {bytes}", bytes=1_000_000_000),
}
_MOST_NAMES = 10
_TARGETS = ("x86_64-windows", "x86-windows", "x86_64-linux", "aarch64-linux", "x86_64-macos", "aarch64-macos")


def _faults(_context: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> tuple[Fault, ...]:
    """Parse the faults."""
    if not texts:
        return ()
    from gusjob.record.recording import MOST_FAULTS, Fault, parse_fault

    parsed = [parse_fault(text) for text in texts]
    for fault in parsed:
        if not isinstance(fault, Fault):
            raise click.BadParameter(localized(fault))
    if len(parsed) > MOST_FAULTS:
        raise click.BadParameter(localized(Phrase("at most {most} --fault options are possible", most=MOST_FAULTS)))
    return tuple(fault for fault in parsed if isinstance(fault, Fault))


def _file_names(_context: click.Context, _parameter: click.Parameter, names: tuple[str, ...]) -> tuple[str, ...]:
    """Check file names of libraries."""
    for name in names:
        if Path(name).name != name or name in (".", "..") or "\\" in name or ":" in name:
            raise click.BadParameter(localized(Phrase("{name} is not a file name", name=printable(name))))
    return names


@click.command(name="record", cls=Command, context_settings={"ignore_unknown_options": False})
@click.option(
    "--abi",
    type=click.Choice([abi.value for abi in Abi]),
    help="Build the functions of this library: gus as in the laser manual, gts with one card, gts-multi with the "
    "card's number first. Default: that of gusjob.toml in this folder or above it, else gus.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(),
    callback=file_path,
    default="calls.gts",
    show_default=True,
    help="Write the listing to this file.",
)
@click.option(
    "--time",
    "time",
    type=click.Choice(["fast", "real"]),
    default="fast",
    show_default=True,
    help="Run the clock fast (motion takes no time) or in real time.",
)
@click.option(
    "--fault",
    "faults",
    multiple=True,
    callback=_faults,
    metavar="NAME:N:CODE",
    help="Let the Nth call of this name return a code without effect; N+: all later ones, too. Repeatable.",
)
@click.option(
    "--limit",
    type=click.IntRange(min=1),
    default=1000,
    show_default=True,
    metavar="MB",
    help="End the listing at this size.",
)
@click.option(
    "--library-name",
    "library_names",
    multiple=True,
    callback=_file_names,
    metavar="FILE",
    help="Provide the stand-in under this file name, too. Repeatable.",
)
@click.option(
    "--long",
    "long_bits",
    type=click.Choice(["32", "64"]),
    help="Build the library's long with this number of bits, as the program declares it. 32: programs that declare "
    "int, such as C# and Python with ctypes.c_int. Default: that of C.",
)
@click.option(
    "--di",
    "inputs",
    type=click.IntRange(0, 2**31 - 1),
    default=0,
    show_default=True,
    metavar="BITS",
    help="Let GT_GetDi read this value.",
)
@click.option(
    "--build-library",
    "folder",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Run nothing: write the library into this folder, to use it elsewhere.",
)
@click.option(
    "--target",
    type=click.Choice(_TARGETS),
    metavar="SYSTEM",
    help=f"Build for this system: {', '.join(_TARGETS)}. Default: this one.",
)
@click.argument(
    "program", nargs=-1, type=click.UNPROCESSED, shell_complete=complete_files, metavar="-- PROGRAM [ARG]..."
)
@quiet_option
def command(
    abi: str | None,
    output: Path,
    time: str,
    faults: tuple[Fault, ...],
    limit: int,
    library_names: tuple[str, ...],
    long_bits: str | None,
    inputs: int,
    folder: Path | None,
    target: str | None,
    program: tuple[str, ...],
) -> None:
    """Run a program with a virtual controller and record its GT_ calls as a listing.

    The program runs as it is, in any language: the command puts a stand-in for the vendor's library into its library
    path. It needs no hardware. gusjob report, check and the other commands read the listing. The stand-in is built
    with this computer's C compiler, or with the package ziglang. Exit status: 0 if the program ended with 0 and made
    calls, 1 otherwise, 2 if it was not started.
    """
    from gusjob.record.build import BuildError, Target

    output_format(None, output, {".gts": "gts"}, option=False)
    chosen = Target(target) if target is not None else None
    bits = int(long_bits) if long_bits is not None else None
    try:
        if folder is not None:
            if program:
                raise click.UsageError(
                    localized(Phrase("--build-library runs no program: leave out {program}", program=program[0]))
                )
            _build(folder, _abi(abi), chosen, library_names, bits)
            return
        if not program:
            raise click.UsageError(localized(Phrase("there is no program: write it after --")))
        from gusjob.record.recording import RecordOptions

        options = RecordOptions(
            command=program,
            output=output,
            abi=_abi(abi),
            is_real_time=time == "real",
            faults=faults,
            limit_bytes=limit * 1_000_000,
            library_names=library_names,
            long_bits=bits,
            inputs=inputs,
            target=chosen,
        )
        sys.exit(_record(options))
    except BuildError as error:
        stop(error.message)


def _abi(name: str | None) -> Abi:
    """Return the ABI of the option, or of the machine profile."""
    if name is not None:
        return Abi(name)
    from gusjob.config.profile import find_profile, read_profile
    from gusjob.diagnostics.model import Severity
    from gusjob.frontend.source import shown_name

    path = find_profile(Path.cwd() / "x.job")
    if path is None:
        return Abi.GUS
    profile = read_profile(path)
    problem = next((d for d in profile.diagnostics if d.severity is Severity.ERROR), None)
    if problem is not None:
        stop(
            Phrase(
                "{path}: {problem}; the ABI is not known: correct it, or use --abi",
                path=shown_name(path),
                problem=problem.message,
            )
        )
    return profile.machine.controller.abi or Abi.GUS


def _record(options: RecordOptions) -> int:
    """Run the program; return the exit status."""
    from gusjob.record.recording import Recording, record

    shows_progress = sys.stderr is not None and sys.stderr.isatty() and not is_quiet()
    recording = record(options, _show_progress if shows_progress else None, _say_build)
    if not isinstance(recording, Recording):
        stop(recording)
    if shows_progress:
        click.echo("\r\x1b[K", err=True, nl=False)
    for line in _summary(recording):
        summarize(f"gusjob: {printable(localized(line))}")
    for line in _problems(options, recording):
        click.echo(f"gusjob: {printable(localized(line))}", err=True)
    return 0 if recording.exit_code == 0 and recording.listings and not recording.is_cut else 1


def _say_build() -> None:
    """Say why the first time takes longer."""
    text = Phrase("building the stand-in; the first time may take a minute")
    summarize(f"gusjob: {localized(text)}")


def _show_progress(lines: int) -> None:
    """Show the number of calls on one line of the terminal."""
    click.echo("\r\x1b[K" + localized(Phrase("recorded: {count} lines", count=lines)), err=True, nl=False)


def _summary(recording: Recording) -> list[Phrase]:
    """Say what was recorded."""
    lines: list[Phrase] = []
    if recording.listings:
        files = _some(recording.listings)
        lines.append(
            plural(
                recording.calls,
                Phrase("{count} line recorded in {files}", count=recording.calls, files=files),
                Phrase("{count} lines recorded in {files}", count=recording.calls, files=files),
            )
        )
    if recording.replaced:
        files = _some(recording.replaced)
        lines.append(Phrase("an earlier recording was replaced: {files}", files=files))
    return lines


def _problems(options: RecordOptions, recording: Recording) -> list[Phrase]:
    """Say what is wrong with the recording, and what to do."""
    from gusjob.record.silence import reason_of_silence

    lines: list[Phrase] = []
    if not recording.listings and not recording.is_cut:
        lines.append(
            Phrase(
                "the program made no call of the stand-in: {reason}",
                reason=reason_of_silence(options.command, options.target),
            )
        )
    if recording.has_wide:
        lines.append(
            Phrase(
                "a refused call has a number from 2147483648 on: if the program declares int where the library "
                "has long, as C# and ctypes.c_int do, record it with --long 32"
            )
        )
    if recording.is_cut:
        lines.append(
            Phrase(
                "the listing is not complete: it has reached its limit, the disk is full, or a process of the program "
                "still records"
            )
        )
    if recording.exit_code < 0:
        lines.append(Phrase("the program was ended by signal {number}", number=-recording.exit_code))
    elif recording.exit_code > 0:
        lines.append(Phrase("the program ended with exit code {code}", code=recording.exit_code))
    if recording.missing:
        lines.append(
            Phrase(
                "the stand-in lacks {names}, which the program names: leave these calls out to record it",
                names=all_of(recording.missing[:10]),
            )
        )
    return lines


def _some(paths: tuple[Path, ...]) -> str:
    """Name files, the first ones of many."""
    names = all_of([str(path) for path in paths[:_MOST_NAMES]])
    more = len(paths) - _MOST_NAMES
    return names if more <= 0 else Phrase("{files} and {count} more", files=names, count=more)


def _build(folder: Path, abi: Abi, target: Target | None, names: tuple[str, ...], long_bits: int | None) -> None:
    """Write the library, and print how to use it."""
    from gusjob.record.recording import write_library

    paths = write_library(folder, abi, target, names, _say_build, long_bits)
    if isinstance(paths, Phrase):
        stop(paths)
    for path in paths:
        click.echo(str(path))
    for line in _HOW_TO_USE:
        click.echo(localized(line))
    for name, meaning in _VARIABLES.items():
        click.echo(f"  {name:22}{localized(meaning)}")
