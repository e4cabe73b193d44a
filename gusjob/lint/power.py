"""Power and following: units and ranges by mode, clamping, saturation, laser pulse against period."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from gusjob.controllers.gus.ranges import FOLLOW, FOLLOW_RATIO, POWER, POWER_NOW, PULSE_DUTY_PCT, Membership, PowerMode
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import Op
from gusjob.ir.setup import PowerNow, SwitchNow
from gusjob.kinematics.units import PowerUnit
from gusjob.lint.view import CHANNELS, Findings, ModeSpan, View, unit_fields

UNIT_OF_MODE = {
    PowerMode.DUTY: PowerUnit.PERCENT,
    PowerMode.FREQUENCY: PowerUnit.KHZ,
    PowerMode.ANALOG: PowerUnit.VOLT,
    PowerMode.DUTY2: PowerUnit.PERCENT,
}


_RATIO = Phrase("follow RATIO")
_FOLLOW = {"MIN": Phrase("follow MIN"), "MAX": Phrase("follow MAX")}


def before_a_mode(view: View, findings: Findings) -> None:
    """Power, following or light before the channel has a mode."""
    path = view.job.path
    for channel in CHANNELS:
        spans = view.modes(channel)
        first = spans[0].setup.row if spans else len(path)
        early = np.arange(len(path))[:first]
        early = early[(path.op[early] >= Op.POWER) & (path.channel[early] == channel)]
        for op in (Op.POWER, Op.FOLLOW):
            findings.at_rows(rules.NO_MODE, early[path.op[early] == op], "", word=op.word, channel=channel)
        on = early[path.op[early] == Op.ON]
        findings.at_rows(rules.LASER_UNKNOWN, on[:1], "", channel=channel)
        for setup in view.setups(SwitchNow):
            turns_on = isinstance(setup.statement, SwitchNow) and setup.statement.on
            if turns_on and setup.channel == channel and (not spans or setup.order < spans[0].setup.order):
                findings.at(rules.LASER_UNKNOWN, setup, channel=channel)
        for setup in view.setups(PowerNow):
            if setup.channel == channel and (not spans or setup.order < spans[0].setup.order):
                findings.at(rules.NO_MODE, setup, word=setup.word, channel=channel)


def direct_power(view: View, findings: Findings) -> None:
    """LASER POWER against its unit, range and the mode's limits."""
    path = view.job.path
    for channel in CHANNELS:
        for span in view.modes(channel):
            rows = _rows_in(view, Op.POWER, span)
            values = path.power[rows]
            good = _units(findings, span, rows, path.power_unit[rows], "LASER POWER", "value")
            rows, values = rows[good], values[good]
            inside = findings.ranged(rows, values, POWER[span.mode.mode], "LASER POWER", "value")
            _clamped(findings, span, rows[inside], values[inside], "LASER POWER", "value")
            _frequency(view, findings, span, rows[inside], values[inside], "LASER POWER", "value")
    for setup in view.setups(PowerNow):
        what, mode = setup.statement, view.mode_of(setup)
        if mode is None or not isinstance(what, PowerNow):
            continue
        wanted = UNIT_OF_MODE[mode.mode.mode]
        good_unit = findings.unit(setup, "value", "LASER POWER NOW", what.unit, wanted, mode.setup)
        if good_unit and findings.one(setup, what.power, POWER_NOW[mode.mode.mode], "LASER POWER NOW"):
            if not mode.mode.low <= what.power <= mode.mode.high:
                findings.at(
                    rules.POWER_CLAMPED, setup, "value", what="LASER POWER NOW", value=what.power, low=mode.mode.low,
                    high=mode.mode.high, unit=wanted.text, remarks=findings.mode_remark(mode.setup),
                )  # fmt: skip
            highest = view.machine.laser(setup.channel).max_frequency_khz
            if wanted is PowerUnit.KHZ and highest is not None and what.power > highest:
                findings.at(
                    rules.CARRIER_TOO_FAST, setup, "value", what="LASER POWER NOW", value=what.power, limit=highest
                )
            width = mode.mode.pulse_width_us
            duty = min(max(what.power, mode.mode.low), mode.mode.high) * (width or 0.0) / 10
            if width and what.power > 0 and PULSE_DUTY_PCT.classify_one(duty) is not Membership.INSIDE:
                findings.at(
                    rules.PULSE_TOO_WIDE, setup, "value", value=what.power, width=width, duty=duty,
                    range=str(PULSE_DUTY_PCT),
                )  # fmt: skip


