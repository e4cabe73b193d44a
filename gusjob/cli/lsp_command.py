"""gusjob lsp."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import click

from gusjob.cli.common import need, output_option, stop, write
from gusjob.cli.language import Command, language_was_given
from gusjob.i18n.phrases import Phrase, localized, reason_of


@click.command(name="lsp", cls=Command)
@click.option(
    "--tcp",
    "port",
    type=click.IntRange(1, 2**16 - 1),
    metavar="PORT",
    help="Listen at this port of this computer, for one client.",
)
@click.option("--textmate", is_flag=True, help="Print the TextMate grammar, with which editors colour a job, and end.")
@output_option
def command(port: int | None, textmate: bool, output: Path | None) -> None:
    """Serve an editor: diagnostics while a job is typed, completion, hovers, jumps, symbols, layout, quick fixes.

    Speaks the Language Server Protocol over standard input and output; an editor starts it. Messages are in the
    editor's language, or in that of --lang. Exit status: 0 when the editor ended it, 1 when the editor was gone, 2
    wrong usage.
    """
    if textmate:
        from gusjob.lsp.textmate import GRAMMAR_PATH

        write([GRAMMAR_PATH.read_bytes()], output)
        return
    if output is not None:
        raise click.UsageError(localized(Phrase("-o is for --textmate")))
    need("lsp", "pygls", to=Phrase("serve an editor"))
    from gusjob.lsp.server import serve_pipes, serve_port

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # A thread waits for input: it must not be waited for.
    if port is not None:
        try:
            sys.exit(serve_port(port, follow=not language_was_given()))
        except OSError as error:
            reason = reason_of(error)
            stop(Phrase("can't listen at port {port}: {reason}; name another with --tcp", port=port, reason=reason))
    stdin, stdout = sys.stdin, sys.stdout
    if stdin is None or stdout is None:
        stop(Phrase("there is no standard input and output to speak over; an editor starts this command"))
    if stdin.isatty():
        stop(Phrase('this command is for an editor to start (README, "In an editor"); --tcp PORT listens at a port'))
    sys.stdout = sys.stderr  # Whatever else prints must not get into the protocol.
    sys.exit(serve_pipes(stdin.buffer, stdout.buffer, follow=not language_was_given()))
