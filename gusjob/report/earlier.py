"""Reader of an earlier report's JSON. The file is not trusted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import orjson
from msgspec import Struct, field

from gusjob.controllers.gus.ranges import PowerMode
from gusjob.i18n.phrases import Phrase, all_of, printable, reason_of
from gusjob.inputs import open_input
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.kinematics.arrays import Floats
from gusjob.report.rows import REPORT_SCHEMA
from gusjob.simulate.kinds import SegmentKind

Columns = Mapping[str, npt.NDArray[Any]]
Key = tuple[str, int | None, str | None]
"""A total: its name, and its channel and power unit if it has them."""

MAX_EARLIER_MB = 1000

CHANNELS = (0, 1)
_UNITS = {mode.unit for mode in PowerMode}
POWERS = ("power_min", "power_mean", "power_max", "power_ms")
"""Columns in the channel's power unit; values in different units are not compared."""
FIGURES = ("emission_ms", *POWERS, "joules")
COUNTS = ("segments", "stages")
_LENGTHS = ("duration_ms", "mark_mm", "jump_mm")
ANY_UNIT = ("emission_ms", "joules", "lit_at_end")
_TOTALS = (*ANY_UNIT, "power_ms", "power_max", "clamped_ms", "before_motion_power_ms")
_REQUIRED = {"segments", *_LENGTHS, "emission_ms", "joules", "power_ms", "power_max"}
_OFF_OUTPUT = ("standby_khz", "standby_pct", "prevoltage_v")


class EarlierReport(Struct, frozen=True, kw_only=True):
    """An earlier report, validated.

    `columns`: as in a Report, NaN for null; None if it has totals only. `overrides`: the values of LETs that its job
    was run with.
    """

    path: str
    job: str
    totals: dict[Key, float]
    columns: Columns | None
    overrides: Overrides = field(default_factory=lambda: NO_OVERRIDES)


