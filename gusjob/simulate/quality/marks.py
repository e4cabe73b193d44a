"""How good each mark is: where the beam is when the light comes and goes, and how evenly it burns in between.

A mark is one emission interval of one channel: from light on to light off. It is meant to go from S to E (ends.py).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.corners import Corners, corners_of, largest_misses
from gusjob.simulate.quality.ends import Ends, Place, ends_of, mark_lines
from gusjob.simulate.quality.way import Way, way_of
from gusjob.simulate.spans import Spans

Columns = dict[str, npt.NDArray[Any]]

BIN_MM = 0.05
"""Energy per mm is taken over equal bins of at most so much of the beam's way."""

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
"""The columns that say how good a mark is, in people's words; the totals hold worst and typical of each."""

_ROUNDING = 1e-6
"""In um and in %: less is nothing."""
_BLOCK_BINS = 1 << 17


def marks_of(trace: Trace, machine: Machine) -> Columns:
    """A row a mark, channel by channel in time order; power in the mode's unit. Without a channel no columns."""
    corners = corners_of(trace, machine)
    found = [_channel_marks(trace, machine, channel, corners) for channel in trace.channels]
    return {name: np.concatenate([columns[name] for columns in found]) for name in (found[0] if found else ())}


def marking_totals(trace: Trace, marks: Columns) -> list[dict[str, Any]]:
    """Number of marks, worst (largest magnitude) and typical (median magnitude) by channel and power unit."""
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
                    "typical": {name: float(np.median(np.abs(v))) if len(v) else None for name, v in figures.items()},
                }
            )
    return totals


def marking_unit(name: str, unit: str) -> str:
    """Unit of a column that says how good a mark is, for power in `unit`."""
    if name.startswith("power_per_mm"):
        return "%" if name.endswith("pct") else f"{unit}*ms/mm"
    return f"{unit}*ms" if name == "outside_power_ms" else "um"


def _worst(values: Floats) -> float | None:
    return float(values[np.argmax(np.abs(values))]) if len(values) else None


def _channel_marks(trace: Trace, machine: Machine, channel: ChannelTrace, corners: Corners) -> Columns:
    shine = channel.emission
    spans = Spans(stage=shine.stage, start_ms=shine.start_ms, end_ms=shine.end_ms)
    ends = ends_of(trace, machine, channel)
    way = way_of(trace, machine, spans)
    on_error, on_miss = _errors(trace, machine, spans.stage, spans.start_ms, ends.begin)
    off_error, off_miss = _errors(trace, machine, spans.stage, spans.end_ms, ends.finish)
    mid, peak, rms = _per_mm(trace, machine, channel, way, spans)
    return {
        "line": mark_lines(trace, spans.stage, ends.on),
        "channel": np.full(len(shine.stage), channel.channel, dtype=np.int8),
        "start_ms": shine.start_ms,
        "length_mm": way.mark_mm(),
        "on_error_um": on_error,
        "off_error_um": off_error,
        "on_miss_um": on_miss,
        "off_miss_um": off_miss,
        "outside_power_ms": _outside(trace, machine, channel, way, spans, ends),
        "power_per_mm_mid": mid,
        "power_per_mm_peak": peak,
        "power_per_mm_rms_pct": rms,
        "corner_miss_um": largest_misses(trace, machine, corners, ends.first, ends.last),
    }


def _errors(trace: Trace, machine: Machine, stage: Indices, time: Floats, place: Place) -> tuple[Floats, Floats]:
    """How far the beam is behind a place along its direction (late: > 0), and away from it, um."""
    off_x, off_y = _off_mm(machine, *trace.beam.position(stage, time), place)
    error, miss = off_x * place.along_x + off_y * place.along_y, np.hypot(off_x, off_y)
    return _rounded(error * US_PER_MS), _rounded(miss * US_PER_MS)


def _off_mm(machine: Machine, x: Floats, y: Floats, place: Place) -> tuple[Floats, Floats]:
    return (x - place.x) / machine.pulses_per_mm[0], (y - place.y) / machine.pulses_per_mm[1]


def _rounded(values: Floats) -> Floats:
    """What is rounding only, as nothing."""
    return np.where(np.abs(values) < _ROUNDING, 0.0, values)


# Outside of [S, E].


def _outside(trace: Trace, machine: Machine, channel: ChannelTrace, way: Way, spans: Spans, ends: Ends) -> Floats:
    """Power integral emitted before the beam first comes to S, and after it is last at E."""
    reached, left = spans.start_ms.copy(), spans.end_ms.copy()
    early, share = _first_inside(machine, way, ends.begin, backwards=False)
    reached[early.mark] = np.where(
        early.found, way.start[early.piece] + way.length[early.piece] * share, left[early.mark]
    )
    over, share = _first_inside(machine, way, ends.finish, backwards=True)
    piece_end = way.start[over.piece] + way.length[over.piece]
    left[over.mark] = np.where(over.found, piece_end - way.length[over.piece] * share, spans.start_ms[over.mark])
    left = np.maximum(left, reached)
    outside = np.zeros(len(spans.stage))
    for start, end in ((spans.start_ms, reached), (left, spans.end_ms)):
        at = np.flatnonzero(start < end)
        outside[at] += trace.power_ms(channel, Spans(stage=spans.stage[at], start_ms=start[at], end_ms=end[at]))
    return outside


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    """Marks that start (or end) outside, and the piece in which each comes in; `found`: it does."""

    mark: Indices
    piece: Indices
    found: Bools


