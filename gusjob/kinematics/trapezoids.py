"""Velocity trapezoids and look-ahead: pure functions on arrays. Units: pulse, ms, pulse/ms, pulse/ms2.

    velocity
      peak |      ________________
           |     /                \\
     start |    /                  \\
           |   /                    \\  end
           +---+-----+------------+---+--> time
               | rise_ms| cruise_ms  | fall_ms
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices

REACHED = 1e-9
"""Relative difference of squared velocities below which a velocity counts as reached: rounding, not physics."""

_BLOCK = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class Trapezoids:
    """One velocity profile a segment; all fields (n,)."""

    start: Floats
    peak: Floats
    end: Floats
    acc: Floats
    rise_ms: Floats
    cruise_ms: Floats
    fall_ms: Floats

    @property
    def duration_ms(self) -> Floats:
        """Time of each segment, ms."""
        return np.asarray(self.rise_ms + self.cruise_ms + self.fall_ms)


def running_sum(values: Floats) -> Floats:
    """Sums before each element and the total behind: (n,) -> (n+1,), each exact to one rounding.

    A plain cumsum of a million durations is off by 1e-7 ms. Here each value is split into a whole number of small
    steps, which int64 sums exactly, and a remainder so small that its own sum's rounding does not matter.
    """
    top = float(np.max(np.abs(values), initial=0.0)) * max(len(values), 1)
    sums = np.zeros(len(values) + 1)
    if top == 0.0:
        return sums
    step = 2.0 ** (np.ceil(np.log2(top)) - 61)
    whole = np.rint(values / step)
    steps = np.zeros(len(values) + 1, dtype=np.int64)
    np.cumsum(whole.astype(np.int64), out=steps[1:])
    np.cumsum(values - whole * step, out=sums[1:])
    sums += steps * step
    return sums


def trapezoids(length: Floats, start: Floats, vel: Floats, end: Floats, acc: Floats) -> Trapezoids:
    """The profile of each segment from `start` up to `vel` down to `end`; `end` must be reachable and <= `vel`.

    A start above `vel` slows down to it first (its `rise` then falls).
    """
    # Squares are taken as products of sum and difference: at speed, over a short way, they differ in the last
    # digits only.
    gained = (end - start) * (end + start) / 2
    top2 = acc * length + (start * start + end * end) / 2
    with np.errstate(divide="ignore", invalid="ignore"):
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
    return Trapezoids(start=start, peak=peak, end=end, acc=acc, rise_ms=rise, cruise_ms=cruise, fall_ms=fall)


def reached_ends(length: Floats, vel: Floats, wanted: Floats, acc: Floats, breaks: Bools) -> Floats:
    """End velocity that each segment really reaches, in order, (n,).

    Each segment starts at what the one before it reached, or at 0 where `breaks` is set. From start v0 over length L
    the square of the end velocity lies within v0^2 +- 2*a*L; a wanted end outside is replaced by the nearest inside.
    Nearly every list asks for what it can get: then no loop runs. Else a loop follows each chain of misses until a
    wanted end is met again.
    """
    aim = np.minimum(wanted, vel)
    aim2 = aim * aim
    gain = 2 * acc * length
    before = np.zeros_like(aim2)
    before[1:] = aim2[:-1]
    before[breaks] = 0.0
    slack = REACHED * (aim2 + before) + 1e-300
    missed = np.flatnonzero(np.abs(aim2 - before) > gain + slack)
    if not len(missed):
        return aim
    reached2 = aim2.copy()
    n = len(aim2)
    done = -1
    for first in missed.tolist():
        i = first
        if i <= done:
            continue
        w0 = 0.0 if breaks[i] else float(reached2[i - 1]) if i else 0.0
        while i < n:
            target, span = float(aim2[i]), float(gain[i])
            if i > first and (breaks[i] or abs(target - w0) <= span + REACHED * (target + w0)):
                break
            w0 = min(max(target, w0 - span), w0 + span)
            reached2[i] = w0
            i += 1
        # Segment i starts at what was reached: it may itself miss, and then stands in `missed` or is followed here.
        done = i - 1
    return np.asarray(np.sqrt(reached2))


def distance_run(profile: Trapezoids, which: Indices, since_ms: Floats) -> Floats:
    """Length that some of the segments have run a time after their start, pulse."""
    rise, cruise = profile.rise_ms[which], profile.cruise_ms[which]
    start, peak, acc = profile.start[which], profile.peak[which], profile.acc[which]
    in_rise = np.minimum(since_ms, rise)
    in_cruise = np.clip(since_ms - rise, 0.0, cruise)
    in_fall = np.maximum(since_ms - rise - cruise, 0.0)
    up = np.where(start > peak, -acc, acc) * in_rise * in_rise / 2
    return start * in_rise + up + peak * in_cruise + peak * in_fall - acc * in_fall * in_fall / 2


def corner_velocity(out_x: Floats, out_y: Floats, in_x: Floats, in_y: Floats, jump: Floats) -> Floats:
    """Highest velocity through each corner at which the velocity vector changes by at most `jump` (pulse/ms), (n,).

    (out_x, out_y) is the unit direction at the end of the segment before the corner, (in_x, in_y) at the start of
    the one behind. At velocity v the vector changes by v*|in - out| = 2*v*sin(phi/2).
    """
    change = np.hypot(in_x - out_x, in_y - out_y)
    with np.errstate(divide="ignore"):
        return np.asarray(np.where(change > 1e-12, jump / np.maximum(change, 1e-300), np.inf))


def look_ahead(length: Floats, acc: Floats, limit: Floats, breaks: Bools) -> Floats:
    """End velocities of segments in a row, (n,).

    Each is the highest that limits, lengths and accelerations allow from both sides. `limit` (n,): highest end
    velocity of each segment (corner, both neighbours' velocity). `breaks` (n,): the segment starts at rest whatever
    the one before it ended at. The first one starts at rest; the last one's limit is its own.
    """
    ends2 = limit * limit
    gain = 2 * acc * length
    ends2[breaks] = np.minimum(ends2[breaks], gain[breaks])
    ends2 = _ramp(ends2, gain)
    if len(ends2) > 1:
        # Backwards: what segment i+1 can get rid of bounds the end of segment i.
        lost = np.where(breaks, np.inf, gain)
        tail = ends2[-1:]
        ends2 = _ramp(np.concatenate([tail, ends2[-2::-1]]), np.concatenate([tail, lost[:0:-1]]))[::-1]
    return np.sqrt(ends2)


def _ramp(limit2: Floats, gain: Floats) -> Floats:
    """w[i] = min(limit2[i], w[i-1] + gain[i]) with w[-1] = 0, without a loop over segments.

    min over j <= i of limit2[j] + (S[i] - S[j]), with S the running sum of gain, is a minimum.accumulate. A gain at
    or above the limit never binds, so it is cut there: S stays small beside what is compared. Blocks keep it
    smaller.
    """
    w = np.empty_like(limit2)
    cut = np.minimum(gain, limit2)
    carry = 0.0
    for a in range(0, len(w), _BLOCK):
        lim, sums = limit2[a : a + _BLOCK].copy(), np.cumsum(cut[a : a + _BLOCK])
        lim[0] = min(lim[0], carry + gain[a])
        free = lim - sums
        low = np.minimum.accumulate(free)
        binding = np.maximum.accumulate(np.where(free <= low, np.arange(len(lim)), 0))
        w[a : a + _BLOCK] = np.minimum(lim, lim[binding] + (sums - sums[binding]))
        carry = float(w[min(a + _BLOCK, len(w)) - 1])
    _settle(w, gain)
    return w


def _settle(w: Floats, gain: Floats) -> None:
    """Take back what rounding gave too much: a near tie in the sums can leave w[i] above w[i-1] + gain[i]."""
    over = np.flatnonzero(w[1:] > (w[:-1] + gain[1:]) * (1 + 1e-13)) + 1
    for first in over.tolist():
        i = first
        while i < len(w) and w[i] > w[i - 1] + gain[i]:
            w[i] = w[i - 1] + gain[i]
            i += 1
