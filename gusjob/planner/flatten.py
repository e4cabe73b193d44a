"""Pass: an arc that is a circle in mm but not in pulses becomes chords within the profile's tolerance."""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.job import Job
from gusjob.ir.path import Path, with_chords
from gusjob.kinematics.arrays import Indices
from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends


def flatten(job: Job, machine: Machine) -> tuple[Path, Indices]:
    """Replace arcs that the controller has no call for by chords.

    Where X and Y have the same pulses per mm there are none.

    Returns:
        The path, and for each of its rows the row of the job's path, (n,).
    """
    path = job.path
    rows = np.flatnonzero(path.is_arc & path.arc_in_mm)
    if machine.equal_axes or not len(rows):
        return path, np.arange(len(path))
    arcs = drawn_arcs(path, rows, machine).arcs
    counts = chord_counts(arcs.sweep, chord_angles(arcs.radius, machine.chord_tolerance_um / 1000))
    x_mm, y_mm = chord_ends(arcs, counts)
    px, py = machine.pulses_per_mm
    return with_chords(path, rows, counts, x_mm * px, y_mm * py)
