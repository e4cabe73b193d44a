"""Overlaps of lines and arcs: what lies on the same straight line or the same circle, and there on the same part.

Each line or arc is a span of a carrier: its straight line or its circle. Spans of a carrier are sorted by their begin,
so that an overlap is a begin before the furthest end up to there. Where several overlap on one part, not every pair is
found.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks, hashed, repeated
from gusjob.kinematics.geometry import TURN, Arcs, Ends

OVERLAP_MM = 0.1
"""Overlaps up to this length, about that of a spot, join marks."""
_SLOPE_STEP, _OFFSET_STEP_MM = 1e-7, 1e-4
"""Straight lines are the same if their slope and offset are the same in these steps."""
_CIRCLE_STEP_MM = 0.004
"""Circles are the same if their centres and radii are the same in these steps."""
_SHIFT = 0.37
"""Share of a step by which steps are moved, so that usual numbers do not lie between two of them."""
_COSINE, _SINE = math.cos(0.7234), math.sin(0.7234)
"""A direction to which lines of jobs are at a right angle only by chance: slopes and offsets are seen from it."""
_BY_SLOPE, _BY_OFFSET = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xC2B2AE3D27D4EB4F)
_TOUCH_MM = 1e-6
_GROUP_MM = 1e8
"""More than any span reaches along its carrier."""


class Overlaps(Struct, frozen=True, kw_only=True, eq=False):
    """Overlaps, (k,) each, `later` ascending: the segment in which each begins, an earlier one on the same part, mm."""

    later: Indices
    earlier: Indices
    length_mm: Floats


class _CarrierSpans(Struct, frozen=True, kw_only=True, eq=False):
    """Parts of carriers, (n,) each: the carrier, begin and end along it in mm, the first of the segments, how many."""

    carrier: npt.NDArray[np.uint64]
    low: Floats
    high: Floats
    first: Indices
    count: Indices

    def pick(self, at: Indices) -> _CarrierSpans:
        """Pick some of the spans."""
        return _CarrierSpans(
            carrier=self.carrier[at],
            low=self.low[at],
            high=self.high[at],
            first=self.first[at],
            count=self.count[at],
        )


def line_overlaps(ends: Callable[[Indices], Ends], key: npt.NDArray[np.uint64]) -> Overlaps:
    """Find overlaps of lines with a length.

    Args:
        ends: Gives the ends of some of the lines, mm; they are numbered in the order in which they are made.
        key: Lines with another key do not count, (n,).
    """
    carrier = np.empty(len(key), dtype=np.uint64)
    for part in blocks(len(key)):
        carrier[part] = _straight(ends(np.arange(part.start, part.stop)))[0] + key[part]
    # Only lines whose carrier has others are looked at more closely.
    at = repeated(carrier)
    if not len(at):
        return _NO_OVERLAPS
    carrier, (x0, y0, x1, y1) = carrier[at], ends(at)
    _, slope, advance = _straight((x0, y0, x1, y1))
    # Lines that continue each other are one span.
    joined = (carrier[1:] == carrier[:-1]) & ((advance[1:] > 0) == (advance[:-1] > 0)) & (at[1:] == at[:-1] + 1)
    joined &= (np.abs(x0[1:] - x1[:-1]) < _TOUCH_MM) & (np.abs(y0[1:] - y1[:-1]) < _TOUCH_MM)
    first = np.flatnonzero(np.concatenate([[True], ~joined]))
    per_mm = np.hypot(1.0, slope)
    along0, along1 = ((x * _COSINE + y * _SINE) * per_mm for x, y in ((x0, y0), (x1, y1)))
    count = np.diff(np.append(first, len(carrier)))
    begin, end = along0[first], along1[first + count - 1]
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    spans = _CarrierSpans(carrier=carrier[first], low=low, high=high, first=first, count=count)
    found = _overlaps(spans, np.minimum(along0, along1), np.maximum(along0, along1))
    return Overlaps(later=at[found.later], earlier=at[found.earlier], length_mm=found.length_mm)


def _straight(ends: Ends) -> tuple[npt.NDArray[np.uint64], Floats, Floats]:
    """Compute the carrier of lines, its slope, and how far each goes in the direction that both are seen from, mm."""
    x0, y0, x1, y1 = ends
    dx, dy = x1 - x0, y1 - y0
    advance = dx * _COSINE + dy * _SINE
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (dy * _COSINE - dx * _SINE) / advance
        offset = (x0 * dy - y0 * dx) / advance
        carrier = np.floor(slope / _SLOPE_STEP + _SHIFT).astype(np.int64).view(np.uint64) * _BY_SLOPE
        carrier += np.floor(offset / _OFFSET_STEP_MM + _SHIFT).astype(np.int64).view(np.uint64) * _BY_OFFSET
    return carrier, slope, advance


def arc_overlaps(arcs: Arcs, key: npt.NDArray[np.uint64]) -> Overlaps:
    """Find overlaps of arcs with a length, in mm; `key` as that of line_overlaps."""
    low = np.where(arcs.sweep >= 0, arcs.angle, arcs.angle + arcs.sweep) % TURN
    high = low + np.abs(arcs.sweep)
    over = np.flatnonzero(high > TURN)
    member = np.concatenate([np.arange(len(low)), over])
    begins = np.concatenate([low, np.zeros(len(over))]) * arcs.radius[member]
    ends = np.concatenate([np.minimum(high, TURN), high[over] - TURN]) * arcs.radius[member]
    found = []
    # Numbers that lie between two steps do not lie between two steps that are moved by a half.
    for shift in (_SHIFT, _SHIFT + 0.5):
        circle = hashed([np.floor(v / _CIRCLE_STEP_MM + shift) for v in (arcs.cx, arcs.cy, arcs.radius)])
        carrier = (circle + key)[member]
        spans = _CarrierSpans(carrier=carrier, low=begins, high=ends, first=member, count=np.ones_like(member))
        found.append(_overlaps(spans, low * arcs.radius, high * arcs.radius))
    return _longest(found)


_NO_OVERLAPS = Overlaps(later=np.empty(0, dtype=np.intp), earlier=np.empty(0, dtype=np.intp), length_mm=np.empty(0))


def _overlaps(spans: _CarrierSpans, low: Floats, high: Floats) -> Overlaps:
    """Find overlaps of spans; `low`, `high`: begin and end of each segment, (n,)."""
    spans = spans.pick(repeated(spans.carrier))
    spans = spans.pick(np.lexsort((spans.low, spans.carrier)))
    n = len(spans.first)
    if not n:
        return _NO_OVERLAPS
    group = np.concatenate([[0], np.cumsum(spans.carrier[1:] != spans.carrier[:-1])])
    reach = group * _GROUP_MM + spans.high
    furthest = np.maximum.accumulate(np.where(reach >= np.maximum.accumulate(reach), np.arange(n), 0))[:-1]
    length = np.minimum(spans.high[1:], spans.high[furthest]) - spans.low[1:]
    same = (group[1:] == group[furthest]) & (spans.first[1:] != spans.first[furthest])
    hit = np.flatnonzero((length > OVERLAP_MM) & same)
    one, other, length = hit + 1, furthest[hit], length[hit]
    begin, end = spans.low[one], spans.low[one] + length
    is_later = spans.first[one] > spans.first[other]
    later, earlier = np.where(is_later, one, other), np.where(is_later, other, one)
    # A span is reported once, with all of its overlaps.
    order = np.lexsort((spans.first[earlier], spans.first[later]))
    first_of = np.flatnonzero(np.diff(spans.first[later][order], prepend=-1))
    if not len(first_of):
        return _NO_OVERLAPS
    at = order[first_of]
    return Overlaps(
        later=_first_in(spans.pick(later[at]), begin[at], end[at], low, high),
        earlier=_first_in(spans.pick(earlier[at]), begin[at], end[at], low, high),
        length_mm=np.add.reduceat(length[order], first_of),
    )


def _first_in(spans: _CarrierSpans, begin: Floats, end: Floats, low: Floats, high: Floats) -> Indices:
    """Find the first segment of each span that lies between a begin and an end."""
    if (spans.count == 1).all():
        return spans.first
    starts = np.cumsum(spans.count) - spans.count
    which = np.repeat(np.arange(len(spans.first)), spans.count)
    row = np.arange(len(which)) - starts[which] + spans.first[which]
    inside: Bools = (high[row] > begin[which] + _TOUCH_MM) & (low[row] < end[which] - _TOUCH_MM)
    return np.minimum.reduceat(np.where(inside, row, row.max(initial=0)), starts)


def _longest(found: list[Overlaps]) -> Overlaps:
    """Join overlaps; of those of one segment the longest."""
    later = np.concatenate([one.later for one in found])
    length = np.concatenate([one.length_mm for one in found])
    order = np.lexsort((-length, later))
    at = order[np.flatnonzero(np.diff(later[order], prepend=-1))]
    earlier = np.concatenate([one.earlier for one in found])
    return Overlaps(later=later[at], earlier=earlier[at], length_mm=length[at])
