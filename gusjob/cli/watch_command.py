"""`gusjob watch`: the report, made anew whenever the job is saved."""

from __future__ import annotations

import sys
import time
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gusjob.cli.common import Loaded, file_argument, interpreted, load, machine_option, need, scanner_option, show, stop
from gusjob.diagnostics import printable
from gusjob.profile import find_profile

if TYPE_CHECKING:
    from gusjob.cli.serve import PageServer
    from gusjob.machine import Scanner

_LOOK_S = 0.25
"""Files are looked at so often. Looking works everywhere, on network drives too, and a change is seen as people see."""

Stamp = dict[Path, tuple[int, int] | None]
"""When each file was changed, ns, and its size in bytes; None where there is none."""


@click.command(name="watch")
@file_argument
@machine_option
@scanner_option
@click.option("--summary", is_flag=True, help="Totals only, no segments and marks.")
@click.option("--page", is_flag=True, help="Serve the report as a page to browsers on this computer; it follows too.")
@click.option(
    "--port", type=click.IntRange(0, 2**16 - 1), default=0, help="Port of the page. Default: any that is free.", metavar="N"
)
def command(
    path: Path, machine_path: Path | None, scanner: Scanner | None, summary: bool, page: bool, port: int
) -> None:
    """Report a job, and again whenever it is saved, or its profile or a file that it includes. Ctrl-C ends it."""
    if port and not page:
        raise click.UsageError("--port is for --page")
    if not path.exists():
        stop(f"{path}: no such file")
    server = _served(port) if page else None
    try:
        included: set[Path] = set()
        while True:
            seen = _stamp(path, machine_path, included)  # What is saved from here on is worked on once more.
            loaded = _report(path, machine_path, scanner, server, summary=summary)
            included = {Path(name) for name, _ in loaded.files}
            _wait_for_change(path, machine_path, included, _stamps(included) | seen)
    except KeyboardInterrupt:
        click.echo()
    finally:
        if server is not None:
            server.close()


def _served(port: int) -> PageServer:
    """A server, or an exit that says why there is none."""
    need("html", "jinja2", to="serve a page")
    from gusjob.cli.serve import PageServer

    try:
        return PageServer(port)
    except OSError as error:
        stop(f"can't listen at port {port}: {(error.strerror or 'unknown error').lower()}; name another with --port")


def _report(
    path: Path, machine_path: Path | None, scanner: Scanner | None, server: PageServer | None, *, summary: bool
) -> Loaded:
    """Read, check and run the job as it stands now, and show what comes of it."""
    loaded = load(path, machine_path, scanner=scanner)
    trace = interpreted(loaded)
    report = None
    if trace is not None:
        from gusjob.report.rows import make_report

        report = make_report(trace, loaded.machine, loaded.files)
    if server is not None:
        from gusjob.cli.page import html_page
        from gusjob.cli.serve import EVENTS

        server.show(b"".join(html_page(loaded, trace, report, watched=EVENTS)))
    if sys.stdout is not None and sys.stdout.isatty():
        click.clear()
    click.echo(f"{datetime.now():%H:%M:%S}  {printable(str(path))}{f'  {server.url}' if server else ''}  Ctrl-C ends")
    if report is not None:
        from gusjob.report.table import report_table

        click.echo(report_table(report, summary=summary), nl=False)
    show(loaded, err=False)
    if not loaded.faults:
        click.echo("no faults")
    return loaded


def _stamp(path: Path, machine_path: Path | None, included: set[Path]) -> Stamp:
    """Stamps of what the report hangs on: the job, what it includes, jobs beside it (one may be missing yet), the
    profile."""
    files = {path, *included}
    with suppress(OSError):  # The folder is gone, or on a drive that is not there now.
        files.update(path.parent.glob("*.job"))
    profile = machine_path or find_profile(path)
    return _stamps({*files, profile} if profile is not None else files)


def _stamps(files: set[Path]) -> Stamp:
    stamp: Stamp = {}
    for path in files:
        try:
            found = path.stat()
            stamp[path] = found.st_mtime_ns, found.st_size
        except OSError:
            stamp[path] = None
    return stamp


def _wait_for_change(path: Path, machine_path: Path | None, included: set[Path], seen: Stamp) -> None:
    """Until a file is another than the one that was seen, and has been left alone for a moment."""
    now = seen
    while True:
        time.sleep(_LOOK_S)
        before, now = now, _stamp(path, machine_path, included)
        # An editor may take a file away for a moment before it puts the new one there.
        if now != seen and now == before and now[path] is not None:
            return