def follow(view: View, findings: Findings) -> None:
    """LASER FOLLOW: ratio, limits, units, whole numbers, order of MIN and MAX."""
    path, machine = view.job.path, view.machine
    for channel in CHANNELS:
        for span in view.modes(channel):
            rows = _rows_in(view, Op.FOLLOW, span)
            if not len(rows):
                continue
            by_velocity = np.isnan(path.ratio[rows]) | ~np.isfinite(path.ratio[rows])
            findings.ranged(rows[~by_velocity], path.ratio[rows[~by_velocity]], FOLLOW_RATIO, _RATIO, "RATIO")
            findings.at_rows(
                rules.OUT_OF_RANGE, rows[by_velocity], "AT", what=Phrase("follow velocity AT"), value=0.0, unit="",
                range="(0, inf)", hint="",
            )  # fmt: skip
            limit = FOLLOW[span.mode.mode]
            fine = np.ones(len(rows), dtype=np.bool_)
            for word, values, units in (("MIN", path.low, path.low_unit), ("MAX", path.high, path.high_unit)):
                what = _FOLLOW[word]
                good = _units(findings, span, rows, units[rows], what, word)
                good[good] = findings.ranged(rows[good], values[rows[good]], limit, what, word)
                _clamped(findings, span, rows[good], values[rows[good]], what, word)
                _frequency(view, findings, span, rows[good], values[rows[good]], what, word)
                fine &= good
            wrong = rows[fine & (path.low[rows] >= path.high[rows])]
            findings.at_rows(
                rules.MIN_ABOVE_MAX, wrong, "MIN", what="LASER FOLLOW", low=path.low[wrong], high=path.high[wrong]
            )
            if not machine.equal_axes:
                findings.at_rows(rules.FOLLOW_SCALES, rows[path.follow_in_mm[rows]], "")


