"""Power and follow: units and ranges by mode, limits, saturation."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import (
    CHANNELS,
    FOLLOW,
    FOLLOW_RATIO,
    POWER,
    POWER_NOW,
)
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import StateEffect
from gusjob.ir.modal import ModeSpan
from gusjob.ir.path import Op, Path
from gusjob.ir.setup import PowerNow, SwitchNow
from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks
from gusjob.kinematics.float_noise import exceeds
from gusjob.lint.context import LintContext, same_remarks
from gusjob.lint.frequency import FOLLOW_ENDS
from gusjob.lint.reporter import Reporter

_RATIO = Phrase("follow RATIO")


def before_a_mode(context: LintContext, report: Reporter) -> None:
    """Power, follow or laser-on before the channel has a mode."""
    path, modal = context.path, context.modal
    for channel in CHANNELS:
        spans = modal.modes(channel)
        first = spans[0].setup.row if spans else len(path)
        early = np.arange(len(path))[:first]
        early = early[(path.op[early] >= Op.POWER) & (path.channel[early] == channel)]
        early = early[context.known(early, StateEffect.MODE, channel)]
        for op in (Op.POWER, Op.FOLLOW):
            report.rows(rules.POWER_WITHOUT_MODE, early[path.op[early] == op], "", word=op.word, channel=channel)
        on = early[path.op[early] == Op.ON]
        report.rows(rules.CHANNEL_WITHOUT_MODE, on[:1], "", channel=channel)
        first_order = spans[0].setup.order if spans else len(context.job.setups)
        for setup, switch in modal.statements(SwitchNow):
            early_on = switch.on and setup.channel == channel and setup.order < first_order
            if early_on and context.known_at(setup, StateEffect.MODE):
                report.setup(rules.CHANNEL_WITHOUT_MODE, setup, channel=channel)
        for setup, _ in modal.statements(PowerNow):
            is_early = setup.channel == channel and setup.order < first_order
            if is_early and context.known_at(setup, StateEffect.MODE):
                report.setup(rules.POWER_WITHOUT_MODE, setup, word=setup.word, channel=channel)


def direct_power(context: LintContext, report: Reporter) -> None:
    """LASER POWER: unit, range, the mode's limits."""
    path, what = context.path, "LASER POWER"
    for channel in CHANNELS:
        for span in context.modal.modes(channel):
            rows = context.rows_in(Op.POWER, span)
            rows = rows[report.rows_in_unit(span, rows, path.power_unit[rows], what, "value")]
            rows = rows[report.rows_in_range(rows, path.power[rows], POWER[span.mode.mode], what, "value")]
            _check_mode_limits(context, report, span, rows, path.power[rows], what, "value")


def power_now(context: LintContext, report: Reporter) -> None:
    """LASER POWER NOW: unit, range, the mode's limits."""
    what = "LASER POWER NOW"
    for setup, statement in context.modal.statements(PowerNow):
        span, power = context.modal.mode_of(setup), statement.power
        if span is None or not report.in_unit(setup, "value", what, statement.unit, span):
            continue
        mode = span.mode
        if not report.in_range(setup, power, POWER_NOW[mode.mode], what):
            continue
        if (exceeds(mode.low, power) or exceeds(power, mode.high)) and span.setup.line not in report.faulty:
            report.setup(
                rules.POWER_CLAMPED,
                setup,
                "value",
                what=what,
                value=power,
                low=mode.low,
                high=mode.high,
                unit=mode.mode.unit,
                remarks=context.mode_remark(span),
            )


def follow(context: LintContext, report: Reporter) -> None:
    """LASER FOLLOW: ratio, limits, units, whole numbers, order of MIN and MAX."""
    path = context.path
    for channel in CHANNELS:
        for span in context.modal.modes(channel):
            rows = context.rows_in(Op.FOLLOW, span)
            if not len(rows):
                continue
            good = np.ones(len(rows), dtype=np.bool_)
            for word, values, units in (("MIN", path.low, path.low_unit), ("MAX", path.high, path.high_unit)):
                what = FOLLOW_ENDS[word]
                fits = report.rows_in_unit(span, rows, units[rows], what, word)
                fits[fits] = report.rows_in_range(rows[fits], values[rows[fits]], FOLLOW[span.mode.mode], what, word)
                _check_mode_limits(context, report, span, rows[fits], values[rows[fits]], what, word)
                good &= fits
            wrong = rows[good & (path.low[rows] >= path.high[rows])]
            low, high = path.low[wrong], path.high[wrong]
            report.rows(rules.MIN_ABOVE_MAX, wrong, "MIN", what="LASER FOLLOW", low=low, high=high)
            # A ratio by AT follows from MIN and MAX.
            rising = rows[good & (path.low[rows] < path.high[rows])]
            no_ratio = ~np.isfinite(path.ratio[rising])
            report.rows_in_range(rising[~no_ratio], path.ratio[rising[~no_ratio]], FOLLOW_RATIO, _RATIO, "RATIO")
            _report_no_velocity(report, rising[no_ratio])
            if not context.machine.equal_axes:
                report.rows(rules.FOLLOW_UNEQUAL_AXES, rows[path.follow_in_mm[rows]], "")


