"""The content of a run's page: rows and marks of the report, the path in strokes, and facts about them."""

from __future__ import annotations

from math import ceil, floor, log10
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.units import MS_PER_S
from gusjob.report.answer import Answer
from gusjob.report.rows import Report
from gusjob.simulate.kinds import SegmentKind
from gusjob.version import __version__
from gusjob.view.page.render import Page
from gusjob.view.strokes import EmissionStrokes, Strokes, undrawn_emission

PAGE_SCHEMA = "gusjob-page/1"
MAX_SEGMENTS = 2_000_000
"""Maximum number of segments that a browser can show."""

Table = dict[str, npt.NDArray[Any]]


def page_of(
    report: Report,
    strokes: Strokes,
    machine: Machine,
    diagnostics: list[dict[str, Any]],
    watched: str = "",
    answer: Answer | None = None,
) -> Page:
    """Make the page of a run. `diagnostics`: as in the JSON, each with the text of its line as `source`."""
    tables = {"rows": report.columns, "strokes": _strokes_table(strokes)}
    if report.marks:
        tables["marks"] = {**report.marks, "row": _rows_of_marks(report)}
    facts = {
        "schema": PAGE_SCHEMA,
        "job": report.job,
        "version": __version__,
        "period_us": report.period_us,
        "totals": report.totals,
        "notes": report.notes,
        "field_mm": {"x": list(machine.field_x_mm), "y": list(machine.field_y_mm)},
        "start_mm": _start(strokes.path.x0, strokes.path.y0),
        "kinds": [kind.word for kind in SegmentKind],
        "channels": [_channel_facts(emission) for emission in strokes.emissions],
        "exact": strokes.exact,
        "units_per_mm": _units_per_mm(strokes, machine),
        "remarks": [text for emission in strokes.emissions for text in undrawn_emission(report, strokes, emission)],
    }
    if report.overrides:
        facts["overrides"] = dict(report.overrides)
    if strokes.beam is not None:
        facts["beam_start_mm"] = _start(strokes.beam.x0, strokes.beam.y0)
    return Page(
        facts=facts,
        tables=tables,
        diagnostics=diagnostics,
        marking=report.totals["marking"],
        watched=watched,
        answer=answer,
    )


def page_without_run(
    job: str,
    diagnostics: list[dict[str, Any]],
    watched: str = "",
    reason: str = "",
    overrides: Overrides = NO_OVERRIDES,
) -> Page:
    """Make the page of a job that was not run, or that can't be shown for a reason."""
    facts: dict[str, Any] = {"schema": PAGE_SCHEMA, "job": job, "version": __version__, "reason": reason}
    if overrides:
        facts["overrides"] = dict(overrides)
    return Page(facts=facts, tables={}, diagnostics=diagnostics, marking=None, watched=watched)


def _units_per_mm(strokes: Strokes, machine: Machine) -> float:
    """Return the units of the coordinates, as fine as 32 bits allow: energy per mm depends on lengths below 1 um.

    The strokes of long runs end at whole pulses; a unit of a pulse is fine enough there.
    """
    lines = [strokes.path] if strokes.beam is None else [strokes.path, strokes.beam]
    ends = [np.abs(end).max(initial=1.0) for line in lines for end in (line.x0, line.y0, line.x1, line.y1)]
    finest = floor(log10(np.iinfo(np.int32).max / max(ends)))
    coarse = max(4, ceil(log10(max(machine.pulses_per_mm))))
    return float(10.0 ** min(finest, 7 if strokes.exact else coarse))


def _strokes_table(strokes: Strokes) -> Table:
    table: Table = {
        "row": strokes.row.astype(np.int32),
        "duration_ms": strokes.duration_ms,
        "x_mm": strokes.path.x1,
        "y_mm": strokes.path.y1,
        "vel0": strokes.vel0,
        "vel1": strokes.vel1,
    }
    if strokes.beam is not None:
        table |= {"beam_x_mm": strokes.beam.x1, "beam_y_mm": strokes.beam.y1}
    for emission in strokes.emissions:
        name = f"ch{emission.channel}_"
        table |= {
            f"{name}on": emission.on.astype(np.int8),
            f"{name}power": emission.power,
            f"{name}per_mm": emission.per_mm,
        }
        if len(emission.units) > 1:
            table[f"{name}unit"] = emission.unit
    return table


def _channel_facts(emission: EmissionStrokes) -> dict[str, Any]:
    watts = np.unique(emission.joules_per_unit_ms) * MS_PER_S
    facts: dict[str, Any] = {
        "channel": emission.channel,
        "unit": emission.units[0],
        "peak_per_mm": [None if np.isnan(peak) else peak for peak in emission.peak_per_mm.tolist()],
        "watts_per_unit": float(watts[0]) if len(watts) == 1 and not np.isnan(watts[0]) else None,
    }
    if len(emission.units) > 1:
        facts["units"] = list(emission.units)
    return facts


def _start(x: Floats, y: Floats) -> list[float]:
    return [float(x[0]), float(y[0])] if len(x) else [0.0, 0.0]


def _rows_of_marks(report: Report) -> npt.NDArray[np.int32]:
    """Return the segment in which each mark begins."""
    assert report.marks is not None
    row = np.searchsorted(report.columns["start_ms"], report.marks["start_ms"], side="right") - 1
    return np.asarray(np.clip(row, 0, max(len(report) - 1, 0)), dtype=np.int32)