class _NotAReportError(Exception):
    """A file is not a report, with the reason."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def read_earlier(path: Path) -> tuple[EarlierReport | None, str]:
    """Read the report in a JSON file.

    Returns:
        The report and ''; None and the reason if the file is not a report.
    """
    try:
        with open_input(path) as file:
            data = file.read(MAX_EARLIER_MB * 1_000_000 + 1)
        return _parse(printable(str(path)), data.removeprefix(b"\xef\xbb\xbf")), ""
    except OSError as error:
        why = reason_of(error)
        return None, Phrase("can't read this file: {why}", why=why)
    except _NotAReportError as error:
        return None, error.reason
    except ValueError:  # A NUL in the name.
        return None, Phrase("can't read this file: the name is not valid")


def _parse(path: str, data: bytes) -> EarlierReport:
    if len(data) > MAX_EARLIER_MB * 1_000_000:
        raise _NotAReportError(Phrase("this file is too large; gusjob reads up to {most} MB", most=MAX_EARLIER_MB))
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise _NotAReportError(Phrase("it looks like UTF-16; write the report with -o"))
    try:
        found = orjson.loads(data)
    except orjson.JSONDecodeError as error:
        reason = Phrase(
            "this is not JSON: {why} (line {line}, column {column})",
            why=printable(error.msg[:80]),
            line=error.lineno,
            column=error.colno,
        )
        raise _NotAReportError(reason) from None
    if type(found) is not dict or found.get("schema") != REPORT_SCHEMA:
        reason = Phrase('this is not a JSON report of gusjob (schema "{schema}")', schema=REPORT_SCHEMA)
        raise _NotAReportError(reason)
    if found.get("totals", found) is None:
        raise _NotAReportError(Phrase("this is the report of a job with errors, which was not simulated"))
    totals = flat_totals(_typed(found, "totals", dict)) | {("period_us", None, None): _figure(found, "period_us")}
    columns = _columns(_typed(found, "segments", dict)) if "segments" in found else None
    overrides = _overrides(_typed(found, "overrides", dict)) if "overrides" in found else NO_OVERRIDES
    job = printable(_typed(found, "job", str))
    return EarlierReport(path=path, job=job, totals=totals, columns=columns, overrides=overrides)


def _overrides(found: dict[str, Any]) -> Overrides:
    if not all(type(value) is str for value in found.values()):
        raise _NotAReportError(Phrase("overrides contains a value that is not a JSON string"))
    return {printable(name): printable(value) for name, value in found.items()}


_JSON_WORDS: dict[type, str] = {
    dict: Phrase("object"),
    list: Phrase("array"),
    str: Phrase("string"),
    int: Phrase("whole number"),
}


def _typed(holder: dict[str, Any], name: str, expected: type) -> Any:
    if type(holder.get(name)) is not expected:
        what = Phrase("{name} is not a JSON {wanted}", name=name, wanted=_JSON_WORDS[expected])
        raise _NotAReportError(what if name in holder else _missing(name))
    return holder[name]


def _missing(name: str) -> Phrase:
    return Phrase("{name} is missing", name=name)


def _figure(holder: dict[str, Any], name: str, *kinds: type) -> float:
    """Return a number, or a value of one of `kinds`, as a float; null is NaN."""
    if type(value := holder.get(name)) not in (int, float, *kinds) or name not in holder:
        raise _NotAReportError(Phrase("{name} is not a number", name=name) if name in holder else _missing(name))
    return float("nan") if value is None else float(value)


def flat_totals(totals: dict[str, Any]) -> dict[Key, float]:
    """Flatten the totals of a report. Those of an earlier version of gusjob may be incomplete."""
    flat: dict[Key, float] = {
        (name, None, None): _figure(totals, name)
        for name in (*COUNTS, *_LENGTHS)
        if name in totals or name in _REQUIRED
    }
    for entry in _typed(totals, "channels", list):
        if type(entry) is not dict:
            raise _NotAReportError(Phrase("channels contains a value that is not a JSON object"))
        channel, unit = _typed(entry, "channel", int), _typed(entry, "unit", str)
        if channel not in CHANNELS or unit not in _UNITS:
            raise _NotAReportError(Phrase("channels contains an unknown channel or unit"))
        for name in _TOTALS:
            if name in entry or name in _REQUIRED:
                flat[name, channel, unit] = _figure(entry, name, bool if name == "lit_at_end" else type(None))
        if "off_output" in entry:
            off = {} if entry["off_output"] is None else _typed(entry, "off_output", dict)
            for name in _OFF_OUTPUT:
                flat[name, channel, unit] = _figure(off, name) if name in off else float("nan")
    return flat


def _columns(found: dict[str, Any]) -> Columns:
    """Return the columns that are compared, all of one length."""
    names = ["line", "x_mm", "y_mm", "duration_ms"]
    for channel in CHANNELS:
        here = [f"ch{channel}_{figure}" for figure in FIGURES]
        names += here if found.keys() & set(here) else []
    columns: dict[str, npt.NDArray[Any]] = {name: _figures(found, name) for name in names}
    columns["kind"] = _kinds(_typed(found, "kind", list))
    if len({len(column) for column in columns.values()}) > 1:
        raise _NotAReportError(Phrase("the columns of segments differ in length"))
    lines = columns["line"]
    if not ((lines == np.floor(lines)) & (lines >= 0) & (lines < 2**53)).all():
        raise _NotAReportError(Phrase("line contains a value that is not a line number"))
    return {**columns, "line": lines.astype(np.int64)}


def _figures(found: dict[str, Any], name: str) -> Floats:
    values = _typed(found, name, list)
    if not set(map(type, values)) <= {int, float, type(None)}:
        raise _NotAReportError(Phrase("{name} contains a value that is not a number", name=name))
    return np.array(values, dtype=np.float64)  # None becomes NaN.


def _kinds(words: list[Any]) -> npt.NDArray[np.int8]:
    numbers = {kind.word: kind.value for kind in SegmentKind}
    if set(map(type, words)) - {str} or set(words) - numbers.keys():
        raise _NotAReportError(Phrase("kind contains a value that is not one of {words}", words=all_of(numbers)))
    return np.array([numbers[word] for word in words], dtype=np.int8)
