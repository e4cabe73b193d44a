"""Marks of a plan that are too short to reach their velocity."""

from __future__ import annotations

from typing import Any

import numpy as np

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic
from gusjob.ir.display import display_units
from gusjob.ir.modal import modal_state
from gusjob.ir.short_marks import PlannedSpeeds, short_marks
from gusjob.kinematics.arrays import Floats
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
    row = plan.origin[plan.timed]
    start = np.concatenate([[0.0], plan.vel_end])[: len(row)]
    start[at_rest_before(plan)] = 0.0
    scale = _per_pulse_of_x(plan)
    length, vel, acc = plan.segments.length / scale, plan.vel / scale, plan.acc / scale
    start, end = start / scale, plan.vel_end / scale
    return PlannedSpeeds(
        row=row,
        op=plan.path.op[plan.timed],
        length=length,
        asked=plan.path.vel[plan.timed],
        vel=vel,
        acc=acc,
        start=start,
        peak=peak_velocity(length, start, vel, end, acc),
        end=end,
        is_sky=plan.job.sky_writing_by_row()[0][row] >= 0,
    )


def _per_pulse_of_x(plan: Plan) -> Floats | float:
    """Pulses along each timed row for a pulse of X, by its direction; 1 where the job is in pulses."""
    if plan.machine.equal_axes or plan.job.in_pulses:
        return 1.0
    segments = plan.segments
    return direction_scale(
        *segments.start_direction(np.arange(len(plan.timed))), segments.arc_at, plan.machine.pulses_per_mm
    )
