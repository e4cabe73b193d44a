"""The format of an output: that of --format, else that of the output file's ending."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from gusjob.cli.standard_input import STANDARD_INPUT, named_path
from gusjob.i18n.phrases import Phrase, any_of, localized, printable
from gusjob.inputs import exists


def output_path(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Path | None:
    """Convert the name of an output file; None for `-`, which is standard output."""
    path = None if text is None else named_path(text)
    return None if path == STANDARD_INPUT else path


def output_format(
    form: str | None, output: Path | None, endings: Mapping[str, str], *, option: bool = True, bare: bool = True
) -> str:
    """Return the format in which a command writes; a usage error for an ending that has none.

    Args:
        form: The value of --format, which wins over any ending.
        output: The output file; None for standard output.
        endings: Format of each ending, in lower case. The first one is the default: that of standard output, of
            devices and pipes, and of names without an ending.
        option: Whether the command has the option --format.
        bare: Whether a file may have a name without an ending.
    """
    default = next(iter(endings.values()))
    if form is not None or output is None:
        return form or default
    name = output.name.lower()
    known = [ending for ending in endings if name.endswith(ending) and name != ending]
    if known:
        return endings[max(known, key=len)]
    if (bare and len(output.suffix) <= 1) or (exists(output) and not output.is_file()):
        return default
    shown, listed = printable(str(output)), any_of([*endings])
    wrong = Phrase("{path}: the name of the output file must end in {endings}", path=shown, endings=listed)
    if option:
        wrong = Phrase(
            "{path}: the name of the output file must end in {endings}; or use --format", path=shown, endings=listed
        )
    raise click.UsageError(localized(wrong))
