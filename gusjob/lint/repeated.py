"""Marks that are made twice: a segment again, in either direction, or a part of a line or circle again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.effects import POSITION, StateEffect
from gusjob.ir.path import Op, Path
from gusjob.ir.setup import PowerNow
from gusjob.kinematics.arrays import Bools, Floats, Indices, hashed, mixed
from gusjob.kinematics.overlaps import arc_overlaps, line_overlaps
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter


def marked_twice(context: LintContext, report: Reporter) -> None:
    """The same segment is marked with the same power from two lines of the job; passes of a loop are intended."""
    for channel in CHANNELS:
        for found in _marks_twice(context, channel):
            certain = _is_certain(context, found.rows, channel) & _is_certain(context, found.first, channel)
            _report_repeated(context, report, found.pick(certain & found.from_another_line(context.path)))


def _is_certain(context: LintContext, rows: Indices, channel: int) -> Bools:
    """Whether position, power and velocity of some marks are known."""
    where = context.known(rows, StateEffect.POWER | StateEffect.MODE | POSITION, channel)
    return where & context.known_after(rows, POSITION | StateEffect.VEL)


def marked_twice_outside_passes(context: LintContext, report: Reporter) -> None:
    """The same segment is marked with the same power, and not in a pass: calls do not show loops."""
    for channel in CHANNELS:
        for found in _marks_twice(context, channel):
            _report_repeated(context, report, found.pick(~found.in_pass))


def _report_repeated(context: LintContext, report: Reporter, found: RepeatedMarks) -> None:
    remarks = context.line_remarks(d.FIRST_HERE, context.path.line[found.first])
    if found.length_mm is None:
        report.rows(rules.MARKED_TWICE, found.rows, "", remarks=remarks)
    else:
        report.rows(rules.PARTLY_MARKED_TWICE, found.rows, "", remarks=remarks, length=np.round(found.length_mm, 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatedMarks:
    """Marked segments that were marked before with the same power and velocity, (k,) in order.

    `first`: the row that marked the segment first. `in_pass`: several segments are repeated in their order and
    direction, from the first to the last, as by another pass of a loop; or a closed segment is repeated at once.
    `length_mm`: length of the part that is repeated; None: the whole segments are.
    """

    rows: Indices
    first: Indices
    in_pass: Bools
    length_mm: Floats | None = None

    def pick(self, where: Bools) -> RepeatedMarks:
        """Pick the repeated segments at a mask."""
        length_mm = None if self.length_mm is None else self.length_mm[where]
        return RepeatedMarks(
            rows=self.rows[where], first=self.first[where], in_pass=self.in_pass[where], length_mm=length_mm
        )

    def from_another_line(self, path: Path) -> Bools:
        """Whether the segment was marked first from another line, (k,)."""
        return np.asarray(path.line[self.rows] != path.line[self.first])


def _marks_twice(context: LintContext, channel: int) -> tuple[RepeatedMarks, ...]:
    """Find the marks of a channel that repeat an earlier one as a whole, and those that repeat a part of one."""
    rows = np.flatnonzero(context.path.moves & context.modal.laser(channel).on)
    if len(rows) < 2:
        return ()
    dose = _dose_keys(context, channel)[rows]
    keys = _segment_keys(context.path, rows, dose)
    first = _first_of_shape(keys.shape)
    if first is None:
        long = slice(None) if keys.has_length.all() else keys.has_length
        return (_partly_repeated(context, channel, rows[long], dose[long]),)
    fresh = first.of_each == np.arange(len(rows))
    again = np.flatnonzero(~fresh & keys.has_length)
    in_pass = _in_passes(keys, first.order, first.begins)[again]
    once = fresh & keys.has_length
    return (
        RepeatedMarks(rows=rows[again], first=rows[first.of_each[again]], in_pass=in_pass),
        _partly_repeated(context, channel, rows[once], dose[once]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _FirstOfShape:
    """Segments by shape, (k,) each.

    `order`: those of one shape in order. `begins`: where in it a new shape begins. `of_each`: the first segment of the
    shape of each segment.
    """

    order: Indices
    begins: Bools
    of_each: Indices


def _first_of_shape(shape: npt.NDArray[np.uint64]) -> _FirstOfShape | None:
    """Find the first segment of each shape; None if no two segments have the same."""
    ascending = np.sort(shape)
    if not (ascending[1:] == ascending[:-1]).any():
        return None
    order = np.argsort(shape, kind="stable")
    begins = np.concatenate([[True], shape[order][1:] != shape[order][:-1]])
    of_each = np.empty(len(shape), dtype=np.intp)
    of_each[order] = order[np.maximum.accumulate(np.where(begins, np.arange(len(order)), 0))]
    return _FirstOfShape(order=order, begins=begins, of_each=of_each)


def _partly_repeated(context: LintContext, channel: int, rows: Indices, dose: npt.NDArray[np.uint64]) -> RepeatedMarks:
    """Find overlaps of marks of different shapes."""
    path, (px, py) = context.path, context.machine.pulses_per_mm
    is_arc = path.is_arc[rows]
    lines, arcs = (np.flatnonzero(~is_arc), np.flatnonzero(is_arc)) if is_arc.any() else (None, None)
    x0, y0, x1, y1 = path.ends(rows if lines is None else rows[lines])
    of_lines = line_overlaps(x0 / px, y0 / py, x1 / px, y1 / py, dose if lines is None else dose[lines])
    later, first, length_mm = of_lines.later, of_lines.earlier, of_lines.length_mm
    if lines is not None and arcs is not None:
        of_arcs = arc_overlaps(drawn_arcs(path, rows[arcs], context.machine).in_mm(), dose[arcs])
        later = np.concatenate([lines[later], arcs[of_arcs.later]])
        first = np.concatenate([lines[first], arcs[of_arcs.earlier]])
        length_mm = np.concatenate([length_mm, of_arcs.length_mm])
    never = np.zeros(len(later), dtype=np.bool_)
    found = RepeatedMarks(rows=rows[later], first=rows[first], in_pass=never, length_mm=length_mm)
    return found.pick(~_closes_mark(context, channel, rows, later, first)) if len(later) else found


def _closes_mark(context: LintContext, channel: int, rows: Indices, later: Indices, first: Indices) -> Bools:
    """Find overlaps that close a contour: a mark's last segment goes on over its first one, in the same direction."""
    path, mark = context.path, context.modal.mark_numbers(channel)[rows]
    begins = np.concatenate([[True], mark[1:] != mark[:-1]])
    ends = np.append(begins[1:], True)
    (x0, y0, x1, y1), (u0, v0, u1, v1) = path.ends(rows[later]), path.ends(rows[first])
    same_way = np.where(
        path.is_arc[rows[later]],
        path.ccw[rows[later]] == path.ccw[rows[first]],
        (x1 - x0) * (u1 - u0) + (y1 - y0) * (v1 - v0) > 0,
    )
    return np.asarray((mark[later] == mark[first]) & begins[first] & ends[later] & same_way)


