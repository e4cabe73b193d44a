"""What the commands share: options, showing diagnostics, writing results."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import BinaryIO, NoReturn

import click

from gusjob.config.machine import SCANNER_FORM, Scanner, parse_scanner
from gusjob.diagnostics.model import Severity, has_errors
from gusjob.i18n.phrases import Phrase, localized, plural, printable, reason_of
from gusjob.pipeline import FileResult

machine_option = click.option(
    "--machine",
    "machine_path",
    type=click.Path(path_type=Path),
    help="Machine profile (TOML). Default: gusjob.toml in the job's folder or above it, else the documented defaults.",
)


def _scanner(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Scanner | None:
    """A scanner from the command line."""
    if text is None:
        return None
    scanner = parse_scanner(text)
    if isinstance(scanner, str):
        raise click.BadParameter(localized(scanner))
    return scanner


scanner_option = click.option(
    "--scanner",
    callback=_scanner,
    metavar="MODEL:TIME",
    help="How the mirrors lag behind the command, in place of the profile's scanner: to see where the beam really is "
    f"while the laser is on. {SCANNER_FORM}.",
)
file_argument = click.argument("path", metavar="FILE", type=click.Path(path_type=Path))
output_option = click.option(
    "-o", "--output", type=click.Path(path_type=Path), help="Write to this file instead of standard output."
)


@dataclass(slots=True, kw_only=True)
class ExitStatus:
    """Exit status of several files: 0 clean, 1 an error (or a warning with `strict`), 2 a file that can't be read."""

    strict: bool = False
    code: int = 0

    def add(self, result: FileResult) -> None:
        """Add a file."""
        failed = has_errors(result.diagnostics)
        failed |= self.strict and any(f.severity is Severity.WARNING for f in result.diagnostics)
        self.code = max(self.code, 2 if result.is_unreadable else int(failed))


def exit_code(result: FileResult) -> int:
    """Exit status of one file: 0 clean, 1 an error, 2 it can't be read."""
    status = ExitStatus()
    status.add(result)
    return status.code


def show(result: FileResult, *, err: bool = True, notes: bool = True) -> None:
    """Print diagnostics with their source lines."""
    from gusjob.cli.text import diagnostic_text

    stream = sys.stderr if err else sys.stdout
    color = stream is not None and stream.isatty()  # A closed stream is None.
    for diagnostic in result.diagnostics:
        if notes or diagnostic.severity is not Severity.NOTE:
            click.echo(diagnostic_text(diagnostic, result.text_of, color=color), err=err, color=color)


def write(
    pieces: Iterable[bytes], output: Path | None, *, sources: Iterable[Path] = (), for_people: bool = False
) -> None:
    """Write bytes to a file or to standard output; exits with 2 if they can't be written.

    A file is there whole or not at all: until it is, an older one stays. `sources` are never written over.
    `for_people`: UTF-8 text, which on standard output is in the terminal's encoding as messages are.
    """
    try:
        if output is None:
            if sys.stdout is not None:
                encoding = sys.stdout.encoding or "utf-8"
                localized = (piece.decode().encode(encoding, "backslashreplace") for piece in pieces)
                _write_all(localized if for_people else pieces, sys.stdout.buffer)
        elif output.exists() and any(source.exists() and output.samefile(source) for source in sources):
            stop(Phrase("{path}: this is a file that was read; name another one with -o", path=output))
        elif output.exists() and not output.is_file():
            with output.open("wb") as file:  # A device or a pipe.
                _write_all(pieces, file)
        else:
            _replace(output.resolve(), pieces)
    except BrokenPipeError:  # Whoever reads has seen enough.
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123  (for the interpreter's own flush)
    except OSError as error:
        stop(Phrase("{path}: can't write: {reason}", path=output or _STANDARD_OUTPUT, reason=reason_of(error)))


_STANDARD_OUTPUT = Phrase("standard output")
BOM = b"\xef\xbb\xbf"
"""What some editors begin a UTF-8 file with; it is no part of a job, and stays."""


def bom_of(path: Path) -> bytes:
    """The BOM that a file begins with, if it does. Raises OSError."""
    with path.open("rb") as file:
        return BOM * (file.read(len(BOM)) == BOM)


def rewrite(path: Path, before: bytes, after: bytes) -> str:
    """Put a changed text in the place of a file that was read, or say why that can't be. A link to it stays."""
    try:
        target = path.resolve(strict=True)
        if not target.is_file():
            return Phrase("this is no file")
        if not os.access(target, os.W_OK):
            return Phrase("permission denied")
        if target.read_bytes() != before:
            return Phrase("the file has changed in the meantime")
        _replace(target, [after])
    except OSError as error:
        return reason_of(error)
    return ""


def _replace(output: Path, pieces: Iterable[bytes]) -> None:
    """Write beside a file, then put it in its place."""
    if output.exists():
        output.open("ab").close()  # What may not be written over is not replaced either.
    handle, name = tempfile.mkstemp(prefix=".gusjob-", dir=output.parent)
    beside = Path(name)
    try:
        with open(handle, "wb") as file:  # noqa: PTH123  (a handle has no path)
            _write_all(pieces, file)
        beside.chmod(output.stat().st_mode & 0o7777 if output.exists() else 0o666 & ~_umask())
        beside.replace(output)
    except KeyboardInterrupt:
        stop(Phrase("{path}: interrupted; nothing was written", path=output))
    finally:
        beside.unlink(missing_ok=True)


def _umask() -> int:
    """What new files may not have; it can't be asked for without being set."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def files_of(count: int) -> str:
    """So many files."""
    return plural(count, Phrase("{count} file", count=count), Phrase("{count} files", count=count))


def need(extra: str, module: str, *, to: str) -> None:
    """See to it that an extra is installed; leaves with 2 and the line that installs it if not. `to`: a Phrase."""
    try:
        import_module(module)
    except ImportError:
        stop(
            Phrase('to {do}, install the extra "{extra}": python -m pip install "gusjob[{extra}]"', do=to, extra=extra)
        )


def refuse_terminal(form: str, output: Path | None) -> None:
    """What is not for reading is not poured out over a terminal."""
    if output is None and sys.stdout is not None and sys.stdout.isatty():
        raise click.UsageError(localized(Phrase("{form} is not for a terminal: name a file with -o", form=form)))


def stop(message: str) -> NoReturn:
    """Say why, in the user's language, and leave with 2."""
    click.echo(f"gusjob: {printable(localized(message))}", err=True)
    sys.exit(2)


def _write_all(pieces: Iterable[bytes], file: BinaryIO) -> None:
    for piece in pieces:
        file.write(piece)
    file.flush()
