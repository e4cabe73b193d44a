r"""Velocity trapezoids and look-ahead: pure functions on arrays. Units: pulse, ms, pulse/ms, pulse/ms2.

    velocity
      peak |      ________________
           |     /                \
     start |    /                  \
           |   /                    \  end
           +---+-----+------------+---+--> time
               | rise_ms| cruise_ms  | fall_ms
"""  # noqa: D208  (a figure)

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks

REACHED = 1e-9
"""Relative difference of squared velocities below which a velocity counts as reached: rounding, not physics."""

_BLOCK = 4096
"""Segments that are added up at a time in look-ahead."""

_CACHED = 1 << 14
"""Segments whose profiles are computed at a time: they fit in the processor's cache."""


class Trapezoids(Struct, frozen=True, kw_only=True, eq=False):
    """Velocity profile of each segment, (n,): velocities in pulse/ms, `acc` in pulse/ms2, times in ms."""

    start: Floats
    peak: Floats
    end: Floats
    acc: Floats
    rise_ms: Floats
    cruise_ms: Floats
    fall_ms: Floats

    @property
    def duration_ms(self) -> Floats:
        """Duration of each segment, (n,) ms."""
        duration = self.rise_ms + self.cruise_ms
        duration += self.fall_ms
        return duration


def trapezoids(length: Floats, start: Floats, vel: Floats, end: Floats, acc: Floats) -> Trapezoids:
    """Compute the profile of each segment: from `start` up to `vel`, down to `end`.

    Args:
        length: Length, (n,) pulse.
        start: Velocity at the start, (n,) pulse/ms. If it is above `vel`, the segment first slows down (in `rise_ms`).
        vel: Highest velocity, (n,) pulse/ms.
        end: Velocity at the end, (n,) pulse/ms; it must be reachable and at most `vel`.
        acc: Acceleration, (n,) pulse/ms2.
    """
    columns = length, start, vel, end, acc
    peak, rise, cruise, fall = (np.empty(len(length)) for _ in range(4))
    for first in range(0, len(length), _CACHED):
        block = slice(first, first + _CACHED)
        peak[block], rise[block], cruise[block], fall[block] = _phases(*(column[block] for column in columns))
    return Trapezoids(start=start, peak=peak, end=end, acc=acc, rise_ms=rise, cruise_ms=cruise, fall_ms=fall)


