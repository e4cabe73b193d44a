"""Intended start and end points of marks, S and E.

The planner names them for sky writing; otherwise they are where the switch is in the order of the path. Emission that
was on before its stage, or continues after it, has the start or the end of the stage as its intended point.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.corners import unit_mm


class MarkPoints(Struct, frozen=True, kw_only=True, eq=False):
    """Points, (k,) pulse, and the unit direction of the path there, in mm (0, 0 in a stage without motion)."""

    x: Floats
    y: Floats
    along_x: Floats
    along_y: Floats

    def pick(self, at: Indices) -> MarkPoints:
        """Pick the points at indices."""
        return MarkPoints(x=self.x[at], y=self.y[at], along_x=self.along_x[at], along_y=self.along_y[at])


class MarkEnds(Struct, frozen=True, kw_only=True, eq=False):
    """S and E of marks, (k,).

    `start_segment`, `end_segment`: number of the segment before which S and E are. `first_motion`, `last_motion`: the
    motion that starts at S, and the one that ends at E. `start`, `end`: the points.
    """

    start_segment: Indices
    end_segment: Indices
    first_motion: Indices
    last_motion: Indices
    start: MarkPoints
    end: MarkPoints


def mark_ends_of(trace: Trace, machine: Machine, channel: ChannelTrace) -> MarkEnds:
    """Find S and E of a channel's emission intervals."""
    schedule, emission, marks = trace.schedule, channel.emission, channel.switch.mark_segment
    begins, stops = schedule.stage_first[emission.stage], schedule.stage_first[emission.stage + 1]
    named = np.append(marks, 0)
    start = np.where(emission.on_event >= 0, named[emission.on_event], begins)
    # An immediate switch of a running stage acts at its start; otherwise the emission ends with its stage.
    at_start = emission.end_ms != schedule.stage_end()[emission.stage]
    end = np.where(emission.off_event >= 0, named[emission.off_event], np.where(at_start, begins, stops))
    count, number = len(trace), np.arange(len(trace))
    moves = trace.segments.length > 0
    # For each segment number: the next motion from there on, and the last one before.
    after = np.append(np.minimum.accumulate(np.where(moves, number, count)[::-1])[::-1], count)
    before = np.concatenate([[-1], np.maximum.accumulate(np.where(moves, number, -1))])
    leaves, arrives = after[start] < stops, after[end] < stops
    return MarkEnds(
        start_segment=start,
        end_segment=end,
        first_motion=after[start],
        last_motion=before[end],
        start=_points(trace, machine, start, after[start], np.where(leaves, -1, before[start]), begins),
        end=_points(trace, machine, end, np.where(arrives, after[end], count), before[end], begins),
    )


def _points(
    trace: Trace, machine: Machine, at: Indices, after: Indices, before: Indices, begins: Indices
) -> MarkPoints:
    """Commanded points before segments `at`.

    The direction is that of motion `before` if it is in the stage, which begins with segment `begins`; otherwise that
    of motion `after`.
    """
    segments = trace.segments
    x, y = np.append(segments.x0[:1], segments.x1), np.append(segments.y0[:1], segments.y1)
    if not len(segments.x0):
        x, y = np.zeros(1), np.zeros(1)
    along = np.zeros((2, len(at)))
    comes = before >= begins
    leaves = ~comes & (after < len(segments.length))
    along[:, comes] = unit_mm(*segments.end_direction(before[comes]), machine)
    along[:, leaves] = unit_mm(*segments.start_direction(after[leaves]), machine)
    return MarkPoints(x=x[at], y=y[at], along_x=along[0], along_y=along[1])


def mark_lines(trace: Trace, stage: Indices, start_segment: Indices) -> npt.NDArray[np.int32]:
    """Source line of the segment with which each mark begins, (k,); of its stage where that has none."""
    schedule = trace.schedule
    segment = np.minimum(start_segment, schedule.stage_first[stage + 1] - 1)
    inside = segment >= schedule.stage_first[stage]
    return np.where(inside, np.append(trace.line, 0)[segment], trace.stage_line[stage]).astype(np.int32)
