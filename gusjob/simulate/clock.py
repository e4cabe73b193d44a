"""When each call of a run moves, and how fast; what the calls ask for and the path can't give."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import Arcs, Segments, arcs_by_centre, arcs_by_radius, segments
from gusjob.kinematics.schedule import Schedule, schedule, starts_at_rest
from gusjob.simulate.state import Program

_ARC_SLACK_PULSE = 3.0
_ROUNDING_PULSE = 2**0.5
"""By how much rounding moves one end of a segment against the other, across it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Clock(Schedule):
    """The schedule of all timed calls of all stages, (m,), and the calls that it comes from.

    `rows` (r,): every buffered row that ran, as index into the stream; `boundary` (r,): how many timed calls ran
    before it; `stage_of_row` (r,). `row` (m,): the timed ones' indices; `laid`, `vel` (m,): what was scheduled.
    """

    rows: Indices
    boundary: Indices
    stage_of_row: Indices
    row: Indices
    laid: Segments
    vel: Floats


def run_clock(calls: BufferedCalls, program: Program, path: str) -> tuple[Clock, list[Diagnostic]]:
    """Times and velocities of everything that ran."""
    stages = program.stages
    per_stage = [stage.rows for stage in stages]
    rows = np.concatenate(per_stage) if per_stage else np.empty(0, dtype=np.intp)
    stage_of_row = np.repeat(np.arange(len(stages)), [len(r) for r in per_stage])
    kind = calls.kind[rows]
    is_timed = kind <= Buffered.DELAY
    timed = np.flatnonzero(is_timed)
    boundary: Indices = np.cumsum(is_timed) - is_timed
    row, stage = rows[timed], stage_of_row[timed]
    dwell = kind[timed] == Buffered.DELAY
    stage_first = np.searchsorted(stage, np.arange(len(stages) + 1))
    laid = lay(calls, row, dwell)

    vel_max = np.array([s.vel_max for s in stages] or [np.inf])
    too_fast = ~dwell & (calls.vel[row] > vel_max[stage] * (1 + 1e-9))
    vel = np.where(dwell, 1.0, np.minimum(calls.vel[row], vel_max[stage]))
    wanted = np.where(dwell, 0.0, calls.vel_end[row])
    planned = schedule(
        length=laid.length,
        vel=vel,
        acc=calls.acc[row],
        vel_end=wanted,
        dwell=dwell,
        dwell_ms=calls.p[row],
        stage_first=stage_first,
    )
    clock = Clock(
        **{f.name: getattr(planned, f.name) for f in fields(Schedule)},
        rows=rows,
        boundary=boundary,
        stage_of_row=stage_of_row,
        row=row,
        laid=laid,
        vel=vel,
    )
    reporter = _Reporter(calls=calls, clock=clock, collector=Collector(path))
    reporter.report(wanted, too_fast, starts_at_rest(dwell, stage_first))
    return clock, reporter.collector.done(rules.MORE)


def lay(calls: BufferedCalls, row: Indices, dwell: Bools, start: tuple[float, float] = (0.0, 0.0)) -> Segments:
    """Segments of timed rows in a row, from the calls' own coordinates; a dwell stays where it is."""
    x1, y1 = calls.x[row], calls.y[row]
    if dwell.any():
        at = np.maximum.accumulate(np.where(dwell, -1, np.arange(len(row))))
        x1, y1 = np.where(at >= 0, x1[at], start[0]), np.where(at >= 0, y1[at], start[1])
    x0, y0 = np.concatenate([[start[0]], x1[:-1]]), np.concatenate([[start[1]], y1[:-1]])
    kind = calls.kind[row]
    at = np.flatnonzero((kind == Buffered.ARC_CENTRE) | (kind == Buffered.ARC_RADIUS))
    ends = (x0[at], y0[at], x1[at], y1[at])
    p, q, ccw = calls.p[row[at]], calls.q[row[at]], calls.r[row[at]] == 1
    centre = arcs_by_centre(*ends, x0[at] + p, y0[at] + q, ccw)
    radius = arcs_by_radius(*ends, p, ccw)
    by_radius = kind[at] == Buffered.ARC_RADIUS
    picked = {
        name: np.where(by_radius, getattr(radius, name), getattr(centre, name))
        for name in ("cx", "cy", "radius", "angle", "sweep")
    }
    return segments(x0, y0, x1, y1, at, Arcs(**picked))


