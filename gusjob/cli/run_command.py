"""gusjob run."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gusjob.cli.common import exit_code, machine_option, scanner_option, show, stop, write
from gusjob.cli.language import Command
from gusjob.config.machine import Abi, Scanner
from gusjob.diagnostics.model import has_errors
from gusjob.i18n.phrases import Phrase, all_of, localized
from gusjob.pipeline import Checked, Compiled, FileResult, Origin, Simulated, compile_calls, load, simulate

if TYPE_CHECKING:  # Only a run on hardware needs it.
    from gusjob.cli.hardware import Wishes

_FILE = click.Path(path_type=Path)
_NO_FILE = Phrase("Missing argument 'FILE'.")


@click.command(name="run", cls=Command)
@click.argument("path", metavar="FILE", type=_FILE, required=False)
@machine_option
@scanner_option
@click.option(
    "--backend",
    type=click.Choice(["sim", "gts"]),
    default="sim",
    show_default=True,
    help="What runs the calls: the built-in interpreter, or a controller through the vendor's library.",
)
@click.option("--library", metavar="PATH", help="The vendor's library. [gts]")
@click.option("--abi", type=click.Choice([abi.value for abi in Abi]), help="Which library it is. [gts]")
@click.option("--yes", is_flag=True, help="Start without a question. [gts]")
@click.option("--frame", is_flag=True, help="Go round the box of the marks once, with the laser off. [gts]")
@click.option("--no-laser", is_flag=True, help="The whole motion without any laser call. [gts]")
@click.option(
    "--progress",
    type=click.Choice(["auto", "lines", "json", "none"]),
    default="auto",
    show_default=True,
    help="How progress is shown: a panel on a terminal, else lines; or JSON lines on standard output. [gts]",
)
@click.option("--journal", type=_FILE, help="Write the journal to this file; default: beside the job. [gts]")
@click.option("--resume", type=_FILE, metavar="JOURNAL", help="Go on where the run of this journal broke. [gts]")
@click.option(
    "--from-line",
    metavar="[FILE:]N",
    help="Begin at this line of the job, or of a FILE that it includes: the state there is rebuilt. [gts]",
)
def command(
    path: Path | None, machine_path: Path | None, scanner: Scanner | None, backend: str, library: str | None,
    abi: str | None, yes: bool, frame: bool, no_laser: bool, progress: str, journal: Path | None,
    resume: Path | None, from_line: str | None,
) -> None:  # fmt: skip
    """Run a job or listing on the built-in interpreter and print its power report, or run it on a controller.

    A job with errors is not run. With --backend gts it runs on hardware: library and ABI come from the options or the
    machine profile; what is going to happen is shown, and asked. Keys: p pauses and goes on, q stops, Ctrl+C stops; a
    second time at once. Whatever ends a run, the light is off first. All calls go into a journal, with which --resume
    goes on. Options marked [gts] are for hardware only.
    """
    if backend == "sim":
        given = {"--library": library, "--abi": abi, "--yes": yes, "--frame": frame, "--no-laser": no_laser,
                 "--journal": journal, "--resume": resume, "--from-line": from_line}  # fmt: skip
        if wrong := [name for name, value in given.items() if value not in (None, False)]:
            stop(localized(Phrase("{options}: only with --backend gts", options=all_of(wrong))))
        if path is None:
            raise click.UsageError(localized(_NO_FILE))
        sys.exit(_on_interpreter(path, machine_path, scanner))
    from gusjob.cli.hardware import Wishes, read_resume

    if frame and no_laser:
        raise click.UsageError(localized(Phrase("--frame is without laser already: leave --no-laser out.")))
    if frame and (resume is not None or from_line is not None):
        raise click.UsageError(localized(Phrase("--frame is a run of its own: leave --resume and --from-line out.")))
    if resume is not None and from_line is not None:
        raise click.UsageError(localized(Phrase("--resume and --from-line both say where to begin.")))
    recorded = read_resume(resume) if resume is not None else None
    if path is None:
        if recorded is None:
            raise click.UsageError(localized(_NO_FILE))
        path = Path(recorded.head["job"])
    wishes = Wishes(
        library=library, abi=abi, yes=yes, frame=frame, no_laser=no_laser, progress=progress, journal=journal,
        resume=recorded, resume_path=resume, from_line=from_line,
    )  # fmt: skip
    sys.exit(_on_controller(path, machine_path, scanner, wishes))


def _on_interpreter(path: Path, machine_path: Path | None, scanner: Scanner | None) -> int:
    result = _simulated(path, machine_path, scanner)
    if isinstance(result, Simulated):
        from gusjob.report.rows import make_report
        from gusjob.report.table import report_table

        report = make_report(result.trace, result.machine, result.files)
        write([report_table(report, summary=False, color=sys.stdout.isatty()).encode()], None, for_people=True)
    show(result, notes=not isinstance(result, Simulated))
    return exit_code(result)


def _on_controller(path: Path, machine_path: Path | None, scanner: Scanner | None, wishes: Wishes) -> int:
    result = _simulated(path, machine_path, scanner)
    show(result, notes=False)
    if not isinstance(result, Simulated) or has_errors(result.diagnostics):
        why = Phrase("not started: a run on hardware wants a job without errors")
        click.echo(f"gusjob: {localized(why)}", err=True)
        return exit_code(result) or 1
    if result.origin is Origin.JOURNAL:
        why = Phrase("this is the journal of a run; go on with it with --resume, or run the job")
        stop(f"{path}: {localized(why)}")
    from gusjob.cli.hardware import run_on_controller

    return run_on_controller(result, wishes)


def _simulated(path: Path, machine_path: Path | None, scanner: Scanner | None) -> FileResult:
    """Take a file through the pipeline, as far as errors allow, with a status line for each phase."""
    with _progress(path) as say:
        say(Phrase("reading and checking"))
        result: FileResult = load(path, machine_path, scanner=scanner)
        if isinstance(result, Checked):
            say(Phrase("planning"))
            result = compile_calls(result)
        if isinstance(result, Compiled):
            say(Phrase("interpreting {count:,} buffered calls", count=len(result.stream.buffered)))
            result = simulate(result)
    return result


class _Say:
    """Tells what is going on; silent where nobody watches."""

    def __call__(self, text: str) -> None: ...


@contextmanager
def _progress(path: Path) -> Iterator[_Say]:
    """A status line on a terminal, while a long job is worked on."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield _Say()
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status("") as status:

        class Shown(_Say):
            def __call__(self, text: str) -> None:
                status.update(f"{escape(path.name)}: {localized(text)}")

        yield Shown()
