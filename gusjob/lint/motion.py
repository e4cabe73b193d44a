"""Motion: velocities, accelerations, field, arcs, dwells, forced end velocities."""

from __future__ import annotations

from typing import Any

import numpy as np

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import MAX_PER_RULE
from gusjob.i18n.phrases import Phrase
from gusjob.ir.arcs import arc_faults, drawn_arcs
from gusjob.ir.effects import POSITION, StateEffect
from gusjob.ir.path import SPEED_WORDS, Op, Path
from gusjob.ir.short_marks import part_begins
from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks, picked, rows_of, where_true
from gusjob.kinematics.float_noise import exceeds
from gusjob.kinematics.geometry import Ends, arcs_by_either
from gusjob.kinematics.slow_parts import REACHES
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter

_MM_S_PER_MM_MS, _MM_S2_PER_MM_MS2 = 1e3, 1e6
_ABOVE = 1 + 1e-9
"""Factor by which a value has to be above a limit: more than rounding."""
_MARGIN = 1.02
"""Factor of a velocity: rounding to pulses is not known before planning."""


def speeds(context: LintContext, report: Reporter) -> None:
    """Every velocity and acceleration that is written is positive and within the machine's limits."""
    machine, written = context.machine, context.job.speeds
    for number, word in enumerate(SPEED_WORDS):
        is_acc = bool(number % 2)
        allowed = ranges.ACCELERATION if is_acc else ranges.VELOCITY
        limit, unit = _machine_limit(context, acceleration=is_acc)
        at = np.flatnonzero(written.word == number)
        value, in_mm = written.value[at], written.in_mm[at]
        mm = value * (_MM_S2_PER_MM_MS2 if is_acc else _MM_S_PER_MM_MS) / machine.pulses_per_mm[0]
        outside = allowed.classify(value) > 0
        fast = ~outside & exceeds(mm, limit) & (in_mm | machine.equal_axes)
        lines, nodes = written.line[at], written.provenance[at]
        words = np.where(written.inline[at], word, "value")
        for rule, bad, values, fields in (
            (rules.TOO_FAST, fast, mm, {"unit": unit, "limit": limit}),
            (rules.OUT_OF_RANGE, outside, value, {"unit": allowed.unit, "range": str(allowed), "hint": ""}),
        ):
            report.lines(rule, lines[bad], nodes[bad], words[bad], what=word, value=values[bad], **fields)


def missing_speeds(context: LintContext, report: Reporter) -> None:
    """A motion has a velocity and an acceleration."""
    path = context.path
    rows = np.flatnonzero(path.moves)
    is_jump = path.op[rows] == Op.JUMP
    for values, missing, effect, of_jumps in (
        (path.vel, rules.NO_VELOCITY, StateEffect.VEL, StateEffect.JUMPVEL),
        (path.acc, rules.NO_ACCELERATION, StateEffect.ACC, StateEffect.JUMPACC),
    ):
        known = context.known_after(rows, effect) & (~is_jump | context.known(rows, of_jumps))
        absent = rows[np.isnan(picked(values, rows_of(rows))) & known]
        if len(absent):
            report.rows(missing, absent[:1], "", word=Op(int(path.op[absent[0]])).word)


def speeds_along(context: LintContext, report: Reporter) -> None:
    """Where the axes differ, a velocity in pulses is another one in mm for each direction."""
    path, machine = context.path, context.machine
    if machine.equal_axes:
        return
    rows = np.flatnonzero(path.moves)
    mm_per_pulse = _mm_per_pulse(context, rows)
    for values, in_mm, lines, word in (
        (path.vel, path.vel_in_mm, path.vel_line, "VEL"),
        (path.acc, path.acc_in_mm, path.acc_line, "ACC"),
    ):
        limit, unit = _machine_limit(context, acceleration=word == "ACC")
        mm = values[rows] * mm_per_pulse * (_MM_S2_PER_MM_MS2 if word == "ACC" else _MM_S_PER_MM_MS)
        fast = np.flatnonzero(~in_mm[rows] & exceeds(mm, limit))
        # A modal value is one diagnostic, where it was set.
        _, first = np.unique(lines[rows[fast]], return_index=True)
        for i in fast[first].tolist():
            line = int(lines[rows[i]])
            is_inline = context.job.locate(line, word) != context.job.locate(line, "")
            report.line(
                rules.TOO_FAST,
                line,
                word if is_inline else "value",
                provenance=int(path.provenance[rows[i]]),
                what=word,
                value=float(mm[i]),
                unit=unit,
                limit=limit,
            )


