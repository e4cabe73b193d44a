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

Floats = npt.NDArray[np.float64]
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
    at_us = events.time_ms * US_PER_MS
    waits_us = _waits(state, events, at_us)[events.goes]
    at_us[events.goes] += events.late_us
    dark_us = np.where(events.op == Op.OFF, _waits(state, events, at_us)[events.goes], 0.0)
    before_us = (times[timeline.stage_first[events.stage]] - time) * US_PER_MS
    behind_us = (time - times[timeline.stage_first[events.stage + 1]]) * US_PER_MS
    into_us = np.where(dwell, np.minimum(time - times[cell], times[cell + 1] - time), 0.0) * US_PER_MS
    crosses_us = np.where(dark_us > _NO_TIME_US, 0.0, waits_us)
    for what, switch, faults in (
        ("on", events.op == Op.ON, (
            (before_us, "before the motion begins", "shorten LASER DELAY ON, or raise NPREV"),
            (behind_us, "behind the end of the motion", "raise NPOST"),
            (into_us, "into a DWELL", "raise NPOST, or shorten LASER DELAY ON"),
            (waits_us, "before what stands in front of it is done", "raise NPREV and NPOST, or SHIFT"),
        )),
        ("off", events.op == Op.OFF, (
            (before_us, "before the motion begins", "shorten LASER DELAY OFF, or raise NPREV"),
            (behind_us, "behind the end of the motion", "raise NPOST"),
            (into_us, "into a DWELL", "raise NPOST, or shorten LASER DELAY OFF"),
            (crosses_us, "before it is switched on", "bring ON and OFF of LASER DELAY nearer to each other"),
        )),
    ):  # fmt: skip
        for amount, where, mend in faults:
            columns: dict[str, npt.NDArray[Any] | str] = {"what": what, "where": where, "mend": mend}
            columns |= {"channel": channels, "early": amount}
            _report(state, collector, rules.SKY_ROOM, rows, switch & (amount > _NO_TIME_US), **columns)
    _report(state, collector, rules.SKY_DARK, rows, dark_us > _NO_TIME_US, late=dark_us)
    _report_slow(state, timeline, events, collector)
    return collector.done(rules.MORE)


def _waits(state: Plan, events: Events, time: Floats) -> Floats:
    """How much later than its own time each event comes if none of its channel comes before those in front of it."""
    waits = np.zeros(len(time))
    for channel in CHANNELS:
        mine = np.flatnonzero(state.path.channel[events.row] == channel)
        waits[mine] = np.maximum.accumulate(time[mine]) - time[mine]
    return waits


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
