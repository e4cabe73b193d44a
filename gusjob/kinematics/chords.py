"""Chords: straight lines in place of an arc."""

from __future__ import annotations

import numpy as np

from gusjob.kinematics.arrays import Floats, Indices, counted
from gusjob.kinematics.geometry import Arcs


def chord_angles(radius: Floats, tolerance: Floats | float) -> Floats:
    """Compute the largest angle of a chord that stays within a tolerance of its circle, (n,) rad; one unit for both.

    A chord of angle a leaves its circle by r*(1 - cos(a/2)).
    """
    reach = np.clip(1 - tolerance / np.maximum(radius, 1e-12), -1, 1)
    return np.asarray(2 * np.arccos(reach))


def chord_counts(sweep_rad: Floats, angle_rad: Floats | float) -> Indices:
    """Count the equal chords of each arc that turn by at most an angle, at least one, (n,)."""
    return np.maximum(np.ceil(np.abs(sweep_rad) / angle_rad), 1).astype(np.intp)


def first_beyond(counts: Indices, most: int) -> int | None:
    """Find the first arc up to which all chords are more than `most`; None if there is none."""
    sums = np.cumsum(counts)
    return int(np.searchsorted(sums, most, side="right")) if len(sums) and sums[-1] > most else None


def chord_ends(arcs: Arcs, counts: Indices) -> tuple[Floats, Floats]:
    """Compute the end points of all chords in order: x and y, (sum of counts,) each."""
    which, number = counted(counts)
    return arcs.pick(which).at((number + 1) / counts[which])
