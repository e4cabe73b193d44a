"""Schedules: stages at rest, dwells, ends that can't be reached."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.kinematics.schedule import Schedule, schedule


def schedule_of(length: list[float], vel_end: list[float], dwell_ms: list[float], stage_first: list[int]) -> Schedule:
    """Segments at 100 pulse/ms and 10 pulse/ms2; a dwell has a time above 0."""
    dwell = np.array(dwell_ms) > 0
    return schedule(
        length=np.array(length),
        vel=np.full(len(length), 100.0),
        acc=np.full(len(length), 10.0),
        vel_end=np.array(vel_end),
        dwell=dwell,
        dwell_ms=np.array(dwell_ms),
        stage_first=np.array([*stage_first, len(length)]),
    )


def test_two_segments_and_a_dwell() -> None:
    """1000 pulse are 10 ms at speed; up and down take 10 ms and 500 pulse each."""
    found = schedule_of([1000.0, 1000.0, 0.0], [100.0, 0.0, 0.0], [0, 0, 7], [0])
    assert found.duration_ms == pytest.approx([15, 15, 7])
    assert found.times_ms == pytest.approx([0, 15, 30, 37])
    risen, falls = found.phases()
    assert risen == pytest.approx([10, 15, 30])
    assert falls == pytest.approx([15, 20, 30])


def test_each_stage_starts_at_rest() -> None:
    found = schedule_of([2000.0, 2000.0], [100.0, 0.0], [0, 0], [0, 1])
    assert found.profile.start.tolist() == [0, 0]
    assert found.stage_start() == pytest.approx([0, 25])
    assert found.stage_end() == pytest.approx([25, 55])
    assert found.segment_at(np.array([0, 0, 1]), np.array([3.0, 99.0, 30.0])).tolist() == [0, 0, 1]


def test_an_end_that_cant_be_reached_is_the_nearest_one() -> None:
    """From rest over 20 pulse at 10 pulse/ms2: 20 pulse/ms."""
    found = schedule_of([20.0, 2000.0], [100.0, 0.0], [0, 0], [0])
    assert found.profile.end == pytest.approx([20, 0])
    assert found.profile.start == pytest.approx([0, 20])
