"""`gusjob report`: time, velocity and laser power of every segment."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click
from msgspec.structs import replace

from gusjob.cli.color import use_color
from gusjob.cli.common import (
    exit_code,
    file_argument,
    machine_option,
    need,
    output_option,
    refuse_overwriting,
    refuse_terminal,
    scanner_option,
    show,
    stop,
    write,
)
from gusjob.cli.define import define_option
from gusjob.cli.endings import output_format
from gusjob.cli.formats import FormatChoice
from gusjob.cli.language import Command
from gusjob.cli.quiet import quiet_option
from gusjob.cli.standard_input import file_path, input_file, stdin_filename_option
from gusjob.cli.text_report import table_option, text_of
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.pipeline import FileResult, Rejected, Simulated, simulate_file

if TYPE_CHECKING:
    from collections.abc import Iterable

    from gusjob.config.machine import Scanner
    from gusjob.ir.overrides import Overrides
    from gusjob.report.compare import Comparison
    from gusjob.report.earlier import EarlierReport
    from gusjob.report.rows import Report

_TOLERANCE_PCT = 1.0
_ENDINGS = {
    ".txt": "text",
    ".json": "json",
    ".csv": "csv",
    ".md": "markdown",
    ".html": "html",
    ".parquet": "parquet",
}
_WITHOUT_RUN = ("json", "markdown", "html")
"""Formats that have the diagnostics, and so are also written for a job with errors."""
_ALWAYS = "json"
"""The format that is also written for a file that can't be read: who parses it can rely on it."""
_WITHOUT_COMPARISON = ("csv", "html", "parquet")
"""Formats without the comparison, which is written to standard error."""
_EXTRAS = {"html": ("html", "jinja2"), "parquet": ("parquet", "pyarrow")}


def _tolerance_pct(_context: click.Context, _parameter: click.Parameter, text: str | None) -> float | None:
    """Parse a percentage; the sign % may be left out."""
    if text is None:
        return None
    found = re.fullmatch(r"(\d+\.?\d*|\.\d+) ?%?", text.strip(), re.ASCII)
    percent = float(found[1]) if found else 101.0
    if percent > 100:
        wrong = Phrase("{text} is not a percentage: write 1, 0.1% or 0; at most 100%", text=printable(text)[:40])
        raise click.BadParameter(localized(wrong))
    return percent


@click.command(name="report", cls=Command)
@file_argument
@machine_option
@scanner_option
@define_option
@stdin_filename_option
@click.option(
    "--format",
    "form",
    type=FormatChoice(["text", "json", "csv", "markdown", "html", "parquet"]),
    help="Default: by the output file's extension, else text. html: one self-contained page for a browser.",
)
@click.option(
    "--summary", is_flag=True, help="Totals only, no segments and marks. The text has these only with --table."
)
@click.option(
    "--marks/--no-marks",
    "marking",
    default=None,
    help="Compute the quality of each mark: ends, energy per mm, corners. Default: on with a scanner, "
    "otherwise up to 100,000 segments.",
)
@click.option(
    "--against",
    "earlier_path",
    type=click.Path(),
    callback=file_path,
    metavar="OLD.JSON",
    help="Compare with an earlier report (--format json); exit status 1 if something changed.",
)
@click.option(
    "--tolerance",
    "tolerance_pct",
    callback=_tolerance_pct,
    metavar="PERCENT",
    show_default="1%",
    help="Ignore changes up to this percentage of the larger value. 0: ignore rounding only.",
)
@click.option("--only-changes", is_flag=True, help="With --against: show the comparison alone, not the report itself.")
@table_option
@output_option
@quiet_option
def command(
    path: Path,
    machine_path: Path | None,
    scanner: Scanner | None,
    overrides: Overrides,
    stdin_filename: Path | None,
    form: str | None,
    summary: bool,
    marking: bool | None,
    earlier_path: Path | None,
    tolerance_pct: float | None,
    only_changes: bool,
    tables: bool,
    output: Path | None,
) -> None:
    """Report the time, velocity and laser power of a run, and what stands out.

    The text begins with the answer; --table adds the tables of all segments and marks. The calls are simulated tick by
    tick. A job with errors is not simulated: JSON, markdown and html then have the diagnostics only, other formats are
    not written. A listing with errors is simulated: calls that the controller would refuse are reported and have no
    effect.
    """
    form = output_format(form, output, _ENDINGS)
    _refuse(form, marking=bool(marking), summary=summary, tables=tables)
    if form in _EXTRAS:
        need(*_EXTRAS[form], to=Phrase("write {form}", form=form))
        refuse_terminal(form, output)
    if tolerance_pct is not None and earlier_path is None:
        raise click.UsageError(localized(Phrase("--tolerance needs --against")))
    _refuse_only_changes(form, earlier_path, only_changes=only_changes)
    if earlier_path is not None and output is not None:
        refuse_overwriting(output, [earlier_path])
    earlier = None if earlier_path is None else _read_earlier(earlier_path)
    file = input_file(path, stdin_filename)
    result = simulate_file(file.path, machine_path, scanner=scanner, data=file.data, overrides=overrides)
    report = _report(result, marking) if isinstance(result, Simulated) else None
    comparison = None
    if report is not None and earlier is not None:
        from gusjob.report.compare import compare

        comparison = compare(report, earlier, _TOLERANCE_PCT if tolerance_pct is None else tolerance_pct)
    if report is not None or form == _ALWAYS or (form in _WITHOUT_RUN and not result.is_unreadable):
        pieces = _written(
            result,
            report,
            comparison,
            form=form,
            summary=summary,
            only_changes=only_changes,
            tables=tables,
            color=output is None and use_color(sys.stdout),
        )
        write(pieces, output, sources=result.inputs, for_people=form == "text")
    if form in _WITHOUT_COMPARISON and comparison is not None:
        from gusjob.report.compare_text import comparison_text

        click.echo(comparison_text(comparison), err=True, nl=False)
    if form not in ("json", "markdown") or report is None:
        show(result, notes=report is None)
    sys.exit(exit_code(result) or int(comparison is not None and not comparison.same))


