"""-q: a command prints its result, errors and warnings, and nothing else."""

from __future__ import annotations

import click

_KEY = "gusjob.quiet"


def _set(context: click.Context, _parameter: click.Parameter, value: bool) -> None:
    context.meta[_KEY] = value


quiet_option = click.option(
    "-q",
    "--quiet",
    is_flag=True,
    expose_value=False,
    callback=_set,
    help="Print only the result, errors and warnings: no notes, summaries or progress.",
)


def is_quiet() -> bool:
    """Return whether the running command was called with -q."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(_KEY))


def summarize(text: str) -> None:
    """Print a summary, or what the command is doing, on standard error; nothing with -q."""
    if not is_quiet():
        click.echo(text, err=True)
