"""When a plan's motions run, and when what goes by a mark is to be called. For sky writing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.ir.path import Op
from gusjob.ir.setup import LaserDelay, LaserFpk
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.schedule import Schedule, schedule
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import Plan
from gusjob.planner.velocity import stage_first

ON, OFF = 1, 2


def schedule_of(state: Plan) -> Schedule:
    """Schedule the motions of a plan."""
    laid, timed = state.segments, state.timed
    assert laid is not None
    return schedule(
        length=laid.length,
        vel=state.vel,
        acc=state.acc,
        vel_end=state.vel_end,
        dwell=state.path.op[timed] == Op.DWELL,
        dwell_ms=state.path.dwell_ms[timed],
        stage_first=stage_first(state),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Events:
    """Rows that act in between, (e,) in job order.

    boundary: how many timed rows stand before; time_ms: when it is to be called. Of those still to be placed, (g,):
    `goes`, which of the events; `ref`, the mark's number among the timed rows; its stage; their op; late_us: how late
    the effect comes behind the call.
    """

    row: Indices
    boundary: Indices
    time_ms: Floats
    goes: Indices
    ref: Indices
    stage: Indices
    op: npt.NDArray[np.uint8]
    late_us: Floats


def events_of(state: Plan, schedule: Schedule) -> Events:
    """What acts in between the motions of a plan."""
    path, sky = state.path, state.sky
    assert sky is not None
    takes_time = path.takes_time
    timed_before: Indices = np.cumsum(takes_time) - takes_time
    open_ = np.flatnonzero(~sky.placed)
    row = np.flatnonzero(~takes_time)
    boundary = timed_before[row]
    goes = (np.cumsum(~takes_time) - 1)[sky.row[open_]]
    ref = timed_before[sky.ref[open_]]
    stage = schedule.stage[ref]
    op = path.op[sky.row[open_]]
    what = np.where(op == Op.ON, ON, np.where(op == Op.OFF, OFF, 0))
    late_us = delays_us(state)[stage, path.channel[sky.row[open_]], what]
    time_ms = schedule.times_ms[boundary]
    time_ms[goes] = schedule.times_ms[ref + sky.at_end[open_]] + (sky.edge_us[open_] - late_us) / US_PER_MS
    return Events(row=row, boundary=boundary, goes=goes, ref=ref, stage=stage, op=op, late_us=late_us, time_ms=time_ms)


def delays_us(state: Plan) -> Floats:
    """How late an effect comes behind its call, (stages, channels, what): `ON` light on, `OFF` light off.

    The off delay of the first pulse killer counts; its gap does not: that is what SHIFT is for (RTC5 p. 115).
    """
    found = np.zeros((len(state.stages), 2, 3))
    on, off, killer = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    for number, stage in enumerate(state.stages):
        for setup in stage.setups:
            match setup.statement:
                case LaserDelay(on_delay_us=on_us, off_delay_us=off_us):
                    on[setup.channel], off[setup.channel] = on_us, off_us
                case LaserFpk(times_us=times_us):
                    killer[setup.channel] = 0.0 if times_us is None else times_us[2]
                case _:
                    pass
        found[number, :, ON] = on
        found[number, :, OFF] = np.add(off, killer)
    return found
