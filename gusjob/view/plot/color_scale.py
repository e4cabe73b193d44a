"""Color scales of a picture: the pieces of the path with emission, their values, and the range of the colors."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import MS_PER_S
from gusjob.view.color_range import ColorRange, color_range, for_people, label
from gusjob.view.palette import BINS
from gusjob.view.strokes import EmissionStrokes, Line, Strokes

OVER = BINS
"""Bin of values above the range."""
UNDER = -1
"""Bin of values below the range."""

_PIECES = 8
"""Number of pieces of a stroke that accelerates from rest, if its value depends on the velocity."""
_MOST_PIECES = 1_000_000
_REST_MM_S = 0.01
"""A beam that is slower is at rest."""
_SAME = 1e-6
"""Rounding errors of a value, relative to it."""
_LONG_MS = 10_000.0
_JOULES = -1
_PER_MM = ((1.0, "J/mm"), (1e3, "mJ/mm"), (1e6, "uJ/mm"), (1e9, "nJ/mm"))


class ColorBy(StrEnum):
    """The quantity that the colors show."""

    POWER = "power"
    ENERGY = "energy"
    VELOCITY = "velocity"
    ORDER = "order"


class ColoredPath(Struct, frozen=True, kw_only=True, eq=False):
    """The colored path of a panel: one channel, values in one unit.

    Attributes:
        channel: The channel.
        label: Name of the quantity.
        unit: Unit of the values.
        strokes: Strokes with the emission, (n,).
        line: The pieces in order, (k,), mm.
        value: Values of the pieces, (k,); infinite for energy per mm of a mark that does not move.
        at_rest: Whether the beam is at rest, (k,).
        range: Range of the colors.
        most_reported: The largest energy per mm in the units of the report; "" if that is the unit of the values.
    """

    channel: int
    label: str
    unit: str
    strokes: Bools
    line: Line
    value: Floats
    at_rest: Bools
    range: ColorRange
    most_reported: str = ""

    def bins(self) -> npt.NDArray[np.int8]:
        """Return the color of each piece, 0 to BINS - 1; OVER above the range, UNDER below it."""
        ends, value = self.range, self.value
        if ends.is_empty:
            return np.where(np.isinf(value), OVER, 0).astype(np.int8)
        over = value > ends.high + _SAME * abs(ends.high)
        under = value < ends.low - _SAME * abs(ends.low)
        place = np.zeros(len(value))
        if not ends.is_single:
            place = np.where(over | under, 0.0, (value - ends.low) / (ends.high - ends.low) * BINS)
        found = np.clip(place, 0, BINS - 1)
        return np.where(over, OVER, np.where(under, UNDER, found)).astype(np.int8)


def color_paths(strokes: Strokes, by: ColorBy, channel: int | None = None) -> tuple[ColoredPath, ...]:
    """Return a colored path for each emitting channel (or only for `channel`), and for each unit of its values."""
    found = []
    for emission in strokes.emissions:
        if channel is None or emission.channel == channel:
            emitting, group = emission.on & (strokes.duration_ms > 0), _unit_groups(emission, by)
            in_order = dict.fromkeys(group[emitting].tolist())
            found += [_colored_path(strokes, emission, emitting & (group == unit), by, unit) for unit in in_order]
    return tuple(found)


def _unit_groups(emission: EmissionStrokes, by: ColorBy) -> npt.NDArray[np.int16]:
    """Group the strokes of a channel by unit: index of the unit, _JOULES, or 0 if the unit does not matter."""
    if by in (ColorBy.VELOCITY, ColorBy.ORDER):
        return np.zeros(len(emission.unit), dtype=np.int16)
    if by is ColorBy.ENERGY:
        return np.where(np.isnan(emission.joules_per_unit_ms), emission.unit.astype(np.int16), np.int16(_JOULES))
    return emission.unit.astype(np.int16)


def _colored_path(strokes: Strokes, emission: EmissionStrokes, emitting: Bools, by: ColorBy, group: int) -> ColoredPath:
    """Return the colored path of one group of strokes."""
    joules, unit = group == _JOULES, emission.units[max(group, 0)]
    at, line, start, velocity = _pieces(strokes, np.flatnonzero(emitting), by)
    length = line.length_mm
    at_rest = strokes.actual.length_mm[at] < _REST_MM_S / MS_PER_S * strokes.duration_ms[at]
    name, peak, reported = "power", np.nan, ""
    match by:
        case ColorBy.POWER:
            value = emission.power[at]
        case ColorBy.ENERGY:
            name = "energy per mm"
            value = np.where(np.isnan(emission.per_mm[at]), np.inf, emission.per_mm[at])
            if joules:
                value = value * emission.joules_per_unit_ms[at]
                factor, unit = _prefix(value[np.isfinite(value)])
                value, peak, reported = value * factor, _peak_joules(emission) * factor, _most_reported(emission)
            else:
                peak, unit = float(emission.peak_per_mm[group]), for_people(f"{unit}*ms/mm")
        case ColorBy.VELOCITY:
            name, unit = ("velocity" if strokes.beam is None else "velocity of the beam"), "mm/s"
            value = velocity
        case ColorBy.ORDER:
            name, unit = "time", "ms"
            value = start
            if value.max() >= _LONG_MS:
                value, unit = value / MS_PER_S, "s"
    return ColoredPath(
        channel=emission.channel,
        label=name,
        unit=unit,
        strokes=emitting,
        line=line,
        value=value,
        at_rest=at_rest,
        range=color_range(value, length, peak=peak, whole=by is ColorBy.ORDER),
        most_reported=reported,
    )


def _pieces(strokes: Strokes, at: Indices, by: ColorBy) -> tuple[Indices, Line, Floats, Floats]:
    """Cut strokes into pieces, since the value may change along a stroke.

    Returns:
        Index of the stroke, line, start in ms, and mean velocity in mm/s of each piece.
    """
    whole, duration = strokes.actual, strokes.duration_ms[at]
    x0, y0, x1, y1 = whole.x0[at], whole.y0[at], whole.x1[at], whole.y1[at]
    v0, v1 = np.maximum(strokes.vel0[at], 0.0), np.maximum(strokes.vel1[at], 0.0)
    if strokes.beam is not None:  # Cut at ticks, if at all.
        v0 = v1 = np.hypot(x1 - x0, y1 - y0) / duration * MS_PER_S
    count = _piece_counts(v0, v1, duration, by)
    if count.sum() > _MOST_PIECES:
        count = np.ones_like(count)
    which = np.repeat(np.arange(len(at)), count)
    number = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    begin, end = number / count[which], (number + 1) / count[which]
    v0, v1 = v0[which], v1[which]

    def path_share(share: Floats) -> Floats:
        """Return the share of the path at a share of the time, at constant acceleration."""
        total = v0 + v1
        found = share.copy()
        np.divide(share * (2 * v0 + (v1 - v0) * share), total, out=found, where=total > 0)
        return found

    first, last = path_share(begin), path_share(end)
    dx, dy = (x1 - x0)[which], (y1 - y0)[which]
    line = Line(
        x0=x0[which] + dx * first,
        y0=y0[which] + dy * first,
        x1=x0[which] + dx * last,
        y1=y0[which] + dy * last,
    )
    start = strokes.start_ms[at][which] + duration[which] * begin
    return at[which], line, start, v0 + (v1 - v0) * (begin + end) / 2


def _piece_counts(v0: Floats, v1: Floats, duration: Floats, by: ColorBy) -> Indices:
    """Return the number of pieces, of equal duration, of each stroke."""
    share = np.zeros(len(v0))
    if by is ColorBy.ORDER:
        share = duration / duration.sum() * (BINS / _PIECES)
    elif by is ColorBy.VELOCITY:
        fastest = np.maximum(v0, v1)
        np.divide(np.abs(v1 - v0), fastest, out=share, where=fastest > 0)
    return np.maximum(np.ceil(share * _PIECES - _SAME), 1).astype(np.intp)


def _prefix(per_mm: Floats) -> tuple[float, str]:
    """Choose the unit of joules per mm by their median."""
    typical = float(np.median(per_mm)) if len(per_mm) else 1.0
    return next((entry for entry in _PER_MM if typical * entry[0] >= 1.0), _PER_MM[-1] if typical > 0 else _PER_MM[0])


def _peak_joules(emission: EmissionStrokes) -> float:
    """Return the highest energy per mm of all units in joules per mm; NaN if there is none."""
    peaks = emission.peak_per_mm[emission.unit] * emission.joules_per_unit_ms
    return float(np.nanmax(peaks[emission.on], initial=-np.inf)) if np.isfinite(peaks[emission.on]).any() else np.nan


def _most_reported(emission: EmissionStrokes) -> str:
    """Return the highest energy per mm as in the report."""
    known = zip(emission.peak_per_mm.tolist(), emission.units, strict=True)
    return ", ".join(f"{label(peak)} {for_people(unit)}·ms/mm" for peak, unit in known if peak == peak)


def uncolored_strokes(strokes: Strokes, colored: ColoredPath | None) -> tuple[Bools, Bools]:
    """Return the strokes without any emission, and those with emission of another channel or unit; (n,) each."""
    any_emission = np.zeros(len(strokes.row), dtype=np.bool_)
    for emission in strokes.emissions:
        any_emission |= emission.on & (strokes.duration_ms > 0)
    own = np.zeros_like(any_emission) if colored is None else colored.strokes
    return ~any_emission, any_emission & ~own


def switch_points(strokes: Strokes, colored: ColoredPath) -> tuple[Floats, Floats]:
    """Return the points where the emission of a colored path's channel begins and ends, (k, 2) each, mm."""
    emission = next(emission for emission in strokes.emissions if emission.channel == colored.channel)
    real = np.flatnonzero(strokes.duration_ms > 0)
    on = emission.on[real]
    before, after = np.append(False, on[:-1]), np.append(on[1:], False)
    line, own = strokes.actual, colored.strokes[real]
    first, last = real[on & ~before & own], real[on & ~after & own]
    return np.column_stack([line.x0[first], line.y0[first]]), np.column_stack([line.x1[last], line.y1[last]])
