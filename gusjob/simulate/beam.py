"""Where the beam is: it follows the commanded position with the scanner's lag.

On every piece of the path the command is a polynomial of time, at most quadratic, and a filter's answer to one is
known: a polynomial p(t) = c + k1*c' + k2*c'', plus what the filter still has to forget, fading as exp(-t/T). So nothing
is stepped through time: positions are exact on lines whatever the period, and within 0.01 pulse on arcs.

    order 1   T = tau     p1 = c - T*c' + T^2*c''
    order 2   T = tau/2   two filters of order 1 in a row; p1 as above, p2 = c - 2*T*c' + 3*T^2*c''

What is to be forgotten, one filter behind the other: y fades as y*exp(-t/T), x as (x + y*t/T)*exp(-t/T).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gusjob.config.machine import Scanner, ScannerModel
from gusjob.kinematics.arrays import Floats, Indices, counted
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.clock import Clock
from gusjob.simulate.path import Motion

_ARC_ERROR_PULSE = 0.01
"""How far the parabolas may lie off an arc; the beam's error is no larger, since both filters average."""

_NO_LAG_US = 1e-6

_FORGOTTEN = 42.0
"""After so many T less than 1e-18 is left of anything."""

_BETWEEN_STAGES = 1e3
"""The host waits between stages, in T: all is forgotten then."""

_BLOCK = 1 << 14
"""Pieces that are summed up at once: they stay in the processor's cache."""


@dataclass(frozen=True, kw_only=True)
class Beam:
    """Where the beam really is. The pieces are made when a lagging position is first asked for."""

    motion: Motion
    scanner: Scanner | None

    def position(self, stage: Indices, time: Floats) -> tuple[Floats, Floats]:
        """Position in the coordinate system, pulse. `stage` (k,): stage numbers; `time` (k,): ms on the clock's axis.

        A stage's command rests at its end from there on, and its beam stands still at its start before.
        """
        scanner = self.scanner
        if scanner is None or scanner.tracking_error_us < _NO_LAG_US:
            return _command(self.motion, stage, time)
        if scanner.model is ScannerModel.DELAY:
            return _command(self.motion, stage, time - scanner.tracking_error_us / US_PER_MS)
        return self._pieces.position(stage, time)

    @cached_property
    def _pieces(self) -> _Pieces:
        assert self.scanner is not None
        order = 1 if self.scanner.model is ScannerModel.FIRST_ORDER else 2
        return _pieces(self.motion, order, self.scanner.tracking_error_us / US_PER_MS / order)


def beam_of(motion: Motion, scanner: Scanner | None) -> Beam:
    """The beam of a motion; without a scanner, or with one that does not lag, it is where the command is."""
    return Beam(motion=motion, scanner=scanner)


def _command(motion: Motion, stage: Indices, time: Floats) -> tuple[Floats, Floats]:
    """Commanded position within stages. In a stage without motion: where the one before it ended, or 0."""
    clock = motion.clock
    time = np.maximum(time, clock.stage_start()[stage])
    cell = clock.segment_at(stage, time)
    x, y = motion.position(np.maximum(cell, 0), time)
    return np.where(cell < 0, 0.0, x), np.where(cell < 0, 0.0, y)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pieces:
    """The command cut into polynomials, and how the beam is off them.

    `first` (s+1,): each stage's first piece; its last is the rest behind its end. `start` (p,): ms. `command`
    (3, 2, p): coefficients of 1, t, t^2 by axis, t since the piece's start. `off` (order, 2, p): how far each filter
    is off its polynomial at the piece's start, by axis.
    """

    first: Indices
    start: Floats
    command: Floats
    off: Floats
    lag_ms: float

    def position(self, stage: Indices, time: Floats) -> tuple[Floats, Floats]:
        """Position of the beam, pulse."""
        at = np.searchsorted(self.start, time, side="right") - 1
        at = np.minimum(np.maximum(at, self.first[stage]), self.first[stage + 1] - 1)
        since = np.maximum(time - self.start[at], 0.0)
        elapsed = since / self.lag_ms
        off = self.off[-1][:, at]
        if len(self.off) == 2:
            off += elapsed * self.off[0][:, at]
        x, y = _answer(self.command[:, :, at], len(self.off), self.lag_ms, since) + off * np.exp(-elapsed)
        return x, y


