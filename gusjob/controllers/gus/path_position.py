"""Position of a run on its path, from the calls that left the FIFO and the position that the controller reports."""

from __future__ import annotations

import math
import sys

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.controllers.gus.geometry import call_segments
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.geometry import TURN

NEAR_PULSE = 2.0
"""A position this near to a segment is on it: reported positions are rounded."""
_DONE_PULSE = 1.0
"""A segment is done this near to its end: what is left would round to nothing."""
_ROUNDED_PULSE = 2.0
"""How much farther along the path than the head a position may be by rounding: its own, and that of the start of what
is run next."""


class PathPosition(Struct, frozen=True, kw_only=True):
    """A position in a stream: the first buffered row that is not completely done, and the distance along it, pulse."""

    row: int
    along_pulse: float = 0.0

    @property
    def key(self) -> tuple[int, float]:
        """For comparison: a later position has a larger key."""
        return self.row, self.along_pulse


JOB_START = PathPosition(row=0)


class PositionRange(Struct, frozen=True, kw_only=True):
    """Where something happened: at `earliest`, at `latest`, or between them."""

    earliest: PathPosition
    latest: PathPosition

    @classmethod
    def exactly(cls, position: PathPosition) -> PositionRange:
        """Make the range of one position."""
        return cls(earliest=position, latest=position)

    def until(self, position: PathPosition) -> PositionRange:
        """Return the range extended to a position, if that is later."""
        return PositionRange(earliest=self.earliest, latest=max(self.latest, position, key=_key))

    def not_before(self, position: PathPosition) -> PositionRange:
        """Return the part of the range from a position on."""
        return PositionRange(
            earliest=max(self.earliest, position, key=_key), latest=max(self.latest, position, key=_key)
        )


def _key(position: PathPosition) -> tuple[int, float]:
    return position.key


