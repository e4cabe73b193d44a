"""Diagnostics of a simulation: velocities that the path cannot reach, corners, the field, emission."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.schedule import Schedule, starts_at_rest
from gusjob.simulate.events import Events, MotionEvents
from gusjob.simulate.motion import Motion
from gusjob.simulate.trace import ChannelTrace


class SegmentReporter(Struct, kw_only=True):
    """Collects diagnostics of segments."""

    motion: MotionEvents
    collector: Collector

    def add(self, rule: Rule, where: Bools, **columns: Floats | str) -> None:
        """Add one diagnostic for each segment in `where`, (m,); its fields come from columns, (m,)."""
        at = np.flatnonzero(where)
        self.add_at(rule, at, **{k: v if isinstance(v, str) else v[at] for k, v in columns.items()})

    def add_at(self, rule: Rule, at: Indices, **columns: Floats | float | str) -> None:
        """Add one diagnostic for each of some segments, (k,); its fields come from columns, (k,)."""
        listed = at[: self.collector.remaining(rule)].tolist()
        for i, segment in enumerate(listed):
            fields: dict[str, object] = {k: float(v[i]) if isinstance(v, np.ndarray) else v for k, v in columns.items()}
            self.collector.add(rule, Span(line=int(self.motion.line[segment])), fields)
        self.collector.count_unlisted(rule, len(at) - len(listed))

    def done(self) -> list[Diagnostic]:
        """All diagnostics."""
        return self.collector.finish(rules.NOT_LISTED)


def segment_reporter(path: str, motion: MotionEvents) -> SegmentReporter:
    """Make a reporter without diagnostics for the text of a path."""
    return SegmentReporter(motion=motion, collector=Collector(path))


def misses_end(motion: MotionEvents, schedule: Schedule) -> Bools:
    """Find the segments that do not reach the end velocity that their calls ask for, (m,)."""
    found = np.empty(len(motion), dtype=np.bool_)
    for part in blocks(len(motion)):
        end, given, moves = schedule.profile.end[part], motion.vel_end[part], ~motion.dwell[part]
        slack = 1e-6 * (np.minimum(given, motion.vel[part]) + end) + 1e-12
        found[part] = moves & (np.abs(end - given) > slack)
    return found


def _starts_too_fast(motion: MotionEvents, schedule: Schedule) -> Bools:
    """Find the segments that start above their velocity, (m,)."""
    found = np.empty(len(motion), dtype=np.bool_)
    for part in blocks(len(motion)):
        found[part] = ~motion.dwell[part] & (schedule.profile.start[part] > motion.vel[part] * (1 + 1e-9))
    return found


def motion_diagnostics(events: Events, schedule: Schedule) -> list[Diagnostic]:
    """Report velocities that the calls ask for and the path cannot reach."""
    motion, profile = events.motion, schedule.profile
    reporter = segment_reporter(events.name, events.motion)
    if not len(motion):
        return []
    breaks = starts_at_rest(schedule.dwell, schedule.stage_first)
    end, start, given = profile.end, profile.start, motion.vel_end
    reporter.add(rules.END_VELOCITY_NOT_REACHED, misses_end(motion, schedule), value=end, wanted=given)
    reporter.add(rules.START_TOO_FAST, _starts_too_fast(motion, schedule), value=start, velocity=motion.vel)
    moves = ~motion.dwell
    last = np.append(breaks[1:], True)
    before_dwell = np.append(motion.dwell[1:], False)
    stops = (last | before_dwell) & moves & (end > 1e-9)
    reporter.add(rules.ABRUPT_STOP, stops, what=Phrase("the segment before a stop ends"), value=end)
    return reporter.done()


def path_diagnostics(events: Events, motion: Motion, machine: Machine) -> list[Diagnostic]:
    """Report corners and positions that the planner would not make.

    Corners at which the velocity vector changes by more than the machine's look-ahead allows; segments outside the
    field.
    """
    reporter = segment_reporter(events.name, events.motion)
    if len(motion):
        _report_corners(motion, machine, reporter)
        _report_field(motion.segments, machine, reporter)
    return reporter.done()


def _report_corners(motion: Motion, machine: Machine, reporter: SegmentReporter) -> None:
    """Report corners at which the velocity vector changes by more than the look-ahead allows."""
    schedule, segments, end = motion.schedule, motion.segments, motion.schedule.profile.end
    limit = float(machine.lookahead_time_ms * machine.lookahead_acc_pulse_per_ms2)
    # The ends are whole pulses: a straight line through points that are each off by half a pulse turns by so much.
    changes, rounding = segments.turns, segments.rounding_turns
    sharp, jumps = [], []
    for part in blocks(len(changes)):
        behind = slice(part.start + 1, part.stop + 1)
        jump = np.where(schedule.stage[part] == schedule.stage[behind], end[part] * changes[part], 0.0)
        by_rounding = np.where(jump > 0, end[part] * (rounding[part] + rounding[behind]), 0.0)
        at = np.flatnonzero(jump - by_rounding > limit * (1 + 1e-6))
        sharp.append(at + part.start)
        jumps.append(jump[at])
    at = np.concatenate([np.empty(0, dtype=np.intp), *sharp])
    reporter.add_at(rules.SHARP_CORNER, at, value=end[at], jump=np.concatenate([np.empty(0), *jumps]), limit=limit)


def _report_field(segments: Segments, machine: Machine, reporter: SegmentReporter) -> None:
    """Report segments outside the field."""
    at = _outside(segments, machine)
    x_low, x_high, y_low, y_high = segments.extent(at)
    for (axis, lowest, highest, (low, high), scale), (first, last) in zip(
        (
            ("X", x_low, x_high, machine.field_x_mm, machine.pulses_per_mm[0]),
            ("Y", y_low, y_high, machine.field_y_mm, machine.pulses_per_mm[1]),
        ),
        machine.field_pulse,
        strict=True,
    ):
        below, above = np.rint(lowest) < first, np.rint(highest) > last
        for where, values in ((below, lowest), (above & ~below, highest)):
            value = values[where] / scale
            reporter.add_at(rules.LISTING_FIELD, at[where], axis=axis, value=value, low=float(low), high=float(high))


def _outside(segments: Segments, machine: Machine) -> Indices:
    """Find the segments that leave the field, ascending."""
    (x_first, x_last), (y_first, y_last) = machine.field_pulse
    found = [np.empty(0, dtype=np.intp)]
    for part in blocks(len(segments.length)):
        x_low, x_high, y_low, y_high = map(np.rint, segments.extent(np.arange(part.start, part.stop)))
        outside = (x_low < x_first) | (x_high > x_last) | (y_low < y_first) | (y_high > y_last)
        found.append(np.flatnonzero(outside) + part.start)
    return np.concatenate(found)


def emission_diagnostics(channel: ChannelTrace, events: Events) -> list[Diagnostic]:
    """Report emission without a power or a power mode, and a laser that is left on."""
    lines, found = events.motion.line, list[Diagnostic]()

    def add(rule: Rule, line: int) -> None:
        fields = {"channel": channel.channel}
        found.append(Diagnostic(rule=rule, span=Span(line=line), fields=fields, path=events.name))

    unpowered = np.flatnonzero(channel.emitted.unpowered)
    if len(unpowered):
        add(rules.LISTING_NO_POWER, int(lines[unpowered[0]]))
    first = channel.first_emitting
    if first is not None and channel.laser_in(first).mode is None:
        add(rules.LISTING_NO_MODE, int(lines[first]))
    if channel.emission.on_at_end:
        last = int(lines[-1]) if len(lines) else 1
        switched_on = (action.line for action in events.at_end if action.channel == channel.channel and action.on)
        add(rules.LISTING_LEFT_ON, max([last, *switched_on]))
    return found