@dataclass(slots=True, kw_only=True)
class _Reporter:
    calls: BufferedCalls
    clock: Clock
    collector: Collector

    def add(self, rule: Rule, where: Bools, **columns: Floats | str) -> None:
        """One diagnostic for each segment in `where`, its fields from columns (m,)."""
        at = np.flatnonzero(where)
        listed = at[: self.collector.room(rule)].tolist()
        for i in listed:
            fields: dict[str, object] = {k: v if isinstance(v, str) else float(v[i]) for k, v in columns.items()}
            self.collector.add(rule, Span(line=int(self.calls.line[self.clock.row[i]])), fields)
        self.collector.uncounted(rule, len(at) - len(listed))

    def report(self, wanted: Floats, too_fast: Bools, breaks: Bools) -> None:
        """Everything that the calls asked for and the path can't give."""
        clock, profile = self.clock, self.clock.profile
        if not len(clock.row):
            return
        end, start = profile.end, profile.start
        moved = ~clock.dwell
        aim = np.minimum(wanted, clock.vel)
        off = np.abs(end - wanted) > 1e-6 * (aim + end) + 1e-12
        self.add(rules.END_NOT_MET, moved & off, value=end, wanted=wanted)
        self.add(rules.START_TOO_FAST, moved & (start > clock.vel * (1 + 1e-9)), value=start, velocity=clock.vel)
        last = np.append(breaks[1:], True)
        before_dwell = np.append(clock.dwell[1:], False)
        stops = (last | before_dwell) & moved & (end > 1e-9)
        self.add(rules.STOPS_HARD, stops, what=Phrase("the segment before a stop ends"), value=end)
        self.add(
            rules.ACCEPTED_ODD,
            too_fast & moved,
            call=Phrase("the segment's velocity"),
            reason=Phrase("it is above synVelMax of GT_SetCrdPrm, and is held to that"),
        )


def path_diagnostics(calls: BufferedCalls, clock: Clock, machine: Machine, path: str) -> list[Diagnostic]:
    """Corners and field, for calls that are not from our planner.

    Corners at which the velocity vector changes by more than the machine's look-ahead lets it; moves outside the
    field.
    """
    laid, end = clock.laid, clock.profile.end
    reporter = _Reporter(calls=calls, clock=clock, collector=Collector(path))
    if not len(end):
        return []
    limit = machine.lookahead_time_ms * machine.lookahead_acc_pulse_per_ms2
    jump = end[:-1] * np.hypot(laid.start_x[1:] - laid.end_x[:-1], laid.start_y[1:] - laid.end_y[:-1])
    jump = np.append(np.where(np.diff(clock.stage) == 0, jump, 0.0), 0.0)
    # The ends are whole pulses: a straight line through points that are each off by half a pulse turns by so much.
    turns = np.where(laid.length > 0, _ROUNDING_PULSE / np.maximum(laid.length, 1e-9), 0.0)
    rounding = np.append(np.where(jump[:-1] > 0, end[:-1] * (turns[:-1] + turns[1:]), 0.0), 0.0)
    sharp = jump - rounding > limit * (1 + 1e-6)
    reporter.add(rules.SHARP_CORNER, sharp, value=end, jump=jump, limit=np.full(len(jump), limit))
    _arc_diagnostics(calls, clock, reporter)
    x_low, x_high, y_low, y_high = laid.extent(np.arange(len(end)))
    for axis, lowest, highest, (low, high), scale in (
        ("X", x_low, x_high, machine.field_x_mm, machine.pulses_per_mm[0]),
        ("Y", y_low, y_high, machine.field_y_mm, machine.pulses_per_mm[1]),
    ):
        below, above = lowest / scale < low - 1e-6, highest / scale > high + 1e-6
        bounds = {"low": np.full(len(end), low), "high": np.full(len(end), high)}
        reporter.add(rules.LISTING_FIELD, below, axis=axis, value=lowest / scale, **bounds)
        reporter.add(rules.LISTING_FIELD, above & ~below, axis=axis, value=highest / scale, **bounds)
    return reporter.collector.done(rules.MORE)


def _arc_diagnostics(calls: BufferedCalls, clock: Clock, reporter: _Reporter) -> None:
    """Arcs whose radius or centre does not fit their ends (sister: no full circle by radius)."""
    laid, at = clock.laid, clock.laid.arc_at
    if not len(at):
        return
    kind, p = calls.kind[clock.row[at]], calls.p[clock.row[at]]
    x0, y0, x1, y1 = laid.x0[at], laid.y0[at], laid.x1[at], laid.y1[at]
    chord = np.hypot(x1 - x0, y1 - y0)
    by_radius = kind == Buffered.ARC_RADIUS
    to_end = np.hypot(x1 - laid.arcs.cx, y1 - laid.arcs.cy)
    # Ends and centre are whole pulses: each may be off by less than one.
    off_circle = ~by_radius & (np.abs(laid.arcs.radius - to_end) > _ARC_SLACK_PULSE)
    for bad, reason in (
        (by_radius & (chord == 0), Phrase("an arc by radius that ends where it starts could be any circle")),
        (
            by_radius & (chord > 0) & (2 * np.abs(p) < chord - _ARC_SLACK_PULSE),
            Phrase("the radius is below half the chord"),
        ),
        (~by_radius & (laid.arcs.radius == 0), Phrase("the centre is the start point")),
        (off_circle & (laid.arcs.radius > 0), Phrase("the end does not lie on the circle about this centre")),
    ):
        where = np.zeros(len(clock.row), dtype=np.bool_)
        where[at[bad]] = True
        reporter.add(rules.LISTING_ARC, where, reason=reason)
