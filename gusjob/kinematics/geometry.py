"""Lines and arcs as columns: lengths, directions, extents.

Pure functions on arrays; any length unit, angles in radians.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks

TURN = 2 * np.pi
_ROUNDING_PULSE = 2**0.5
"""By how much rounding moves one end of a segment against the other, across it."""
CLOSES_MM = 0.005
"""Largest distance of the end of an arc from its circle."""
SAME_POINT_MM, SAME_POINT_PULSE = 2e-6, 0.1
"""An arc whose end is nearer to its start on both axes ends there: what is left of a computed number is no arc."""
CLOSE_ENDS_PULSE = 2.0
"""Largest distance of the ends of an arc of half a turn at most that is as good as a line."""
_ROUNDING_OF_ARC_PULSE = 2.5
"""Divided by the radius: turn of the ends of half a turn if its height changes by a pulse and its chord by sqrt(2).

With the height h over the chord c the sweep is 4*atan(2*h/c).
"""


def sin_cos_deg(degrees: Floats) -> tuple[Floats, Floats]:
    """Compute sine and cosine of degrees, exact at quarter turns: sin(180) is 0, and so is cos(90)."""
    quarters = np.rint(degrees / 90.0)
    rest = np.radians(degrees - 90.0 * quarters)
    turned, back = quarters % 2 == 1, quarters % 4 >= 2
    sine, cosine = np.where(turned, np.cos(rest), np.sin(rest)), np.where(turned, -np.sin(rest), np.cos(rest))
    return np.where(back, -sine, sine) + 0.0, np.where(back, -cosine, cosine) + 0.0


class Arcs(Struct, frozen=True, kw_only=True, eq=False):
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
        return Arcs(**{name: getattr(self, name)[at] for name in Arcs.__struct_fields__})

    def at(self, share: Floats) -> tuple[Floats, Floats]:
        """Compute the points at a share 0..1 of each arc: x and y, (n,)."""
        angle = self.angle + self.sweep * share
        return self.cx + self.radius * np.cos(angle), self.cy + self.radius * np.sin(angle)

    def direction(self, share: Floats | float) -> tuple[Floats, Floats]:
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
    return Arcs(
        **{name: np.where(by_radius, getattr(first, name), getattr(second, name)) for name in Arcs.__struct_fields__}
    )


class Segments(Struct, frozen=True, kw_only=True, eq=False):
    """Lines and arcs that follow each other, (n,) each.

    `x0`, `y0`, `x1`, `y1`: start and end point. `length`: along the segment. `arc_at` (k,): numbers of the segments
    that are `arcs`. `unrounded`: what they are before rounding, in a plan. `moving`: number of the segment whose
    direction each has; None: its own.

    A segment whose ends are one point, also before rounding, has the direction of the one before it, so the corner
    across it counts.
    """

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats
    length: Floats
    arc_at: Indices
    arcs: Arcs
    unrounded: Unrounded | None = None
    moving: Indices | None = None

    def start_direction(self, at: Indices) -> tuple[Floats, Floats]:
        """Compute the unit direction at the start of some segments, in a plan before rounding: x and y, (k,)."""
        return self._direction(at, 0.0)

    def end_direction(self, at: Indices) -> tuple[Floats, Floats]:
        """Compute the unit direction at the end of some segments, in a plan before rounding: x and y, (k,)."""
        return self._direction(at, 1.0)

    def _direction(self, at: Indices, share: float) -> tuple[Floats, Floats]:
        source = at if self.moving is None else self.moving[at]
        dx, dy = self._unrounded_chords(np.maximum(source, 0))
        length = np.hypot(dx, dy)
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = dx / length, dy / length
        found, arcs = self._unrounded_arcs_among(source)
        if len(found):
            # Behind an arc its end counts.
            x[found], y[found] = arcs.direction(np.where(source == at, share, 1.0)[found])
        if len(self.chords):
            found, which = _found(self.chords.at, source)
            x[found], y[found] = self.chords.directions(which, is_end=(source[found] != at[found]) | (share > 0))
        if self.moving is not None:
            x[source < 0], y[source < 0] = 1.0, 0.0
        return x, y

    def _unrounded_chords(self, at: Indices | slice) -> tuple[Floats, Floats]:
        """Compute the way from the start to the end of some segments, in a plan before rounding: x and y, (k,)."""
        if self.unrounded is None:
            return self.x1[at] - self.x0[at], self.y1[at] - self.y0[at]
        return self.unrounded.dx[at], self.unrounded.dy[at]

    def _unrounded_arcs_among(self, at: Indices) -> tuple[Indices, Arcs]:
        return _among(self.arc_at, self.arcs if self.unrounded is None else self.unrounded.arcs, at)

    @property
    def chords(self) -> Chords:
        """Lines in place of a part of a curve, in a plan."""
        return NO_CHORDS if self.unrounded is None else self.unrounded.chords

    @property
    def turns(self) -> Floats:
        """Change of the unit direction from each segment to the next, 2*sin(phi/2), (n-1,).

        Behind segments of no length it is at least the change across them: they take no time.
        """
        changes = np.empty(max(len(self.length) - 1, 0))
        for part in blocks(len(changes)):
            at = np.arange(part.start, part.stop)
            changes[part] = self._change(at, at + 1)
        still = np.flatnonzero(self.length[:-1] == 0)
        if len(still):
            before = np.maximum.accumulate(np.where(self.length == 0, -1, np.arange(len(self.length))))[still]
            across = self._change(np.maximum(before, 0), still + 1)
            changes[still] = np.maximum(changes[still], np.where(before >= 0, across, 0.0))
        return changes

    def _change(self, before: Indices, after: Indices) -> Floats:
        """Compute the change of the unit direction from some segments to others, (k,)."""
        (x0, y0), (x1, y1) = self.end_direction(before), self.start_direction(after)
        return np.asarray(np.hypot(x1 - x0, y1 - y0))

    @property
    def unrounded_length(self) -> Floats:
        """Length of each segment, (n,), in a plan before rounding."""
        if self.unrounded is None:
            return self.length
        length = np.hypot(self.unrounded.dx, self.unrounded.dy)
        length[self.arc_at] = self.unrounded.arcs.length
        return length

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
        spacing = length[1:] + length[:-1]
        spacing /= 2
        return spacing

    @property
    def rounding_turns(self) -> Floats:
        """By how much rounding of the end points to whole pulses turns each segment at most, (n,)."""
        length = self.moving_length
        turns = np.empty(len(length))
        for part in blocks(len(length)):
            turns[part] = np.where(length[part] > 0, _ROUNDING_PULSE / np.maximum(length[part], 1e-9), 0.0)
        if len(self.arc_at):
            turns[self.arc_at] += _ROUNDING_OF_ARC_PULSE / np.maximum(self.arcs.radius, 1e-9)
        return turns

    def arcs_among(self, at: Indices) -> tuple[Indices, Arcs]:
        """Find the arcs among some segments `at`: their indices in `at`, and the arcs."""
        return _among(self.arc_at, self.arcs, at)

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


class Chords(Struct, frozen=True, kw_only=True, eq=False):
    """Lines in place of a part of a curve, (c,): the direction of the curve at their ends, and its radius.

    `at`: numbers of the segments, ascending. `start_x`, `start_y`, `end_x`, `end_y`: unit directions. `continues`: the
    next segment is the next chord of the same curve.
    """

    at: Indices
    start_x: Floats
    start_y: Floats
    end_x: Floats
    end_y: Floats
    radius: Floats
    continues: Bools

    def __len__(self) -> int:
        return len(self.at)

    def directions(self, which: Indices, is_end: Bools) -> tuple[Floats, Floats]:
        """Direction at the start or the end of some chords: x and y, (k,)."""
        return (
            np.where(is_end, self.end_x[which], self.start_x[which]),
            np.where(is_end, self.end_y[which], self.start_y[which]),
        )


class Unrounded(Struct, frozen=True, kw_only=True, eq=False):
    """Directions before rounding: of each segment as a line from its start to its end, (n,), and of the arcs, (k,).

    `chords`: segments that are lines in place of a curve.
    """

    dx: Floats
    dy: Floats
    arcs: Arcs
    chords: Chords


def segments(
    x0: Floats, y0: Floats, x1: Floats, y1: Floats, arc_at: Indices, arcs: Arcs, unrounded: Unrounded | None = None
) -> Segments:
    """Make segments from their end points; those at `arc_at` are `arcs`, the others lines.

    Args:
        unrounded: Directions of the segments, where their end points are rounded and shorter ones would turn by it.
    """
    length = np.empty(len(x1))
    for part in blocks(len(length)):
        length[part] = np.hypot(x1[part] - x0[part], y1[part] - y0[part])
    if len(arc_at):
        length[arc_at] = arcs.length
    found = Segments(x0=x0, y0=y0, x1=x1, y1=y1, length=length, arc_at=arc_at, arcs=arcs, unrounded=unrounded)
    is_still = length == 0
    if unrounded is not None and is_still.any():
        is_still &= found.unrounded_length == 0
    if not is_still.any():
        return found
    moving = np.maximum.accumulate(np.where(is_still, -1, np.arange(len(length))))
    return replace(found, moving=moving)


def _among(arc_at: Indices, arcs: Arcs, at: Indices) -> tuple[Indices, Arcs]:
    """Find the arcs among some segments `at`: their indices in `at`, and the arcs. `arc_at`: segment of each arc."""
    if not len(arc_at):
        return np.empty(0, dtype=np.intp), NO_ARCS
    found, which = _found(arc_at, at)
    return found, arcs.pick(which)


def _found(some: Indices, at: Indices) -> tuple[Indices, Indices]:
    """Find one or more ascending numbers among others `at`: their indices in `at`, and which of `some` each is."""
    number = np.minimum(np.searchsorted(some, at), len(some) - 1)
    found = np.flatnonzero(some[number] == at)
    return found, number[found]


NO_ARCS = Arcs(cx=np.empty(0), cy=np.empty(0), radius=np.empty(0), angle=np.empty(0), sweep=np.empty(0))
_NOWHERE = np.empty(0)
NO_CHORDS = Chords(
    at=np.empty(0, dtype=np.intp),
    start_x=_NOWHERE,
    start_y=_NOWHERE,
    end_x=_NOWHERE,
    end_y=_NOWHERE,
    radius=_NOWHERE,
    continues=np.empty(0, dtype=np.bool_),
)
