"""Sky writing: its numbers, and what it can't be combined with."""

from __future__ import annotations

import math

import numpy as np

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import StateEffect, is_known
from gusjob.ir.path import Op
from gusjob.ir.setup import Setup, SkyWrite, SkyWriting, SwitchNow
from gusjob.ir.stages import opens_stage
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter

_LAG_SLACK = 0.2
"""Share of a scanner's tracking error by which TIMELAG may differ from it: more than tuning changes it."""

_NPREV, _NPOST = Phrase("NPREV, in steps of 10 us,"), Phrase("NPOST, in steps of 10 us,")


def settings(context: LintContext, report: Reporter) -> None:
    """SKYWRITE: ranges, and numbers that do not go together."""
    follows = bool((context.path.op == Op.FOLLOW).any())
    scanner = context.machine.scanner
    for setup, statement in context.modal.statements(SkyWrite):
        sky = statement.settings
        if sky is None or not _in_range(report, setup, sky):
            continue
        _together(report, setup, sky)
        if follows and sky.is_on and sky.run_out_us < sky.lag_us - ranges.RUN_STEP_US / 2:
            least = math.ceil(sky.lag_us / ranges.RUN_STEP_US)
            report.setup(rules.SKY_RUN_OUT, setup, run_out=sky.run_out_us, timelag=sky.lag_us, least=least)
        if scanner is not None and sky.is_on:
            lag_us = scanner.tracking_error_us
            off_us = abs(sky.lag_us - lag_us)
            if off_us > _LAG_SLACK * lag_us:
                report.setup(rules.SKY_TIMELAG_MISMATCH, setup, "TIMELAG", value=sky.timelag_us, lag=lag_us, off=off_us)


def _in_range(report: Reporter, setup: Setup, sky: SkyWriting) -> bool:
    good = report.in_range(setup, sky.mode, ranges.SKYWRITE_MODE, "SKYWRITE MODE", "MODE")
    if report.in_range(setup, sky.timelag_us, ranges.TIMELAG_US, "TIMELAG", "TIMELAG"):
        good &= report.in_range(setup, sky.nprev, ranges.RUN_STEPS, _NPREV, "NPREV")
        good &= report.in_range(setup, sky.npost, ranges.RUN_STEPS, _NPOST, "NPOST")
    else:
        good = False
    good &= report.in_range(setup, sky.limit, ranges.CORNER_LIMIT, "LIMIT", "LIMIT")
    if not report.in_range(setup, sky.shift_us, ranges.SHIFT_US, "SHIFT", "SHIFT"):
        return False
    if sky.shift_us % ranges.SHIFT_STEP_US:
        report.setup(rules.SKY_STEP, setup, "SHIFT", value=sky.shift_us)
    return good


def _together(report: Reporter, setup: Setup, sky: SkyWriting) -> None:
    if not sky.is_on:
        report.setup(rules.SKY_OFF, setup, "TIMELAG", value=sky.timelag_us)
        return
    if sky.mode != 3 and sky.limit_given:
        report.setup(rules.SKY_NO_LIMIT, setup, "LIMIT", mode=int(sky.mode))
    early = sky.on_us - (sky.lag_us + sky.shift_us)
    if early > 0:
        report.setup(rules.SKY_SHIFT, setup, "SHIFT", value=sky.shift_us, early=early, least=sky.shift_us + early)
    elif -sky.shift_us > sky.run_in_us:
        early, least = -sky.shift_us - sky.run_in_us, math.ceil(-sky.shift_us / ranges.RUN_STEP_US)
        report.setup(rules.SKY_SHIFT_RAMP, setup, "SHIFT", value=sky.shift_us, early=early, least=least)


def laser_changes(context: LintContext, report: Reporter) -> None:
    """Under sky writing the laser is switched along the path, and a mark is sky-written as a whole."""
    sky = context.job.sky_writing_by_row()[0] >= 0
    sky &= np.asarray(is_known(context.path.unknown_before, StateEffect.SKY))
    if not sky.any():
        return
    for setup, _ in context.modal.statements(SkyWrite):
        _changed_in_mark(context, report, setup)
    for setup, switch in context.modal.statements(SwitchNow):
        if switch.on and sky[min(context.modal.stage_first[setup.order], len(sky) - 1)]:
            report.setup(rules.SKY_NOW, setup)
    opening = zip(context.job.setups, opens_stage(context.job), strict=True)
    stops = [s for s, opens in opening if opens and s.row > 0 and sky[s.row - 1]]
    instants = np.array([s.row * 2 for s in stops], dtype=np.intp)
    for channel in CHANNELS:
        for i in np.flatnonzero(context.modal.switches(channel).on_at(instants)).tolist():
            if is_known(stops[i].unknown, StateEffect.SWITCH, channel):
                report.setup(rules.SKY_STAGE, stops[i], word=stops[i].word, channel=channel)
        laser = context.modal.laser(channel)
        dwells = np.flatnonzero((context.path.op == Op.DWELL) & laser.on & sky)
        remarks = context.line_remarks(d.ON_HERE, laser.on_line[dwells])
        report.rows(rules.SKY_DWELL, dwells, "", channel=channel, remarks=remarks)


def _changed_in_mark(context: LintContext, report: Reporter, setup: Setup) -> None:
    for channel in CHANNELS:
        is_on = context.modal.switches(channel).on_at(np.array([setup.row * 2 + 1]))[0]
        if is_on and is_known(setup.unknown, StateEffect.SWITCH, channel):
            on_line = context.modal.laser(channel).on_line[max(setup.row - 1, 0) : max(setup.row, 1)]
            report.setup(
                rules.SKY_LASER_ON, setup, remarks=context.line_remarks(d.ON_HERE, on_line)(0), channel=channel
            )


def forced_ends(context: LintContext, report: Reporter) -> None:
    """No END on a mark under sky writing."""
    path = context.path
    number, _ = context.job.sky_writing_by_row()
    forced = np.flatnonzero((number >= 0) & ~np.isnan(path.end) & path.moves)
    forced = forced[context.known(forced, StateEffect.SKY)]
    report.rows(rules.SKY_END, forced[context.modal.any_on()[forced]], "END")
