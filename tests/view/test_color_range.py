"""The range of a colour scale and its labels."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.view.color_range import color_range, label, labelled

ONES = np.ones(1000)


@pytest.mark.parametrize(
    ("value", "length", "wanted"),
    [
        (np.arange(1000.0), ONES, (0, 999, 0, 999)),  # No extremes: all of them.
        (
            np.append(np.arange(999.0), 1e6),
            ONES,
            (0, 979, 0, 1e6),
        ),  # One hot spot of 0.1 % does not flatten the others.
        (np.append(np.arange(2000.0, 2999.0), 3.0), ONES, (2018, 2998, 3, 2998)),
        (np.append(np.arange(999.0), 2e6), np.append(np.ones(999), 500.0), (0, 2e6, 0, 2e6)),  # A third of the length.
        (np.append(np.linspace(100, 101, 999), 109.0), ONES, (100, 109, 100, 109)),  # All are similar: none is extreme.
        (np.append(np.full(999, 7.0), 1e6), ONES, (7, 1e6, 7, 1e6)),  # The others are equal: nothing is flattened.
        (np.array([np.inf, 5.0, np.nan]), np.ones(3), (5, 5, 5, 5)),
        (np.array([5.0, 6.0]), np.zeros(2), (5, 6, 5, 6)),  # At rest.
    ],
)
def test_range(value: np.ndarray, length: np.ndarray, wanted: tuple[float, ...]) -> None:
    found = color_range(value, length)
    assert (found.low, found.high, found.least, found.most) == pytest.approx(wanted)
    assert (found.has_lower, found.has_higher) == (wanted[2] < wanted[0], wanted[3] > wanted[1])
    whole = color_range(value, length, whole=True)
    assert (whole.low, whole.high) == pytest.approx(wanted[2:])


def test_a_peak_that_is_known_from_elsewhere() -> None:
    found = color_range(np.arange(1000.0), ONES, peak=5e4)
    assert (found.high, found.most) == (979, 5e4)
    assert color_range(np.array([np.nan]), np.ones(1)).is_empty


@pytest.mark.parametrize(
    ("value", "text"), [(1693.8, "1694"), (14515.3, "14520"), (0.00123456, "0.001235"), (2000.0, "2000"), (0.0, "0")]
)
def test_labels_have_four_digits(value: float, text: str) -> None:
    assert label(value) == text


@pytest.mark.parametrize(
    ("low", "high", "between", "wanted"),
    [
        (2000.1, 2000.3, (2000.2,), ["2000"]),
        (1999.0, 2002.0, (1999.5, 2000, 2000.5, 2001), ["1999", "2000", "2001", "2002"]),
        (0.0, 10.0, (2, 4, 6, 8), ["0", "2", "4", "6", "8", "10"]),
        (0.0, 10.0, (5, 5.0004), ["0", "5", "10"]),
    ],
)
def test_labels_differ_and_are_true(low: float, high: float, between: tuple[float, ...], wanted: list[str]) -> None:
    assert [label(tick) for tick in labelled(low, high, between)] == wanted
