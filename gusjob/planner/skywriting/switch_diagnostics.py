"""Diagnostics of sky writing: switches that have no motion, and marks that are not at speed at both ends."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS, RUN_STEP_US
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, has_errors
from gusjob.i18n.phrases import Phrase
from gusjob.ir.display import display_units
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.trapezoids import distance_run
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import PlannedPath
from gusjob.planner.row_diagnostics import report_rows
from gusjob.planner.skywriting.switch_events import PlannedEvents

_NO_TIME_US = 1e-6
_MOMENT_MS = 1e-4
"""Half the time over which a velocity is measured."""
_COARSE_PULSE = 3.0
"""Largest error of the beam's position at a switch without a warning."""
_MOST_STEPS = 2.0**53
"""Largest number of steps that is shown: at a velocity of almost 0 there are more than an integer holds."""
_AT_SPEED = 0.02
"""Share by which a mark may miss its speed at its ends: rounding of small circles makes as much."""

_ON, _OFF = Phrase("on"), Phrase("off")
_BEFORE, _BEHIND = Phrase("before the motion begins"), Phrase("after the end of the motion")
_INTO, _RAISE_NPOST = Phrase("after the start of a DWELL"), Phrase("raise NPOST")


def switch_diagnostics(
    planned: PlannedPath, schedule: Schedule, events: PlannedEvents, position: Floats
) -> list[Diagnostic]:
    """Report switches that can't come in time, marks without emission, and marks that are not at speed.

    Args:
        position: Of every event, as in SwitchPoints, (e,).
    """
    collector = Collector(planned.job.name)
    at_us = events.time_ms * US_PER_MS
    waits_us = _waits_us(planned, events, at_us)[events.moved]
    at_us[events.moved] += events.late_us
    off_us = np.where(events.op == Op.OFF, _waits_us(planned, events, at_us)[events.moved], 0.0)
    crosses_us = np.where(off_us > _NO_TIME_US, 0.0, waits_us)
    _report_outside_motion(planned, schedule, events, waits_us, crosses_us, collector)
    no_emission = (off_us > _NO_TIME_US) | _at_one_point(planned, events, position)[events.moved]
    _report(planned, collector, rules.SKY_NO_EMISSION, events, no_emission, late=off_us)
    _report_slow(planned, schedule, events, collector)
    if not has_errors(collector.found):
        _report_coarse(planned, schedule, events, collector)
    return collector.finish(rules.NOT_LISTED)


def _report_outside_motion(
    planned: PlannedPath,
    schedule: Schedule,
    events: PlannedEvents,
    waits_us: Floats,
    crosses_us: Floats,
    collector: Collector,
) -> None:
    """Report switches at a time without motion, and those that would come before what they follow.

    Args:
        waits_us: How much later than its time each event comes since others come first, (g,).
        crosses_us: The same for laser-off whose mark has some emission, (g,).
    """
    times, time = schedule.times_ms, events.time_ms[events.moved]
    cell = np.minimum(np.searchsorted(times[1:], time, side="left"), len(schedule.stage) - 1)
    before_us = (times[schedule.stage_first[events.stage]] - time) * US_PER_MS
    behind_us = (time - times[schedule.stage_first[events.stage + 1]]) * US_PER_MS
    within_ms = np.minimum(time - times[cell], times[cell + 1] - time)
    into_us = np.where(schedule.dwell[cell], within_ms, 0.0) * US_PER_MS
    causes: dict[Op, tuple[Phrase, tuple[tuple[Floats, Phrase, Phrase], ...]]] = {
        Op.ON: (
            _ON,
            (
                (before_us, _BEFORE, Phrase("shorten LASER DELAY ON, or raise NPREV")),
                (behind_us, _BEHIND, _RAISE_NPOST),
                (into_us, _INTO, Phrase("raise NPOST, or shorten LASER DELAY ON")),
                (
                    waits_us,
                    Phrase("before the previous switch or change of power"),
                    Phrase("raise NPREV and NPOST, or SHIFT"),
                ),
            ),
        ),
        Op.OFF: (
            _OFF,
            (
                (before_us, _BEFORE, Phrase("shorten LASER DELAY OFF, or raise NPREV")),
                (behind_us, _BEHIND, _RAISE_NPOST),
                (into_us, _INTO, Phrase("raise NPOST, or shorten LASER DELAY OFF")),
                (
                    crosses_us,
                    Phrase("before it is switched on"),
                    Phrase("reduce the difference between ON and OFF of LASER DELAY"),
                ),
            ),
        ),
    }
    channels = planned.path.channel[events.row[events.moved]]
    for op, (what, cases) in causes.items():
        for early_us, where, fix in cases:
            columns: dict[str, npt.NDArray[Any] | str] = {"what": what, "where": where, "mend": fix}
            columns |= {"channel": channels, "early": early_us}
            wrong = (events.op == op) & (early_us > _NO_TIME_US)
            _report(planned, collector, rules.SKY_NO_MOTION, events, wrong, **columns)


