"""gusjob check."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import click

from gusjob.cli.common import Loaded, compiled, exit_code, interpreted_faults, load, machine_option, show, write


@click.command(name="check")
@click.argument("paths", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@machine_option
@click.option("--format", "form", type=click.Choice(["text", "json"]), default="text", show_default=True)
@click.option("--strict", is_flag=True, help="Warnings fail too.")
def command(paths: tuple[Path, ...], machine_path: Path | None, form: str, strict: bool) -> None:
    """Check jobs and listings: words, ranges, modes, order, light, motion.

    All faults of all files are listed. Exit status: 0 clean, 1 an error (with --strict also a warning), 2 a file
    that can't be read.
    """
    files = [judged(path, machine_path) for path in paths]
    if form == "json":
        from gusjob.report.files import check_json

        write([check_json(f for one in files for f in one.faults), b"\n"], None)
    else:
        for one in files:
            show(one, err=False)
        counts = Counter(f.severity.value for one in files for f in one.faults)
        said = ", ".join(f"{n} {kind}{'s' if n != 1 else ''}" for kind, n in sorted(counts.items())) or "clean"
        click.echo(f"{len(files)} file{'s' if len(files) != 1 else ''}: {said}", err=True)
    sys.exit(exit_code(files, strict=strict))


def judged(path: Path, machine_path: Path | None) -> Loaded:
    """A file with all its diagnostics: for a listing, what the controller would say too."""
    loaded = load(path, machine_path)
    if loaded.job is not None and loaded.job.has_forced_ends:
        compiled(loaded)
    if loaded.stream is not None:
        from gusjob.interpreter import find_faults

        interpreted_faults(loaded, find_faults(loaded.stream, loaded.machine))
    return loaded
