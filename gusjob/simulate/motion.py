"""The planned motion: position and velocity at any number of moments at once."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Floats, Indices, rows_of
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.schedule import Schedule, schedule
from gusjob.kinematics.trapezoids import distance_run
from gusjob.simulate.events import Events, MotionEvents


class Motion(Struct, frozen=True, kw_only=True, eq=False):
    """The planned motion of all stages.

    Moments are in ms on the schedule's time axis; `segment` (k,) is the number of the segment that runs at each moment.
    `axes`: of each stage, the axes (from 0) that X and Y drive.
    """

    schedule: Schedule
    segments: Segments
    axes: tuple[tuple[int, int], ...]

    def __len__(self) -> int:
        """Number of segments, dwells included."""
        return len(self.schedule.dwell)

    def velocity(self, segment: Indices, time: Floats) -> Floats:
        """Path velocity, (k,) pulse/ms; 0 in a dwell and after a stage's end."""
        profile, schedule = self.schedule.profile, self.schedule
        if not len(self):
            return np.zeros(len(time))
        rows = rows_of(segment)
        begin, duration = schedule.times_ms[rows], schedule.duration_ms[rows]
        start, peak, acc = profile.start[rows], profile.peak[rows], profile.acc[rows]
        since, end = time - begin, profile.end[rows]
        gained = acc * np.maximum(since, 0.0)
        rise = np.minimum(start + gained, peak)
        if (start > peak).any():
            rise = np.where(start > peak, np.maximum(start - gained, peak), rise)
        velocity = np.maximum(np.minimum(rise, end + acc * (duration - since)), 0.0)
        over = np.flatnonzero(time >= begin + duration)
        if len(over):
            # At the very end of a segment its end velocity still holds.
            stage_end = schedule.times_ms[schedule.stage_first[schedule.stage[segment[over]] + 1]]
            velocity[over] = np.where(time[over] > stage_end, 0.0, end[over])
        velocity[schedule.dwell[rows]] = 0.0
        return np.asarray(velocity)

    def distance_run(self, segment: Indices, time: Floats) -> Floats:
        """Path length since the segment's start, (k,) pulse."""
        schedule = self.schedule
        since = np.clip(time - schedule.times_ms[segment], 0.0, schedule.duration_ms[segment])
        return distance_run(schedule.profile, segment, since)

    def position(self, segment: Indices, time: Floats) -> tuple[Floats, Floats]:
        """Planned position of the machine, (x, y), (k,) pulse."""
        if not len(self):
            return np.zeros(len(time)), np.zeros(len(time))
        length = self.segments.length[segment]
        share = np.where(length > 0, self.distance_run(segment, time) / np.where(length > 0, length, 1.0), 0.0)
        return self.segments.points(segment, share)


def motion_of(events: Events) -> Motion:
    """Schedule the segments of all stages."""
    return scheduled(events.motion, events.stage_first, tuple(stage.axes for stage in events.stages))


def scheduled(motion: MotionEvents, stage_first: Indices, axes: tuple[tuple[int, int], ...]) -> Motion:
    """Schedule segments.

    Args:
        motion: The segments, m.
        stage_first: Number of each stage's first segment, and m, (s+1,).
        axes: Of each stage, the axes (from 0) that X and Y drive.
    """
    return Motion(
        schedule=schedule(
            length=motion.segments.length,
            vel=motion.vel,
            acc=motion.acc,
            vel_end=motion.vel_end,
            dwell=motion.dwell,
            dwell_ms=motion.dwell_ms,
            stage_first=stage_first,
            even_time_ms=motion.even_time_ms,
        ),
        segments=motion.segments,
        axes=axes,
    )
