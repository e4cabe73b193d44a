"""Where the path is and how fast it goes at a moment, for any number of moments at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.trapezoids import REACHED, distance_run
from gusjob.simulate.clock import Clock
from gusjob.simulate.state import Program


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """The planned motion. Moments are on the clock's axis, ms; `cell` is the timed call a moment lies in."""

    clock: Clock
    program: Program

    def lines(self, cell: Indices, time: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """The cells' velocity is the lowest of three lines: rising and falling line at `time`, slope, peak."""
        profile, clock = self.clock.profile, self.clock
        since = time - clock.times_ms[cell]
        left = clock.duration_ms[cell] - since
        moves = left > 0  # Light may shine on behind a stage's end, at rest.
        acc, peak = np.where(moves, profile.acc[cell], 0.0), np.where(moves, profile.peak[cell], 0.0)
        rise, fall = profile.start[cell] + acc * since, profile.end[cell] + acc * left
        return np.where(moves, rise, 0.0), np.where(moves, fall, 0.0), acc, peak

    def slows_first(self, cell: Indices) -> bool:
        """Whether one of the cells starts above its velocity (then its velocity is no minimum of lines)."""
        profile = self.clock.profile
        return bool((profile.start[cell] > profile.peak[cell] * (1 + REACHED)).any())

    def velocity(self, cell: Indices, time: Floats) -> Floats:
        """Path velocity, pulse/ms; 0 in a dwell and behind a stage's end."""
        profile, clock = self.clock.profile, self.clock
        if not len(clock.row):
            return np.zeros(len(time))
        rise, fall, acc, peak = self.lines(cell, time)
        since = np.maximum(time - clock.times_ms[cell], 0.0)
        start = profile.start[cell]
        slowing = start > peak
        first = np.where(slowing, np.maximum(start - acc * since, peak), np.minimum(rise, peak))
        velocity = np.minimum(first, fall)
        still = clock.dwell[cell] | (time >= clock.times_ms[cell] + clock.duration_ms[cell])
        # A sample at the very end of a segment still has its end velocity.
        ended = np.where(time > clock.stage_end()[clock.stage[cell]], 0.0, profile.end[cell])
        return np.where(still, np.where(clock.dwell[cell], 0.0, ended), np.maximum(velocity, 0.0))

    def distance_run(self, cell: Indices, time: Floats) -> Floats:
        """Length run since the cell's start, pulse."""
        profile, clock = self.clock.profile, self.clock
        since = np.clip(time - clock.times_ms[cell], 0.0, clock.duration_ms[cell])
        return distance_run(profile, cell, since)

    def position(self, cell: Indices, time: Floats) -> tuple[Floats, Floats]:
        """Planned position in the coordinate system, pulse."""
        laid = self.clock.laid
        if not len(self.clock.row):
            return np.zeros(len(time)), np.zeros(len(time))
        length = laid.length[cell]
        share = np.where(length > 0, self.distance_run(cell, time) / np.where(length > 0, length, 1.0), 0.0)
        return laid.points(cell, share)

    def axis_positions(self, stage: int, x: Floats, y: Floats) -> list[Floats]:
        """Positions of the four axes of distance follow; axes that are not in the coordinate system stand at 0."""
        axes = [np.zeros(len(x)) for _ in range(4)]
        for axis, values in zip(self.program.stages[stage].axes, (x, y), strict=True):
            if axis < 4:
                axes[axis] = values
        return axes
