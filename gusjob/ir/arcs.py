"""Arcs as they were drawn: circles in mm or in pulses; what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Rule
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import Op, Path
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import CLOSES_MM, Arcs, Ends, arcs_by_either


class DrawnArcs(Struct, frozen=True, kw_only=True, eq=False):
    """Arcs as the circles that were written, (k,) each: in mm, or in pulses where the axes differ and these were used.

    `ends`: their unrounded ends. `by_radius`: given by their radius, which is `written`; the others by their centre.
    `mm_x`, `mm_y`: mm of a unit along each axis. They are 1 in mm.
    """

    arcs: Arcs
    ends: Ends
    by_radius: Bools
    written: Floats
    mm_x: Floats
    mm_y: Floats

    @property
    def mm(self) -> Floats:
        """Length in mm of a unit, (k,); where the axes differ, the largest."""
        return np.maximum(self.mm_x, self.mm_y)

    @property
    def to_end_mm(self) -> Floats:
        """Distance of each end from its centre, (k,)."""
        return np.asarray(np.hypot(self.ends[2] - self.arcs.cx, self.ends[3] - self.arcs.cy) * self.mm)

    def in_mm(self) -> Arcs:
        """Return the arcs in mm; where the axes differ, circles in pulses by their largest unit."""
        mm, arcs = self.mm, self.arcs
        return replace(arcs, cx=arcs.cx * mm, cy=arcs.cy * mm, radius=arcs.radius * mm)

    def extent_mm(self) -> tuple[Floats, Floats, Floats, Floats]:
        """Compute the bounding boxes: x low, x high, y low, y high, (k,) mm each."""
        x_low, x_high, y_low, y_high = self.arcs.extent()
        return x_low * self.mm_x, x_high * self.mm_x, y_low * self.mm_y, y_high * self.mm_y


def drawn_arcs(path: Path, rows: Indices, machine: Machine) -> DrawnArcs:
    """Compute the arcs at some rows as they were drawn, from their unrounded ends."""
    px, py = machine.pulses_per_mm
    in_mm = path.arc_in_mm[rows] | machine.equal_axes
    unit_x, unit_y = np.where(in_mm, px, 1.0), np.where(in_mm, py, 1.0)
    x0, y0, x1, y1 = path.ends(rows)
    ends = (x0 / unit_x, y0 / unit_y, x1 / unit_x, y1 / unit_y)
    cx, cy, radius = path.cx[rows] / unit_x, path.cy[rows] / unit_y, path.radius[rows] / unit_x
    by_radius = path.op[rows] == Op.ARC_RADIUS
    arcs = arcs_by_either(ends, cx, cy, radius, path.ccw[rows], by_radius)
    return DrawnArcs(arcs=arcs, ends=ends, by_radius=by_radius, written=radius, mm_x=unit_x / px, mm_y=unit_y / py)


def arc_faults(drawn: DrawnArcs) -> Iterator[tuple[Rule, Bools, str, dict[str, Any]]]:
    """Find arcs that are none: the end of an arc lies on its circle, and a radius reaches its end.

    Yields:
        A rule, which arcs break it, (k,), the word, and the fields: one entry an arc, or one for all.
    """
    start, end = drawn.arcs.radius * drawn.mm, drawn.to_end_mm
    by_centre = ~drawn.by_radius
    yield _bad(by_centre & (start == 0), Phrase("the centre I J is the start point: the radius is 0"))
    differ = by_centre & (start > 0) & (np.abs(start - end) > CLOSES_MM)
    yield rules.ARC_RADII_DIFFER, differ, "", {"end": end, "start": start, "limit": CLOSES_MM}
    x0, y0, x1, y1 = drawn.ends
    chord, radius = np.hypot(x1 - x0, y1 - y0) * drawn.mm, np.abs(drawn.written) * drawn.mm
    yield _bad(drawn.by_radius & (radius == 0), Phrase("the radius R is 0"))
    yield _bad(
        drawn.by_radius & (chord == 0) & (radius > 0),
        Phrase("an arc with R that ends where it starts does not define a circle: write it with I J"),
    )
    short = drawn.by_radius & (2 * radius < chord - CLOSES_MM) & (radius > 0)
    yield rules.ARC_RADIUS_TOO_SMALL, short, "R", {"value": radius, "chord": chord, "least": chord / 2}


def _bad(where: Bools, reason: str) -> tuple[Rule, Bools, str, dict[str, Any]]:
    return rules.BAD_ARC, where, "", {"reason": reason}