def _answer(command: Floats, number: int, lag_ms: float, since: Floats | float) -> Floats:
    """What the filter `number` (1 or 2) of a row answers to polynomials (3, 2, k) in the long run: (2, k)."""
    at, slope, bend = command
    k1, k2 = (-lag_ms, lag_ms**2) if number == 1 else (-2 * lag_ms, 3 * lag_ms**2)
    return np.asarray(at + slope * since + bend * since * since + k1 * (slope + 2 * bend * since) + 2 * k2 * bend)


def _pieces(motion: Motion, order: int, lag_ms: float) -> _Pieces:
    """The pieces of all stages; `lag_ms`: T of each filter."""
    clock = motion.clock
    cut = _cut(clock)
    stage = clock.stage[cut.cell]
    stages = np.arange(len(clock.stage_first) - 1)
    # Each stage has one piece more, its rest.
    first = np.searchsorted(stage, np.arange(len(stages) + 1)) + np.arange(len(stages) + 1)
    place, rest = np.arange(len(stage)) + stage, first[1:] - 1
    start, length = np.empty(first[-1]), np.zeros(first[-1])
    start[place], start[rest], length[place] = cut.start, clock.stage_end(), cut.length
    command = np.zeros((3, 2, int(first[-1])))
    command[:, :, place] = _commands(clock, cut)
    command[0][:, rest] = _command(motion, stages, clock.stage_end())
    off = _jumps(command, length, first[:-1], order, lag_ms)
    _sum_up(off, start / lag_ms, np.repeat(stages, np.diff(first)).astype(np.float64))
    return _Pieces(first=first, start=start, command=command, off=off, lag_ms=lag_ms)


def _jumps(command: Floats, length: Floats, firsts: Indices, order: int, lag_ms: float) -> Floats:
    """By how much each filter's polynomial jumps at the start of each piece, (order, 2, p); a stage starts at rest."""
    jumps = np.empty((order, 2, len(length)))
    for number in range(order):
        answer = _answer(command, number + 1, lag_ms, 0.0)
        before = _answer(command[:, :, :-1], number + 1, lag_ms, length[:-1])
        jumps[number, :, 1:] = before - answer[:, 1:]
        jumps[number][:, firsts] = command[0][:, firsts] - answer[:, firsts]
    return jumps


def _sum_up(off: Floats, elapsed: Floats, stage: Floats) -> None:
    """Turn jumps (order, 2, p) into what they come to at the start of each piece, each faded by the time since.

    `elapsed` (p,): time in T. Within a block by doubling: after step n every piece bears the 2^n jumps before it.
    """
    for a in range(0, len(elapsed), _BLOCK):
        block = off[:, :, a : a + _BLOCK]
        time, number = elapsed[a : a + _BLOCK], stage[a : a + _BLOCK]
        step = 1
        while step < len(time):
            past = time[step:] - time[:-step] + _BETWEEN_STAGES * (number[step:] - number[:-step])
            if past.min() > _FORGOTTEN:
                break
            block[:, :, step:] += _faded(block[:, :, :-step], past)
            step *= 2
        if a:
            past = time - elapsed[a - 1] + _BETWEEN_STAGES * (number - stage[a - 1])
            block += _faded(off[:, :, a - 1 : a], past)


def _faded(off: Floats, past: Floats) -> Floats:
    """What is left of (order, 2, k) after a time in T."""
    left = off * np.exp(-past)
    if len(off) == 2:
        left[1] += past * left[0]
    return np.asarray(left)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cut:
    """Rise, cruise and fall of the timed calls, those of arcs cut further; nothing that takes no time. (q,) each.

    `start`, `length` in ms; `way`, `vel`: path length run since the call's start and velocity, at the piece's start.
    """

    cell: Indices
    start: Floats
    length: Floats
    way: Floats
    vel: Floats
    acc: Floats


def _cut(clock: Clock) -> _Cut:
    profile = clock.profile
    cruise = np.where(clock.dwell, clock.duration_ms, profile.cruise_ms)
    spans = np.stack([profile.rise_ms, cruise, profile.fall_ms], axis=1)
    taken = np.flatnonzero(spans.ravel() > 0)
    cell, phase = taken // 3, taken % 3
    span = spans.ravel()[taken]
    rise = profile.rise_ms[cell]
    up = np.where(profile.start[cell] > profile.peak[cell], -profile.acc[cell], profile.acc[cell])
    behind_rise = (profile.start[cell] + up * rise / 2) * rise
    way = np.where(phase > 0, behind_rise, 0.0) + np.where(phase > 1, profile.peak[cell] * cruise[cell], 0.0)
    start = np.where(phase > 0, rise, 0.0) + np.where(phase > 1, cruise[cell], 0.0)
    vel = np.where(phase == 0, profile.start[cell], profile.peak[cell])
    acc = np.where(phase == 0, up, np.where(phase == 2, -profile.acc[cell], 0.0))
    # Rounding must not put a piece behind the next call's start.
    start = np.minimum(clock.times_ms[cell] + start, clock.times_ms[cell + 1])
    cut = _Cut(cell=cell, start=start, length=span, way=way, vel=vel, acc=acc)
    return _cut_arcs(clock, cut) if len(clock.laid.arc_at) else cut


