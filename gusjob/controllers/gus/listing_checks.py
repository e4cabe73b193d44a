"""Rules of jobs that hold for calls, too: the calls are lifted to a job, and the checks of jobs run on it.

With them what only calls can do: settings in the middle of a motion, coordinate systems without Y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, Stream, Value
from gusjob.controllers.gus.execution import Execution
from gusjob.controllers.gus.lift import lift
from gusjob.controllers.gus.ranges import PULSE_DUTY_PCT, PowerMode
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Remark, Rule, Span
from gusjob.i18n.phrases import Phrase, all_of
from gusjob.ir.short_marks import PlannedSpeeds, short_marks
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.geometry import Segments
from gusjob.lint import CHECKS_OF_CALLS, run_checks
from gusjob.lint.context import LintContext, Remarks, lint_context, no_remarks
from gusjob.lint.frequency import US_KHZ_PER_PCT
from gusjob.lint.reporter import Reporter
from gusjob.planner.quantize import direction_scale
from gusjob.simulate import Trace
from gusjob.simulate.checks import misses_end
from gusjob.simulate.events import Events

HOLD_FOR_CALLS = (
    rules.POWER_CLAMPED,
    rules.PULSE_TOO_WIDE,
    rules.CARRIER_TOO_FAST,
    rules.FOLLOW_SATURATES,
    rules.UNUSED_POWER,
    rules.UNUSED_LAST_POWER,
    rules.OFF_DELAY_BELOW_ON,
    rules.DISTANCE_UNIT_CHANGED,
    rules.FPK_IN_DUTY2,
    rules.DELAY_LONGER_THAN_MARK,
    rules.DELAY_LONGER_THAN_JUMP,
    rules.GAP_LONGER_THAN_MARK,
    rules.FPK_LONGER_THAN_JUMP,
    rules.DWELL_WITH_LASER_ON,
    rules.WAIT_WITH_LASER_ON,
    rules.LASER_ON_WITHOUT_MOTION,
    rules.MARKED_TWICE,
    rules.PARTLY_MARKED_TWICE,
    rules.ALREADY_ON,
    rules.TOO_FAST,
    rules.ARC_TOO_FAST,
    rules.MARK_WITHOUT_LENGTH,
    rules.FIFO_MAY_RUN_EMPTY,
    rules.MARK_TOO_SHORT,
)
"""The rules of jobs that hold for calls. What the other checks find in calls has rules of its own (GJ7)."""

_RADIUS_ROUNDING_PULSE = 2.0
_ROUNDING = 1e-9
_XY = 2
"""Dimension of a plane."""

_IN_CALLS: dict[str, str] = {
    "LINE": "GT_LnXY",
    "VEL": Phrase("the segment's velocity"),
    "ACC": Phrase("the segment's acceleration"),
    "DWELL": "GT_BufDelay",
    "LASER ON": "GT_BufLaserOn",
    "LASER OFF": "GT_BufLaserOff",
    "LASER DISTANCE": "GT_SetLaserDisRatio",
    "LASER POWER": "GT_BufLaserPrfCmd",
    "LASER POWER NOW": "GT_LaserPrfCmd",
    "LASER FOLLOW": "GT_BufLaserPrfFollow",
    "follow MIN": "GT_BufLaserPrfFollow minPower",
    "follow MAX": "GT_BufLaserPrfFollow maxPower",
    "distance MIN": "GT_SetLaserDisRatio minPower",
    "distance MAX": "GT_SetLaserDisRatio maxPower",
    "CARRIER": "GT_LaserOutFrq",
    "standby FREQ": "GT_SetWaitPulse waitPulseFrq",
}
"""What the words of a job are in calls."""


class LintedCalls(Struct, frozen=True, kw_only=True):
    """What the checks of jobs find in executed calls, and the state that the checks of their motion need."""

    stream: Stream
    execution: Execution
    context: LintContext
    found: tuple[Diagnostic, ...]

    def diagnostics(self, events: Events, trace: Trace) -> list[Diagnostic]:
        """Find what breaks a rule of jobs, and coordinate systems that lack an axis of their motion."""
        return [
            *self.found,
            *_wide_pulses(self.found, trace),
            *_fast_arcs(trace, self.context.machine),
            *_slow_marks(self.context, events, trace),
            *_axes_missing(self.stream, self.execution),
        ]


def lint_calls(stream: Stream, execution: Execution, machine: Machine) -> LintedCalls:
    """Run the checks of jobs on executed calls.

    They run before the simulation: the job that the calls amount to is as large as the trace, and is not kept.
    """
    context = lint_context(lift(stream, execution), machine)
    found = run_checks(CHECKS_OF_CALLS, context, _CallReporter(context, Collector(stream.name)))
    if all(math.isfinite(stage.start_ms) for stage in execution.stages):
        # The time between the stages is known: it is reported by itself (GJ726).
        found = [d for d in found if d.rule is not rules.WAIT_WITH_LASER_ON]
    return LintedCalls(stream=stream, execution=execution, context=context.without_numbers(), found=tuple(found))


def _slow_marks(context: LintContext, events: Events, trace: Trace) -> list[Diagnostic]:
    """Report marks that are too short for their velocity, but for those with a segment that GJ704 reports."""
    collector, profile, motion = Collector(trace.name), trace.schedule.profile, events.motion
    rows = np.flatnonzero(context.path.takes_time)
    is_slower = profile.peak < profile.start
    speeds = PlannedSpeeds(
        row=rows,
        op=context.path.op[rows],
        length=trace.segments.length,
        asked=_asked(motion.vel, trace.segments, machine=context.machine),
        vel=motion.vel,
        acc=profile.acc,
        start=profile.start,
        peak=np.maximum(profile.peak, profile.start) if is_slower.any() else profile.peak,
        end=profile.end,
        is_sky=np.broadcast_to(np.False_, len(rows)),
    )
    found = short_marks(context.modal, speeds).without(misses_end(motion, trace.schedule))
    rule = rules.MARK_TOO_SHORT
    listed = min(len(found), collector.remaining(rule))
    for i in range(listed):
        line = int(trace.line[found.at[i]])
        collector.add(rule, Span(line=line), found.fields(i, context.shown, context.machine))
    collector.count_unlisted(rule, len(found) - listed)
    return collector.finish(rules.NOT_LISTED)


def _asked(vel: Floats, segments: Segments, machine: Machine) -> Floats:
    """Velocities as they may have been set, (m,): one for motions whose velocity is the same in pulses, or in mm.

    Where the axes differ, one velocity in mm is another one in pulses for each direction. Rounding of the ends turns
    the direction: by the angle phi it changes the pulses per mm by up to (k - 1/k)/2 * phi, with the ratio k of the
    axes.
    """
    if machine.equal_axes or not len(vel):
        return vel
    ratio = max(machine.pulses_per_mm) / min(machine.pulses_per_mm)
    scale = direction_scale(*segments.start_direction(np.arange(len(vel))), segments.arc_at, machine.pulses_per_mm)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.abs(np.diff(np.log(vel / scale)))
    slack = (ratio - 1 / ratio) / 2 * segments.rounding_turns
    same = (np.diff(vel) == 0) | (change <= slack[:-1] + slack[1:] + _ROUNDING)
    return vel[np.maximum.accumulate(np.where(np.append(False, same), 0, np.arange(len(vel))))]


def _wide_pulses(found: Sequence[Diagnostic], trace: Trace) -> list[Diagnostic]:
    """Report the first segment with laser pulses as long as their period, if no call is reported for them.

    More than the rated power is not possible: no report shows it without an error. The frequency may be the lowest of
    the mode, which no call sets.
    """
    if any(diagnostic.rule is rules.PULSE_TOO_WIDE for diagnostic in found):
        return []
    collector = Collector(trace.name)
    for channel in trace.channels:
        lasers = channel.lasers
        widths = np.array([x.pulse_width_us if x.mode is PowerMode.FREQUENCY else 0.0 for x in lasers] or [0.0])
        if not widths.any() or not len(trace):
            continue
        width = widths[trace.schedule.stage]
        duty = channel.emitted.power_max * width / US_KHZ_PER_PCT
        wide = np.flatnonzero(duty >= PULSE_DUTY_PCT.high)
        if len(wide):
            i = int(wide[0])
            khz = float(channel.emitted.power_max[i])
            fields = {"value": khz, "width": float(width[i]), "duty": float(duty[i]), "range": str(PULSE_DUTY_PCT)}
            collector.add(rules.PULSE_TOO_WIDE, Span(line=int(trace.line[i])), fields)
    return collector.finish(rules.NOT_LISTED)


def _fast_arcs(trace: Trace, machine: Machine) -> list[Diagnostic]:
    """Report arcs on which v^2/r is above the machine's acceleration, at the highest velocity that is reached."""
    collector = Collector(trace.name)
    at, radius, profile = trace.segments.arc_at, trace.segments.arcs.radius, trace.schedule.profile
    limit = machine.max_acceleration_pulse_per_ms2
    velocity = np.maximum(np.maximum(profile.peak[at], profile.start[at]), profile.end[at])
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = velocity**2 / radius
    # Ends are whole pulses, and often the centre is, so the radius may be off by this much.
    fast = np.flatnonzero((radius > 0) & (velocity**2 > limit * (radius + _RADIUS_ROUNDING_PULSE)))
    rule = rules.ARC_TOO_FAST_IN_CALLS
    listed = fast[: collector.remaining(rule)].tolist()
    for i in listed:
        fields = {"velocity": float(velocity[i]), "radius": float(radius[i]), "value": float(needed[i]), "limit": limit}
        collector.add(rule, Span(line=int(trace.line[at[i]])), fields)
    collector.count_unlisted(rule, len(fast) - len(listed))
    return collector.finish(rules.NOT_LISTED)


