"""The way of the beam while a laser shines: cut so that time and length follow from each other piece by piece.

A piece lies between two moments at which the command or the beam changes its law (knots), or is a part of that. Within
it the beam's way is a parabola of time through start, middle and end: exact for a command with constant acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.config.machine import Machine, ScannerModel
from gusjob.kinematics.arrays import Floats, Indices, counted
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import Trace
from gusjob.simulate.clock import Clock
from gusjob.simulate.spans import Spans

_BLOCK = 1 << 15
"""Moments worked on at once: they stay in the processor's cache."""

_ARC_STEP_RAD = 0.1
_STEP_IN_LAG = 0.25
_STEP_FOR_PULSE = 2.0
_QUIET_PULSE = 0.25
"""A lag's transient below this is over: a parabola through it is off by a hundredth of that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """The beam's way under light, piece by piece.

    `first` (k+1,): each mark's first piece. `start`, `length` (n,): ms. `x`, `y` (3, n): beam at start, middle and end
    of each, pulse. `before` (n,): mm run in all marks before each piece; `half`, `whole` (n,): mm run in it, to its
    middle and to its end.
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
        """When so much of a mark is run, ms, (q,)."""
        target = self.before[self.first[mark]] + run_mm
        piece = np.searchsorted(self.before, target, side="right") - 1
        piece = np.minimum(np.maximum(piece, self.first[mark]), self.first[mark + 1] - 1)
        left = target - self.before[piece]
        slope = np.clip(4 * self.half[piece] - self.whole[piece], 0.0, 2 * self.whole[piece])
        root = slope + np.sqrt(np.maximum(slope * slope + 4 * (self.whole[piece] - slope) * left, 0.0))
        share = np.divide(2 * left, root, out=np.zeros_like(root), where=root > 0)
        return np.asarray(self.start[piece] + self.length[piece] * np.clip(share, 0.0, 1.0))


