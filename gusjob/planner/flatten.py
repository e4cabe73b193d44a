"""Pass: arcs that the controller can't do become chords within the profile's tolerance.

These are circles in mm that are none in pulses, and arcs that no call keeps in whole pulses. The plan still knows that
they are arcs: their chords have no corners (quantize.py).
"""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.job import Job
from gusjob.ir.path import Path, with_chords
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends, first_beyond
from gusjob.planner.fit_arcs import fit_arcs

_SMOOTH_PULSE = 0.1
"""Largest height of an arc over its chord: the corners between such chords are smaller than those that rounding makes.

With the radius r the height of a chord c is c^2/(8*r), and its corners turn by c/r: here by 0.8/c. Rounding turns each
chord by up to sqrt(2)/c.
"""
_SHORT_PULSE, _HIGH_PULSE = 2.0, 1.0
"""On small circles: length of the shortest chords, and their largest height."""


class ChordLimitError(ValueError):
    """Arcs would become more chords than the profile allows. `row`: the first row of the job's path that is beyond."""

    def __init__(self, row: int, count: int, limit: int) -> None:
        super().__init__(f"{count} chords")
        self.row, self.count, self.limit = row, count, limit


def flatten(job: Job, machine: Machine) -> tuple[Path, Indices]:
    """Replace arcs that the controller has no call for by chords, and choose the form of the others.

    Returns:
        The path, and for each of its rows the row of the job's path, (n,).

    Raises:
        ChordLimitError: There would be more chords than the profile allows.
    """
    path, origin = _circles_in_mm(job.path, machine)
    path, bent, arcs = fit_arcs(path)
    if not len(bent):
        return path, origin
    counts = _limited(chord_counts(arcs.sweep, _smooth_angles(arcs.radius)), origin[bent], machine)
    path, fitted_origin = with_chords(path, bent, counts, *chord_ends(arcs, counts))
    return path, origin[fitted_origin]


def _circles_in_mm(path: Path, machine: Machine) -> tuple[Path, Indices]:
    """Replace circles in mm by chords. Where X and Y have the same pulses per mm, they are circles in pulses, too."""
    rows = np.flatnonzero(path.is_arc & path.arc_in_mm)
    if machine.equal_axes or not len(rows):
        return path, np.arange(len(path))
    arcs, (px, py) = drawn_arcs(path, rows, machine).arcs, machine.pulses_per_mm
    angles = chord_angles(arcs.radius, machine.chord_tolerance_um / 1000)
    smooth = np.minimum(angles, _smooth_angles(arcs.radius * max(px, py)))
    counts = _limited(chord_counts(arcs.sweep, smooth), rows, machine)
    x_mm, y_mm = chord_ends(arcs, counts)
    return with_chords(path, rows, counts, x_mm * px, y_mm * py)


def _limited(counts: Indices, rows: Indices, machine: Machine) -> Indices:
    """Return the numbers of chords of some rows of the job's path, if they are not too many."""
    over = first_beyond(counts, machine.most_chords)
    if over is not None:
        raise ChordLimitError(int(rows[over]), int(counts[: over + 1].sum()), machine.most_chords)
    return counts


def _smooth_angles(radius_pulse: Floats) -> Floats:
    """Compute the angle of chords that have no corners in whole pulses, (n,) rad; they are not shorter than needed."""
    with np.errstate(divide="ignore"):
        height_pulse = np.clip(_SHORT_PULSE**2 / (8 * radius_pulse), _SMOOTH_PULSE, _HIGH_PULSE)
    return chord_angles(radius_pulse, height_pulse)