def _waits_us(planned: PlannedPath, events: PlannedEvents, time_us: Floats) -> Floats:
    """Delay of each event after its own time, (e,): the events of a channel keep their order."""
    waits = np.zeros(len(time_us))
    for channel in CHANNELS:
        own = np.flatnonzero(planned.path.channel[events.row] == channel)
        waits[own] = np.maximum.accumulate(time_us[own]) - time_us[own]
    return waits


def _at_one_point(planned: PlannedPath, events: PlannedEvents, position: Floats) -> Bools:
    """Events that switch the laser off at the position where it was switched on, (e,)."""
    op, found = planned.path.op[events.row], np.zeros(len(events.row), dtype=np.bool_)
    for channel in CHANNELS:
        own = planned.path.channel[events.row] == channel
        switches = np.flatnonzero(own & ((op == Op.ON) | (op == Op.OFF)))
        before, behind = switches[:-1], switches[1:]
        empty = (op[before] == Op.ON) & (op[behind] == Op.OFF) & (position[before] == position[behind])
        found[behind[empty]] = True
    return found


def _report_coarse(planned: PlannedPath, schedule: Schedule, events: PlannedEvents, collector: Collector) -> None:
    """Report switches where the command is so slow that one pulse takes long, for a beam at mark speed."""
    times, time = schedule.times_ms, events.time_ms[events.moved]
    cell = np.clip(np.searchsorted(times[1:], time, side="left"), 0, len(schedule.stage) - 1)
    since = np.clip(time - times[cell], 0.0, times[cell + 1] - times[cell])
    run = [distance_run(schedule.profile, cell, np.maximum(since + step, 0.0)) for step in (-_MOMENT_MS, _MOMENT_MS)]
    # Half a pulse at this velocity; from rest it takes 1/sqrt(acc).
    acc = schedule.profile.acc[cell]
    off_ms = 0.5 / np.maximum((run[1] - run[0]) / (2 * _MOMENT_MS), 0.5 * np.sqrt(acc))
    off_pulse = off_ms * planned.vel[events.mark]
    error_um = off_pulse / min(planned.machine.pulses_per_mm) * US_PER_MS
    from_start_us = (time - times[events.mark]) * US_PER_MS
    from_end_us = (time - times[events.mark + 1]) * US_PER_MS
    coarse = off_pulse > _COARSE_PULSE
    for what, op in ((_ON, Op.ON), (_OFF, Op.OFF)):
        for word, beyond_us in (("NPREV", -from_start_us), ("NPOST", from_end_us)):
            which = (events.op == op) & coarse & (beyond_us > 0)
            columns: dict[str, npt.NDArray[Any] | str] = {"what": what, "word": word, "error": error_um}
            steps = np.ceil(np.clip(beyond_us / RUN_STEP_US, 0.0, _MOST_STEPS))
            columns |= {"least": steps.astype(np.intp)}
            _report(planned, collector, rules.SKY_COARSE, events, which, **columns)


def _report_slow(planned: PlannedPath, schedule: Schedule, events: PlannedEvents, collector: Collector) -> None:
    """Report marks that are not at speed at their start or end: look-ahead slows them for a corner inside."""
    shown, segments = display_units(planned.job, planned.machine), planned.segments
    px, py = planned.machine.pulses_per_mm
    for what, op, before in ((Phrase("begins"), Op.ON, 1), (Phrase("ends"), Op.OFF, 0)):
        of_kind = events.op == op
        mark = events.mark
        reached, full = schedule.profile.end[mark - before], planned.vel[mark]
        slow = of_kind & (reached < full * (1 - _AT_SPEED))
        x, y = segments.start_direction(mark) if op is Op.ON else segments.end_direction(mark)
        per_pulse = np.hypot(x / px, y / py) * US_PER_MS if shown.speed == "mm/s" else np.ones(len(mark))
        columns = {"value": reached * per_pulse, "velocity": full * per_pulse}
        _report(planned, collector, rules.SKY_NOT_AT_SPEED, events, slow, what=what, speed=shown.speed, **columns)


def _report(
    planned: PlannedPath,
    collector: Collector,
    rule: Rule,
    events: PlannedEvents,
    wrong: Bools,
    /,
    **columns: npt.NDArray[Any] | str,
) -> None:
    """Report the wrong ones of the events to be placed, (g,), at the lines of their marks."""
    at = np.flatnonzero(wrong)

    def fields(index: int) -> dict[str, Any]:
        i = at[index]
        return {k: v if isinstance(v, str) else round(v[i].item(), 3) for k, v in columns.items()}

    report_rows(planned, collector, rule, planned.timed[events.mark[at]], fields)
