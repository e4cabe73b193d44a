"""gusjob run."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from gusjob.cli.common import (
    compiled,
    exit_code,
    file_argument,
    interpreted_faults,
    load,
    machine_option,
    scanner_option,
    show,
    write,
)
from gusjob.machine import Scanner


@click.command(name="run")
@file_argument
@machine_option
@scanner_option
@click.option("--backend", type=click.Choice(["sim"]), default="sim", show_default=True, help="What runs the calls.")
def command(path: Path, machine_path: Path | None, scanner: Scanner | None, backend: str) -> None:
    """Run a job or listing on the built-in interpreter, and print its power report.

    A job with errors is not run.
    """
    with _progress(path) as say:
        say("reading and checking")
        loaded = load(path, machine_path, scanner=scanner)
        say("planning")
        stream, report = compiled(loaded), None
        if stream is not None:
            from gusjob.interpreter import interpret
            from gusjob.report.rows import make_report

            say(f"running {len(stream.buffered):,} buffered calls on {backend}")
            trace, faults = interpret(stream, loaded.machine, foreign=loaded.foreign)
            interpreted_faults(loaded, faults)
            report = None if trace is None else make_report(trace, loaded.machine, loaded.files)
    if report is not None:
        from gusjob.report.table import report_table

        write([report_table(report, summary=False, color=sys.stdout.isatty()).encode()], None)
    show(loaded, notes=report is None)
    sys.exit(exit_code(loaded))


class _Say:
    """Tells what is going on; silent where nobody watches."""

    def __call__(self, text: str) -> None: ...


@contextmanager
def _progress(path: Path) -> Iterator[_Say]:
    """A status line on a terminal, while a long job is worked on."""
    if not sys.stderr.isatty():
        yield _Say()
        return
    from rich.console import Console
    from rich.markup import escape

    with Console(stderr=True).status("") as status:

        class Shown(_Say):
            def __call__(self, text: str) -> None:
                status.update(f"{escape(path.name)}: {text}")

        yield Shown()
