"""Path of the beam during emission, cut so that time and length follow from each other part by part.

A part lies between two moments at which the command or the beam changes its law (knots), or is a fraction of that. In
a part the beam's path is a parabola of time through start, middle and end: exact for a command with constant
acceleration.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine, ScannerModel
from gusjob.kinematics.arrays import Floats, Indices, counted, distinct
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import Trace
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.motion import Motion

_BLOCK = 1 << 15
"""Moments that are computed at once: they fit in the processor's cache."""

_ARC_STEP_RAD = 0.1
_STEP_IN_LAG = 0.25
_STEP_FOR_PULSE = 2.0
_SETTLED_PULSE = 0.25
"""A transient below this is over: a parabola through it is off by a hundredth of that."""


class BeamPath(Struct, frozen=True, kw_only=True, eq=False):
    """Path of the beam during marks, in parts, (n,).

    `first` (k+1,): number of each mark's first part. `start`, `length`: ms. `x`, `y` (3, n): beam at start, middle and
    end of each, pulse. `before`: path length in all marks before each part, mm; `half`, `whole`: path length in it, to
    its middle and to its end.
    """

    first: Indices
    start: Floats
    length: Floats
    x: Floats
    y: Floats
    before: Floats
    half: Floats
    whole: Floats

    def mark_mm(self) -> Floats:
        """Length of each mark, (k,)."""
        total = np.append(self.before, self.before[-1:] + self.whole[-1:]) if len(self.before) else np.zeros(1)
        return np.asarray(total[self.first[1:]] - total[self.first[:-1]])

    def moment(self, mark: Indices, run_mm: Floats) -> Floats:
        """Moments at which the beam has run a length of its mark, (q,) ms."""
        target = self.before[self.first[mark]] + run_mm
        part = np.searchsorted(self.before, target, side="right") - 1
        part = np.minimum(np.maximum(part, self.first[mark]), self.first[mark + 1] - 1)
        left = target - self.before[part]
        slope = np.clip(4 * self.half[part] - self.whole[part], 0.0, 2 * self.whole[part])
        root = slope + np.sqrt(np.maximum(slope * slope + 4 * (self.whole[part] - slope) * left, 0.0))
        share = np.divide(2 * left, root, out=np.zeros_like(root), where=root > 0)
        return np.asarray(self.start[part] + self.length[part] * np.clip(share, 0.0, 1.0))


