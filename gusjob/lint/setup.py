"""Setup statements: ranges, mode, order."""

from __future__ import annotations

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.ranges import DISTANCE_LIMIT, MODE_LIMIT, PULSE_DUTY_PCT, Membership, PowerMode
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.setup import (
    Crd,
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
from gusjob.lint.power import UNIT_OF_MODE
from gusjob.lint.view import Findings, View

_MODE_MIN, _MODE_MAX, _PULSE_WIDTH = Phrase("mode MIN"), Phrase("mode MAX"), Phrase("pulse WIDTH")
_ON_DELAY, _OFF_DELAY, _PREVOLTAGE = Phrase("on delay"), Phrase("off delay"), Phrase("pre-voltage")
_STANDBY_FREQ, _STANDBY_DUTY = Phrase("standby FREQ"), Phrase("standby DUTY")
_DISTANCE = {"MIN": Phrase("distance MIN"), "MAX": Phrase("distance MAX")}
_PWM, _ANALOG = Phrase("the PWM modes (DUTY, DUTY2, FREQUENCY)"), Phrase("analog mode")


def laser_mode(view: View, findings: Findings) -> None:
    """LASER MODE: limits, carrier, pulse width."""
    for setup in view.setups(LaserMode):
        mode = setup.statement
        assert isinstance(mode, LaserMode)
        allowed = MODE_LIMIT[mode.mode]
        good = findings.one(setup, mode.low, allowed, _MODE_MIN, "MIN")
        good &= findings.one(setup, mode.high, allowed, _MODE_MAX, "MAX")
        if good and mode.low >= mode.high:
            findings.at(rules.MIN_ABOVE_MAX, setup, "MIN", what=setup.word, low=float(mode.low), high=float(mode.high))
        if mode.pulse_width_us is not None:
            findings.one(setup, mode.pulse_width_us, ranges.PULSE_WIDTH_US, _PULSE_WIDTH, "WIDTH")
        if mode.carrier_khz is None or not findings.one(
            setup, mode.carrier_khz, ranges.CARRIER_KHZ, "CARRIER", "CARRIER"
        ):
            continue
        highest = view.machine.laser(setup.channel).max_frequency_khz
        if highest is not None and mode.carrier_khz > highest:
            findings.at(rules.CARRIER_TOO_FAST, setup, "CARRIER", what="CARRIER", value=mode.carrier_khz, limit=highest)


def delays(view: View, findings: Findings) -> None:
    """LASER DELAY: whole us, and off not below on."""
    for setup in view.setups(LaserDelay):
        delay = setup.statement
        assert isinstance(delay, LaserDelay)
        good = findings.one(setup, delay.on_delay_us, ranges.SWITCH_DELAY_US, _ON_DELAY, "ON")
        good &= findings.one(setup, delay.off_delay_us, ranges.SWITCH_DELAY_US, _OFF_DELAY, "OFF")
        if good and delay.off_delay_us < delay.on_delay_us:
            findings.at(rules.OFF_BELOW_ON, setup, "OFF", off=delay.off_delay_us, on=delay.on_delay_us)


def output_when_off(view: View, findings: Findings) -> None:
    """LASER STANDBY, LASER PREVOLT, LASER FPK: ranges, and the modes in which they mean something."""
    for setup in view.setups(LaserStandby):
        standby = setup.statement
        assert isinstance(standby, LaserStandby)
        if standby.pulse is not None:
            findings.one(setup, standby.pulse[0], ranges.STANDBY_KHZ, _STANDBY_FREQ, "FREQ")
            findings.one(setup, standby.pulse[1], ranges.STANDBY_PCT, _STANDBY_DUTY, "DUTY")
            highest = view.machine.laser(setup.channel).max_frequency_khz
            if highest is not None and standby.pulse[0] > highest:
                findings.at(
                    rules.CARRIER_TOO_FAST, setup, "FREQ", what=_STANDBY_FREQ, value=standby.pulse[0], limit=highest
                )
            _wants(view, findings, setup, pwm=True)
    for setup in view.setups(LaserPrevolt):
        prevolt = setup.statement
        assert isinstance(prevolt, LaserPrevolt)
        if prevolt.prevoltage_v is not None:
            findings.one(setup, prevolt.prevoltage_v, ranges.PREVOLTAGE_V, _PREVOLTAGE)
            _wants(view, findings, setup, pwm=False)
    for setup, behind in _with_next(view.setups(LaserFpk)):
        fpk = setup.statement
        assert isinstance(fpk, LaserFpk)
        if fpk.times_us is not None:
            for value, allowed, word in zip(
                fpk.times_us,
                (ranges.FPK_WIDTH_US, ranges.FPK_GAP_US, ranges.FPK_OFF_DELAY_US),
                ("WIDTH", "GAP", "OFFDELAY"),
                strict=True,
            ):
                findings.one(setup, value, allowed, f"FPK {word}", word)
            _wants(view, findings, setup, pwm=True)
            span = view.mode_of(setup)
            if span is not None and span.mode.mode is PowerMode.DUTY2:
                remarks = findings.mode_remark(span.setup)
                findings.at(rules.FPK_SWITCH, setup, channel=setup.channel, remarks=remarks)
                continue
            for later in view.modes_behind(setup):
                if behind is not None and later.setup.row >= behind.row:
                    break
                if later.mode.mode is PowerMode.DUTY2 and span is not later:
                    remarks = findings.set_remark(setup)
                    findings.at(rules.FPK_SWITCH, later.setup, channel=setup.channel, remarks=remarks)
                    break


def _wants(view: View, findings: Findings, setup: Setup, *, pwm: bool) -> None:
    span = view.mode_of(setup)
    if span is not None and span.mode.mode.is_pwm != pwm:
        findings.at(
            rules.WRONG_MODE, setup, word=setup.word, wanted=_PWM if pwm else _ANALOG, channel=setup.channel,
            mode=span.mode.mode.name, remarks=findings.mode_remark(span.setup),
        )  # fmt: skip


def distance(view: View, findings: Findings) -> None:
    """LASER DISTANCE: after its mode, with limits in the mode's range and unit."""
    for setup, behind in _with_next(view.setups(LaserDistance)):
        what = setup.statement
        assert isinstance(what, LaserDistance)
        if what.settings is None:
            continue
        mode, settings = view.mode_of(setup), what.settings
        if mode is None or mode.setup.order > setup.order:
            findings.at(rules.DISTANCE_NEEDS_MODE, setup, channel=setup.channel)
            continue
        allowed, wanted = DISTANCE_LIMIT[mode.mode.mode], UNIT_OF_MODE[mode.mode.mode]
        good = True
        for word, value, unit in (("MIN", settings.low, settings.low_unit), ("MAX", settings.high, settings.high_unit)):
            name = _DISTANCE[word]
            fits = findings.unit(setup, word, name, unit, wanted, mode.setup)
            good &= fits and findings.one(setup, value, allowed, name, word)
        if good and settings.low >= settings.high:
            findings.at(rules.MIN_ABOVE_MAX, setup, "MIN", what="LASER DISTANCE", low=settings.low, high=settings.high)
        for word, value in (("MIN", settings.low), ("MAX", settings.high)):
            if good and not mode.mode.low <= value <= mode.mode.high:
                findings.at(
                    rules.POWER_CLAMPED, setup, word, what=_DISTANCE[word], value=value, low=mode.mode.low,
                    high=mode.mode.high, unit=mode.mode.mode.unit, remarks=findings.mode_remark(mode.setup),
                )  # fmt: skip
        width = mode.mode.pulse_width_us
        if good and mode.mode.mode is PowerMode.FREQUENCY and width:
            # What distance follow may ask for is a frequency that the job commands (M 二.2).
            for word, value in (("MIN", settings.low), ("MAX", settings.high)):
                duty = min(max(value, mode.mode.low), mode.mode.high) * width / 10
                if value > 0 and PULSE_DUTY_PCT.classify_one(duty) is not Membership.INSIDE:
                    findings.at(
                        rules.PULSE_TOO_WIDE, setup, word, value=value, width=width, duty=duty,
                        range=str(PULSE_DUTY_PCT), remarks=findings.mode_remark(mode.setup),
                    )  # fmt: skip
        for span in view.modes_behind(setup):
            if behind is not None and span.setup.row >= behind.row:
                break  # Another LASER DISTANCE takes over before anything moves in this mode.
            if span.mode.mode.unit != mode.mode.mode.unit:
                findings.at(
                    rules.DISTANCE_STALE, span.setup, remarks=findings.set_remark(setup),
                    unit=mode.mode.mode.unit, mode_unit=span.mode.mode.unit,
                )  # fmt: skip
                break
        for axis, place in zip("XYZA", settings.reference_pulse, strict=True):
            findings.one(setup, place, ranges.COORDINATE_PULSE, f"REF {axis}", "REF")


def _with_next(setups: tuple[Setup, ...]) -> list[tuple[Setup, Setup | None]]:
    """Each setup statement with the next one of its channel."""
    following: dict[int, Setup] = {}
    found: list[tuple[Setup, Setup | None]] = []
    for setup in reversed(setups):
        found.append((setup, following.get(setup.channel)))
        following[setup.channel] = setup
    return found[::-1]


def coordinate_system(view: View, findings: Findings) -> None:
    """CRD and LOOKAHEAD: numbers, and CRD before the path."""
    for setup in view.job.setups:
        match setup.statement:
            case Crd(crd=crd, fifo=fifo):
                findings.one(setup, crd, ranges.CRD, "CRD")
                findings.one(setup, fifo, ranges.FIFO, "FIFO", "FIFO")
                if setup.row:
                    findings.at(rules.CRD_LATE, setup)
            case LookAhead(corner=(time, acc)):
                if time == time:
                    findings.one(setup, time, ranges.LOOKAHEAD_TIME_MS, "LOOKAHEAD TIME", "TIME")
                if acc == acc:
                    findings.one(setup, acc, ranges.ACCELERATION, "LOOKAHEAD ACC", "ACC")
            case _:
                pass


def new_stages(view: View, findings: Findings) -> None:
    """A setup statement behind motion stops it."""
    for setup, opens in zip(view.job.setups, opens_stage(view.job), strict=True):
        if opens and not isinstance(setup.statement, Wait):
            findings.at(rules.NEW_STAGE, setup, word=setup.word)
