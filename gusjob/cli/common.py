"""What the commands share: options, printing diagnostics, writing results."""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import BinaryIO, NoReturn

import click
from msgspec import Struct

from gusjob.cli.color import use_color
from gusjob.cli.endings import output_path
from gusjob.cli.quiet import is_quiet
from gusjob.cli.standard_input import file_path, input_path
from gusjob.config.machine import SCANNER_FORM, Scanner, parse_scanner
from gusjob.diagnostics.model import Severity, has_errors
from gusjob.i18n.phrases import Phrase, localized, plural, printable, reason_of
from gusjob.inputs import exists, open_input
from gusjob.pipeline import FileResult

machine_option = click.option(
    "--profile",
    "--machine",  # Its former name.
    "machine_path",
    type=click.Path(),
    callback=file_path,
    help="Machine profile (TOML). Default: gusjob.toml in the job's folder or above it, else the documented defaults.",
)


def _scanner(_context: click.Context, _parameter: click.Parameter, text: str | None) -> Scanner | None:
    """Parse the scanner option."""
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
    help=f"Scanner model in place of the profile's: how the beam lags behind the commanded position. {SCANNER_FORM}.",
)
file_argument = click.argument("path", metavar="FILE", type=click.Path(), callback=input_path)
output_option = click.option(
    "-o",
    "--output",
    type=click.Path(),
    callback=output_path,
    help="Write to this file instead of standard output (-). Its extension sets the format.",
)


class ExitStatus(Struct, kw_only=True):
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
    """Print diagnostics with their source lines; no notes with -q."""
    if not result.diagnostics:
        return
    from gusjob.diagnostics.formats.text import diagnostic_text  # Start-up time is part of the tool.

    stream = sys.stderr if err else sys.stdout
    color = use_color(stream)
    notes = notes and not is_quiet()
    for diagnostic in result.diagnostics:
        if notes or diagnostic.severity is not Severity.NOTE:
            click.echo(diagnostic_text(diagnostic, result.text_of, color=color), err=err, color=color)


def write(
    pieces: Iterable[bytes], output: Path | None, *, sources: Iterable[Path] = (), for_people: bool = False
) -> None:
    """Write bytes to a file or to standard output; exit with 2 if they can't be written.

    A file is replaced when the new one is complete, never written in part. `sources` are never overwritten.
    `for_people`: UTF-8 text, converted to the terminal's encoding on standard output as messages are.
    """
    try:
        if output is None:
            if sys.stdout is not None:
                encoding = sys.stdout.encoding or "utf-8"
                localized = (piece.decode().encode(encoding, "backslashreplace") for piece in pieces)
                _write_all(localized if for_people else pieces, sys.stdout.buffer)
        else:
            refuse_overwriting(output, sources)
            if exists(output) and not output.is_file():
                with output.open("wb") as file:  # A device or a pipe.
                    _write_all(pieces, file)
            else:
                _replace(_target(output), pieces)
    except BrokenPipeError:  # The reader has closed the pipe.
        discard_standard_output()
    except OSError as error:
        stop_writing(output, error)


def refuse_overwriting(output: Path, inputs: Iterable[Path]) -> None:
    """Exit with 2 if an output is one of the inputs, also under another name."""
    try:
        target = output if exists(output) else _target(output)
        if target.is_file() and any(exists(path) and target.samefile(path) for path in inputs):
            stop(Phrase("{path} is an input of this command: name another output file with -o", path=output))
    except OSError as error:
        stop_writing(output, error)


def _target(output: Path) -> Path:
    """Return the file that is written. For missing/../a.job it is a.job, though there is no folder of that name.

    Raises:
        OSError: its links are a loop.
    """
    target = Path(os.path.realpath(output))
    if target.is_symlink():
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP))
    return target


def stop_writing(output: Path | None, error: OSError) -> NoReturn:
    """Print why a file, or standard output, can't be written, and exit with 2."""
    if output is None:
        discard_standard_output()
    stop(Phrase("{path}: can't write: {reason}", path=output or _STANDARD_OUTPUT, reason=reason_of(error)))


def discard_standard_output() -> None:
    """Drop what is left for standard output: the interpreter's own flush at the end would fail again."""
    sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115, PTH123  (kept open until the process ends)


_STANDARD_OUTPUT = Phrase("standard output")
BOM = b"\xef\xbb\xbf"
"""Byte order mark that some editors put at the start of a UTF-8 file; it is not part of a job, and is kept."""


def bom_of(path: Path) -> bytes:
    """The BOM that a file begins with, or nothing. Raises OSError."""
    with open_input(path) as file:
        return BOM * (file.read(len(BOM)) == BOM)


def rewrite(path: Path, before: bytes, after: bytes) -> str:
    """Replace a file that was read by a changed text. Return why that failed, or an empty text. Links stay links."""
    try:
        target = path.resolve(strict=True)
        if not target.is_file():
            return Phrase("it is not a file")
        if not os.access(target, os.W_OK):
            return Phrase("permission denied")
        if target.read_bytes() != before:
            return Phrase("the file was changed in the meantime")
        _replace(target, [after])
    except OSError as error:
        return reason_of(error)
    return ""


def _replace(output: Path, pieces: Iterable[bytes]) -> None:
    """Write a temporary file beside a file, then move it to its place."""
    import tempfile  # Start-up time is part of the tool.

    if output.exists():
        output.open("ab").close()  # A file that may not be written is not replaced either.
    handle, name = tempfile.mkstemp(prefix=".gusjob-", dir=output.parent)
    beside = Path(name)
    try:
        with open(handle, "wb") as file:  # noqa: PTH123  (a handle has no path)
            _write_all(pieces, file)
        beside.chmod(output.stat().st_mode & 0o7777 if output.exists() else 0o666 & ~_umask())
        beside.replace(output)
    except KeyboardInterrupt:
        stop(Phrase("{path}: interrupted, nothing was written", path=output))
    finally:
        beside.unlink(missing_ok=True)


def _umask() -> int:
    """The process's umask; it can only be read by setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def counted_files(count: int) -> str:
    """'3 files'."""
    return plural(count, Phrase("{count} file", count=count), Phrase("{count} files", count=count))


def need(extra: str, module: str, *, to: str) -> None:
    """Exit with 2 and print the install command if an extra is missing. `to`: its purpose."""
    try:
        import_module(module)
    except ImportError:
        stop(
            Phrase('to {do}, install the extra "{extra}": python -m pip install "gusjob[{extra}]"', do=to, extra=extra)
        )


def refuse_terminal(form: str, output: Path | None) -> None:
    """Refuse to write binary or endless output to a terminal."""
    if output is None and sys.stdout is not None and sys.stdout.isatty():
        raise click.UsageError(localized(Phrase("{form} can't be shown on a terminal: name a file with -o", form=form)))


def stop(message: str) -> NoReturn:
    """Print why, in the user's language, and exit with 2."""
    click.echo(f"gusjob: {printable(localized(message))}", err=True)
    sys.exit(2)


def _write_all(pieces: Iterable[bytes], file: BinaryIO) -> None:
    for piece in pieces:
        file.write(piece)
    file.flush()