def _report_no_velocity(report: Reporter, rows: Indices) -> None:
    """Report rows of LASER FOLLOW whose AT is 0: no ratio reaches MAX there."""
    what = Phrase("follow velocity AT")
    report.rows(rules.OUT_OF_RANGE, rows, "AT", what=what, value=0.0, unit="", range="(0, inf)", hint="")


def kept(context: LintContext, report: Reporter) -> None:
    """A LASER MODE that repeats the mode in force keeps the power, but sets new limits."""
    path, modal = context.path, context.modal
    for channel in CHANNELS:
        powers, on = modal.power_instants(channel), modal.laser(channel).on
        for before, span in pairwise(modal.modes(channel)):
            at = int(np.searchsorted(powers, span.first * 2)) - 1
            if before.mode.mode is not span.mode.mode or at < 0 or powers[at] % 2 == 0:
                continue
            until = min(int(powers[at + 1]) // 2 if at + 1 < len(powers) else len(path), span.last)
            part = slice(span.first, until)
            if not (on[part] & path.takes_time[part]).any():
                continue
            row = powers[at : at + 1] // 2
            of_power = (("LASER POWER", "value", path.power),)
            of_follow = ((FOLLOW_ENDS["MIN"], "MIN", path.low), (FOLLOW_ENDS["MAX"], "MAX", path.high))
            for what, word, values in of_power if path.op[row[0]] == Op.POWER else of_follow:
                _check_mode_limits(context, report, span, row, values[row], what, word)


def saturation(context: LintContext, report: Reporter) -> None:
    """Follow computes more than its MAX at the velocity of a mark."""
    path, shown = context.path, context.shown
    for channel in CHANNELS:
        sets = path.sets_power & (path.channel == channel)
        if not (path.op[sets] == Op.FOLLOW).any():
            continue
        powers, on = np.flatnonzero(sets), context.modal.laser(channel).on
        marks = np.flatnonzero(path.moves & (path.op != Op.JUMP) & on)
        marks = marks[np.searchsorted(marks, powers[0]) :]
        over = np.empty(len(marks), dtype=np.bool_)
        for part in blocks(len(marks)):
            over[part] = _saturates(context, channel, marks[part], _in_force(powers, marks[part]))
        marks = marks[over]
        marks = marks[report.is_sound(path.vel_line[marks])]
        rows, which = np.unique(_in_force(powers, marks), return_index=True)
        report.rows(
            rules.FOLLOW_SATURATES,
            rows,
            "",
            value=_followed(path, marks[which], rows),
            high=path.high[rows],
            unit=_units(context, channel, rows),
            velocity=path.vel[marks[which]] * shown.per_pulse_per_ms,
            speed=shown.speed,
        )


def _in_force(powers: Indices, rows: Indices) -> Indices:
    """Find the power in force in some rows, none of them before the first one: its row, (k,)."""
    return np.asarray(powers[np.searchsorted(powers, rows, side="right") - 1])


def _followed(path: Path, rows: Indices, powers: Indices) -> Floats:
    """Compute what follows make of the velocity of some rows. `powers`: the power in force in each."""
    with np.errstate(invalid="ignore"):
        return np.asarray(path.ratio[powers] * path.vel[rows] + path.low[powers])


def _saturates(context: LintContext, channel: int, marks: Indices, powers: Indices) -> Bools:
    """Find the marks for which a follow computes more than its MAX. `powers`: the power in force in each."""
    path = context.path
    found = (path.op[powers] == Op.FOLLOW) & (_followed(path, marks, powers) > path.high[powers] * (1 + 1e-9))
    found &= context.known(marks, StateEffect.POWER | StateEffect.MODE, channel)
    return np.asarray(found & context.known_after(marks, StateEffect.VEL))


def _units(context: LintContext, channel: int, rows: Indices) -> npt.NDArray[np.str_]:
    """The power unit in force at some rows."""
    units = np.full(len(rows), "", dtype=object)
    for span in context.modal.modes(channel):
        units[(rows >= span.first) & (rows < span.last)] = span.mode.mode.unit
    return np.array(units, dtype=str)


def _check_mode_limits(
    context: LintContext, report: Reporter, span: ModeSpan, rows: Indices, values: Floats, what: str, word: str
) -> None:
    """Check powers, one a row, against the limits of the mode in force: the controller clamps them."""
    mode = span.mode
    out = exceeds(mode.low, values) | exceeds(values, mode.high)
    if out.any() and span.setup.line not in report.faulty:
        report.rows(
            rules.POWER_CLAMPED,
            rows[out],
            word,
            what=what,
            value=values[out],
            low=float(mode.low),
            high=float(mode.high),
            unit=mode.mode.unit,
            remarks=same_remarks(context.mode_remark(span)),
        )