class TimedPath(Struct, frozen=True, kw_only=True, eq=False):
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

    def locate(self, low: int, high: int, x: float, y: float, *, sent: int = sys.maxsize) -> PositionRange | None:
        """Find the position of the motion.

        The row in progress may have left the FIFO already or not (no manual says): x, y decides. Where several rows fit
        (a line there and back) the range has all of them.

        Args:
            low: at least this many rows have left the FIFO.
            high: at most this many rows have left the FIFO.
            x: reported position, pulse.
            y: reported position, pulse.
            sent: at most this many rows were sent.

        Returns:
            The range, or None if x, y is not on the path there.
        """
        # From the last timed call that left the FIFO to the first one that is still in it.
        first, last = (int(np.searchsorted(self.timed, taken)) for taken in (low, high))
        numbers = range(max(first - 1, 0), min(last, len(self.timed) - 1) + 1)
        # The next timed call after those that were sent can't have begun.
        after = self.timed[np.searchsorted(self.timed, sent) :]
        limit = int(after[0]) if len(after) else len(self.calls)
        found = [fit for number in numbers for fit in self._locate_in(number, x, y) if fit[1].row <= limit]
        if not found:
            return PositionRange.exactly(PathPosition(row=high))
        least = min(distance for distance, _ in found)
        if least > NEAR_PULSE:
            # The first motion begins wherever the head was.
            row = int(self.timed[0])
            is_first = low <= row + 1
            return PositionRange(earliest=PathPosition(row=row), latest=PathPosition(row=row + 1)) if is_first else None
        # At a joint the end of one call is the start of the next.
        fitting = [position for distance, position in found if distance <= least + 0.5]
        return PositionRange(earliest=min(fitting, key=_key), latest=max(fitting, key=_key))

    def _locate_in(self, number: int, x: float, y: float) -> list[tuple[float, PathPosition]]:
        """Return the distance of a point from a timed call, with each position on the call that fits the point."""
        row = int(self.timed[number])
        distance, along, length = self.nearest(number, x, y)
        begin, end = (distance, PathPosition(row=row)), (distance, PathPosition(row=row + 1))
        if self.calls.kind[row] == Buffered.DELAY:
            return [begin]
        # With a motion that is done, the untimed calls up to the next one are done.
        is_done, is_begin = along >= length - _DONE_PULSE, along <= _DONE_PULSE
        if (is_done or is_begin) and self._is_circle(number):
            return [begin, end]
        return [end if is_done else (distance, PathPosition(row=row, along_pulse=along))]

    def _is_circle(self, number: int) -> bool:
        """Return whether a motion ends where it begins, as a full circle does."""
        row, moves = int(self.timed[number]), self.timed[:number]
        moves = moves[self.calls.kind[moves] < Buffered.DELAY]
        x0, y0 = (self.calls.x[moves[-1]], self.calls.y[moves[-1]]) if len(moves) else self.start_pulse
        is_arc = self.calls.kind[row] in (Buffered.ARC_CENTRE, Buffered.ARC_RADIUS)
        return bool(is_arc and math.hypot(self.calls.x[row] - x0, self.calls.y[row] - y0) <= NEAR_PULSE)

    def earliest(self, taken: int) -> PathPosition:
        """Return the earliest position of a motion of which that many rows have left the FIFO."""
        number = int(np.searchsorted(self.timed, taken)) - 1
        return PathPosition(row=int(self.timed[number])) if number >= 0 else JOB_START

    def earliest_at(self, taken: int, x: float, y: float) -> PathPosition:
        """Return the earliest position of a motion that was polled: free slots first, then the position, pulse."""
        found = self.locate(taken, taken, x, y)
        return self.earliest(taken) if found is None else self._without_rounding(found.earliest, 0)

    def rewind(self, position: PathPosition, by_ms: float, first: int = 0) -> PathPosition:
        """Move a position back by a time, and by what rounding may add: rather too far than not far enough.

        Each motion is taken at its highest possible velocity.

        Args:
            position: a position in this path.
            by_ms: the time.
            first: the row before which the motion was certainly not.
        """
        back = self._back(position, by_ms, first, by_time=True)
        return self._without_rounding(back, first)

    def _without_rounding(self, position: PathPosition, first: int) -> PathPosition:
        """Move a position back by what rounding may have added. A dwell is run again as a whole anyway."""
        if position.row < len(self.calls) and self.calls.kind[position.row] == Buffered.DELAY:
            return position
        return self.rewind_along(position, _ROUNDED_PULSE, first)

    def rewind_along(self, position: PathPosition, by_pulse: float, first: int = 0) -> PathPosition:
        """Move a position back along the path."""
        return self._back(position, by_pulse, first, by_time=False)

    def between(self, begin: PathPosition, end: PathPosition) -> tuple[Indices, Floats]:
        """Return the timed rows between a position and a later one, and the length of each between them, pulse."""
        low, number = (int(np.searchsorted(self.timed, position.row)) for position in (begin, end))
        high = min(number + 1, len(self.timed))
        if end.key <= begin.key or high <= low:
            return self.timed[:0], np.empty(0)
        rows, lengths = self.timed[low:high], self.lengths(low, high).copy()
        if number < len(self.timed):
            lengths[-1] = end.along_pulse if rows[-1] == end.row else 0.0
        lengths[0] -= begin.along_pulse if rows[0] == begin.row else 0.0
        return rows, lengths

    def lengths(self, low: int, high: int) -> Floats:
        """Return the lengths of the timed calls low..high-1 (indices into `timed`), pulse; dwells have none."""
        begin = low
        while begin > 0 and (begin == low or self.calls.kind[self.timed[begin]] == Buffered.DELAY):
            begin -= 1
        rows = self.timed[begin:high]
        lengths: Floats = call_segments(
            self.calls, rows, self.calls.kind[rows] == Buffered.DELAY, self.start_pulse
        ).length
        return lengths[low - begin :]

    def _slowness(self, rows: Indices) -> Floats:
        """Return the least time for a pulse of each row, ms.

        A row may begin faster than its own velocity, and so may the next ones if it is too short to slow down in: from
        an end velocity v the square of the velocity is v**2 - 2 * acc * s after a length s.
        """
        low, high = (int(np.searchsorted(self.timed, row)) for row in (rows[0], rows[-1]))
        begin = 0 if low == 0 else low - 1
        timed = self.timed[begin : high + 1]
        lengths = self.lengths(begin, high + 1)
        slowed = np.concatenate([[0.0], np.cumsum(2 * self.calls.acc[timed] * lengths)])
        exits = np.maximum.accumulate(self.calls.vel_end[timed] ** 2 + slowed[1:])
        entries = np.concatenate([[0.0], exits[:-1] - slowed[1:-1]])[low - begin :]
        entries[0] = max(entries[0], float(self.calls.vel_end[: rows[0]].max(initial=0.0)) ** 2)
        fastest = np.sqrt(np.maximum(self.calls.vel[rows] ** 2, entries))
        slowness: Floats = 1 / np.where(fastest > 0, fastest, np.inf)
        return slowness

    def _back(self, position: PathPosition, amount: float, first: int, *, by_time: bool) -> PathPosition:
        """Move a position back by an amount, ms or pulse, at most to the row `first`."""
        low, number = (int(np.searchsorted(self.timed, row)) for row in (first, position.row))
        high = min(number + 1, len(self.timed))
        if amount <= 0 or high <= low:
            return position
        rows, lengths = self.timed[low:high], self.lengths(low, high)
        per_pulse = self._slowness(rows) if by_time else np.ones(len(rows))
        done = lengths.copy()
        if number < len(self.timed):
            done[-1] = position.along_pulse if self.timed[number] == position.row else 0.0
        is_time = self.calls.kind[rows] == Buffered.DELAY
        costs = done * per_pulse
        if by_time:
            # How much of a dwell in progress is over is not known: none of it counts.
            costs += np.where(is_time & (rows < position.row), self.calls.p[rows], 0.0)
        behind = np.cumsum(costs[::-1])[::-1]
        at = int(np.flatnonzero(behind >= amount)[-1]) if (behind >= amount).any() else -1
        if at < 0:
            return max(PathPosition(row=first), PathPosition(row=int(rows[0])), key=_key)
        if is_time[at]:
            return PathPosition(row=int(rows[at]))
        along = float((behind[at] - amount) / per_pulse[at])
        return PathPosition(row=int(rows[at]), along_pulse=along)


def _along_arc(dx: float, dy: float, angle: float, sweep: float, length: float) -> float:
    """Return how far along an arc a direction from its centre lies; beyond its ends the nearer end."""
    turned = (math.copysign(1.0, sweep) * (math.atan2(dy, dx) - angle)) % TURN
    span = abs(sweep)
    if turned <= span:
        return length * turned / span if span > 0 else 0.0
    return length if turned - span < TURN - turned else 0.0
