"""gusjob report."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from gusjob.backend.sim import SimBackend
from gusjob.cli.common import (
    compiled,
    exit_code,
    file_argument,
    interpreted_faults,
    load,
    machine_option,
    output_option,
    show,
    write,
)


@click.command(name="report")
@file_argument
@machine_option
@click.option("--format", "form", type=click.Choice(["table", "json", "csv"]), default="table", show_default=True)
@click.option("--summary", is_flag=True, help="Totals only, no segments.")
@output_option
def command(path: Path, machine_path: Path | None, form: str, summary: bool, output: Path | None) -> None:
    """Report the time, speed and laser power of every segment.

    The calls are interpreted tick by tick, as the controller would run them. A job with errors is not run; a listing
    is, since some program already sends it: what the controller would refuse is reported and has no effect.
    """
    loaded = load(path, machine_path)
    stream, report = compiled(loaded), None
    if stream is not None:
        from gusjob.report.rows import make_report

        trace, faults = SimBackend().run(stream, loaded.machine, foreign=loaded.foreign)
        interpreted_faults(loaded, faults)
        report = None if trace is None else make_report(trace, loaded.machine)
    if report is not None:
        if form == "table":
            from gusjob.report.table import report_table

            write([report_table(report, summary=summary).encode()], output, source=path)
        else:
            from gusjob.report.files import report_csv, report_json, summary_csv

            if form == "json":
                write(report_json(report, loaded.faults, summary=summary), output, source=path)
            else:
                write(summary_csv(report) if summary else report_csv(report), output, source=path)
    if form != "json" or report is None:
        show(loaded, notes=report is None)
    sys.exit(exit_code([loaded]))
