"""The schedule of a path: start time, duration and velocity profile of every segment.

Each stage starts at rest. Length in pulse, velocity in pulse/ms, acceleration in pulse/ms2, time in ms. Values that the
path can't reach are scheduled like this: an end velocity that length and acceleration can't reach is replaced by the
nearest reachable one, and the next segment starts with it; a start above the segment's velocity slows down to it first;
a corner is passed at the given velocity; where motion stops without slowing down before (a dwell, the end of a stage),
it stops at once.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices, running_sum
from gusjob.kinematics.trapezoids import Trapezoids, even_velocity, reached_ends, trapezoids


class Schedule(Struct, frozen=True, kw_only=True, eq=False):
    """Time and velocity of each segment or dwell, (m,); stages follow each other on one time axis.

    `times_ms` (m+1,): the start of each and the end of the last. `stage` (m,): the stage of each. `stage_first` (s+1,):
    the number of each stage's first segment, and m.
    """

    profile: Trapezoids
    dwell: Bools
    duration_ms: Floats
    times_ms: Floats
    stage: Indices
    stage_first: Indices

    def stage_start(self) -> Floats:
        """Return the start of each stage, (s,) ms."""
        return self.times_ms[self.stage_first[:-1]]

    def stage_end(self) -> Floats:
        """Return the end of each stage, (s,) ms."""
        return self.times_ms[self.stage_first[1:]]

    def phases(self) -> tuple[Floats, Floats]:
        """Return the end of the acceleration and the start of the deceleration of each segment, (m,) ms."""
        profile, begin, end = self.profile, self.times_ms[:-1], self.times_ms[1:]
        risen = np.where(self.dwell, begin, np.minimum(begin + profile.rise_ms, end))
        falls = np.where(self.dwell, begin, np.minimum(begin + profile.rise_ms + profile.cruise_ms, end))
        return risen, falls

    def segment_at(self, stage: Indices, time_ms: Floats) -> Indices:
        """Find the segment that runs at some times within stages, (k,).

        After a stage's end, and in a stage without segments, it is the last one before; -1 before all motion.

        Args:
            stage: Number of the stage, (k,).
            time_ms: Time, (k,).
        """
        first, last = self.stage_first[stage], self.stage_first[stage + 1] - 1
        found = np.searchsorted(self.times_ms[:-1], time_ms, side="right") - 1
        return np.asarray(np.minimum(np.maximum(found, first), last))


def stage_numbers(stage_first: Indices) -> Indices:
    """Number the stage of each segment, (m,). `stage_first` (s+1,): number of each stage's first segment, and m."""
    counts = np.diff(stage_first)
    number: Indices = np.arange(len(counts))
    return np.broadcast_to(number, int(counts[0])) if len(counts) == 1 else np.repeat(number, counts)


def starts_at_rest(dwell: Bools, stage_first: Indices) -> Bools:
    """Find the segments that start at rest, (m,): the first of each stage, and the one after a dwell."""
    breaks = np.zeros(len(dwell), dtype=np.bool_)
    firsts = stage_first[stage_first < len(dwell)]
    breaks[firsts] = True
    breaks[1:] |= dwell[:-1]
    return breaks


def reachable_ends(
    length: Floats, vel: Floats, acc: Floats, vel_end: Floats, dwell: Bools, stage_first: Indices
) -> Floats:
    """Compute the end velocity that each segment reaches, (m,) pulse/ms; 0 for a dwell. Arguments as of schedule."""
    breaks, has_dwells = starts_at_rest(dwell, stage_first), bool(dwell.any())
    if has_dwells:
        vel, acc, vel_end = np.where(dwell, 1.0, vel), np.where(dwell, 1.0, acc), np.where(dwell, 0.0, vel_end)
    ends = reached_ends(length, vel, vel_end, acc, breaks)
    return np.where(dwell, 0.0, ends) if has_dwells else ends


def schedule(
    *,
    length: Floats,
    vel: Floats,
    acc: Floats,
    vel_end: Floats,
    dwell: Bools,
    dwell_ms: Floats,
    stage_first: Indices,
    even_time_ms: Floats | None = None,
) -> Schedule:
    """Schedule segments and dwells.

    Args:
        length: Length of each segment, (m,) pulse; 0 for a dwell.
        vel: Highest velocity, (m,) pulse/ms; not read for a dwell.
        acc: Acceleration, (m,) pulse/ms2; not read for a dwell.
        vel_end: Given end velocity, (m,) pulse/ms; not read for a dwell.
        dwell: Which rows are dwells, (m,).
        dwell_ms: Duration of the dwells, (m,) ms; not read for a motion.
        stage_first: Number of each stage's first segment, and m, (s+1,).
        even_time_ms: Least time at constant velocity, (m,) ms; None: there is none.
    """
    reached = np.zeros(len(length) + 1)
    reached[1:] = reachable_ends(length, vel, acc, vel_end, dwell, stage_first)
    start, end, rests = reached[:-1], reached[1:], np.flatnonzero(starts_at_rest(dwell, stage_first))
    if start[rests].any():
        start = start.copy()
        start[rests] = 0.0
    has_dwells = bool(dwell.any())
    if has_dwells:
        vel, acc = np.where(dwell, 1.0, vel), np.where(dwell, 1.0, acc)
    if even_time_ms is not None:
        vel = even_velocity(length, start, vel, end, acc, even_time_ms)
    profile = trapezoids(length, start, vel, end, acc)
    duration = profile.duration_ms
    if has_dwells:
        duration[dwell] = dwell_ms[dwell]
    return Schedule(
        profile=profile,
        dwell=dwell,
        duration_ms=duration,
        times_ms=running_sum(duration),
        stage=stage_numbers(stage_first),
        stage_first=stage_first,
    )
