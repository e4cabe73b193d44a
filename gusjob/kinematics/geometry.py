"""Lines and arcs as columns: lengths, directions, extents.

Pure functions on arrays; any length unit, angles in radians.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices

TURN = 2 * np.pi
_ROUNDING_PULSE = 2**0.5
"""By how much rounding moves one end of a segment against the other, across it."""
CLOSES_MM = 0.005
"""Largest distance of the end of an arc from its circle."""
SAME_POINT_MM, SAME_POINT_PULSE = 2e-6, 0.1
"""An arc whose end is nearer to its start on both axes ends there: what is left of a computed number is no arc."""
CLOSE_ENDS_PULSE = 2.0
"""Largest distance of the ends of an arc of half a turn at most that is as good as a line."""


def sin_cos_deg(degrees: Floats) -> tuple[Floats, Floats]:
    """Compute sine and cosine of degrees, exact at quarter turns: sin(180) is 0, and so is cos(90)."""
    quarters = np.rint(degrees / 90.0)
    rest = np.radians(degrees - 90.0 * quarters)
    turned, back = quarters % 2 == 1, quarters % 4 >= 2
    sine, cosine = np.where(turned, np.cos(rest), np.sin(rest)), np.where(turned, -np.sin(rest), np.cos(rest))
    return np.where(back, -sine, sine) + 0.0, np.where(back, -cosine, cosine) + 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Arcs:
    """Circle arcs, (n,) each: centre, radius, angle at the start, signed sweep (> 0 counter-clockwise)."""

    cx: Floats
    cy: Floats
    radius: Floats
    angle: Floats
    sweep: Floats

    @property
    def length(self) -> Floats:
        """Length along the arc, (n,)."""
        return np.asarray(self.radius * np.abs(self.sweep))

    def pick(self, at: Indices) -> Arcs:
        """Select some of the arcs."""
        return Arcs(**{f.name: getattr(self, f.name)[at] for f in fields(Arcs)})

    def at(self, share: Floats) -> tuple[Floats, Floats]:
        """Compute the points at a share 0..1 of each arc: x and y, (n,)."""
        angle = self.angle + self.sweep * share
        return self.cx + self.radius * np.cos(angle), self.cy + self.radius * np.sin(angle)

    def direction(self, share: float) -> tuple[Floats, Floats]:
        """Compute the unit direction of travel at a share 0..1 of each arc: x and y, (n,)."""
        angle = self.angle + self.sweep * share
        turn = np.sign(self.sweep)
        return -np.sin(angle) * turn, np.cos(angle) * turn

    def extent(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Compute the bounding box of each arc: x low, x high, y low, y high, (n,) each."""
        (x0, y0), (x1, y1) = self.at(np.zeros_like(self.angle)), self.at(np.ones_like(self.angle))
        low_angle = np.where(self.sweep >= 0, self.angle, self.angle + self.sweep)
        span = np.abs(self.sweep)

        def reaches(quarter: int) -> Bools:
            # The first angle = quarter * 90 degrees at or after the arc's lower end.
            return (quarter * np.pi / 2 - low_angle) % TURN <= span

        x_high = np.where(reaches(0), self.cx + self.radius, np.maximum(x0, x1))
        y_high = np.where(reaches(1), self.cy + self.radius, np.maximum(y0, y1))
        x_low = np.where(reaches(2), self.cx - self.radius, np.minimum(x0, x1))
        y_low = np.where(reaches(3), self.cy - self.radius, np.minimum(y0, y1))
        return x_low, x_high, y_low, y_high


def arcs_by_centre(x0: Floats, y0: Floats, x1: Floats, y1: Floats, cx: Floats, cy: Floats, ccw: Bools) -> Arcs:
    """Make arcs from start to end about an absolute centre; end = start is a full circle."""
    angle = np.arctan2(y0 - cy, x0 - cx)
    to = np.arctan2(y1 - cy, x1 - cx)
    sweep = np.where(ccw, (to - angle) % TURN, -((angle - to) % TURN))
    full = (x0 == x1) & (y0 == y1)
    sweep = np.where(full, np.where(ccw, TURN, -TURN), sweep)
    return Arcs(cx=cx, cy=cy, radius=np.hypot(x0 - cx, y0 - cy), angle=angle, sweep=sweep)


