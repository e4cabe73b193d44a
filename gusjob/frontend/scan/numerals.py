"""Numerals as columns, and the decimal numbers that are made of them.

A numeral is a run of digits and points, as long as possible: 12, 1.5, .5 or 5. A number is a numeral with a sign before
it and an exponent after it, which has a numeral of its own.

The digits of a number together are a whole number. It and the power of ten are exact as floats up to some size: then
one division rounds correctly. What is beyond that size is divided with twice the digits, or read as text.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints

Words = npt.NDArray[np.uint64]

PADDING = 8
"""Bytes that a text has before its first numeral."""
_WINDOW = 8
_MAX_DIGITS = 19
"""So many digits always fit a uint64."""
_EXACT_DIGITS, _EXACT_POWER = 15, 22
"""Whole numbers and powers of ten up to here are floats without rounding."""
_POWERS = np.array([float(f"1e{k}") for k in range(_EXACT_POWER + 1)])
_WHOLE_POWERS = np.array([10**k for k in range(_MAX_DIGITS + 1)], dtype=np.uint64)
_LOW_BITS, _DIGIT_BIT = np.uint64(0x0F0F0F0F0F0F0F0F), np.uint64(0x1010101010101010)
_ONE, _FOUR, _EIGHT = np.uint64(1), np.uint64(4), np.uint64(8)
_JOINS = (
    (np.uint64(10 * 2**8 + 1), np.uint64(8), np.uint64(0x00FF00FF00FF00FF)),
    (np.uint64(100 * 2**16 + 1), np.uint64(16), np.uint64(0x0000FFFF0000FFFF)),
    (np.uint64(10000 * 2**32 + 1), np.uint64(32), np.uint64(0x00000000FFFFFFFF)),
)
"""Factor, shift and mask that join neighbours: digits to pairs, pairs to fours, fours to eights."""
_MANY = np.uint64(10**9)
"""An exponent beyond all that a float has."""
_BYTES_AFTER = (np.uint64(sum((7 - k) << (61 - 8 * k) for k in range(8))), np.uint64(61))
"""Factor and shift by which 1 << 8k becomes 7 - k, the number of bytes after the one at k; and 0 becomes 0."""
_SPLIT = 2.0**27 + 1
_DOUBT = 2.0**-40
"""Relative error of the second half of a quotient, far above the true one."""


class NumberForm(Struct, frozen=True, kw_only=True):
    """How a number is written.

    Attributes:
        has_point: Whether its numeral has a point.
        exponent: The sign of its exponent, whose numeral is the next one; 0 if it has none.
        is_negative: Whether its sign is a minus.
    """

    has_point: bool = False
    exponent: int = 0
    is_negative: bool = False


class Numerals(Struct, frozen=True, kw_only=True, eq=False):
    """Numerals in a text.

    Attributes:
        text: Padding, then the text.
        edges: Where each begins, and ends, in turn, (2k,).
    """

    text: bytes
    edges: Indices

    def lengths(self, at: Indices) -> Indices:
        """Characters of some numerals."""
        return np.asarray(self.edges[2 * at + 1] - self.edges[2 * at])

    def digits(self, at: Indices) -> tuple[Words, Indices]:
        """The values of numerals without a point, wrong above 19 digits, and how many digits they have."""
        digits = self.lengths(at)
        return _whole_numbers(self.text, self.edges[2 * at + 1], digits, has_point=False)[0], digits

    def numbers(self, form: NumberForm, at: Indices) -> Floats:
        """The numbers at some numerals, correctly rounded, never -0; inf where one is too large for a float, (n,)."""
        at = 2 * at
        ends = self.edges[at + 1]
        digits = ends - self.edges[at]
        mantissa, decimals = _whole_numbers(self.text, ends, digits, has_point=form.has_point)
        digits -= form.has_point
        if decimals is None and not form.exponent:
            found = mantissa.astype(np.float64)  # The conversion itself rounds correctly.
            unsure = np.flatnonzero(digits > _MAX_DIGITS) if int(digits.max(initial=0)) > _MAX_DIGITS else ()
        else:
            power = self._exponents(at // 2 + 1) * form.exponent if form.exponent else None
            found, unsure = _scaled(mantissa, digits, decimals, power)
        if len(unsure):
            last = at[unsure] + (2 if form.exponent else 0)
            found[unsure] = self._by_text(self.edges[at[unsure]], self.edges[last + 1])
        if form.is_negative:
            np.subtract(0.0, found, out=found)
        return found

    def are_same(self, at: Indices) -> bool:
        """Whether some numerals, at least one, have the same characters, at most eight."""
        begin, end = self.edges[2 * at[0]], self.edges[2 * at[0] + 1]
        begin_of_last, end_of_last = self.edges[2 * at[-1]], self.edges[2 * at[-1] + 1]
        if end - begin > _WINDOW or self.text[begin:end] != self.text[begin_of_last:end_of_last]:
            return False  # Most numerals that differ do so here.
        ends = self.edges[2 * at + 1]
        words = _windows(self.text)[ends - _WINDOW]
        words ^= words[0]
        words >>= np.uint64(8 * (_WINDOW - (end - begin)))
        return not words.any() and bool((ends - self.edges[2 * at] == end - begin).all())

    def _exponents(self, at: Indices) -> Ints:
        """Exponents without their signs; those that have too many digits are some large number."""
        values, digits = self.digits(at)
        values[digits > _MAX_DIGITS] = _MANY
        found: Ints = np.minimum(values, _MANY).astype(np.int64)
        return found

    def _by_text(self, starts: Indices, ends: Indices) -> Floats:
        """Numbers without a sign, each from its text."""
        return np.array([float(self.text[a:b]) for a, b in zip(starts.tolist(), ends.tolist(), strict=True)])


def _whole_numbers(text: bytes, ends: Indices, lengths: Indices, *, has_point: bool) -> tuple[Words, Ints | None]:
    """The digits of numerals as whole numbers, wrong above 19 digits, and how many of them are decimals.

    Decimals are None if the numerals have no point.
    """
    values, point = _last_digits(text, ends, np.minimum(lengths, _WINDOW), has_point=has_point)
    decimals = None if point is None else _bytes_after(point)
    if len(lengths) and int(lengths.max()) > _WINDOW:
        longer = np.flatnonzero(lengths > _WINDOW)
        values[longer], further = _long_numbers(text, ends[longer], lengths[longer])
        if decimals is not None:
            decimals[longer] = further
    return values, decimals


def _long_numbers(text: bytes, ends: Indices, lengths: Indices) -> tuple[Words, Ints]:
    """As _whole_numbers, from several windows of digits."""
    values, decimals = np.zeros(len(ends), dtype=np.uint64), np.zeros(len(ends), dtype=np.int64)
    digits = np.zeros(len(ends), dtype=np.int64)
    for before in range(0, _MAX_DIGITS + 1, _WINDOW):
        rest = np.clip(lengths - before, 0, _WINDOW)
        found, point = _last_digits(text, np.maximum(ends - before, _WINDOW), rest, has_point=True)
        assert point is not None
        values += found * _WHOLE_POWERS[np.minimum(digits, _MAX_DIGITS)] * (rest > 0)
        has_point = (point != 0) & (rest > 0)
        decimals = np.where(has_point, digits + _bytes_after(point), decimals)
        digits += _WINDOW - has_point
    return values, decimals


def _last_digits(text: bytes, ends: Indices, lengths: Indices, *, has_point: bool) -> tuple[Words, Words | None]:
    """The values of the last digits of numerals, at most eight bytes of each, without their point.

    All digits of a numeral are joined at once in one word.

    Returns:
        The values, and for each numeral 1 << 8k if byte k of its eight bytes is a point, 0 if none is; None if
        `has_point` is not set.
    """
    words = _windows(text)[ends - _WINDOW]
    shifts = ((_WINDOW - lengths) * 8).astype(np.uint64)
    words >>= shifts  # The bytes before the numeral become zeros, as leading digits.
    words <<= shifts
    point = None
    if has_point:
        point = words >> _ONE  # Of digits and points only a point has bit 5 without bit 4.
        point &= ~words
        point &= _DIGIT_BIT
    words &= _LOW_BITS
    if point is not None:
        words &= ~(point - (point >> _FOUR))
        point >>= _FOUR
        before = np.maximum(point, _ONE)
        before -= _ONE
        before &= words
        words -= before
        before <<= _EIGHT
        words += before
    for factor, shift, mask in _JOINS:
        words *= factor
        words >>= shift
        words &= mask
    return words, point


def _windows(text: bytes) -> Words:
    """The eight bytes from each byte of a text on, as words."""
    return np.ndarray(len(text) - _WINDOW + 1, dtype="<u8", buffer=text, strides=(1,))


def _bytes_after(point: Words) -> Ints:
    """How many of eight bytes come after a point; 0 without one."""
    factor, shift = _BYTES_AFTER
    return (point * factor >> shift).astype(np.int64)


def _scaled(mantissa: Words, digits: Indices, decimals: Ints | None, power: Ints | None) -> tuple[Floats, Indices]:
    """Products mantissa * 10^(power - decimals), and the indices at which it may not be rounded correctly."""
    found = mantissa.astype(np.float64)
    if power is None:
        assert decimals is not None
        found /= _POWERS[np.minimum(decimals, _EXACT_POWER)]
        if not len(digits) or int(digits.max()) <= _EXACT_DIGITS:
            return found, np.zeros(0, dtype=np.intp)
        power = -decimals
    else:
        power = power if decimals is None else power - decimals
        found *= _POWERS[np.clip(power, 0, _EXACT_POWER)]
        found /= _POWERS[np.clip(-power, 0, _EXACT_POWER)]
    unsure = np.flatnonzero((digits > _EXACT_DIGITS) | (np.abs(power) > _EXACT_POWER))
    long = unsure[(digits[unsure] <= _MAX_DIGITS) & (power[unsure] <= 0) & (power[unsure] >= -_EXACT_POWER)]
    if not len(long):
        return found, unsure
    is_sure = np.zeros(len(found), dtype=np.bool_)
    found[long], is_sure[long] = _quotient(mantissa[long], _POWERS[-power[long]])
    return found, unsure[~is_sure[unsure]]


def _quotient(mantissa: Words, divisor: Floats) -> tuple[Floats, Bools]:
    """Quotients of whole numbers below 10^19, and whether they are surely rounded correctly.

    The remainder of the first division, computed exactly (Dekker's product), gives the second half of the quotient.
    """
    high = mantissa.astype(np.float64)
    low = (mantissa - high.astype(np.uint64)).view(np.int64).astype(np.float64)
    first = high / divisor
    product = first * divisor
    first_high, divisor_high = _upper_half(first), _upper_half(divisor)
    first_low, divisor_low = first - first_high, divisor - divisor_high
    error = first_high * divisor_high - product + first_high * divisor_low + first_low * divisor_high
    error += first_low * divisor_low
    second = ((high - product) - error + low) / divisor
    found = first + second
    doubt = second * _DOUBT
    return found, (first + (second - doubt) == found) & (first + (second + doubt) == found)


def _upper_half(values: Floats) -> Floats:
    """The upper half of the bits of each value (Veltkamp)."""
    scaled = values * _SPLIT
    return np.asarray(scaled - (scaled - values))
