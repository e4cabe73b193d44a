"""Laser switching: laser left on, laser on during a jump, marks without a power, delays that are too long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import Op
from gusjob.ir.setup import LaserDelay, LaserFpk
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter


def left_on(context: LintContext, report: Reporter) -> None:
    """The job ends with every channel off."""
    for channel in CHANNELS:
        laser = context.modal.laser(channel)
        if laser.on_at_end:
            hint = f" CHANNEL {channel}" if channel else ""
            report.line(rules.LEFT_ON, laser.last_on_line, channel=channel, hint=hint)


def jumps(context: LintContext, report: Reporter) -> None:
    """JUMP is a move with the laser off."""
    rows = context.rows(Op.JUMP)
    for channel in CHANNELS:
        laser = context.modal.laser(channel)
        bad = rows[laser.on[rows]]
        remarks = context.line_remarks(d.ON_HERE, laser.on_line[bad])
        report.rows(rules.JUMP_WITH_LASER_ON, bad, "", channel=channel, remarks=remarks)


def dwells(context: LintContext, report: Reporter) -> None:
    """A dwell inside a mark burns a point; at the start of a mark it pierces."""
    path, rows = context.path, context.rows(Op.DWELL)
    if not len(rows):
        return
    moved, sky = np.concatenate([[0], np.cumsum(path.moves)]), context.job.sky_writing_by_row()[0]
    for channel in CHANNELS:
        laser = context.modal.laser(channel)
        own = rows[laser.on[rows]]
        begins = np.flatnonzero(laser.on & ~np.concatenate([[False], laser.on[:-1]]))
        ends = np.flatnonzero(laser.on & ~np.concatenate([laser.on[1:], [False]])) + 1
        number = np.searchsorted(begins, own, side="right") - 1
        # Under sky writing a dwell with the laser on is an error anyway.
        bad = own[(moved[own] > moved[begins[number]]) & (moved[ends[number]] > moved[own]) & (sky[own] < 0)]
        remarks = context.line_remarks(d.ON_HERE, laser.on_line[bad])
        report.rows(rules.DWELL_WITH_LASER_ON, bad, "", channel=channel, remarks=remarks)


def waits(context: LintContext, report: Reporter) -> None:
    """A laser that is on at the end of a stage stays on until the next stage moves."""
    sky = context.job.sky_writing_by_row()[0]  # Under it this is an error anyway.
    opening = zip(context.job.setups, opens_stage(context.job), strict=True)
    stops = [s for s, opens in opening if opens and sky[s.row - 1] < 0]
    instants = np.array([s.row * 2 for s in stops], dtype=np.intp)
    for channel in CHANNELS:
        # LASER OFF NOW can end a mark, too.
        switches = context.modal.switches(channel)
        for i in np.flatnonzero(switches.on_at(instants) & switches.on_at(instants + 1)).tolist():
            report.setup(rules.WAIT_WITH_LASER_ON, stops[i], word=stops[i].word, channel=channel)


def switching(context: LintContext, report: Reporter) -> None:
    """LASER ON that changes nothing, and LASER ON and OFF with nothing between."""
    timed = np.concatenate([[0], np.cumsum(context.path.takes_time)])
    for channel in CHANNELS:
        switches = context.modal.switches(channel)
        if not len(switches):
            continue
        on, buffered = switches.on, switches.is_buffered
        before = np.concatenate([[False], on[:-1]])
        begin = switches.line[np.maximum.accumulate(np.where(on & ~before, np.arange(len(on)), 0))]
        again = np.flatnonzero(on & before & buffered)
        remarks = context.line_remarks(d.ON_HERE, begin[again])
        report.rows(rules.ALREADY_ON, switches.rows[again], "", channel=channel, remarks=remarks)
        timed_before = timed[(switches.instant + 1) // 2]
        nothing = timed_before[:-1] == timed_before[1:]
        empty = np.flatnonzero(on[:-1] & ~on[1:] & nothing & buffered[:-1] & buffered[1:])
        report.rows(rules.LASER_ON_WITHOUT_MOTION, switches.rows[empty], "", channel=channel)


def marked_twice(context: LintContext, report: Reporter) -> None:
    """The same segment is marked with the same power from two lines of the job; passes of a loop are intended."""
    path = context.path
    for channel in CHANNELS:
        rows = np.flatnonzero(path.moves & context.modal.laser(channel).on)
        if len(rows) < 2:
            continue
        key, has_length = _segment_keys(context, rows, channel)
        ascending = np.sort(key)
        if not (ascending[1:] == ascending[:-1]).any():
            continue
        order = np.argsort(key, kind="stable")
        same = key[order][1:] == key[order][:-1]
        first = order[np.maximum.accumulate(np.where(np.concatenate([[True], ~same]), np.arange(len(order)), 0))]
        again = np.flatnonzero((path.line[rows[order]] != path.line[rows[first]]) & (order != first))
        again = again[has_length[order[again]]]
        again = again[np.argsort(order[again])]
        remarks = context.line_remarks(d.FIRST_HERE, path.line[rows[first[again]]])
        report.rows(rules.MARKED_TWICE, rows[order[again]], "", remarks=remarks)


def _segment_keys(
    context: LintContext, rows: Indices, channel: int
) -> tuple[npt.NDArray[np.uint64], npt.NDArray[np.bool_]]:
    """A key of each motion, (k,): equal where shape (in whole pulses, either direction) and power are equal.

    With it whether the motion has a length; a full circle has one.
    """
    path = context.path
    ax, ay, bx, by = (np.rint(v) for v in path.ends(rows))
    reverse = (ax > bx) | ((ax == bx) & (ay > by))
    low_x, high_x = np.where(reverse, bx, ax), np.where(reverse, ax, bx)
    low_y, high_y = np.where(reverse, by, ay), np.where(reverse, ay, by)
    not_line = path.op[rows] != Op.LINE
    parts = [low_x, low_y, high_x, high_y, _dose_keys(context, channel)[rows]]
    if not_line.any():
        bend = np.where(path.ccw[rows] != reverse, 1.0, -1.0)
        arc = [np.rint(np.nan_to_num(v[rows])) for v in (path.cx, path.cy, path.radius)]
        parts += [np.where(not_line, v, 0.0) for v in (*arc, bend)]
    return _hashed(parts), (low_x != high_x) | (low_y != high_y) | not_line


def _dose_keys(context: LintContext, channel: int) -> Floats:
    """A key of each row, (n,): equal where mode, power and velocity are equal."""
    path = context.path
    mode = np.zeros(len(path))
    for span in context.modal.modes(channel):
        key = (span.mode.mode, span.mode.carrier_khz, span.mode.pulse_width_us)
        mode[span.first : span.last] = hash(key) % 1_000_003
    return _hashed([_power_keys(context, channel), mode, np.nan_to_num(path.vel)]).astype(np.float64)


def _power_keys(context: LintContext, channel: int) -> Floats:
    """A key of each row, (n,): equal where the same power is in force."""
    path = context.path
    sets = np.flatnonzero(path.sets_power & (path.channel == channel))
    if not len(sets):
        return np.zeros(len(path))
    values = [np.nan_to_num(v[sets]) for v in (path.power, path.low, path.high, path.ratio)]
    at = np.searchsorted(sets, np.arange(len(path)), side="left") - 1
    return np.where(at >= 0, _hashed(values).astype(np.float64)[at], 0.0)


def _hashed(columns: list[Floats]) -> npt.NDArray[np.uint64]:
    """Hash the rows of some columns: equal rows have equal hashes, others hardly ever."""
    mixed = np.zeros(len(columns[0]), dtype=np.uint64)
    for column in columns:
        bits = np.ascontiguousarray(column + 0.0).view(np.uint64)
        mixed = (mixed ^ bits) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def delays_against_path(context: LintContext, report: Reporter) -> None:
    """Delays that are longer than what they belong to.

    An on delay longer than the whole mark: emission begins when the mark is over, or not at all. An off delay longer
    than the path to the next mark: emission does not stop between. Both against the longest time of the path.
    """
    path = context.path
    timed = np.flatnonzero(path.takes_time)
    sky = np.append(context.job.sky_writing_by_row()[0] >= 0, False)  # It compensates for delays.
    for channel in CHANNELS:
        switches, delays = context.modal.switches(channel), _delays_in_force(context, channel)
        if len(delays.instant) == 1 or len(switches) < 2:
            continue
        on, rows = switches.on, switches.rows
        times_ms = np.concatenate([[0.0], np.cumsum(_longest_ms(context, timed))])
        most_us = np.diff(times_ms[np.searchsorted(timed, (switches.instant + 1) // 2)]) * US_PER_MS
        force = delays.at(switches.instant[:-1])
        on_us, off_us = delays.on_us[force], delays.off_us[force]
        buffered = switches.is_buffered & np.concatenate([[True], switches.is_buffered[1:]])
        checked = buffered[:-1] & ~sky[rows[:-1]] & (most_us > 0)
        marks = np.flatnonzero(on[:-1] & ~on[1:] & (on_us > most_us) & checked)
        for no_emission, lost in (
            (True, Phrase("there is no emission")),
            (False, Phrase("emission begins after the mark")),
        ):
            which = marks[(on_us[marks] >= most_us[marks] + off_us[marks]) == no_emission]
            fields = {"on": on_us[which], "most": np.round(most_us[which], 3), "lost": lost}
            report.rows(rules.DELAY_LONGER_THAN_MARK, rows[which], "", **fields)
        gaps = np.flatnonzero(~on[:-1] & on[1:] & (off_us >= most_us + on_us) & (off_us > 0) & checked)
        fields = {"off": off_us[gaps], "on": on_us[gaps], "most": np.round(most_us[gaps], 3)}
        report.rows(rules.DELAY_LONGER_THAN_JUMP, rows[gaps], "", **fields)


@dataclass(frozen=True, slots=True, kw_only=True)
class DelaysInForce:
    """Delay of emission after laser-on and laser-off, (k,) each: from an instant on, ascending."""

    instant: Indices
    on_us: Floats
    off_us: Floats

    def at(self, instants: Indices) -> Indices:
        """Number of the delays in force at some instants."""
        return np.searchsorted(self.instant, instants, side="right") - 1


def _delays_in_force(context: LintContext, channel: int) -> DelaysInForce:
    """Delays of a channel: LASER DELAY and first pulse killer together."""
    instants, on_us, off_us = [-1], [0.0], [0.0]
    delay, killer = (0.0, 0.0), (0.0, 0.0)
    for setup in context.job.setups:
        if setup.channel != channel:
            continue
        match setup.statement:
            case LaserDelay(on_delay_us=on, off_delay_us=off):
                delay = (on, off)
            case LaserFpk(times_us=times):
                killer = (0.0, 0.0) if times is None else (times[1], times[2])
            case _:
                continue
        instants.append(context.modal.stage_first[setup.order] * 2)
        on_us.append(delay[0] + killer[0])
        off_us.append(delay[1] + killer[1])
    return DelaysInForce(instant=np.array(instants, dtype=np.intp), on_us=np.array(on_us), off_us=np.array(off_us))


def _longest_ms(context: LintContext, rows: Indices) -> Floats:
    """The longest time that rows can take: from rest to rest."""
    path = context.path
    length, vel, acc = context.lengths(rows), path.vel[rows], path.acc[rows]
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = length * acc >= vel * vel
        moving = np.where(reached, length / vel + vel / acc, 2 * np.sqrt(length / acc))
    return np.where(
        path.op[rows] == Op.DWELL,
        np.nan_to_num(path.dwell_ms[rows]),
        np.clip(np.nan_to_num(moving, posinf=1e12), 0, 1e12),
    )


def no_power(context: LintContext, report: Reporter) -> None:
    """A channel emits, in a motion or dwell or by its delays alone, without a power since its mode was set."""
    path = context.path
    for channel in CHANNELS:
        offs = np.flatnonzero((path.op == Op.OFF) & (path.channel == channel))
        delays = _delays_in_force(context, channel)
        force = delays.at(offs * 2)
        may_emit = path.takes_time.copy()
        may_emit[offs[delays.off_us[force] > delays.on_us[force]]] = True
        emitting = np.flatnonzero(may_emit)
        laser, powers = context.modal.laser(channel), context.modal.power_instants(channel)
        changed = None
        for span in context.modal.modes(channel):
            # A LASER MODE that repeats the mode in force keeps the power.
            changed = span if changed is None or changed.mode.mode is not span.mode.mode else changed
            rows = emitting[slice(*np.searchsorted(emitting, [span.first, span.last]))]
            rows = rows[laser.on[rows]]
            if not len(rows):
                continue
            last = np.searchsorted(powers, rows * 2, side="right") - 1
            unset = last < 0
            if len(powers):
                unset |= powers[last] < changed.first * 2
            for line in sorted(set(laser.on_line[rows[unset]].tolist())):
                report.line(rules.NO_POWER, line, channel=channel, remarks=context.mode_remark(changed))