def _phases(
    length: Floats, start: Floats, vel: Floats, end: Floats, acc: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Compute peak, rise_ms, cruise_ms and fall_ms of some segments. Arguments as of trapezoids."""
    # Differences of squares as products of sum and difference: at speed, over a short length, the squares differ in
    # the last digits only.
    gained = (end - start) * (end + start) / 2
    top2 = acc * length + (start * start + end * end) / 2
    # Velocity or acceleration may be so small that a time is infinite.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        tip = (top2 < vel * vel) & (start <= vel)
        peak = np.maximum(np.where(tip, np.sqrt(top2), vel), end)
        up = np.where(tip, acc * length + gained, np.abs(peak - start) * (peak + start))
        down = np.where(tip, acc * length - gained, (peak - end) * (peak + end))
        rise = np.where(tip, np.maximum(up, 0.0) / (peak + start), np.abs(peak - start)) / acc
        fall = np.where(tip, np.maximum(down, 0.0) / (peak + end), peak - end) / acc
        left = length - (up + down) / (2 * acc)
        cruise = np.where(tip | (peak <= 0), 0.0, np.maximum(left, 0.0) / peak)
    # A cruise below rounding of its own length is the tip of a triangle.
    cruise[left <= length * 1e-12] = 0.0
    none = length <= 0
    for part in (rise, cruise, fall):
        part[none] = 0.0
    return peak, rise, cruise, fall


def peak_velocity(length: Floats, start: Floats, vel: Floats, end: Floats, acc: Floats) -> Floats:
    """Compute the highest velocity of each segment, (n,) pulse/ms. Arguments as for trapezoids."""
    peak = np.empty(len(length))
    for block in blocks(len(length)):
        own_start, own_end = start[block], end[block]
        tip = np.sqrt(acc[block] * length[block] + (own_start * own_start + own_end * own_end) / 2)
        peak[block] = np.maximum(np.maximum(np.minimum(tip, vel[block]), own_start), own_end)
    return peak


def even_velocity(length: Floats, start: Floats, vel: Floats, end: Floats, acc: Floats, even_time_ms: Floats) -> Floats:
    """Lower the velocity of each segment so far that it is constant for at least a given time, if that is possible.

    With the velocity v, rise and fall take (2*v^2 - start^2 - end^2) / (2*acc) of the length; v*even_time must be left.
    The velocity is not lowered below start or end: then it is constant for as long as the length allows. A segment that
    starts above its velocity keeps it.

    Args:
        length, start, vel, end, acc: As for trapezoids, (n,).
        even_time_ms: Least time at constant velocity, (n,) ms; 0: no limit.

    Returns:
        Highest velocities, (n,) pulse/ms.
    """
    top2 = acc * length + (start * start + end * end) / 2
    half = acc * even_time_ms / 2
    # The root of v^2 + acc*even_time*v = top2, without cancellation.
    with np.errstate(invalid="ignore"):
        even = top2 / (half + np.sqrt(half * half + top2))
    lowered = np.minimum(vel, np.maximum(even, np.maximum(start, end)))
    return np.where((even_time_ms > 0) & (start <= vel), lowered, vel)


def reached_ends(length: Floats, vel: Floats, given: Floats, acc: Floats, breaks: Bools) -> Floats:
    """Compute the end velocity that each segment really reaches, in order.

    Each segment starts at what the one before it reached, or at 0 where `breaks` is set. From start v0 over length L
    the square of the end velocity is within v0^2 +- 2*a*L; a given end outside is replaced by the nearest inside. In
    nearly every job all of them can be reached: then no loop runs. Else a loop follows each chain of misses until a
    given end is met again.

    Args:
        length, vel, acc: Length, highest velocity and acceleration, (n,) pulse, pulse/ms, pulse/ms2.
        given: Given end velocity, (n,) pulse/ms.
        breaks: Segments that start at rest, (n,).

    Returns:
        End velocities, (n,) pulse/ms.
    """
    goal = np.minimum(given, vel)
    missed = [np.empty(0, dtype=np.intp)]
    for part in blocks(len(goal)):
        goal2 = goal[part] * goal[part]
        before = np.zeros_like(goal2)
        before[1:] = goal2[:-1]
        before[:1] = goal[part.start - 1] * goal[part.start - 1] if part.start else 0.0
        before[breaks[part]] = 0.0
        slack = REACHED * (goal2 + before) + 1e-300
        off = np.abs(goal2 - before) > 2 * acc[part] * length[part] + slack
        missed.append(np.flatnonzero(off) + part.start)
    return _reached_after(np.concatenate(missed), goal, 2 * acc * length, breaks) if sum(map(len, missed)) else goal


def _reached_after(missed: Indices, goal: Floats, gain: Floats, breaks: Bools) -> Floats:
    """Follow the chains of segments that miss the velocity `goal` at their end. Other arguments as in reached_ends."""
    goal2 = goal * goal
    reached2 = goal2.copy()
    n = len(goal2)
    done = -1
    for first in missed.tolist():
        i = first
        if i <= done:
            continue
        w0 = 0.0 if breaks[i] else float(reached2[i - 1]) if i else 0.0
        while i < n:
            target, span = float(goal2[i]), float(gain[i])
            if i > first and (breaks[i] or abs(target - w0) <= span + REACHED * (target + w0)):
                break
            w0 = min(max(target, w0 - span), w0 + span)
            reached2[i] = w0
            i += 1
        # Segment i starts at what was reached: it may miss itself, and then it is in `missed` or is followed here.
        done = i - 1
    return np.asarray(np.sqrt(reached2))


def distance_run(profile: Trapezoids, which: Indices, since_ms: Floats) -> Floats:
    """Compute the length that some segments have run a time after their start, (k,) pulse.

    Args:
        which: Numbers of the segments, (k,).
        since_ms: Time since their start, (k,).
    """
    rise, cruise = profile.rise_ms[which], profile.cruise_ms[which]
    start, peak, acc = profile.start[which], profile.peak[which], profile.acc[which]
    in_rise = np.minimum(since_ms, rise)
    in_cruise = np.clip(since_ms - rise, 0.0, cruise)
    in_fall = np.maximum(since_ms - rise - cruise, 0.0)
    up = np.where(start > peak, -acc, acc) * in_rise * in_rise / 2
    return start * in_rise + up + peak * in_cruise + peak * in_fall - acc * in_fall * in_fall / 2


def time_of_run(profile: Trapezoids, which: Indices, run: Floats) -> Floats:
    """Compute when some segments have run a length, (k,) ms after their start. The inverse of distance_run.

    Args:
        which: Numbers of the segments, (k,).
        run: Length since their start, (k,) pulse.
    """
    rise, cruise, fall = profile.rise_ms[which], profile.cruise_ms[which], profile.fall_ms[which]
    start, peak, end, acc = profile.start[which], profile.peak[which], profile.end[which], profile.acc[which]
    up = np.where(start > peak, -acc, acc)
    cruised = run - (start + peak) / 2 * rise
    left = np.maximum((peak + end) / 2 * fall + peak * cruise - cruised, 0.0)
    # Quadratic equations without cancellation. A denominator of 0 is that of no length.
    from_start = start + np.sqrt(np.maximum(start * start + 2 * up * run, 0.0))
    to_end = end + np.sqrt(end * end + 2 * acc * left)
    in_rise = np.divide(2 * run, from_start, out=np.zeros_like(run), where=from_start > 0)
    in_fall = np.divide(2 * left, to_end, out=np.zeros_like(run), where=to_end > 0)
    in_cruise = np.divide(cruised, peak, out=np.zeros_like(run), where=peak > 0)
    duration = rise + cruise + fall
    later = np.where(cruised < peak * cruise, rise + in_cruise, duration - in_fall)
    return np.clip(np.where(cruised < 0, in_rise, later), 0.0, duration)


def corner_velocity(change: Floats, jump: Floats, spacing: Floats, acc: float) -> Floats:
    """Compute the highest velocity through each corner, (n,) pulse/ms.

    At velocity v the velocity vector changes by v*change. Corners that follow each other at a spacing L change it by
    v^2*change/L in a unit of time: on the chords of a circle of radius r that is v^2/r, as on the circle.

    Args:
        change: Change of the unit direction at each corner, |in - out| = 2*sin(phi/2), (n,).
        jump: Largest change of the velocity vector at one corner, (n,) pulse/ms.
        spacing: Mean length of the segments before and behind the corner, (n,) pulse.
        acc: Largest change of the velocity vector in a unit of time, pulse/ms2.
    """
    turn = np.maximum(change, 1e-300)
    with np.errstate(over="ignore"):
        limit = np.minimum(jump / turn, np.sqrt(acc * spacing / turn))
    return np.asarray(np.where(change > 1e-12, limit, np.inf))


def look_ahead(length: Floats, acc: Floats, limit: Floats, breaks: Bools) -> Floats:
    """Compute the end velocities of segments: the highest that limits, lengths and accelerations allow.

    Args:
        length: Length of each segment, (n,) pulse.
        acc: Acceleration, (n,) pulse/ms2.
        limit: Highest end velocity of each segment (corner, velocity of both neighbours), (n,) pulse/ms.
        breaks: Segments that start at rest, whatever the one before them ended at, (n,). The first one always does.

    Returns:
        End velocities, (n,) pulse/ms.
    """
    ends2 = limit * limit
    gain = np.empty(len(ends2) + 1)
    for part in blocks(len(ends2)):
        gain[part] = 2 * acc[part] * length[part]
    ends2[breaks] = np.minimum(ends2[breaks], gain[:-1][breaks])
    _ramp(ends2, gain[:-1])
    if len(ends2) > 1:
        # Backwards: what segment i+1 can lose limits the end of segment i.
        gain[:-1][breaks] = np.inf
        gain[-1] = ends2[-1]
        _ramp(ends2[::-1], gain[:0:-1])
    return np.sqrt(ends2, out=ends2)


def _ramp(w: Floats, gain: Floats) -> None:
    """Compute w[i] = min(limit2[i], w[i-1] + gain[i]) with w[-1] = 0 in place of limit2, without a loop over segments.

    min over j <= i of limit2[j] + (S[i] - S[j]), with S the running sum of gain, is a minimum.accumulate. A gain at
    or above the limit never binds, so it is cut there: S stays small beside what is compared. Blocks keep it
    smaller.
    """
    carry = 0.0
    for a in range(0, len(w), _BLOCK):
        lim = w[a : a + _BLOCK].copy()
        sums = np.cumsum(np.minimum(gain[a : a + _BLOCK], lim))
        lim[0] = min(lim[0], carry + gain[a])
        free = lim - sums
        low = np.minimum.accumulate(free)
        binding = np.maximum.accumulate(np.where(free <= low, np.arange(len(lim)), 0))
        w[a : a + _BLOCK] = np.minimum(lim, lim[binding] + (sums - sums[binding]))
        carry = float(w[min(a + _BLOCK, len(w)) - 1])
    _settle(w, gain)


def _settle(w: Floats, gain: Floats) -> None:
    """Correct rounding in place: a near tie in the sums can leave w[i] above w[i-1] + gain[i]."""
    for part in blocks(len(w) - 1):
        at = np.flatnonzero(w[1:][part] > (w[:-1][part] + gain[1:][part]) * (1 + 1e-13)) + 1 + part.start
        _settle_from(at, w, gain)


def _settle_from(over: Indices, w: Floats, gain: Floats) -> None:
    for first in over.tolist():
        i = first
        while i < len(w) and w[i] > w[i - 1] + gain[i]:
            w[i] = w[i - 1] + gain[i]
            i += 1
