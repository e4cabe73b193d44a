"""Diagnostics of a simulated stream that depend on the GUS controller and its calls."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.controllers.gus.execution import Execution
from gusjob.controllers.gus.ranges import FIFO_SLOTS, PowerMode
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Span
from gusjob.i18n.phrases import Phrase, number
from gusjob.kinematics.arrays import Bools
from gusjob.kinematics.geometry import nearly_closed
from gusjob.simulate import Trace
from gusjob.simulate.checks import SegmentReporter, segment_reporter
from gusjob.simulate.events import Events, MotionEvents
from gusjob.simulate.rest import OnAtRest, times_on_at_rest

_ARC_TOLERANCE_PULSE = 3.0
_NO_RADIUS_PULSE = 1e-3
"""Radius below which a centre is the start point: what is left of a computed number."""
_BELOW = 1 - 1e-12
"""Factor by which a radius has to be below half the chord: more than rounding."""


def limit_diagnostics(path: str, motion: MotionEvents, too_fast: Bools, too_strong: Bools) -> list[Diagnostic]:
    """Report the segments, (m,), whose velocity or acceleration the controller limits (sister)."""
    reporter = segment_reporter(path, motion)
    reporter.add(
        rules.QUESTIONABLE_CALL,
        too_fast,
        call=Phrase("the segment's velocity"),
        reason=Phrase("it is above synVelMax of GT_SetCrdPrm, which limits it"),
    )
    reporter.add(
        rules.QUESTIONABLE_CALL,
        too_strong,
        call=Phrase("the segment's acceleration"),
        reason=Phrase("it is above synAccMax of GT_SetCrdPrm, which limits it"),
    )
    return reporter.done()


def listing_diagnostics(execution: Execution, events: Events, trace: Trace) -> list[Diagnostic]:
    """Report what the planner would not make: impossible arcs, full FIFOs, lasers on at a stop or at rest."""
    calls, reporter = execution.run.calls, segment_reporter(events.name, events.motion)
    _report_arcs(calls, execution.run.sent, events.motion, reporter)
    fifos = _full_fifos(calls, execution, events.name)
    return [*reporter.done(), *fifos, *_stopped_on(execution, trace), *_on_at_rest(events, trace)]


def _stopped_on(execution: Execution, trace: Trace) -> Iterator[Diagnostic]:
    """Report stops that leave a laser on (sister: nothing says that a stop switches it off)."""
    ends = trace.schedule.stage_end()
    for i, stage in enumerate(execution.stages):
        if stage.stop is None or stage.stop.name != "GT_Stop":
            continue
        for channel in trace.channels:
            on = channel.emission.switch
            if ((on.stage == i) & (on.end_ms == ends[i])).any():
                name = channel.channel
                reason = Phrase("the laser of channel {channel} stays on: a stop does not switch it off", channel=name)
                fields = {"call": stage.stop.name, "reason": reason}
                span = Span(line=stage.stop.line)
                yield Diagnostic(rule=rules.QUESTIONABLE_CALL, span=span, fields=fields, path=trace.name)


def _on_at_rest(events: Events, trace: Trace) -> list[Diagnostic]:
    """Report lasers that are on while nothing moves.

    Without times only those that calls at rest switch on and off: a laser on before GT_CrdStart, or switched off after
    the motion, is normal. With times this is so for less than a tick, which is the time that the calls take.
    """
    collector = Collector(trace.name)
    for channel in trace.channels:
        for found in times_on_at_rest(channel, events, trace):
            if not (found.by_calls or found.time_ms >= trace.period_ms):
                continue
            fields = {"channel": channel.channel, "power": _power_at_rest(found)}
            span = Span(line=found.line)
            if math.isnan(found.time_ms):
                collector.add(rules.ON_AT_REST_UNTIMED, span, fields)
            else:
                collector.add(rules.ON_AT_REST, span, {**fields, "time": found.time_ms})
    return collector.finish(rules.NOT_LISTED)


def _power_at_rest(found: OnAtRest) -> str:
    """Describe the power of a laser that is on at rest."""
    laser = found.laser
    if math.isnan(found.power):
        return Phrase("no power is set")
    power = f"{number(min(max(found.power, laser.low), laser.high))} {laser.power_mode.unit}"
    return Phrase("{power} without distance follow", power=power) if laser.follows_distance else power


def carrier_diagnostics(trace: Trace) -> list[Diagnostic]:
    """Report emission in a duty mode without a carrier, or in frequency mode without a pulse width."""
    found = []
    for channel in trace.channels:
        first = channel.first_emitting
        if first is None:
            continue
        laser = channel.laser_in(first)
        if laser.mode in (PowerMode.DUTY, PowerMode.DUTY2) and laser.carrier_khz is None:
            call = "GT_LaserOutFrq"
            reason = Phrase("emission in a duty mode without a carrier; call GT_LaserOutFrq first (M 二.2)")
        elif laser.mode is PowerMode.FREQUENCY and not laser.pulse_width_us:
            call = "GT_SetPulseWidth"
            reason = Phrase("emission in frequency mode without a pulse width; call GT_SetPulseWidth first (M 二.2)")
        else:
            continue
        fields = {"call": call, "reason": reason}
        span = Span(line=int(trace.line[first]))
        found.append(Diagnostic(rule=rules.QUESTIONABLE_CALL, span=span, fields=fields, path=trace.name))
    return found


def _report_arcs(calls: BufferedCalls, sent: int, motion: MotionEvents, reporter: SegmentReporter) -> None:
    """Report arcs whose radius or centre does not fit their ends (sister: no full circle by radius).

    Of the calls the first `sent` are those of the listing; the others are parts of them, from a stop to a start.
    """
    segments, at = motion.segments, motion.segments.arc_at
    if not len(at):
        return
    row = motion.call[at]
    by_radius, radius = calls.kind[row] == Buffered.ARC_RADIUS, calls.p[row]
    x0, y0, x1, y1 = segments.x0[at], segments.y0[at], segments.x1[at], segments.y1[at]
    chord = np.hypot(x1 - x0, y1 - y0)
    to_end = np.hypot(x1 - segments.arcs.cx, y1 - segments.arcs.cy)
    # Ends are whole pulses, and often the centre is: each may be off by less than one.
    no_radius = ~by_radius & (segments.arcs.radius < _NO_RADIUS_PULSE)
    off = np.abs(segments.arcs.radius - to_end) > _ARC_TOLERANCE_PULSE
    off_circle = ~by_radius & (off | (to_end < _NO_RADIUS_PULSE))
    for bad, reason in (
        (by_radius & (chord == 0), Phrase("an arc by radius that ends where it starts is ambiguous")),
        (
            by_radius & (chord > 0) & (2 * np.abs(radius) < chord * _BELOW),
            Phrase("the radius is below half the chord"),
        ),
        (no_radius, Phrase("the centre is the start point")),
        (off_circle & ~no_radius, Phrase("the end is not on the circle around this centre")),
        (
            ~by_radius & ~no_radius & ~off_circle & (row < sent) & nearly_closed(segments.arcs, chord),
            Phrase("the end is so near to the start that it may be taken for a full circle, or for none"),
        ),
    ):
        where = np.zeros(len(motion), dtype=np.bool_)
        where[at[bad]] = True
        reporter.add(rules.LISTING_ARC, where, reason=reason)


def _full_fifos(calls: BufferedCalls, execution: Execution, path: str) -> list[Diagnostic]:
    """Report stages of which more calls are sent before GT_CrdStart than a FIFO holds (sister)."""
    found = []
    for stage in execution.stages:
        left = FIFO_SLOTS
        for rows in stage.parts[: stage.waiting]:
            if len(rows) > left:
                fields = {"count": FIFO_SLOTS + 1, "slots": FIFO_SLOTS}
                span = Span(line=int(calls.line[rows[left]]))
                found.append(Diagnostic(rule=rules.FIFO_FULL, span=span, fields=fields, path=path))
                break
            left -= len(rows)
    return found
