"""Sums of power under distance follow on lines, without a term for each tick.

Within one phase of the velocity and on one side of the references the power at the ticks is a quadratic of their
number. Where a limit is met in between, the piece is left to a sum by ticks.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.trapezoids import distance_run, time_of_run
from gusjob.simulate.motion import Motion
from gusjob.simulate.power_settings import CLAMPED, StageLasers
from gusjob.simulate.tick_runs import RunSums, TickRuns

_TOUCHES = 1e-12
"""Relative distance beyond a limit up to which a power only touches it: rounding."""


def distance_sums(
    motion: Motion, lasers: StageLasers, runs: TickRuns, by_ticks: Callable[[TickRuns], RunSums]
) -> RunSums:
    """Sum up the power of runs under distance follow of the planned position; arcs only where nothing moves.

    Args:
        motion: The motion.
        lasers: Distance follow in each stage.
        runs: The runs.
        by_ticks: Sums up the pieces in which a limit is met.
    """
    run, pieces, phase = _pieces(motion, lasers, runs)
    settings, at, count = pieces.settings, pieces.settings.stage, pieces.count
    # Order of the limits: that of the base power, those of distance follow, those of the mode.
    base, is_whole, is_over = _base(pieces, phase)
    power = _with_distance(motion, lasers, pieces, phase, base)
    low, high = np.maximum(lasers.low[at], settings.mode_low), np.minimum(lasers.high[at], settings.mode_high)
    lowest, highest = power.extremes(count)
    free = is_whole & (low < high)
    inside = free & (lowest >= low - _slack(low, _TOUCHES)) & (highest <= high + _slack(high, _TOUCHES))
    beyond = (highest < low - _slack(low, 2 * CLAMPED)) | (lowest > high + _slack(high, 2 * CLAMPED))
    beyond &= free
    held = is_over | beyond
    closed = RunSums(
        total=power.total(count),
        lowest=np.clip(lowest, low, high),
        highest=np.clip(highest, low, high),
        last=np.clip(power.value(count - 1), low, high),
        held=np.where(held, count, 0.0),
        last_held=held,
    )
    closed.total[beyond] = (count * closed.lowest)[beyond]
    mixed = np.flatnonzero(~(inside | beyond))
    if len(mixed):
        closed.put(mixed, by_ticks(pieces.pick(mixed)))
    return closed.joined(run)


def _slack(limit: Floats, relative: float) -> Floats:
    return np.asarray(relative * (1 + np.abs(limit)))


class _TickVelocity(Struct, frozen=True, kw_only=True, eq=False):
    """Velocity at the first tick of pieces and its change, (p,): pulse/ms, pulse/ms2."""

    velocity: Floats
    acc: Floats


class _Quadratic(Struct, frozen=True, kw_only=True, eq=False):
    """Quadratics c0 + c1*k + c2*k^2 of the number k of a tick, (p,)."""

    c0: Floats
    c1: Floats
    c2: Floats

    def value(self, number: Floats) -> Floats:
        return np.asarray(self.c0 + (self.c1 + self.c2 * number) * number)

    def total(self, count: Floats) -> Floats:
        """Sum over k = 0 .. count - 1."""
        last = count - 1
        return np.asarray(count * (self.c0 + last / 2 * (self.c1 + self.c2 * (2 * count - 1) / 3)))

    def extremes(self, count: Floats) -> tuple[Floats, Floats]:
        """Lowest and highest value at whole k = 0 .. count - 1."""
        curved = self.c2 != 0
        turn = np.divide(-self.c1, 2 * self.c2, out=np.zeros_like(self.c1), where=curved)
        before = np.clip(np.floor(turn), 0.0, count - 1)
        values = [self.value(k) for k in (np.zeros_like(count), before, np.minimum(before + 1, count - 1), count - 1)]
        return np.minimum.reduce(values), np.maximum.reduce(values)


def _pieces(motion: Motion, lasers: StageLasers, runs: TickRuns) -> tuple[Indices, TickRuns, _TickVelocity]:
    """Cut runs where the phase changes and where X or Y passes its reference; return the run of each piece, too."""
    rising = runs.rising(motion)
    falling = runs.falling(motion, rising)
    edges = np.zeros((len(runs.segment), 6))
    edges[:, 1], edges[:, 2], edges[:, 5] = rising, runs.count - falling, runs.count
    segments, at = motion.segments, runs.settings.stage
    edges[:, 3] = _passes(motion, runs, segments.x0, segments.x1, lasers.reference_x[at])
    edges[:, 4] = _passes(motion, runs, segments.y0, segments.y1, lasers.reference_y[at])
    edges.sort(axis=1)
    run, number = np.nonzero(np.diff(edges, axis=1) > 0)
    skipped = edges[run, number]
    pieces = runs.parts(run, skipped, edges[run, number + 1] - skipped)
    is_rise, is_fall = skipped < rising[run], skipped >= (runs.count - falling)[run]
    return run, pieces, _tick_velocity(motion, pieces, is_rise, is_fall)


def _passes(motion: Motion, runs: TickRuns, begin: Floats, end: Floats, reference: Floats) -> Floats:
    """Number of the first tick at which a coordinate of lines is past its reference, (r,), within 0 and the count."""
    begins = begin[runs.segment]
    way = end[runs.segment] - begins
    share = np.divide(reference - begins, way, out=np.zeros_like(way), where=(way != 0) & ~runs.still)
    passes = np.flatnonzero((share > 0) & (share < 1))
    segment, ticks = runs.segment[passes], np.zeros(len(way))
    moment = time_of_run(motion.schedule.profile, segment, share[passes] * motion.segments.length[segment])
    ticks[passes] = np.ceil((moment - runs.since_ms[passes]) / runs.period_ms)
    return np.clip(ticks, 0.0, runs.count)


def _tick_velocity(motion: Motion, pieces: TickRuns, is_rise: Bools, is_fall: Bools) -> _TickVelocity:
    """Find the velocity of pieces, each within one phase."""
    profile, at = motion.schedule.profile, pieces.segment
    start, peak, acc = profile.start[at], profile.peak[at], profile.acc[at]
    up = np.where(start > peak, -acc, acc)
    before_end = pieces.left_ms + (pieces.count - 1) * pieces.period_ms
    cruise_or_fall = np.where(is_fall, profile.end[at] + acc * before_end, peak)
    velocity = np.where(is_rise, start + up * pieces.since_ms, cruise_or_fall)
    change = np.where(is_rise, up, np.where(is_fall, -acc, 0.0))
    return _TickVelocity(velocity=np.where(pieces.still, 0.0, velocity), acc=np.where(pieces.still, 0.0, change))


def _base(pieces: TickRuns, phase: _TickVelocity) -> tuple[_Quadratic, Bools, Bools]:
    """Compute the base power of pieces; whether its limit is met at all ticks or at none; whether at all."""
    settings, period = pieces.settings, pieces.period_ms
    slope = settings.ratio * phase.acc * period
    base = _Quadratic(c0=settings.low + settings.ratio * phase.velocity, c1=slope, c2=np.zeros_like(slope))
    first, last, high = base.c0, base.value(pieces.count - 1), settings.high
    is_under = np.maximum(first, last) <= high * (1 + _TOUCHES)
    is_over = np.minimum(first, last) > high * (1 + 2 * CLAMPED)
    base.c0[is_over], base.c1[is_over] = high[is_over], 0.0
    return base, is_under | is_over, is_over


def _with_distance(
    motion: Motion, lasers: StageLasers, pieces: TickRuns, phase: _TickVelocity, base: _Quadratic
) -> _Quadratic:
    """Add the distance term to the base power of pieces."""
    period, stage = pieces.period_ms, pieces.settings.stage
    segments, schedule, segment = motion.segments, motion.schedule, pieces.segment
    since = np.minimum(pieces.since_ms, schedule.duration_ms[segment])
    run, length = distance_run(schedule.profile, segment, since), segments.length[segment]
    share = np.divide(run, length, out=np.zeros_like(run), where=length > 0)
    c0, c1, c2 = base.c0 + lasers.constant[stage], base.c1, base.c2
    # Path length of one tick, of half the ticks.
    by_tick, bend = phase.velocity * period, phase.acc * period * period / 2
    half = (pieces.count - 1) / 2
    middle = (by_tick + bend * half) * half
    sides = (
        (segments.x0, segments.x1, lasers.reference_x, lasers.per_x),
        (segments.y0, segments.y1, lasers.reference_y, lasers.per_y),
    )
    for place, (begin, end, reference, per_pulse) in zip(segments.points(segment, share), sides, strict=True):
        way = end[segment] - begin[segment]
        unit = np.divide(way, length, out=np.zeros_like(way), where=(length > 0) & ~pieces.still)
        away = place - reference[stage]
        ratio = per_pulse[stage] * np.where(away + unit * middle < 0, -1.0, 1.0)
        c0, c1, c2 = c0 + ratio * away, c1 + ratio * unit * by_tick, c2 + ratio * unit * bend
    return _Quadratic(c0=c0, c1=c1, c2=c2)
