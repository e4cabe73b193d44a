"""gusjob lsp."""

from __future__ import annotations

import signal
import sys

import click

from gusjob.cli.common import need, stop


@click.command(name="lsp")
@click.option(
    "--tcp",
    "port",
    type=click.IntRange(1, 2**16 - 1),
    metavar="PORT",
    help="Listen at this port of this computer, for one client.",
)
@click.option("--textmate", is_flag=True, help="Print the TextMate grammar, with which editors colour a job, and end.")
def command(port: int | None, textmate: bool) -> None:
    """Serve an editor: diagnostics while a job is typed, completion, hovers, jumps, symbols, layout, quick fixes.

    Speaks the Language Server Protocol over standard input and output; an editor starts it. Exit status: 0 when the
    editor ended it, 1 when the editor was gone, 2 wrong usage.
    """
    if textmate:
        from gusjob.lsp.textmate import GRAMMAR_PATH

        click.echo(GRAMMAR_PATH.read_text(encoding="utf-8"), nl=False)
        return
    need("lsp", "pygls", to="serve an editor")
    from gusjob.lsp.server import serve_pipes, serve_port

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # A thread waits for input: it must not be waited for.
    if port is not None:
        try:
            sys.exit(serve_port(port))
        except OSError as error:
            stop(f"can't listen at port {port}: {(error.strerror or 'unknown error').lower()}; name another with --tcp")
    stdin, stdout = sys.stdin, sys.stdout
    if stdin is None or stdout is None:
        stop("there is no standard input and output to speak over; an editor starts this command")
    if stdin.isatty():
        stop('this command is for an editor to start (README, "In an editor"); --tcp PORT listens at a port')
    sys.stdout = sys.stderr  # Whatever else prints must not get into the protocol.
    sys.exit(serve_pipes(stdin.buffer, stdout.buffer))
