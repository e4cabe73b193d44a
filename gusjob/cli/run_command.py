"""gusjob run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gusjob.cli.color import terminal_console, use_color
from gusjob.cli.common import exit_code, machine_option, scanner_option, show, stop, write
from gusjob.cli.completion import complete_files
from gusjob.cli.define import define_option, recorded_overrides
from gusjob.cli.language import Command
from gusjob.cli.quiet import is_quiet, quiet_option
from gusjob.cli.standard_input import (
    STANDARD_INPUT,
    InputFile,
    file_path,
    input_file,
    input_path,
    stdin_filename_option,
)
from gusjob.cli.text_report import table_option, text_of
from gusjob.config.machine import Abi, Scanner
from gusjob.diagnostics.model import has_errors
from gusjob.i18n.phrases import Phrase, all_of, localized
from gusjob.ir.overrides import Overrides
from gusjob.pipeline import Checked, Compiled, FileResult, Origin, Simulated, compile_calls, load, simulate

if TYPE_CHECKING:  # Only a run on hardware needs it.
    from gusjob.hardware.request import RunOptions

_NO_FILE = Phrase("Missing argument 'FILE'.")


@click.command(name="run", cls=Command)
@click.argument("path", metavar="FILE", type=click.Path(), callback=input_path, required=False)
@machine_option
@scanner_option
@table_option
@define_option
@stdin_filename_option
@click.option(
    "--backend",
    type=click.Choice(["sim", "gts"]),
    default="sim",
    show_default=True,
    help="Execute the calls in the built-in simulator, or on a controller through the vendor's library.",
)
@click.option("--library", metavar="PATH", shell_complete=complete_files, help="The vendor's library. [gts]")
@click.option(
    "--abi", type=click.Choice([abi.value for abi in Abi]), help="The library's ABI, as gusjob devices prints it. [gts]"
)
@click.option("--yes", is_flag=True, help="Start without confirmation. [gts]")
@click.option("--frame", is_flag=True, help="Move once around the bounding box of the marks, with the laser off. [gts]")
@click.option("--no-laser", is_flag=True, help="Run the whole motion without any laser call. [gts]")
@click.option(
    "--progress",
    type=click.Choice(["auto", "lines", "json", "none"]),
    default="auto",
    show_default=True,
    help="Show progress as a panel on a terminal and as lines elsewhere, or as JSON lines on standard output. [gts]",
)
@click.option(
    "--journal",
    type=click.Path(),
    callback=file_path,
    help="Write the journal to this file; default: beside the job. [gts]",
)
@click.option(
    "--resume",
    type=click.Path(),
    callback=file_path,
    metavar="JOURNAL",
    help="Continue the run of this journal. [gts]",
)
@click.option(
    "--from-line",
    metavar="[FILE:]N",
    help="Begin at this line of the job, or of a FILE that it includes, with the state that the job has there. [gts]",
)
@quiet_option
def command(
    path: Path | None,
    machine_path: Path | None,
    scanner: Scanner | None,
    tables: bool,
    overrides: Overrides,
    stdin_filename: Path | None,
    backend: str,
    library: str | None,
    abi: str | None,
    yes: bool,
    frame: bool,
    no_laser: bool,
    progress: str,
    journal: Path | None,
    resume: Path | None,
    from_line: str | None,
) -> None:
    """Simulate a job or listing and print what it does, or run it on a controller.

    The report begins with the answer and what stands out; --table adds the tables of all segments and marks.

    A job with errors is not run. With --backend gts it runs on hardware: library and ABI come from the options or the
    machine profile; the command describes the run and starts it when you confirm. Keys: p pauses and continues; q and
    Ctrl+C stop smoothly, pressed a second time at once. However a run ends, the laser is switched off first. All calls
    are recorded in a journal; --resume continues the run of a journal; its -D values are taken from the journal.
    Options marked [gts] are for hardware only.
    """
    if backend == "sim":
        given = {
            "--library": library,
            "--abi": abi,
            "--yes": yes,
            "--frame": frame,
            "--no-laser": no_laser,
            "--journal": journal,
            "--resume": resume,
            "--from-line": from_line,
        }
        if wrong := [name for name, value in given.items() if value not in (None, False)]:
            stop(Phrase("{options}: only with --backend gts", options=all_of(wrong)))
        if path is None:
            raise click.UsageError(localized(_NO_FILE))
        sys.exit(_in_simulator(input_file(path, stdin_filename), machine_path, scanner, overrides, tables=tables))
    if path == STANDARD_INPUT or stdin_filename is not None:
        why = Phrase(
            "standard input can't be run on a controller, since --resume and the journal need the job's file: save it"
        )
        raise click.UsageError(localized(why))
    if frame and no_laser:
        raise click.UsageError(localized(Phrase("--frame runs without laser already: leave out --no-laser.")))
    if frame and (resume is not None or from_line is not None):
        raise click.UsageError(localized(Phrase("--frame can't be combined with --resume or --from-line.")))
    if resume is not None and from_line is not None:
        raise click.UsageError(
            localized(Phrase("--resume and --from-line both set where the run begins: leave out one."))
        )
    from gusjob.cli.hardware import recorded_run
    from gusjob.controllers.journal.lines import path_of
    from gusjob.hardware.request import RunMode, RunOptions

    recorded = recorded_run(resume) if resume is not None else None
    if path is None:
        if recorded is None:
            raise click.UsageError(localized(_NO_FILE))
        path = path_of(recorded.head["job"])
    if recorded is not None:
        overrides = overrides or recorded_overrides(recorded.path, recorded.overrides)
    options = RunOptions(
        library=library or "",
        abi=Abi(abi) if abi else None,
        mode=RunMode.FRAME if frame else RunMode.NO_LASER if no_laser else RunMode.JOB,
        journal=journal,
        resume=recorded,
        from_line=from_line,
    )
    progress = "none" if is_quiet() and progress == "auto" else progress
    sys.exit(_on_controller(path, machine_path, scanner, overrides, options, yes=yes, progress=progress))


def _in_simulator(
    file: InputFile, machine_path: Path | None, scanner: Scanner | None, overrides: Overrides, *, tables: bool
) -> int:
    result = _simulated(file, machine_path, scanner, overrides)
    if isinstance(result, Simulated):
        from gusjob.report.rows import report_of

        report = report_of(result)
        text = text_of(result, report, tables=tables, color=use_color(sys.stdout))
        write([text.encode()], None, for_people=True)
    show(result, notes=not isinstance(result, Simulated))
    return exit_code(result)


def _on_controller(
    path: Path,
    machine_path: Path | None,
    scanner: Scanner | None,
    overrides: Overrides,
    options: RunOptions,
    *,
    yes: bool,
    progress: str,
) -> int:
    result = _simulated(InputFile(path=path), machine_path, scanner, overrides)
    show(result, notes=False)
    if not isinstance(result, Simulated) or has_errors(result.diagnostics):
        why = Phrase("not started: only a job without errors can run on hardware")
        click.echo(f"gusjob: {localized(why)}", err=True)
        return exit_code(result) or 1
    if result.origin is Origin.JOURNAL:
        why = Phrase("this is the journal of a run; continue it with --resume, or run the job")
        stop(f"{path}: {localized(why)}")
    from gusjob.cli.hardware import run_on_controller

    return run_on_controller(result, options, yes=yes, progress=progress)


def _simulated(file: InputFile, machine_path: Path | None, scanner: Scanner | None, overrides: Overrides) -> FileResult:
    """Take a file through the pipeline, as far as errors allow, with a status line for each phase."""
    with _status_line(file.path) as set_status:
        set_status(Phrase("reading and checking"))
        result: FileResult = load(file.path, machine_path, scanner=scanner, data=file.data, overrides=overrides)
        if isinstance(result, Checked):
            set_status(Phrase("planning"))
            result = compile_calls(result)
        if isinstance(result, Compiled):
            set_status(Phrase("simulating {count:,} buffered calls", count=len(result.stream.buffered)))
            result = simulate(result)
    return result


@contextmanager
def _status_line(path: Path) -> Iterator[Callable[[str], None]]:
    """Show a status line on a terminal while the context lasts; nothing elsewhere, and with -q."""
    console = None if is_quiet() else terminal_console()
    if console is None:
        yield lambda _text: None
        return
    from rich.markup import escape

    with console.status("") as status:
        yield lambda text: status.update(f"{escape(path.name)}: {localized(text)}")