_PERIODS = 16
"""Lengths of a pass that are tried, the most frequent distances between two equal segments first."""


def _in_passes(keys: _SegmentKeys, order: Indices, fresh: Bools) -> Bools:
    """Find segments in a pass that repeats the one before, (k,).

    Args:
        keys: Keys of all segments.
        order: Segments by shape, those of one shape in order, (k,).
        fresh: Where in `order` a new shape begins, (k,).
    """
    n = len(order)
    lags, counts = np.unique(np.diff(order)[~fresh[1:]], return_counts=True)
    periods = lags[np.argsort(-counts, kind="stable")][:_PERIODS].tolist()
    found = np.zeros(n, dtype=np.bool_)
    for period in periods:
        same = keys.directed[period:] == keys.directed[:-period]
        if period == 1:
            found[1:] |= same & keys.closed[1:]
            continue
        # Stretches of equal segments at least as long as the pass.
        edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
        begin, end = edges[::2], edges[1::2]
        whole = end - begin >= period
        steps = np.zeros(len(same) + 1, dtype=np.int8)
        steps[begin[whole]], steps[end[whole]] = 1, -1
        found[period:] |= np.cumsum(steps)[:-1] > 0
    return found


@dataclass(frozen=True, slots=True, kw_only=True)
class _SegmentKeys:
    """Keys of some motions, (k,) each.

    `shape`: equal where shape (in whole pulses, either direction) and power are equal. `directed`: in one direction.
    `has_length`: the motion has a length; a full circle has one. `closed`: it ends where it starts.
    """

    shape: npt.NDArray[np.uint64]
    directed: npt.NDArray[np.uint64]
    has_length: Bools
    closed: Bools


