"""Pass: sky writing puts light where the beam is. What a mark switches or sets comes later along the path.

The beam lags behind the command by TIMELAG, so light goes on TIMELAG + SHIFT behind the moment at which the command
passes the mark's start, and off TIMELAG behind its end (RTC5 p. 115; the sign of the shift is its text's, not its
formula's). A GUS switches between two motions: the motion that runs at that moment is split there, at whole pulses,
and goes on at its speed. Delays of the switch line are taken off beforehand, so that the light comes as it would
without them: the RTC5 ignores its own while sky writing is on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.trapezoids import Trapezoids, distance_run, look_ahead
from gusjob.lint.view import CHANNELS
from gusjob.planner.layout import layout
from gusjob.planner.plan import Plan, rearranged
from gusjob.planner.skywriting.switch_diagnostics import switch_diagnostics
from gusjob.planner.skywriting.timeline import Events, events_of, schedule_of
from gusjob.planner.velocity import at_rest_before

_HALF_PULSE = 0.5


def switch_points(state: Plan) -> Plan:
    """Nothing to do where there is no sky writing."""
    if state.sky is None:
        return state
    if state.sky.placed.all():
        return replace(
            state, mark_end=_mark_ends(state, np.arange(len(state.path)), state.timed, state.timed, len(state.path))
        )
    schedule = schedule_of(state)
    events = events_of(state, schedule)
    points = _points(state, schedule, events)
    return _split(state, schedule, events, points)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Points:
    """Where events come: `place` (e,) is the number of a timed row and the share of it that has run.

    The splits, (s,) in order: timed row, place and whole-pulse point of each.
    """

    place: Floats
    at: Indices
    split: Floats
    x: Floats
    y: Floats


def _points(state: Plan, schedule: Schedule, events: Events) -> _Points:
    laid, times = state.segments, schedule.times_ms
    assert laid is not None
    goes = events.goes
    first, behind = schedule.stage_first[events.stage], schedule.stage_first[events.stage + 1]
    time = np.clip(events.time_ms[goes], times[first], times[behind])
    at = np.clip(np.searchsorted(times[1:], time, side="left"), first, behind - 1)
    run = distance_run(schedule.profile, at, np.clip(time - times[at], 0.0, times[at + 1] - times[at]))
    length = laid.length[at]
    share = np.divide(run, length, out=np.zeros(len(at)), where=length > 0)
    x, y = (np.rint(values) + 0.0 for values in laid.points(at, share))
    begins = (run < _HALF_PULSE) | ((x == laid.x0[at]) & (y == laid.y0[at]))
    ends = (length - run < _HALF_PULSE) | ((x == laid.x1[at]) & (y == laid.y1[at]))
    on_round = np.zeros(len(schedule.stage), dtype=np.bool_)
    on_round[laid.arc_at] = True  # An arc may end where it begins.
    begins, ends = begins & (~on_round[at] | (share < 0.5)), ends & (~on_round[at] | (share >= 0.5))
    place = np.where(ends, at + 1.0, np.where(begins, at, at + share))

    splits = np.flatnonzero(~begins & ~ends)
    splits = splits[np.argsort(place[splits], kind="stable")]
    same = np.ones(max(len(splits) - 1, 0), dtype=np.bool_)
    for column in (at, x, y):
        same &= column[splits[1:]] == column[splits[:-1]]
    fresh = np.append(True, ~same)[: len(splits)]
    chosen = splits[np.maximum.accumulate(np.where(fresh, np.arange(len(splits)), 0))]
    place[splits] = place[chosen]
    kept = splits[fresh]

    places = events.boundary.astype(np.float64)
    places[goes] = place
    for channel in CHANNELS:
        mine = np.flatnonzero(state.path.channel[events.row] == channel)
        places[mine] = np.maximum.accumulate(places[mine])
    return _Points(place=places, at=at[kept], split=place[kept], x=x[kept], y=y[kept])


def _split(state: Plan, schedule: Schedule, events: Events, points: _Points) -> Plan:
    """The plan with its motions split at the points, and the events there."""
    path, timed, sky = state.path, state.timed, state.sky
    assert sky is not None
    m, splits = len(timed), len(points.at)
    # Every motion has the place at which it ends; what acts there stands behind it.
    place = np.concatenate([np.arange(1.0, m + 1), points.split, points.place])
    order = np.argsort(place, kind="stable")
    source = np.concatenate([timed, timed[points.at], events.row])[order]
    cell = np.concatenate([np.arange(m), points.at, np.full(len(events.row), -1)])[order]
    moves = cell >= 0
    pieces = _Pieces(cell=cell[moves], place=place[order][moves])

    def column(name: str, split: Any) -> npt.NDArray[Any]:
        own = getattr(path, name)
        parts = [own[timed], np.broadcast_to(np.asarray(split, dtype=own.dtype), splits), own[events.row]]
        return np.concatenate(parts)[order]

    columns = {"x": column("x", points.x), "y": column("y", points.y), "end": column("end", np.nan)}
    bent = pieces.bent(state)
    if bent is not None:
        which, cx, cy = bent
        at = np.flatnonzero(moves)[which]
        for name, value in (("op", Op.ARC_CENTRE), ("cx", cx[which]), ("cy", cy[which])):
            columns[name] = getattr(path, name)[source]
            columns[name][at] = value
    motions = np.flatnonzero(moves)
    smooth = sky.smooth[source]
    smooth[motions[~pieces.last]] = True
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    now = np.empty(len(path), dtype=np.intp)
    now[timed], now[events.row] = rank[:m], rank[m + splits :]
    longer = replace(
        layout(rearranged(state, source, columns)),
        sky=replace(sky, run=sky.run[source], smooth=smooth),
        mark_end=_mark_ends(state, now, motions[pieces.first], motions[pieces.last], len(order)),
        vel=state.vel[pieces.cell],
        acc=state.acc[pieces.cell],
    )
    assert longer.segments is not None
    ends = pieces.end_velocities(state, schedule.profile, longer.segments.length)
    if bent is not None:
        # The pieces of an arc may be shorter than it was.
        acc = np.where(longer.path.op[longer.timed] == Op.DWELL, 1.0, longer.acc)
        reached = np.minimum(look_ahead(longer.segments.length, acc, ends, at_rest_before(longer)), ends)
        ends = np.where(np.isfinite(longer.path.end[longer.timed]), ends, reached)
    return replace(
        longer,
        vel_end=ends,
        diagnostics=(*state.diagnostics, *switch_diagnostics(state, schedule, events, points.place)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pieces:
    """Timed rows cut at splits, (p,): which timed row each is of, and the place at which it ends."""

    cell: Indices
    place: Floats

    @property
    def first(self) -> Bools:
        """The first piece of each motion."""
        return np.append(True, self.cell[1:] != self.cell[:-1])[: len(self.cell)]

    @property
    def last(self) -> Bools:
        """The last piece of each motion."""
        return np.append(self.cell[1:] != self.cell[:-1], True)

    def bent(self, state: Plan) -> tuple[Bools, Floats, Floats] | None:
        """Pieces of arcs that were split, (p,): which these are, and their centres; None without any.

        They become arcs about a centre: by radius it is lost near half a turn.
        """
        laid = state.segments
        assert laid is not None
        cut = np.zeros(len(state.timed), dtype=np.bool_)
        cut[self.cell[~self.last]] = True
        cx, cy, round_ = np.zeros(len(cut)), np.zeros(len(cut)), np.zeros(len(cut), dtype=np.bool_)
        cx[laid.arc_at], cy[laid.arc_at], round_[laid.arc_at] = laid.arcs.cx, laid.arcs.cy, True
        cut &= round_
        return (cut[self.cell], cx[self.cell], cy[self.cell]) if cut.any() else None

    def end_velocities(self, state: Plan, profile: Trapezoids, length: Floats) -> Floats:
        """End velocity of each piece, pulse/ms: that of the whole motion at this point.

        From start v0 over the pieces up to here, v^2 = v0^2 + 2*a*L; down to the end likewise; never above the peak.
        """
        cell, last = self.cell, self.last
        at = np.flatnonzero(~last)
        ends = np.where(last, state.vel_end[cell], 0.0)
        if not len(at):
            return ends
        own = cell[at]
        behind = np.append(0, np.flatnonzero(last) + 1)
        begin, behind = behind[own], behind[own + 1]
        padded = np.append(length, 0.0)
        run = np.add.reduceat(padded, np.column_stack([begin, at + 1]).ravel())[::2]
        left = np.add.reduceat(padded, np.column_stack([at + 1, behind]).ravel())[::2]
        start, peak, end, acc = profile.start[own], profile.peak[own], profile.end[own], profile.acc[own]
        rising = np.sqrt(np.maximum(start * start + np.where(start > peak, -2, 2) * acc * run, 0.0))
        rising = np.where(start > peak, np.maximum(rising, peak), np.minimum(rising, peak))
        ends[at] = np.minimum(rising, np.sqrt(end * end + 2 * acc * left))
        return ends


def _mark_ends(state: Plan, now: Indices, first: Indices, last: Indices, count: int) -> Indices:
    """As in stream.Intent: the first piece of the motion that a light-on goes by, the last of a light-off's.

    `now`: for each row of the plan its row among `count` pieces; `first`, `last`: for each timed row its pieces' rows.
    """
    sky, takes_time = state.sky, state.path.takes_time
    assert sky is not None
    number = (np.cumsum(takes_time) - 1)[sky.ref]
    op = state.path.op[sky.row]
    found = np.full(count, -1, dtype=np.intp)
    for switch, piece in ((Op.ON, first), (Op.OFF, last)):
        mine = op == switch
        found[now[sky.row[mine]]] = piece[number[mine]]
    return found
