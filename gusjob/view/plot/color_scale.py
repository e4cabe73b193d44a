"""Color scales of a picture: the pieces of the path with emission, their values, and the range of the colors."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import MS_PER_S
from gusjob.view.strokes import EmissionStrokes, Line, Strokes

BINS = 64
"""Number of colors."""
OVER = BINS
"""Bin of values above the range."""

_PIECES = 8
"""Number of pieces of a stroke that accelerates from rest, if its value depends on the velocity."""
_MOST_PIECES = 1_000_000
_REST_MM_S = 0.01
"""A beam that is slower is at rest."""
_SAME = 1e-6
"""Values with a smaller relative range are equal: numbers are shown with six digits."""
_SHARE = 0.99
"""Share of the length within the color range of energy per mm, which is unlimited where the beam is almost at rest."""
_LONG_MS = 10_000.0
_JOULES = -1
_PER_MM = ((1.0, "J/mm"), (1e3, "mJ/mm"), (1e6, "uJ/mm"), (1e9, "nJ/mm"))


class ColorBy(StrEnum):
    """The quantity that the colors show."""

    POWER = "power"
    ENERGY = "energy"
    VELOCITY = "velocity"
    ORDER = "order"


@dataclass(frozen=True, slots=True, kw_only=True)
class ColoredPath:
    """The colored path of a panel: one channel, values in one unit.

    Attributes:
        channel: The channel.
        label: Name of the quantity.
        unit: Unit of the values.
        strokes: Strokes with the emission, (n,).
        line: The pieces in order, (k,), mm.
        value: Values of the pieces, (k,); infinite for energy per mm where the beam is at rest.
        at_rest: Whether the beam is at rest, (k,).
        low: Low end of the color range.
        high: High end; equal to `low` for a single value; both are NaN if there is no finite value.
        highest: The highest finite value.
    """

    channel: int
    label: str
    unit: str
    strokes: Bools
    line: Line
    value: Floats
    at_rest: Bools
    low: float
    high: float
    highest: float

    @property
    def is_constant(self) -> bool:
        """Whether all values within the range are equal."""
        return not self.high > self.low

    @property
    def exceeds_range(self) -> bool:
        """Whether some values are above the range."""
        return bool((self.bins() == OVER).any())

    def bins(self) -> npt.NDArray[np.int8]:
        """Return the color of each piece, 0 to BINS - 1; OVER above the range."""
        over = self.value > self.high + _SAME * abs(self.high) if self.high == self.high else np.isinf(self.value)
        if self.is_constant:
            return np.where(over, OVER, 0).astype(np.int8)
        place = np.where(over, 0.0, (self.value - self.low) / (self.high - self.low) * BINS)
        return np.where(over, OVER, np.clip(place, 0, BINS - 1)).astype(np.int8)


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
    at, line, start, duration, velocity = _pieces(strokes, np.flatnonzero(emitting), by)
    length = line.length_mm
    at_rest = strokes.actual.length_mm[at] < _REST_MM_S / MS_PER_S * strokes.duration_ms[at]
    label = "power"
    match by:
        case ColorBy.POWER:
            value = emission.power[at]
        case ColorBy.ENERGY:
            label = "energy per mm"
            energy = emission.power[at] * duration * (emission.joules_per_unit_ms[at] if joules else 1.0)
            value = np.divide(energy, length, out=np.full(len(at), np.inf), where=~at_rest & (length > 0))
            unit = f"{unit}*ms/mm"
            if joules:
                factor, unit = _prefix(value[np.isfinite(value)])
                value = value * factor
        case ColorBy.VELOCITY:
            label, unit = ("velocity" if strokes.beam is None else "velocity of the beam"), "mm/s"
            value = velocity
        case ColorBy.ORDER:
            label, unit = "time", "ms"
            value = start
            if value.max() >= _LONG_MS:
                value, unit = value / MS_PER_S, "s"
    low, high, highest = _range(value, length, by)
    return ColoredPath(
        channel=emission.channel,
        label=label,
        unit=unit,
        strokes=emitting,
        line=line,
        value=value,
        at_rest=at_rest,
        low=low,
        high=high,
        highest=highest,
    )


def _pieces(strokes: Strokes, at: Indices, by: ColorBy) -> tuple[Indices, Line, Floats, Floats, Floats]:
    """Cut strokes into pieces, since the value may change along a stroke.

    Returns:
        Index of the stroke, line, start in ms, duration in ms, and mean velocity in mm/s of each piece.
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
    return at[which], line, start, (duration / count)[which], v0 + (v1 - v0) * (begin + end) / 2


def _piece_counts(v0: Floats, v1: Floats, duration: Floats, by: ColorBy) -> Indices:
    """Return the number of pieces, of equal duration, of each stroke."""
    share = np.zeros(len(v0))
    if by is ColorBy.ORDER:
        share = duration / duration.sum() * (BINS / _PIECES)
    elif by is not ColorBy.POWER:
        fastest = np.maximum(v0, v1)
        np.divide(np.abs(v1 - v0), fastest, out=share, where=fastest > 0)
    return np.maximum(np.ceil(share * _PIECES - _SAME), 1).astype(np.intp)


def _prefix(per_mm: Floats) -> tuple[float, str]:
    """Choose the unit of joules per mm by their median."""
    typical = float(np.median(per_mm)) if len(per_mm) else 1.0
    return next((entry for entry in _PER_MM if typical * entry[0] >= 1.0), _PER_MM[-1] if typical > 0 else _PER_MM[0])


def _range(value: Floats, length: Floats, by: ColorBy) -> tuple[float, float, float]:
    """Return low and high end of the color range, and the highest finite value."""
    finite = np.isfinite(value)
    if not finite.any():
        return np.nan, np.nan, np.nan
    value, length = value[finite], length[finite]
    low, highest = float(value.min()), float(value.max())
    high = highest
    if by is ColorBy.ENERGY:
        order = np.argsort(value, kind="stable")
        upto = np.cumsum(length[order])
        high = float(value[order[np.searchsorted(upto, _SHARE * upto[-1])]])
    if high - low <= _SAME * max(abs(low), abs(high)):
        low = high
    return low, high, highest


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
