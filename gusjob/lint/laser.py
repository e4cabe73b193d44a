"""Laser switching: laser left on, laser on during a jump, marks without a power, delays that are too long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import POSITION, StateEffect, is_known
from gusjob.ir.path import Op, Path
from gusjob.ir.setup import LaserDelay, LaserFpk, PowerNow
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.arrays import Bools, Floats, Indices, hashed
from gusjob.kinematics.units import US_PER_MS
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter


def left_on(context: LintContext, report: Reporter) -> None:
    """The job ends with every channel off."""
    for channel in CHANNELS:
        laser = context.modal.laser(channel)
        if laser.on_at_end and is_known(context.job.unknown_at_end, StateEffect.SWITCH, channel):
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
        report.rows(rules.DWELL_WITH_LASER_ON, bad, "", word="DWELL", channel=channel, remarks=remarks)


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
            if is_known(stops[i].unknown, StateEffect.SWITCH, channel):
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
        again = again[context.known(switches.rows[again], StateEffect.SWITCH, channel)]
        remarks = context.line_remarks(d.ON_HERE, begin[again])
        report.rows(rules.ALREADY_ON, switches.rows[again], "", channel=channel, word="LASER OFF", remarks=remarks)
        timed_before = timed[(switches.instant + 1) // 2]
        nothing = timed_before[:-1] == timed_before[1:]
        empty = np.flatnonzero(on[:-1] & ~on[1:] & nothing & buffered[:-1] & buffered[1:])
        report.rows(rules.LASER_ON_WITHOUT_MOTION, switches.rows[empty], "", channel=channel)


def marked_twice(context: LintContext, report: Reporter) -> None:
    """The same segment is marked with the same power from two lines of the job; passes of a loop are intended."""
    for channel in CHANNELS:
        found = repeated_marks(context, channel)
        found = found.pick(_is_certain(context, found.rows, channel) & _is_certain(context, found.first, channel))
        _report_repeated(context, report, found.pick(found.from_another_line(context.path)))


def _is_certain(context: LintContext, rows: Indices, channel: int) -> Bools:
    """Whether position, power and velocity of some marks are known."""
    where = context.known(rows, StateEffect.POWER | StateEffect.MODE | POSITION, channel)
    return where & context.known_after(rows, POSITION | StateEffect.VEL)


def marked_twice_outside_passes(context: LintContext, report: Reporter) -> None:
    """The same segment is marked with the same power, and not in a pass: calls do not show loops."""
    for channel in CHANNELS:
        found = repeated_marks(context, channel)
        _report_repeated(context, report, found.pick(~found.in_pass))


def _report_repeated(context: LintContext, report: Reporter, found: RepeatedMarks) -> None:
    remarks = context.line_remarks(d.FIRST_HERE, context.path.line[found.first])
    report.rows(rules.MARKED_TWICE, found.rows, "", remarks=remarks)


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatedMarks:
    """Marked segments that were marked before with the same power and velocity, (k,) in order.

    `first`: the row that marked the segment first. `in_pass`: several segments are repeated in their order and
    direction, from the first to the last, as by another pass of a loop; or a closed segment is repeated at once.
    """

    rows: Indices
    first: Indices
    in_pass: Bools

    def pick(self, where: Bools) -> RepeatedMarks:
        """Pick the repeated segments at a mask."""
        return RepeatedMarks(rows=self.rows[where], first=self.first[where], in_pass=self.in_pass[where])

    def from_another_line(self, path: Path) -> Bools:
        """Whether the segment was marked first from another line, (k,)."""
        return np.asarray(path.line[self.rows] != path.line[self.first])


def repeated_marks(context: LintContext, channel: int) -> RepeatedMarks:
    """Find the marks of a channel that repeat an earlier one."""
    rows = np.flatnonzero(context.path.moves & context.modal.laser(channel).on)
    nothing = np.empty(0, dtype=np.intp)
    if len(rows) < 2:
        return RepeatedMarks(rows=nothing, first=nothing, in_pass=nothing.astype(np.bool_))
    keys = _segment_keys(context, rows, channel)
    ascending = np.sort(keys.shape)
    if not (ascending[1:] == ascending[:-1]).any():
        return RepeatedMarks(rows=nothing, first=nothing, in_pass=nothing.astype(np.bool_))
    order = np.argsort(keys.shape, kind="stable")
    fresh = np.concatenate([[True], keys.shape[order][1:] != keys.shape[order][:-1]])
    first = np.empty(len(rows), dtype=np.intp)
    first[order] = order[np.maximum.accumulate(np.where(fresh, np.arange(len(order)), 0))]
    again = np.flatnonzero((first != np.arange(len(rows))) & keys.has_length)
    in_pass = _in_passes(keys, order, fresh)[again]
    return RepeatedMarks(rows=rows[again], first=rows[first[again]], in_pass=in_pass)


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


def _segment_keys(context: LintContext, rows: Indices, channel: int) -> _SegmentKeys:
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
    shape, closed = hashed(parts), (ax == bx) & (ay == by)
    directed = shape + reverse.astype(np.uint64)
    return _SegmentKeys(shape=shape, directed=directed, has_length=~closed | not_line, closed=closed)


def _dose_keys(context: LintContext, channel: int) -> Floats:
    """A key of each row, (n,): equal where mode, power and velocity are equal."""
    path = context.path
    mode = np.zeros(len(path))
    for span in context.modal.modes(channel):
        key = (span.mode.mode, span.mode.carrier_khz, span.mode.pulse_width_us)
        mode[span.first : span.last] = hash(key) % 1_000_003
    return hashed([_power_keys(context, channel), mode, np.nan_to_num(path.vel)]).astype(np.float64)


def _power_keys(context: LintContext, channel: int) -> Floats:
    """A key of each row, (n,): equal where the same power is in force."""
    path = context.path
    rows = np.flatnonzero(path.sets_power & (path.channel == channel))
    now = [(setup, power) for setup, power in context.modal.statements(PowerNow) if setup.channel == channel]
    at_rest = np.array([context.modal.stage_first[setup.order] * 2 for setup, _ in now], dtype=np.intp)
    instants = np.concatenate([rows * 2 + 1, at_rest])
    if not len(instants):
        return np.zeros(len(path))
    power = np.concatenate([path.power[rows], [power.power for _, power in now]])
    follow = [np.concatenate([v[rows], np.full(len(now), np.nan)]) for v in (path.low, path.high, path.ratio)]
    order = np.argsort(instants, kind="stable")
    keys = hashed([np.nan_to_num(v[order]) for v in (power, *follow)]).astype(np.float64)
    at = np.searchsorted(instants[order], np.arange(len(path)) * 2 + 1, side="left") - 1
    return np.where(at >= 0, keys[at], 0.0)


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
        checked = buffered[:-1] & ~sky[rows[:-1]] & (most_us > 0) & np.all(report.is_sound(delays.lines)[force], axis=1)
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
        report.rows(rules.DELAY_LONGER_THAN_JUMP, rows[gaps], "", word="LASER ON", **fields)


@dataclass(frozen=True, slots=True, kw_only=True)
class DelaysInForce:
    """Delay of emission after laser-on and laser-off, (k,) each: from an instant on, ascending.

    `lines`: (k, 2), those of LASER DELAY and LASER FPK in force, 0 without one.
    """

    instant: Indices
    on_us: Floats
    off_us: Floats
    lines: npt.NDArray[np.intp]

    def at(self, instants: Indices) -> Indices:
        """Number of the delays in force at some instants."""
        return np.searchsorted(self.instant, instants, side="right") - 1


def _delays_in_force(context: LintContext, channel: int) -> DelaysInForce:
    """Delays of a channel: LASER DELAY and first pulse killer together."""
    instants, on_us, off_us, lines = [-1], [0.0], [0.0], [(0, 0)]
    delay, killer = (0.0, 0.0), (0.0, 0.0)
    for setup in context.job.setups:
        if setup.channel != channel:
            continue
        match setup.statement:
            case LaserDelay(on_delay_us=on, off_delay_us=off):
                delay = (on, off)
                lines.append((setup.line, lines[-1][1]))
            case LaserFpk(times_us=times):
                killer = (0.0, 0.0)
                lines.append((lines[-1][0], setup.line))
                if times is not None:
                    killer = (times[1], times[2])
            case _:
                continue
        instants.append(context.modal.stage_first[setup.order] * 2)
        on_us.append(delay[0] + killer[0])
        off_us.append(delay[1] + killer[1])
    return DelaysInForce(
        instant=np.array(instants, dtype=np.intp),
        on_us=np.array(on_us),
        off_us=np.array(off_us),
        lines=np.array(lines, dtype=np.intp),
    )


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
            rows = rows[context.known(rows, StateEffect.POWER | StateEffect.MODE, channel)]
            if not len(rows):
                continue
            last = np.searchsorted(powers, rows * 2, side="right") - 1
            unset = last < 0
            if len(powers):
                unset |= powers[last] < changed.first * 2
            for line in sorted(set(laser.on_line[rows[unset]].tolist())):
                report.line(rules.NO_POWER, line, channel=channel, remarks=context.mode_remark(changed))
