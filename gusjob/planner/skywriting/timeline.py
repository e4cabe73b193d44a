"""When a plan's motions run, and when what goes by a mark is to be called. For sky writing."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.ir.job import LaserDelay, LaserFpk, Op
from gusjob.kinematics.trapezoids import Trapezoids, reached_ends, running_sum, trapezoids
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import Plan
from gusjob.planner.velocity import starts_at_rest

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

ON, OFF = 1, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """When each timed row runs, (m,), and how fast; `times` (m+1,) ms, stages back to back. `stage` of each."""

    profile: Trapezoids
    times: Floats
    stage: Indices
    stage_first: Indices
    """(s+1,): number of each stage's first timed row."""


def timeline_of(state: Plan) -> Timeline:
    """When the motions of a plan run."""
    laid, timed = state.segments, state.timed
    assert laid is not None
    dwell = state.path.op[timed] == Op.DWELL
    breaks = starts_at_rest(state)
    vel, acc = np.where(dwell, 1.0, state.vel), np.where(dwell, 1.0, state.acc)
    end = np.where(dwell, 0.0, reached_ends(laid.length, vel, state.vel_end, acc, breaks))
    start = np.concatenate([[0.0], end[:-1]])
    start[breaks] = 0.0
    profile = trapezoids(laid.length, start, vel, end, acc)
    firsts = np.searchsorted(timed, [s.first for s in state.stages])
    return Timeline(
        profile=profile,
        times=running_sum(np.where(dwell, state.path.dwell_ms[timed], profile.duration_ms)),
        stage=np.searchsorted(firsts, np.arange(len(timed)), side="right") - 1,
        stage_first=np.append(firsts, len(timed)),
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


def events_of(state: Plan, timeline: Timeline) -> Events:
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
    stage = timeline.stage[ref]
    op = path.op[sky.row[open_]]
    what = np.where(op == Op.ON, ON, np.where(op == Op.OFF, OFF, 0))
    late_us = delays_us(state)[stage, path.channel[sky.row[open_]], what]
    time_ms = timeline.times[boundary]
    time_ms[goes] = timeline.times[ref + sky.at_end[open_]] + (sky.edge_us[open_] - late_us) / US_PER_MS
    return Events(row=row, boundary=boundary, goes=goes, ref=ref, stage=stage, op=op, late_us=late_us, time_ms=time_ms)


def delays_us(state: Plan) -> Floats:
    """How late an effect comes behind its call, (stages, channels, what): `ON` light on, `OFF` light off.

    The off delay of the first pulse killer counts; its gap does not: that is what SHIFT is for (RTC5 p. 115).
    """
    found = np.zeros((len(state.stages), 2, 3))
    on, off, killer = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    for number, stage in enumerate(state.stages):
        for setup in stage.setups:
            match setup.what:
                case LaserDelay(on_delay_us=on_us, off_delay_us=off_us):
                    on[setup.channel], off[setup.channel] = on_us, off_us
                case LaserFpk(times_us=times_us):
                    killer[setup.channel] = 0.0 if times_us is None else times_us[2]
                case _:
                    pass
        found[number, :, ON] = on
        found[number, :, OFF] = np.add(off, killer)
    return found
