"""Laser switching: laser left on, laser on during a jump, marks without a power, delays that are too long."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import StateEffect, is_known
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
    """A dwell burns a point, but at the start of a mark, before any motion, it pierces."""
    rows = context.rows(Op.DWELL)
    if not len(rows):
        return
    moved, sky = np.concatenate([[0], np.cumsum(context.path.moves)]), context.job.sky_writing_by_row()[0]
    for channel in CHANNELS:
        laser = context.modal.laser(channel)
        # Under sky writing a dwell with the laser on is an error anyway.
        own = rows[laser.on[rows] & (sky[rows] < 0)]
        begins = context.modal.switches(channel).begins
        begin = (begins[np.searchsorted(begins, own * 2, side="right") - 1] + 1) // 2
        bad = own[moved[own] > moved[begin]]
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
                delay, lines = (on, off), [*lines, (setup.line, lines[-1][1])]
            case LaserFpk(times_us=times):
                killer, lines = (0.0, 0.0), [*lines, (lines[-1][0], setup.line)]
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
