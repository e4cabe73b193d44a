"""Setup statements: ranges, mode, order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TypeVar

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.ranges import DISTANCE_LIMIT, MODE_LIMIT, PowerMode
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import StateEffect
from gusjob.ir.modal import ModeSpan
from gusjob.ir.setup import (
    Crd,
    DistanceFollow,
    LaserDelay,
    LaserDistance,
    LaserFpk,
    LaserMode,
    LaserPrevolt,
    LaserStandby,
    LookAhead,
    Setup,
    Wait,
)
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.float_noise import exceeds
from gusjob.lint.context import LintContext
from gusjob.lint.frequency import DISTANCE_ENDS
from gusjob.lint.reporter import Reporter

_T = TypeVar("_T")

_MODE_MIN, _MODE_MAX, _PULSE_WIDTH = Phrase("mode MIN"), Phrase("mode MAX"), Phrase("pulse WIDTH")
_ON_DELAY, _OFF_DELAY, _PREVOLTAGE = Phrase("on delay"), Phrase("off delay"), Phrase("pre-voltage")
_STANDBY_FREQ, _STANDBY_DUTY = Phrase("standby FREQ"), Phrase("standby DUTY")
_PWM, _ANALOG = Phrase("the PWM modes (DUTY, DUTY2, FREQUENCY)"), Phrase("analog mode")


def laser_mode(context: LintContext, report: Reporter) -> None:
    """LASER MODE: limits, carrier, laser pulse width."""
    for setup, mode in context.modal.statements(LaserMode):
        allowed = MODE_LIMIT[mode.mode]
        good = report.in_range(setup, mode.low, allowed, _MODE_MIN, "MIN")
        good &= report.in_range(setup, mode.high, allowed, _MODE_MAX, "MAX")
        if good and mode.low >= mode.high:
            low, high = float(mode.low), float(mode.high)
            report.setup(rules.MIN_ABOVE_MAX, setup, "MIN", what=setup.word, low=low, high=high)
        if mode.pulse_width_us is not None:
            report.in_range(setup, mode.pulse_width_us, ranges.PULSE_WIDTH_US, _PULSE_WIDTH, "WIDTH")
        if mode.carrier_khz is not None and report.in_range(
            setup, mode.carrier_khz, ranges.CARRIER_KHZ, "CARRIER", "CARRIER"
        ):
            _check_response(context, report, setup, "CARRIER", "CARRIER", mode.carrier_khz)


def _check_response(
    context: LintContext, report: Reporter, setup: Setup, word: str, what: str, frequency_khz: float
) -> None:
    """Check a frequency against the laser's highest response frequency."""
    highest = context.machine.laser(setup.channel).max_frequency_khz
    if highest is not None and exceeds(frequency_khz, highest):
        report.setup(rules.CARRIER_TOO_FAST, setup, word, what=what, value=frequency_khz, limit=highest)


def delays(context: LintContext, report: Reporter) -> None:
    """LASER DELAY: whole us, and off not below on."""
    for setup, delay in context.modal.statements(LaserDelay):
        good = report.in_range(setup, delay.on_delay_us, ranges.SWITCH_DELAY_US, _ON_DELAY, "ON")
        good &= report.in_range(setup, delay.off_delay_us, ranges.SWITCH_DELAY_US, _OFF_DELAY, "OFF")
        if good and delay.off_delay_us < delay.on_delay_us:
            report.setup(rules.OFF_DELAY_BELOW_ON, setup, "OFF", off=delay.off_delay_us, on=delay.on_delay_us)


def output_when_off(context: LintContext, report: Reporter) -> None:
    """LASER STANDBY, LASER PREVOLT: ranges, and the modes in which they have an effect."""
    for setup, standby in context.modal.statements(LaserStandby):
        if standby.pulse is not None:
            frequency_khz, duty_pct = standby.pulse
            report.in_range(setup, frequency_khz, ranges.STANDBY_KHZ, _STANDBY_FREQ, "FREQ")
            report.in_range(setup, duty_pct, ranges.STANDBY_PCT, _STANDBY_DUTY, "DUTY")
            _check_response(context, report, setup, "FREQ", _STANDBY_FREQ, frequency_khz)
            _check_mode(context, report, setup, pwm=True)
    for setup, prevolt in context.modal.statements(LaserPrevolt):
        if prevolt.prevoltage_v is not None:
            report.in_range(setup, prevolt.prevoltage_v, ranges.PREVOLTAGE_V, _PREVOLTAGE)
            _check_mode(context, report, setup, pwm=False)


def first_pulse_killer(context: LintContext, report: Reporter) -> None:
    """LASER FPK: ranges, and the modes in which it has an effect."""
    for setup, fpk, following in _with_next(context.modal.statements(LaserFpk)):
        if fpk.times_us is None:
            continue
        for value, allowed, word in zip(
            fpk.times_us,
            (ranges.FPK_WIDTH_US, ranges.FPK_GAP_US, ranges.FPK_OFF_DELAY_US),
            ("WIDTH", "GAP", "OFFDELAY"),
            strict=True,
        ):
            report.in_range(setup, value, allowed, f"FPK {word}", word)
        _check_mode(context, report, setup, pwm=True)
        span = context.modal.mode_of(setup)
        if span is not None and span.mode.mode is PowerMode.DUTY2:
            remarks = context.mode_remark(span)
            report.setup(rules.FPK_IN_DUTY2, setup, channel=setup.channel, remarks=remarks)
            continue
        for later in context.modal.modes_after(setup):
            if following is not None and later.setup.row >= following.row:
                break
            if later.mode.mode is PowerMode.DUTY2 and span is not later:
                remarks = context.set_remark(setup)
                report.setup(rules.FPK_IN_DUTY2, later.setup, channel=setup.channel, remarks=remarks)
                break


