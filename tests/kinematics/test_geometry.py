"""Arcs against circles that can be drawn by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gusjob.kinematics.geometry import NO_ARCS, arcs_by_centre, arcs_by_radius, segments


def a(*values: float) -> np.ndarray:
    return np.array(values)


YES, NO = np.array([True]), np.array([False])


def test_quarter_half_and_full_circles() -> None:
    quarter = arcs_by_centre(a(10.0), a(0.0), a(0.0), a(10.0), a(0.0), a(0.0), YES)
    assert quarter.length == pytest.approx([5 * math.pi])
    other_way = arcs_by_centre(a(10.0), a(0.0), a(0.0), a(10.0), a(0.0), a(0.0), NO)
    assert other_way.length == pytest.approx([15 * math.pi])
    assert other_way.sweep[0] < 0
    full = arcs_by_centre(a(10.0), a(0.0), a(10.0), a(0.0), a(0.0), a(0.0), NO)
    assert full.length == pytest.approx([20 * math.pi])


def test_radius_form_takes_the_short_and_the_long_way() -> None:
    # From (0,0) to (10,10) with R 10: the centre is (0,10) or (10,0).
    short = arcs_by_radius(a(0.0), a(0.0), a(10.0), a(10.0), a(10.0), YES)
    assert (short.cx[0], short.cy[0]) == pytest.approx((0, 10), abs=1e-12)
    assert short.length == pytest.approx([5 * math.pi])
    long = arcs_by_radius(a(0.0), a(0.0), a(10.0), a(10.0), a(-10.0), YES)
    assert (long.cx[0], long.cy[0]) == pytest.approx((10, 0), abs=1e-12)
    assert long.length == pytest.approx([15 * math.pi])
    clockwise = arcs_by_radius(a(0.0), a(0.0), a(10.0), a(10.0), a(10.0), NO)
    assert (clockwise.cx[0], clockwise.cy[0]) == pytest.approx((10, 0), abs=1e-12)


def test_directions_are_tangents() -> None:
    quarter = arcs_by_centre(a(10.0), a(0.0), a(0.0), a(10.0), a(0.0), a(0.0), YES)
    assert np.hstack(quarter.direction(0.0)) == pytest.approx([0, 1], abs=1e-12)
    assert np.hstack(quarter.direction(1.0)) == pytest.approx([-1, 0], abs=1e-12)


@pytest.mark.parametrize("seed", range(30))
def test_extent_holds_every_point_and_no_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = (rng.uniform(-5, 5, 50) for _ in range(4))
    radius = np.hypot(x1 - x0, y1 - y0) * rng.uniform(0.5, 3, 50) * rng.choice([-1, 1], 50)
    arcs = arcs_by_radius(x0, y0, x1, y1, radius, rng.uniform(0, 1, 50) < 0.5)
    x_low, x_high, y_low, y_high = arcs.extent()
    points = [arcs.at(np.full(50, share)) for share in np.linspace(0, 1, 2001)]
    x, y = np.array([p[0] for p in points]), np.array([p[1] for p in points])
    for found, drawn in ((x_low, x.min(0)), (x_high, x.max(0)), (y_low, y.min(0)), (y_high, y.max(0))):
        assert found == pytest.approx(drawn, abs=1e-4 * np.abs(radius).max())


def test_a_segment_of_no_length_has_the_direction_before_it() -> None:
    found = segments(a(0, 10, 10), a(0, 0, 0), a(10, 10, 10), a(0, 0, 10), np.empty(0, dtype=np.intp), NO_ARCS)
    assert found.length.tolist() == [10, 0, 10]
    x, y = found.start_direction(np.arange(3))
    assert (x[1], y[1]) == (1, 0)
    assert (x[2], y[2]) == (0, 1)
