"""gusjob compile."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gusjob.cli.common import exit_code, file_argument, machine_option, output_option, show, write
from gusjob.cli.language import Command
from gusjob.cli.quiet import quiet_option
from gusjob.controllers.gus import GUS
from gusjob.pipeline import Compiled, compile_file


@click.command(name="compile", cls=Command)
@file_argument
@machine_option
@click.option("--format", "form", type=click.Choice(GUS.formats), default=GUS.formats[0], show_default=True)
@output_option
@quiet_option
def command(path: Path, machine_path: Path | None, form: str, output: Path | None) -> None:
    """Compile a job to GT_ calls.

    gts: one call a line, which gusjob can read again. json: the calls as columns. c: a C program that sends them.
    """
    result = compile_file(path, machine_path)
    show(result, notes=False)
    if isinstance(result, Compiled):
        write(GUS.write(result.stream, form), output, sources=result.inputs)
    sys.exit(exit_code(result))
