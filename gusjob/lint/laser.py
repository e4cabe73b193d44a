"""Laser switching: laser left on, laser on during a jump, marks without a power, marks made twice."""

from __future__ import annotations

import numpy as np

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.ir.effects import StateEffect, is_known
from gusjob.ir.path import Op
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.arrays import blocks
from gusjob.lint.context import LintContext
from gusjob.lint.delays import delays_in_force
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


def no_power(context: LintContext, report: Reporter) -> None:
    """A channel emits, in a motion or dwell or by its delays alone, without a power since its mode was set."""
    path = context.path
    for channel in CHANNELS:
        offs = np.flatnonzero((path.op == Op.OFF) & (path.channel == channel))
        delays = delays_in_force(context, channel)
        force = delays.at(offs * 2)
        may_emit = path.takes_time.copy()
        may_emit[offs[~delays.never_emits(force, np.zeros(len(offs)))]] = True
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
            lines = set[int]()
            for part in blocks(len(rows)):
                last = np.searchsorted(powers, rows[part] * 2, side="right") - 1
                unset = last < 0
                if len(powers):
                    unset |= powers[last] < changed.first * 2
                lines.update(laser.on_line[rows[part][unset]].tolist())
            for line in sorted(lines):
                report.line(rules.NO_POWER, line, channel=channel, remarks=context.mode_remark(changed))
