"""Trapezoids and look-ahead against closed forms and plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gusjob.kinematics.arrays import running_sum
from gusjob.kinematics.trapezoids import (
    corner_velocity,
    even_velocity,
    look_ahead,
    reached_ends,
    time_of_run,
    trapezoids,
)

A = np.array


def one(length: float, start: float, vel: float, end: float, acc: float) -> tuple[float, float, float, float]:
    t = trapezoids(A([length]), A([start]), A([vel]), A([end]), A([acc]))
    return float(t.rise_ms[0]), float(t.cruise_ms[0]), float(t.fall_ms[0]), float(t.peak[0])


def test_trapezoid_with_a_cruise() -> None:
    # 50 pulse/ms at 2 pulse/ms2: 25 ms and 625 pulse up and down; 98750 pulse at 50 are 1975 ms.
    assert one(100_000, 0, 50, 0, 2) == pytest.approx((25, 1975, 25, 50), rel=1e-15)


def test_triangle() -> None:
    # 100 pulse: v^2 = a*L = 200.
    peak = math.sqrt(200)
    assert one(100, 0, 50, 0, 2) == pytest.approx((peak / 2, 0, peak / 2, peak), rel=1e-14)


def test_time_of_a_length_in_every_phase() -> None:
    """100 pulse from 0 over 10 pulse/ms to 0 at 2 pulse/ms2: 25 pulse in 5 ms up, 5 ms level, 5 ms down.

    40 pulse from 10 over 5 to 5 pulse/ms at 5 pulse/ms2: 7.5 pulse in 1 ms down, then 6.5 ms at 5 pulse/ms.
    """
    t = trapezoids(A([100.0, 40.0]), A([0.0, 10.0]), A([10.0, 5.0]), A([0.0, 5.0]), A([2.0, 5.0]))
    run = A([0, 9, 25, 60, 75, 99, 100])
    found = time_of_run(t, np.zeros(7, dtype=np.intp), run.astype(np.float64))
    assert found == pytest.approx([0, 3, 5, 8.5, 10, 14, 15])
    found = time_of_run(t, np.ones(4, dtype=np.intp), A([0, 10 * 0.2 - 2.5 * 0.04, 7.5, 40.0]))
    assert found == pytest.approx([0, 0.2, 1, 7.5])


def test_ramps_to_and_from_other_velocities() -> None:
    # From 10 to 30 over the shortest length that allows it: (900 - 100) / 4 = 200 pulse.
    assert one(200, 10, 50, 30, 2) == pytest.approx((10, 0, 0, 30), rel=1e-12)
    assert one(200, 30, 50, 10, 2) == pytest.approx((0, 0, 10, 30), rel=1e-12)


def test_a_start_above_the_velocity_slows_down_first() -> None:
    # From 40 to 20 takes 10 ms and 300 pulse at 2 pulse/ms2; from 20 to 0 100 pulse; 600 are left at 20.
    assert one(1000, 40, 20, 0, 2) == pytest.approx((10, 30, 10, 20), rel=1e-12)


def test_no_length_takes_no_time() -> None:
    assert one(0, 0, 50, 0, 2)[:3] == (0, 0, 0)
    assert one(0, 20, 50, 20, 2)[:3] == (0, 0, 0)


@given(
    st.lists(st.tuples(st.floats(1e-3, 1e6), st.floats(1e-2, 1e3), st.floats(0.1, 1e4)), min_size=1, max_size=30),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=200)
def test_a_trapezoid_covers_its_length(rows: list[tuple[float, float, float]], seed: int) -> None:
    length, acc, vel = (A(c) for c in zip(*rows, strict=True))
    rng = np.random.default_rng(seed)
    start = rng.uniform(0, 1, len(rows)) * vel
    low, high = np.sqrt(np.maximum(start**2 - 2 * acc * length, 0)), np.sqrt(start**2 + 2 * acc * length)
    end = np.minimum(low + (high - low) * rng.uniform(0, 1, len(rows)), vel)
    t = trapezoids(length, start, vel, end, acc)
    covered = (start + t.peak) / 2 * t.rise_ms + t.peak * t.cruise_ms + (t.peak + end) / 2 * t.fall_ms
    assert covered == pytest.approx(length, rel=1e-9)


def plain_look_ahead(length: list[float], acc: list[float], limit: list[float], breaks: list[bool]) -> list[float]:
    """The textbook loop."""
    w = [v * v for v in limit]
    before = 0.0
    for i in range(len(w)):
        before = 0.0 if breaks[i] else before
        w[i] = before = min(w[i], before + 2 * acc[i] * length[i])
    for i in range(len(w) - 1, 0, -1):
        if not breaks[i]:
            w[i - 1] = min(w[i - 1], w[i] + 2 * acc[i] * length[i])
    return [math.sqrt(x) for x in w]


@pytest.mark.parametrize("seed", range(20))
def test_look_ahead_equals_the_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 20_000))
    length = np.exp(rng.uniform(-3, 10, n))
    acc = np.exp(rng.uniform(-2, 4, n))
    limit = np.exp(rng.uniform(-2, 6, n)) * (rng.uniform(0, 1, n) > 0.01)
    breaks = rng.uniform(0, 1, n) < 0.01
    breaks[0] = True
    found = look_ahead(length, acc, limit, breaks)
    plain = plain_look_ahead(length.tolist(), acc.tolist(), limit.tolist(), breaks.tolist())
    assert found == pytest.approx(plain, rel=1e-8, abs=1e-12)
    # The result can be driven: no segment needs more than length and acceleration allow.
    start = np.concatenate([[0.0], found[:-1]])
    start[breaks] = 0
    forward = ~np.append(breaks[1:], False)
    assert (np.abs(found**2 - start**2)[forward] <= (2 * acc * length)[forward] * (1 + 1e-9) + 1e-9).all()


def test_reached_ends_take_the_nearest_and_go_on_from_there() -> None:
    # 100 pulse at 2: from 0 at most 20. Then 100 pulse from 20: 0 given, 400 - 400 = 0 reached. Then 30 from 0.
    found = reached_ends(
        A([100.0, 100.0, 225.0]), A([99.0] * 3), A([50.0, 0.0, 30.0]), A([2.0] * 3), A([True, False, False])
    )
    assert found == pytest.approx([20, 0, 30], abs=1e-9)


def test_reached_ends_carry_a_miss_through_a_chain() -> None:
    # 10 pulse at 2 gain 40 each: 40, 80, 120, 160 where 60 (3600) is given each time.
    found = reached_ends(A([10.0] * 4), A([99.0] * 4), A([60.0] * 4), A([2.0] * 4), A([True, False, False, False]))
    assert found**2 == pytest.approx([40, 80, 120, 160])


def test_reached_ends_cannot_stop_in_time() -> None:
    # 30 at the end of the first; 100 pulse lose 400 of 900.
    found = reached_ends(A([1000.0, 100.0]), A([50.0, 50.0]), A([30.0, 0.0]), A([2.0, 2.0]), A([True, False]))
    assert found == pytest.approx([30, math.sqrt(500)])


def test_corner_velocity() -> None:
    # A right angle changes the vector by v*sqrt(2), going back by 2*v, going on by nothing.
    found = corner_velocity(A([math.sqrt(2), 2.0, 0.0]), A([5.0, 5.0, 5.0]), A([1e5, 1e5, 1e5]), 1000.0)
    assert found[:2] == pytest.approx([5 / math.sqrt(2), 2.5], rel=1e-15)
    assert found[2] == math.inf


def test_running_sum_is_exact_to_one_rounding() -> None:
    rng = np.random.default_rng(3)
    values = rng.uniform(0, 1, 100_001) * 10.0 ** rng.integers(-6, 4, 100_001)
    sums = running_sum(values)
    assert sums[0] == 0
    for n in (1, 17, 1000, 100_001):
        exact = math.fsum(values[:n])
        assert abs(sums[n] - exact) <= 2 * math.ulp(exact)
    assert running_sum(np.zeros(3)).tolist() == [0, 0, 0, 0]
    assert running_sum(np.empty(0)).tolist() == [0]


def test_least_time_at_constant_velocity() -> None:
    """At 1 pulse/ms2: from rest to rest, from 6 to 2 pulse/ms, one that has to stay at its start, and no least time."""
    length, start = np.array([1000.0, 100.0, 20.0, 1000.0]), np.array([0.0, 6.0, 6.0, 0.0])
    vel, end, acc = np.full(4, 50.0), np.array([0.0, 2.0, 2.0, 0.0]), np.ones(4)
    even_time = np.array([50.0, 10.0, 10.0, 0.0])
    lowered = even_velocity(length, start, vel, end, acc, even_time)
    # v*v - (start^2 + end^2)/2 + v*even_time = length: v*v + 50*v = 1000; v*v + 10*v = 120.
    assert lowered == pytest.approx([np.sqrt(1625) - 25, np.sqrt(145) - 5, 6, 50])
    found = trapezoids(length, start, lowered, end, acc)
    # The third takes 16 pulse to slow down from 6 to 2 pulse/ms: 4 pulse are left.
    assert found.cruise_ms == pytest.approx([50, 10, 4 / 6, 0])
    assert found.rise_ms == pytest.approx([lowered[0], lowered[1] - 6, 0, np.sqrt(1000)])


def test_a_segment_that_starts_too_fast_slows_down_to_its_velocity_whatever_the_least_time() -> None:
    one = np.ones(1)
    assert even_velocity(100 * one, 6 * one, 4 * one, 0 * one, one, 30 * one).tolist() == [4]
