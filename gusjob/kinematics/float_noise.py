"""Numbers without float noise: what an expression or a unit conversion means is what is compared and sent.

In floats 0.1*3*500 is 150.00000000000003. A number that is within FLOAT_NOISE of a short one is the short one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # The machine profile needs one number, but no arrays: start-up time is part of the tool.
    from gusjob.kinematics.arrays import Floats

FLOAT_NOISE = 1e-12
"""Largest error of a number by float arithmetic, as a share of it; next to 0 the error itself."""
SHORT_DIGITS = 7
"""A short number has at most so many digits, or it is whole."""
_LARGEST_POWER = 22
"""Largest power of ten that is exact in a float."""


def settled(values: Floats, limit: float | None = None) -> Floats:
    """Replace numbers that are within float noise of a short number by it.

    Args:
        values: Numbers, (n,), NaN where absent.
        limit: A number of the machine profile that counts as short.
    """
    import numpy as np

    from gusjob.kinematics.arrays import blocks

    if len(values) and values.strides == (0,):  # A column with one value takes no memory, and stays so.
        return np.broadcast_to(settled(values[:1].copy(), limit)[0], len(values))
    found = values  # Copied only where a number changes.
    for part in blocks(len(values)):
        own = _settled(values[part], limit)
        if own is not None:
            found = values.copy() if found is values else found
            found[part] = own
    return found


def _settled(values: Floats, limit: float | None) -> Floats | None:
    """Replace numbers as `settled` does; None if all of them stay."""
    import numpy as np

    whole = np.rint(values)
    at = np.flatnonzero((values != whole) & np.isfinite(values))
    if not len(at):
        return None
    number, short = values[at], whole[at]
    powers = np.array([float(f"1e{k}") for k in range(_LARGEST_POWER + 1)])
    shift = (SHORT_DIGITS - 1 - np.floor(np.log10(np.abs(number)))).astype(np.int64)
    power = powers[np.minimum(np.abs(shift), _LARGEST_POWER)]
    decimal = np.where(shift >= 0, np.rint(number * power) / power, short)
    noise = FLOAT_NOISE * np.abs(number)
    result = np.where(np.abs(decimal - number) <= noise, decimal, number)
    result = np.where(np.abs(short - number) <= noise, short, result)
    if limit is not None:
        result = np.where(np.abs(limit - number) <= noise, limit, result)
    result = np.where(np.abs(number) < FLOAT_NOISE, 0.0, result)
    if (result == number).all():
        return None
    found = values.copy()
    found[at] = result
    return found


def settled_one(value: float) -> float:
    """Replace one number that is within float noise of a short number by it."""
    if not math.isfinite(value):
        return value
    if abs(value) < FLOAT_NOISE:
        return 0.0
    noise = FLOAT_NOISE * abs(value)
    for short in (float(round(value)), float(f"{value:.{SHORT_DIGITS - 1}e}")):
        if abs(short - value) <= noise:
            return short
    return value


def exceeds(values: Floats | float, limit: Floats | float) -> Any:
    """Whether numbers are above a limit by more than float noise."""
    import numpy as np

    return values > limit + FLOAT_NOISE * np.abs(limit)
