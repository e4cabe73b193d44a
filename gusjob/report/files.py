"""Reports as JSON, CSV and Parquet, written column by column to save memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np
import orjson

from gusjob.diagnostics.formats.check_json import diagnostic_object
from gusjob.diagnostics.model import Diagnostic
from gusjob.report.rows import REPORT_SCHEMA, Report
from gusjob.tables.columns import CategoryColumn, Column, Columns, chunks
from gusjob.tables.export import csv_bytes, parquet_bytes

_NUMPY = orjson.OPT_SERIALIZE_NUMPY
_NOT_IN_CSV = {"channels", "marking", "run_in_mm", "run_out_mm"}
_GROUP_ROWS = 1 << 17
"""Rows per Parquet row group."""


def report_json(report: Report, diagnostics: Iterable[Diagnostic], *, summary: bool) -> Iterator[bytes]:
    """Yield gusjob-report/1 in pieces."""
    yield b'{"schema": ' + orjson.dumps(REPORT_SCHEMA) + b', "job": ' + orjson.dumps(report.job)
    yield b', "period_us": ' + orjson.dumps(report.period_us)
    yield b', "totals": ' + orjson.dumps(report.totals)
    for name, value in report.notes.items():
        yield b", " + orjson.dumps(name) + b": " + orjson.dumps(value)
    if not summary:
        yield from _columns("segments", rows_of(report))
        yield from [b', "marks": null'] if report.marks is None else _columns("marks", report.marks)
    yield b', "diagnostics": ' + orjson.dumps([diagnostic_object(f) for f in diagnostics]) + b"}\n"


def report_json_without_run(
    job: str, period_us: float | None, diagnostics: Iterable[Diagnostic], *, summary: bool
) -> Iterator[bytes]:
    """Yield gusjob-report/1 of a job that was not run: it has the fields of a run, but all figures are null."""
    fields: dict[str, Any] = {"schema": REPORT_SCHEMA, "job": job, "period_us": period_us, "totals": None}
    if not summary:
        fields |= {"segments": None, "marks": None}
    yield orjson.dumps({**fields, "diagnostics": [diagnostic_object(f) for f in diagnostics]}) + b"\n"


def _columns(name: str, columns: Mapping[str, Column]) -> Iterator[bytes]:
    yield b", " + orjson.dumps(name) + b": {"
    for number, (column, values) in enumerate(columns.items()):
        yield (b", " if number else b"") + orjson.dumps(column) + b": "
        yield _column(values)
    yield b"}"


def _column(column: Column) -> bytes:
    if isinstance(column, CategoryColumn):
        categories = [orjson.dumps(category) for category in column.categories]
        return b"[" + b",".join(map(categories.__getitem__, column.codes.tolist())) + b"]"
    return orjson.dumps(np.ascontiguousarray(column), option=_NUMPY)


def rows_of(report: Report) -> Columns:
    """Return the rows as a table, with texts in place of their numbers."""
    table: Columns = dict(report.columns)
    return table | {
        name: CategoryColumn(codes=report.columns[name], categories=words) for name, words in report.words.items()
    }


def report_csv(report: Report) -> Iterator[bytes]:
    """Yield CSV: a header row, then one row per segment; a null is an empty field."""
    return csv_bytes(chunks(rows_of(report)))


def report_parquet(report: Report) -> Iterator[bytes]:
    """Yield Parquet: one row per segment; the metadata holds the totals as JSON."""
    table = rows_of(report)
    if "files" in report.notes:
        table["file"] = CategoryColumn(codes=report.columns["file"], categories=tuple(report.notes["files"]))
    about = {"schema": REPORT_SCHEMA.encode(), "job": report.job.encode(), "totals": orjson.dumps(report.totals)}
    if report.overrides:
        about["overrides"] = orjson.dumps(report.overrides)
    return parquet_bytes(chunks(table, _GROUP_ROWS), about)


def summary_csv(report: Report) -> Iterator[bytes]:
    """Yield the totals as CSV, one row per channel and power unit."""
    shared = {k: v for k, v in report.totals.items() if k not in _NOT_IN_CSV}
    per_channel = [{k: v for k, v in c.items() if k != "off_output"} for c in report.totals["channels"]] or [{}]
    header = list(chain(shared, per_channel[0]))
    yield (",".join(header) + "\r\n").encode()
    for entry in per_channel:
        values = [*shared.values(), *entry.values()]
        yield (",".join("" if v is None else str(v) for v in values) + "\r\n").encode()
