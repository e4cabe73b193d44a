"""Where on the path a run is: from the calls that left the FIFO and the position that the controller reports."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.geometry import TURN
from gusjob.interpreter.clock import lay
from gusjob.stream import Buffered, BufferedCalls

NEAR_PULSE = 2.0
"""So near to a segment is on it: reported positions are rounded."""


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
    """Buffered calls as a route. `timed` (m,): the rows that take time."""

    calls: BufferedCalls
    timed: npt.NDArray[np.intp]

    @classmethod
    def of(cls, calls: BufferedCalls) -> Route:
        """The route of some calls."""
        return cls(calls=calls, timed=np.flatnonzero(calls.kind <= Buffered.DELAY))

    def nearest(self, number: int, x: float, y: float) -> tuple[float, float, float]:
        """For a timed call: the distance of a point from it, how far along it that is, and its length; all pulse."""
        # The call before gives the start; a dwell gives none, so look back to a motion.
        first = number - 1
        while first > 0 and self.calls.kind[self.timed[first]] == Buffered.DELAY:
            first -= 1
        rows = self.timed[max(first, 0) : number + 1]
        laid = lay(self.calls, rows, self.calls.kind[rows] == Buffered.DELAY)
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

    def place(self, taken: int, x: float, y: float) -> Place:
        """Where the motion is: `taken` rows have left the FIFO, the head is at x, y.

        The row in progress may have left the FIFO already or not (no manual says): the position tells. Where both fit
        (a way there and back) the earlier one is taken: rather twice than never.
        """
        number = int(np.searchsorted(self.timed, taken))  # The first timed call that is still in the FIFO.
        best: tuple[float, Place] | None = None
        for candidate in (number - 1, number):
            if not 0 <= candidate < len(self.timed):
                continue
            row = int(self.timed[candidate])
            distance, run, length = self.nearest(candidate, x, y)
            place = Place(row=row, run_pulse=run)
            if self.calls.kind[row] == Buffered.DELAY:
                place = Place(row=row)
            elif run >= length - 0.5:
                # It is done, with all that stands before the next motion.
                place = Place(row=row + 1)
            if best is None or distance < best[0] - 0.5 or (distance <= NEAR_PULSE and best[1].row == row):
                best = (distance, place)
        if best is None:
            return Place(row=taken)
        return best[1] if best[0] <= NEAR_PULSE else Place(row=best[1].row, sure=False)

    def back(self, place: Place, by_pulse: float) -> Place:
        """A place so much earlier on the way, but never before the motion call that comes before it."""
        if by_pulse <= 0:
            return place
        if place.run_pulse >= by_pulse:
            return Place(row=place.row, run_pulse=place.run_pulse - by_pulse, sure=place.sure)
        number = int(np.searchsorted(self.timed, place.row)) - 1
        if number < 0 or place.run_pulse > 0 or self.calls.kind[self.timed[number]] == Buffered.DELAY:
            return Place(row=place.row, sure=place.sure)
        row = int(self.timed[number])
        length = self.nearest(number, float(self.calls.x[row]), float(self.calls.y[row]))[2]
        return Place(row=row, run_pulse=max(length - by_pulse, 0.0), sure=place.sure)


def _run_on_arc(dx: float, dy: float, angle: float, sweep: float, length: float) -> float:
    """How far along an arc a direction from its centre lies; beyond its ends the nearer end."""
    turned = (math.copysign(1.0, sweep) * (math.atan2(dy, dx) - angle)) % TURN
    span = abs(sweep)
    if turned <= span:
        return length * turned / span if span > 0 else 0.0
    return length if turned - span < TURN - turned else 0.0
