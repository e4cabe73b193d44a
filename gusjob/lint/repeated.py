"""Marks that are made twice: a segment again, in either direction, or a part of a line or circle again."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.effects import POSITION, StateEffect
from gusjob.ir.path import Op, Path
from gusjob.ir.setup import PowerNow
from gusjob.kinematics.arrays import (
    Bools,
    Floats,
    Indices,
    blocks,
    follow_each_other,
    hashed,
    mixed,
    picked,
    repeated,
    where_true,
)
from gusjob.kinematics.geometry import Ends
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


class RepeatedMarks(Struct, frozen=True, kw_only=True, eq=False):
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
    dose = _dose_keys(context, channel, rows)
    whole, once = _wholly_repeated(context.path, rows, dose)
    where = where_true(once)
    return whole, _partly_repeated(context, channel, rows[where], picked(dose, where))


def _wholly_repeated(path: Path, rows: Indices, dose: npt.NDArray[np.uint64]) -> tuple[RepeatedMarks, Bools]:
    """Find marks that repeat an earlier one as a whole, and which of all have a length and do not, (k,)."""
    keys = _segment_keys(path, rows, dose)
    once, shapes = keys.has_length.copy(), _repeated_shapes(keys.shape)
    again, first = shapes.later()
    once[again] = False
    has_length = keys.has_length[again]
    again, first = again[has_length], first[has_length]
    in_pass = _in_passes(path, rows, keys, shapes)[again]
    return RepeatedMarks(rows=rows[again], first=rows[first], in_pass=in_pass), once


class _RepeatedShapes(Struct, frozen=True, kw_only=True, eq=False):
    """Segments whose shape occurs several times, by shape, (k,) each.

    `order`: the segments, those of one shape in order. `begins`: where in it a new shape begins.
    """

    order: Indices
    begins: Bools

    def later(self) -> tuple[Indices, Indices]:
        """List the segments whose shape an earlier one has, ascending, and for each the first one of its shape."""
        first = self.order[np.maximum.accumulate(np.where(self.begins, np.arange(len(self.order)), 0))]
        later, first = self.order[~self.begins], first[~self.begins]
        ascending = np.argsort(later)
        return later[ascending], first[ascending]


def _repeated_shapes(shape: npt.NDArray[np.uint64]) -> _RepeatedShapes:
    """Find the segments whose shape occurs several times."""
    several = repeated(shape)
    order = several[np.argsort(shape[several], kind="stable")]
    begins = np.ones(len(order), dtype=np.bool_)
    begins[1:] = shape[order[1:]] != shape[order[:-1]]
    return _RepeatedShapes(order=order, begins=begins)


def _partly_repeated(context: LintContext, channel: int, rows: Indices, dose: npt.NDArray[np.uint64]) -> RepeatedMarks:
    """Find overlaps of marks of different shapes."""
    path, (px, py) = context.path, context.machine.pulses_per_mm
    is_arc = path.is_arc[rows]
    lines, arcs = (np.flatnonzero(~is_arc), np.flatnonzero(is_arc)) if is_arc.any() else (None, None)

    def ends_mm(at: Indices) -> Ends:
        x0, y0, x1, y1 = path.ends(rows[at if lines is None else lines[at]])
        return x0 / px, y0 / py, x1 / px, y1 / py

    of_lines = line_overlaps(ends_mm, dose if lines is None else dose[lines])
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
    path, modal = context.path, context.modal
    mark = modal.mark_numbers(channel, rows[later])
    is_first = (first == 0) | (modal.mark_numbers(channel, rows[first - 1]) != mark)
    is_last = later == len(rows) - 1
    is_last |= modal.mark_numbers(channel, rows[np.minimum(later + 1, len(rows) - 1)]) != mark
    (x0, y0, x1, y1), (u0, v0, u1, v1) = path.ends(rows[later]), path.ends(rows[first])
    same_way = np.where(
        path.is_arc[rows[later]],
        path.ccw[rows[later]] == path.ccw[rows[first]],
        (x1 - x0) * (u1 - u0) + (y1 - y0) * (v1 - v0) > 0,
    )
    return np.asarray((mark == modal.mark_numbers(channel, rows[first])) & is_first & is_last & same_way)


_PERIODS = 16
"""Lengths of a pass that are tried, the most frequent distances between two equal segments first."""


def _in_passes(path: Path, rows: Indices, keys: _SegmentKeys, shapes: _RepeatedShapes) -> Bools:
    """Find segments in a pass that repeats the one before, (k,).

    Args:
        path: The path.
        rows: The segments, (k,).
        keys: Their keys.
        shapes: Those whose shape occurs several times.
    """
    found = np.zeros(len(rows), dtype=np.bool_)
    if not len(shapes.order):
        return found
    lags, counts = np.unique(np.diff(shapes.order)[~shapes.begins[1:]], return_counts=True)
    periods = lags[np.argsort(-counts, kind="stable")][:_PERIODS].tolist()
    directed = _directed_keys(path, rows, keys.shape)
    for period in periods:
        same = directed[period:] == directed[:-period]
        if period == 1:
            found[1:] |= same & keys.closed[1:]
            continue
        # Stretches of equal segments at least as long as the pass.
        edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
        begin, end = edges[::2], edges[1::2]
        whole = end - begin >= period
        steps = np.zeros(len(same) + 1, dtype=np.int8)
        steps[begin[whole]], steps[end[whole]] = 1, -1
        found[period:] |= np.cumsum(steps, dtype=np.int8)[:-1] > 0
    return found


class _SegmentKeys(Struct, frozen=True, kw_only=True, eq=False):
    """Keys of some motions, (k,) each.

    `shape`: equal where shape (in whole pulses, either direction) and power are equal. `has_length`: the motion has a
    length; a full circle has one. `closed`: it ends where it starts.
    """

    shape: npt.NDArray[np.uint64]
    has_length: Bools
    closed: Bools


def _segment_keys(path: Path, rows: Indices, dose: npt.NDArray[np.uint64]) -> _SegmentKeys:
    shape, closed = np.empty(len(rows), dtype=np.uint64), np.empty(len(rows), dtype=np.bool_)
    has_length, is_arc = np.empty(len(rows), dtype=np.bool_), path.is_arc
    for part in blocks(len(rows)):
        start, end = _end_keys(path, rows[part])
        shape[part], closed[part] = start + end + dose[part], start == end
        has_length[part] = ~closed[part]
        arcs = np.flatnonzero(is_arc[rows[part]])
        if len(arcs):
            shape[part][arcs] += _arc_keys(path, rows[part][arcs], start[arcs] > end[arcs])
            has_length[part][arcs] = True
    return _SegmentKeys(shape=shape, has_length=has_length, closed=closed)


def _directed_keys(path: Path, rows: Indices, shape: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    """Keys of motions, equal where shape, power and direction are equal. `shape`: their keys in either direction."""
    directed = np.empty_like(shape)
    for part in blocks(len(rows)):
        directed[part] = shape[part] + _end_keys(path, rows[part])[0] * _BY_DIRECTION
    return directed


def _end_keys(path: Path, rows: Indices) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.uint64]]:
    """Keys of the start and of the end of motions, in whole pulses.

    They are well mixed, so that the sums of the keys of both ends differ where the ends do.
    """
    x0, y0, x1, y1 = path.ends(rows)
    ends = _point_keys(x1, y1)
    if follow_each_other(rows):  # Each starts where the one before it ends.
        return np.concatenate([_point_keys(x0[:1], y0[:1]), ends[:-1]]), ends
    return _point_keys(x0, y0), ends


def _point_keys(x: Floats, y: Floats) -> npt.NDArray[np.uint64]:
    return mixed(hashed([np.rint(x), np.rint(y)]))


_BY_DIRECTION = np.uint64(0x9E3779B97F4A7C15)


def _arc_keys(path: Path, rows: Indices, is_reverse: Bools) -> npt.NDArray[np.uint64]:
    """Keys of arcs: equal where circle and side are equal. `is_reverse`: one of both directions, (k,)."""
    by_radius = path.op[rows] == Op.ARC_RADIUS  # It has no centre of its own.
    centre = [np.rint(np.where(by_radius, 0.0, v[rows])) for v in (path.cx, path.cy)]
    side = np.where(path.ccw[rows] != is_reverse, 1.0, -1.0)
    return hashed([*centre, np.rint(np.nan_to_num(path.radius[rows])), side])


def _dose_keys(context: LintContext, channel: int, rows: Indices) -> npt.NDArray[np.uint64]:
    """A key of each motion, (k,): equal where mode, power and velocity are equal."""
    vel, (firsts, power) = context.path.vel, _power_keys(context, channel)
    has_velocities = bool(np.fmin.reduce(vel) != np.fmax.reduce(vel))
    dose = np.empty(len(rows), dtype=np.uint64)
    for part in blocks(len(rows)):
        dose[part] = power[np.searchsorted(firsts, rows[part], side="right") - 1]
        if has_velocities:
            dose[part] += hashed([np.nan_to_num(vel[rows[part]])])
    for span in context.modal.modes(channel):
        key = (span.mode.mode, span.mode.carrier_khz, span.mode.pulse_width_us)
        dose[slice(*np.searchsorted(rows, [span.first, span.last]))] += np.uint64(hash(key) % 1_000_003)
    return np.broadcast_to(dose[:1], len(dose)) if (dose == dose[0]).all() else dose


def _power_keys(context: LintContext, channel: int) -> tuple[Indices, npt.NDArray[np.uint64]]:
    """A key of each power, equal where the power is, (e,), and the rows from which on they are in force, ascending."""
    path = context.path
    rows = np.flatnonzero(path.sets_power & (path.channel == channel))
    now = [(setup, power) for setup, power in context.modal.statements(PowerNow) if setup.channel == channel]
    at_rest = np.array([context.modal.stage_first[setup.order] * 2 for setup, _ in now], dtype=np.intp)
    instants = np.concatenate([rows * 2 + 1, at_rest])
    power = np.concatenate([path.power[rows], [power.power for _, power in now]])
    given = [v for v in (path.low, path.high, path.ratio) if v.strides != (0,)]  # Without FOLLOW there are none.
    follow = [np.concatenate([v[rows], np.full(len(now), np.nan)]) for v in given]
    order = np.argsort(instants, kind="stable")
    keys = hashed([np.nan_to_num(v[order]) for v in (power, *follow)])
    # Each power is in force from the row behind its instant on.
    firsts = np.concatenate([[0], (instants[order] + 1) // 2])
    return firsts, np.concatenate([np.zeros(1, dtype=np.uint64), keys])