def arcs_by_radius(x0: Floats, y0: Floats, x1: Floats, y1: Floats, radius: Floats, ccw: Bools) -> Arcs:
    """Make arcs of a radius: > 0 up to 180 degrees, < 0 more. A radius below half the chord becomes half the chord.

    Between two ends that are one point there is no arc: it has no length.
    """
    dx, dy = x1 - x0, y1 - y0
    half = np.hypot(dx, dy) / 2
    size = np.maximum(np.abs(radius), half)
    with np.errstate(divide="ignore", invalid="ignore"):
        height = np.where(half > 0, np.sqrt(size * size - half * half) / (2 * half), 0.0)
    # The centre lies left of the chord for a short counter-clockwise or a long clockwise arc.
    side = np.where(ccw == (radius > 0), 1.0, -1.0)
    cx = (x0 + x1) / 2 - side * height * dy
    cy = (y0 + y1) / 2 + side * height * dx
    arcs = arcs_by_centre(x0, y0, x1, y1, cx, cy, ccw)
    return Arcs(cx=cx, cy=cy, radius=size, angle=arcs.angle, sweep=np.where(half > 0, arcs.sweep, 0.0))


def nearly_closed(arcs: Arcs, chord: Floats) -> Bools:
    """Find arcs that may be taken for a full circle, or a full circle for none, (n,).

    Their ends are hardly apart: short arcs, and arcs of nearly a whole turn whose end is beside their start rather than
    before it, so that little changes the side.

    Args:
        arcs: The arcs, in pulses.
        chord: Distance of their ends, pulse; 0 of a full circle, which is none of them.
    """
    turn = np.abs(arcs.sweep)
    short = (chord <= CLOSE_ENDS_PULSE) & (turn <= np.pi)
    return np.asarray((chord > 0) & (short | (arcs.radius * (TURN - turn) < chord / 2)))


Ends = tuple[Floats, Floats, Floats, Floats]
"""x0, y0, x1, y1."""


def arcs_by_either(ends: Ends, cx: Floats, cy: Floats, radius: Floats, ccw: Bools, by_radius: Bools) -> Arcs:
    """Make arcs of which some (`by_radius`) are given by their radius, the others by their centre."""
    first, second = arcs_by_radius(*ends, radius, ccw), arcs_by_centre(*ends, cx, cy, ccw)
    return Arcs(**{f.name: np.where(by_radius, getattr(first, f.name), getattr(second, f.name)) for f in fields(Arcs)})


