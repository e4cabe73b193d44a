"""Numbers without float noise, against exact fractions."""

from __future__ import annotations

from fractions import Fraction
from random import Random

import numpy as np
import pytest

from gusjob.kinematics.float_noise import exceeds, settled, settled_one

NOISE = Fraction(1, 10**12)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.1 * 3 * 500, 150.0),
        (0.1 * 3 * 10, 3.0),
        (0.1 + 0.2, 0.3),
        (0.3 - 0.1 * 3, 0.0),
        (sum([0.1] * 1000), 100.0),
        (65535 * (1 + 5e-13), 65535.0),
        (65535 * (1 + 3e-12), 65535 * (1 + 3e-12)),
        (1 / 3, 1 / 3),
        (1073741823.0000002, 1073741823.0),
        (1.23456789, 1.23456789),
        (-0.1 * 3 * 500, -150.0),
        (1e-30, 0.0),
    ],
)
def test_a_number_near_a_short_one_is_the_short_one(value: float, expected: float) -> None:
    assert settled_one(value) == expected
    assert settled(np.array([value]))[0] == expected


def test_random_numbers_with_noise_are_found_and_others_stay() -> None:
    rng = Random(5)
    for _ in range(3000):
        short = Fraction(rng.randrange(1, 10**7)) * Fraction(10) ** rng.randrange(-9, 1)
        share = Fraction(rng.randrange(-3000, 3000), 10**15)
        value = float(short * (1 + share))
        off = abs(Fraction(value) / short - 1)
        if short < NOISE * 2 or abs(off - NOISE) < NOISE / 1000:
            continue
        expected = float(short) if off < NOISE else value
        assert settled(np.array([value]))[0] == settled_one(value) == expected


def test_a_column_keeps_what_it_has_not() -> None:
    column = np.array([np.nan, 0.1 * 3, np.inf, 2.0])
    np.testing.assert_array_equal(settled(column), [np.nan, 0.3, np.inf, 2.0])
    everywhere = settled(np.broadcast_to(np.float64(0.1 * 3), 5))
    assert everywhere.strides == (0,)
    assert everywhere[4] == 0.3


def test_a_limit_of_the_machine_counts_as_short() -> None:
    limit = 1234.56789012
    assert settled(np.array([limit * (1 + 4e-13)]), limit)[0] == limit
    assert not exceeds(limit * (1 + 4e-13), limit)
    assert exceeds(limit * (1 + 4e-12), limit)
