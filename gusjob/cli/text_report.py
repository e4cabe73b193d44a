"""Reports as text on a terminal."""

from __future__ import annotations

import os
import shutil
import sys
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from gusjob.pipeline import FileResult
    from gusjob.report.rows import Report

table_option = click.option(
    "--table", "tables", is_flag=True, help="Add the totals, and the tables of all segments and marks."
)


def text_of(result: FileResult, report: Report, *, tables: bool, color: bool = False) -> str:
    """Format a report for people, for the width of the terminal."""
    from gusjob.report.answer import answer_of
    from gusjob.report.text import report_text

    answer = answer_of(report, result.diagnostics)
    return report_text(report, answer, tables=tables, width=text_width(), color=color)


def text_width() -> int:
    """Return the width of the terminal, or that of COLUMNS; a text that goes elsewhere has no narrow limit."""
    from gusjob.report.text import UNLIMITED

    if (sys.stdout is not None and sys.stdout.isatty()) or os.environ.get("COLUMNS", "").isdecimal():
        return shutil.get_terminal_size().columns
    return UNLIMITED