def _mm_per_pulse(context: LintContext, rows: Indices) -> Floats:
    """Length in mm of a pulse along each of some motions; of an arc the largest, since it has many directions."""
    path, (px, py) = context.path, context.machine.pulses_per_mm
    x0, y0, x1, y1 = path.ends(rows)
    dx, dy = x1 - x0, y1 - y0
    chord = np.hypot(dx, dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        mm_per_pulse = np.where(chord > 0, np.hypot(dx / px, dy / py) / chord, 0.0)
    mm_per_pulse[path.is_arc[rows]] = 1 / min(px, py)
    return mm_per_pulse


def _machine_limit(context: LintContext, *, acceleration: bool) -> tuple[float, str]:
    machine = context.machine
    return (machine.max_acceleration_mm_s2, "mm/s2") if acceleration else (machine.max_velocity_mm_s, "mm/s")


def field(context: LintContext, report: Reporter) -> None:
    """Every motion stays in the machine's field, arcs with their whole extent."""
    path, machine = context.path, context.machine
    rows = np.flatnonzero(path.moves)
    in_x, in_y = machine.field_pulse
    axes = (
        ("X", path.x, machine.field_x_mm, in_x, machine.pulses_per_mm[0], StateEffect.X),
        ("Y", path.y, machine.field_y_mm, in_y, machine.pulses_per_mm[1], StateEffect.Y),
    )
    reported, lines = np.zeros(len(rows), dtype=np.bool_), path.line[rows_of(rows)]
    for axis, values, (low, high), (first, last), scale, effect in axes:
        sent = np.rint(values[rows_of(rows)])
        out = ((sent < first) | (sent > last)) & context.known_after(rows, effect)
        again = out & np.isin(lines, lines[reported]) if reported.any() else reported
        outside, out = out, out & (~again | _has_both_words(context, rows, again))
        reported |= out
        end_mm = values[rows[out]] / scale
        report.rows(rules.OUTSIDE_FIELD, rows[out], axis, axis=axis, value=end_mm, low=low, high=high, hint="")
        within = where_true(~outside & context.known_after(rows, effect))
        report.rows_in_range(rows[within], sent[within], ranges.COORDINATE_PULSE, axis, axis)
    arcs = _certain(context, context.arc_rows())
    if not len(arcs):
        return
    x_low, x_high, y_low, y_high = _extent_mm(context, arcs)
    hint = Phrase(": the arc leaves the field between its ends")
    # One diagnostic an arc: it leaves the field at several sides for one reason.
    inside = ~np.isin(arcs, rows[reported])
    for (axis, _, (low, high), (first, last), scale, _), near, far in zip(
        axes, (x_low, y_low), (x_high, y_high), strict=True
    ):
        for beyond, reached in ((np.rint(near * scale) < first, near), (np.rint(far * scale) > last, far)):
            out = inside & beyond
            inside &= ~out
            report.rows(
                rules.OUTSIDE_FIELD, arcs[out], "", axis=axis, value=reached[out], low=low, high=high, hint=hint
            )


def _extent_mm(context: LintContext, rows: Indices) -> Ends:
    """Bounding boxes of arcs: x low, x high, y low, y high, (k,) mm each.

    Their ends and centres are sent in whole pulses; where the axes differ, many are sent as chords of exact arcs.
    """
    path, machine = context.path, context.machine
    if not machine.equal_axes:
        return drawn_arcs(path, rows, machine).extent_mm()
    scale = machine.pulses_per_mm[0]
    x0, y0, x1, y1, cx, cy = (np.rint(v) / scale for v in (*path.ends(rows), path.cx[rows], path.cy[rows]))
    by_radius = path.op[rows] == Op.ARC_RADIUS
    ends = (x0, y0, x1, y1)
    return arcs_by_either(ends, cx, cy, path.radius[rows] / scale, path.ccw[rows], by_radius).extent()


def _has_both_words(context: LintContext, rows: Indices, where: Bools) -> Bools:
    """Whether rows have X and Y, (k,), looked up where it matters: in a rotated frame one word moves both axes."""
    found = np.ones(len(rows), dtype=np.bool_)
    if not where.any():
        return found
    locate, lines = context.job.locate, context.path.line[rows]
    looked_up = np.unique(lines[where])[:MAX_PER_RULE]
    without = [line for line in looked_up.tolist() if locate(line, "") in (locate(line, "X"), locate(line, "Y"))]
    return ~(where & np.isin(lines, without))


def _certain(context: LintContext, rows: Indices) -> Indices:
    """Of some motions those whose start and end are known."""
    return rows[context.known(rows, POSITION) & context.known_after(rows, POSITION)]


def arcs_close(context: LintContext, report: Reporter) -> None:
    """The end of an arc lies on its circle, and a radius reaches its end."""
    path = context.path
    rows = _certain(context, context.arc_rows())
    if not len(rows):
        return
    good = np.ones(len(rows), dtype=np.bool_)
    by_centre, by_radius = (np.flatnonzero(path.op[rows] == op) for op in (Op.ARC_CENTRE, Op.ARC_RADIUS))
    x0, y0, _, _ = path.ends(rows)
    for at, values, allowed, word in (
        (by_centre, np.rint(path.cx[rows] - x0), ranges.COORDINATE_PULSE, "I"),
        (by_centre, np.rint(path.cy[rows] - y0), ranges.COORDINATE_PULSE, "J"),
        (by_radius, path.radius[rows], ranges.RADIUS_PULSE, "R"),
    ):
        good[at] &= report.rows_in_range(rows[at], values[at], allowed, word, word)
    for rule, bad, word, fields in arc_faults(drawn_arcs(path, rows, context.machine)):
        found = bad & good if rule is rules.ARC_RADII_DIFFER else bad
        if rule is not rules.BAD_ARC:
            found = found & ~_follows(path, rows, found)
        picked: dict[str, Any] = {name: v[found] if isinstance(v, np.ndarray) else v for name, v in fields.items()}
        report.rows(rule, rows[found], word, **picked)


def _follows(path: Path, rows: Indices, bad: Bools) -> Bools:
    """Find bad arcs that begin where the bad one before them ended, on one axis at least: that end may be the cause."""
    found = np.zeros(len(rows), dtype=np.bool_)
    at = np.flatnonzero(bad)
    x0, y0, x1, y1 = path.ends(rows[at])
    found[at[1:]] = (x0[1:] == x1[:-1]) | (y0[1:] == y1[:-1])
    return found


def arc_speed(context: LintContext, report: Reporter) -> None:
    """On an arc v^2/r stays within the machine's acceleration; the planner slows the arc where it may."""
    path, shown = context.path, context.shown
    rows = _certain(context, context.arc_rows())
    rows = rows[context.known_after(rows, StateEffect.VEL)]
    if not len(rows):
        return
    machine, drawn = context.machine, drawn_arcs(path, rows, context.machine)
    px, finest = machine.pulses_per_mm[0], max(machine.pulses_per_mm)
    # A circle in mm is seen in pulses of X, in which its velocity is given.
    in_mm = path.arc_in_mm[rows] | machine.equal_axes
    radius = drawn.arcs.radius * drawn.mm_x * px
    limit = machine.max_acceleration_pulse_per_ms2 * np.where(in_mm, px / finest, 1.0)
    vel = path.vel[rows] * np.where(~in_mm & path.vel_in_mm[rows], min(machine.pulses_per_mm) / px, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = vel**2 / radius
    fast = (needed > limit * _ABOVE) & (radius > 0)
    report.rows(
        rules.ARC_TOO_FAST,
        rows[fast],
        "",
        velocity=vel[fast] * shown.per_pulse_per_ms,
        radius=radius[fast] * shown.per_pulse,
        value=needed[fast] * shown.per_pulse_per_ms2,
        limit=limit[fast] * shown.per_pulse_per_ms2,
        speed=shown.speed,
        length=shown.length,
        acceleration=shown.acceleration,
    )


def _stays(position: Floats) -> Bools:
    """Whether a position is the one before it, in whole pulses, (n,); 0 is before the first."""
    pulses, found = np.rint(position), np.empty(len(position), dtype=np.bool_)
    found[:1], found[1:] = pulses[:1] == 0, pulses[1:] == pulses[:-1]
    return found


def no_length(context: LintContext, report: Reporter) -> None:
    """A mark ends where it begins, in whole pulses."""
    path = context.path
    still = (path.op == Op.LINE) & _stays(path.x) & _stays(path.y)
    if not still.any():
        return
    for channel in CHANNELS:
        rows = np.flatnonzero(still & context.modal.laser(channel).on)
        report.rows(rules.MARK_WITHOUT_LENGTH, rows, "", word="LINE")
        still[rows] = False


def arcs_without_length(context: LintContext, report: Reporter) -> None:
    """An arc ends where it begins, in whole pulses, and is no full circle."""
    path, machine, shown = context.path, context.machine, context.shown
    rows = _certain(context, context.arc_rows())
    if not len(rows):
        return
    drawn = drawn_arcs(path, rows, machine)
    px, py = machine.pulses_per_mm
    x0, y0, x1, y1 = (np.rint(values) for values in path.ends(rows))
    cx, cy = np.rint(drawn.arcs.cx * drawn.mm_x * px), np.rint(drawn.arcs.cy * drawn.mm_y * py)
    is_circle = (drawn.ends[0] == drawn.ends[2]) & (drawn.ends[1] == drawn.ends[3])
    is_short = (np.abs(drawn.arcs.sweep) <= np.pi) | ((cx == x0) & (cy == y0))
    still = (x0 == x1) & (y0 == y1) & is_short & (drawn.arcs.radius > 0) & ~(drawn.by_radius & is_circle)
    value = np.round(drawn.arcs.length * drawn.mm * px * shown.per_pulse, 6)
    hint = Phrase("; without X and Y it would be a full circle")
    for which, text in ((still & ~drawn.by_radius & ~is_circle, hint), (still & (drawn.by_radius | is_circle), "")):
        fields = {"value": value[which], "length": shown.length, "hint": text}
        report.rows(rules.ARC_WITHOUT_LENGTH, rows[which], "", **fields)


def starving(context: LintContext, report: Reporter) -> None:
    """So many short segments follow each other that the host can't keep the FIFO filled.

    The profile gives the host's calls per second. A host that sends a call each 1/rate falls behind by what a segment
    is shorter; the slots of the FIFO are the reserve.
    """
    path, rate = context.path, context.machine.host_calls_per_s
    if rate is None or not len(path):
        return
    rows = np.arange(len(path))
    with np.errstate(divide="ignore", invalid="ignore"):
        moving = np.clip(np.nan_to_num(context.lengths(rows) / path.vel, posinf=0.0, neginf=0.0), 0, 1e12)
    shortest_ms = np.where(path.op == Op.DWELL, np.nan_to_num(path.dwell_ms), moving)
    behind = np.cumsum(1 - shortest_ms * rate / 1e3)
    lowest = np.minimum.accumulate(np.concatenate([[0.0], behind]))[:-1]
    empty = np.flatnonzero(behind - lowest > ranges.FIFO_SLOTS)
    if len(empty):
        # The first row of each stretch in which the FIFO runs empty.
        begins = empty[np.concatenate([[True], np.diff(lowest[empty]) != 0])]
        start = np.searchsorted(-np.minimum.accumulate(behind), -lowest[begins])
        report.rows(rules.FIFO_MAY_RUN_EMPTY, begins, "", calls=begins - start, rate=rate, slots=ranges.FIFO_SLOTS)


def may_be_slow(context: LintContext) -> bool:
    """Whether some mark may be too short for its velocity; if so, only the planner can tell.

    No segment of such a mark reaches the velocity from rest to rest.
    """
    return any(_may_be_slow(context, channel) for channel in CHANNELS if len(context.modal.switches(channel)))


def _may_be_slow(context: LintContext, channel: int) -> bool:
    """Whether some part of a mark of a channel, at one velocity, has segments but none that reaches the velocity."""
    path, modal = context.path, context.modal
    is_marked = modal.laser(channel).on & ~modal.follows_velocity(channel)
    rows = np.flatnonzero(path.moves & (path.op != Op.JUMP) & is_marked)
    if not len(rows):
        return False
    reaches, has_length = np.empty(len(rows), dtype=np.bool_), np.empty(len(rows), dtype=np.bool_)
    for block in blocks(len(rows)):
        own = rows[block]
        length, vel, acc = context.lengths(own), path.vel[own], path.acc[own]
        reaches[block] = np.minimum(np.sqrt(acc * length), vel) >= REACHES * _MARGIN * vel
        has_length[block] = length > 0
    firsts = np.flatnonzero(part_begins(modal, channel, rows, picked(path.vel, rows))[1])
    return bool((np.logical_or.reduceat(has_length, firsts) & ~np.logical_or.reduceat(reaches, firsts)).any())


def dwells(context: LintContext, report: Reporter) -> None:
    """DWELL: whole ms in range."""
    rows = context.rows(Op.DWELL)
    report.rows_in_range(rows, context.path.dwell_ms[rows], ranges.DWELL_MS, "DWELL", "value")


def forced_ends(context: LintContext, report: Reporter) -> None:
    """END: in range, not above VEL."""
    path, shown = context.path, context.shown
    rows = np.flatnonzero(~np.isnan(path.end) & path.moves)
    rows = rows[report.rows_in_range(rows, path.end[rows], ranges.END_VELOCITY, "END", "END")]
    above = rows[exceeds(path.end[rows], path.vel[rows]) & context.known_after(rows, StateEffect.VEL)]
    ends, velocities = path.end[above] * shown.per_pulse_per_ms, path.vel[above] * shown.per_pulse_per_ms
    report.rows(rules.END_ABOVE_VEL, above, "END", value=ends, velocity=velocities, speed=shown.speed)
