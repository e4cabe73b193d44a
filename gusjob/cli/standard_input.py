"""Standard input as FILE: `-`, read once, under the name that --stdin-filename gives it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NoReturn

import click
from msgspec import Struct

from gusjob.i18n.phrases import Phrase, localized, printable, reason_of

DASH = "-"
STANDARD_INPUT = Path(DASH)
"""Standard input among the files of a command. A file of this name in the current folder is absolute (`named_path`)."""
_SHOWN = "<stdin>"


class InputFile(Struct, frozen=True, kw_only=True):
    """A file to read. `data`: its content if it is standard input, whose `path` is only a name; None: read the file."""

    path: Path
    data: bytes | None = None


def named_path(text: str) -> Path:
    """Return the path of a name on the command line: `-` is standard input or output, `./-` a file."""
    path = Path(text)
    return path if text == DASH or path != STANDARD_INPUT else path.absolute()


def input_path(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Path | None:
    """Convert the name of a file, or `-`."""
    return None if text is None else named_path(text)


def input_paths(_context: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> tuple[Path, ...]:
    """Convert the names of files, of which one may be `-`."""
    return tuple(map(named_path, texts))


def file_path(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Path | None:
    """Convert the name of a file that can't be standard input or output."""
    if text == DASH:
        wrong = Phrase("- (standard input or output) can't be used here: name a file; a file called - is ./-")
        raise click.BadParameter(localized(wrong))
    return None if text is None else named_path(text)


def _name(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Path | None:
    """Convert the name of standard input, which need not exist."""
    path = None if text is None else Path(text)
    if path is not None and path.name in ("", ".."):
        raise click.BadParameter(localized(Phrase("{name} is not a file name", name=printable(str(text)) or '""')))
    return path


stdin_filename_option = click.option(
    "--stdin-filename",
    type=click.Path(),
    callback=_name,
    metavar="PATH",
    help="Name of standard input (FILE is -) in messages. The profile and included files are searched for in its "
    "folder; its extension decides whether it is a job or a listing.",
)


def input_file(path: Path, stdin_filename: Path | None) -> InputFile:
    """Return the file of the argument FILE; standard input is read here."""
    refuse_name_without_input([path], stdin_filename)
    return InputFile(path=path) if path != STANDARD_INPUT else read_standard_input(stdin_filename)


def refuse_name_without_input(paths: list[Path] | tuple[Path, ...], stdin_filename: Path | None) -> None:
    """Refuse a name for standard input if it is not among the files."""
    if stdin_filename is not None and STANDARD_INPUT not in paths:
        wrong = Phrase("--stdin-filename names standard input: write - as FILE, too")
        raise click.UsageError(localized(wrong))


def read_standard_input(stdin_filename: Path | None) -> InputFile:
    """Read standard input up to its end; exit with 2 if it can't be read."""
    from gusjob.frontend.source import read_limited

    if sys.stdin is None:
        _stop(Phrase("it is closed"))
    try:
        data = read_limited(sys.stdin.buffer)
    except OSError as error:
        _stop(reason_of(error))
    return InputFile(path=stdin_filename or Path(_SHOWN), data=data)


def _stop(reason: str) -> NoReturn:
    text = localized(Phrase("standard input: can't read: {reason}", reason=reason))
    click.echo(f"gusjob: {printable(text)}", err=True)
    sys.exit(2)
