"""What sky writing can't do as asked: switch where no motion is left, be at speed at both ends of every mark."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob import rules
from gusjob.checks.view import CHANNELS
from gusjob.diagnostics import Collector, Diagnostic, Rule
from gusjob.job import Op, shown_units
from gusjob.planner.plan import Plan
from gusjob.planner.timeline import Events, Timeline
from gusjob.units import US_PER_MS

Indices = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]

_NO_TIME_US = 1e-6
_AT_SPEED = 0.02
"""By how much of it a mark's speed may be missed at its ends: rounding of small circles makes as much."""


def switch_faults(state: Plan, timeline: Timeline, events: Events) -> list[Diagnostic]:
    """Where a switch can't come when it should: no motion runs then, or it would come before what it follows."""
    times = timeline.times
    collector = Collector(state.job.name)
    rows, time = state.timed[events.ref], events.time_ms[events.goes]
    channels = state.path.channel[events.row[events.goes]]
    cell = np.minimum(np.searchsorted(times[1:], time, side="left"), len(timeline.stage) - 1)
    dwell = state.path.op[state.timed[cell]] == Op.DWELL
    waited = np.zeros(len(events.row))
    for channel in CHANNELS:
        mine = np.flatnonzero(state.path.channel[events.row] == channel)
        waited[mine] = np.maximum.accumulate(events.time_ms[mine]) - events.time_ms[mine]
    before_us = (times[timeline.stage_first[events.stage]] - time) * US_PER_MS
    behind_us = (time - times[timeline.stage_first[events.stage + 1]]) * US_PER_MS
    into_us = np.where(dwell, np.minimum(time - times[cell], times[cell + 1] - time), 0.0) * US_PER_MS
    lost_us = waited[events.goes] * US_PER_MS
    for what, switch in (("on", events.op == Op.ON), ("off", events.op == Op.OFF)):
        delay = f"shorten LASER DELAY {what.upper()}"
        for amount, where, mend in (
            (before_us, "before the motion begins", f"{delay}, or raise NPREV"),
            (behind_us, "behind the end of the motion", "raise NPOST"),
            (into_us, "into a DWELL", f"raise NPOST, or {delay}"),
            (lost_us if what == "on" else np.zeros(len(time)), "before what stands in front of it is done",
             "raise NPREV and NPOST, or bring SHIFT nearer to 0"),
        ):  # fmt: skip
            fields: dict[str, npt.NDArray[Any] | str] = {
                "what": what,
                "where": where,
                "mend": mend,
                "channel": channels,
            }
            _report(state, collector, rules.SKY_ROOM, rows, switch & (amount > _NO_TIME_US), **fields)
    dark = (events.op == Op.OFF) & (lost_us > _NO_TIME_US)
    _report(state, collector, rules.SKY_DARK, rows, dark, late=lost_us)
    _report_slow(state, timeline, events, collector)
    return collector.done(rules.MORE)


def _report_slow(state: Plan, timeline: Timeline, events: Events, collector: Collector) -> None:
    """Marks that are not at speed where their light should come or go: look-ahead slows them for a corner inside."""
    shown = shown_units(state.job, state.machine)
    for what, op, before in (("begins", Op.ON, 1), ("ends", Op.OFF, 0)):
        mark = events.ref[events.op == op]
        passed, wanted = timeline.profile.end[mark - before], state.vel[mark]
        slow = passed < wanted * (1 - _AT_SPEED)
        columns = {"value": passed * shown.per_pulse_per_ms, "velocity": wanted * shown.per_pulse_per_ms}
        _report(state, collector, rules.SKY_SLOW, state.timed[mark], slow, what=what, speed=shown.speed, **columns)


def _report(
    state: Plan, collector: Collector, rule: Rule, rows: Indices, faulty: Bools, /, **columns: npt.NDArray[Any] | str
) -> None:
    """A fault a line."""
    at = np.flatnonzero(faulty)
    path = state.path
    _, first, counts = np.unique(path.line[rows[at]], return_index=True, return_counts=True)
    listed = collector.room(rule)
    for i, count in zip(at[first[:listed]].tolist(), counts[:listed].tolist(), strict=True):
        row = int(rows[i])
        fields: dict[str, Any] = {
            name: value if isinstance(value, str) else round(value[i].item(), 3) for name, value in columns.items()
        }
        span, remarks = state.job.locate(int(path.line[row]), ""), state.job.remarks(int(path.trail[row]))
        collector.add(rule, span, fields, count, remarks)
    collector.uncounted(rule, max(len(first) - listed, 0))
