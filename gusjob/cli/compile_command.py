"""gusjob compile."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gusjob.cli.common import exit_code, file_argument, machine_option, output_option, show, write
from gusjob.cli.define import define_option
from gusjob.cli.language import Command
from gusjob.controllers.gus import GUS
from gusjob.ir.overrides import Overrides
from gusjob.pipeline import Compiled, compile_file


@click.command(name="compile", cls=Command)
@file_argument
@machine_option
@define_option
@click.option("--format", "form", type=click.Choice(GUS.formats), default=GUS.formats[0], show_default=True)
@output_option
def command(path: Path, machine_path: Path | None, overrides: Overrides, form: str, output: Path | None) -> None:
    """Compile a job to GT_ calls.

    gts: one call a line, which gusjob can read again. json: the calls as columns. c: a C program that sends them.
    """
    result = compile_file(path, machine_path, overrides=overrides)
    show(result, notes=False)
    if isinstance(result, Compiled):
        write(GUS.write(result.stream, form, result.overrides), output, sources=result.inputs)
    sys.exit(exit_code(result))
