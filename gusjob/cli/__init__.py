"""The command line: one module for each command, imported when the command is used."""

from __future__ import annotations

import errno
import gc
import os
import sys
from importlib import import_module
from typing import Any

import click

from gusjob.cli.language import Command, apply_language_option, color_given, own_language_settings
from gusjob.version import __version__

# No command multiplies matrices: numpy's thread pool would only slow down the start.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

_COMMANDS = (
    "check",
    "fmt",
    "explain",
    "compile",
    "run",
    "report",
    "plot",
    "trace",
    "watch",
    "lsp",
    "tune",
    "devices",
    "record",
    "help",
)
_WITHOUT_NUMPY = ("explain", "devices", "record", "help")
_COMPLETE = "_GUSJOB_COMPLETE"
"""The variable with which a shell asks for completions."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a full or broken disk, which may occur wherever a command prints."""


class _CommandGroup(Command, click.Group):
    """Imports a command's module only when that command is used, for a fast start."""

    def main(self, *args: Any, **extra: Any) -> Any:
        with own_language_settings():
            return super().main(*args, **extra)

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        apply_language_option(args)
        extra.setdefault("color", color_given(args))
        return super().make_context(info_name, args, parent, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        command = import_module(f"gusjob.cli.{cmd_name}_command").command
        assert isinstance(command, click.Command)
        return command


@click.group(
    cls=_CommandGroup,
    invoke_without_command=True,
    subcommand_metavar="COMMAND [ARGS]...",
    context_settings={"help_option_names": ["-h", "--help"]},
)
@click.version_option(__version__, "-V", "--version", prog_name="gusjob")
@click.pass_context
def cli(context: click.Context) -> None:
    """Compile, lint and run laser jobs for Googol GUS galvo controllers.

    FILE is a job (.job), or the GT_ calls of a listing or C program (.gts, .c); - is standard input. Exit status: 0
    clean, 1 errors, or changes found by report --against, 2 wrong usage or a file that can't be read.
    """
    if context.invoked_subcommand is None:  # Wrong usage: a script that lost its words must not pass.
        click.echo(context.get_help(), err=True)
        context.exit(2)


def main() -> None:
    """Entry point."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:  # Characters that a console can't show are escaped.
            reconfigure(errors="backslashreplace")
    try:
        _import_numpy()
        _call()
    except OSError as error:
        if error.errno not in _FULL or error.filename is not None:
            raise
        from gusjob.cli.common import stop_writing

        stop_writing(None, error)
    except MemoryError:
        from gusjob.cli.common import stop
        from gusjob.i18n.phrases import Phrase

        stop(Phrase("there is not enough memory for what this command has to compute"))
    finally:
        _flush_standard_output()
        gc.freeze()  # All that is left ends with the process: no search for garbage among it.


def _import_numpy() -> None:
    """Import numpy here if the command needs it: from deep in the stack its import takes a third longer.

    Python keeps its frames in chunks of 16 KB, and allocates a chunk for each call at the end of one. The import makes
    thousands of calls of one depth.
    """
    words = sys.argv[1:]
    command = next((word for word in words if word in _COMMANDS), None)
    if command not in (None, *_WITHOUT_NUMPY) and not {"-h", "--help"} & {*words} and _COMPLETE not in os.environ:
        import_module("numpy")


def _call() -> None:
    """Run the command, or answer a shell that completes one: also of python -m gusjob, under the program's own name."""
    if _COMPLETE not in os.environ:
        cli()
    import_module("gusjob.cli.bash_words")
    try:
        cli(prog_name="gusjob", complete_var=_COMPLETE)
    except (KeyError, ValueError):  # Not called by a shell: without its variables, or with others.
        sys.exit(1)


def _flush_standard_output() -> None:
    """Write what is left, and drop it if the reader has closed the pipe: Python's own flush would exit with 120."""
    try:
        if sys.stdout is not None and not sys.stdout.closed:
            sys.stdout.flush()
    except BrokenPipeError:
        from gusjob.cli.common import discard_standard_output

        discard_standard_output()
