"""gusjob fmt."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import click
from msgspec import Struct, field

from gusjob.cli.color import colored_difference
from gusjob.cli.common import BOM, bom_of, counted_files, rewrite, show, write
from gusjob.cli.files import CURRENT_FOLDER, files_named, refuse_writing_unnamed
from gusjob.cli.language import Command
from gusjob.cli.quiet import quiet_option, summarize
from gusjob.cli.standard_input import (
    STANDARD_INPUT,
    InputFile,
    input_paths,
    read_standard_input,
    refuse_name_without_input,
    stdin_filename_option,
)
from gusjob.diagnostics.model import Diagnostic
from gusjob.i18n.phrases import Phrase, all_of, localized, plural, printable
from gusjob.pipeline import FileResult

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from gusjob.frontend import Source

_FORMATTED = (".job",)
_CHANGED, _UNCHANGED, _FAILED, _LISTING = "changed", "unchanged", "failed", "listing"


@click.command(name="fmt", cls=Command)
@click.argument("paths", metavar="[FILE|FOLDER|GLOB]...", nargs=-1, type=click.Path(), callback=input_paths)
@stdin_filename_option
@click.option("--check", "checks", is_flag=True, help="List the files that would change, without writing.")
@click.option("--diff", "diffs", is_flag=True, help="Show what would change, without writing.")
@quiet_option
def command(paths: tuple[Path, ...], stdin_filename: Path | None, checks: bool, diffs: bool) -> None:
    """Format jobs: words, spaces, indents and comments in one canonical layout. Their calls stay the same.

    A FOLDER means all .job files in it. A GLOB ("**/*.job") works even if the shell does not expand it. --check and
    --diff without arguments take those in the current folder. Listings are not formatted. - reads standard input and
    writes standard output. A job with lines that can't be read stays as it is. Exit status: 0 done, 1 a job with errors
    (with --check or --diff also one that would change), 2 a file that can't be read or written.
    """
    run = _Formatting(checks=checks, diffs=diffs)
    if run.writes:
        refuse_writing_unnamed(paths, Phrase("fmt rewrites files: name them, or . for those in the current folder"))
    refuse_name_without_input(paths, stdin_filename)
    for path in _files(paths or (CURRENT_FOLDER,)):
        run.file(InputFile(path=path) if path != STANDARD_INPUT else read_standard_input(stdin_filename))
    summarize(run.summary())
    sys.exit(run.exit_code)


def _files(paths: tuple[Path, ...]) -> list[Path]:
    """List the jobs that are named, each once; standard input first."""
    return sorted(files_named(paths, _FORMATTED), key=lambda path: path != STANDARD_INPUT)


class _Formatting(Struct, kw_only=True):
    """Formats files one by one and counts the outcomes."""

    checks: bool
    diffs: bool
    counts: Counter[str] = field(default_factory=Counter)
    exit_code: int = 0

    @property
    def writes(self) -> bool:
        return not (self.checks or self.diffs)

    def file(self, file: InputFile) -> None:
        """Format a file."""
        from gusjob.frontend import is_listing

        bom, source, diagnostics = _read(file)
        if source is None:
            show(FileResult(path=file.path, diagnostics=tuple(diagnostics)))
            self.fail(2)
        elif is_listing(source):
            summarize(printable(localized(Phrase("{path}: listings are not formatted", path=source.name))))
            self.counts[_LISTING] += 1
            if file.data is not None and self.writes:
                write([file.data], None)
        else:
            self.job(file, bom, source)

    def job(self, file: InputFile, bom: bytes, source: Source) -> None:
        """Format a job that was read."""
        from gusjob.frontend.format import format_source

        data, diagnostics = format_source(source)
        if data is None:
            show(FileResult(path=file.path, diagnostics=tuple(diagnostics), sources={source.name: source}))
            self.fail(1)
            return
        before = source.as_written
        changed = data != before
        if self.writes and file.data is not None:
            write([bom, data], None)
        elif self.writes and changed:
            reason = rewrite(file.path, bom + before, bom + data)
            if reason:
                failed = Phrase("{path}: can't write: {reason}", path=source.name, reason=reason)
                click.echo(f"gusjob: {printable(localized(failed))}", err=True)
                self.fail(2)
                return
        elif changed:
            self.exit_code = max(self.exit_code, 1)
            self.show_change(source.name, bom + before, bom + data)
        self.counts[_CHANGED if changed else _UNCHANGED] += 1

    def show_change(self, name: str, before: bytes, after: bytes) -> None:
        """Print the difference, or only the name."""
        from gusjob.frontend.format.unified_diff import unified_diff

        named = [f"{name}\n".encode(errors="backslashreplace")]
        write(colored_difference(unified_diff(name, before, after)) if self.diffs else named, None)

    def fail(self, exit_code: int) -> None:
        self.counts[_FAILED] += 1
        self.exit_code = max(self.exit_code, exit_code)

    def summary(self) -> str:
        """'3 files: 1 changed, 2 unchanged', in the user's language."""
        changed, unchanged, failed, listings = (self.counts[kind] for kind in (_CHANGED, _UNCHANGED, _FAILED, _LISTING))
        words = {
            Phrase("{count} changed", count=changed): changed if self.writes else 0,
            Phrase("{count} would change", count=changed): 0 if self.writes else changed,
            Phrase("{count} unchanged", count=unchanged): unchanged,
            Phrase("{count} failed", count=failed): failed,
            plural(
                listings,
                Phrase("{count} listing not formatted", count=listings),
                Phrase("{count} listings not formatted", count=listings),
            ): listings,
        }
        counted = all_of([word for word, count in words.items() if count])
        return localized(Phrase("{files}: {counts}", files=counted_files(self.counts.total()), counts=counted))


def _read(file: InputFile) -> tuple[bytes, Source | None, list[Diagnostic]]:
    """Read a file: its BOM, if it has one, and its text, or why it is not text."""
    from gusjob.frontend import check_text, read_source
    from gusjob.frontend.source import shown_name

    if file.data is not None:
        source, diagnostics = check_text(file.data, shown_name(file.path), file.path)
        return BOM * file.data.startswith(BOM), source, diagnostics
    source, diagnostics = read_source(file.path)
    if source is None:
        return b"", None, diagnostics
    try:
        return bom_of(file.path), source, diagnostics
    except OSError:  # It has been removed since: it won't be written either.
        return b"", source, diagnostics
