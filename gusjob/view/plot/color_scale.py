"""What is coloured in a picture of the path: pieces with light, their values, and the range of the colours."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import MS_PER_S
from gusjob.view.strokes import EmissionStrokes, Line, Strokes

BINS = 64
"""Colours of a picture."""
OVER = BINS
"""The bin of what lies above the range."""

_PIECES = 8
"""A stroke that comes to speed from rest is cut into so many, where its values change with the velocity."""
_MOST_PIECES = 1_000_000
_STANDS_MM_S = 0.01
"""What is slower stands."""
_SAME = 1e-6
"""Values whose range is a smaller share of them are one value: figures are read to six digits."""
_SHARE = 0.99
"""Colours of energy per mm are for so much of the length: where the beam hardly moves there is no highest value."""
_LONG_MS = 10_000.0
_JOULES = -1
_PER_MM = ((1.0, "J/mm"), (1e3, "mJ/mm"), (1e6, "uJ/mm"), (1e9, "nJ/mm"))


class ColorBy(StrEnum):
    """What colours tell."""

    POWER = "power"
    ENERGY = "energy"
    VELOCITY = "velocity"
    ORDER = "order"


@dataclass(frozen=True, slots=True, kw_only=True)
class ColoredPath:
    """The light of a panel: of one channel, its values in one unit.

    `strokes` (n,): which strokes it shines in. `line`, `value`, `stands` (k,): its pieces in order, mm, with their
    values in `unit` (infinite for energy per mm where the beam stands) and whether the beam stands there.
    `low`, `high`: the range of the colours; equal for a single value, NaN if there is no finite value. `highest`: the
    highest finite value.
    """

    channel: int
    word: str
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
        """Whether one colour is enough for what lies within the range."""
        return not self.high > self.low

    @property
    def exceeds_range(self) -> bool:
        """Whether values lie above the range."""
        return bool((self.bins() == OVER).any())

    def bins(self) -> npt.NDArray[np.int8]:
        """The colour of each piece, 0 to BINS - 1; OVER above the range."""
        over = self.value > self.high + _SAME * abs(self.high) if self.high == self.high else np.isinf(self.value)
        if self.is_constant:
            return np.where(over, OVER, 0).astype(np.int8)
        place = np.where(over, 0.0, (self.value - self.low) / (self.high - self.low) * BINS)
        return np.where(over, OVER, np.clip(place, 0, BINS - 1)).astype(np.int8)


def colored_paths(strokes: Strokes, by: ColorBy, channel: int | None = None) -> tuple[ColoredPath, ...]:
    """What to colour: of each channel that shines (or of one) one entry, or several if its values change their unit."""
    found = []
    for light in strokes.emissions:
        if channel is None or light.channel == channel:
            lit, group = light.on & (strokes.duration_ms > 0), _unit_groups(light, by)
            in_order = dict.fromkeys(group[lit].tolist())
            found += [_colored_path(strokes, light, lit & (group == unit), by, unit) for unit in in_order]
    return tuple(found)


def _unit_groups(light: EmissionStrokes, by: ColorBy) -> npt.NDArray[np.int16]:
    """Which strokes of a channel share a unit: place among its units, _JOULES, or 0 where its units do not matter."""
    if by in (ColorBy.VELOCITY, ColorBy.ORDER):
        return np.zeros(len(light.unit), dtype=np.int16)
    if by is ColorBy.ENERGY:
        return np.where(np.isnan(light.joules_per_unit_ms), light.unit.astype(np.int16), np.int16(_JOULES))
    return light.unit.astype(np.int16)


def _colored_path(strokes: Strokes, light: EmissionStrokes, shine: Bools, by: ColorBy, group: int) -> ColoredPath:
    """One entry."""
    joules, unit = group == _JOULES, light.units[max(group, 0)]
    at, line, start, duration, velocity = _pieces(strokes, np.flatnonzero(shine), by)
    length = line.length_mm
    stands = strokes.actual.length_mm[at] < _STANDS_MM_S / MS_PER_S * strokes.duration_ms[at]
    word = "power"
    match by:
        case ColorBy.POWER:
            value = light.power[at]
        case ColorBy.ENERGY:
            word = "energy per mm"
            energy = light.power[at] * duration * (light.joules_per_unit_ms[at] if joules else 1.0)
            value = np.divide(energy, length, out=np.full(len(at), np.inf), where=~stands & (length > 0))
            unit = f"{unit}*ms/mm"
            if joules:
                factor, unit = _prefix(value[np.isfinite(value)])
                value = value * factor
        case ColorBy.VELOCITY:
            word, unit = ("velocity" if strokes.beam is None else "velocity of the beam"), "mm/s"
            value = velocity
        case ColorBy.ORDER:
            word, unit = "time", "ms"
            value = start
            if value.max() >= _LONG_MS:
                value, unit = value / MS_PER_S, "s"
    low, high, highest = _range(value, length, by)
    return ColoredPath(
        channel=light.channel,
        word=word,
        unit=unit,
        strokes=shine,
        line=line,
        value=value,
        at_rest=stands,
        low=low,
        high=high,
        highest=highest,
    )


def _pieces(strokes: Strokes, at: Indices, by: ColorBy) -> tuple[Indices, Line, Floats, Floats, Floats]:
    """(stroke, line, ms of its start and its length, mm/s) of pieces: what is shown may change along a stroke."""
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

    def way(share: Floats) -> Floats:
        """Way in equal acceleration, as a share of the whole, at a share of the time."""
        total = v0 + v1
        found = share.copy()
        np.divide(share * (2 * v0 + (v1 - v0) * share), total, out=found, where=total > 0)
        return found

    first, last = way(begin), way(end)
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
    """Into how many pieces of equal time each stroke is cut."""
    share = np.zeros(len(v0))
    if by is ColorBy.ORDER:
        share = duration / duration.sum() * (BINS / _PIECES)
    elif by is not ColorBy.POWER:
        fastest = np.maximum(v0, v1)
        np.divide(np.abs(v1 - v0), fastest, out=share, where=fastest > 0)
    return np.maximum(np.ceil(share * _PIECES - _SAME), 1).astype(np.intp)


def _prefix(per_mm: Floats) -> tuple[float, str]:
    """Factor and unit in which joules per mm are read without many noughts."""
    typical = float(np.median(per_mm)) if len(per_mm) else 1.0
    return next((entry for entry in _PER_MM if typical * entry[0] >= 1.0), _PER_MM[-1] if typical > 0 else _PER_MM[0])


def _range(value: Floats, length: Floats, by: ColorBy) -> tuple[float, float, float]:
    """Low and high of the colours, and the highest finite value."""
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


def uncolored_strokes(strokes: Strokes, shade: ColoredPath | None) -> tuple[Bools, Bools]:
    """(n,) each: strokes without any light, and those lit by another channel or in another unit."""
    any_light = np.zeros(len(strokes.row), dtype=np.bool_)
    for light in strokes.emissions:
        any_light |= light.on & (strokes.duration_ms > 0)
    mine = np.zeros_like(any_light) if shade is None else shade.strokes
    return ~any_light, any_light & ~mine


def switch_points(strokes: Strokes, shade: ColoredPath) -> tuple[Floats, Floats]:
    """Where the light of a shade's channel comes and where it goes, (k, 2) each, mm."""
    light = next(light for light in strokes.emissions if light.channel == shade.channel)
    real = np.flatnonzero(strokes.duration_ms > 0)
    on = light.on[real]
    before, behind = np.append(False, on[:-1]), np.append(on[1:], False)
    line, mine = strokes.actual, shade.strokes[real]
    first, last = real[on & ~before & mine], real[on & ~behind & mine]
    return np.column_stack([line.x0[first], line.y0[first]]), np.column_stack([line.x1[last], line.y1[last]])
