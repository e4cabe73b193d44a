"""gusjob compile."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gusjob.cli.common import exit_code, file_argument, machine_option, output_option, show, write
from gusjob.cli.language import Command
from gusjob.pipeline import Compiled, compile_file


@click.command(name="compile", cls=Command)
@file_argument
@machine_option
@click.option("--format", "form", type=click.Choice(["gts", "json", "c"]), default="gts", show_default=True)
@output_option
def command(path: Path, machine_path: Path | None, form: str, output: Path | None) -> None:
    """Compile a job to GT_ calls.

    gts: one call a line, which gusjob reads again. json: the calls as columns. c: a C program that sends them.
    """
    from gusjob.controllers.gus.listing import listing, listing_json

    result = compile_file(path, machine_path)
    show(result, notes=False)
    if isinstance(result, Compiled):
        if form == "json":
            write(listing_json(result.stream), output, sources=result.inputs)
        else:
            text_of = listing
            if form == "c":
                from gusjob.controllers.gus.c_program import c_program as text_of
            write((text.encode() for text in text_of(result.stream)), output, sources=result.inputs)
    sys.exit(exit_code(result))