def _cut_arcs(clock: Clock, cut: _Cut) -> _Cut:
    """Pieces of arcs cut into equal times, such that a parabola through both ends and the middle is close enough.

    It is off by at most |c'''|*h^3 / (72*sqrt(3)), and |c'''| <= r*(w^3 + 3*w*w') with the angular velocity w.
    """
    laid = clock.laid
    radius = np.full(len(clock.row), np.nan)
    radius[laid.arc_at] = laid.arcs.radius
    round_ = np.flatnonzero(~np.isnan(radius[cut.cell]))
    size, span = radius[cut.cell[round_]], cut.length[round_]
    fastest = np.maximum(cut.vel[round_], cut.vel[round_] + cut.acc[round_] * span)
    angle, gained = fastest * span / size, np.abs(cut.acc[round_]) * span * span / size
    parts = np.ones(len(cut.cell), dtype=np.intp)
    error = size * (angle**3 + 3 * angle * gained) / (72 * np.sqrt(3.0))
    parts[round_] = np.maximum(np.ceil(np.cbrt(error / _ARC_ERROR_PULSE)), 1).astype(np.intp)
    which, part = counted(parts)
    length = cut.length[which] / parts[which]
    since, vel, acc = part * length, cut.vel[which], cut.acc[which]
    return _Cut(
        cell=cut.cell[which],
        start=np.minimum(cut.start[which] + since, clock.times_ms[cut.cell[which] + 1]),
        length=length,
        way=cut.way[which] + (vel + acc * since / 2) * since,
        vel=vel + acc * since,
        acc=acc,
    )


def _commands(clock: Clock, cut: _Cut) -> Floats:
    """Coefficients of the commanded position, (3, 2, q); a dwell stays where it is."""
    laid, cell = clock.laid, cut.cell
    length = np.where(laid.length > 0, laid.length, 1.0)
    command = np.empty((3, 2, len(cell)))
    for axis, (begin, end) in enumerate(((laid.x0, laid.x1), (laid.y0, laid.y1))):
        unit = ((end - begin) / length)[cell]
        command[0, axis] = begin[cell] + unit * cut.way
        command[1, axis] = unit * cut.vel
        command[2, axis] = unit * cut.acc / 2
    if len(laid.arc_at):
        _bend(clock, cut, command)
    return command


def _bend(clock: Clock, cut: _Cut, command: Floats) -> None:
    """Put in the parabolas of arcs, through both ends and the middle of each piece."""
    laid = clock.laid
    number = np.full(len(clock.row), -1, dtype=np.intp)
    number[laid.arc_at] = np.arange(len(laid.arc_at))
    number = number[cut.cell]
    at = np.flatnonzero(number >= 0)
    arcs, which = laid.arcs, number[at]
    radius, half, acc = arcs.radius[which], cut.length[at] / 2, cut.acc[at]
    turn = np.sign(arcs.sweep[which]) / radius
    angle = arcs.angle[which] + turn * cut.way[at]
    first = turn * (cut.vel[at] + acc * half / 2) * half
    second = turn * (cut.vel[at] + acc * half * 1.5) * half
    to_middle, to_end = _chord(radius, angle, first), _chord(radius, angle + first, second)
    command[0][0, at] = arcs.cx[which] + radius * np.cos(angle)
    command[0][1, at] = arcs.cy[which] + radius * np.sin(angle)
    command[1][:, at] = (3 * to_middle - to_end) / (2 * half)
    command[2][:, at] = (to_end - to_middle) / (2 * half * half)


def _chord(radius: Floats, angle: Floats, turn: Floats) -> Floats:
    """From one point of a circle to another, (2, k), without the cancellation of two positions."""
    size = 2 * radius * np.sin(turn / 2)
    return np.stack([-size * np.sin(angle + turn / 2), size * np.cos(angle + turn / 2)])