def beam_path_of(trace: Trace, machine: Machine, intervals: Intervals) -> BeamPath:
    """Compute the beam's path in emission intervals, one mark each."""
    px, py = machine.pulses_per_mm
    mark, start, length = _cut(trace, machine, intervals)
    first = np.searchsorted(mark, np.arange(len(intervals.stage) + 1))
    # Start and middle of every part, and the end of each mark's last.
    node = 2 * np.arange(len(mark)) + mark
    time = np.empty(2 * len(mark) + len(intervals.stage))
    stage = np.empty(len(time), dtype=np.intp)
    last = node[first[1:] - 1] + 2
    time[node], time[node + 1], time[last] = start, start + length / 2, intervals.end_ms
    stage[node] = stage[node + 1] = intervals.stage[mark]
    stage[last] = intervals.stage
    x, y = np.empty((2, len(time)))
    for begin in range(0, len(time), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        x[part], y[part] = trace.beam.position(stage[part], time[part])
    chord = np.hypot(np.diff(x) / px, np.diff(y) / py)
    half = chord[node]
    whole = half + chord[node + 1]
    before = np.cumsum(whole) - whole
    nodes = np.stack([node, node + 1, node + 2])
    return BeamPath(
        first=first, start=start, length=length, x=x[nodes], y=y[nodes], before=before, half=half, whole=whole
    )


def _cut(trace: Trace, machine: Machine, intervals: Intervals) -> tuple[Indices, Floats, Floats]:
    """Cut all intervals: (mark, start, length) of the parts, in order."""
    schedule, scanner = trace.schedule, machine.scanner
    lag = scanner.tracking_error_us / US_PER_MS if scanner is not None else 0.0
    shift = lag if scanner is not None and scanner.model is ScannerModel.DELAY else 0.0
    knots = distinct(np.concatenate([schedule.times_ms, *schedule.phases()]))
    mark, start, end = _between(schedule, knots, intervals, shift)
    length = end - start
    settling, step = np.zeros(len(length)), np.ones(len(length))
    if lag > shift:
        settling, step = _settling(trace.motion, start, length, lag)
    angle = _angle(trace, intervals.stage[mark], start - shift, end - shift)
    share = np.divide(settling, length, out=np.zeros_like(length), where=length > 0)
    fine = np.maximum(np.ceil(settling / step), np.ceil(angle * share / _ARC_STEP_RAD))
    coarse = np.where(share < 1, np.maximum(np.ceil(angle * (1 - share) / _ARC_STEP_RAD), 1.0), 0.0)
    parts = np.stack([fine, coarse], axis=1).ravel().astype(np.intp)
    size = np.stack([settling, length - settling], axis=1).ravel() / np.maximum(parts, 1)
    begin = np.stack([start, start + settling], axis=1).ravel()
    which, part = counted(parts)
    return mark[which // 2], begin[which] + part * size[which], size[which]


def _between(schedule: Schedule, knots: Floats, intervals: Intervals, shift: float) -> tuple[Indices, Floats, Floats]:
    """Cut intervals at the knots of their own stage, each `shift` later: (interval, start, end) of each part."""
    begin, finish = intervals.start_ms - shift, intervals.end_ms - shift
    low, high = schedule.stage_start()[intervals.stage], schedule.stage_end()[intervals.stage]
    first = np.searchsorted(knots, begin, side="right")
    first = np.where(begin < low, np.searchsorted(knots, low), first)
    last = np.searchsorted(knots, finish)
    last = np.where(finish > high, np.searchsorted(knots, high, side="right"), last)
    inside = np.maximum(last - first, 0)
    which = np.repeat(np.arange(len(inside)), inside + 1)
    ends = np.cumsum(inside + 1) - 1
    number = np.arange(len(which)) - (ends - inside)[which] + first[which]
    start = knots[np.clip(number - 1, 0, len(knots) - 1)] + shift
    end = knots[np.minimum(number, len(knots) - 1)] + shift
    start[ends - inside], end[ends] = intervals.start_ms, intervals.end_ms
    return which, start, end


def _angle(trace: Trace, stage: Indices, start: Floats, end: Floats) -> Floats:
    """By how much the command turns within parts that lie in one segment each, rad."""
    schedule, segments = trace.schedule, trace.segments
    turned = np.zeros(len(start))
    if not len(segments.arc_at):
        return turned
    middle = np.clip((start + end) / 2, schedule.stage_start()[stage], schedule.stage_end()[stage])
    segment = np.searchsorted(schedule.times_ms[1:], middle, side="right")
    segment = np.clip(segment, schedule.stage_first[stage], schedule.stage_first[stage + 1] - 1)
    radius = np.zeros(len(trace))
    radius[segments.arc_at] = segments.arcs.radius
    on_arc = np.flatnonzero((segment >= 0) & (radius[segment] > 0))
    segment = segment[on_arc]
    run = trace.motion.distance_run(segment, end[on_arc]) - trace.motion.distance_run(segment, start[on_arc])
    turned[on_arc] = run / radius[segment]
    return turned


def _settling(motion: Motion, start: Floats, length: Floats, lag: float) -> tuple[Floats, Floats]:
    """How long a lagging beam has transients in each part, ms, and the step in which they are followed, ms.

    A parabola through three points of D*exp(-t/lag), h apart in all, is off by 0.008*D*(h/lag)^3.
    """
    if not len(motion):
        return np.zeros(len(start)), np.ones(len(start))
    knots, kick = _kicks(motion, lag)
    with np.errstate(divide="ignore"):
        reach = np.where(kick > _SETTLED_PULSE, lag * (np.log(kick / _SETTLED_PULSE) + 1), 0.0)
    settled = np.maximum.accumulate(knots + reach)
    at = np.searchsorted(knots, start, side="right") - 1
    left = np.maximum(settled[at] - start, 0.0)
    transient = _SETTLED_PULSE * np.exp(np.minimum(left / lag - 1, 50.0))
    step = lag * np.maximum(np.cbrt(_STEP_FOR_PULSE / transient), _STEP_IN_LAG)
    return np.minimum(left, length), step


def _kicks(motion: Motion, lag: float) -> tuple[Floats, Floats]:
    """(moment, pulse) of each change of the command's law, and how large a transient it causes."""
    schedule, segments, profile = motion.schedule, motion.segments, motion.schedule.profile
    risen, falls = schedule.phases()
    acc, bend = np.where(schedule.dwell, 0.0, profile.acc), np.zeros(len(motion))
    bend[segments.arc_at] = np.sign(segments.arcs.sweep) / np.maximum(segments.arcs.radius, 1e-9)
    begin, end = np.where(schedule.dwell, 0.0, profile.start), np.where(schedule.dwell, 0.0, profile.end)
    every = np.arange(len(motion))
    out = _law(end, bend, *segments.end_direction(every))
    come = _law(begin, bend, *segments.start_direction(every))
    change = np.zeros(len(begin) + 1)
    for after, before, scale in zip(come, out, (lag, lag, lag**2, lag**2), strict=True):
        change += scale * np.abs(np.append(after, 0.0) - np.concatenate([[0.0], before]))
    # The path's own acceleration is taken as switched at every end: at most twice of what it is.
    change[:-1] += lag**2 * acc
    change[1:] += lag**2 * acc
    steady = (profile.rise_ms + profile.fall_ms) == 0
    change[:-1] -= np.where(steady, lag**2 * acc, 0.0)
    change[1:] -= np.where(steady, lag**2 * acc, 0.0)
    moments = np.concatenate([schedule.times_ms, risen, falls])
    kicks = np.concatenate([change, *([np.where(steady, 0.0, lag**2 * acc)] * 2)])
    order = np.argsort(moments, kind="stable")
    return moments[order], kicks[order]


def _law(vel: Floats, bend: Floats, along_x: Floats, along_y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Velocity and centripetal acceleration by axis."""
    pull = vel * vel * bend
    return vel * along_x, vel * along_y, -pull * along_y, pull * along_x
