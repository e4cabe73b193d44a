"""Pass: arcs that the controller can't do become chords within the profile's tolerance.

These are circles in mm that are none in pulses, and arcs that no call keeps in whole pulses.
"""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.job import Job
from gusjob.ir.path import Path, with_chords
from gusjob.kinematics.arrays import Indices
from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends
from gusjob.planner.fit_arcs import fit_arcs


def flatten(job: Job, machine: Machine) -> tuple[Path, Indices]:
    """Replace arcs that the controller has no call for by chords, and choose the form of the others.

    Returns:
        The path, and for each of its rows the row of the job's path, (n,).
    """
    path, origin = _circles_in_mm(job.path, machine)
    fitted, fitted_origin = fit_arcs(path, machine)
    return fitted, fitted_origin if path is job.path else origin[fitted_origin]


def _circles_in_mm(path: Path, machine: Machine) -> tuple[Path, Indices]:
    """Replace circles in mm by chords. Where X and Y have the same pulses per mm, they are circles in pulses, too."""
    rows = np.flatnonzero(path.is_arc & path.arc_in_mm)
    if machine.equal_axes or not len(rows):
        return path, np.arange(len(path))
    arcs = drawn_arcs(path, rows, machine).arcs
    counts = chord_counts(arcs.sweep, chord_angles(arcs.radius, machine.chord_tolerance_um / 1000))
    x_mm, y_mm = chord_ends(arcs, counts)
    px, py = machine.pulses_per_mm
    return with_chords(path, rows, counts, x_mm * px, y_mm * py)
