"""Beam position: the beam follows the commanded position with the scanner's lag.

On every part of the path the command is a polynomial of time, at most quadratic, and a filter's response to one is
known: a polynomial p(t) = c + k1*c' + k2*c'', plus a transient that decays as exp(-t/T). So nothing is stepped through
time: positions are exact on lines whatever the period, and within 0.01 pulse on arcs.

    order 1   T = tau     p1 = c - T*c' + T^2*c''
    order 2   T = tau/2   two filters of order 1 in series; p1 as above, p2 = c - 2*T*c' + 3*T^2*c''

Transients of two filters in series: y decays as y*exp(-t/T), x as (x + y*t/T)*exp(-t/T).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Scanner, ScannerModel
from gusjob.kinematics.arrays import Floats, Indices, counted
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.motion import Motion

_ARC_ERROR_PULSE = 0.01
"""Largest distance of the parabolas from an arc; the beam's error is no larger, since both filters average."""

_NO_LAG_US = 1e-6

_DECAYED = 42.0
"""After so many T less than 1e-18 is left of a transient."""

_BETWEEN_STAGES = 1e3
"""The host waits between stages, in T: all transients have decayed then."""

_BLOCK = 1 << 14
"""Polynomials that are summed up at once: they fit in the processor's cache."""


class Beam(Struct, frozen=True, kw_only=True, dict=True):
    """Beam position of a motion. Without a scanner, or with one that does not lag, it is the commanded position.

    The polynomials are made when a lagging position is first computed.
    """

    motion: Motion
    scanner: Scanner | None

    @property
    def is_planned(self) -> bool:
        """Whether the beam is where the motion is planned: nothing lags."""
        return self.scanner is None or self.scanner.tracking_error_us < _NO_LAG_US

    def position(self, stage: Indices, time: Floats) -> tuple[Floats, Floats]:
        """Compute positions on the machine.

        A stage's command stays at its end after the stage, and the beam rests at its start before.

        Args:
            stage: Stage numbers, (k,).
            time: Moments on the schedule's time axis, (k,) ms.

        Returns:
            x and y, (k,) pulse.
        """
        scanner = self.scanner
        if scanner is None or self.is_planned:
            return _commanded(self.motion, stage, time)
        if scanner.model is ScannerModel.DELAY:
            return _commanded(self.motion, stage, time - scanner.tracking_error_us / US_PER_MS)
        return self._polynomials.position(stage, time)

    @cached_property
    def _polynomials(self) -> _Polynomials:
        assert self.scanner is not None
        order = 1 if self.scanner.model is ScannerModel.FIRST_ORDER else 2
        return _polynomials(self.motion, order, self.scanner.tracking_error_us / US_PER_MS / order)


def _commanded(motion: Motion, stage: Indices, time: Floats) -> tuple[Floats, Floats]:
    """Commanded position within stages. In a stage without segments: where the one before it ended, or 0."""
    schedule = motion.schedule
    time = np.maximum(time, schedule.stage_start()[stage])
    segment = schedule.segment_at(stage, time)
    x, y = motion.position(np.maximum(segment, 0), time)
    return np.where(segment < 0, 0.0, x), np.where(segment < 0, 0.0, y)


class _Polynomials(Struct, frozen=True, kw_only=True, eq=False):
    """The command as polynomials of time, and the beam's transients.

    `first` (s+1,): number of each stage's first polynomial; its last one is the rest after its end. `start` (p,): ms.
    `command` (3, 2, p): coefficients of 1, t, t^2 by axis, t since the polynomial's start. `transient` (order, 2, p):
    each filter's transient at the polynomial's start, by axis.
    """

    first: Indices
    start: Floats
    command: Floats
    transient: Floats
    lag_ms: float

    def position(self, stage: Indices, time: Floats) -> tuple[Floats, Floats]:
        """Position of the beam, pulse."""
        at = np.searchsorted(self.start, time, side="right") - 1
        at = np.minimum(np.maximum(at, self.first[stage]), self.first[stage + 1] - 1)
        since = np.maximum(time - self.start[at], 0.0)
        elapsed = since / self.lag_ms
        transient = self.transient[-1][:, at]
        if len(self.transient) == 2:
            transient += elapsed * self.transient[0][:, at]
        steady = _response(self.command[:, :, at], len(self.transient), self.lag_ms, since)
        x, y = steady + transient * np.exp(-elapsed)
        return x, y


