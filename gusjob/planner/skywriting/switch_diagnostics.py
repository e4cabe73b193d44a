"""What sky writing can't do as asked: switch where no motion is left, be at speed at both ends of every mark."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import RUN_STEP_US
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, has_errors
from gusjob.i18n.phrases import Phrase
from gusjob.ir.display import display_units
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.trapezoids import distance_run
from gusjob.kinematics.units import US_PER_MS
from gusjob.lint.view import CHANNELS
from gusjob.planner.plan import Plan
from gusjob.planner.report_rows import report_rows
from gusjob.planner.skywriting.timeline import Events

_NO_TIME_US = 1e-6
_MOMENT_MS = 1e-4
_COARSE_PULSE = 3.0
"""So much the beam may be off where light is switched before a warning is due."""
_AT_SPEED = 0.02
"""By how much of it a mark's speed may be missed at its ends: rounding of small circles makes as much."""


_ON, _OFF = Phrase("on"), Phrase("off")
_BEFORE, _BEHIND = Phrase("before the motion begins"), Phrase("behind the end of the motion")
_INTO, _RAISE_NPOST = Phrase("into a DWELL"), Phrase("raise NPOST")


def switch_diagnostics(state: Plan, schedule: Schedule, events: Events, place: Floats) -> list[Diagnostic]:
    """Where a switch can't come when it should: no motion runs then, or it would come before what it follows.

    `place`: of every event, as the switch points have it.
    """
    times = schedule.times_ms
    collector = Collector(state.job.name)
    rows, time = state.timed[events.ref], events.time_ms[events.goes]
    channels = state.path.channel[events.row[events.goes]]
    cell = np.minimum(np.searchsorted(times[1:], time, side="left"), len(schedule.stage) - 1)
    dwell = state.path.op[state.timed[cell]] == Op.DWELL
    at_us = events.time_ms * US_PER_MS
    waits_us = _waits(state, events, at_us)[events.goes]
    at_us[events.goes] += events.late_us
    dark_us = np.where(events.op == Op.OFF, _waits(state, events, at_us)[events.goes], 0.0)
    before_us = (times[schedule.stage_first[events.stage]] - time) * US_PER_MS
    behind_us = (time - times[schedule.stage_first[events.stage + 1]]) * US_PER_MS
    into_us = np.where(dwell, np.minimum(time - times[cell], times[cell + 1] - time), 0.0) * US_PER_MS
    crosses_us = np.where(dark_us > _NO_TIME_US, 0.0, waits_us)
    for what, switch, diagnostics in (
        (_ON, events.op == Op.ON, (
            (before_us, _BEFORE, Phrase("shorten LASER DELAY ON, or raise NPREV")),
            (behind_us, _BEHIND, _RAISE_NPOST),
            (into_us, _INTO, Phrase("raise NPOST, or shorten LASER DELAY ON")),
            (waits_us, Phrase("before what stands in front of it is done"),
             Phrase("raise NPREV and NPOST, or SHIFT")),
        )),
        (_OFF, events.op == Op.OFF, (
            (before_us, _BEFORE, Phrase("shorten LASER DELAY OFF, or raise NPREV")),
            (behind_us, _BEHIND, _RAISE_NPOST),
            (into_us, _INTO, Phrase("raise NPOST, or shorten LASER DELAY OFF")),
            (crosses_us, Phrase("before it is switched on"),
             Phrase("bring ON and OFF of LASER DELAY nearer to each other")),
        )),
    ):  # fmt: skip
        for amount, where, mend in diagnostics:
            columns: dict[str, npt.NDArray[Any] | str] = {"what": what, "where": where, "mend": mend}
            columns |= {"channel": channels, "early": amount}
            _report(state, collector, rules.SKY_ROOM, rows, switch & (amount > _NO_TIME_US), **columns)
    dark = (dark_us > _NO_TIME_US) | _at_one_point(state, events, place)[events.goes]
    _report(state, collector, rules.SKY_DARK, rows, dark, late=dark_us)
    _report_slow(state, schedule, events, collector)
    if not has_errors(collector.found):
        _report_coarse(state, schedule, events, collector)
    return collector.done(rules.MORE)


