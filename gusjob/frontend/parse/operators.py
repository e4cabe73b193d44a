"""Operators and functions of expressions: what they compute, and how kinds of operands give the kind of a result.

Every function takes single numbers as well as arrays. A result that has no value (a division by zero, an operand
without a value) is NaN.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from enum import Enum
from typing import Any

import numpy as np
from msgspec import Struct

from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.geometry import sin_cos_deg
from gusjob.kinematics.units import QuantityKind

Number = np.float64 | Floats
"""One value, or one for each lane."""
NumberType = tuple[int, int]
"""A QuantityKind (or TRUTH), and the system it was written in (units.UnitSystem, or units.PowerUnit for powers)."""

TRUTH = -1
"""In place of a QuantityKind: the result of a comparison, 1 true, 0 false, NaN where an operand has no value."""
PLAIN: NumberType = (QuantityKind.PLAIN, 0)
NAMED_NUMBERS = {"pi": np.float64(np.pi)}
"""Names that the language defines."""


class Typing(Enum):
    """How the kind of a result follows from the kinds of the operands; the text says which operands are allowed."""

    SAME = Phrase("takes numbers of one kind")
    KEEP = Phrase("takes a number")
    TIMES = Phrase("needs a plain number on one side")
    OVER = Phrase("needs a plain number as the divisor, or two numbers of one kind")
    PLAIN = Phrase("takes plain numbers")
    ANGLE = Phrase("takes an angle in degrees")
    RATIO = Phrase("takes two numbers of one kind")
    COMPARE = Phrase("compares two numbers of one kind")
    TRUTH = Phrase("joins comparisons")


class Function(Struct, frozen=True):
    """An operator or function.

    Attributes:
        name: What users call it.
        arity: How many operands it takes; None: one or more.
        typing: How the kind of the result is found.
        run: Computes it.
        work: How long it takes, as a multiple of an addition.
    """

    name: str
    arity: int | None
    typing: Typing
    run: Callable[..., Any]
    work: int = 1


def result_type(typing: Typing, operands: tuple[NumberType, ...]) -> NumberType | None:
    """The kind of a result; None where the operands do not fit."""
    if (TRUTH, 0) in operands and typing is not Typing.TRUTH:
        return None
    same = all(one == operands[0] for one in operands)
    match typing:
        case Typing.SAME:
            return operands[0] if same else None
        case Typing.KEEP:
            return operands[0]
        case Typing.TIMES:
            left, right = operands
            return left if right == PLAIN else right if left == PLAIN else None
        case Typing.OVER:
            left, right = operands
            return left if right == PLAIN else PLAIN if same else None
        case Typing.PLAIN:
            return PLAIN if same and operands[0] == PLAIN else None
        case Typing.ANGLE:
            return PLAIN if operands[0][0] in (QuantityKind.PLAIN, QuantityKind.ANGLE) else None
        case Typing.RATIO:
            return PLAIN if same else None
        case Typing.COMPARE:
            return (TRUTH, 0) if same else None
        case Typing.TRUTH:
            return (TRUTH, 0) if all(kind == TRUTH for kind, _ in operands) else None


def _sin(degrees: Any) -> Any:
    return sin_cos_deg(degrees)[0] if isinstance(degrees, np.ndarray) else _sine(float(degrees), 0)


def _cos(degrees: Any) -> Any:
    return sin_cos_deg(degrees)[1] if isinstance(degrees, np.ndarray) else _sine(float(degrees), 1)


def _sine(degrees: float, quarters: int) -> np.float64:
    """The sine of an angle plus some quarter turns: geometry.sin_cos_deg for one number, without the cost of arrays."""
    if not math.isfinite(degrees):
        return np.float64(np.nan)
    whole = round(degrees / 90.0)
    rest, quarter = math.radians(degrees - 90.0 * whole), whole + quarters
    sine = math.cos(rest) if quarter % 2 else math.sin(rest)
    return np.float64((-sine if quarter % 4 >= 2 else sine) + 0.0)


def _tan(degrees: Any) -> Any:
    return _divide(_sin(degrees), _cos(degrees))


def _strict(run: Callable[..., Any]) -> Callable[..., Any]:
    """A function that has no value where an operand has none: min(1/0, 3) is not 3."""

    def checked(*values: Any) -> Any:
        finite = np.isfinite(values[0])
        for value in values[1:]:
            finite = finite & np.isfinite(value)
        return np.where(finite, run(*values), np.nan)[()]

    return checked


def _divide(a: Any, b: Any) -> Any:
    if not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray):
        return a / b if b != 0 and math.isfinite(b) else np.float64(np.nan)
    return np.where((b == 0) | ~np.isfinite(b), np.nan, a / b)[()]


def _maximum(*values: Any) -> Any:
    result = values[0]
    for value in values[1:]:
        result = np.maximum(result, value)
    return result


def _minimum(*values: Any) -> Any:
    result = values[0]
    for value in values[1:]:
        result = np.minimum(result, value)
    return result


def _comparison(compare: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def run(a: Any, b: Any) -> Any:
        if not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray):
            return np.float64(compare(a, b)) if math.isfinite(a) and math.isfinite(b) else np.float64(np.nan)
        finite = np.isfinite(a) & np.isfinite(b)
        return np.where(finite, compare(a, b), np.nan)[()]

    return run


def _and(a: Any, b: Any) -> Any:
    return np.where((a == 0) | (b == 0), 0.0, a * b)[()]


def _or(a: Any, b: Any) -> Any:
    return np.where((a == 1) | (b == 1), 1.0, a + b)[()]


def _not(a: Any) -> Any:
    return 1.0 - a


OPERATORS = {
    "OR": Function("or", 2, Typing.TRUTH, _or, work=5),
    "AND": Function("and", 2, Typing.TRUTH, _and, work=5),
    "NOT": Function("not", 1, Typing.TRUTH, _not),
    "LT": Function("<", 2, Typing.COMPARE, _comparison(operator.lt), work=4),
    "LE": Function("<=", 2, Typing.COMPARE, _comparison(operator.le), work=4),
    "GT": Function(">", 2, Typing.COMPARE, _comparison(operator.gt), work=4),
    "GE": Function(">=", 2, Typing.COMPARE, _comparison(operator.ge), work=4),
    "EQ": Function("==", 2, Typing.COMPARE, _comparison(operator.eq), work=4),
    "NE": Function("!=", 2, Typing.COMPARE, _comparison(operator.ne), work=4),
    "PLUS": Function("+", 2, Typing.SAME, operator.add),
    "MINUS": Function("-", 2, Typing.SAME, operator.sub),
    "STAR": Function("*", 2, Typing.TIMES, operator.mul),
    "SLASH": Function("/", 2, Typing.OVER, _divide, work=4),
    "MODULO": Function("%", 2, Typing.SAME, _strict(operator.mod), work=12),
    "POWER_OF": Function("**", 2, Typing.PLAIN, np.power, work=24),
}
"""By terminal of the grammar."""
NEGATE = Function("-", 1, Typing.KEEP, operator.neg)
FUNCTIONS = {
    "sqrt": Function("sqrt", 1, Typing.PLAIN, np.sqrt),
    "abs": Function("abs", 1, Typing.KEEP, np.abs),
    "min": Function("min", None, Typing.SAME, _strict(_minimum), work=12),
    "max": Function("max", None, Typing.SAME, _strict(_maximum), work=12),
    "floor": Function("floor", 1, Typing.PLAIN, np.floor),
    "ceil": Function("ceil", 1, Typing.PLAIN, lambda x: np.ceil(x) + 0.0),
    "round": Function("round", 1, Typing.PLAIN, lambda x: np.rint(x) + 0.0),  # Not -0, for atan2.
    "sin": Function("sin", 1, Typing.ANGLE, _sin, work=20),
    "cos": Function("cos", 1, Typing.ANGLE, _cos, work=20),
    "tan": Function("tan", 1, Typing.ANGLE, _tan, work=45),
    "atan2": Function("atan2", 2, Typing.RATIO, _strict(lambda y, x: np.degrees(np.arctan2(y, x))), work=20),
    "hypot": Function("hypot", 2, Typing.SAME, np.hypot, work=4),
}
"""By name."""
