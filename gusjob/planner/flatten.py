"""Pass: an arc that is a circle in mm but no circle in pulses becomes lines within the profile's chord tolerance."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.geometry import Arcs
from gusjob.job import Op, Path, arcs_mm
from gusjob.planner.plan import Plan


def flatten(state: Plan) -> Plan:
    """Nothing to do where X and Y have the same pulses per mm."""
    path, machine = state.path, state.machine
    arcs = (path.op == Op.ARC_CENTRE) | (path.op == Op.ARC_RADIUS)
    at = np.flatnonzero(arcs & path.arc_in_mm)
    if machine.equal_axes or not len(at):
        return state
    shapes = arcs_mm(path, at, machine)
    tolerance_mm = machine.chord_tolerance_um / 1000
    # A chord of angle a leaves its circle by r*(1 - cos(a/2)).
    reach = np.clip(1 - tolerance_mm / np.maximum(shapes.radius, 1e-12), -1, 1)
    pieces = np.maximum(np.ceil(np.abs(shapes.sweep) / (2 * np.arccos(reach))), 1).astype(np.intp)
    counts = np.ones(len(path), dtype=np.intp)
    counts[at] = pieces
    origin = np.repeat(np.arange(len(path)), counts)
    ends = np.cumsum(counts)
    step = np.arange(len(origin)) - (ends - counts)[origin] + 1

    columns: dict[str, npt.NDArray[Any]] = {f.name: getattr(path, f.name)[origin] for f in fields(Path)}
    number = np.full(len(path), -1)
    number[at] = np.arange(len(at))
    new = np.flatnonzero(number[origin] >= 0)
    which = number[origin[new]]
    share = step[new] / pieces[which]
    picked = Arcs(**{f.name: getattr(shapes, f.name)[which] for f in fields(Arcs)})
    x_mm, y_mm = picked.at(share)
    last = share == 1
    columns["x"][new] = np.where(last, columns["x"][new], x_mm * machine.pulses_per_mm[0])
    columns["y"][new] = np.where(last, columns["y"][new], y_mm * machine.pulses_per_mm[1])
    columns["end"][new] = np.where(last, columns["end"][new], np.nan)
    columns["op"][new] = Op.LINE
    longer = Path(**columns)
    return replace(state, path=longer, origin=origin, timed=np.flatnonzero(longer.takes_time))
