"""`gusjob lsp`: the language server."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import click

from gusjob.cli.common import need, output_option, stop, write
from gusjob.cli.endings import output_format
from gusjob.cli.language import Command, language_was_given
from gusjob.i18n.phrases import Phrase, localized, reason_of


@click.command(name="lsp", cls=Command)
@click.option(
    "--tcp",
    "port",
    type=click.IntRange(1, 2**16 - 1),
    metavar="PORT",
    help="Listen on this port of this computer, for one client.",
)
@click.option("--textmate", is_flag=True, help="Print the TextMate grammar for syntax highlighting, and exit.")
@output_option
def command(port: int | None, textmate: bool, output: Path | None) -> None:
    """Run the language server: diagnostics, completion, hovers, definitions, symbols, formatting, quick fixes.

    Uses the Language Server Protocol over standard input and output; an editor starts it. Messages are in the
    editor's language, or in that of --lang. Exit status: 0 after the editor's shutdown request, 1 without one, 2 for
    wrong usage.
    """
    if textmate:
        from gusjob.lsp.textmate import GRAMMAR_PATH

        output_format(None, output, {".json": "json"}, option=False)
        write([GRAMMAR_PATH.read_bytes()], output, sources=[GRAMMAR_PATH])
        return
    if output is not None:
        raise click.UsageError(localized(Phrase("-o needs --textmate")))
    need("lsp", "pygls", to=Phrase("serve an editor"))
    from gusjob.lsp.serve import serve_pipes, serve_port

    signal.signal(signal.SIGINT, signal.SIG_DFL)  # A thread waits for input; do not wait for it.
    if port is not None:
        try:
            sys.exit(serve_port(port, follow=not language_was_given()))
        except OSError as error:
            reason = reason_of(error)
            why = Phrase(
                "can't listen on port {port}: {reason}; choose another one with --tcp", port=port, reason=reason
            )
            stop(why)
    stdin, stdout = sys.stdin, sys.stdout
    if stdin is None or stdout is None:
        stop(Phrase("there is no standard input and output; an editor must start this command"))
    if stdin.isatty():
        stop(Phrase("an editor must start this command (docs/editors.md); --tcp PORT listens on a port"))
    sys.stdout = sys.stderr  # Other output must not get into the protocol.
    sys.exit(serve_pipes(stdin.buffer, stdout.buffer, follow=not language_was_given()))
