"""The numbers of statements while they are expanded: their values and kinds, and their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct, field

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Rule
from gusjob.frontend.expand.lanes import Lanes, any_lane
from gusjob.frontend.expand.ledger import Ledger
from gusjob.frontend.expand.program import ComputedStatements, ExpressionSlot
from gusjob.frontend.parse.expressions import Expression, Mismatch
from gusjob.frontend.parse.forms import Word
from gusjob.frontend.parse.intent import ANY_NAME
from gusjob.frontend.parse.operators import PLAIN, TRUTH, NumberType
from gusjob.frontend.parse.unread_numbers import EXPECTED_KIND, POWER_KINDS
from gusjob.frontend.scan.shapes import MAX_NUMBER, MIN_NUMBER
from gusjob.i18n.phrases import Phrase, both_of, did_you_mean, number
from gusjob.i18n.spelling import nearest
from gusjob.kinematics.units import QuantityKind, UnitSystem

_NUMBERS_PER_STEP = 100
_NO_KIND: NumberType = PLAIN
"""The kind of a number that has none: what is wrong is already reported."""


class Site(Struct, frozen=True):
    """A word of a line whose number is computed, in some lanes."""

    lanes: Lanes
    line: int
    word: str


class Evaluator(Struct):
    """Computes numbers for all lanes at once."""

    ledger: Ledger
    unset: set[str] = field(default_factory=set)
    """Names whose LET has no value or can't be parsed: that is reported where they are set. With ANY_NAME any name
    may be one of them."""

    def report(self, rule: Rule, site: Site, /, **fields: object) -> None:
        """Report a diagnostic that concerns all lanes."""
        self.ledger.report(rule, site.line, site.word, site.lanes.provenance, site.lanes.count, **fields)

    def report_where(self, rule: Rule, site: Site, where: Any, count: int, /, **fields: object) -> None:
        """Report a diagnostic that concerns some lanes."""
        self.ledger.report(rule, site.line, site.word, site.lanes.first_provenance(where), count, **fields)

    def number(
        self, expression: Expression, constants: Sequence[Any], site: Site, rows: int = 1
    ) -> tuple[Any, NumberType]:
        """Compute an expression.

        Args:
            expression: The expression.
            constants: Its numbers.
            site: Where it is.
            rows: How many rows have the expression, each with numbers of its own.

        Returns:
            The value, NaN where it has none (which is reported), and its kind. With more than one row and lane the
            value has the shape (lanes, rows), or one that broadcasts to it.
        """
        scope, top = site.lanes.scope, site.lanes.top
        values: dict[str, Any] = {}
        types = []
        for name in expression.names:
            found = scope.get(name) or top.get(name)
            if found is None:
                self.report_unknown(name, site)
                return np.float64(np.nan), _NO_KIND
            value, type_ = found
            values[name] = value.reshape(-1, 1) if rows > 1 and isinstance(value, np.ndarray) else value
            types.append(type_)
        kind = expression.type(tuple(types))
        if isinstance(kind, Mismatch) and any(np.all(np.isnan(value)) for value in values.values()):
            return np.float64(np.nan), _NO_KIND  # A name without a value has no kind; it is reported where it is set.
        if isinstance(kind, Mismatch):
            given = both_of(kind_words(operand) for operand in kind.given[:4])
            self.report(
                rules.UNIT_MISMATCH, site, operator=kind.function.name, wants=kind.function.typing.value, given=given
            )
            return np.float64(np.nan), _NO_KIND
        steps = expression.work * (1 + site.lanes.count * rows // _NUMBERS_PER_STEP)
        self.ledger.count_steps(steps, site.line, site.lanes.provenance)
        value = expression.run(values, constants)
        if not (np.isfinite(value).all() if isinstance(value, np.ndarray) else math.isfinite(value)):
            value = self.without_value(expression, value, values, site)
        return value, kind

    def report_unknown(self, name: str, site: Site) -> None:
        """Report a name that was never set."""
        if (rules.UNKNOWN_NAME.code, site.line, site.word) in self.ledger.reported:
            self.report(rules.UNKNOWN_NAME, site)
        elif not self.unset & {name, ANY_NAME}:
            near = nearest(name, dict.fromkeys([*site.lanes.scope.names(), *site.lanes.top.names()]))
            hint = did_you_mean(near) or Phrase(": write LET {name} = ... before it", name=name)
            self.report(rules.UNKNOWN_NAME, site, name=name, hint=hint)

    def without_value(self, expression: Expression, value: Any, values: dict[str, Any], site: Site) -> Any:
        """Report numbers that are not finite, and make them NaN.

        Causes: a division by zero, the root of a negative number, a name that not every lane has set.
        """
        wrong = ~np.isfinite(value)
        for name in expression.names:
            unset = np.isnan(values[name])
            if np.any(unset):
                if not self.unset & {name, ANY_NAME}:
                    count = int(np.count_nonzero(np.broadcast_to(unset, np.shape(value)) if np.ndim(value) else unset))
                    hint = Phrase(": its LET does not always run before this line")
                    self.report_where(rules.UNKNOWN_NAME, site, unset, count, name=name, hint=hint)
                wrong = wrong & ~unset
        if np.any(wrong):
            shown = Phrase("not a number") if np.any(np.isnan(value)) else Phrase("infinity")
            self.report_where(rules.NO_VALUE, site, wrong, int(np.count_nonzero(wrong)), value=shown)
        return np.where(np.isfinite(value), value, np.nan)[()]

    def fitted(
        self, value: Any, kind: NumberType, slot: ExpressionSlot, lanes: Lanes, statements: ComputedStatements
    ) -> tuple[Any, int]:
        """A value as its word takes it, and the unit system in which it was written."""
        word, site = slot.kind, Site(lanes, statements.line, slot.word)
        fits = kind == PLAIN or kind[0] == word.kind or (word.kind is QuantityKind.POWER and kind[0] in POWER_KINDS)
        if word.kind is QuantityKind.PLAIN:
            fits = kind == PLAIN
        if not fits:
            if not np.all(np.isnan(value)):
                name = statements.statement.name
                self.report_wrong_kind(kind, word, site, name if slot.word == "value" else f"{name} {slot.word}")
            return np.float64(np.nan), 0
        if kind[0] == QuantityKind.TIME and word.ms:
            value = value / 1000.0
        large = abs(value) > MAX_NUMBER
        if any_lane(large):
            shown = number(float(np.nanmax(np.abs(value))))
            count = int(np.count_nonzero(large))
            self.report_where(rules.NUMBER_TOO_LARGE, site, large, count, value=shown, limit=MAX_NUMBER)
            value = np.where(large, np.nan, value)[()]
        small = (abs(value) < MIN_NUMBER) & (value != 0)
        if any_lane(small):
            shown = number(float(np.min(np.abs(np.asarray(value)[small]))))
            count = int(np.count_nonzero(small))
            self.report_where(rules.NUMBER_TOO_SMALL, site, small, count, value=shown, limit=MIN_NUMBER)
            value = np.where(small, np.nan, value)[()]
        return value, kind[1] if kind != PLAIN else 0

    def report_wrong_kind(self, kind: NumberType, word: Word, site: Site, what: str) -> None:
        """Report a comparison, or a number with a unit of another kind."""
        if kind[0] == TRUTH:
            self.report(rules.NOT_A_NUMBER, site, what=what)
            return
        fields = {"what": what, "wanted": EXPECTED_KIND[word.kind], "unit": Phrase("this expression")}
        self.report(rules.WRONG_UNIT, site, **fields, kind=QuantityKind(kind[0]).words, hint="")

    def bound(self, value: Any, kind: NumberType, site: Site) -> Any:
        """A bound of REPEAT or FOR; NaN where it is not a number."""
        if kind[0] == TRUTH:
            self.report(rules.NOT_A_NUMBER, site, what=Phrase("a loop"))
            return np.float64(np.nan)
        return value

    def named_number(
        self, expression: Expression, constants: Sequence[Any], site: Site, what: str, name: str
    ) -> tuple[Any, NumberType]:
        """The value of a LET or of a routine's parameter. `what`: the statement that sets the name."""
        value, kind = self.number(expression, constants, site)
        if kind[0] == TRUTH:
            self.report(rules.NOT_A_NUMBER, site, what=what)
            value, kind = np.float64(np.nan), _NO_KIND
        if any_lane(value != value):
            self.unset.add(name)
        return value, kind


def kind_words(kind: NumberType) -> str:
    """Name of a kind in messages; for a length or speed also whether it is in mm or in pulses."""
    if kind[0] == TRUTH:
        return Phrase("a comparison")
    words = QuantityKind(kind[0]).words
    if kind[0] > QuantityKind.ACCELERATION or kind[1] == UnitSystem.DEFAULT:
        return words
    in_mm = kind[1] == UnitSystem.MM
    return Phrase("{kind} in mm", kind=words) if in_mm else Phrase("{kind} in pulses", kind=words)