def _first_inside(machine: Machine, way: Way, place: Place, *, backwards: bool) -> tuple[_Entry, Floats]:
    """Where marks that start before S (`backwards` in time: end beyond E) come in, and at which share of the piece."""
    tolerance = 1 / min(machine.pulses_per_mm)
    edge = way.first[1:] - 1 if backwards else way.first[:-1]
    outer = 2 if backwards else 0
    sign = -1.0 if backwards else 1.0

    def inside(node: int | slice, piece: Indices, mark: Indices) -> Floats:
        at = place.pick(mark)
        off_x, off_y = _off_mm(machine, way.x[node][..., piece], way.y[node][..., piece], at)
        return sign * (off_x * at.along_x + off_y * at.along_y)

    mark = np.flatnonzero(inside(outer, edge, np.arange(len(edge))) < -tolerance)
    count = way.first[mark + 1] - way.first[mark]
    begins = np.cumsum(count) - count
    which = np.repeat(np.arange(len(mark)), count)
    number = np.arange(len(which)) - begins[which]
    piece = way.first[mark][which] + (count[which] - 1 - number if backwards else number)
    nodes = inside(slice(None), piece, mark[which])[:: -1 if backwards else 1]
    middle_in, end_in = nodes[1] >= -tolerance, nodes[2] >= -tolerance
    none = len(which)
    comes = np.where(middle_in | end_in, np.arange(none), none)
    at = np.minimum.reduceat(comes, begins) if len(mark) else comes
    found = at < none
    at = np.minimum(at, none - 1)
    level = np.minimum(np.where(middle_in, nodes[1], nodes[2])[at], 0.0)
    return _Entry(mark=mark, piece=piece[at], found=found), _root(nodes[:, at] - level)


def _root(nodes: Floats) -> Floats:
    """First root, as share of the piece, of parabolas through (3, k) values at start (< 0), middle and end."""
    slope = 4 * nodes[1] - 3 * nodes[0] - nodes[2]
    bend = 2 * (nodes[0] + nodes[2] - 2 * nodes[1])
    below = slope + np.sqrt(np.maximum(slope * slope - 4 * bend * nodes[0], 0.0))
    share = np.divide(-2 * nodes[0], below, out=np.ones_like(below), where=below > 0)
    return np.asarray(np.clip(share, 0.0, 1.0))


# Energy per mm.


def _per_mm(
    trace: Trace, machine: Machine, channel: ChannelTrace, way: Way, spans: Spans
) -> tuple[Floats, Floats, Floats]:
    """(middle, peak, RMS deviation from the middle in %) of the power integral per mm of the beam's way, (k,)."""
    length = way.mark_mm()
    moves = length >= 1 / max(machine.pulses_per_mm)
    count = np.where(moves, np.maximum(np.ceil(length / BIN_MM - 1e-9), 1), 1).astype(np.intp)
    energy = _bins(trace, channel, way, spans, length, count)
    mark = np.repeat(np.arange(len(count)), count)
    begins = np.cumsum(count) - count
    with np.errstate(divide="ignore", invalid="ignore"):
        width = np.where(moves, length / count, np.nan)
        energy /= width[mark]
        number, third = np.arange(len(mark)) - begins[mark], (count // 3)[mark]
        middle = (number >= third) & (number < count[mark] - third)
        mid = np.bincount(mark, weights=np.where(middle, energy, 0.0), minlength=len(count)) / (
            count - 2 * (count // 3)
        )
        peak = np.maximum.reduceat(energy, begins) if len(mark) else np.empty(0)
        square = np.bincount(mark, weights=(energy - mid[mark]) ** 2, minlength=len(count)) / count
        rms = np.where(mid > 0, np.sqrt(square) / mid * 100, np.nan)
    return mid, peak, _rounded(rms)


def _bins(trace: Trace, channel: ChannelTrace, way: Way, spans: Spans, length: Floats, count: Indices) -> Floats:
    """Power integral in `count` equal parts of each mark's length, all marks in a row."""
    begins = np.cumsum(count) - count
    total = int(count.sum())
    energy = np.empty(total)
    for first in range(0, total, _BLOCK_BINS):
        bins = np.arange(first, min(first + _BLOCK_BINS, total) + 1)
        mark = np.searchsorted(begins, np.minimum(bins, total - 1), side="right") - 1
        number = bins - begins[mark]
        edge = way.moment(mark, length[mark] * (number / count[mark]))
        edge = np.where(number == 0, spans.start_ms[mark], edge)
        of = mark[:-1]
        end = np.where(number[:-1] == count[of] - 1, spans.end_ms[of], edge[1:])
        part = Spans(stage=spans.stage[of], start_ms=edge[:-1], end_ms=np.maximum(end, edge[:-1]))
        energy[first : first + _BLOCK_BINS] = trace.power_ms(channel, part)
    return energy
