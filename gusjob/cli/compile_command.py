"""gusjob compile."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gusjob.cli.common import compiled, exit_code, file_argument, load, machine_option, output_option, show, write


@click.command(name="compile")
@file_argument
@machine_option
@click.option("--format", "form", type=click.Choice(["gts", "json"]), default="gts", show_default=True)
@output_option
def command(path: Path, machine_path: Path | None, form: str, output: Path | None) -> None:
    """Compile a job to its GT_ calls.

    gts: one call a line, readable by gusjob again. json: the calls as columns.
    """
    from gusjob.listing import listing, listing_json

    loaded = load(path, machine_path)
    stream = compiled(loaded)
    show(loaded, notes=False)
    if stream is not None:
        pieces = (text.encode() for text in listing(stream)) if form == "gts" else listing_json(stream)
        write(pieces, output, source=path)
    sys.exit(exit_code([loaded]))
