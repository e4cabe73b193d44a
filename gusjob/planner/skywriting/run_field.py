"""Check that run-ins and run-outs stay in the machine's field, as the job's own points do."""

from __future__ import annotations

from typing import Any

import numpy as np

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic
from gusjob.i18n.phrases import Phrase
from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.planner.plan import QuantizedPath
from gusjob.planner.row_diagnostics import report_rows

_RUN_IN, _RUN_OUT = Phrase("run-in"), Phrase("run-out")


def run_field_diagnostics(quantized: QuantizedPath) -> list[Diagnostic]:
    """Report every mark whose run-in or run-out leaves the field, at its worst point."""
    segments, machine = quantized.segments, quantized.machine
    axes = (
        ("X", machine.field_x_mm, machine.pulses_per_mm[0]),
        ("Y", machine.field_y_mm, machine.pulses_per_mm[1]),
    )
    if not len(segments.arc_at) and all(
        first <= points.min() and points.max() <= last
        for points, (first, last) in zip((segments.x1, segments.y1), machine.field_pulse, strict=True)
    ):
        return []
    run = quantized.sky.run_of(quantized.timed)
    runs = np.flatnonzero(run != RunKind.NONE)
    x_low, x_high, y_low, y_high = segments.extent(runs)
    collector = Collector(quantized.job.name)
    for (axis, (low, high), scale), (first, last), lowest, highest in zip(
        axes, machine.field_pulse, (x_low, y_low), (x_high, y_high), strict=True
    ):
        leaves = (np.rint(lowest) < first) | (np.rint(highest) > last)
        below, above = low - lowest / scale, highest / scale - high
        over = np.maximum(below, above)
        value = np.where(below > above, lowest / scale, highest / scale)
        for kind, what, word in ((RunKind.RUN_IN, _RUN_IN, "NPREV"), (RunKind.RUN_OUT, _RUN_OUT, "NPOST")):
            fields = {"what": what, "word": word, "axis": axis, "low": low, "high": high}
            outside = np.flatnonzero((run[runs] == kind) & leaves)
            _report(quantized, collector, runs[outside], over[outside], value[outside], fields)
    return collector.finish(rules.NOT_LISTED)


def _report(
    quantized: QuantizedPath, collector: Collector, at: Indices, over: Floats, value: Floats, fields: dict[str, Any]
) -> None:
    """Report some timed rows: one diagnostic a line, at its worst point."""
    worst = np.argsort(-over, kind="stable")

    def numbers(index: int) -> dict[str, Any]:
        which = worst[index]
        return {**fields, "value": round(float(value[which]), 6), "over": round(float(over[which]), 6)}

    report_rows(quantized, collector, rules.SKY_FIELD, quantized.timed[at[worst]], numbers)
