"""Check arguments against their ranges: which calls the controller accepts, and how it refuses the others."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.calls import (
    BUFFERED,
    C_TYPE_WORDS,
    FOLLOW_KINDS,
    SIGNATURES,
    Arg,
    ArgKind,
    ArgumentConversion,
    Buffered,
    BufferedCalls,
    Call,
    Signature,
    Stream,
)
from gusjob.controllers.gus.ranges import FOLLOW, POWER, Membership, PowerMode, Range
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase, number
from gusjob.kinematics.arrays import Bools, Indices, blocks

EXECUTION_ERROR, PARAMETER_ERROR = 1, 7
"""Return codes (sister series)."""

_UNUSED_WHEN_OFF = ("GT_SetWaitPulse", "GT_SetPreVltg", "GT_SetLaserDisMode")
"""Calls whose other numbers are not used if their first argument switches off."""


def argument_error(call: Call) -> str:
    """Describe the first argument for which the controller refuses an immediate call; '' if it accepts the call."""
    switched_off = call.name in _UNUSED_WHEN_OFF and call.args[0] == 0.0
    for arg, value in zip(SIGNATURES[call.name].args, call.args, strict=True):
        if arg.range is None or (switched_off and arg.kind in (ArgKind.REAL, ArgKind.ARRAY)):
            continue
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, float) and (reason := range_error(arg.range, arg.name, one)):
                return reason
    return ""


def range_error(allowed: Range, name: str, value: float) -> str:
    """Describe why a value does not fit a range; '' if it does."""
    # A value that is off by float noise is shown with all its digits.
    written = number(value) if range_has(allowed, float(number(value))) == range_has(allowed, value) else repr(value)
    shown = f"{name} {written} {allowed.unit}".rstrip()
    if allowed.classify_one(value) is Membership.OUTSIDE:
        return Phrase("{value} is outside {range}", value=shown, range=str(allowed))
    return "" if allowed.carries(value) else Phrase("{value} is not whole", value=shown)


def conversion_diagnostics(stream: Stream) -> list[Diagnostic]:
    """Report the arguments of a listing that do not arrive as they are written."""
    collector = Collector(stream.name)
    report_conversions(stream.conversions, collector)
    return collector.finish(rules.NOT_LISTED)


def report_conversions(conversions: Iterable[ArgumentConversion], collector: Collector) -> None:
    """Report arguments that do not arrive as they are written."""
    for found in conversions:
        for rule, where in (
            (rules.ARGUMENT_UNDEFINED, np.isnan(found.arrives)),
            (rules.ARGUMENT_CONVERTED, ~np.isnan(found.arrives)),
        ):
            at = np.flatnonzero(where)
            listed = at[: collector.remaining(rule)].tolist()
            for i in listed:
                fields = {
                    "argument": found.argument,
                    "call": found.call,
                    "type": C_TYPE_WORDS.get(found.c, found.c.value),
                    "value": float(found.written[i]),
                    "arrives": float(found.arrives[i]),
                }
                collector.add(rule, Span(line=int(found.line[i])), fields)
            collector.count_unlisted(rule, len(at) - len(listed))


def range_has(allowed: Range, value: float) -> bool:
    """Whether a call carries a value and the controller accepts it."""
    return allowed.classify_one(value) is not Membership.OUTSIDE and bool(allowed.carries(value))


class ArgumentChecker(Struct, kw_only=True):
    """Checks arguments of buffered calls. `modes`: power modes of both channels when the calls are made."""

    calls: BufferedCalls
    modes: tuple[PowerMode, PowerMode]
    collector: Collector

    def accepted(self, rows: Indices) -> Indices:
        """Return the rows whose arguments the controller accepts; report the others."""
        bad = np.zeros(len(rows), dtype=np.bool_)
        kinds = self.calls.kind[rows]
        for kind, signature in BUFFERED.items():
            at = np.flatnonzero(kinds == kind)
            if not len(at):
                continue
            for arg in signature.args:
                if arg.range is not None:
                    self._check(rows, at, signature, arg, arg.range, bad)
            if kind in (Buffered.POWER, *FOLLOW_KINDS):
                for channel, mode in enumerate(self.modes):
                    mine = at[self.calls.channel[rows[at]] == channel]
                    allowed = FOLLOW[mode] if kind == Buffered.FOLLOW else POWER[mode]
                    self._check_power(rows, mine, signature, allowed, bad)
        return rows[~bad] if bad.any() else rows

    def _check_power(self, rows: Indices, at: Indices, signature: Signature, allowed: Range, bad: Bools) -> None:
        """Check powers, whose range depends on the mode, and that a follow's max is above its min."""
        for arg in signature.args:
            if arg.range is None:
                self._check(rows, at, signature, arg, allowed, bad)
        if signature.buffered in FOLLOW_KINDS:
            upside_down = at[~(self.calls.r[rows[at]] > self.calls.q[rows[at]]) & ~bad[at]]
            reason = Phrase("maxPower must be above minPower")
            self._report(rules.REFUSED, rows[upside_down], lambda _: _refused(signature, reason))
            bad[upside_down] = True

    def _check(self, rows: Indices, at: Indices, signature: Signature, arg: Arg, allowed: Range, bad: Bools) -> None:
        """Check one argument of the rows at `at`; mark bad rows."""
        if all(self._fits(rows[at[part]], arg, allowed) for part in blocks(len(at))):
            return
        values = self.calls.column(arg.column)[rows[at]]
        verdict = allowed.classify(values)
        whole = allowed.carries(values) if allowed.whole else np.isfinite(values)
        wrong = (verdict == Membership.OUTSIDE) | ~whole
        fresh = np.flatnonzero(wrong & ~bad[at])
        self._report(
            rules.REFUSED,
            rows[at[fresh]],
            lambda i: _refused(signature, range_error(allowed, arg.name, float(values[fresh[i]]))),
        )
        bad[at[wrong]] = True
        ends = np.flatnonzero((verdict == Membership.ON_TOLERATED_END) & whole)
        what = {"what": f"{signature.name} {arg.name}", "unit": allowed.unit, "range": str(allowed)}
        self._report(rules.ON_EXCLUDED_END, rows[at[ends]], lambda i: {**what, "value": float(values[ends[i]])})

    def _fits(self, rows: Indices, arg: Arg, allowed: Range) -> bool:
        """Whether one argument of some rows is within its range, and no number that the call does not carry."""
        values = self.calls.column(arg.column)[rows]
        return bool(not allowed.classify(values).any() and allowed.carries(values).all())

    def _report(self, rule: Rule, rows: Indices, fields: Callable[[int], dict[str, object]]) -> None:
        """Report each row, with the fields for the i-th."""
        listed = rows[: self.collector.remaining(rule)].tolist()
        for i, row in enumerate(listed):
            self.collector.add(rule, Span(line=int(self.calls.line[row])), fields(i))
        self.collector.count_unlisted(rule, len(rows) - len(listed))


def _refused(signature: Signature, reason: str) -> dict[str, object]:
    return {"call": signature.name, "code": PARAMETER_ERROR, "reason": reason}
