"""gusjob compile."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gusjob.cli.common import exit_code, file_argument, machine_option, output_option, show, write
from gusjob.cli.define import define_option
from gusjob.cli.endings import output_format
from gusjob.cli.language import Command
from gusjob.cli.quiet import quiet_option
from gusjob.cli.standard_input import input_file, stdin_filename_option
from gusjob.controllers.gus import GUS
from gusjob.ir.overrides import Overrides
from gusjob.pipeline import Compiled, compile_file

_ENDINGS = {f".{form}": form for form in GUS.formats}


@click.command(name="compile", cls=Command)
@file_argument
@machine_option
@define_option
@stdin_filename_option
@click.option(
    "--format", "form", type=click.Choice(GUS.formats), help="Default: by the output file's extension, else gts."
)
@output_option
@quiet_option
def command(
    path: Path,
    machine_path: Path | None,
    overrides: Overrides,
    stdin_filename: Path | None,
    form: str | None,
    output: Path | None,
) -> None:
    """Compile a job to GT_ calls.

    gts: one call a line, which gusjob can read again. json: the calls as columns. c: a C program that sends them. A job
    with errors is not compiled: its JSON has no calls, only the diagnostics; the other formats are not written.
    """
    from gusjob.frontend.source import shown_name

    form = output_format(form, output, _ENDINGS)
    file = input_file(path, stdin_filename)
    result = compile_file(file.path, machine_path, data=file.data, overrides=overrides)
    show(result, notes=False)
    stream = result.stream if isinstance(result, Compiled) else None
    if stream is not None or form in GUS.formats_with_diagnostics:
        name = shown_name(result.path)
        pieces = GUS.write(stream, form, result.overrides, name=name, diagnostics=result.diagnostics)
        write(pieces, output, sources=result.inputs)
    sys.exit(exit_code(result))
