"""The option -D NAME=VALUE: overrides of a job's LETs."""

from __future__ import annotations

from pathlib import Path

import click

from gusjob.cli.common import stop
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.ir.overrides import NO_OVERRIDES, Overrides

_SHOWN = 40


def _overrides(_context: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> Overrides:
    """Parse the option's values."""
    if not texts:
        return NO_OVERRIDES
    from gusjob.frontend.overrides import checked_overrides  # The parser takes time to load.

    pairs = []
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            wrong = Phrase("{text} has no =: write NAME=VALUE, such as pitch=0.5mm", text=printable(text)[:_SHOWN])
            raise click.BadParameter(localized(wrong))
        pairs.append((name.strip(), value))
    found = checked_overrides(pairs)
    if isinstance(found, Phrase):
        raise click.BadParameter(localized(found))
    return found


define_option = click.option(
    "-D",
    "--define",
    "overrides",
    multiple=True,
    callback=_overrides,
    metavar="NAME=VALUE",
    help="Replace the value of the first LET of NAME in the job; repeatable.",
)


def recorded_overrides(journal: Path, recorded: Overrides) -> Overrides:
    """Check the overrides that a journal has; stop if a run does not write them like this."""
    if not recorded:
        return NO_OVERRIDES
    from gusjob.frontend.overrides import checked_overrides

    found = checked_overrides(recorded.items())
    if isinstance(found, Phrase):
        stop(f"{journal}: {localized(found)}")
    return found
