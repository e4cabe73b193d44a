"""Marks of a plan that are too short to reach their velocity."""

from __future__ import annotations

from typing import Any

import numpy as np

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic
from gusjob.ir.display import display_units
from gusjob.ir.modal import modal_state
from gusjob.ir.short_marks import PlannedSpeeds, short_marks
from gusjob.kinematics.arrays import Floats, picked, rows_of
from gusjob.kinematics.trapezoids import peak_velocity
from gusjob.planner.plan import Plan
from gusjob.planner.quantize import direction_scale
from gusjob.planner.row_diagnostics import report_rows
from gusjob.planner.velocity import at_rest_before


def slow_mark_diagnostics(plan: Plan) -> list[Diagnostic]:
    """Report the marks that are too short for their velocity."""
    found = short_marks(modal_state(plan.job), _speeds(plan))
    if not len(found):
        return []
    shown, collector = display_units(plan.job, plan.machine), Collector(plan.job.name)

    def fields(index: int) -> dict[str, Any]:
        return found.fields(index, shown, plan.machine)

    report_rows(plan, collector, rules.MARK_TOO_SHORT, plan.timed[found.at], fields)
    return collector.finish(rules.NOT_LISTED)


def _speeds(plan: Plan) -> PlannedSpeeds:
    rows = rows_of(plan.timed)
    row = plan.origin[rows]
    start = np.concatenate([[0.0], plan.vel_end])[: len(row)]
    start[at_rest_before(plan)] = 0.0
    length, vel, acc, end = plan.segments.length, plan.vel, plan.acc, plan.vel_end
    if (scale := _per_pulse_of_x(plan)) is not None:
        length, vel, acc, start, end = (values / scale for values in (length, vel, acc, start, end))
    return PlannedSpeeds(
        row=row,
        op=plan.path.op[rows],
        length=length,
        asked=picked(plan.path.vel, rows),
        vel=vel,
        acc=acc,
        start=start,
        peak=peak_velocity(length, start, vel, end, acc),
        end=end,
        is_sky=plan.job.sky_writing_by_row()[0][row] >= 0,
    )


def _per_pulse_of_x(plan: Plan) -> Floats | None:
    """Pulses along each timed row for a pulse of X, by its direction; None where that is 1 everywhere."""
    if plan.machine.equal_axes or plan.job.in_pulses:
        return None
    segments = plan.segments
    return direction_scale(
        *segments.start_direction(np.arange(len(plan.timed))), segments.arc_at, plan.machine.pulses_per_mm
    )