def _waits(state: Plan, events: Events, time: Floats) -> Floats:
    """How much later than its own time each event comes if none of its channel comes before those in front of it."""
    waits = np.zeros(len(time))
    for channel in CHANNELS:
        mine = np.flatnonzero(state.path.channel[events.row] == channel)
        waits[mine] = np.maximum.accumulate(time[mine]) - time[mine]
    return waits


def _at_one_point(state: Plan, events: Events, place: Floats) -> Bools:
    """Events that switch light off at the place where it was switched on."""
    op, found = state.path.op[events.row], np.zeros(len(events.row), dtype=np.bool_)
    for channel in CHANNELS:
        mine = state.path.channel[events.row] == channel
        switches = np.flatnonzero(mine & ((op == Op.ON) | (op == Op.OFF)))
        before, behind = switches[:-1], switches[1:]
        found[behind[(op[before] == Op.ON) & (op[behind] == Op.OFF) & (place[before] == place[behind])]] = True
    return found


def _report_coarse(state: Plan, schedule: Schedule, events: Events, collector: Collector) -> None:
    """Light that is switched where the command is so slow that a whole pulse takes long, for a beam at mark speed."""
    times, time = schedule.times_ms, events.time_ms[events.goes]
    cell = np.clip(np.searchsorted(times[1:], time, side="left"), 0, len(schedule.stage) - 1)
    since, moment = np.clip(time - times[cell], 0.0, times[cell + 1] - times[cell]), _MOMENT_MS
    run = [distance_run(schedule.profile, cell, np.maximum(since + step, 0.0)) for step in (-moment, moment)]
    # Half a pulse at this velocity; from rest it takes 1/sqrt(acc).
    acc = schedule.profile.acc[cell]
    off_ms = 0.5 / np.maximum((run[1] - run[0]) / (2 * moment), 0.5 * np.sqrt(acc))
    off_pulse = off_ms * state.vel[events.ref]
    error_um = off_pulse / min(state.machine.pulses_per_mm) * US_PER_MS
    from_start_us = (time - times[events.ref]) * US_PER_MS
    from_end_us = (time - times[events.ref + 1]) * US_PER_MS
    coarse = off_pulse > _COARSE_PULSE
    for what, op in ((_ON, Op.ON), (_OFF, Op.OFF)):
        for word, beyond_us in (("NPREV", -from_start_us), ("NPOST", from_end_us)):
            which = (events.op == op) & coarse & (beyond_us > 0)
            columns: dict[str, npt.NDArray[Any] | str] = {"what": what, "word": word, "error": error_um}
            columns |= {"least": np.ceil(beyond_us / RUN_STEP_US).astype(np.intp)}
            _report(state, collector, rules.SKY_COARSE, state.timed[events.ref], which, **columns)


def _report_slow(state: Plan, schedule: Schedule, events: Events, collector: Collector) -> None:
    """Marks that are not at speed where their light should come or go: look-ahead slows them for a corner inside."""
    shown, laid, (px, py) = display_units(state.job, state.machine), state.segments, state.machine.pulses_per_mm
    assert laid is not None
    for what, op, before in ((Phrase("begins"), Op.ON, 1), (Phrase("ends"), Op.OFF, 0)):
        mark = events.ref[events.op == op]
        passed, wanted = schedule.profile.end[mark - before], state.vel[mark]
        slow = passed < wanted * (1 - _AT_SPEED)
        x, y = (laid.start_x, laid.start_y) if op is Op.ON else (laid.end_x, laid.end_y)
        per_pulse = np.hypot(x[mark] / px, y[mark] / py) * US_PER_MS if shown.speed == "mm/s" else np.ones(len(mark))
        columns = {"value": passed * per_pulse, "velocity": wanted * per_pulse}
        _report(state, collector, rules.SKY_SLOW, state.timed[mark], slow, what=what, speed=shown.speed, **columns)


def _report(
    state: Plan, collector: Collector, rule: Rule, rows: Indices, faulty: Bools, /, **columns: npt.NDArray[Any] | str
) -> None:
    """A diagnostic at the lines of the faulty ones of some rows, each with its own of every column."""
    at = np.flatnonzero(faulty)

    def fields(index: int) -> dict[str, Any]:
        i = at[index]
        return {k: v if isinstance(v, str) else round(v[i].item(), 3) for k, v in columns.items()}

    report_rows(state, collector, rule, rows[at], fields)
