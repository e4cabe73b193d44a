"""Motion: velocities, accelerations, field, arcs, dwells, forced end velocities."""

from __future__ import annotations

import numpy as np

from gusjob.controllers.gus import ranges
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import SPEED_WORDS, Op, arcs_mm
from gusjob.kinematics.arrays import Indices
from gusjob.kinematics.geometry import CLOSES_MM, arcs_by_either
from gusjob.lint.view import CHANNELS, Findings, View


def speeds(view: View, findings: Findings) -> None:
    """Every velocity and acceleration that is written is positive and within the machine's limits."""
    machine, written = view.machine, view.job.speeds
    for number, word in enumerate(SPEED_WORDS):
        is_acc = bool(number % 2)
        allowed = ranges.ACCELERATION if is_acc else ranges.VELOCITY
        limit, unit = _machine_limit(view, acceleration=is_acc)
        at = np.flatnonzero(written.word == number)
        value, in_mm = written.value[at], written.in_mm[at]
        mm = value * (1e6 if is_acc else 1e3) / machine.pulses_per_mm[0]
        outside = allowed.classify(value) > 0
        fast = ~outside & (mm > limit * (1 + 1e-9)) & (in_mm | machine.equal_axes)
        places = written.line[at], written.provenance[at], np.where(written.inline[at], word, "value")
        for rule, bad, values, fields in (
            (rules.TOO_FAST, fast, mm, {"unit": unit, "limit": limit}),
            (rules.OUT_OF_RANGE, outside, value, {"unit": allowed.unit, "range": str(allowed), "hint": ""}),
        ):
            findings.at_places(rule, *(p[bad] for p in places), what=word, value=values[bad], **fields)


def given_speeds(view: View, findings: Findings) -> None:
    """A move has a velocity and an acceleration."""
    path = view.job.path
    rows = np.flatnonzero(path.moves)
    for values, missing in ((path.vel, rules.NO_VELOCITY), (path.acc, rules.NO_ACCELERATION)):
        absent = rows[np.isnan(values[rows])]
        if len(absent):
            findings.at_rows(missing, absent[:1], "", word=Op(int(path.op[absent[0]])).word)


def speeds_along(view: View, findings: Findings) -> None:
    """Where the axes differ, a velocity in pulses is another one in mm for each direction."""
    path, machine = view.job.path, view.machine
    if machine.equal_axes:
        return
    px, py = machine.pulses_per_mm
    rows = np.flatnonzero(path.moves)
    dx = path.x[rows] - np.concatenate([[0.0], path.x])[rows]
    dy = path.y[rows] - np.concatenate([[0.0], path.y])[rows]
    chord = np.hypot(dx, dy)
    with np.errstate(divide="ignore", invalid="ignore"):
        mm_per_pulse = np.where(chord > 0, np.hypot(dx / px, dy / py) / chord, 0.0)
    round_ = path.op[rows] != Op.LINE
    round_ &= path.op[rows] != Op.JUMP
    mm_per_pulse[round_] = 1 / min(px, py)  # An arc goes in many directions.
    for values, in_mm, lines, word in (
        (path.vel, path.vel_in_mm, path.vel_line, "VEL"),
        (path.acc, path.acc_in_mm, path.acc_line, "ACC"),
    ):
        limit, unit = _machine_limit(view, acceleration=word == "ACC")
        mm = values[rows] * mm_per_pulse * (1e6 if word == "ACC" else 1e3)
        fast = np.flatnonzero(~in_mm[rows] & (mm > limit * (1 + 1e-9)))
        # A modal value is one diagnostic, where it was set.
        _, first = np.unique(lines[rows[fast]], return_index=True)
        for i in fast[first].tolist():
            line = int(lines[rows[i]])
            place = word if view.job.locate(line, word) != view.job.locate(line, "") else "value"
            findings.add(
                rules.TOO_FAST, line, place, trail=int(path.provenance[rows[i]]), what=word,
                value=float(mm[i]), unit=unit,
                limit=limit,
            )  # fmt: skip


