"""Pass: move the switches and powers of sky-written marks along the path, to where the lagging beam needs them.

The beam lags behind the command by TIMELAG, so the laser goes on TIMELAG + SHIFT after the command passes
the mark's start, and off TIMELAG after it passes the end (RTC5 p. 115; the sign of the shift is that of its text, not
of its formula). A GUS switches between two motions: the motion that runs at that moment is split there, at whole
pulses, and continues at its velocity. Delays of the switch line are subtracted first, so that the emission is as it
would be without them: the RTC5 ignores its own delays while sky writing is on.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.ir.intent import Intent
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.trapezoids import Trapezoids, distance_run, look_ahead
from gusjob.planner.plan import Plan, PlannedPath, QuantizedPath, next_phase, rearranged
from gusjob.planner.quantize import quantize
from gusjob.planner.skywriting.switch_diagnostics import switch_diagnostics
from gusjob.planner.skywriting.switch_events import PlannedEvents, schedule_of, switch_events
from gusjob.planner.velocity import at_rest_before

_HALF_PULSE = 0.5


def place_switches(planned: PlannedPath) -> Plan:
    """Split motions where a switch or power takes effect, and move it there; record the Intent of the calls."""
    marked = planned.sky.events
    if marked.placed.all():
        count = len(planned.path)
        mark_end = _mark_ends(planned, np.arange(count), planned.timed, planned.timed, count)
        return next_phase(Plan, planned, intent=Intent(run=planned.sky.run, mark_end=mark_end))
    schedule = schedule_of(planned)
    events = switch_events(planned, schedule)
    points = _switch_points(planned, schedule, events)
    return _split(planned, schedule, events, points)


class SwitchPoints(Struct, frozen=True, kw_only=True, eq=False):
    """Where events are on the path. A position is the number of a timed row plus the share of it that has run.

    `position` (e,): of each event. Where motions are split, (s,) in order: `at`, the timed row; `split`, the position;
    `x`, `y`, the point in whole pulses.
    """

    position: Floats
    at: Indices
    split: Floats
    x: Floats
    y: Floats


def _switch_points(planned: PlannedPath, schedule: Schedule, events: PlannedEvents) -> SwitchPoints:
    """Find the positions of events: those that round to an end of their motion are there, the others split it."""
    segments, times = planned.segments, schedule.times_ms
    moved = events.moved
    first, behind = schedule.stage_first[events.stage], schedule.stage_first[events.stage + 1]
    time = np.clip(events.time_ms[moved], times[first], times[behind])
    at = np.clip(np.searchsorted(times[1:], time, side="left"), first, behind - 1)
    run = distance_run(schedule.profile, at, np.clip(time - times[at], 0.0, times[at + 1] - times[at]))
    length = segments.length[at]
    share = np.divide(run, length, out=np.zeros(len(at)), where=length > 0)
    x, y = (np.rint(values) + 0.0 for values in segments.points(at, share))
    begins = (run < _HALF_PULSE) | ((x == segments.x0[at]) & (y == segments.y0[at]))
    ends = (length - run < _HALF_PULSE) | ((x == segments.x1[at]) & (y == segments.y1[at]))
    on_arc = np.zeros(len(schedule.stage), dtype=np.bool_)
    on_arc[segments.arc_at] = True  # An arc may end where it begins.
    begins, ends = begins & (~on_arc[at] | (share < 0.5)), ends & (~on_arc[at] | (share >= 0.5))
    position = np.where(ends, at + 1.0, np.where(begins, at, at + share))

    splits = np.flatnonzero(~begins & ~ends)
    splits = splits[np.argsort(position[splits], kind="stable")]
    same = np.ones(max(len(splits) - 1, 0), dtype=np.bool_)
    for column in (at, x, y):
        same &= column[splits[1:]] == column[splits[:-1]]
    fresh = np.append(True, ~same)[: len(splits)]
    chosen = splits[np.maximum.accumulate(np.where(fresh, np.arange(len(splits)), 0))]
    position[splits] = position[chosen]
    kept = splits[fresh]

    positions = events.boundary.astype(np.float64)
    positions[moved] = position
    for channel in CHANNELS:
        own = np.flatnonzero(planned.path.channel[events.row] == channel)
        positions[own] = np.maximum.accumulate(positions[own])
    return SwitchPoints(position=positions, at=at[kept], split=position[kept], x=x[kept], y=y[kept])


def _split(planned: PlannedPath, schedule: Schedule, events: PlannedEvents, points: SwitchPoints) -> Plan:
    """Make the plan with its motions split at the points, and the events there."""
    path, timed, sky = planned.path, planned.timed, planned.sky
    m, splits = len(timed), len(points.at)
    # Every motion has the position at which it ends; an event there comes behind it.
    position = np.concatenate([np.arange(1.0, m + 1), points.split, points.position])
    order = np.argsort(position, kind="stable")
    source = np.concatenate([timed, timed[points.at], events.row])[order]
    of = np.concatenate([np.arange(m), points.at, np.full(len(events.row), -1)])[order]
    is_timed = of >= 0
    pieces = SplitMotions(of=of[is_timed])

    def column(name: str, split: Any) -> npt.NDArray[Any]:
        own = getattr(path, name)
        parts = [own[timed], np.broadcast_to(np.asarray(split, dtype=own.dtype), splits), own[events.row]]
        return np.concatenate(parts)[order]

    columns = {"x": column("x", points.x), "y": column("y", points.y), "end": column("end", np.nan)}
    split_arcs = pieces.split_arcs(planned)
    if split_arcs is not None:
        which, cx, cy = split_arcs
        at = np.flatnonzero(is_timed)[which]
        for name, value in (("op", Op.ARC_CENTRE), ("cx", cx[which]), ("cy", cy[which])):
            columns[name] = getattr(path, name)[source]
            columns[name][at] = value
    rows = np.flatnonzero(is_timed)
    smooth = sky.smooth[source]
    smooth[rows[~pieces.last]] = True
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    now = np.empty(len(path), dtype=np.intp)
    now[timed], now[events.row] = rank[:m], rank[m + splits :]
    mark_end = _mark_ends(planned, now, rows[pieces.first], rows[pieces.last], len(order))
    longer = replace(
        quantize(rearranged(planned, source, columns), replace(sky, run=sky.run[source], smooth=smooth)),
        vel=planned.vel[pieces.of],
        acc=planned.acc[pieces.of],
    )
    ends = pieces.end_velocities(planned, schedule.profile, longer.segments.length)
    return next_phase(
        Plan,
        longer,
        vel_end=ends if split_arcs is None else _reachable(longer, ends),
        diagnostics=(*planned.diagnostics, *switch_diagnostics(planned, schedule, events, points.position)),
        intent=Intent(run=longer.sky.run, mark_end=mark_end),
    )


def _reachable(quantized: QuantizedPath, ends: Floats) -> Floats:
    """End velocities that can be reached: the pieces of an arc may be shorter than the arc. An END stays as written."""
    acc = np.where(quantized.is_dwell, 1.0, quantized.acc)
    reached = np.minimum(look_ahead(quantized.segments.length, acc, ends, at_rest_before(quantized)), ends)
    return np.where(np.isfinite(quantized.path.end[quantized.timed]), ends, reached)


class SplitMotions(Struct, frozen=True, kw_only=True, eq=False):
    """Timed rows split into pieces, (p,): the timed row that each is a piece of."""

    of: Indices

    @property
    def first(self) -> Bools:
        """First piece of each timed row."""
        return np.append(True, self.of[1:] != self.of[:-1])[: len(self.of)]

    @property
    def last(self) -> Bools:
        """Last piece of each timed row."""
        return np.append(self.of[1:] != self.of[:-1], True)

    def split_arcs(self, planned: PlannedPath) -> tuple[Bools, Floats, Floats] | None:
        """Find the pieces of arcs that were split, (p,): which these are, and their centres; None if there are none.

        They become arcs about a centre: by radius it is lost near half a turn.
        """
        segments = planned.segments
        cut = np.zeros(len(planned.timed), dtype=np.bool_)
        cut[self.of[~self.last]] = True
        cx, cy, is_arc = np.zeros(len(cut)), np.zeros(len(cut)), np.zeros(len(cut), dtype=np.bool_)
        cx[segments.arc_at], cy[segments.arc_at], is_arc[segments.arc_at] = segments.arcs.cx, segments.arcs.cy, True
        cut &= is_arc
        return (cut[self.of], cx[self.of], cy[self.of]) if cut.any() else None

    def end_velocities(self, planned: PlannedPath, profile: Trapezoids, length: Floats) -> Floats:
        """Compute the end velocity of each piece, (p,) pulse/ms: that of the whole motion at this point.

        From start v0 over the pieces up to here, v^2 = v0^2 + 2*a*L; down to the end likewise; never above the peak.

        Args:
            profile: Of the whole motions, (m,).
            length: Of the pieces, (p,) pulse.
        """
        of, last = self.of, self.last
        at = np.flatnonzero(~last)
        ends = np.where(last, planned.vel_end[of], 0.0)
        if not len(at):
            return ends
        own = of[at]
        bounds = np.append(0, np.flatnonzero(last) + 1)
        begin, behind = bounds[own], bounds[own + 1]
        padded = np.append(length, 0.0)
        run = np.add.reduceat(padded, np.column_stack([begin, at + 1]).ravel())[::2]
        left = np.add.reduceat(padded, np.column_stack([at + 1, behind]).ravel())[::2]
        start, peak, end, acc = profile.start[own], profile.peak[own], profile.end[own], profile.acc[own]
        rising = np.sqrt(np.maximum(start * start + np.where(start > peak, -2, 2) * acc * run, 0.0))
        rising = np.where(start > peak, np.maximum(rising, peak), np.minimum(rising, peak))
        ends[at] = np.minimum(rising, np.sqrt(end * end + 2 * acc * left))
        return ends


def _mark_ends(planned: PlannedPath, now: Indices, first: Indices, last: Indices, count: int) -> Indices:
    """For Intent: the first piece of the motion that determines a laser-on, the last one for a laser-off.

    Args:
        now: For each row of the path its row among `count` rows, (n,).
        first, last: For each timed row the rows of its first and last piece, (m,).
    """
    marked = planned.sky.events
    number = (np.cumsum(planned.path.takes_time) - 1)[marked.mark_row]
    op = planned.path.op[marked.row]
    found = np.full(count, -1, dtype=np.intp)
    for switch, piece in ((Op.ON, first), (Op.OFF, last)):
        own = op == switch
        found[now[marked.row[own]]] = piece[number[own]]
    return found