@dataclass(frozen=True, slots=True, kw_only=True)
class Segments:
    """Lines and arcs that follow each other, (n,) each.

    `x0`, `y0`, `x1`, `y1`: start and end point. `length`: along the segment; `unrounded_length`: in a plan
    that before rounding. `start_x`, `start_y`, `end_x`, `end_y`:
    unit direction at the start and at the end, in a plan that before rounding. `arc_at` (k,): numbers of the segments
    that are `arcs`.

    A segment whose ends are one point, also before rounding, has the direction of the one before it, so the corner
    across it counts.
    """

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats
    length: Floats
    unrounded_length: Floats
    start_x: Floats
    start_y: Floats
    end_x: Floats
    end_y: Floats
    arc_at: Indices
    arcs: Arcs

    @property
    def turns(self) -> Floats:
        """Change of the unit direction from each segment to the next, 2*sin(phi/2), (n-1,).

        Behind segments of no length it is at least the change across them: they take no time.
        """
        changes = np.hypot(self.start_x[1:] - self.end_x[:-1], self.start_y[1:] - self.end_y[:-1])
        still = np.flatnonzero(self.length[:-1] == 0)
        if len(still):
            before = np.maximum.accumulate(np.where(self.length == 0, -1, np.arange(len(self.length))))[still]
            across = np.hypot(
                self.start_x[still + 1] - self.end_x[before], self.start_y[still + 1] - self.end_y[before]
            )
            changes[still] = np.maximum(changes[still], np.where(before >= 0, across, 0.0))
        return changes

    @property
    def moving_length(self) -> Floats:
        """Length of each segment, (n,); where it has none, that of the one before, whose direction it has."""
        still = self.length == 0
        if not still.any():
            return self.length
        return self.length[np.maximum.accumulate(np.where(still, 0, np.arange(len(still))))]

    @property
    def corner_spacing(self) -> Floats:
        """Mean length of the segments before and behind each corner, (n-1,), not less for rounding."""
        length = np.maximum(self.moving_length, self.unrounded_length)
        return np.asarray((length[1:] + length[:-1]) / 2)

    @property
    def rounding_turns(self) -> Floats:
        """By how much rounding of the end points to whole pulses turns each segment at most, (n,)."""
        length = self.moving_length
        return np.where(length > 0, _ROUNDING_PULSE / np.maximum(length, 1e-9), 0.0)

    def arcs_among(self, at: Indices) -> tuple[Indices, Arcs]:
        """Find the arcs among some segments `at`: their indices in `at`, and the arcs."""
        if not len(self.arc_at):
            return np.empty(0, dtype=np.intp), NO_ARCS
        number = np.minimum(np.searchsorted(self.arc_at, at), len(self.arc_at) - 1)
        found = np.flatnonzero(self.arc_at[number] == at)
        return found, self.arcs.pick(number[found])

    def extent(self, at: Indices) -> tuple[Floats, Floats, Floats, Floats]:
        """Compute the bounding boxes of some segments: x low, x high, y low, y high, (k,) each."""
        x_low, x_high = np.minimum(self.x0[at], self.x1[at]), np.maximum(self.x0[at], self.x1[at])
        y_low, y_high = np.minimum(self.y0[at], self.y1[at]), np.maximum(self.y0[at], self.y1[at])
        found, arcs = self.arcs_among(at)
        if len(found):
            x_low[found], x_high[found], y_low[found], y_high[found] = arcs.extent()
        return x_low, x_high, y_low, y_high

    def points(self, at: Indices, share: Floats) -> tuple[Floats, Floats]:
        """Compute the points at a share 0..1 of some segments, each at its own: x and y, (k,)."""
        x = self.x0[at] + (self.x1[at] - self.x0[at]) * share
        y = self.y0[at] + (self.y1[at] - self.y0[at]) * share
        found, arcs = self.arcs_among(at)
        if len(found):
            x[found], y[found] = arcs.at(share[found])
        return x, y


@dataclass(frozen=True, slots=True, kw_only=True)
class Unrounded:
    """Directions before rounding: of each segment as a line from its start to its end, (n,), and of the arcs, (k,)."""

    dx: Floats
    dy: Floats
    arcs: Arcs


def segments(
    x0: Floats, y0: Floats, x1: Floats, y1: Floats, arc_at: Indices, arcs: Arcs, unrounded: Unrounded | None = None
) -> Segments:
    """Make segments from their end points; those at `arc_at` are `arcs`, the others lines.

    Args:
        unrounded: Directions of the segments, where their end points are rounded and shorter ones would turn by it.
    """
    dx, dy = x1 - x0, y1 - y0
    length = unrounded_length = np.hypot(dx, dy)
    ideal = arcs
    if unrounded is not None:
        dx, dy, ideal = unrounded.dx, unrounded.dy, unrounded.arcs
        unrounded_length = np.hypot(dx, dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        start_x, start_y = dx / unrounded_length, dy / unrounded_length
    end_x, end_y = start_x, start_y
    if len(arc_at):
        length[arc_at] = arcs.length
        unrounded_length[arc_at] = ideal.length
        end_x, end_y = start_x.copy(), start_y.copy()
        start_x[arc_at], start_y[arc_at] = ideal.direction(0.0)
        end_x[arc_at], end_y[arc_at] = ideal.direction(1.0)
    still = (length == 0) & (unrounded_length == 0)
    if still.any():
        at = np.maximum.accumulate(np.where(still, -1, np.arange(len(length))))
        carry_x, carry_y = np.where(at >= 0, end_x[at], 1.0), np.where(at >= 0, end_y[at], 0.0)
        start_x, end_x = np.where(still, carry_x, start_x), np.where(still, carry_x, end_x)
        start_y, end_y = np.where(still, carry_y, start_y), np.where(still, carry_y, end_y)
    return Segments(
        x0=x0,
        y0=y0,
        x1=x1,
        y1=y1,
        length=length,
        unrounded_length=unrounded_length,
        start_x=start_x,
        start_y=start_y,
        end_x=end_x,
        end_y=end_y,
        arc_at=arc_at,
        arcs=arcs,
    )


NO_ARCS = Arcs(cx=np.empty(0), cy=np.empty(0), radius=np.empty(0), angle=np.empty(0), sweep=np.empty(0))
