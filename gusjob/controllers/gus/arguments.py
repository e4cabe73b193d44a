"""Arguments against their ranges: which calls the controller takes, and what it says of the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gusjob.controllers.gus.calls import BUFFERED, SIGNATURES, Arg, ArgKind, Buffered, BufferedCalls, Call, Signature
from gusjob.controllers.gus.ranges import FOLLOW, POWER, Membership, PowerMode, Range
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Rule, Span
from gusjob.i18n.phrases import Phrase, number
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.simulate.state import PARAMETER_ERROR

_OFF_MEANS_NOTHING = ("GT_SetWaitPulse", "GT_SetPreVltg", "GT_SetLaserDisMode")
"""Calls whose other numbers mean nothing while their first argument switches off."""


def bad_argument(call: Call) -> str:
    """Why the controller would not take a call that is not buffered; '' if it would."""
    switched_off = call.name in _OFF_MEANS_NOTHING and call.args[0] == 0.0
    for arg, value in zip(SIGNATURES[call.name].args, call.args, strict=True):
        if arg.range is None or (switched_off and arg.kind in (ArgKind.REAL, ArgKind.ARRAY)):
            continue
        for one in value if isinstance(value, tuple) else (value,):
            if isinstance(one, float) and (reason := out_of(arg.range, arg.name, one)):
                return reason
    return ""


def out_of(allowed: Range, name: str, value: float) -> str:
    """Why a value is none for a range; '' if it is one."""
    shown = f"{name} {number(value)} {allowed.unit}".rstrip()
    if allowed.classify_one(value) is Membership.OUTSIDE:
        return Phrase("{value} is outside {range}", value=shown, range=str(allowed))
    return "" if allowed.carries(value) else Phrase("{value} is not whole", value=shown)


@dataclass(slots=True, kw_only=True)
class BufferedJudge:
    """Judges buffered rows. `modes`: of both channels, when the calls are made."""

    calls: BufferedCalls
    modes: tuple[PowerMode, PowerMode]
    collector: Collector

    def taken(self, rows: Indices) -> Indices:
        """The rows whose arguments the controller takes; the others are diagnostics."""
        bad = np.zeros(len(rows), dtype=np.bool_)
        kinds = self.calls.kind[rows]
        for kind, signature in BUFFERED.items():
            at = np.flatnonzero(kinds == kind)
            if not len(at):
                continue
            for arg in signature.args:
                if arg.range is not None:
                    self.judge(rows, at, signature, arg, arg.range, bad)
            if kind in (Buffered.POWER, Buffered.FOLLOW):
                for channel, mode in enumerate(self.modes):
                    mine = at[self.calls.channel[rows[at]] == channel]
                    self.judge_power(
                        rows, mine, signature, POWER[mode] if kind == Buffered.POWER else FOLLOW[mode], bad
                    )
        return rows[~bad] if bad.any() else rows

    def judge_power(self, rows: Indices, at: Indices, signature: Signature, allowed: Range, bad: Bools) -> None:
        """Powers, whose range hangs on the mode; and follow's max above its min."""
        for arg in signature.args:
            if arg.range is None:
                self.judge(rows, at, signature, arg, allowed, bad)
        if signature.buffered is Buffered.FOLLOW:
            upside_down = at[~(self.calls.r[rows[at]] > self.calls.q[rows[at]]) & ~bad[at]]
            reason = Phrase("maxPower must be above minPower")
            self.each(rules.REFUSED, rows[upside_down], lambda _: _refused(signature, reason))
            bad[upside_down] = True

    def judge(self, rows: Indices, at: Indices, signature: Signature, arg: Arg, allowed: Range, bad: Bools) -> None:
        """One argument of the rows at `at` against its range."""
        values = self.calls.column(arg.column)[rows[at]]
        verdict = allowed.classify(values)
        whole = allowed.carries(values) if allowed.whole else np.isfinite(values)
        if not verdict.any() and whole.all():
            return
        wrong = (verdict == Membership.OUTSIDE) | ~whole
        fresh = np.flatnonzero(wrong & ~bad[at])
        self.each(
            rules.REFUSED,
            rows[at[fresh]],
            lambda i: _refused(signature, out_of(allowed, arg.name, float(values[fresh[i]]))),
        )
        bad[at[wrong]] = True
        ends = np.flatnonzero((verdict == Membership.ON_TOLERATED_END) & whole)
        what = {"what": f"{signature.name} {arg.name}", "unit": allowed.unit, "range": str(allowed)}
        self.each(rules.ON_OPEN_END, rows[at[ends]], lambda i: {**what, "value": float(values[ends[i]])})

    def each(self, rule: Rule, rows: Indices, fields: Callable[[int], dict[str, object]]) -> None:
        """A diagnostic for each row, with the fields for the i-th."""
        listed = rows[: self.collector.room(rule)].tolist()
        for i, row in enumerate(listed):
            self.collector.add(rule, Span(line=int(self.calls.line[row])), fields(i))
        self.collector.uncounted(rule, len(rows) - len(listed))


def _refused(signature: Signature, reason: str) -> dict[str, object]:
    return {"call": signature.name, "code": PARAMETER_ERROR, "reason": reason}
