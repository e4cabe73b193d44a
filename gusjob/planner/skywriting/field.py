"""Pass: run-ins and run-outs stay in the machine's field, as the job's own points do."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector
from gusjob.i18n.phrases import Phrase
from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.planner.plan import Plan
from gusjob.planner.report_rows import report_rows

_RUN_IN, _RUN_OUT = Phrase("run-in"), Phrase("run-out")
_SLACK_PULSE = 1.5
"""Rounding to whole pulses may take a run so far."""


def stays_in_field(state: Plan) -> Plan:
    """The plan, with a diagnostic for every mark whose run-in or run-out leaves the field, at its worst."""
    laid, sky, machine = state.segments, state.sky, state.machine
    if laid is None or sky is None:
        return state
    if not len(laid.arc_at) and all(
        low <= points.min() / scale and points.max() / scale <= high
        for points, (low, high), scale in (
            (laid.x1, machine.field_x_mm, machine.pulses_per_mm[0]),
            (laid.y1, machine.field_y_mm, machine.pulses_per_mm[1]),
        )
    ):
        return state
    run = sky.run[state.timed]
    runs = np.flatnonzero(run != RunKind.NONE)
    x_low, x_high, y_low, y_high = laid.extent(runs)
    collector = Collector(state.job.name)
    for axis, lowest, highest, (low, high), scale in (
        ("X", x_low, x_high, machine.field_x_mm, machine.pulses_per_mm[0]),
        ("Y", y_low, y_high, machine.field_y_mm, machine.pulses_per_mm[1]),
    ):
        below, above = low - lowest / scale, highest / scale - high
        over = np.maximum(below, above)
        value = np.where(below > above, lowest / scale, highest / scale)
        for kind, what, word in ((RunKind.RUN_IN, _RUN_IN, "NPREV"), (RunKind.RUN_OUT, _RUN_OUT, "NPOST")):
            fields = {"what": what, "word": word, "axis": axis, "low": low, "high": high}
            mine = np.flatnonzero((run[runs] == kind) & (over > _SLACK_PULSE / scale))
            _report(state, collector, runs[mine], over[mine], value[mine], fields)
    return replace(state, diagnostics=(*state.diagnostics, *collector.done(rules.MORE)))


def _report(
    state: Plan, collector: Collector, at: Indices, over: Floats, value: Floats, fields: dict[str, Any]
) -> None:
    """One diagnostic a line, where it is worst."""
    worst = np.argsort(-over, kind="stable")

    def numbers(index: int) -> dict[str, Any]:
        which = worst[index]
        return {**fields, "value": round(float(value[which]), 6), "over": round(float(over[which]), 6)}

    report_rows(state, collector, rules.SKY_FIELD, state.timed[at[worst]], numbers)