def _refuse_only_changes(form: str, earlier_path: Path | None, *, only_changes: bool) -> None:
    if only_changes and earlier_path is None:
        raise click.UsageError(localized(Phrase("--only-changes needs --against")))
    if only_changes and form not in ("text", "markdown"):
        raise click.UsageError(localized(Phrase("--only-changes needs --format text or markdown")))


def _refuse(form: str, *, marking: bool, summary: bool, tables: bool) -> None:
    """Refuse options that a format does not support."""
    if marking and form in ("csv", "parquet"):
        wrong = Phrase("--marks can't be used with {form}, which has segments only", form=form)
        raise click.UsageError(localized(wrong))
    if summary and form in ("html", "parquet"):
        raise click.UsageError(localized(Phrase("--summary needs --format text, json, csv or markdown")))
    if tables and form != "text":
        raise click.UsageError(localized(Phrase("--table needs --format text; other formats have all rows")))
    if tables and summary:
        raise click.UsageError(localized(Phrase("--table and --summary exclude each other")))


def _report(result: Simulated, marking: bool | None) -> Report:
    from gusjob.report.rows import report_of

    return report_of(result, marking=marking)


def _written(
    result: FileResult,
    report: Report | None,
    comparison: Comparison | None,
    *,
    form: str,
    summary: bool,
    only_changes: bool,
    tables: bool,
    color: bool,
) -> Iterable[bytes]:
    """Write the report in a format; only some formats have one of a job that was not run."""
    if form == "html":
        from gusjob.cli.page import html_page, too_long

        if reason := too_long(report):
            stop(f"{result.path}: {localized(reason)}")
        return html_page(result, report)
    if form == "markdown":
        from gusjob.report.markdown import report_markdown

        text = report_markdown(
            report,
            result.diagnostics,
            name=str(result.path),
            summary=summary,
            comparison=comparison,
            only_changes=only_changes,
            overrides=result.overrides,
        )
        return [text.encode()]
    from gusjob.report.files import report_csv, report_json, report_json_without_run, report_parquet, summary_csv

    if report is None:
        period_us = None if isinstance(result, Rejected) else result.machine.period_us
        from gusjob.frontend.source import shown_name

        return report_json_without_run(shown_name(result.path), period_us, result.diagnostics, summary=summary)
    if form == "text":
        shown = [] if only_changes else [text_of(result, report, tables=tables and not summary, color=color)]
        if comparison is not None:
            from gusjob.report.compare_text import comparison_text

            shown.insert(0, comparison_text(comparison))
        return ["\n\n".join(text.rstrip("\n") for text in shown).encode() + b"\n"]
    if form == "parquet":
        return report_parquet(report)
    if form == "csv":
        return summary_csv(report) if summary else report_csv(report)
    if comparison is not None:
        from gusjob.report.compare_json import against_json

        report = replace(report, notes={**report.notes, "against": against_json(comparison)})
    return report_json(report, result.diagnostics, summary=summary)


def _read_earlier(path: Path) -> EarlierReport:
    """Read an earlier report; exit with 2 if the file is none."""
    from gusjob.report.earlier import read_earlier

    earlier, reason = read_earlier(path)
    if earlier is None:
        stop(f"{path}: {localized(reason)}")
    return earlier
