"""Collects the diagnostics of one lint run, and checks values against ranges."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field

from gusjob.controllers.gus.ranges import Membership, PowerMode, Range
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Remark, Rule, Severity
from gusjob.i18n.phrases import Phrase
from gusjob.ir.modal import ModeSpan
from gusjob.ir.setup import Setup
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import PowerUnit, QuantityKind
from gusjob.lint.context import LintContext, Remarks, no_remarks, same_remarks

UNIT_OF_MODE = {
    PowerMode.DUTY: PowerUnit.PERCENT,
    PowerMode.FREQUENCY: PowerUnit.KHZ,
    PowerMode.ANALOG: PowerUnit.VOLT,
    PowerMode.DUTY2: PowerUnit.PERCENT,
}
_KIND_OF_UNIT = {
    PowerUnit.PERCENT: QuantityKind.SHARE,
    PowerUnit.KHZ: QuantityKind.FREQUENCY,
    PowerUnit.VOLT: QuantityKind.VOLTAGE,
}


class Reporter(Struct):
    """Diagnostics of one lint run."""

    context: LintContext
    collector: Collector
    seen: dict[tuple[Any, ...], int] = field(default_factory=dict)
    """For a job with loops: index of each diagnostic by rule, statement and subject. A statement has each one once,
    however often it runs."""
    faulty: set[int] = field(default_factory=set)
    """Lines with an error."""
    suspect: frozenset[int] = frozenset()
    """Lines with an error of an earlier check: what the running one finds in their values may follow from it."""

    def begin(self, *, derived: bool) -> None:
        """Begin a check. `derived`: it combines values that other checks look at alone."""
        self.suspect = frozenset(self.faulty) if derived else frozenset()

    def is_sound(self, lines: npt.NDArray[np.integer[Any]]) -> Bools:
        """Whether the values of lines may be combined: no check has found an error there, (k,)."""
        return ~np.isin(lines, np.fromiter(self.suspect, dtype=np.int64, count=len(self.suspect)))

    def line(
        self,
        rule: Rule,
        line: int,
        word: str = "",
        /,
        *,
        provenance: int = 0,
        count: int = 1,
        remarks: tuple[Remark, ...] = (),
        **fields: Any,
    ) -> None:
        """Report one diagnostic at a word of a line ('' for the statement, 'value' for its number)."""
        if line in self.suspect:
            return
        if rule.severity is Severity.ERROR:
            self.faulty.add(line)
        job = self.context.job
        key = (rule.code, line, word, fields.get("what"), fields.get("axis"), fields.get("channel"))
        if job.provenance is not None and key in self.seen:
            self.collector.count_again(self.seen[key], count)
            return
        if not self.collector.remaining(rule):
            self.collector.count_unlisted(rule, 1)
            return
        self.seen[key] = len(self.collector.found)
        span = job.locate(line, word)
        if job.provenance is not None:
            remarks = (*remarks, *job.name_remarks(line, word), *job.provenance_remarks(provenance))
        self.collector.add(rule, span, fields, count, remarks)

    def setup(
        self, rule: Rule, setup: Setup, word: str = "", /, *, remarks: tuple[Remark, ...] = (), **fields: Any
    ) -> None:
        """Report one diagnostic at a word of a setup statement."""
        self.line(rule, setup.line, word, provenance=setup.provenance, remarks=remarks, **fields)

    def rows(self, rule: Rule, rows: Indices, word: str, /, *, remarks: Remarks = no_remarks, **columns: Any) -> None:
        """Report one diagnostic a row; a column that is an array has one entry a row of `rows`."""
        path = self.context.path
        if self.suspect:
            sound = self.is_sound(path.line[rows]) & self.is_sound(path.vel_line[rows])
            kept = np.flatnonzero(sound & self.is_sound(path.acc_line[rows]))
            rows, remarks = rows[kept], _picked(remarks, kept)
            columns = {k: v[kept] if isinstance(v, np.ndarray) else v for k, v in columns.items()}
        words = np.broadcast_to(word, len(rows))
        self.lines(rule, path.line[rows], path.provenance[rows], words, remarks=remarks, **columns)

    def lines(
        self,
        rule: Rule,
        lines: npt.NDArray[np.int32],
        provenance: npt.NDArray[np.int32],
        words: npt.NDArray[np.str_],
        /,
        *,
        remarks: Remarks = no_remarks,
        **columns: Any,
    ) -> None:
        """Report one diagnostic a line of (k,); in a job with loops, one for all iterations of the same statement."""
        firsts, counts = np.arange(len(lines)), np.ones(len(lines), dtype=np.intp)
        if self.context.job.provenance is not None:
            _, firsts, counts = np.unique(lines, return_index=True, return_counts=True)
        listed = min(len(firsts), self.collector.remaining(rule))
        for i, count in zip(firsts[:listed].tolist(), counts[:listed].tolist(), strict=True):
            fields = {k: v[i].item() if isinstance(v, np.ndarray) else v for k, v in columns.items()}
            line, node = int(lines[i]), int(provenance[i])
            self.line(rule, line, str(words[i]), provenance=node, count=count, remarks=remarks(i), **fields)
        self.collector.count_unlisted(rule, len(firsts) - listed)

    def rows_in_range(self, rows: Indices, values: Floats, allowed: Range, what: str, word: str) -> Bools:
        """Check values, one a row, against a range.

        Returns:
            Which of them are good, (k,).
        """
        membership, carried = allowed.classify(values), allowed.carries(values)
        if not membership.any() and carried.all():
            return np.ones(len(values), dtype=np.bool_)
        outside = membership == Membership.OUTSIDE
        fields: dict[str, Any] = {"what": what, "unit": allowed.unit, "range": str(allowed), "hint": ""}
        self.rows(rules.OUT_OF_RANGE, rows[outside], word, value=values[outside], **fields)
        ends = (membership == Membership.ON_TOLERATED_END) & carried
        self.rows(rules.ON_EXCLUDED_END, rows[ends], word, value=values[ends], **fields)
        broken = ~outside & ~carried
        self.rows(rules.NOT_WHOLE, rows[broken], word, value=values[broken], **fields)
        return np.asarray(~outside & carried)

    def in_range(self, setup: Setup, value: float, allowed: Range, what: str, word: str = "value") -> bool:
        """Check a setup statement's number against a range; returns whether it is good."""
        membership = allowed.classify_one(value)
        if membership is Membership.OUTSIDE:
            rule = rules.OUT_OF_RANGE
        elif not allowed.carries(value):
            rule = rules.NOT_WHOLE
        elif membership is Membership.ON_TOLERATED_END:
            rule = rules.ON_EXCLUDED_END
        else:
            return True
        self.setup(rule, setup, word, what=what, value=value, unit=allowed.unit, range=str(allowed), hint="")
        return rule is rules.ON_EXCLUDED_END

    def rows_in_unit(self, mode: ModeSpan, rows: Indices, units: npt.NDArray[np.int8], what: str, word: str) -> Bools:
        """Check the units in which powers were written, one a row, against the mode's unit.

        Returns:
            Which of them are good, (k,).
        """
        expected = UNIT_OF_MODE[mode.mode.mode]
        good = np.asarray((units == PowerUnit.NONE) | (units == expected))
        for unit in set(units[~good].tolist()):
            fields = _unit_fields(what, unit, expected)
            remarks = same_remarks(self.context.mode_remark(mode))
            self.rows(rules.WRONG_UNIT, rows[units == unit], word, remarks=remarks, **fields)
        return good

    def in_unit(self, setup: Setup, word: str, what: str, unit: PowerUnit, mode: ModeSpan) -> bool:
        """Check the unit in which a setup statement's power was written; returns whether it is good."""
        expected = UNIT_OF_MODE[mode.mode.mode]
        if unit in (PowerUnit.NONE, expected):
            return True
        fields = _unit_fields(what, unit, expected)
        self.setup(rules.WRONG_UNIT, setup, word, remarks=self.context.mode_remark(mode), **fields)
        return False


def _picked(remarks: Remarks, kept: Indices) -> Remarks:
    """The remarks of the diagnostics that are kept."""
    return lambda index: remarks(int(kept[index]))


def _unit_fields(what: str, written: int, expected: PowerUnit) -> dict[str, Any]:
    """Fields of WRONG_UNIT for a power."""
    unit = PowerUnit(written)
    return {
        "what": what,
        "wanted": Phrase("in {unit} in this mode", unit=expected.text),
        "unit": unit.text,
        "kind": _KIND_OF_UNIT[unit].words,
        "hint": "",
    }
