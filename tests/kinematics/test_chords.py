"""Chords: within their tolerance, as few as possible, from point to point of the arc."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends
from gusjob.kinematics.geometry import arcs_by_centre


@pytest.mark.parametrize("radius_mm", [0.1, 5.0, 80.0])
@pytest.mark.parametrize("tolerance_mm", [1e-4, 1e-2])
def test_a_chord_leaves_its_circle_by_the_tolerance(radius_mm: float, tolerance_mm: float) -> None:
    angle = chord_angles(np.array([radius_mm]), tolerance_mm)
    assert radius_mm * (1 - np.cos(angle / 2)) == pytest.approx([tolerance_mm], rel=1e-6)


def test_a_tolerance_above_the_radius_allows_one_chord() -> None:
    angle = chord_angles(np.array([1e-3, 0.0]), 1.0)
    assert chord_counts(np.array([2 * np.pi, np.pi]), angle).tolist() == [1, 1]


def test_counts_are_the_fewest() -> None:
    assert chord_counts(np.array([1.0, -1.0, 1.01, 0.0]), 0.5).tolist() == [2, 2, 3, 1]


def test_ends_lie_on_the_arc_in_order() -> None:
    one = np.array([1.0])
    arcs = arcs_by_centre(one, 0 * one, 0 * one, one, 0 * one, 0 * one, np.array([True]))
    x, y = chord_ends(arcs, np.array([3]))
    angles = np.pi / 6 * np.arange(1, 4)
    assert x == pytest.approx(np.cos(angles))
    assert y == pytest.approx(np.sin(angles))
