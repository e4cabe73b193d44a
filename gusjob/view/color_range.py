"""The range of values that a colour scale shows, and its labels; the same in pictures and on the page."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from msgspec import Struct

from gusjob.i18n.phrases import figure
from gusjob.kinematics.arrays import Floats

_SHARES = 0.02, 0.98
"""Shares of the length below the low and the high end of the range."""
_NEAR = 1.0
"""An end moves to the extreme value if that widens the range by no more than this share."""
_SIMILAR = 0.1
"""Values that differ by no more than this share of the largest are similar."""
_DIGITS = 4
_FAITHFUL = 0.01
"""A label may be off by this share of the range."""


class ColorRange(Struct, frozen=True, kw_only=True):
    """Range of a colour scale: its ends, and the smallest and the largest value. NaN if there is no value."""

    low: float
    high: float
    least: float
    most: float

    @property
    def is_empty(self) -> bool:
        """Whether there is no value."""
        return self.high != self.high

    @property
    def is_single(self) -> bool:
        """Whether all values in the range are shown as the same number."""
        return self.is_empty or label(self.low) == label(self.high)

    @property
    def has_lower(self) -> bool:
        """Whether there are values below the range."""
        return self.least < self.low

    @property
    def has_higher(self) -> bool:
        """Whether there are values above the range."""
        return self.most > self.high


def color_range(value: Floats, length: Floats, *, peak: float = np.nan, whole: bool = False) -> ColorRange:
    """Return the range for values along a path: a few extreme values do not flatten the colours of the others.

    If the others are all shown as the same number, there is nothing to flatten, and if all values are similar, none is
    extreme: then all of them are in the range.

    Args:
        value: Values, (n,); those that are not finite have no colour.
        length: Length along which each value is found, (n,).
        peak: The largest value if it is known to be larger than these, which may be means.
        whole: Whether all values are in the range.
    """
    finite = np.isfinite(value)
    if not finite.any():
        return ColorRange(low=np.nan, high=np.nan, least=np.nan, most=peak)
    order = np.argsort(value[finite], kind="stable")
    value, length = value[finite][order], length[finite][order]
    least, most = float(value[0]), float(np.fmax(value[-1], peak))
    upto = np.cumsum(length if length.sum() > 0 else np.ones(len(length)))
    low, high = (float(value[np.searchsorted(upto, share * upto[-1])]) for share in _SHARES)
    similar = most - least <= _SIMILAR * max(abs(least), abs(most))
    near = np.inf if whole or similar or label(low) == label(high) else _NEAR * (high - low)
    if low - least <= near:
        low = least
    if most - high <= near:
        high = most
    return ColorRange(low=low, high=high, least=least, most=most)


def label(value: float) -> str:
    """Format a value of a scale, with at most four significant digits."""
    return figure(value, _DIGITS)


def labelled(low: float, high: float, between: Iterable[float]) -> list[float]:
    """Return the ticks of a range, its ends included, whose labels are true and differ from each other."""
    if label(low) == label(high):
        return [high]
    seen, found = {label(low), label(high)}, []
    for tick in between:
        text = label(tick)
        if text not in seen and abs(float(text) - tick) <= _FAITHFUL * (high - low):
            seen.add(text)
            found.append(tick)
    return [low, *found, high]


def for_people(unit: str) -> str:
    """Return a unit as people write it: with a middle dot."""
    return unit.replace("*", "·")
