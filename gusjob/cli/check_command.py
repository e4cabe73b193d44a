"""gusjob check."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import click

from gusjob.cli.common import Verdict, files_of, machine_option, output_option, show, write
from gusjob.cli.files import files_named
from gusjob.cli.fixes import FileFixer
from gusjob.cli.language import Command
from gusjob.diagnostics.formats.writers import writer_for
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.diagnostics.rules import RULES
from gusjob.diagnostics.select import SelectionLayer
from gusjob.i18n.language import translated
from gusjob.i18n.phrases import Phrase, all_of, localized, plural, printable
from gusjob.i18n.width import padded
from gusjob.pipeline import Loaded, load, look_closer, selected

_CHECKED = (".job", ".gts")
"""Endings of the files in a folder that are checked."""


def _prefixes(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    """Codes or the beginnings of codes, 'GJ4' or 'GJ401,GJ402'; each must begin a rule."""
    codes = tuple(code.strip().upper() for text in value for code in text.split(",") if code.strip())
    for code in codes:
        if not any(known.startswith(code) for known in RULES):
            wrong = Phrase("no rule begins with {code}; `gusjob explain` lists them", code=printable(code))
            raise click.BadParameter(localized(wrong))
    return codes


@click.command(name="check", cls=Command)
@click.argument("paths", metavar="FILE|FOLDER|GLOB...", nargs=-1, required=True, type=click.Path(path_type=Path))
@machine_option
@click.option(
    "--format", "form", type=click.Choice(["text", "json", "sarif", "junit"]), default="text", show_default=True,
    help="text for people, json for programs, sarif for code scanning, junit for CI systems that show tests.",
)  # fmt: skip
@output_option
@click.option("--strict", is_flag=True, help="Warnings fail too.")
@click.option(
    "--select", multiple=True, callback=_prefixes, metavar="CODES", help="Only these rules, such as GJ4,GJ201."
)
@click.option("--ignore", multiple=True, callback=_prefixes, metavar="CODES", help="All but these rules.")
@click.option("--statistics", is_flag=True, help="Count the faults of each rule in place of listing them.")
@click.option(
    "--fix", "fixes", is_flag=True, help="Correct problems that have only one possible correction; show the rest."
)
@click.option("--diff", "diffs", is_flag=True, help="Show what --fix would change; write nothing.")
def command(
    paths: tuple[Path, ...], machine_path: Path | None, form: str, output: Path | None, strict: bool,
    select: tuple[str, ...], ignore: tuple[str, ...], statistics: bool, fixes: bool, diffs: bool,
) -> None:  # fmt: skip
    """Check jobs and listings: words, ranges, modes, order, light, motion.

    All diagnostics of all files are listed; in a FOLDER all .job and .gts files are checked, and of a GLOB
    ("**/*.job") that the shell has left as it is, what it matches. Exit status: 0 clean, 1 an error (with --strict
    also a warning), 2 a file that can't be read. A diagnostic that is not selected, here or in the profile's [check],
    does not count.

    With --fix, the exit status is that of the corrected files; with --diff, it is 1 if something can be fixed.
    """
    _refuse(form, output, statistics=statistics, diffs=diffs)
    asked = SelectionLayer(select=select, ignore=ignore)
    sums = _Sums(asked=asked, verdict=Verdict(strict=strict))
    writer = writer_for(form, strict=strict, by_rule=sums.by_rule if statistics else None)
    fixer = FileFixer(machine_path=machine_path, asked=asked, diffs=diffs) if fixes or diffs else None
    files = files_named(paths, _CHECKED)
    if fixes and output is not None:
        _keep(output, files)
    for path in files:
        loaded = judged(path, machine_path)
        loaded = loaded if fixer is None else fixer.fix(loaded)
        sums.add(loaded)
        if writer is not None:
            writer.add(loaded.path, loaded.diagnostics, loaded.text_of, readable=not loaded.unreadable)
        elif not statistics:
            show(loaded, err=diffs)
    if writer is not None:
        write([writer.to_bytes()], output, sources=sums.read)
    elif statistics:
        _print_statistics(sums.by_rule)
    if writer is None or output is not None or fixer is not None:
        click.echo(sums.told + (fixer.summary if fixer else ""), err=True)
    sys.exit(max(sums.verdict.exit_code, fixer.exit_code if fixer else 0))


@dataclass(slots=True, kw_only=True)
class _Sums:
    """What all files come to. `left_out`: what is not selected, by severity; `read`: every file that was."""

    asked: SelectionLayer
    verdict: Verdict
    files: int = 0
    counts: Counter[Severity] = field(default_factory=Counter)
    left_out: Counter[Severity] = field(default_factory=Counter)
    by_rule: Counter[str] = field(default_factory=Counter)
    read: list[Path] = field(default_factory=list)

    def add(self, loaded: Loaded) -> None:
        """One more file; only the diagnostics that are selected stay."""
        every, loaded.diagnostics = loaded.diagnostics, selected(loaded, self.asked)
        chosen = Counter(diagnostic.severity for diagnostic in loaded.diagnostics)
        self.files += 1
        self.counts += chosen
        self.left_out += Counter(diagnostic.severity for diagnostic in every) - chosen
        self.by_rule += _counted(loaded.diagnostics)
        self.verdict.add(loaded)
        self.read += loaded.inputs

    @property
    def told(self) -> str:
        """'3 files: 1 error, 2 warnings (1 not selected)', in the user's language."""
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
        return localized(Phrase("{files}: {counts}{hidden}", files=files_of(self.files), counts=found, hidden=rest))


def _refuse(form: str, output: Path | None, *, statistics: bool, diffs: bool) -> None:
    """What does not go together."""
    if form == "text" and output is not None:
        raise click.UsageError(localized(Phrase("-o is for --format json, sarif and junit")))
    if statistics and form in ("sarif", "junit"):
        raise click.UsageError(localized(Phrase("--statistics is for text and JSON")))
    if diffs and (form != "text" or statistics):
        raise click.UsageError(
            localized(Phrase("--diff is for people and patch: no --format, no --statistics with it"))
        )


def _keep(output: Path, files: list[Path]) -> None:
    """Refuse an output file that is one of the files to fix."""
    for path in files:
        if output.exists() and path.exists() and output.samefile(path):
            wrong = Phrase("--fix would write over {path}: name another file with -o", path=output)
            raise click.UsageError(localized(wrong))


def _counted(diagnostics: list[Diagnostic]) -> Counter[str]:
    """Diagnostics of each rule, those that are not listed or come in many rounds included."""
    counts: Counter[str] = Counter()
    for diagnostic in diagnostics:
        code = diagnostic.rule.code
        if "count" in diagnostic.fields and diagnostic.fields.get("code") in RULES:
            code, times = str(diagnostic.fields["code"]), int(diagnostic.fields["count"])
            counts[code] += times
        else:
            counts[code] += diagnostic.count
    return counts


def _print_statistics(counts: Counter[str]) -> None:
    for code, times in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
        click.echo(f"{times:>9}  {code}  {padded(RULES[code].severity.localized, 7)}  {translated(RULES[code].title)}")


def judged(path: Path, machine_path: Path | None) -> Loaded:
    """A file with all its diagnostics."""
    loaded = load(path, machine_path)
    look_closer(loaded)
    return loaded
