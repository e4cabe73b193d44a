"""Stop a stage at a known time: the calls that run until the motion is at rest, and those that are left.

The motion slows down on its path from where it is at the stop. Each motion on the way becomes pieces that run exactly
like this; what is left of the last one runs after the next GT_CrdStart.
"""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.controllers.gus.execution import RunCalls, StageRun
from gusjob.controllers.gus.motions import limited_motions
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.trapezoids import REACHED
from gusjob.simulate.motion import Motion, scheduled

_NOTHING_PULSE = 1e-9
"""A piece no longer than this is none."""


class StoppedStage(Struct, frozen=True, kw_only=True, eq=False):
    """A stage that a stop ends: its rows, the rows that are left in the FIFO, and the time from its start to rest."""

    run: RunCalls
    rows: Indices
    rest: Indices
    end_ms: float


class _Pieces(Struct, frozen=True, kw_only=True, eq=False):
    """Pieces of segments on the way to rest, (k,): from and to a length along the segment, pulse, and their motion."""

    segment: Indices
    begin: Floats
    end: Floats
    vel: Floats
    acc: Floats
    vel_end: Floats

    def slowing_ms(self) -> Floats:
        """Return how long each piece takes but for the first one, which ran before the stop, (k-1,)."""
        return (self.vel_end[:-1] - self.vel_end[1:]) / self.acc[1:]

    def until(self, since_ms: float) -> _Pieces:
        """Return the pieces up to a time since the stop, at which the motion stops at once."""
        times = np.append(0.0, np.cumsum(self.slowing_ms()))
        last = int(np.searchsorted(times, since_ms))
        if last == len(times):
            return self
        cut = _Pieces(**{name: getattr(self, name)[: last + 1].copy() for name in self.__struct_fields__})
        if last:
            vel, acc, past_ms = self.vel_end[last - 1], self.acc[last], since_ms - times[last - 1]
            cut.end[last] = self.begin[last] + (vel - acc * past_ms / 2) * past_ms
            cut.vel_end[last] = vel - acc * past_ms
        return cut


def stop_stage(
    run: RunCalls,
    stage: StageRun,
    start: tuple[float, float],
    time_ms: float,
    dec_pulse_per_ms2: float,
    *,
    halt_ms: float = math.inf,
) -> StoppedStage | None:
    """Stop a stage.

    Args:
        run: The calls that run.
        stage: The stage that moves.
        start: Where it starts, pulse on the machine.
        time_ms: Time of the stop since its start.
        dec_pulse_per_ms2: Deceleration; 0: that of each segment, inf: it stops at once.
        halt_ms: Time of a second stop since its start: on its way to rest it stops at once.

    Returns:
        The stage, or None if its path slows down faster than the stop: that is not simulated.
    """
    rows = stage.rows
    at = np.flatnonzero(run.calls.kind[rows] <= Buffered.DELAY)
    one = np.zeros(len(at), dtype=np.intp)
    events = limited_motions(run, rows[at], one, [stage.settings], start).events
    motion = scheduled(events, np.array([0, len(at)]), (stage.settings.axes,))
    times = motion.schedule.times_ms
    if time_ms >= times[-1]:
        return StoppedStage(run=run, rows=rows, rest=rows[:0], end_ms=float(times[-1]))
    first = int(np.searchsorted(times, time_ms, side="right")) - 1
    if motion.schedule.dwell[first]:
        return _stop_dwell(run, rows, int(at[first]), time_ms - float(times[first]), time_ms)
    pieces = _pieces(motion, first, time_ms, dec_pulse_per_ms2)
    if pieces is None:
        return None
    pieces = pieces.until(halt_ms - time_ms)
    end_ms = time_ms + float(pieces.slowing_ms().sum())
    real = pieces.end - pieces.begin > _NOTHING_PULSE
    made = _made(run.calls, rows[at], motion, pieces, stage.settings.origin_pulse)
    origin = run.source(rows[at[pieces.segment]])
    count = len(run.calls)
    run = run.with_made(made, rows[at[pieces.segment]], np.ones(len(origin), dtype=np.bool_))
    last, along = int(pieces.segment[-1]), float(pieces.end[-1])
    # The rows up to the last motion, with pieces in the place of those from the first one on.
    place = np.arange(int(at[last]))
    kept = place[~np.isin(place, at[first : last + 1])]
    key = np.concatenate([kept, at[pieces.segment[real]]])
    ran = np.concatenate([rows[kept], count + np.flatnonzero(real)])[np.argsort(key, kind="stable")]
    rest = rows[int(at[last]) + 1 :]
    if float(motion.segments.length[last]) - along > _NOTHING_PULSE:
        run, row = _rest_of(run, int(rows[at[last]]), motion, last, along, stage.settings.origin_pulse)
        rest = np.concatenate([[row], rest])
    return StoppedStage(run=run, rows=ran, rest=rest.astype(np.intp), end_ms=end_ms)


