"""Mark quality: position of the beam when the emission starts and ends, and how even the energy is in between.

A mark is one emission interval of one channel. Its intended path is from S to E (mark_ends.py).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Bools, Floats, Indices, median
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.quality.beam_path import BeamPath, beam_path_of
from gusjob.simulate.quality.corners import Corners, corners_of, largest_misses
from gusjob.simulate.quality.energy_bins import EnergyBins, energy_bins
from gusjob.simulate.quality.mark_ends import MarkEnds, MarkPoints, mark_ends_of, mark_lines

_MarkTable = dict[str, npt.NDArray[Any]]

MARKING_WORDS = {
    "on_error_um": Phrase("on error"),
    "off_error_um": Phrase("off error"),
    "on_miss_um": Phrase("on miss"),
    "off_miss_um": Phrase("off miss"),
    "outside_power_ms": Phrase("outside"),
    "power_per_mm_mid": Phrase("middle"),
    "power_per_mm_peak": Phrase("peak"),
    "power_per_mm_rms_pct": Phrase("rms"),
    "corner_miss_um": Phrase("corner miss"),
}
"""The columns of mark quality with their display names; the totals hold worst and typical of each."""

_ROUNDING = 1e-6
"""In um and in %: smaller values are shown as 0."""


def marks_of(trace: Trace, machine: Machine) -> _MarkTable:
    """Make a table with a row a mark, channel by channel in time order; power in the mode's unit.

    Without a channel it has no columns.
    """
    corners = corners_of(trace, machine)
    found = [_channel_marks(trace, machine, channel, corners) for channel in trace.channels]
    return {name: np.concatenate([columns[name] for columns in found]) for name in (found[0] if found else ())}


def marking_totals(trace: Trace, marks: _MarkTable) -> list[dict[str, Any]]:
    """Compute number of marks, worst (largest magnitude) and typical (median magnitude) by channel and power unit."""
    totals, done = [], 0
    for channel in trace.channels:
        count = len(channel.emission.stage)
        mine = {name: marks[name][done : done + count] for name in MARKING_WORDS}
        done += count
        units = np.array([laser.power_mode.unit for laser in channel.lasers])
        for unit in dict.fromkeys(units[channel.emission.stage].tolist() if count else ()):
            at = units[channel.emission.stage] == unit
            figures = {name: column[at][~np.isnan(column[at])] for name, column in mine.items()}
            totals.append(
                {
                    "channel": channel.channel,
                    "unit": unit,
                    "marks": int(at.sum()),
                    "worst": {name: _worst(values) for name, values in figures.items()},
                    "typical": {name: median(np.abs(v)) if len(v) else None for name, v in figures.items()},
                }
            )
    return totals


def marking_unit(name: str, unit: str) -> str:
    """Unit of a column of mark quality, for power in `unit`."""
    if name.startswith("power_per_mm"):
        return "%" if name.endswith("pct") else f"{unit}·ms/mm"
    return f"{unit}·ms" if name == "outside_power_ms" else "um"


def _worst(values: Floats) -> float | None:
    return float(values[np.argmax(np.abs(values))]) if len(values) else None


def _channel_marks(trace: Trace, machine: Machine, channel: ChannelTrace, corners: Corners) -> _MarkTable:
    intervals = channel.emission.intervals
    ends = mark_ends_of(trace, machine, channel)
    path = beam_path_of(trace, machine, intervals)
    on_error, on_miss = _errors(trace, machine, intervals.stage, intervals.start_ms, ends.start)
    off_error, off_miss = _errors(trace, machine, intervals.stage, intervals.end_ms, ends.end)
    mid, peak, rms = _per_mm(energy_bins(machine, channel, path, intervals))
    return {
        "line": mark_lines(trace, intervals.stage, ends.start_segment),
        "channel": np.full(len(intervals.stage), channel.channel, dtype=np.int8),
        "start_ms": intervals.start_ms,
        "length_mm": path.mark_mm(),
        "on_error_um": on_error,
        "off_error_um": off_error,
        "on_miss_um": on_miss,
        "off_miss_um": off_miss,
        "outside_power_ms": _outside(machine, channel, path, intervals, ends),
        "power_per_mm_mid": mid,
        "power_per_mm_peak": peak,
        "power_per_mm_rms_pct": rms,
        "corner_miss_um": largest_misses(trace, machine, corners, ends.first_motion, ends.last_motion),
    }


def _errors(trace: Trace, machine: Machine, stage: Indices, time: Floats, point: MarkPoints) -> tuple[Floats, Floats]:
    """Distance of the beam past a point along its direction (late: > 0), and distance from it, um."""
    off_x, off_y = _off_mm(machine, *trace.beam.position(stage, time), point)
    error, miss = off_x * point.along_x + off_y * point.along_y, np.hypot(off_x, off_y)
    return _rounded(error * US_PER_MS), _rounded(miss * US_PER_MS)


def _off_mm(machine: Machine, x: Floats, y: Floats, point: MarkPoints) -> tuple[Floats, Floats]:
    return (x - point.x) / machine.pulses_per_mm[0], (y - point.y) / machine.pulses_per_mm[1]


def _rounded(values: Floats) -> Floats:
    """Set values that are rounding only to 0."""
    return np.where(np.abs(values) < _ROUNDING, 0.0, values)


# Outside of [S, E].


def _outside(machine: Machine, channel: ChannelTrace, path: BeamPath, intervals: Intervals, ends: MarkEnds) -> Floats:
    """Power integral that is emitted before the beam first reaches S, and after it last leaves E."""
    reached, left = intervals.start_ms.copy(), intervals.end_ms.copy()
    early, share = _first_inside(machine, path, ends.start, backwards=False)
    reached[early.mark] = np.where(
        early.found, path.start[early.part] + path.length[early.part] * share, left[early.mark]
    )
    over, share = _first_inside(machine, path, ends.end, backwards=True)
    part_end = path.start[over.part] + path.length[over.part]
    left[over.mark] = np.where(over.found, part_end - path.length[over.part] * share, intervals.start_ms[over.mark])
    left = np.maximum(left, reached)
    outside = np.zeros(len(intervals.stage))
    for start, end in ((intervals.start_ms, reached), (left, intervals.end_ms)):
        at = np.flatnonzero(start < end)
        outside[at] += channel.power.integral(Intervals(stage=intervals.stage[at], start_ms=start[at], end_ms=end[at]))
    return outside


class _MarkEntries(Struct, frozen=True, kw_only=True, eq=False):
    """Marks that start (or end) outside of [S, E], and the part in which each enters it; `found`: it does."""

    mark: Indices
    part: Indices
    found: Bools


def _first_inside(
    machine: Machine, path: BeamPath, point: MarkPoints, *, backwards: bool
) -> tuple[_MarkEntries, Floats]:
    """Find where marks that start before S enter [S, E], and at which share of the part.

    `backwards`: in the opposite order of time, where marks that end beyond E enter.
    """
    tolerance = 1 / min(machine.pulses_per_mm)
    edge = path.first[1:] - 1 if backwards else path.first[:-1]
    outer = 2 if backwards else 0
    sign = -1.0 if backwards else 1.0

    def inside(node: int | slice, part: Indices, mark: Indices) -> Floats:
        at = point.pick(mark)
        off_x, off_y = _off_mm(machine, path.x[node][..., part], path.y[node][..., part], at)
        return sign * (off_x * at.along_x + off_y * at.along_y)

    mark = np.flatnonzero(inside(outer, edge, np.arange(len(edge))) < -tolerance)
    count = path.first[mark + 1] - path.first[mark]
    begins = np.cumsum(count) - count
    which = np.repeat(np.arange(len(mark)), count)
    number = np.arange(len(which)) - begins[which]
    part = path.first[mark][which] + (count[which] - 1 - number if backwards else number)
    nodes = inside(slice(None), part, mark[which])[:: -1 if backwards else 1]
    middle_in, end_in = nodes[1] >= -tolerance, nodes[2] >= -tolerance
    none = len(which)
    comes = np.where(middle_in | end_in, np.arange(none), none)
    at = np.minimum.reduceat(comes, begins) if len(mark) else comes
    found = at < none
    at = np.minimum(at, none - 1)
    level = np.minimum(np.where(middle_in, nodes[1], nodes[2])[at], 0.0)
    return _MarkEntries(mark=mark, part=part[at], found=found), _root(nodes[:, at] - level)


def _root(nodes: Floats) -> Floats:
    """First root, as share of the part, of parabolas through (3, k) values at start (< 0), middle and end."""
    slope = 4 * nodes[1] - 3 * nodes[0] - nodes[2]
    bend = 2 * (nodes[0] + nodes[2] - 2 * nodes[1])
    below = slope + np.sqrt(np.maximum(slope * slope - 4 * bend * nodes[0], 0.0))
    share = np.divide(-2 * nodes[0], below, out=np.ones_like(below), where=below > 0)
    return np.asarray(np.clip(share, 0.0, 1.0))


# Energy per mm.


def _per_mm(bins: EnergyBins) -> tuple[Floats, Floats, Floats]:
    """Compute (middle, peak, RMS deviation from the middle in %) of the power integral per mm of the path, (k,)."""
    begins, count, mark, energy = bins.first[:-1], np.diff(bins.first), bins.mark, bins.per_mm
    number, third = np.arange(len(mark)) - begins[mark], (count // 3)[mark]
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = (number >= third) & (number < count[mark] - third)
        mid = np.bincount(mark, weights=np.where(middle, energy, 0.0), minlength=len(count)) / (
            count - 2 * (count // 3)
        )
        peak = np.maximum.reduceat(energy, begins) if len(mark) else np.empty(0)
        square = np.bincount(mark, weights=(energy - mid[mark]) ** 2, minlength=len(count)) / count
        rms = np.where(mid > 0, np.sqrt(square) / mid * 100, np.nan)
    return mid, peak, _rounded(rms)
