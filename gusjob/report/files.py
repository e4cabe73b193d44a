"""Reports and diagnostics as JSON and CSV: written column by column, so that a million rows stay small in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import chain
from typing import Any

import numpy as np
import orjson

from gusjob.diagnostics.model import Diagnostic
from gusjob.report.rows import REPORT_SCHEMA, Report
from gusjob.tables.columns import CategoryColumn, Column, Columns, chunks
from gusjob.tables.export import csv_bytes, parquet_bytes

_NUMPY = orjson.OPT_SERIALIZE_NUMPY
_NOT_IN_CSV = {"channels", "marking", "run_in_mm", "run_out_mm"}
_GROUP_ROWS = 1 << 17
"""Rows of a Parquet row group."""


def diagnostic_object(diagnostic: Diagnostic) -> dict[str, Any]:
    """One diagnostic as in the JSON; `count` and `notes` only where they say something."""
    span = diagnostic.span
    found: dict[str, Any] = {
        "path": diagnostic.file,
        "line": span.line,
        "column": span.column,
        "end_line": max(span.end_line, span.line),
        "end_column": max(span.end_column, span.column),
        "severity": diagnostic.severity.value,
        "code": diagnostic.rule.code,
        "message": diagnostic.message,
    }
    if diagnostic.count > 1:
        found["count"] = diagnostic.count
    if diagnostic.remarks:
        found["notes"] = [
            {
                "path": r.span.path or diagnostic.path,
                "line": r.span.line,
                "column": r.span.column,
                "end_line": max(r.span.end_line, r.span.line),
                "end_column": max(r.span.end_column, r.span.column),
                "message": r.message,
            }
            for r in diagnostic.remarks
        ]
    return found


def check_json(diagnostics: Iterable[Diagnostic], statistics: dict[str, int] | None = None) -> bytes:
    """gusjob-check/1; `statistics`: diagnostics by rule."""
    found: dict[str, Any] = {"schema": "gusjob-check/1", "diagnostics": [diagnostic_object(f) for f in diagnostics]}
    if statistics is not None:
        found["statistics"] = statistics
    return orjson.dumps(found, option=orjson.OPT_INDENT_2)


def report_json(report: Report, diagnostics: Iterable[Diagnostic], *, summary: bool) -> Iterator[bytes]:
    """gusjob-report/1 in pieces."""
    yield b'{"schema": ' + orjson.dumps(REPORT_SCHEMA) + b', "job": ' + orjson.dumps(report.job)
    yield b', "period_us": ' + orjson.dumps(report.period_us)
    yield b', "totals": ' + orjson.dumps(report.totals)
    for name, value in report.notes.items():
        yield b", " + orjson.dumps(name) + b": " + orjson.dumps(value)
    if not summary:
        yield from _columns("segments", rows_of(report))
        yield from [b', "marks": null'] if report.marks is None else _columns("marks", report.marks)
    yield b', "diagnostics": ' + orjson.dumps([diagnostic_object(f) for f in diagnostics]) + b"}\n"


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
    """The rows as a table, with words where they are meant."""
    table: Columns = dict(report.columns)
    return table | {
        name: CategoryColumn(codes=report.columns[name], categories=words) for name, words in report.words.items()
    }


def report_csv(report: Report) -> Iterator[bytes]:
    """One row a segment, a header row first; nothing where a power is null."""
    return csv_bytes(chunks(rows_of(report)))


def report_parquet(report: Report) -> Iterator[bytes]:
    """One row a segment; the totals stand as JSON in the file's metadata."""
    table = rows_of(report)
    if "files" in report.notes:
        table["file"] = CategoryColumn(codes=report.columns["file"], categories=tuple(report.notes["files"]))
    about = {"schema": REPORT_SCHEMA.encode(), "job": report.job.encode(), "totals": orjson.dumps(report.totals)}
    return parquet_bytes(chunks(table, _GROUP_ROWS), about)


def summary_csv(report: Report) -> Iterator[bytes]:
    """The totals, one row a channel and unit."""
    shared = {k: v for k, v in report.totals.items() if k not in _NOT_IN_CSV}
    per_channel = [{k: v for k, v in c.items() if k != "off_output"} for c in report.totals["channels"]] or [{}]
    header = list(chain(shared, per_channel[0]))
    yield (",".join(header) + "\r\n").encode()
    for entry in per_channel:
        values = [*shared.values(), *entry.values()]
        yield (",".join("" if v is None else str(v) for v in values) + "\r\n").encode()
