"""gusjob check."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import click
from msgspec import Struct, field

from gusjob.cli.common import ExitStatus, counted_files, machine_option, output_option, refuse_overwriting, show, write
from gusjob.cli.completion import complete_codes
from gusjob.cli.define import define_option
from gusjob.cli.endings import output_format
from gusjob.cli.files import CURRENT_FOLDER, files_named, refuse_writing_unnamed
from gusjob.cli.formats import FormatChoice
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
from gusjob.diagnostics.formats.writers import ENDINGS, FORMATS, LOG, TEXT, WITH_STATISTICS, writer_for
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.diagnostics.rules import RULES
from gusjob.diagnostics.select import SelectionLayer
from gusjob.i18n.language import translated
from gusjob.i18n.phrases import Phrase, all_of, localized, plural, printable
from gusjob.i18n.width import padded
from gusjob.ir.overrides import Overrides
from gusjob.pipeline import FileResult, examine_file, selected

_CHECKED = (".job", ".gts")
"""Endings of the files in a folder that are checked."""


def _prefixes(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    """Split codes or prefixes of codes, 'GJ4' or 'GJ401,GJ402'; each must match a rule."""
    codes = tuple(code.strip().upper() for text in value for code in text.split(",") if code.strip())
    for code in codes:
        if not any(known.startswith(code) for known in RULES):
            wrong = Phrase(
                "no rule has a code that begins with {code}: `gusjob explain` lists all rules", code=printable(code)
            )
            raise click.BadParameter(localized(wrong))
    return codes


@click.command(name="check", cls=Command)
@click.argument("paths", metavar="[FILE|FOLDER|GLOB]...", nargs=-1, type=click.Path(), callback=input_paths)
@machine_option
@define_option
@stdin_filename_option
@click.option(
    "--format", "form", type=FormatChoice(FORMATS),
    help="text for people, json for programs, sarif for code scanning, junit for CI systems that show test results, "
    "github for annotations, gitlab for Code Quality. Default: by the output file's extension, else text.",
)  # fmt: skip
@output_option
@click.option("--strict", is_flag=True, help="Exit with 1 on warnings, too.")
@click.option(
    "--exit-zero", is_flag=True, help="Exit with 0 even if there are errors; still 2 if a file can't be read."
)
@click.option(
    "--select", multiple=True, callback=_prefixes, metavar="CODES", shell_complete=complete_codes,
    help="Report only these rules, such as GJ4,GJ201.",
)  # fmt: skip
@click.option(
    "--ignore", multiple=True, callback=_prefixes, metavar="CODES", shell_complete=complete_codes,
    help="Report all rules but these.",
)  # fmt: skip
@click.option("--statistics", is_flag=True, help="Count the diagnostics of each rule instead of listing them.")
@click.option(
    "--fix", "fixes", is_flag=True, help="Correct problems that have only one possible correction; report the rest."
)
@click.option("--diff", "diffs", is_flag=True, help="Show what --fix would change, without writing.")
@quiet_option
def command(
    paths: tuple[Path, ...], machine_path: Path | None, overrides: Overrides, stdin_filename: Path | None,
    form: str | None, output: Path | None, strict: bool, exit_zero: bool, select: tuple[str, ...],
    ignore: tuple[str, ...], statistics: bool, fixes: bool, diffs: bool,
) -> None:  # fmt: skip
    """Check jobs and listings for errors.

    A FOLDER means all .job and .gts files in it; without arguments, those in the current folder. A GLOB ("**/*.job")
    works even if the shell does not expand it. - reads standard input. Exit status: 0 clean, 1 errors (with --strict
    also warnings; with --exit-zero 0 instead), 2 wrong usage or a file that can't be read. Rules that are not selected,
    here or in the profile's [check], are not counted.

    With --fix the exit status is that of the corrected files; with --diff it is 1 if there is something to correct.
    --fix writes the corrected text of standard input to standard output.
    """
    form = output_format(form, output, ENDINGS)
    _refuse(form, statistics=statistics, diffs=diffs, strict=strict, exit_zero=exit_zero)
    if overrides and (fixes or diffs):
        wrong = Phrase("--fix and --diff can't be combined with -D: they correct the job for the values in its text")
        raise click.UsageError(localized(wrong))
    writes_text = fixes and not diffs and STANDARD_INPUT in paths
    if writes_text and output is None and (form != TEXT or statistics):
        wrong = Phrase("--fix writes the text of standard input to standard output: name a file for the rest with -o")
        raise click.UsageError(localized(wrong))
    if fixes and not diffs:
        refuse_writing_unnamed(paths, Phrase("--fix rewrites files: name them, or . for those in the current folder"))
    refuse_name_without_input(paths, stdin_filename)
    asked = SelectionLayer(select=select, ignore=ignore)
    sums = _Sums(status=ExitStatus(strict=strict))
    is_shown = form == TEXT and (output is None or statistics)
    by_rule = sums.by_rule if statistics else None
    writer = None if is_shown else writer_for(form, strict=strict, by_rule=by_rule, overrides=overrides)
    fixer = None
    if fixes or diffs:
        from gusjob.cli.fixes import FileFixer

        fixer = FileFixer(machine_path=machine_path, asked=asked, diffs=diffs)
    files = files_named(paths or (CURRENT_FOLDER,), _CHECKED)
    named = [] if machine_path is None else [machine_path]
    if output is not None:  # Before anything is fixed.
        refuse_overwriting(output, [*files, *named])
    for path in files:
        file = InputFile(path=path) if path != STANDARD_INPUT else read_standard_input(stdin_filename)
        examined: FileResult = examine_file(file.path, machine_path, data=file.data, overrides=overrides)
        examined = examined if fixer is None else fixer.fix(examined, file.data)
        chosen = selected(examined, asked)
        sums.add(examined, chosen)
        if examined.diagnostics and fixer is None and (writer is None or output is not None):
            from gusjob.cli.fixes import count_fixes  # Start-up time is part of the tool.

            sums.add_fixable(count_fixes(examined, machine_path, asked))
        if writer is not None:
            writer.add(chosen.path, chosen.diagnostics, chosen.text_of, readable=not chosen.is_unreadable)
        elif not statistics:
            show(chosen, err=diffs or writes_text)
    if writer is not None:
        write([writer.to_bytes()], output, sources=[*sums.read, *named])
    elif statistics:
        write([_statistics_text(sums.by_rule).encode()], output, sources=[*sums.read, *named], for_people=True)
    if writer is None or output is not None or fixer is not None or form == LOG:
        summarize(sums.summary + (fixer.summary if fixer else ""))
    code = max(sums.status.code, fixer.exit_code if fixer else 0)
    sys.exit(0 if exit_zero and code == 1 else code)


class _Sums(Struct, kw_only=True):
    """Sums over all files. `left_out`: what is not selected, by severity; `read`: every file that was read.

    `fixable`: what --fix corrects; `is_counted`: this was counted in every file.
    """

    status: ExitStatus
    files: int = 0
    counts: Counter[Severity] = field(default_factory=Counter)
    left_out: Counter[Severity] = field(default_factory=Counter)
    by_rule: Counter[str] = field(default_factory=Counter)
    read: list[Path] = field(default_factory=list)
    fixable: int = 0
    is_counted: bool = True

    def add(self, examined: FileResult, chosen: FileResult) -> None:
        """Add a file with all its diagnostics, and with those that are selected."""
        counts = Counter(diagnostic.severity for diagnostic in chosen.diagnostics)
        self.files += 1
        self.counts += counts
        self.left_out += Counter(diagnostic.severity for diagnostic in examined.diagnostics) - counts
        self.by_rule += _counted(chosen.diagnostics)
        self.status.add(chosen)
        self.read += examined.inputs

    def add_fixable(self, count: int | None) -> None:
        """Add the number of problems that --fix corrects in a file; None if it is not known."""
        self.fixable += count or 0
        self.is_counted &= count is not None

    @property
    def _fixable(self) -> str:
        """'; 2 can be corrected with --fix'."""
        if not self.is_counted:  # A large file is checked once only.
            return Phrase("; --fix may correct some")
        return Phrase("; {count} can be corrected with --fix", count=self.fixable) if self.fixable else ""

    @property
    def summary(self) -> str:
        """'3 files: 1 error, 2 warnings (1 not selected); 1 can be corrected with --fix', in the user's language."""
        errors, warnings, notes = (self.counts[severity] for severity in Severity)
        words = (
            (errors, Phrase("{count} error", count=errors), Phrase("{count} errors", count=errors)),
            (notes, Phrase("{count} note", count=notes), Phrase("{count} notes", count=notes)),
            (warnings, Phrase("{count} warning", count=warnings), Phrase("{count} warnings", count=warnings)),
        )
        found = all_of([plural(count, one, many) for count, one, many in words if count]) or Phrase("clean")
        hidden, refused = self.left_out.total(), self.left_out[Severity.ERROR]
        rest = Phrase(" ({count} not selected)", count=hidden) if hidden else ""
        if refused:
            rest = Phrase(" ({count} not selected, {errors} of them errors)", count=hidden, errors=refused)
        return localized(
            Phrase("{files}: {counts}{hidden}", files=counted_files(self.files), counts=found, hidden=rest)
        ) + localized(self._fixable)


