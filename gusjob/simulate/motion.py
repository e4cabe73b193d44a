"""The planned motion: position and velocity at any number of moments at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.schedule import Schedule, schedule
from gusjob.kinematics.trapezoids import REACHED, distance_run
from gusjob.simulate.events import Events, MotionEvents


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
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

    def velocity_lines(self, segment: Indices, time: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Compute three lines of which the lowest is the segments' velocity.

        Returns:
            The rising and the falling line at `time`, both pulse/ms, their slope, pulse/ms2, and the peak, pulse/ms.
        """
        profile, schedule = self.schedule.profile, self.schedule
        since = time - schedule.times_ms[segment]
        left = schedule.duration_ms[segment] - since
        moves = left > 0  # Emission may outlast its stage, at rest.
        acc, peak = np.where(moves, profile.acc[segment], 0.0), np.where(moves, profile.peak[segment], 0.0)
        rise, fall = profile.start[segment] + acc * since, profile.end[segment] + acc * left
        return np.where(moves, rise, 0.0), np.where(moves, fall, 0.0), acc, peak

    def starts_above_peak(self, segment: Indices) -> bool:
        """Whether one of the segments starts above its velocity, which then is not the lowest of three lines."""
        profile = self.schedule.profile
        return bool((profile.start[segment] > profile.peak[segment] * (1 + REACHED)).any())

    def velocity(self, segment: Indices, time: Floats) -> Floats:
        """Path velocity, (k,) pulse/ms; 0 in a dwell and after a stage's end."""
        profile, schedule = self.schedule.profile, self.schedule
        if not len(self):
            return np.zeros(len(time))
        rise, fall, acc, peak = self.velocity_lines(segment, time)
        since = np.maximum(time - schedule.times_ms[segment], 0.0)
        start = profile.start[segment]
        slows = start > peak
        first = np.where(slows, np.maximum(start - acc * since, peak), np.minimum(rise, peak))
        velocity = np.minimum(first, fall)
        dwell = schedule.dwell[segment]
        over = dwell | (time >= schedule.times_ms[segment] + schedule.duration_ms[segment])
        # At the very end of a segment its end velocity still holds.
        ended = np.where(time > schedule.stage_end()[schedule.stage[segment]], 0.0, profile.end[segment])
        return np.where(over, np.where(dwell, 0.0, ended), np.maximum(velocity, 0.0))

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

    def axis_positions(self, stage: int, x: Floats, y: Floats) -> list[Floats]:
        """Positions of the four axes of distance follow; an axis outside the coordinate system is at 0.

        They are positions of the machine: the axes know no origin of a coordinate system.
        """
        axes = [np.zeros(len(x)) for _ in range(4)]
        for axis, values in zip(self.axes[stage], (x, y), strict=True):
            if axis < 4:
                axes[axis] = values
        return axes


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