def _stop_dwell(run: RunCalls, rows: Indices, at: int, past_ms: float, end_ms: float) -> StoppedStage:
    """End a dwell. What is left of it is not made up for (sister: a pause cancels it)."""
    made, count = run.calls.pick(rows[at : at + 1]), len(run.calls)
    made.p[0] = past_ms
    run = run.with_made(made, rows[at : at + 1], np.ones(1, dtype=np.bool_))
    return StoppedStage(run=run, rows=np.append(rows[:at], count), rest=rows[at + 1 :], end_ms=end_ms)


def _pieces(motion: Motion, first: int, time_ms: float, dec: float) -> _Pieces | None:
    """Cut the path from a segment on: what ran before the stop, then the way to rest; None: see stop_stage."""
    schedule, profile = motion.schedule, motion.schedule.profile
    number, time = np.array([first]), np.array([time_ms])
    along, vel = float(motion.distance_run(number, time)[0]), float(motion.velocity(number, time)[0])
    since = time_ms - float(schedule.times_ms[first])
    peak = vel if since < profile.rise_ms[first] else float(profile.peak[first])
    dwells = np.flatnonzero(schedule.dwell[first:])
    stop = first + int(dwells[0]) if len(dwells) else len(motion)  # A dwell stops the motion anyway.
    ways = motion.segments.length[first:stop].copy()
    ways[0] -= along
    if math.isinf(dec):
        segment, length, ends = number[:0], ways[:0], ways[:0]
        acc = ways[:0]
    else:
        acc = np.full(len(ways), dec) if dec else profile.acc[first:stop]
        left2 = vel * vel - np.cumsum(2 * acc * ways)
        slack = REACHED * vel * vel
        over = np.flatnonzero(left2 <= slack)
        count = int(over[0]) + 1 if len(over) else len(ways)
        acc, left2 = acc[:count], np.where(left2[:count] <= slack, 0.0, left2[:count])
        if (left2 > profile.end[first : first + count] ** 2 + slack).any():
            return None
        segment, length, ends = np.arange(first, first + count), ways[:count].copy(), np.sqrt(left2)
        if len(over):
            length[-1] = min(length[-1], float(np.append(vel, ends)[count - 1]) ** 2 / (2 * acc[-1]))
    begin = np.zeros(len(segment))
    begin[:1] = along
    return _Pieces(
        segment=np.append(first, segment),
        begin=np.append(0.0, begin),
        end=np.append(along, begin + length),
        vel=np.append(peak, np.append(vel, ends[:-1])[: len(segment)]),
        acc=np.append(profile.acc[first], acc),
        vel_end=np.append(vel, ends),
    )


def _made(
    calls: BufferedCalls, rows: Indices, motion: Motion, pieces: _Pieces, origin: tuple[float, float]
) -> BufferedCalls:
    """Make the calls of pieces; positions in the coordinate system."""
    made, number = calls.pick(rows[pieces.segment]), pieces.segment
    length = np.maximum(motion.segments.length[number], _NOTHING_PULSE)
    x, y = motion.segments.points(number, pieces.end / length)
    made.x[:], made.y[:] = x - origin[0], y - origin[1]
    made.vel[:], made.acc[:], made.vel_end[:] = np.maximum(pieces.vel, _LEAST), pieces.acc, pieces.vel_end
    _set_centres(made, motion, number, pieces.begin / length)
    return made


_LEAST = 1e-12
"""Velocity of a piece that the motion does not move on, pulse/ms."""


def _rest_of(
    run: RunCalls, row: int, motion: Motion, number: int, along: float, origin: tuple[float, float]
) -> tuple[RunCalls, int]:
    """Return the row that runs the rest of a motion: the same, or for an arc one with its centre relative to there."""
    if run.calls.kind[row] <= Buffered.LINE_TO_REST:
        return run, row
    made, count = run.calls.pick(np.array([row])), len(run.calls)
    _set_centres(made, motion, np.array([number]), np.array([along / float(motion.segments.length[number])]))
    return run.with_made(made, np.array([row]), np.zeros(1, dtype=np.bool_)), count


def _set_centres(made: BufferedCalls, motion: Motion, number: Indices, share: Floats) -> None:
    """Give arcs that begin at a share of their segment's length their centre relative to there."""
    segments = motion.segments
    which, arcs = segments.arcs_among(number)
    if len(which):
        x, y = segments.points(number[which], share[which])
        made.kind[which] = Buffered.ARC_CENTRE
        made.p[which], made.q[which] = arcs.cx - x, arcs.cy - y
