"""The numbers of statements while they are carried out: their values, kinds, and what is wrong with them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gusjob.diagnostics import rules
from gusjob.frontend.expand.lanes import Lanes, some
from gusjob.frontend.expand.ledger import Ledger
from gusjob.frontend.expand.program import Computed, Slot
from gusjob.frontend.parse.expressions import PLAIN, TRUTH, Expression, Mismatch, Type
from gusjob.frontend.parse.forms import Word
from gusjob.frontend.parse.lines import nearest
from gusjob.frontend.parse.statements import POWER_KINDS, WANTED
from gusjob.frontend.scan.shapes import MAX_NUMBER
from gusjob.i18n.phrases import Phrase, both_of, did_you_mean, number
from gusjob.kinematics.units import QuantityKind, UnitSystem

_LANES_A_STEP = 10
_NO_KIND: Type = PLAIN
"""The kind of a number that has none: what is wrong was said."""


@dataclass(slots=True)
class Evaluator:
    """Numbers for all lanes at once."""

    ledger: Ledger
    failed: set[str] = field(default_factory=set)
    """Names whose LET has no value or can't be read: that was said where they are set."""

    def number(
        self, expression: Expression, constants: Sequence[Any], lanes: Lanes, line: int, word: str, rows: int = 1
    ) -> tuple[Any, Type]:
        """The value of an expression and its kind; NaN where it has none, which is reported.

        With more than one row and lane the result has the shape (lanes, rows), or one that broadcasts to it.
        """
        scope, top = lanes.scope, lanes.top
        values: dict[str, Any] = {}
        types = []
        for name in expression.names:
            value = scope.values.get(name)
            source = scope
            if value is None:
                value, source = top.values.get(name), top
            if value is None:
                return self.unknown(name, lanes, line, word)
            values[name] = value.reshape(-1, 1) if rows > 1 and isinstance(value, np.ndarray) else value
            types.append(source.types[name])
        kind = expression.type(tuple(types))
        if isinstance(kind, Mismatch):
            self.mismatch(kind, lanes, line, word)
            return np.float64(np.nan), _NO_KIND
        self.ledger.spend(len(expression.code) // 3 * (1 + max(lanes.count, rows) // _LANES_A_STEP), line, lanes.trail)
        value = expression.run(values, constants)
        if not (np.isfinite(value).all() if isinstance(value, np.ndarray) else math.isfinite(value)):
            value = self.no_value(expression, value, values, lanes, line, word)
        return value, kind

    def unknown(self, name: str, lanes: Lanes, line: int, word: str) -> tuple[Any, Type]:
        """A name that was never set."""
        if (rules.UNKNOWN_NAME.code, line, word) in self.ledger.diagnostics:
            self.ledger.diagnostic(rules.UNKNOWN_NAME, line, word, lanes.trail, lanes.count)
        elif name not in self.failed:
            near = nearest(name, {**lanes.scope.values, **lanes.top.values})
            hint = did_you_mean(near) or Phrase(": write LET {name} = ... before it", name=name)
            self.ledger.diagnostic(rules.UNKNOWN_NAME, line, word, lanes.trail, lanes.count, name=name, hint=hint)
        return np.float64(np.nan), _NO_KIND

    def mismatch(self, found: Mismatch, lanes: Lanes, line: int, word: str) -> None:
        """Operands that do not fit."""
        given = both_of(kind_words(kind) for kind in found.given[:4])
        fields = {"operator": found.function.name, "wants": found.function.typing.value, "given": given}
        self.ledger.diagnostic(rules.MISMATCH, line, word, lanes.trail, lanes.count, **fields)

    def no_value(
        self, expression: Expression, value: Any, values: dict[str, Any], lanes: Lanes, line: int, word: str
    ) -> Any:
        """Division by zero, the root of a negative number, a name that not every lane has set."""
        wrong = ~np.isfinite(value)
        for name in expression.names:
            unset = np.isnan(values[name])
            if np.any(unset):
                if name not in self.failed:
                    count = int(np.count_nonzero(np.broadcast_to(unset, np.shape(value)) if np.ndim(value) else unset))
                    hint = Phrase(": not every way leads through its LET")
                    self.ledger.diagnostic(
                        rules.UNKNOWN_NAME, line, word, lanes.first_trail(unset), count, name=name, hint=hint
                    )
                wrong = wrong & ~unset
        if np.any(wrong):
            endless = not np.any(np.isnan(value))
            fields = {"value": Phrase("a number without end") if endless else Phrase("no number")}
            self.ledger.diagnostic(
                rules.NO_VALUE, line, word, lanes.first_trail(wrong), int(np.count_nonzero(wrong)), **fields
            )
        return np.where(np.isfinite(value), value, np.nan)[()]

    def fitted(self, value: Any, kind: Type, slot: Slot, lanes: Lanes, one: Computed) -> tuple[Any, int]:
        """A value as the word needs it, and the system it was written in."""
        word, line = slot.kind, one.line
        fits = kind == PLAIN or kind[0] == word.kind or (word.kind is QuantityKind.POWER and kind[0] in POWER_KINDS)
        if word.kind is QuantityKind.PLAIN:
            fits = kind == PLAIN
        if not fits:
            if not np.all(np.isnan(value)):
                name = one.statement.name if slot.word == "value" else f"{one.statement.name} {slot.word}"
                self.wrong_kind(kind, word, lanes, line, slot.word, name)
            return np.float64(np.nan), 0
        if kind[0] == QuantityKind.TIME and word.ms:
            value = value / 1000.0
        large = abs(value) > MAX_NUMBER
        if some(large):
            shown = number(float(np.max(np.abs(value))))
            self.ledger.diagnostic(
                rules.TOO_BIG, line, slot.word, lanes.first_trail(large), int(np.count_nonzero(large)), value=shown,
                limit=MAX_NUMBER,
            )  # fmt: skip
            value = np.where(large, np.nan, value)[()]
        return value, kind[1] if kind != PLAIN else 0

    def wrong_kind(self, kind: Type, word: Word, lanes: Lanes, line: int, place: str, what: str) -> None:
        """A comparison, or a number with a unit of another kind."""
        if kind[0] == TRUTH:
            self.ledger.diagnostic(rules.NOT_A_NUMBER, line, place, lanes.trail, lanes.count, what=what)
            return
        shown = QuantityKind(kind[0]).words
        fields = {"what": what, "wanted": WANTED[word.kind], "unit": Phrase("this expression"), "kind": shown}
        self.ledger.diagnostic(rules.WRONG_UNIT, line, place, lanes.trail, lanes.count, **fields, hint="")

    def count_of(self, value: Any, kind: Type, lanes: Lanes, line: int, word: str) -> Any:
        """A plain number for REPEAT and FOR; NaN where it is none."""
        if kind[0] == TRUTH:
            self.ledger.diagnostic(rules.NOT_A_NUMBER, line, word, lanes.trail, lanes.count, what=Phrase("a loop"))
            return np.float64(np.nan)
        return value

    def argument(
        self, expression: Expression, constants: Sequence[Any], lanes: Lanes, line: int, word: str, what: str, name: str
    ) -> tuple[Any, Type]:
        """The value of LET or of a routine's parameter, which gets a name."""
        value, kind = self.number(expression, constants, lanes, line, word)
        if kind[0] == TRUTH:
            self.ledger.diagnostic(rules.NOT_A_NUMBER, line, word, lanes.trail, lanes.count, what=what)
            value, kind = np.float64(np.nan), _NO_KIND
        if some(value != value):
            self.failed.add(name)
        return value, kind


def kind_words(kind: Type) -> str:
    """A kind for messages; a length or speed says whether it is in mm or in pulses."""
    if kind[0] == TRUTH:
        return Phrase("a comparison")
    words = QuantityKind(kind[0]).words
    if kind[0] > QuantityKind.ACCELERATION or kind[1] == UnitSystem.DEFAULT:
        return words
    in_mm = kind[1] == UnitSystem.MM
    return Phrase("{kind} in mm", kind=words) if in_mm else Phrase("{kind} in pulses", kind=words)