def way_of(trace: Trace, machine: Machine, spans: Spans) -> Way:
    """The beam's way in spans of light."""
    px, py = machine.pulses_per_mm
    mark, start, length = _cut(trace, machine, spans)
    first = np.searchsorted(mark, np.arange(len(spans.stage) + 1))
    # Start and middle of every piece, and the end of each mark's last.
    node = 2 * np.arange(len(mark)) + mark
    time = np.empty(2 * len(mark) + len(spans.stage))
    stage = np.empty(len(time), dtype=np.intp)
    last = node[first[1:] - 1] + 2
    time[node], time[node + 1], time[last] = start, start + length / 2, spans.end_ms
    stage[node] = stage[node + 1] = spans.stage[mark]
    stage[last] = spans.stage
    x, y = np.empty((2, len(time)))
    for begin in range(0, len(time), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        x[part], y[part] = trace.beam.position(stage[part], time[part])
    chord = np.hypot(np.diff(x) / px, np.diff(y) / py)
    half = chord[node]
    whole = half + chord[node + 1]
    before = np.cumsum(whole) - whole
    nodes = np.stack([node, node + 1, node + 2])
    return Way(first=first, start=start, length=length, x=x[nodes], y=y[nodes], before=before, half=half, whole=whole)


def _cut(trace: Trace, machine: Machine, spans: Spans) -> tuple[Indices, Floats, Floats]:
    """(mark, start, length) of the pieces of all spans, in order."""
    clock, scanner = trace.clock, machine.scanner
    lag = scanner.tracking_error_us / US_PER_MS if scanner is not None else 0.0
    shift = lag if scanner is not None and scanner.model is ScannerModel.DELAY else 0.0
    knots = np.unique(np.concatenate([clock.times_ms, *clock.phases()]))
    mark, start, end = _between(clock, knots, spans, shift)
    length = end - start
    fading, step = _fading(clock, start, length, lag) if lag > shift else (np.zeros(len(length)), np.ones(len(length)))
    angle = _angle(trace, spans.stage[mark], start - shift, end - shift)
    share = np.divide(fading, length, out=np.zeros_like(length), where=length > 0)
    fine = np.maximum(np.ceil(fading / step), np.ceil(angle * share / _ARC_STEP_RAD))
    coarse = np.where(share < 1, np.maximum(np.ceil(angle * (1 - share) / _ARC_STEP_RAD), 1.0), 0.0)
    parts = np.stack([fine, coarse], axis=1).ravel().astype(np.intp)
    size = np.stack([fading, length - fading], axis=1).ravel() / np.maximum(parts, 1)
    begin = np.stack([start, start + fading], axis=1).ravel()
    which, part = counted(parts)
    return mark[which // 2], begin[which] + part * size[which], size[which]


def _between(clock: Clock, knots: Floats, spans: Spans, shift: float) -> tuple[Indices, Floats, Floats]:
    """Spans cut at the knots of their own stage, each `shift` later: (span, start, end)."""
    begin, finish = spans.start_ms - shift, spans.end_ms - shift
    low, high = clock.stage_start()[spans.stage], clock.stage_end()[spans.stage]
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
    start[ends - inside], end[ends] = spans.start_ms, spans.end_ms
    return which, start, end


def _angle(trace: Trace, stage: Indices, start: Floats, end: Floats) -> Floats:
    """By how much the command turns within pieces that lie in one timed call each, rad."""
    clock = trace.clock
    turned = np.zeros(len(start))
    if not len(clock.laid.arc_at):
        return turned
    middle = np.clip((start + end) / 2, clock.stage_start()[stage], clock.stage_end()[stage])
    cell = np.searchsorted(clock.times_ms[1:], middle, side="right")
    cell = np.clip(cell, clock.stage_first[stage], clock.stage_first[stage + 1] - 1)
    radius = np.zeros(len(clock.row))
    radius[clock.laid.arc_at] = clock.laid.arcs.radius
    round_ = np.flatnonzero((cell >= 0) & (radius[cell] > 0))
    cell = cell[round_]
    run = trace.motion.distance_run(cell, end[round_]) - trace.motion.distance_run(cell, start[round_])
    turned[round_] = run / radius[cell]
    return turned


def _fading(clock: Clock, start: Floats, length: Floats, lag: float) -> tuple[Floats, Floats]:
    """How long a lagging beam still swings in each piece, ms, and the steps in which that is followed, ms.

    A parabola through three points of D*exp(-t/lag), h apart in all, is off by 0.008*D*(h/lag)^3.
    """
    if not len(clock.row):
        return np.zeros(len(start)), np.ones(len(start))
    knots, kick = _kicks(clock, lag)
    with np.errstate(divide="ignore"):
        reach = np.where(kick > _QUIET_PULSE, lag * (np.log(kick / _QUIET_PULSE) + 1), 0.0)
    quiet = np.maximum.accumulate(knots + reach)
    at = np.searchsorted(knots, start, side="right") - 1
    left = np.maximum(quiet[at] - start, 0.0)
    swing = _QUIET_PULSE * np.exp(np.minimum(left / lag - 1, 50.0))
    step = lag * np.maximum(np.cbrt(_STEP_FOR_PULSE / swing), _STEP_IN_LAG)
    return np.minimum(left, length), step


def _kicks(clock: Clock, lag: float) -> tuple[Floats, Floats]:
    """(moment, pulse) of each change of the command's law, and how far it throws the beam off its way."""
    profile, laid = clock.profile, clock.laid
    risen, falls = clock.phases()
    acc, bend = np.where(clock.dwell, 0.0, profile.acc), np.zeros(len(clock.row))
    bend[laid.arc_at] = np.sign(laid.arcs.sweep) / np.maximum(laid.arcs.radius, 1e-9)
    begin, end = np.where(clock.dwell, 0.0, profile.start), np.where(clock.dwell, 0.0, profile.end)
    start_x, start_y, end_x, end_y = laid.start_x, laid.start_y, laid.end_x, laid.end_y
    out = _law(end, bend, end_x, end_y)
    come = _law(begin, bend, start_x, start_y)
    change = np.zeros(len(begin) + 1)
    for after, before, scale in zip(come, out, (lag, lag, lag**2, lag**2), strict=True):
        change += scale * np.abs(np.append(after, 0.0) - np.concatenate([[0.0], before]))
    # The path's own acceleration is taken as switched at every end: at most twice of what it is.
    change[:-1] += lag**2 * acc
    change[1:] += lag**2 * acc
    steady = (profile.rise_ms + profile.fall_ms) == 0
    change[:-1] -= np.where(steady, lag**2 * acc, 0.0)
    change[1:] -= np.where(steady, lag**2 * acc, 0.0)
    moments = np.concatenate([clock.times_ms, risen, falls])
    kicks = np.concatenate([change, *([np.where(steady, 0.0, lag**2 * acc)] * 2)])
    order = np.argsort(moments, kind="stable")
    return moments[order], kicks[order]


def _law(vel: Floats, bend: Floats, along_x: Floats, along_y: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Velocity and centripetal acceleration by axis."""
    pull = vel * vel * bend
    return vel * along_x, vel * along_y, -pull * along_y, pull * along_x