def _segment_keys(path: Path, rows: Indices, dose: npt.NDArray[np.uint64]) -> _SegmentKeys:
    # Well mixed, so that the sums of the keys of both ends differ where the ends do; the path begins at 0, 0.
    point = mixed(hashed([np.rint(np.append(v, 0.0)) for v in (path.x, path.y)]))
    start, end = point[rows - 1], point[rows]
    closed = start == end
    shape: npt.NDArray[np.uint64] = start + end + dose
    directed: npt.NDArray[np.uint64] = shape + start * _BY_DIRECTION
    arcs = np.flatnonzero(path.is_arc[rows])
    has_length = ~closed
    if len(arcs):
        of_arcs = _arc_keys(path, rows[arcs], start[arcs] > end[arcs])
        shape[arcs] += of_arcs
        directed[arcs] += of_arcs
        has_length[arcs] = True
    return _SegmentKeys(shape=shape, directed=directed, has_length=has_length, closed=closed)


_BY_DIRECTION = np.uint64(0x9E3779B97F4A7C15)


def _arc_keys(path: Path, rows: Indices, is_reverse: Bools) -> npt.NDArray[np.uint64]:
    """Keys of arcs: equal where circle and side are equal. `is_reverse`: one of both directions, (k,)."""
    by_radius = path.op[rows] == Op.ARC_RADIUS  # It has no centre of its own.
    centre = [np.rint(np.where(by_radius, 0.0, v[rows])) for v in (path.cx, path.cy)]
    side = np.where(path.ccw[rows] != is_reverse, 1.0, -1.0)
    return hashed([*centre, np.rint(np.nan_to_num(path.radius[rows])), side])


def _dose_keys(context: LintContext, channel: int) -> npt.NDArray[np.uint64]:
    """A key of each row, (n,): equal where mode, power and velocity are equal."""
    path = context.path
    dose = _power_keys(context, channel)
    for span in context.modal.modes(channel):
        key = (span.mode.mode, span.mode.carrier_khz, span.mode.pulse_width_us)
        dose[span.first : span.last] += np.uint64(hash(key) % 1_000_003)
    vel = path.vel
    if len(vel) and np.fmin.reduce(vel) != np.fmax.reduce(vel):
        dose += hashed([np.nan_to_num(vel)])
    return dose


def _power_keys(context: LintContext, channel: int) -> npt.NDArray[np.uint64]:
    """A key of each row, (n,): equal where the same power is in force."""
    path = context.path
    rows = np.flatnonzero(path.sets_power & (path.channel == channel))
    now = [(setup, power) for setup, power in context.modal.statements(PowerNow) if setup.channel == channel]
    at_rest = np.array([context.modal.stage_first[setup.order] * 2 for setup, _ in now], dtype=np.intp)
    instants = np.concatenate([rows * 2 + 1, at_rest])
    power = np.concatenate([path.power[rows], [power.power for _, power in now]])
    follow = [np.concatenate([v[rows], np.full(len(now), np.nan)]) for v in (path.low, path.high, path.ratio)]
    order = np.argsort(instants, kind="stable")
    keys = hashed([np.nan_to_num(v[order]) for v in (power, *follow)])
    # Each power is in force from the row behind its instant on.
    firsts = np.concatenate([[0], (instants[order] + 1) // 2, [len(path)]])
    return np.repeat(np.concatenate([np.zeros(1, dtype=np.uint64), keys]), np.diff(firsts))
