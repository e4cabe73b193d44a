"""Position of a run on its path, from the calls that left the FIFO and the position that the controller reports."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.controllers.gus.geometry import call_segments
from gusjob.kinematics.arrays import Indices
from gusjob.kinematics.geometry import TURN

NEAR_PULSE = 2.0
"""A position this near to a segment is on it: reported positions are rounded."""
_DONE_PULSE = 1.0
"""A segment is done this near to its end: what is left would round to nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PathPosition:
    """A position in a stream: the first buffered row that is not completely done, and the distance along it, pulse.

    `sure`: whether the reported position was on the path there.
    """

    row: int
    along_pulse: float = 0.0
    sure: bool = True


JOB_START = PathPosition(row=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedPath:
    """The path of buffered calls.

    `timed` (m,): the rows that take time (motions and dwells); `start_pulse`: where the first one begins.
    """

    calls: BufferedCalls
    timed: Indices
    start_pulse: tuple[float, float]

    @classmethod
    def of(cls, calls: BufferedCalls, start_pulse: tuple[float, float]) -> TimedPath:
        """Make the path of some calls."""
        return cls(calls=calls, timed=np.flatnonzero(calls.kind <= Buffered.DELAY), start_pulse=start_pulse)

    def nearest(self, number: int, x: float, y: float) -> tuple[float, float, float]:
        """Project a point onto a timed call.

        Args:
            number: index into `timed`.
            x: the point, pulse.
            y: the point, pulse.

        Returns:
            The point's distance from the call, how far along it the nearest point is, and its length; all pulse.
        """
        # The call before gives the start; a dwell gives none, so look back to a motion.
        first = number - 1
        while first > 0 and self.calls.kind[self.timed[first]] == Buffered.DELAY:
            first -= 1
        rows = self.timed[max(first, 0) : number + 1]
        segments = call_segments(self.calls, rows, self.calls.kind[rows] == Buffered.DELAY, self.start_pulse)
        at = len(rows) - 1
        x0, y0, length = float(segments.x0[at]), float(segments.y0[at]), float(segments.length[at])
        found, arcs = segments.arcs_among(np.array([at]))
        if len(found):
            along = _along_arc(x - arcs.cx[0], y - arcs.cy[0], float(arcs.angle[0]), float(arcs.sweep[0]), length)
        elif length > 0:
            dx, dy = (float(segments.x1[at]) - x0) / length, (float(segments.y1[at]) - y0) / length
            along = min(max((x - x0) * dx + (y - y0) * dy, 0.0), length)
        else:
            along = 0.0
        px, py = segments.points(np.array([at]), np.array([along / length if length > 0 else 0.0]))
        return math.hypot(x - float(px[0]), y - float(py[0])), along, length

    def locate(self, low: int, high: int, x: float, y: float) -> PathPosition:
        """Find the position of the motion.

        The row in progress may have left the FIFO already or not (no manual says): x, y decides. Where several rows fit
        (a line there and back) the earliest is taken, and where none fits the earliest of all: it is better to mark a
        piece twice than to leave it out.

        Args:
            low: at least this many rows have left the FIFO.
            high: at most this many rows have left the FIFO.
            x: reported position, pulse.
            y: reported position, pulse.
        """
        # From the last timed call that left the FIFO to the first one that is still in it.
        first, last = (int(np.searchsorted(self.timed, taken)) for taken in (low, high))
        numbers = range(max(first - 1, 0), min(last, len(self.timed) - 1) + 1)
        found = [self._locate_in(number, x, y) for number in numbers]
        if not found:
            return PathPosition(row=high)
        least = min(distance for distance, _ in found)
        if least > NEAR_PULSE:
            return PathPosition(row=found[0][1].row, sure=False)
        # At a joint the end of one call is the start of the next.
        return next(position for distance, position in found if distance <= least + 0.5)

    def _locate_in(self, number: int, x: float, y: float) -> tuple[float, PathPosition]:
        """Return the distance of a point from a timed call, and the position if the point is on it."""
        row = int(self.timed[number])
        distance, along, length = self.nearest(number, x, y)
        if self.calls.kind[row] == Buffered.DELAY:
            return distance, PathPosition(row=row)
        # With a motion that is done, the untimed calls up to the next one are done.
        done = along >= length - _DONE_PULSE
        return distance, PathPosition(row=row + 1) if done else PathPosition(row=row, along_pulse=along)

    def rewind(self, position: PathPosition, by_ms: float) -> PathPosition:
        """Move a position back by a time, at full velocity throughout: rather too far than not far enough.

        It stops at a dwell, which is run again as a whole.
        """
        row, along, left_ms = position.row, position.along_pulse, by_ms
        if row < len(self.calls) and self.calls.kind[row] == Buffered.DELAY:
            return position
        number = int(np.searchsorted(self.timed, row))
        while left_ms > 0:
            if row < len(self.calls) and along > 0:
                vel = float(self.calls.vel[row])
                if along >= vel * left_ms:
                    return PathPosition(row=row, along_pulse=along - vel * left_ms, sure=position.sure)
                left_ms -= along / vel
            number -= 1
            if number < 0 or self.calls.kind[self.timed[number]] == Buffered.DELAY:
                return PathPosition(row=row, sure=position.sure)
            row = int(self.timed[number])
            along = self.nearest(number, float(self.calls.x[row]), float(self.calls.y[row]))[2]
        return PathPosition(row=row, along_pulse=along, sure=position.sure)


def _along_arc(dx: float, dy: float, angle: float, sweep: float, length: float) -> float:
    """Return how far along an arc a direction from its centre lies; beyond its ends the nearer end."""
    turned = (math.copysign(1.0, sweep) * (math.atan2(dy, dx) - angle)) % TURN
    span = abs(sweep)
    if turned <= span:
        return length * turned / span if span > 0 else 0.0
    return length if turned - span < TURN - turned else 0.0