def kept(view: View, findings: Findings) -> None:
    """Power that a LASER MODE leaves in force since it says the same mode again: it has new limits, another width."""
    path = view.job.path
    for channel in CHANNELS:
        places, lit = view.power_keys(channel), view.lit(channel)[0]
        for before, span in pairwise(view.modes(channel)):
            at = int(np.searchsorted(places, span.first * 2)) - 1
            if before.mode.mode is not span.mode.mode or at < 0 or places[at] % 2 == 0:
                continue
            until = min(int(places[at + 1]) // 2 if at + 1 < len(places) else len(path), span.last)
            part = slice(span.first, until)
            if not (lit[part] & path.takes_time[part]).any():
                continue
            row = places[at : at + 1] // 2
            by_power = (("LASER POWER", "value", path.power),)
            by_follow = ((_FOLLOW["MIN"], "MIN", path.low), (_FOLLOW["MAX"], "MAX", path.high))
            for what, word, values in by_power if path.op[row[0]] == Op.POWER else by_follow:
                _clamped(findings, span, row, values[row], what, word)
                _frequency(view, findings, span, row, values[row], what, word)


def saturation(view: View, findings: Findings) -> None:
    """Following that asks for more than its MAX at the velocity of a segment."""
    path = view.job.path
    for channel in CHANNELS:
        sets = ((path.op == Op.POWER) | (path.op == Op.FOLLOW)) & (path.channel == channel)
        if not (path.op[sets] == Op.FOLLOW).any():
            continue
        in_force = np.maximum.accumulate(np.where(sets, np.arange(len(path)), -1))
        lit = view.lit(channel)[0]
        marks = np.flatnonzero(path.moves & (path.op != Op.JUMP) & lit & (in_force >= 0))
        source = in_force[marks]
        asked = path.ratio[source] * path.vel[marks] + path.low[source]
        over = (path.op[source] == Op.FOLLOW) & (asked > path.high[source] * (1 + 1e-9))
        rows, first = np.unique(source[over], return_index=True)
        which = np.flatnonzero(over)[first]
        findings.at_rows(
            rules.SATURATES, rows, "", value=asked[which], high=path.high[rows], unit=_unit_at(view, channel, rows),
            velocity=path.vel[marks[which]] * view.shown.per_pulse_per_ms, speed=view.shown.speed,
        )  # fmt: skip


def unused(view: View, findings: Findings) -> None:
    """A power that is set anew before any light comes."""
    path = view.job.path
    for channel in CHANNELS:
        lit = view.lit(channel)[0]
        if not lit.any():
            continue
        places = view.power_keys(channel)
        shone = np.concatenate([[0], np.cumsum(lit & path.takes_time)])
        begins = (places + 1) // 2
        used = shone[np.append(begins[1:], len(path))] > shone[begins]
        # Before any light powers may be a header's defaults; the last one may leave the least behind.
        used |= shone[begins] == 0
        used[-1:] = True
        spans = view.modes(channel)
        buffered = (places % 2 == 1) & (places >= (spans[0].first * 2 if spans else 0))
        rows, used = places[buffered] // 2, used[buffered]
        # In a loop or routine the first or last round may go without.
        idle = rows[~used]
        idle = idle[~np.isin(path.line[idle], path.line[rows[used]])]
        for op in (Op.POWER, Op.FOLLOW):
            findings.at_rows(rules.POWER_UNUSED, idle[path.op[idle] == op], "", word=op.word)


def _unit_at(view: View, channel: int, rows: np.ndarray) -> np.ndarray:
    """The power unit in force at rows."""
    units = np.full(len(rows), "", dtype=object)
    for span in view.modes(channel):
        units[(rows >= span.first) & (rows < span.last)] = span.mode.mode.unit
    return np.array(units, dtype=str)


def _rows_in(view: View, op: Op, span: ModeSpan) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    path = view.job.path
    part = slice(span.first, span.last)
    return np.flatnonzero((path.op[part] == op) & (path.channel[part] == span.channel)) + span.first


def _units(
    findings: Findings, span: ModeSpan, rows: np.ndarray, written: np.ndarray, what: str, word: str
) -> np.ndarray:
    wanted = UNIT_OF_MODE[span.mode.mode]
    good: np.ndarray = (written == PowerUnit.NONE) | (written == wanted)
    for unit in set(written[~good].tolist()):
        findings.at_rows(
            rules.WRONG_UNIT, rows[written == unit], word, remarks=lambda _: findings.mode_remark(span.setup),
            **unit_fields(what, unit, wanted),
        )  # fmt: skip
    return good


def _clamped(findings: Findings, span: ModeSpan, rows: np.ndarray, values: np.ndarray, what: str, word: str) -> None:
    mode = span.mode
    out = (values < mode.low) | (values > mode.high)
    if out.any():
        findings.at_rows(
            rules.POWER_CLAMPED, rows[out], word, what=what, value=values[out], low=float(mode.low),
            high=float(mode.high), unit=mode.mode.unit, remarks=lambda _: findings.mode_remark(span.setup),
        )  # fmt: skip


def _frequency(
    view: View, findings: Findings, span: ModeSpan, rows: np.ndarray, values: np.ndarray, what: str, word: str
) -> None:
    """In frequency mode: the laser pulse must fit its period (M 二.2), the laser must follow the frequency."""
    mode = span.mode
    if mode.mode is not PowerMode.FREQUENCY or not mode.pulse_width_us:
        return
    # The frequency in force is what the mode's limits leave of it.
    duty = np.clip(values, mode.low, mode.high) * mode.pulse_width_us / 10
    bad = (values > 0) & (PULSE_DUTY_PCT.classify(duty) != Membership.INSIDE)
    if bad.any():
        findings.at_rows(
            rules.PULSE_TOO_WIDE, rows[bad], word, value=values[bad], width=float(mode.pulse_width_us), duty=duty[bad],
            range=str(PULSE_DUTY_PCT),
        )  # fmt: skip
    highest = view.machine.laser(span.channel).max_frequency_khz
    if highest is not None and (values > highest).any():
        fast = values > highest
        findings.at_rows(rules.CARRIER_TOO_FAST, rows[fast], word, what=what, value=values[fast], limit=highest)
