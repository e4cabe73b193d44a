"""Sky writing: its numbers, and what it can't be used with."""

from __future__ import annotations

import math

import numpy as np

from gusjob.controllers.gus import ranges
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import Op
from gusjob.ir.setup import Setup, SkyWrite, SkyWriting, SwitchNow
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.arrays import Bools
from gusjob.lint.light import switched_on
from gusjob.lint.view import CHANNELS, Findings, View

_LAG_SLACK = 0.2
"""Share of a scanner's tracking error by which TIMELAG may miss it: what tuning makes of it, and more."""

_NPREV, _NPOST = Phrase("NPREV, in steps of 10 us,"), Phrase("NPOST, in steps of 10 us,")


def settings(view: View, findings: Findings) -> None:
    """SKYWRITE: ranges, and what its numbers say together."""
    follows = bool((view.job.path.op == Op.FOLLOW).any())
    for setup in view.setups(SkyWrite):
        assert isinstance(setup.statement, SkyWrite)
        sky = setup.statement.settings
        if sky is None or not _in_range(findings, setup, sky):
            continue
        _together(findings, setup, sky)
        if follows and sky.is_on and sky.run_out_us < sky.lag_us - ranges.RUN_STEP_US / 2:
            least = math.ceil(sky.lag_us / ranges.RUN_STEP_US)
            findings.at(rules.SKY_RUN_OUT, setup, run_out=sky.run_out_us, timelag=sky.lag_us, least=least)
        scanner = view.machine.scanner
        if scanner is not None and sky.is_on:
            off_us = abs(sky.lag_us - scanner.tracking_error_us)
            if off_us > _LAG_SLACK * scanner.tracking_error_us:
                lag_us = scanner.tracking_error_us
                findings.at(rules.SKY_LAG, setup, "TIMELAG", value=sky.timelag_us, lag=lag_us, off=off_us)


def _in_range(findings: Findings, setup: Setup, sky: SkyWriting) -> bool:
    good = findings.one(setup, sky.mode, ranges.SKYWRITE_MODE, "SKYWRITE MODE", "MODE")
    if findings.one(setup, sky.timelag_us, ranges.TIMELAG_US, "TIMELAG", "TIMELAG"):
        good &= findings.one(setup, sky.nprev, ranges.RUN_STEPS, _NPREV, "NPREV")
        good &= findings.one(setup, sky.npost, ranges.RUN_STEPS, _NPOST, "NPOST")
    else:
        good = False
    good &= findings.one(setup, sky.limit, ranges.CORNER_LIMIT, "LIMIT", "LIMIT")
    if findings.one(setup, sky.shift_us, ranges.SHIFT_US, "SHIFT", "SHIFT"):
        if sky.shift_us % ranges.SHIFT_STEP_US:
            findings.at(rules.SKY_STEP, setup, "SHIFT", value=sky.shift_us)
        return good
    return False


def _together(findings: Findings, setup: Setup, sky: SkyWriting) -> None:
    if not sky.is_on:
        findings.at(rules.SKY_OFF, setup, "TIMELAG", value=sky.timelag_us)
        return
    if sky.mode != 3 and sky.limit_given:
        findings.at(rules.SKY_NO_LIMIT, setup, "LIMIT", mode=int(sky.mode))
    early = sky.on_us - (sky.lag_us + sky.shift_us)
    if early > 0:
        findings.at(rules.SKY_SHIFT, setup, "SHIFT", value=sky.shift_us, early=early, least=sky.shift_us + early)
    elif -sky.shift_us > sky.run_in_us:
        early, least = -sky.shift_us - sky.run_in_us, math.ceil(-sky.shift_us / ranges.RUN_STEP_US)
        findings.at(rules.SKY_SHIFT_RAMP, setup, "SHIFT", value=sky.shift_us, early=early, least=least)


def light(view: View, findings: Findings) -> None:
    """Under sky writing light comes and goes with the path, and a mark is sky-written as a whole."""
    number, _ = view.job.sky_writing_by_row()
    sky = number >= 0
    if not sky.any():
        return
    for setup in view.setups(SkyWrite):
        _changed_in_light(view, findings, setup)
    for setup in view.setups(SwitchNow):
        assert isinstance(setup.statement, SwitchNow)
        if setup.statement.on and sky[min(view.stage_first[setup.order], len(sky) - 1)]:
            findings.at(rules.SKY_NOW, setup)
    stops = [s for s, opens in zip(view.job.setups, opens_stage(view.job), strict=True) if opens and _under(sky, s.row)]
    places = np.array([s.row * 2 for s in stops], dtype=np.intp)
    for channel in CHANNELS:
        for i in np.flatnonzero(view.lit_at(channel, places)).tolist():
            findings.at(rules.SKY_STAGE, stops[i], word=stops[i].word, channel=channel)
        lit, on_line, _, _ = view.lit(channel)
        dwells = np.flatnonzero((view.job.path.op == Op.DWELL) & lit & sky)
        remarks = switched_on(view, on_line[dwells])
        findings.at_rows(rules.SKY_DWELL, dwells, "", channel=channel, remarks=remarks)


def _under(sky: Bools, at: int) -> bool:
    """Whether sky writing is on in front of a row."""
    return at > 0 and bool(sky[at - 1])


def _changed_in_light(view: View, findings: Findings, setup: Setup) -> None:
    for channel in CHANNELS:
        if view.lit_at(channel, np.array([setup.row * 2 + 1]))[0]:
            on_line = view.lit(channel)[1][max(setup.row - 1, 0) : max(setup.row, 1)]
            findings.at(rules.SKY_LIT, setup, remarks=switched_on(view, on_line)(0), channel=channel)


def forced_ends(view: View, findings: Findings) -> None:
    """No END on a mark under sky writing."""
    path = view.job.path
    number, _ = view.job.sky_writing_by_row()
    forced = np.flatnonzero((number >= 0) & ~np.isnan(path.end) & path.moves)
    lit = view.lit(0)[0] | view.lit(1)[0]
    findings.at_rows(rules.SKY_END, forced[lit[forced]], "END")