def _response(command: Floats, number: int, lag_ms: float, since: Floats | float) -> Floats:
    """Steady response of the filter `number` (1 or 2) in the series to polynomials (3, 2, k): (2, k)."""
    at, slope, bend = command
    k1, k2 = (-lag_ms, lag_ms**2) if number == 1 else (-2 * lag_ms, 3 * lag_ms**2)
    return np.asarray(at + slope * since + bend * since * since + k1 * (slope + 2 * bend * since) + 2 * k2 * bend)


def _polynomials(motion: Motion, order: int, lag_ms: float) -> _Polynomials:
    """Make the polynomials of all stages; `lag_ms`: T of each filter."""
    schedule = motion.schedule
    phases = _phases(motion)
    stage = schedule.stage[phases.segment]
    stages = np.arange(len(schedule.stage_first) - 1)
    # Each stage has one polynomial more, its rest.
    first = np.searchsorted(stage, np.arange(len(stages) + 1)) + np.arange(len(stages) + 1)
    moving, rest = np.arange(len(stage)) + stage, first[1:] - 1
    start, length = np.empty(first[-1]), np.zeros(first[-1])
    start[moving], start[rest], length[moving] = phases.start, schedule.stage_end(), phases.length
    command = np.zeros((3, 2, int(first[-1])))
    command[:, :, moving] = _coefficients(motion, phases)
    command[0][:, rest] = _commanded(motion, stages, schedule.stage_end())
    transient = _jumps(command, length, first[:-1], order, lag_ms)
    _sum_up(transient, start / lag_ms, np.repeat(stages, np.diff(first)).astype(np.float64))
    return _Polynomials(first=first, start=start, command=command, transient=transient, lag_ms=lag_ms)


def _jumps(command: Floats, length: Floats, firsts: Indices, order: int, lag_ms: float) -> Floats:
    """Jump of each filter's steady response at the start of each polynomial, (order, 2, p); a stage starts at rest."""
    jumps = np.empty((order, 2, len(length)))
    for number in range(order):
        after = _response(command, number + 1, lag_ms, 0.0)
        before = _response(command[:, :, :-1], number + 1, lag_ms, length[:-1])
        jumps[number, :, 1:] = before - after[:, 1:]
        jumps[number][:, firsts] = command[0][:, firsts] - after[:, firsts]
    return jumps


def _sum_up(transient: Floats, elapsed: Floats, stage: Floats) -> None:
    """Turn jumps (order, 2, p) in place into transients: the sum of all earlier jumps, each decayed since.

    `elapsed` (p,): time in T. Within a block by doubling: after step n every entry holds the 2^n jumps before it.
    """
    for a in range(0, len(elapsed), _BLOCK):
        block = transient[:, :, a : a + _BLOCK]
        time, number = elapsed[a : a + _BLOCK], stage[a : a + _BLOCK]
        step = 1
        while step < len(time):
            past = time[step:] - time[:-step] + _BETWEEN_STAGES * (number[step:] - number[:-step])
            if past.min() > _DECAYED:
                break
            block[:, :, step:] += _decayed(block[:, :, :-step], past)
            step *= 2
        if a:
            past = time - elapsed[a - 1] + _BETWEEN_STAGES * (number - stage[a - 1])
            block += _decayed(transient[:, :, a - 1 : a], past)


def _decayed(transient: Floats, past: Floats) -> Floats:
    """Remainder of transients (order, 2, k) after a time in T."""
    left = transient * np.exp(-past)
    if len(transient) == 2:
        left[1] += past * left[0]
    return np.asarray(left)


class _Phases(Struct, frozen=True, kw_only=True, eq=False):
    """Acceleration, cruise and deceleration of segments, those of arcs cut further; none is empty. (q,) each.

    `start`, `length` in ms; `run`, `vel`: path length since the segment's start and velocity, at the phase's start.
    """

    segment: Indices
    start: Floats
    length: Floats
    run: Floats
    vel: Floats
    acc: Floats


def _phases(motion: Motion) -> _Phases:
    schedule, profile = motion.schedule, motion.schedule.profile
    cruise = np.where(schedule.dwell, schedule.duration_ms, profile.cruise_ms)
    lengths = np.stack([profile.rise_ms, cruise, profile.fall_ms], axis=1)
    taken = np.flatnonzero(lengths.ravel() > 0)
    segment, phase = taken // 3, taken % 3
    length = lengths.ravel()[taken]
    rise = profile.rise_ms[segment]
    up = np.where(profile.start[segment] > profile.peak[segment], -profile.acc[segment], profile.acc[segment])
    after_rise = (profile.start[segment] + up * rise / 2) * rise
    cruised = profile.peak[segment] * cruise[segment]
    run = np.where(phase > 0, after_rise, 0.0) + np.where(phase > 1, cruised, 0.0)
    start = np.where(phase > 0, rise, 0.0) + np.where(phase > 1, cruise[segment], 0.0)
    vel = np.where(phase == 0, profile.start[segment], profile.peak[segment])
    acc = np.where(phase == 0, up, np.where(phase == 2, -profile.acc[segment], 0.0))
    # Rounding must not put a phase behind the next segment's start.
    start = np.minimum(schedule.times_ms[segment] + start, schedule.times_ms[segment + 1])
    phases = _Phases(segment=segment, start=start, length=length, run=run, vel=vel, acc=acc)
    return _cut_arcs(motion, phases) if len(motion.segments.arc_at) else phases


