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

from gusjob import rules
from gusjob.checks.view import CHANNELS
from gusjob.diagnostics import Collector, Diagnostic, Rule
from gusjob.geometry import Segments
from gusjob.job import LaserDelay, LaserFpk, Op
from gusjob.motion import Trapezoids, distance_run, look_ahead, reached_ends, running_sum, trapezoids
from gusjob.planner.layout import layout
from gusjob.planner.plan import Plan, rearranged
from gusjob.planner.velocity import starts_at_rest
from gusjob.units import US_PER_MS

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]

_HALF_PULSE = 0.5
_NO_TIME_MS = 1e-9
_ON, _OFF = 1, 2


def switch_points(state: Plan) -> Plan:
    """Nothing to do where there is no sky writing."""
    if state.sky is None:
        return state
    timeline = _timeline(state)
    events = _events(state, timeline)
    points = _points(state, timeline, events)
    return _split(state, timeline, events, points)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Timeline:
    """When each timed row runs, (m,), and how fast; `times` (m+1,) ms, stages back to back. `stage` of each."""

    profile: Trapezoids
    times: Floats
    stage: Indices
    stage_first: Indices
    """(s+1,): number of each stage's first timed row."""


def _timeline(state: Plan) -> _Timeline:
    laid, timed = state.segments, state.timed
    assert laid is not None
    dwell = state.path.op[timed] == Op.DWELL
    breaks = starts_at_rest(state)
    vel, acc = np.where(dwell, 1.0, state.vel), np.where(dwell, 1.0, state.acc)
    end = np.where(dwell, 0.0, reached_ends(laid.length, vel, state.vel_end, acc, breaks))
    start = np.concatenate([[0.0], end[:-1]])
    start[breaks] = 0.0
    profile = trapezoids(laid.length, start, vel, end, acc)
    firsts = np.searchsorted(timed, [s.first for s in state.stages])
    return _Timeline(
        profile=profile,
        times=running_sum(np.where(dwell, state.path.dwell_ms[timed], profile.duration_ms)),
        stage=np.searchsorted(firsts, np.arange(len(timed)), side="right") - 1,
        stage_first=np.append(firsts, len(timed)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Events:
    """Rows that act in between, (e,) in job order.

    boundary: how many timed rows stand before; time_ms: when it is to be called. Of those that go by a mark, (g,):
    `goes`, which of the events; `ref`, the mark's number among the timed rows; its stage; their op.
    """

    row: Indices
    boundary: Indices
    time_ms: Floats
    goes: Indices
    ref: Indices
    stage: Indices
    op: npt.NDArray[np.uint8]


def _events(state: Plan, timeline: _Timeline) -> _Events:
    path, sky = state.path, state.sky
    assert sky is not None
    takes_time = path.takes_time
    timed_before: Indices = np.cumsum(takes_time) - takes_time
    row = np.flatnonzero(~takes_time)
    boundary = timed_before[row]
    goes = (np.cumsum(~takes_time) - 1)[sky.row]
    ref = timed_before[sky.ref]
    stage = timeline.stage[ref]
    op = path.op[sky.row]
    late_us = _delays_us(state)[
        stage, path.channel[sky.row], np.where(op == Op.ON, _ON, np.where(op == Op.OFF, _OFF, 0))
    ]
    time_ms = timeline.times[boundary]
    time_ms[goes] = timeline.times[ref + sky.at_end] + (sky.edge_us - late_us) / US_PER_MS
    return _Events(row=row, boundary=boundary, goes=goes, ref=ref, stage=stage, op=op, time_ms=time_ms)


def _delays_us(state: Plan) -> Floats:
    """How late an effect comes behind its call, (stages, channels, what): `_ON` light on, `_OFF` light off.

    The off delay of the first pulse killer counts; its gap does not: that is what SHIFT is for (RTC5 p. 115).
    """
    found = np.zeros((len(state.stages), 2, 3))
    on, off, killer = [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]
    for number, stage in enumerate(state.stages):
        for setup in stage.setups:
            match setup.what:
                case LaserDelay(on_delay_us=on_us, off_delay_us=off_us):
                    on[setup.channel], off[setup.channel] = on_us, off_us
                case LaserFpk(times_us=times_us):
                    killer[setup.channel] = 0.0 if times_us is None else times_us[2]
                case _:
                    pass
        found[number, :, _ON] = on
        found[number, :, _OFF] = np.add(off, killer)
    return found


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


def _points(state: Plan, timeline: _Timeline, events: _Events) -> _Points:
    laid, times = state.segments, timeline.times
    assert laid is not None
    goes = events.goes
    first, behind = timeline.stage_first[events.stage], timeline.stage_first[events.stage + 1]
    time = np.clip(events.time_ms[goes], times[first], times[behind])
    at = np.clip(np.searchsorted(times[1:], time, side="left"), first, behind - 1)
    run = distance_run(timeline.profile, at, np.clip(time - times[at], 0.0, times[at + 1] - times[at]))
    length = laid.length[at]
    share = np.divide(run, length, out=np.zeros(len(at)), where=length > 0)
    x, y = _whole_pulses(laid, at, share)
    begins = (run < _HALF_PULSE) | ((x == laid.x0[at]) & (y == laid.y0[at]))
    ends = (length - run < _HALF_PULSE) | ((x == laid.x1[at]) & (y == laid.y1[at]))
    on_round = np.zeros(len(timeline.stage), dtype=np.bool_)
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


def _whole_pulses(laid: Segments, at: Indices, share: Floats) -> tuple[Floats, Floats]:
    x, y = laid.x0[at] + (laid.x1[at] - laid.x0[at]) * share, laid.y0[at] + (laid.y1[at] - laid.y0[at]) * share
    if len(laid.arc_at):
        number = np.minimum(np.searchsorted(laid.arc_at, at), len(laid.arc_at) - 1)
        round_ = np.flatnonzero(laid.arc_at[number] == at)
        x[round_], y[round_] = laid.arcs.pick(number[round_]).at(share[round_])
    return np.rint(x) + 0.0, np.rint(y) + 0.0


def _split(state: Plan, timeline: _Timeline, events: _Events, points: _Points) -> Plan:
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
    smooth = sky.smooth[source]
    smooth[np.flatnonzero(moves)[~pieces.last]] = True
    longer = replace(
        layout(rearranged(state, source, columns)),
        sky=replace(sky, run=sky.run[source], smooth=smooth),
        mark_end=_mark_ends(events, order, pieces, np.flatnonzero(moves)),
        vel=state.vel[pieces.cell],
        acc=state.acc[pieces.cell],
    )
    assert longer.segments is not None
    ends = pieces.end_velocities(state, timeline.profile, longer.segments.length)
    if bent is not None:
        # The pieces of an arc may be shorter than it was.
        acc = np.where(longer.path.op[longer.timed] == Op.DWELL, 1.0, longer.acc)
        reached = np.minimum(look_ahead(longer.segments.length, acc, ends, starts_at_rest(longer)), ends)
        ends = np.where(np.isfinite(longer.path.end[longer.timed]), ends, reached)
    return replace(longer, vel_end=ends, diagnostics=(*state.diagnostics, *_faults(state, timeline, events)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Pieces:
    """Timed rows cut at splits, (p,): which timed row each is of, and the place at which it ends."""

    cell: Indices
    place: Floats

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


def _mark_ends(events: _Events, order: Indices, pieces: _Pieces, timed: Indices) -> Indices:
    """As in stream.Intent: the first piece of the mark that a light-on goes by, the last of a light-off's."""
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    behind = np.append(0, np.flatnonzero(pieces.last) + 1)
    found = np.full(len(order), -1, dtype=np.intp)
    motions = len(timed)
    for switch, piece in ((Op.ON, behind[events.ref]), (Op.OFF, behind[events.ref + 1] - 1)):
        mine = events.op == switch
        found[rank[motions + events.goes[mine]]] = timed[piece[mine]]
    return found


def _faults(state: Plan, timeline: _Timeline, events: _Events) -> list[Diagnostic]:
    """Where a switch can't come when it should: no motion runs then, or it would come before what it follows."""
    times = timeline.times
    collector = Collector(state.job.name)
    rows, time = events.row[events.goes], events.time_ms[events.goes]
    cell = np.minimum(np.searchsorted(times[1:], time, side="left"), len(timeline.stage) - 1)
    dwell = state.path.op[state.timed[cell]] == Op.DWELL
    waited = np.zeros(len(events.row))
    for channel in CHANNELS:
        mine = np.flatnonzero(state.path.channel[events.row] == channel)
        waited[mine] = np.maximum.accumulate(events.time_ms[mine]) - events.time_ms[mine]
    before = times[timeline.stage_first[events.stage]] - time
    behind = time - times[timeline.stage_first[events.stage + 1]]
    into = np.where(dwell, np.minimum(time - times[cell], times[cell + 1] - time), 0.0)
    lost = waited[events.goes]
    for what, switch in (("on", events.op == Op.ON), ("off", events.op == Op.OFF)):
        delay = f"shorten LASER DELAY {what.upper()}"
        for amount, where, mend in (
            (before, "before the motion begins", f"{delay}, or raise NPREV"),
            (behind, "behind the end of the motion", "raise NPOST"),
            (into, "into a DWELL", f"raise NPOST, or {delay}"),
            (lost if what == "on" else np.zeros(len(time)), "before what stands in front of it is done",
             "raise NPREV and NPOST, or bring SHIFT nearer to 0"),
        ):  # fmt: skip
            fields = {"what": what, "where": where, "mend": mend}
            _report(state, collector, rules.SKY_ROOM, rows, switch & (amount > _NO_TIME_MS), early=amount, **fields)
    dark = (events.op == Op.OFF) & (lost > _NO_TIME_MS)
    _report(state, collector, rules.SKY_DARK, rows, dark, late=lost)
    return collector.done(rules.MORE)


def _report(
    state: Plan, collector: Collector, rule: Rule, rows: Indices, faulty: Bools, /, **columns: Floats | str
) -> None:
    """A fault a line; times that are given in ms are said in us."""
    at = np.flatnonzero(faulty)
    path = state.path
    _, first, counts = np.unique(path.line[rows[at]], return_index=True, return_counts=True)
    listed = collector.room(rule)
    for i, count in zip(at[first[:listed]].tolist(), counts[:listed].tolist(), strict=True):
        row = int(rows[i])
        fields: dict[str, Any] = {
            name: value if isinstance(value, str) else round(float(value[i]) * US_PER_MS, 3)
            for name, value in columns.items()
        }
        fields["channel"] = int(path.channel[row])
        span, remarks = state.job.locate(int(path.line[row]), ""), state.job.remarks(int(path.trail[row]))
        collector.add(rule, span, fields, count, remarks)
    collector.uncounted(rule, max(len(first) - listed, 0))
