"""Pass: end velocities. Where LOOKAHEAD is on, a corner is taken as fast as the velocity vector may change there."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Rule
from gusjob.ir.display import display_units
from gusjob.ir.intent import RunKind
from gusjob.ir.path import Op
from gusjob.ir.setup import LookAhead
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import starts_at_rest
from gusjob.kinematics.trapezoids import corner_velocity, look_ahead
from gusjob.planner.plan import Plan
from gusjob.planner.report_rows import report_rows


def velocities(state: Plan) -> Plan:
    """vel_end of every segment; a forced END that can't be met is a diagnostic."""
    laid, timed = state.segments, state.timed
    assert laid is not None
    n = len(timed)
    if not n:
        return state
    dwell = state.path.op[timed] == Op.DWELL
    jump = corner_jump(state)
    ahead = np.isfinite(jump)
    vel = path_velocity(state, jump)
    acc = np.where(dwell, 1.0, state.acc)
    smooth = state.sky.smooth[timed] if state.sky is not None else np.zeros(n, dtype=np.bool_)
    breaks = at_rest_before(state)
    limit = np.zeros(n)
    corner = corner_velocity(
        laid.end_x[:-1], laid.end_y[:-1], laid.start_x[1:], laid.start_y[1:], np.where(ahead, jump, 0.0)[:-1]
    )
    look = state.machine.lookahead_time_ms * state.machine.lookahead_acc_pulse_per_ms2
    corner = np.where(smooth[:-1], np.inf, corner)
    limit[:-1] = np.where((ahead | smooth)[:-1], np.minimum(np.minimum(vel[:-1], vel[1:]), corner), 0.0)
    limit[:-1][breaks[1:] | dwell[:-1] | dwell[1:]] = 0.0
    forced = np.isfinite(state.vel_end)
    limit = np.where(forced, np.minimum(state.vel_end, vel), limit)
    if not ahead.any() and not forced.any() and not smooth.any():
        vel_end = limit
    else:
        vel_end = np.minimum(look_ahead(laid.length, acc, limit, breaks), limit)
    collector = Collector(state.job.name)
    _report(state, collector, rules.END_UNREACHABLE, forced & (vel_end < state.vel_end * (1 - 1e-9)), vel_end)
    _report(state, collector, rules.END_AT_STOP, forced & (state.vel_end > 0) & np.append(breaks[1:], True), vel_end)
    # An END is taken as written; at a corner it may be more than look-ahead would allow, whether that is on or not.
    allowed = np.where(ahead, jump, look)[:-1]
    change = np.hypot(laid.start_x[1:] - laid.end_x[:-1], laid.start_y[1:] - laid.end_y[:-1])
    turns = np.append(np.where(forced, state.vel_end, 0.0)[:-1] * change, 0.0)
    sharp = forced & ~np.append(breaks[1:], True) & (turns > np.append(allowed, np.inf) * (1 + 1e-9))
    _report(state, collector, rules.CORNER_TOO_FAST, sharp, vel_end, jump=turns, limit=np.append(allowed, 0.0))
    return replace(
        state,
        vel=vel,
        vel_end=np.where(forced, state.vel_end, vel_end),
        diagnostics=(*state.diagnostics, *collector.done(rules.MORE)),
    )


def path_velocity(state: Plan, jump: Floats) -> Floats:
    """Velocity of each timed row, (m,) pulse/ms: as written, slower on arcs where look-ahead is on, 0 in a dwell."""
    vel = np.where(state.path.op[state.timed] == Op.DWELL, 0.0, state.vel)
    slows = np.isfinite(jump)
    if state.sky is not None:  # Its marks and runs have their speed already.
        slows &= state.sky.run[state.timed] == RunKind.NONE
    return np.where(slows, _slowed_on_arcs(state, vel), vel)


def stage_first(state: Plan) -> Indices:
    """Number of each stage's first timed row, and how many timed rows there are, (s+1,)."""
    return np.append(np.searchsorted(state.timed, [stage.first for stage in state.stages]), len(state.timed))


def at_rest_before(state: Plan) -> Bools:
    """Timed rows before which motion stands still, (m,): the first of a stage, dwells and what follows them."""
    dwell = state.path.op[state.timed] == Op.DWELL
    return np.asarray(dwell | starts_at_rest(dwell, stage_first(state)))


def corner_jump(state: Plan) -> Floats:
    """By how much the velocity vector may change behind each segment, pulse/ms, (m,); NaN where LOOKAHEAD is OFF."""
    machine = state.machine
    default = machine.lookahead_time_ms * machine.lookahead_acc_pulse_per_ms2
    jump = np.full(len(state.timed), default)
    for setup in state.job.setups:
        if isinstance(setup.statement, LookAhead):
            rows = state.origin[state.timed] if state.origin is not None else state.timed
            jump[rows >= setup.row] = _jump(setup.statement, state)
    return jump


def _jump(what: LookAhead, state: Plan) -> float:
    if what.corner is None:
        return math.nan
    time, acc = what.corner
    time = state.machine.lookahead_time_ms if math.isnan(time) else time
    acc = state.machine.lookahead_acc_pulse_per_ms2 if math.isnan(acc) else acc
    return time * acc


def _slowed_on_arcs(state: Plan, vel: Floats) -> Floats:
    """On an arc v^2/r stays within the machine's acceleration."""
    laid = state.segments
    assert laid is not None
    if not len(laid.arc_at):
        return vel
    slowed = vel.copy()
    fastest = np.sqrt(state.machine.max_acceleration_pulse_per_ms2 * laid.arcs.radius)
    slowed[laid.arc_at] = np.minimum(vel[laid.arc_at], fastest)
    return slowed


def _report(state: Plan, collector: Collector, rule: Rule, where: Bools, reached: Floats, **columns: Floats) -> None:
    """A diagnostic at the END of every segment in `where`."""
    at = np.flatnonzero(where)
    path, timed, shown = state.path, state.timed, display_units(state.job, state.machine)
    values = {"value": state.vel_end, "high": reached, **columns}

    def fields(index: int) -> dict[str, Any]:
        i = at[index]
        # As written: where the axes differ, a velocity in mm is another one in pulses for each direction.
        written = float(path.end[timed[i]] / state.vel_end[i]) if state.vel_end[i] > 0 else 1.0
        shares = {name: float(column[i]) * written * shown.per_pulse_per_ms for name, column in values.items()}
        return {**shares, "speed": shown.speed}

    report_rows(state, collector, rule, timed[at], fields, "END")
