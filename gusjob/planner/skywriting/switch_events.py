"""Events between the motions of a path: switches and powers, and when each has to be called."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.ir.path import Op
from gusjob.ir.setup import LaserDelay, LaserFpk
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.schedule import Schedule, schedule
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import PlannedPath, StagedPath

ON, OFF = 1, 2
"""Index of laser-on and laser-off in delays_us; 0 is a power, which has no delay."""


class PlannedEvents(Struct, frozen=True, kw_only=True, eq=False):
    """Rows that act between motions, (e,) in job order, and those of them that are still to be placed, (g,).

    Of all (e,): `row`: row of the path. `boundary`: number of timed rows before it. `time_ms`: time of the call.

    Of those to be placed (g,): `moved`: number among the events. `mark`: number of the mark among the timed rows.
    `stage`: number of the stage. `op`: Op of the row. `late_us`: delay of the effect after the call.
    """

    row: Indices
    boundary: Indices
    time_ms: Floats
    moved: Indices
    mark: Indices
    stage: Indices
    op: npt.NDArray[np.uint8]
    late_us: Floats


def schedule_of(planned: PlannedPath) -> Schedule:
    """Schedule the motions of a path."""
    return schedule(
        length=planned.segments.length,
        vel=planned.vel,
        acc=planned.acc,
        vel_end=planned.vel_end,
        dwell=planned.is_dwell,
        dwell_ms=planned.path.dwell_ms[planned.timed],
        stage_first=planned.stage_first,
    )


def switch_events(planned: PlannedPath, schedule: Schedule) -> PlannedEvents:
    """Collect what acts between the motions of a path, with the time at which it has to be called."""
    path, marked = planned.path, planned.sky.events
    takes_time = path.takes_time
    timed_before: Indices = np.cumsum(takes_time) - takes_time
    open_ = np.flatnonzero(~marked.placed)
    row = np.flatnonzero(~takes_time)
    boundary = timed_before[row]
    moved = (np.cumsum(~takes_time) - 1)[marked.row[open_]]
    mark = timed_before[marked.mark_row[open_]]
    stage = schedule.stage[mark]
    op = path.op[marked.row[open_]]
    what = np.where(op == Op.ON, ON, np.where(op == Op.OFF, OFF, 0))
    late_us = delays_us(planned)[stage, path.channel[marked.row[open_]], what]
    time_ms = schedule.times_ms[boundary]
    time_ms[moved] = schedule.times_ms[mark + marked.at_end[open_]] + (marked.effect_us[open_] - late_us) / US_PER_MS
    return PlannedEvents(
        row=row,
        boundary=boundary,
        moved=moved,
        mark=mark,
        stage=stage,
        op=op,
        late_us=late_us,
        time_ms=time_ms,
    )


def delays_us(staged: StagedPath) -> Floats:
    """Compute the delay of an effect after its call, (stages, channels, 3) by ON and OFF.

    The off delay of the first pulse killer counts; its gap does not: SHIFT compensates for it (RTC5 p. 115).
    """
    count = len(CHANNELS)
    found = np.zeros((len(staged.stages), count, 3))
    on, off, killer = np.zeros(count), np.zeros(count), np.zeros(count)
    for number, stage in enumerate(staged.stages):
        for setup in stage.setups:
            match setup.statement:
                case LaserDelay(on_delay_us=on_us, off_delay_us=off_us):
                    on[setup.channel], off[setup.channel] = on_us, off_us
                case LaserFpk(times_us=times_us):
                    killer[setup.channel] = 0.0 if times_us is None else times_us[2]
                case _:
                    pass
        found[number, :, ON] = on
        found[number, :, OFF] = off + killer
    return found
