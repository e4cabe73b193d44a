"""Segment lengths in mm."""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.geometry import Segments

_ARC_NODES = 64


def segment_mm(segments: Segments, machine: Machine) -> Floats:
    """Length of each segment, (m,) mm; an arc on unequal axes is an ellipse, integrated (Gauss-Legendre)."""
    px, py = machine.pulses_per_mm
    if machine.equal_axes:
        return segments.length / px
    length = np.hypot((segments.x1 - segments.x0) / px, (segments.y1 - segments.y0) / py)
    if len(segments.arc_at):
        nodes, weights = np.polynomial.legendre.leggauss(_ARC_NODES)
        arcs = segments.arcs
        angle = arcs.angle + arcs.sweep * (nodes[:, None] + 1) / 2
        speed = arcs.radius * np.hypot(np.sin(angle) / px, np.cos(angle) / py)
        length[segments.arc_at] = np.abs(arcs.sweep) / 2 * (weights @ speed)
    return length


def mm_per_pulse(segments: Segments, machine: Machine) -> Floats:
    """Millimetres per pulse along each segment, (m,); on unequal axes an arc's mean."""
    scale = np.full(len(segments.length), 1 / machine.pulses_per_mm[0])
    np.divide(segment_mm(segments, machine), segments.length, out=scale, where=segments.length > 0)
    return scale