def _refuse(form: str, *, statistics: bool, diffs: bool, strict: bool, exit_zero: bool) -> None:
    """Refuse options that exclude each other."""
    if statistics and form not in WITH_STATISTICS:
        raise click.UsageError(localized(Phrase("--statistics needs --format text or json")))
    if diffs and (form != TEXT or statistics):
        raise click.UsageError(localized(Phrase("--diff can't be combined with --format or --statistics")))
    if strict and exit_zero:
        raise click.UsageError(localized(Phrase("--strict and --exit-zero exclude each other")))


def _counted(diagnostics: Iterable[Diagnostic]) -> Counter[str]:
    """Count the diagnostics of each rule, including those that are not listed and repetitions in loops."""
    counts: Counter[str] = Counter()
    for diagnostic in diagnostics:
        code = diagnostic.rule.code
        if "count" in diagnostic.fields and diagnostic.fields.get("code") in RULES:
            code, times = str(diagnostic.fields["code"]), int(diagnostic.fields["count"])
            counts[code] += times
        else:
            counts[code] += diagnostic.count
    return counts


def _statistics_text(counts: Counter[str]) -> str:
    """A line for each rule, the most frequent one first."""
    return "".join(
        f"{times:>9}  {code}  {padded(RULES[code].severity.localized, 7)}  {translated(RULES[code].title)}\n"
        for code, times in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    )
