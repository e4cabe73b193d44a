"""Diagnostics of a simulation: velocities that the path cannot reach, corners, the field, emission."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Bools, Floats, blocks
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
        listed = at[: self.collector.remaining(rule)].tolist()
        for i in listed:
            fields: dict[str, object] = {k: v if isinstance(v, str) else float(v[i]) for k, v in columns.items()}
            self.collector.add(rule, Span(line=int(self.motion.line[i])), fields)
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


def motion_diagnostics(events: Events, schedule: Schedule) -> list[Diagnostic]:
    """Report velocities that the calls ask for and the path cannot reach."""
    motion, profile = events.motion, schedule.profile
    reporter = segment_reporter(events.name, events.motion)
    if not len(motion):
        return []
    breaks = starts_at_rest(schedule.dwell, schedule.stage_first)
    end, start, given = profile.end, profile.start, motion.vel_end
    moves = ~motion.dwell
    reporter.add(rules.END_VELOCITY_NOT_REACHED, misses_end(motion, schedule), value=end, wanted=given)
    reporter.add(rules.START_TOO_FAST, moves & (start > motion.vel * (1 + 1e-9)), value=start, velocity=motion.vel)
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
    schedule, segments = motion.schedule, motion.segments
    end = schedule.profile.end
    reporter = segment_reporter(events.name, events.motion)
    if not len(end):
        return []
    limit = machine.lookahead_time_ms * machine.lookahead_acc_pulse_per_ms2
    jump = end[:-1] * segments.turns
    jump = np.append(np.where(np.diff(schedule.stage) == 0, jump, 0.0), 0.0)
    # The ends are whole pulses: a straight line through points that are each off by half a pulse turns by so much.
    turns = segments.rounding_turns
    rounding = np.append(np.where(jump[:-1] > 0, end[:-1] * (turns[:-1] + turns[1:]), 0.0), 0.0)
    sharp = jump - rounding > limit * (1 + 1e-6)
    reporter.add(rules.SHARP_CORNER, sharp, value=end, jump=jump, limit=np.full(len(jump), limit))
    x_low, x_high, y_low, y_high = segments.extent(np.arange(len(end)))
    for (axis, lowest, highest, (low, high), scale), (first, last) in zip(
        (
            ("X", x_low, x_high, machine.field_x_mm, machine.pulses_per_mm[0]),
            ("Y", y_low, y_high, machine.field_y_mm, machine.pulses_per_mm[1]),
        ),
        machine.field_pulse,
        strict=True,
    ):
        below, above = np.rint(lowest) < first, np.rint(highest) > last
        bounds = {"low": np.full(len(end), low), "high": np.full(len(end), high)}
        reporter.add(rules.LISTING_FIELD, below, axis=axis, value=lowest / scale, **bounds)
        reporter.add(rules.LISTING_FIELD, above & ~below, axis=axis, value=highest / scale, **bounds)
    return reporter.done()


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
