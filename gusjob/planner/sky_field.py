"""Run-ins and run-outs stay in the machine's field, as the job's own points do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gusjob import rules
from gusjob.diagnostics import Collector
from gusjob.planner.plan import Plan
from gusjob.stream import Run

_SLACK_MM = 1e-6


def outside_field(state: Plan) -> Plan:
    """The plan, with a fault for every mark whose run-in or run-out leaves the field, at its worst."""
    laid, sky, machine = state.segments, state.sky, state.machine
    assert laid is not None and sky is not None
    x_low, x_high = np.minimum(laid.x0, laid.x1), np.maximum(laid.x0, laid.x1)
    y_low, y_high = np.minimum(laid.y0, laid.y1), np.maximum(laid.y0, laid.y1)
    if len(laid.arc_at):
        x_low[laid.arc_at], x_high[laid.arc_at], y_low[laid.arc_at], y_high[laid.arc_at] = laid.arcs.extent()
    collector = Collector(state.job.name)
    run = sky.run[state.timed]
    for axis, lowest, highest, (low, high), scale in (
        ("X", x_low, x_high, machine.field_x_mm, machine.pulses_per_mm[0]),
        ("Y", y_low, y_high, machine.field_y_mm, machine.pulses_per_mm[1]),
    ):
        below, above = low - lowest / scale, highest / scale - high
        over = np.where(run != Run.NONE, np.maximum(below, above), -np.inf)
        value = np.where(below > above, lowest / scale, highest / scale)
        for kind, what, word in ((Run.RUN_IN, "run-in", "NPREV"), (Run.RUN_OUT, "run-out", "NPOST")):
            fields = {"what": what, "word": word, "axis": axis, "low": low, "high": high}
            _report(state, collector, np.where(run == kind, over, -np.inf), value, fields)
    return replace(state, diagnostics=(*state.diagnostics, *collector.done(rules.MORE)))


def _report(state: Plan, collector: Collector, over: Any, value: Any, fields: dict[str, Any]) -> None:
    """One fault a line, where it is worst."""
    at = np.flatnonzero(over > _SLACK_MM)
    at = at[np.argsort(-over[at], kind="stable")]
    rows = state.timed[at]
    _, first, counts = np.unique(state.path.line[rows], return_index=True, return_counts=True)
    listed = collector.room(rules.SKY_FIELD)
    for i, count in zip(at[first[:listed]].tolist(), counts[:listed].tolist(), strict=True):
        row = int(state.timed[i])
        span, remarks = state.job.locate(int(state.path.line[row]), ""), state.job.remarks(int(state.path.trail[row]))
        numbers = {"value": round(float(value[i]), 6), "over": round(float(over[i]), 6)}
        collector.add(rules.SKY_FIELD, span, {**fields, **numbers}, count, remarks)
    collector.uncounted(rules.SKY_FIELD, max(len(first) - listed, 0))