def _machine_limit(view: View, *, acceleration: bool) -> tuple[float, str]:
    machine = view.machine
    return (machine.max_acceleration_mm_s2, "mm/s2") if acceleration else (machine.max_velocity_mm_s, "mm/s")


def field(view: View, findings: Findings) -> None:
    """Every move stays in the machine's field, arcs with all of their bulge."""
    path, machine = view.job.path, view.machine
    rows = np.flatnonzero(path.moves)
    for axis, values, (low, high), scale in (
        ("X", path.x, machine.field_x_mm, machine.pulses_per_mm[0]),
        ("Y", path.y, machine.field_y_mm, machine.pulses_per_mm[1]),
    ):
        place = values[rows] / scale
        out = (place < low) | (place > high)
        findings.at_rows(rules.OUTSIDE_FIELD, rows[out], axis, axis=axis, value=place[out], low=low, high=high, hint="")
        findings.ranged(rows, np.rint(values[rows]), ranges.COORDINATE_PULSE, axis, axis)
    arcs = view.rows(Op.ARC_CENTRE, Op.ARC_RADIUS)
    if not len(arcs):
        return
    x_low, x_high, y_low, y_high = arcs_mm(path, arcs, machine).extent()
    hint = Phrase(": the arc bulges out between its ends")
    for axis, near, far, (low, high), ends in (
        ("X", x_low, x_high, machine.field_x_mm, path.x[arcs] / machine.pulses_per_mm[0]),
        ("Y", y_low, y_high, machine.field_y_mm, path.y[arcs] / machine.pulses_per_mm[1]),
    ):
        slack = 1e-6
        ends_in = (ends >= low) & (ends <= high)
        below, above = ends_in & (near < low - slack), ends_in & (far > high + slack)
        for out, place in ((below, near), (above, far)):
            findings.at_rows(
                rules.OUTSIDE_FIELD, arcs[out], "", axis=axis, value=place[out], low=low, high=high, hint=hint
            )


def arcs_close(view: View, findings: Findings) -> None:
    """The end of an arc lies on its circle, and a radius reaches its end."""
    path, machine = view.job.path, view.machine
    px, py = machine.pulses_per_mm
    x0, y0 = np.concatenate([[0.0], path.x]) / px, np.concatenate([[0.0], path.y]) / py
    rows = view.rows(Op.ARC_CENTRE)
    if len(rows):
        cx, cy = path.cx[rows] / px, path.cy[rows] / py
        start = np.hypot(x0[rows] - cx, y0[rows] - cy)
        end = np.hypot(x0[rows + 1] - cx, y0[rows + 1] - cy)
        _bad_arc(findings, rows[start == 0], Phrase("the centre I J is the start point: the radius is 0"))
        for word, place in (("I", path.cx[rows] - x0[rows] * px), ("J", path.cy[rows] - y0[rows] * py)):
            findings.ranged(rows, np.rint(place), ranges.COORDINATE_PULSE, word, word)
        off = (np.abs(start - end) > CLOSES_MM) & (start > 0)
        findings.at_rows(rules.ARC_OFF, rows[off], "", end=end[off], start=start[off], limit=CLOSES_MM)
    rows = view.rows(Op.ARC_RADIUS)
    if len(rows):
        findings.ranged(rows, path.radius[rows], ranges.RADIUS_PULSE, "R", "R")
        radius = np.abs(path.radius[rows]) / px
        chord = np.hypot(x0[rows + 1] - x0[rows], y0[rows + 1] - y0[rows])
        _bad_arc(findings, rows[radius == 0], Phrase("the radius R is 0"))
        _bad_arc(
            findings,
            rows[(chord == 0) & (radius > 0)],
            Phrase("an arc with R that ends where it starts could be any circle: write it with I J"),
        )
        short = (2 * radius < chord - CLOSES_MM) & (radius > 0)
        least = chord[short] / 2
        findings.at_rows(rules.ARC_SHORT, rows[short], "R", value=radius[short], chord=chord[short], least=least)


def _bad_arc(findings: Findings, rows: Indices, reason: str) -> None:
    findings.at_rows(rules.BAD_ARC, rows, "", reason=reason)


