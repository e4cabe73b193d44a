"""`gusjob watch`: the report, updated whenever the job is saved."""

from __future__ import annotations

import sys
import time
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gusjob.cli.color import use_color
from gusjob.cli.common import machine_option, need, scanner_option, show, stop
from gusjob.cli.define import define_option
from gusjob.cli.language import Command
from gusjob.cli.quiet import is_quiet, quiet_option
from gusjob.cli.standard_input import file_path
from gusjob.cli.text_report import table_option, text_of
from gusjob.config.profile import find_profile
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase, localized, printable, reason_of
from gusjob.inputs import exists
from gusjob.pipeline import FileResult, Simulated, simulate_file

if TYPE_CHECKING:
    from gusjob.cli.serve import PageServer
    from gusjob.config.machine import Scanner
    from gusjob.ir.overrides import Overrides

_LOOK_S = 0.25
"""Interval of polling. Polling works everywhere, on network drives too, and is fast enough for people."""

_PATIENCE_S = 2.0
"""Interval of reports of a file that changes all the time."""

Stamp = dict[Path, tuple[int, int] | None]
"""Modification time of each file, ns, and its size, bytes; None if there is no file."""


@click.command(name="watch", cls=Command)
@click.argument("path", metavar="FILE", type=click.Path(), callback=file_path)
@machine_option
@scanner_option
@table_option
@define_option
@click.option(
    "--page", is_flag=True, help="Also serve the report to browsers on this computer, as a page that updates itself."
)
@click.option(
    "--port",
    type=click.IntRange(0, 2**16 - 1),
    default=0,
    metavar="N",
    help="Port of the page. Default: any free port.",
)
@quiet_option
def command(
    path: Path,
    machine_path: Path | None,
    scanner: Scanner | None,
    overrides: Overrides,
    tables: bool,
    page: bool,
    port: int,
) -> None:
    """Report a job, and report it again whenever the job, its profile or an included file is saved.

    Ctrl+C ends the command.
    """
    if port and not page:
        raise click.UsageError(localized(Phrase("--port needs --page")))
    if not exists(path):
        why = Phrase("no such file")
        stop(f"{path}: {localized(why)}")
    server = _served(port) if page else None
    try:
        needed: set[Path] = set()
        while True:
            seen = _stamp(path, machine_path, needed)  # Later changes cause another report.
            start_ns = time.time_ns()
            result = _report(path, machine_path, scanner, overrides, server, tables=tables)
            missing = _missing_includes(result)
            needed = {*result.inputs, *missing}
            _wait_for_change(path, machine_path, needed, _first_stamps(needed, missing, start_ns) | seen)
    except KeyboardInterrupt:
        click.echo()
    finally:
        if server is not None:
            server.close()


def _served(port: int) -> PageServer:
    """Start a server; exit if that is not possible."""
    need("html", "jinja2", to=Phrase("serve a page"))
    from gusjob.cli.serve import PageServer

    try:
        return PageServer(port)
    except OSError as error:
        why = Phrase(
            "can't listen on port {port}: {why}; choose another one with --port", port=port, why=reason_of(error)
        )
        stop(localized(why))


def _report(
    path: Path,
    machine_path: Path | None,
    scanner: Scanner | None,
    overrides: Overrides,
    server: PageServer | None,
    *,
    tables: bool,
) -> FileResult:
    """Read, check and simulate the job, and show the result."""
    result = simulate_file(path, machine_path, scanner=scanner, overrides=overrides)
    report = None
    if isinstance(result, Simulated):
        from gusjob.report.rows import report_of

        report = report_of(result)
    if server is not None:
        from gusjob.cli.page import html_page

        events = server.new_events()
        server.show(b"".join(html_page(result, report, watched=events)), events)
    if sys.stdout is not None and sys.stdout.isatty():
        click.clear()
    head = [f"{datetime.now():%H:%M:%S}", printable(str(path)), *([server.url] if server else [])]
    click.echo("  ".join([*head, localized(Phrase("Ctrl+C ends"))]))
    if report is not None:
        click.echo(text_of(result, report, tables=tables, color=use_color(sys.stdout)), nl=False)
    show(result, err=False)
    if not result.diagnostics and not is_quiet():
        click.echo(localized(Phrase("no problems")))
    return result


def _missing_includes(result: FileResult) -> set[Path]:
    """Return the included files that could not be read."""
    missing = (diagnostic for diagnostic in result.diagnostics if diagnostic.rule is rules.BAD_INCLUDE)
    return {Path(diagnostic.file).parent / str(diagnostic.fields["file"]) for diagnostic in missing}


def _first_stamps(files: set[Path], missing: set[Path], start_ns: int) -> Stamp:
    """Return the stamps that included files had when they were read: before the report nobody knew of them.

    None, so that the job is reported again, for a file that was missing, and for one that was saved since then.
    """
    stamps = _stamps(files)
    return {
        path: None if path in missing or (stamp is not None and stamp[0] >= start_ns) else stamp
        for path, stamp in stamps.items()
    }


def _stamp(path: Path, machine_path: Path | None, needed: set[Path]) -> Stamp:
    """Return the stamps of all files on which the report depends: job, included files and profile."""
    profile = machine_path or find_profile(path)
    return _stamps({path, *needed} if profile is None else {path, *needed, profile})


def _stamps(files: set[Path]) -> Stamp:
    stamp: Stamp = {}
    for path in files:
        try:
            found = path.stat()
            stamp[path] = found.st_mtime_ns, found.st_size
        except OSError:
            stamp[path] = None
    return stamp


def _wait_for_change(path: Path, machine_path: Path | None, needed: set[Path], seen: Stamp) -> None:
    """Wait until a file has changed and then stayed the same for a moment (or changes all the time)."""
    now, changing = seen, 0
    while True:
        time.sleep(_LOOK_S)
        before, now = now, _stamp(path, machine_path, needed)
        changing = changing + 1 if now != seen else 0
        # An editor may remove a file for a moment before it writes the new one.
        if changing and now[path] is not None and (now == before or changing * _LOOK_S > _PATIENCE_S):
            return
