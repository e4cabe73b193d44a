"""Where on the path a run is: from the calls that left the FIFO and the position that the controller reports."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.controllers.gus.geometry import call_segments
from gusjob.kinematics.arrays import Indices
from gusjob.kinematics.geometry import TURN

NEAR_PULSE = 2.0
"""So near to a segment is on it: reported positions are rounded."""
_DONE_PULSE = 1.0
"""So near to its end a segment is done: what is left would round to nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A place in a stream: the first buffered row that is not completely done, and how far the motion is along it.

    `sure`: whether the position lay on the path there.
    """

    row: int
    run_pulse: float = 0.0
    sure: bool = True


START = Place(row=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """Buffered calls as a route. `timed` (m,): the rows that take time; `start`: where the first one begins, pulse."""

    calls: BufferedCalls
    timed: Indices
    start: tuple[float, float]

    @classmethod
    def of(cls, calls: BufferedCalls, start: tuple[float, float]) -> Route:
        """The route of some calls."""
        return cls(calls=calls, timed=np.flatnonzero(calls.kind <= Buffered.DELAY), start=start)

    def nearest(self, number: int, x: float, y: float) -> tuple[float, float, float]:
        """For a timed call: the distance of a point from it, how far along it that is, and its length; all pulse."""
        # The call before gives the start; a dwell gives none, so look back to a motion.
        first = number - 1
        while first > 0 and self.calls.kind[self.timed[first]] == Buffered.DELAY:
            first -= 1
        rows = self.timed[max(first, 0) : number + 1]
        laid = call_segments(self.calls, rows, self.calls.kind[rows] == Buffered.DELAY, self.start)
        at = len(rows) - 1
        x0, y0, length = float(laid.x0[at]), float(laid.y0[at]), float(laid.length[at])
        found, arcs = laid.arcs_among(np.array([at]))
        if len(found):
            run = _run_on_arc(x - arcs.cx[0], y - arcs.cy[0], float(arcs.angle[0]), float(arcs.sweep[0]), length)
        elif length > 0:
            dx, dy = (float(laid.x1[at]) - x0) / length, (float(laid.y1[at]) - y0) / length
            run = min(max((x - x0) * dx + (y - y0) * dy, 0.0), length)
        else:
            run = 0.0
        px, py = laid.points(np.array([at]), np.array([run / length if length > 0 else 0.0]))
        return math.hypot(x - float(px[0]), y - float(py[0])), run, length

    def place(self, low: int, high: int, x: float, y: float) -> Place:
        """Where the motion is: between `low` and `high` rows have left the FIFO, the head is at x, y.

        The row in progress may have left the FIFO already or not (no manual says): the position tells. Where several
        fit (a way there and back) the earliest is taken, and where none does the earliest of all: rather twice than
        never.
        """
        # From the last timed call that left the FIFO to the first one that is still in it.
        first, last = (int(np.searchsorted(self.timed, taken)) for taken in (low, high))
        numbers = range(max(first - 1, 0), min(last, len(self.timed) - 1) + 1)
        found = [self._place_in(number, x, y) for number in numbers]
        if not found:
            return Place(row=high)
        least = min(distance for distance, _ in found)
        if least > NEAR_PULSE:
            return Place(row=found[0][1].row, sure=False)
        # At a joint the end of one call is the start of the next.
        return next(place for distance, place in found if distance <= least + 0.5)

    def _place_in(self, number: int, x: float, y: float) -> tuple[float, Place]:
        """How far a point is from a timed call, and the place there if it is on it."""
        row = int(self.timed[number])
        distance, run, length = self.nearest(number, x, y)
        if self.calls.kind[row] == Buffered.DELAY:
            return distance, Place(row=row)
        # One that is done is done with all that stands before the next motion.
        return distance, Place(row=row, run_pulse=run) if run < length - _DONE_PULSE else Place(row=row + 1)

    def back(self, place: Place, by_ms: float) -> Place:
        """A place so much earlier on the way, at full velocity all the while: rather too far than not far enough."""
        row, run, left_ms = place.row, place.run_pulse, by_ms
        if row < len(self.calls) and self.calls.kind[row] == Buffered.DELAY:
            return place  # It is run again as a whole.
        number = int(np.searchsorted(self.timed, row))
        while left_ms > 0:
            if row < len(self.calls) and run > 0:
                vel = float(self.calls.vel[row])
                if run >= vel * left_ms:
                    return Place(row=row, run_pulse=run - vel * left_ms, sure=place.sure)
                left_ms -= run / vel
            number -= 1
            if number < 0 or self.calls.kind[self.timed[number]] == Buffered.DELAY:
                return Place(row=row, sure=place.sure)
            row = int(self.timed[number])
            run = self.nearest(number, float(self.calls.x[row]), float(self.calls.y[row]))[2]
        return Place(row=row, run_pulse=run, sure=place.sure)


def _run_on_arc(dx: float, dy: float, angle: float, sweep: float, length: float) -> float:
    """How far along an arc a direction from its centre lies; beyond its ends the nearer end."""
    turned = (math.copysign(1.0, sweep) * (math.atan2(dy, dx) - angle)) % TURN
    span = abs(sweep)
    if turned <= span:
        return length * turned / span if span > 0 else 0.0
    return length if turned - span < TURN - turned else 0.0
