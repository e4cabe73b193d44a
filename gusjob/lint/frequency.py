"""Frequency mode: at every frequency that is commanded the laser pulse fits its period, and the laser can follow.

What is checked is the frequency that the controller uses: a power, or the lowest and the highest of velocity follow,
within the limits of distance follow and of the mode (the order of limits of the simulation).
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS, DISTANCE_LIMIT, FOLLOW, POWER, PULSE_DUTY_PCT, Membership, PowerMode
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import StateEffect
from gusjob.ir.modal import ModeSpan
from gusjob.ir.path import Op
from gusjob.ir.setup import DistanceFollow, LaserDistance, PowerNow, Setup
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.float_noise import exceeds, settled
from gusjob.kinematics.units import PowerUnit
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter

US_KHZ_PER_PCT = 10
"""Laser pulse width times frequency at a duty of 1 %."""
_KHZ = (PowerUnit.NONE, PowerUnit.KHZ)
FOLLOW_ENDS = {"MIN": Phrase("follow MIN"), "MAX": Phrase("follow MAX")}
DISTANCE_ENDS = {"MIN": Phrase("distance MIN"), "MAX": Phrase("distance MAX")}


class _Limits(Struct, frozen=True, kw_only=True):
    """The limits in force in rows first..last-1 of a channel in frequency mode: of its mode, of distance follow.

    `kept_from`: first row since when the channel is in frequency mode. A LASER MODE that repeats the mode keeps the
    power.
    """

    span: ModeSpan
    distance: DistanceFollow | None
    first: int
    last: int
    kept_from: int

    def applied(self, khz: Floats) -> Floats:
        """Return the frequencies that the controller uses, (k,)."""
        if self.distance is not None:
            khz = np.clip(khz, self.distance.low, self.distance.high)
        return np.clip(khz, self.span.mode.low, self.span.mode.high)

    def reported(self) -> list[float]:
        """List the limits of distance follow that are reported by themselves, as the controller uses them."""
        if self.distance is None:
            return []
        ends = self.applied(np.array([self.distance.low, self.distance.high]))
        return [float(khz) for khz in ends[_is_bad(self.span, ends)]]


def powers(context: LintContext, report: Reporter) -> None:
    """LASER POWER and LASER FOLLOW in frequency mode, where they are set and where a change of limits keeps them."""
    for channel in CHANNELS:
        reported = -1
        for limits in _limits(context, channel):
            rows = _rows_set(context, limits)
            kept = _kept(context, limits)
            if kept is not None and kept[1] >= 0 and kept[1] != reported:
                rows = np.concatenate([[kept[1]], rows]).astype(np.intp)
            elif kept is not None and kept[0] is not None:
                _check_now(context, report, *kept[0], limits)
            bad = _check_rows(context, report, rows, limits)
            reported = int(bad[-1]) if len(bad) else reported


def power_now(context: LintContext, report: Reporter) -> None:
    """LASER POWER NOW in frequency mode."""
    for setup, statement in context.modal.statements(PowerNow):
        span = context.modal.mode_of(setup)
        if span is not None and span.mode.mode is PowerMode.FREQUENCY:
            before = [(s, d) for s, d in _distances(context, setup.channel) if s.order < setup.order]
            settings = before[-1][1].settings if before else None
            if settings is None or _is_sound(settings):
                limits = _Limits(span=span, distance=settings, first=0, last=0, kept_from=0)
                _check_now(context, report, setup, statement, limits)


def distance(context: LintContext, report: Reporter) -> None:
    """LASER DISTANCE in frequency mode, in every LASER MODE in which it is in force."""
    following: dict[int, int] = {}
    for setup, statement in reversed(context.modal.statements(LaserDistance)):
        until = following.get(setup.channel, len(context.path) + 1)
        following[setup.channel] = setup.row
        first = context.modal.mode_of(setup)
        if statement.settings is None or first is None or not _is_sound(statement.settings):
            continue
        left = list(DISTANCE_ENDS)
        for span in (first, *context.modal.modes_after(setup)):
            if span.setup.row >= until:
                break  # Another LASER DISTANCE is in force before anything moves in this mode.
            if span.mode.mode is not PowerMode.FREQUENCY:
                break
            left = [word for word in left if not _check_end(context, report, setup, statement.settings, span, word)]


def _check_end(
    context: LintContext, report: Reporter, setup: Setup, settings: DistanceFollow, span: ModeSpan, word: str
) -> bool:
    """Check MIN or MAX of LASER DISTANCE in a mode; return whether it is reported."""
    if span.setup.line in report.faulty and span.setup.line != setup.line:
        return False
    khz = np.clip([settings.low if word == "MIN" else settings.high], span.mode.low, span.mode.high)
    remarks = context.mode_remark(span)
    if _is_bad(span, khz)[0]:
        report.setup(rules.PULSE_TOO_WIDE, setup, word, **_pulse_fields(span, float(khz[0])), remarks=remarks)
        return True
    highest = context.machine.laser(span.channel).max_frequency_khz
    if word == "MAX" and highest is not None and exceeds(khz, highest)[0]:
        fields: dict[str, Any] = {"what": DISTANCE_ENDS[word], "value": float(khz[0]), "limit": highest}
        report.setup(rules.CARRIER_TOO_FAST, setup, word, **fields, remarks=remarks)
        return True
    return False


def _is_sound(settings: DistanceFollow) -> bool:
    """Whether limits of distance follow are good frequencies: another check reports those that are not."""
    allowed = DISTANCE_LIMIT[PowerMode.FREQUENCY]
    good = all(allowed.classify_one(khz) is Membership.INSIDE for khz in (settings.low, settings.high))
    return good and settings.low < settings.high and settings.low_unit in _KHZ and settings.high_unit in _KHZ


def _distances(context: LintContext, channel: int) -> Sequence[tuple[Setup, LaserDistance]]:
    """List the LASER DISTANCEs of a channel in order."""
    return [(setup, found) for setup, found in context.modal.statements(LaserDistance) if setup.channel == channel]


def _limits(context: LintContext, channel: int) -> Iterator[_Limits]:
    """Yield the limits of a channel in frequency mode along the path, but where those of distance follow are wrong."""
    distances = _distances(context, channel)
    changes = [setup.row for setup, _ in distances]
    kept_from = None
    for span in context.modal.modes(channel):
        if span.mode.mode is not PowerMode.FREQUENCY:
            kept_from = None
            continue
        kept_from = span.first if kept_from is None else kept_from
        begins = [span.first, *changes[bisect_right(changes, span.first) : bisect_right(changes, span.last - 1)]]
        for first, last in zip(begins, [*begins[1:], span.last], strict=True):
            before = bisect_right(changes, first)
            settings = distances[before - 1][1].settings if before else None
            if first < last and (settings is None or _is_sound(settings)):
                yield _Limits(span=span, distance=settings, first=first, last=last, kept_from=kept_from)


def _rows_set(context: LintContext, limits: _Limits) -> Indices:
    """Find the rows that set a power under some limits."""
    part, channel = slice(limits.first, limits.last), limits.span.channel
    path = context.path
    return np.flatnonzero(path.sets_power[part] & (path.channel[part] == channel)) + limits.first


def _kept(context: LintContext, limits: _Limits) -> tuple[tuple[Setup, PowerNow] | None, int] | None:
    """Find the power that was set before some limits and is emitted under them: LASER POWER NOW, or a row (or -1)."""
    modal, channel, path = context.modal, limits.span.channel, context.path
    instants = modal.power_instants(channel)
    at = int(np.searchsorted(instants, limits.first * 2)) - 1
    if at < 0 or instants[at] < limits.kept_from * 2:
        return None
    until = min(int(instants[at + 1]) // 2 if at + 1 < len(instants) else len(path), limits.last)
    part = slice(limits.first, until)
    if not (modal.laser(channel).on[part] & path.takes_time[part]).any():
        return None
    row, is_row = divmod(int(instants[at]), 2)
    if is_row:
        return None, row
    for setup, statement in reversed(modal.statements(PowerNow)):
        if setup.channel == channel and modal.stage_first[setup.order] == row:
            return (setup, statement), -1
    return None


def _check_now(context: LintContext, report: Reporter, setup: Setup, statement: PowerNow, limits: _Limits) -> None:
    """Check LASER POWER NOW under some limits."""
    span, allowed = limits.span, POWER[PowerMode.FREQUENCY]
    if statement.unit not in _KHZ or allowed.classify_one(statement.power) is Membership.OUTSIDE:
        return
    if span.setup.line in report.faulty or setup.line in report.faulty:
        return
    khz = limits.applied(np.array([statement.power]))
    if _is_bad(span, khz)[0] and khz[0] not in limits.reported():
        report.setup(rules.PULSE_TOO_WIDE, setup, "value", **_pulse_fields(span, float(khz[0])))
    highest = context.machine.laser(setup.channel).max_frequency_khz
    if highest is not None and exceeds(khz, highest)[0]:
        value = float(khz[0])
        report.setup(rules.CARRIER_TOO_FAST, setup, "value", what="LASER POWER NOW", value=value, limit=highest)


def _check_rows(context: LintContext, report: Reporter, rows: Indices, limits: _Limits) -> Indices:
    """Check the powers of rows under some limits; return the rows that are reported, ascending."""
    path, span = context.path, limits.span
    if span.setup.line in report.faulty:
        return rows[:0]
    rows = rows[context.known(rows, StateEffect.MODE_KIND, span.channel)]
    direct = rows[(path.op[rows] == Op.POWER) & np.isin(path.power_unit[rows], _KHZ)]
    direct = direct[POWER[PowerMode.FREQUENCY].classify(path.power[direct]) != Membership.OUTSIDE]
    follow = rows[(path.op[rows] == Op.FOLLOW) & (path.low[rows] < path.high[rows])]
    for values, units in ((path.low, path.low_unit), (path.high, path.high_unit)):
        fits = FOLLOW[PowerMode.FREQUENCY].classify(values[follow]) != Membership.OUTSIDE
        follow = follow[fits & np.isin(units[follow], _KHZ)]
    check = _RowCheck(context=context, report=report, limits=limits)
    found = [check.run(direct, path.power, "LASER POWER", "value")]
    for word, values in (("MIN", path.low), ("MAX", path.high)):
        found.append(check.run(follow, values, FOLLOW_ENDS[word], word))
    return np.unique(np.concatenate(found))


class _RowCheck(Struct, frozen=True, kw_only=True):
    """Checks frequencies of rows under some limits."""

    context: LintContext
    report: Reporter
    limits: _Limits

    def run(self, rows: Indices, values: Floats, what: str, word: str) -> Indices:
        """Check a column in some rows; return those that are reported."""
        span, khz = self.limits.span, self.limits.applied(values[rows])
        bad = _is_bad(span, khz) & ~np.isin(khz, self.limits.reported())
        if bad.any():
            self.report.rows(rules.PULSE_TOO_WIDE, rows[bad], word, **_pulse_fields(span, khz[bad]))
        highest = self.context.machine.laser(span.channel).max_frequency_khz
        fast = np.asarray(exceeds(khz, np.inf if highest is None else highest), dtype=np.bool_)
        if fast.any():
            self.report.rows(rules.CARRIER_TOO_FAST, rows[fast], word, what=what, value=khz[fast], limit=highest)
        return rows[bad | fast]


def _is_bad(span: ModeSpan, khz: Floats) -> Bools:
    """Find frequencies at which the laser pulse does not fit its period, (k,) (M 二.2).

    Without pulses (0 kHz) there is nothing to fit: M itself passes 0 as the MIN of a follow (M 四.2).
    """
    width_us = span.mode.pulse_width_us
    if not width_us:
        return np.zeros(len(khz), dtype=np.bool_)
    outside = PULSE_DUTY_PCT.classify(settled(khz * width_us / US_KHZ_PER_PCT)) != Membership.INSIDE
    return np.asarray(outside & (khz > 0))


def _pulse_fields(span: ModeSpan, khz: float | Floats) -> dict[str, Any]:
    """Fields of PULSE_TOO_WIDE for one frequency, or a column of them."""
    width_us = float(span.mode.pulse_width_us or 0.0)
    return {"value": khz, "width": width_us, "duty": khz * width_us / US_KHZ_PER_PCT, "range": str(PULSE_DUTY_PCT)}