def _cut_arcs(motion: Motion, phases: _Phases) -> _Phases:
    """Cut phases of arcs into equal times, such that a parabola through both ends and the middle is close enough.

    It is off by at most |c'''|*h^3 / (72*sqrt(3)), and |c'''| <= r*(w^3 + 3*w*w') with the angular velocity w.
    """
    segments = motion.segments
    radius = np.full(len(motion), np.nan)
    radius[segments.arc_at] = segments.arcs.radius
    on_arc = np.flatnonzero(~np.isnan(radius[phases.segment]))
    size, span = radius[phases.segment[on_arc]], phases.length[on_arc]
    fastest = np.maximum(phases.vel[on_arc], phases.vel[on_arc] + phases.acc[on_arc] * span)
    angle, gained = fastest * span / size, np.abs(phases.acc[on_arc]) * span * span / size
    parts = np.ones(len(phases.segment), dtype=np.intp)
    error = size * (angle**3 + 3 * angle * gained) / (72 * np.sqrt(3.0))
    parts[on_arc] = np.maximum(np.ceil(np.cbrt(error / _ARC_ERROR_PULSE)), 1).astype(np.intp)
    which, part = counted(parts)
    length = phases.length[which] / parts[which]
    since, vel, acc = part * length, phases.vel[which], phases.acc[which]
    end = motion.schedule.times_ms[phases.segment[which] + 1]
    return _Phases(
        segment=phases.segment[which],
        start=np.minimum(phases.start[which] + since, end),
        length=length,
        run=phases.run[which] + (vel + acc * since / 2) * since,
        vel=vel + acc * since,
        acc=acc,
    )


def _coefficients(motion: Motion, phases: _Phases) -> Floats:
    """Coefficients of the commanded position, (3, 2, q); a dwell stays where it is."""
    segments, segment = motion.segments, phases.segment
    length = np.where(segments.length > 0, segments.length, 1.0)
    command = np.empty((3, 2, len(segment)))
    for axis, (begin, end) in enumerate(((segments.x0, segments.x1), (segments.y0, segments.y1))):
        unit = ((end - begin) / length)[segment]
        command[0, axis] = begin[segment] + unit * phases.run
        command[1, axis] = unit * phases.vel
        command[2, axis] = unit * phases.acc / 2
    if len(segments.arc_at):
        _set_arcs(motion, phases, command)
    return command


def _set_arcs(motion: Motion, phases: _Phases, command: Floats) -> None:
    """Set the parabolas of arcs, through both ends and the middle of each phase."""
    segments = motion.segments
    number = np.full(len(motion), -1, dtype=np.intp)
    number[segments.arc_at] = np.arange(len(segments.arc_at))
    number = number[phases.segment]
    at = np.flatnonzero(number >= 0)
    arcs, which = segments.arcs, number[at]
    radius, half, acc = arcs.radius[which], phases.length[at] / 2, phases.acc[at]
    turn = np.sign(arcs.sweep[which]) / radius
    angle = arcs.angle[which] + turn * phases.run[at]
    first = turn * (phases.vel[at] + acc * half / 2) * half
    second = turn * (phases.vel[at] + acc * half * 1.5) * half
    to_middle, to_end = _chord(radius, angle, first), _chord(radius, angle + first, second)
    command[0][0, at] = arcs.cx[which] + radius * np.cos(angle)
    command[0][1, at] = arcs.cy[which] + radius * np.sin(angle)
    command[1][:, at] = (3 * to_middle - to_end) / (2 * half)
    command[2][:, at] = (to_end - to_middle) / (2 * half * half)


def _chord(radius: Floats, angle: Floats, turn: Floats) -> Floats:
    """Vector from one point of a circle to another, (2, k), without the cancellation of two positions."""
    size = 2 * radius * np.sin(turn / 2)
    return np.stack([-size * np.sin(angle + turn / 2), size * np.cos(angle + turn / 2)])
