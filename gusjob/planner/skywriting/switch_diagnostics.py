"""Diagnostics of sky writing: switches that have no motion, and marks that are not at speed at both ends."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS, RUN_STEP_US
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, has_errors
from gusjob.i18n.phrases import Phrase
from gusjob.ir.display import display_units
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
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
_RAISE_NPOST = Phrase("raise NPOST")
_LONG_SHIFT = Phrase("the mark is shorter than SHIFT")
_LONG_OFF_DELAY = Phrase(
    "LASER DELAY OFF, with OFFDELAY of LASER FPK, is too long for this mark: reduce it, or raise LASER DELAY ON"
)
_SHIFT_LEAVES_NOTHING = Phrase("SHIFT leaves less than a pulse of the mark")
_TOO_SLOW_THERE = Phrase("the motion there is too slow for a pulse during the mark: raise NPOST")
_SHORT_MARK = Phrase("the mark is shorter than a pulse")


def switch_diagnostics(
    planned: PlannedPath, schedule: Schedule, events: PlannedEvents, position: Floats
) -> list[Diagnostic]:
    """Report switches that can't come in time, marks without emission, and marks that are not at speed.

    A switch is reported for one cause: after that, where it is says nothing.

    Args:
        position: Of every event, as in SwitchPoints, (e,).
    """
    reporter = _SwitchReporter(
        planned=planned,
        events=events,
        collector=Collector(planned.job.name),
        own_on=_own_on(planned, events),
        unreported=np.ones(len(events.op), dtype=np.bool_),
    )
    _report_long_shifts(reporter)
    _report_outside_motion(reporter, schedule)
    _report_no_emission(reporter, schedule, position)
    _report_waits(reporter)
    _report_slow(planned, schedule, events, reporter.collector)
    if not has_errors(reporter.collector.found):
        _report_coarse(planned, schedule, events, reporter.collector)
    return reporter.collector.finish(rules.NOT_LISTED)


class _SwitchReporter(Struct, frozen=True, kw_only=True, eq=False):
    """Reports events that are to be placed, (g,), each only once.

    `own_on`: number of the laser-on of each laser-off among them; -1 where there is none.
    """

    planned: PlannedPath
    events: PlannedEvents
    collector: Collector
    own_on: Indices
    unreported: Bools

    def switch(self, op: Op, wrong: Bools, **columns: npt.NDArray[Any] | str) -> None:
        """Report switches that have no motion."""
        chosen = (self.events.op == op) & wrong & self.unreported
        self.unreported[chosen] = False
        channels = self.planned.path.channel[self.events.row[self.events.moved]]
        columns |= {"what": _ON if op is Op.ON else _OFF, "channel": channels}
        _report(self.planned, self.collector, rules.SKY_NO_MOTION, self.events, chosen, **columns)

    def mark(self, rule: Rule, wrong: Bools, **columns: npt.NDArray[Any] | str) -> None:
        """Report marks by their laser-off; their laser-on is reported with it."""
        own_on = self.own_on
        chosen = (self.events.op == Op.OFF) & wrong & self.unreported & ((own_on < 0) | self.unreported[own_on])
        self.unreported[chosen] = False
        self.unreported[own_on[chosen & (own_on >= 0)]] = False
        _report(self.planned, self.collector, rule, self.events, chosen, **columns)


def _report_long_shifts(reporter: _SwitchReporter) -> None:
    """Report marks whose emission would end before it begins."""
    events = reporter.events
    effect_us = events.time_ms * US_PER_MS
    effect_us[events.moved] += events.late_us
    late_us = _waits_us(reporter.planned, events, effect_us)[events.moved]
    reporter.mark(rules.SKY_OFF_BEFORE_ON, late_us > _NO_TIME_US, late=late_us, cause=_LONG_SHIFT)


def _report_outside_motion(reporter: _SwitchReporter, schedule: Schedule) -> None:
    """Report switches at a time without motion."""
    events = reporter.events
    times, time = schedule.times_ms, events.time_ms[events.moved]
    cell = np.minimum(np.searchsorted(times[1:], time, side="left"), len(schedule.stage) - 1)
    before_us = (times[schedule.stage_first[events.stage]] - time) * US_PER_MS
    behind_us = (time - times[schedule.stage_first[events.stage + 1]]) * US_PER_MS
    within_ms = np.minimum(time - times[cell], times[cell + 1] - time)
    into_us = np.where(schedule.dwell[cell], within_ms, 0.0) * US_PER_MS
    before, behind = Phrase("before the motion begins"), Phrase("after the end of the motion")
    into = Phrase("after the start of a DWELL")
    for op, early_us, where, mend in (
        (Op.ON, before_us, before, Phrase("shorten LASER DELAY ON, or raise NPREV")),
        (Op.ON, behind_us, behind, _RAISE_NPOST),
        (Op.ON, into_us, into, Phrase("raise NPOST, or shorten LASER DELAY ON")),
        (Op.OFF, before_us, before, Phrase("shorten LASER DELAY OFF, or raise NPREV")),
        (Op.OFF, behind_us, behind, _RAISE_NPOST),
        (Op.OFF, into_us, into, Phrase("raise NPOST, or shorten LASER DELAY OFF")),
    ):
        reporter.switch(op, early_us > _NO_TIME_US, early=early_us, where=where, mend=mend)


def _report_no_emission(reporter: _SwitchReporter, schedule: Schedule, position: Floats) -> None:
    """Report marks whose laser-off is called before their laser-on, or at the same point.

    Args:
        position: Of every event, as in SwitchPoints, (e,).
    """
    planned, events, own_on = reporter.planned, reporter.events, reporter.own_on
    time_us, has_on = events.time_ms[events.moved] * US_PER_MS, own_on >= 0
    crosses_us = np.where(has_on, time_us[own_on] - time_us, 0.0)
    longer_us = np.where(has_on, events.late_us - events.late_us[own_on], 0.0)
    reporter.mark(rules.SKY_OFF_BEFORE_ON, crosses_us > _NO_TIME_US, late=crosses_us, cause=_LONG_OFF_DELAY)
    empty = _at_one_point(planned, events, position)[events.moved]
    first = np.where(has_on, events.mark[own_on], events.mark)
    mark_us = (schedule.times_ms[events.mark + 1] - schedule.times_ms[first]) * US_PER_MS
    emission_us = longer_us - crosses_us
    with np.errstate(divide="ignore"):
        pulse_us = US_PER_MS / planned.vel[events.mark]
    for wrong, cause in (
        ((longer_us > _NO_TIME_US) & (emission_us >= pulse_us), _LONG_OFF_DELAY),
        ((mark_us - emission_us > _NO_TIME_US) & (mark_us >= pulse_us), _SHIFT_LEAVES_NOTHING),
        (mark_us >= pulse_us, _TOO_SLOW_THERE),
        (empty, _SHORT_MARK),
    ):
        reporter.mark(rules.SKY_NO_EMISSION, empty & wrong, cause=cause)


def _report_waits(reporter: _SwitchReporter) -> None:
    """Report switches that would come before what they follow."""
    events, own_on = reporter.events, reporter.own_on
    waits_us = _waits_us(reporter.planned, events, events.time_ms * US_PER_MS)[events.moved]
    where = Phrase("before the previous switch or change of power")
    reporter.switch(
        Op.ON, waits_us > _NO_TIME_US, early=waits_us, where=where, mend=Phrase("raise NPREV and NPOST, or SHIFT")
    )
    # A laser-off also waits for what its laser-on waits for.
    alone = (own_on < 0) | reporter.unreported[own_on]
    mend = Phrase("shorten LASER DELAY OFF")
    reporter.switch(Op.OFF, alone & (waits_us > _NO_TIME_US), early=waits_us, where=where, mend=mend)


def _waits_us(planned: PlannedPath, events: PlannedEvents, time_us: Floats) -> Floats:
    """Delay of each event after its own time, (e,): the events of a channel keep their order."""
    waits = np.zeros(len(time_us))
    for channel in CHANNELS:
        own = np.flatnonzero(planned.path.channel[events.row] == channel)
        waits[own] = np.maximum.accumulate(time_us[own]) - time_us[own]
    return waits


def _own_on(planned: PlannedPath, events: PlannedEvents) -> Indices:
    """Number of the laser-on of each laser-off among the events to be placed, (g,); -1 where there is none."""
    number = np.full(len(events.row), -1, dtype=np.intp)
    number[events.moved] = np.arange(len(events.moved))
    found = np.full(len(events.moved), -1, dtype=np.intp)
    for on, off in _marks(planned, events):
        kept = number[off] >= 0
        found[number[off[kept]]] = number[on[kept]]
    return found


def _at_one_point(planned: PlannedPath, events: PlannedEvents, position: Floats) -> Bools:
    """Events that switch the laser off at the position where it was switched on, (e,)."""
    found = np.zeros(len(events.row), dtype=np.bool_)
    for on, off in _marks(planned, events):
        found[off] = position[on] == position[off]
    return found


def _marks(planned: PlannedPath, events: PlannedEvents) -> Iterator[tuple[Indices, Indices]]:
    """Each laser-on and the laser-off that follows it, as numbers of events, channel by channel."""
    op = planned.path.op[events.row]
    for channel in CHANNELS:
        own = planned.path.channel[events.row] == channel
        switches = np.flatnonzero(own & ((op == Op.ON) | (op == Op.OFF)))
        before, behind = switches[:-1], switches[1:]
        is_mark = (op[before] == Op.ON) & (op[behind] == Op.OFF)
        yield before[is_mark], behind[is_mark]


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
