"""Pass: arcs in a form that keeps them in whole pulses: about a centre, by a radius, or as lines.

The ends of an arc are rounded, and so is its centre. Near half a turn a pulse more between the ends moves the top of
an arc by radius by many pulses; near a whole turn it turns the circle around. An arc about a centre whose end is
rounded to the other side of its start becomes a whole circle, or none.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gusjob.controllers.gus.ranges import RADIUS_PULSE
from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import (
    CLOSE_ENDS_PULSE,
    NO_ARCS,
    Arcs,
    Ends,
    arcs_by_centre,
    arcs_by_either,
    arcs_by_radius,
    nearly_closed,
)

_SAME_TOP_PULSE = 0.5
"""Largest change of the top of an arc at which its radius stays as it was written."""
_BY_RADIUS_PULSE, _BY_CENTRE_PULSE = 2.0, 3.0
"""Largest distance of an arc in whole pulses from the one that was drawn: ends round by up to 0.71, the centre, too."""
_SHARES = (0.25, 0.5, 0.75)


def fit_arcs(path: Path) -> tuple[Path, Indices, Arcs]:
    """Choose the form of each arc; those that are none in pulses become a line.

    Returns:
        The path; the rows of the arcs that no form keeps, (k,), and they in pulses.
    """
    rows = np.flatnonzero(path.is_arc)
    if not len(rows):
        return path, rows, NO_ARCS
    x0, y0, x1, y1 = path.ends(rows)
    by_radius, ccw = path.op[rows] == Op.ARC_RADIUS, path.ccw[rows]
    drawn = arcs_by_either((x0, y0, x1, y1), path.cx[rows], path.cy[rows], path.radius[rows], ccw, by_radius)
    ends = (np.rint(x0) + 0.0, np.rint(y0) + 0.0, np.rint(x1) + 0.0, np.rint(y1) + 0.0)
    is_line = lost_arcs(drawn, ends)
    radius = _fitted_radius(path.radius[rows], np.hypot(x1 - x0, y1 - y0), ends)
    forms = _Forms(drawn=drawn, ends=ends, miss=np.hypot(*_minus(drawn.at(np.ones(len(rows))), (x1, y1))), ccw=ccw)
    as_radius = forms.keep_radius(np.where(by_radius, radius, np.nan))
    as_centre = ~is_line & ~as_radius & forms.keep_centre()
    # The radius of an arc about a centre that does not meet its end keeps the top.
    top = _radius_of_top(drawn, ends)
    other = ~is_line & ~as_radius & ~as_centre & ~by_radius & forms.keep_radius(top)
    as_radius = ~is_line & (as_radius | other)
    op = np.select([is_line, as_radius, as_centre], [Op.LINE, Op.ARC_RADIUS, Op.ARC_CENTRE], default=path.op[rows])
    radius = np.where(as_radius, np.where(other, top, radius), np.nan)
    columns = {"op": op, "cx": np.where(as_centre, drawn.cx, np.nan), "cy": np.where(as_centre, drawn.cy, np.nan)}
    changed = {name: getattr(path, name).copy() for name in (*columns, "radius")}
    for name, values in {**columns, "radius": radius}.items():
        changed[name][rows] = values
    bent = np.flatnonzero(~is_line & ~as_radius & ~as_centre)
    return replace(path, **changed), rows[bent], drawn.pick(bent)


def lost_arcs(drawn: Arcs, ends: Ends) -> Bools:
    """Find the arcs that are lines in whole pulses, (k,): of half a turn at most, with ends at most two pulses apart.

    Args:
        drawn: The arcs before rounding.
        ends: Their ends in whole pulses.
    """
    return np.asarray((_chord(ends) <= CLOSE_ENDS_PULSE) & (np.abs(drawn.sweep) <= np.pi))


class _Forms(Struct, frozen=True, kw_only=True, eq=False):
    """Arcs to be sent, (k,): as drawn, their rounded ends, and by how much each misses its unrounded end."""

    drawn: Arcs
    ends: Ends
    miss: Floats
    ccw: Bools

    def keep_centre(self) -> Bools:
        """Find the arcs that a call about their rounded centre keeps."""
        cx, cy = np.rint(self.drawn.cx), np.rint(self.drawn.cy)
        arcs = arcs_by_centre(*self.ends, cx, cy, self.ccw)
        off = np.abs(np.hypot(self.ends[2] - cx, self.ends[3] - cy) - arcs.radius)
        meets = off <= np.minimum(_BY_CENTRE_PULSE, arcs.radius / 2)
        return np.asarray((arcs.radius > 0) & meets & self.keeps(arcs, _BY_CENTRE_PULSE))

    def keep_radius(self, radius: Floats) -> Bools:
        """Find the arcs that a call by a radius keeps; NaN, or a radius that no call has: none."""
        in_range = np.abs(radius) <= RADIUS_PULSE.high
        arcs = arcs_by_radius(*self.ends, np.where(in_range, radius, 1.0), self.ccw)
        good = in_range & (_chord(self.ends) > 0)
        return np.asarray(good & self.keeps(arcs, _BY_RADIUS_PULSE))

    def keeps(self, arcs: Arcs, within_pulse: float) -> Bools:
        """Find arcs that stay near the drawn ones, and turn as far; none that could be taken for a full circle."""
        kept = (np.abs(arcs.sweep - self.drawn.sweep) <= np.pi) & ~nearly_closed(arcs, _chord(self.ends))
        for share in _SHARES:
            at = np.full(len(kept), share)
            kept &= np.hypot(*_minus(arcs.at(at), self.drawn.at(at))) <= within_pulse + self.miss
        return np.asarray(kept)


def _minus(one: tuple[Floats, Floats], other: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    return one[0] - other[0], one[1] - other[1]


def _chord(ends: Ends) -> Floats:
    x0, y0, x1, y1 = ends
    return np.asarray(np.hypot(x1 - x0, y1 - y0))


def _least_radius(ends: Ends) -> Floats:
    """Half the chord, or the next number above it if rounding may have made it too short."""
    x0, y0, x1, y1 = ends
    chord = _chord(ends)
    dx, dy, whole = (np.rint(values).astype(np.int64) for values in (x1 - x0, y1 - y0, chord))
    is_exact = (whole == chord) & (whole * whole == dx * dx + dy * dy)
    return np.where(is_exact, chord / 2, np.nextafter(chord / 2, np.inf))


def _top(radius: Floats, half: Floats) -> Floats:
    """Height of an arc over its chord: of the short one for a radius > 0, of the long one for < 0."""
    size = np.abs(radius)
    rest = np.sqrt(np.maximum(size - half, 0.0) * (size + half))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(radius < 0, size + rest, np.where(size > 0, half * half / (size + rest), 0.0))


def _radius_over(half: Floats, top: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((half * (half / top) + top) / 2)


def _fitted_radius(written: Floats, chord: Floats, ends: Ends) -> Floats:
    """The radius that keeps the height of an arc over its rounded chord, and never less than half of that.

    It stays as written where that is near enough. An arc of half a turn at most stays one.
    """
    half, least = chord / 2, _least_radius(ends)
    sign = np.where(written < 0, -1.0, 1.0)
    size = np.abs(written)
    top = _top(sign * np.maximum(size, half), half)
    stays = (size >= least) & (np.abs(_top(written, least) - top) <= _SAME_TOP_PULSE)
    is_half = np.abs(least - top) <= _SAME_TOP_PULSE
    near = np.where(sign < 0, np.maximum(top, least), np.minimum(top, least))
    fitted = np.where(is_half, least, np.maximum(_radius_over(least, near), least))
    return sign * np.where(stays, size, fitted)


def _radius_of_top(drawn: Arcs, ends: Ends) -> Floats:
    """The radius of arcs about a centre that keeps their height over the rounded chord; < 0 beyond half a turn."""
    half = np.abs(drawn.sweep) / 2
    top = drawn.radius * (1 - np.cos(half))
    least = _least_radius(ends)
    is_long = np.abs(drawn.sweep) > np.pi
    near = np.where(is_long, np.maximum(top, least), np.minimum(top, least))
    return np.where(is_long, -1.0, 1.0) * np.maximum(_radius_over(least, near), least)
