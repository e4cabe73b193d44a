"""gusjob help."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gusjob.cli.language import Command

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from click.shell_completion import CompletionItem


def _complete(context: click.Context, _parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete the name of a command, as the shell does after gusjob."""
    root = context.find_root()
    return root.command.shell_complete(root, incomplete)


@click.command(name="help", cls=Command)
@click.argument("name", metavar="[COMMAND]", required=False, shell_complete=_complete)
@click.pass_context
def command(context: click.Context, name: str | None) -> None:
    """Show the help of a command, as its --help does; without COMMAND that of gusjob."""
    root = context.find_root()
    group = root.command
    assert isinstance(group, click.Group)
    if name is None:
        click.echo(root.get_help())
        return
    _, named, _ = group.resolve_command(root, [name])  # Of another name it is wrong usage.
    assert named is not None
    named.make_context(name, ["--help"], parent=root)
