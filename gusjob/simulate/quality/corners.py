"""Corner miss: distance at which the beam passes the corners of the path."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine, ScannerModel
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import Trace

_FLAT = 2 * np.sin(np.radians(1.0) / 2)
"""A smaller change of the unit direction is no corner."""

_IN_LAG = np.array([0, 0.25, 0.5, 0.75, 1, 1.25, 1.5, 1.75, 2, 2.5, 3, 4, 5, 6, 8])
"""Moments of the first search for the nearest one, in lags after the corner's own moment."""
_FINER = np.linspace(0.0, 1.0, 9)
_BLOCK = 1 << 13


class Corners(Struct, frozen=True, kw_only=True, eq=False):
    """The path's corners in order, (c,): number of the motion that ends there, and of the one that starts there."""

    before: Indices
    after: Indices


def corners_of(trace: Trace, machine: Machine) -> Corners:
    """Find where the path turns by more than a degree within a stage, and by more than rounding to pulses explains."""
    schedule, segments = trace.schedule, trace.segments
    moves = np.flatnonzero(segments.length > 0)
    before, after = moves[:-1], moves[1:]
    out_x, out_y = unit_mm(*segments.end_direction(before), machine)
    in_x, in_y = unit_mm(*segments.start_direction(after), machine)
    px, py = machine.pulses_per_mm
    shift_pulse = np.hypot(1 / px, 1 / py) * max(px, py)  # Of one end of a segment against the other.
    rounding = shift_pulse / segments.length[before] + shift_pulse / segments.length[after]
    turns = np.hypot(in_x - out_x, in_y - out_y) > _FLAT + rounding
    turns &= schedule.stage[before] == schedule.stage[after]
    return Corners(before=before[turns], after=after[turns])


def unit_mm(along_x: Floats, along_y: Floats, machine: Machine) -> tuple[Floats, Floats]:
    """Turn directions in pulses into unit directions in mm; 0, 0 stays."""
    x, y = along_x / machine.pulses_per_mm[0], along_y / machine.pulses_per_mm[1]
    size = np.hypot(x, y)
    size = np.where(size > 0, size, 1.0)
    return x / size, y / size


def largest_misses(trace: Trace, machine: Machine, corners: Corners, first: Indices, last: Indices) -> Floats:
    """Largest miss at the corners from motion `first` to motion `last` of each mark, (k,) um; NaN without a corner."""
    low, high = np.searchsorted(corners.before, first), np.searchsorted(corners.before, last)
    cornered = np.flatnonzero(low < high)
    found = np.full(len(first), np.nan)
    if not len(cornered):
        return found
    used = np.zeros(len(corners.before) + 1, dtype=np.intp)
    np.add.at(used, low[cornered], 1)
    np.add.at(used, high[cornered], -1)
    seen = np.flatnonzero(np.cumsum(used)[:-1])
    misses = np.zeros(len(corners.before) + 1)
    scanner = machine.scanner
    # The command, and a beam that is only delayed, pass through every corner.
    if scanner is not None and scanner.model is not ScannerModel.DELAY:
        lag = scanner.tracking_error_us / US_PER_MS
        parts = [seen[a : a + _BLOCK] for a in range(0, len(seen), _BLOCK)]
        misses[seen] = np.concatenate([_misses(trace, machine, corners.after[part], lag) for part in parts])
    bounds = np.stack([low[cornered], high[cornered]], axis=1).ravel()
    found[cornered] = np.maximum.reduceat(misses, bounds)[::2] * 1e3
    return found


def _misses(trace: Trace, machine: Machine, after: Indices, lag: float) -> Floats:
    """Least distance of a lagging beam to the corners at which motions `after` start, mm."""
    leaves = trace.schedule.times_ms[after]
    time = leaves[:, None] + lag * _IN_LAG
    for _ in range(2):
        distance = _distances(trace, machine, after, time)
        near = np.argmin(distance, axis=1)
        rows = np.arange(len(after))
        low = time[rows, np.maximum(near - 1, 0)]
        high = time[rows, np.minimum(near + 1, time.shape[1] - 1)]
        time = low[:, None] + (high - low)[:, None] * _FINER
    return np.asarray(_distances(trace, machine, after, time).min(axis=1))


def _distances(trace: Trace, machine: Machine, after: Indices, time: Floats) -> Floats:
    """Distance of the beam to corners (c,) at moments (c, t), mm."""
    segments = trace.segments
    stage = np.repeat(trace.schedule.stage[after], time.shape[1])
    x, y = trace.beam.position(stage, time.ravel())
    px, py = machine.pulses_per_mm
    off_x = (x.reshape(time.shape) - segments.x0[after][:, None]) / px
    off_y = (y.reshape(time.shape) - segments.y0[after][:, None]) / py
    return np.hypot(off_x, off_y)