def arc_speed(view: View, findings: Findings) -> None:
    """On an arc v^2/r stays within the machine's acceleration; the planner sees to it where it may."""
    path, machine = view.job.path, view.machine
    rows = view.rows(Op.ARC_CENTRE, Op.ARC_RADIUS)
    if not len(rows):
        return
    x0, y0 = view.starts()
    by_radius = path.op[rows] == Op.ARC_RADIUS
    ends = (x0[rows], y0[rows], path.x[rows], path.y[rows])
    radius = arcs_by_either(ends, path.cx[rows], path.cy[rows], path.radius[rows], path.ccw[rows], by_radius).radius
    limit = machine.max_acceleration_pulse_per_ms2
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = path.vel[rows] ** 2 / radius
    fast = (needed > limit * (1 + 1e-9)) & (radius > 0)
    shown = view.shown
    findings.at_rows(
        rules.ARC_TOO_FAST,
        rows[fast],
        "",
        velocity=path.vel[rows[fast]] * shown.per_pulse_per_ms,
        radius=radius[fast] * shown.per_pulse,
        value=needed[fast] * shown.per_pulse_per_ms2,
        limit=limit * shown.per_pulse_per_ms2,
        speed=shown.speed,
        length=shown.length,
        acceleration=shown.acceleration,
    )


def no_length(view: View, findings: Findings) -> None:
    """A mark that ends where it begins, in whole pulses."""
    path = view.job.path
    x0, y0 = view.starts()
    still = (path.op == Op.LINE) & (np.rint(path.x) == np.rint(x0)) & (np.rint(path.y) == np.rint(y0))
    if not still.any():
        return
    for channel in CHANNELS:
        rows = np.flatnonzero(still & view.lit(channel)[0])
        findings.at_rows(rules.NO_LENGTH, rows, "", word="LINE")
        still[rows] = False


def starving(view: View, findings: Findings) -> None:
    """Segments so short, so many in a row, that no host keeps the FIFO filled (where the profile says how fast it is).

    A host that sends a call each 1/rate falls behind by what a segment is shorter; 4096 slots are the reserve.
    """
    path, rate = view.job.path, view.machine.host_calls_per_s
    if rate is None or not len(path):
        return
    rows = np.arange(len(path))
    with np.errstate(divide="ignore", invalid="ignore"):
        moving = np.clip(np.nan_to_num(view.lengths(rows) / path.vel, posinf=0.0, neginf=0.0), 0, 1e12)
    shortest_ms = np.where(path.op == Op.DWELL, np.nan_to_num(path.dwell_ms), moving)
    behind = np.cumsum(1 - shortest_ms * rate / 1e3)
    lowest = np.minimum.accumulate(np.concatenate([[0.0], behind]))[:-1]
    empty = np.flatnonzero(behind - lowest > ranges.FIFO_SLOTS)
    if len(empty):
        # Of each stretch in which the FIFO runs empty, the place where it first does.
        begins = empty[np.concatenate([[True], np.diff(lowest[empty]) != 0])]
        start = np.searchsorted(-np.minimum.accumulate(behind), -lowest[begins])
        findings.at_rows(rules.STARVES, begins, "", calls=begins - start, rate=rate, slots=ranges.FIFO_SLOTS)


def dwells(view: View, findings: Findings) -> None:
    """DWELL: whole ms in range."""
    rows = view.rows(Op.DWELL)
    findings.ranged(rows, view.job.path.dwell_ms[rows], ranges.DWELL_MS, "DWELL", "value")


def forced_ends(view: View, findings: Findings) -> None:
    """END: in range, not above VEL."""
    path = view.job.path
    rows = np.flatnonzero(~np.isnan(path.end) & path.moves)
    good = findings.ranged(rows, path.end[rows], ranges.END_VELOCITY, "END", "END")
    rows = rows[good]
    above = rows[path.end[rows] > path.vel[rows] * (1 + 1e-12)]
    per_ms, speed = view.shown.per_pulse_per_ms, view.shown.speed
    ends, velocities = path.end[above] * per_ms, path.vel[above] * per_ms
    findings.at_rows(rules.END_ABOVE_VEL, above, "END", value=ends, velocity=velocities, speed=speed)
