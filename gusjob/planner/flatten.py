"""Pass: an arc that is a circle in mm but no circle in pulses becomes lines within the profile's chord tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gusjob.ir.path import Op, arcs_mm, with_chords
from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends
from gusjob.planner.plan import Plan


def flatten(state: Plan) -> Plan:
    """Nothing to do where X and Y have the same pulses per mm."""
    path, machine = state.path, state.machine
    arcs = (path.op == Op.ARC_CENTRE) | (path.op == Op.ARC_RADIUS)
    at = np.flatnonzero(arcs & path.arc_in_mm)
    if machine.equal_axes or not len(at):
        return state
    shapes = arcs_mm(path, at, machine)
    pieces = chord_counts(shapes.sweep, chord_angles(shapes.radius, machine.chord_tolerance_um / 1000))
    x_mm, y_mm = chord_ends(shapes, pieces)
    px, py = machine.pulses_per_mm
    longer, origin = with_chords(path, at, pieces, x_mm * px, y_mm * py)
    return replace(state, path=longer, origin=origin, timed=np.flatnonzero(longer.takes_time))