def _axes_missing(stream: Stream, execution: Execution) -> list[Diagnostic]:
    """Report coordinate systems that lack an axis of their motion."""
    collector = Collector(stream.name)
    kind, crd = stream.buffered.kind, stream.buffered.crd
    for accepted in execution.accepted:
        call = accepted.call
        if call.name != "GT_SetCrdPrm":
            continue
        reason = _missing_axis(call.args[1])
        moves = (kind <= Buffered.ARC_RADIUS) & (crd == call.args[0])
        if reason and moves.any():
            collector.add(rules.QUESTIONABLE_CALL, Span(line=call.line), {"call": call.name, "reason": reason})
    return collector.finish(rules.NOT_LISTED)


def _missing_axis(parameters: Value) -> str:
    """Describe which of X and Y a TCrdPrm lacks; '' if none, or if it is not known."""
    if not isinstance(parameters, tuple):
        return ""
    dimension, profile = parameters[0], parameters[1]
    if isinstance(dimension, float) and dimension < _XY:
        return Phrase("dimension {dimension} has no Y: GT_LnXY and arcs need 2", dimension=dimension)
    axes = [axis for number, axis in ((1.0, "X"), (2.0, "Y")) if isinstance(profile, tuple) and number not in profile]
    return Phrase("no axis of its profile is {axes}: GT_LnXY and arcs need X and Y", axes=all_of(axes)) if axes else ""


class _CallReporter(Reporter):
    """Reports only rules that hold for calls, in the words of calls."""

    def line(
        self,
        rule: Rule,
        line: int,
        word: str = "",
        /,
        *,
        provenance: int = 0,
        count: int = 1,
        remarks: tuple[Remark, ...] = (),
        **fields: Any,
    ) -> None:
        """Report one diagnostic at a word of a line."""
        if rule in HOLD_FOR_CALLS:
            rule = rules.TOO_FAST_IN_CALLS if rule is rules.TOO_FAST else rule
            fields |= {name: _IN_CALLS.get(fields[name], fields[name]) for name in ("what", "word") if name in fields}
            Reporter.line(self, rule, line, word, provenance=provenance, count=count, remarks=remarks, **fields)

    def lines(
        self,
        rule: Rule,
        lines: npt.NDArray[np.int32],
        provenance: npt.NDArray[np.int32],
        words: npt.NDArray[np.str_],
        /,
        *,
        remarks: Remarks = no_remarks,
        **columns: Any,
    ) -> None:
        """Report one diagnostic a line of (k,)."""
        if rule in HOLD_FOR_CALLS:
            Reporter.lines(self, rule, lines, provenance, words, remarks=remarks, **columns)