def _check_mode(context: LintContext, report: Reporter, setup: Setup, *, pwm: bool) -> None:
    """Check that a setup statement has an effect in its mode."""
    span = context.modal.mode_of(setup)
    if span is not None and span.mode.mode.is_pwm != pwm:
        report.setup(
            rules.WRONG_MODE,
            setup,
            word=setup.word,
            wanted=_PWM if pwm else _ANALOG,
            channel=setup.channel,
            mode=span.mode.mode.name,
            remarks=context.mode_remark(span),
        )


def distance(context: LintContext, report: Reporter) -> None:
    """LASER DISTANCE: after its mode, with limits in the mode's range and unit."""
    for setup, statement, following in _with_next(context.modal.statements(LaserDistance)):
        settings = statement.settings
        if settings is None:
            continue
        span = context.modal.mode_of(setup)
        if not context.known_at(setup, StateEffect.MODE):
            continue
        if span is None or span.setup.order > setup.order:
            report.setup(rules.DISTANCE_WITHOUT_MODE, setup, channel=setup.channel)
            continue
        _check_distance_limits(context, report, setup, settings, span)
        for later in context.modal.modes_after(setup):
            if following is not None and later.setup.row >= following.row:
                break  # Another LASER DISTANCE is in force before anything moves in this mode.
            known = context.known_at(later.setup, StateEffect.MODE | StateEffect.DISTANCE)
            if known and later.mode.mode.unit != span.mode.mode.unit:
                report.setup(
                    rules.DISTANCE_UNIT_CHANGED,
                    later.setup,
                    remarks=context.set_remark(setup),
                    word="LASER DISTANCE",
                    unit=span.mode.mode.unit,
                    mode_unit=later.mode.mode.unit,
                )
                break
        for axis, reference_pulse in zip("XYZA", settings.reference_pulse, strict=True):
            report.in_range(setup, reference_pulse, ranges.COORDINATE_PULSE, f"REF {axis}", "REF")


def _check_distance_limits(
    context: LintContext, report: Reporter, setup: Setup, settings: DistanceFollow, span: ModeSpan
) -> None:
    """Check MIN and MAX of LASER DISTANCE: unit, range, order, the mode's limits."""
    mode, allowed = span.mode, DISTANCE_LIMIT[span.mode.mode]
    good = True
    for word, value, unit in (("MIN", settings.low, settings.low_unit), ("MAX", settings.high, settings.high_unit)):
        fits = report.in_unit(setup, word, DISTANCE_ENDS[word], unit, span)
        good &= fits and report.in_range(setup, value, allowed, DISTANCE_ENDS[word], word)
    if not good:
        return
    if settings.low >= settings.high:
        low, high = settings.low, settings.high
        report.setup(rules.MIN_ABOVE_MAX, setup, "MIN", what="LASER DISTANCE", low=low, high=high)
    remarks = context.mode_remark(span)
    for word, value in (("MIN", settings.low), ("MAX", settings.high)):
        if (exceeds(mode.low, value) or exceeds(value, mode.high)) and span.setup.line not in report.faulty:
            report.setup(
                rules.POWER_CLAMPED,
                setup,
                word,
                what=DISTANCE_ENDS[word],
                value=value,
                low=mode.low,
                high=mode.high,
                unit=mode.mode.unit,
                remarks=remarks,
            )


def _with_next(statements: Sequence[tuple[Setup, _T]]) -> list[tuple[Setup, _T, Setup | None]]:
    """Join each setup statement with the next one of its channel."""
    following: dict[int, Setup] = {}
    found: list[tuple[Setup, _T, Setup | None]] = []
    for setup, statement in reversed(statements):
        found.append((setup, statement, following.get(setup.channel)))
        following[setup.channel] = setup
    return found[::-1]


def coordinate_system(context: LintContext, report: Reporter) -> None:
    """CRD and LOOKAHEAD: numbers, and CRD before the path."""
    for setup, statement in context.modal.statements(Crd):
        report.in_range(setup, statement.crd, ranges.CRD, "CRD")
        report.in_range(setup, statement.fifo, ranges.FIFO, "FIFO", "FIFO")
        if setup.row:
            report.setup(rules.CRD_LATE, setup)
    for setup, look_ahead in context.modal.statements(LookAhead):
        if look_ahead.corner is None:
            continue
        time_ms, acc = look_ahead.corner
        if not math.isnan(time_ms):
            report.in_range(setup, time_ms, ranges.LOOKAHEAD_TIME_MS, "LOOKAHEAD TIME", "TIME")
        if not math.isnan(acc):
            report.in_range(setup, acc, ranges.ACCELERATION, "LOOKAHEAD ACC", "ACC")


def new_stages(context: LintContext, report: Reporter) -> None:
    """A setup statement after a motion stops it."""
    for setup, opens in zip(context.job.setups, opens_stage(context.job), strict=True):
        if opens and not isinstance(setup.statement, Wait):
            report.setup(rules.NEW_STAGE, setup, word=setup.word)
