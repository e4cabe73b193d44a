"""Expressions: read into postfix code once, then run on one number or on many at once.

Numbers may carry units, and names carry the unit of their number: 2*pitch is a length where pitch is one. Which kind a
result has hangs on the kinds alone, so it is found once for all rounds of a loop.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np
from lark import Token, Tree

from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.geometry import sin_cos_deg
from gusjob.kinematics.units import QuantityKind

Number = np.float64 | Floats
"""One value, or one a lane."""

TRUTH = -1
"""What a comparison gives, in place of a Kind: 1 true, 0 false, NaN where an operand has no value."""
Type = tuple[int, int]
"""Kind (or TRUTH), and the system it was written in (units.System, or units.PowerUnit for powers)."""
PLAIN: Type = (QuantityKind.PLAIN, 0)
NAMED_NUMBERS = {"pi": np.float64(np.pi)}
"""Names that the language gives."""


class Typing(Enum):
    """How the kind of a result comes from those of the operands; the text says what it takes."""

    SAME = Phrase("takes numbers of one kind")
    KEEP = Phrase("takes a number")
    TIMES = Phrase("needs a plain number on one side")
    OVER = Phrase("needs a plain number below, or two numbers of one kind")
    PLAIN = Phrase("takes plain numbers")
    ANGLE = Phrase("takes an angle in degrees")
    RATIO = Phrase("takes two numbers of one kind")
    COMPARE = Phrase("compares two numbers of one kind")
    TRUTH = Phrase("joins comparisons")


@dataclass(frozen=True, slots=True)
class Function:
    """An operator or function: what users call it, how many operands it takes (None: one or more)."""

    name: str
    arity: int | None
    typing: Typing
    run: Callable[..., Any]


def _sin(degrees: Any) -> Any:
    return sin_cos_deg(degrees)[0] if isinstance(degrees, np.ndarray) else _turned(float(degrees), 0)


def _cos(degrees: Any) -> Any:
    return sin_cos_deg(degrees)[1] if isinstance(degrees, np.ndarray) else _turned(float(degrees), 1)


def _turned(degrees: float, quarters: int) -> np.float64:
    """geometry.sin_cos_deg for one number, without what arrays cost: the sine so many quarter turns on."""
    if not math.isfinite(degrees):
        return np.float64(np.nan)
    whole = round(degrees / 90.0)
    rest, quarter = math.radians(degrees - 90.0 * whole), whole + quarters
    sine = math.cos(rest) if quarter % 2 else math.sin(rest)
    return np.float64((-sine if quarter % 4 >= 2 else sine) + 0.0)


def _tan(degrees: Any) -> Any:
    return _divide(_sin(degrees), _cos(degrees))


def _known(run: Callable[..., Any]) -> Callable[..., Any]:
    """A function that has no value where an operand has none: min(1/0, 3) is not 3."""

    def checked(*values: Any) -> Any:
        fine = np.isfinite(values[0])
        for value in values[1:]:
            fine = fine & np.isfinite(value)
        return np.where(fine, run(*values), np.nan)[()]

    return checked


def _divide(a: Any, b: Any) -> Any:
    if not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray):
        return a / b if b != 0 and math.isfinite(b) else np.float64(np.nan)
    return np.where((b == 0) | ~np.isfinite(b), np.nan, a / b)[()]


def _most(*values: Any) -> Any:
    result = values[0]
    for value in values[1:]:
        result = np.maximum(result, value)
    return result


def _least(*values: Any) -> Any:
    result = values[0]
    for value in values[1:]:
        result = np.minimum(result, value)
    return result


def _truth(compare: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    def run(a: Any, b: Any) -> Any:
        if not isinstance(a, np.ndarray) and not isinstance(b, np.ndarray):
            return np.float64(compare(a, b)) if math.isfinite(a) and math.isfinite(b) else np.float64(np.nan)
        known = np.isfinite(a) & np.isfinite(b)
        return np.where(known, compare(a, b), np.nan)[()]

    return run


def _and(a: Any, b: Any) -> Any:
    return np.where((a == 0) | (b == 0), 0.0, a * b)[()]


def _or(a: Any, b: Any) -> Any:
    return np.where((a == 1) | (b == 1), 1.0, a + b)[()]


def _not(a: Any) -> Any:
    return 1.0 - a


OPERATORS = {
    "OR": Function("or", 2, Typing.TRUTH, _or),
    "AND": Function("and", 2, Typing.TRUTH, _and),
    "NOT": Function("not", 1, Typing.TRUTH, _not),
    "LT": Function("<", 2, Typing.COMPARE, _truth(operator.lt)),
    "LE": Function("<=", 2, Typing.COMPARE, _truth(operator.le)),
    "GT": Function(">", 2, Typing.COMPARE, _truth(operator.gt)),
    "GE": Function(">=", 2, Typing.COMPARE, _truth(operator.ge)),
    "EQ": Function("==", 2, Typing.COMPARE, _truth(operator.eq)),
    "NE": Function("!=", 2, Typing.COMPARE, _truth(operator.ne)),
    "PLUS": Function("+", 2, Typing.SAME, operator.add),
    "MINUS": Function("-", 2, Typing.SAME, operator.sub),
    "STAR": Function("*", 2, Typing.TIMES, operator.mul),
    "SLASH": Function("/", 2, Typing.OVER, _divide),
    "MODULO": Function("%", 2, Typing.SAME, _known(operator.mod)),
    "POWER_OF": Function("**", 2, Typing.PLAIN, np.power),
}
"""By terminal of the grammar."""
NEGATE = Function("-", 1, Typing.KEEP, operator.neg)
FUNCTIONS = {
    "sqrt": Function("sqrt", 1, Typing.PLAIN, np.sqrt),
    "abs": Function("abs", 1, Typing.KEEP, np.abs),
    "min": Function("min", None, Typing.SAME, _known(_least)),
    "max": Function("max", None, Typing.SAME, _known(_most)),
    "floor": Function("floor", 1, Typing.PLAIN, np.floor),
    "ceil": Function("ceil", 1, Typing.PLAIN, lambda x: np.ceil(x) + 0.0),
    "round": Function("round", 1, Typing.PLAIN, lambda x: np.rint(x) + 0.0),  # -0.3 is 0, not -0: atan2 knows both.
    "sin": Function("sin", 1, Typing.ANGLE, _sin),
    "cos": Function("cos", 1, Typing.ANGLE, _cos),
    "tan": Function("tan", 1, Typing.ANGLE, _tan),
    "atan2": Function("atan2", 2, Typing.RATIO, _known(lambda y, x: np.degrees(np.arctan2(y, x)))),
    "hypot": Function("hypot", 2, Typing.SAME, np.hypot),
}


@dataclass(frozen=True, slots=True)
class Constant:
    """A number in an expression, by its index in the expression's constants."""

    index: int


@dataclass(frozen=True, slots=True)
class Apply:
    """An operator or function on the `count` values on top of the stack."""

    function: Function
    count: int


Step = Constant | str | Apply
"""One step of postfix code; a string is a name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Literal:
    """A number as it stands in an expression, in canonical units of its kind.

    A template reads it as the run of digits (and sign) at `column` (from 1), times `times` / `over`, if it is `plain`.
    """

    value: float
    type: Type
    times: float
    over: float
    column: int
    plain: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Mismatch:
    """Why an expression has no kind: an operator, what it takes, and the kinds it was given."""

    function: Function
    given: tuple[Type, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Expression:
    """Postfix code. `names` are those it reads; columns from 1, end behind."""

    code: tuple[Step, ...]
    constants: tuple[Literal, ...]
    names: tuple[str, ...]
    column: int
    end_column: int
    _types: dict[tuple[Type, ...], Type | Mismatch] = field(default_factory=dict, repr=False, compare=False)

    def type(self, names: tuple[Type, ...]) -> Type | Mismatch:
        """The kind of the result; `names` are the kinds of the names it reads, in their order."""
        found = self._types.get(names)
        if found is None:
            found = self._types[names] = self._find_type(dict(zip(self.names, names, strict=True)))
        return found

    def _find_type(self, names: Mapping[str, Type]) -> Type | Mismatch:
        stack: list[Type] = []
        for step in self.code:
            match step:
                case Constant(index=index):
                    stack.append(self.constants[index].type)
                case Apply(function=function, count=count):
                    operands = tuple(stack[-count:])
                    found = _result(function.typing, operands)
                    if found is None:
                        return Mismatch(function=function, given=operands)
                    stack[-count:] = [found]
                case name:
                    stack.append(PLAIN if name in NAMED_NUMBERS else names[name])
        return stack[-1]

    def run(self, value_of: Mapping[str, Number], constants: Sequence[Number]) -> Number:
        """The value: one number, or as many as the values it reads have."""
        stack: list[Any] = []
        for step in self.code:
            if isinstance(step, Apply):
                if step.count == 2:
                    right = stack.pop()
                    stack[-1] = step.function.run(stack[-1], right)
                else:
                    stack[-step.count :] = [step.function.run(*stack[-step.count :])]
            elif isinstance(step, Constant):
                stack.append(constants[step.index])
            else:
                stack.append(NAMED_NUMBERS[step] if step in NAMED_NUMBERS else value_of[step])
        result: Number = stack[-1]
        return result


def _result(typing: Typing, given: tuple[Type, ...]) -> Type | None:
    """The kind of a result; None where the operands do not fit."""
    if (TRUTH, 0) in given and typing is not Typing.TRUTH:
        return None
    same = all(one == given[0] for one in given)
    match typing:
        case Typing.SAME:
            return given[0] if same else None
        case Typing.KEEP:
            return given[0]
        case Typing.TIMES:
            left, right = given
            return left if right == PLAIN else right if left == PLAIN else None
        case Typing.OVER:
            left, right = given
            return left if right == PLAIN else PLAIN if same else None
        case Typing.PLAIN:
            return PLAIN if same and given[0] == PLAIN else None
        case Typing.ANGLE:
            return PLAIN if given[0][0] in (QuantityKind.PLAIN, QuantityKind.ANGLE) else None
        case Typing.RATIO:
            return PLAIN if same else None
        case Typing.COMPARE:
            return (TRUTH, 0) if same else None
        case Typing.TRUTH:
            return (TRUTH, 0) if all(kind == TRUTH for kind, _ in given) else None


@dataclass(frozen=True, slots=True)
class Named:
    """A function that was written by name, not yet looked up, on the `count` values on top of the stack."""

    token: Token
    count: int


Part = Token | Apply | Named


def postfix(root: Tree[Token] | Token) -> list[Part]:
    """A parsed expression in postfix order: tokens of numbers and names, operators and functions behind their operands.

    A loop with its own stack: an expression may nest as deep as a line is long.
    """
    order: list[Part] = []
    work: list[Tree[Token] | Part] = [root]
    while work:
        item = work.pop()
        if isinstance(item, Tree):
            work += reversed(_parts(item))
        else:
            order.append(item)
    return order


def _parts(tree: Tree[Token]) -> list[Tree[Token] | Part]:
    children = tree.children
    first = children[0]
    if tree.data == "apply":
        assert isinstance(first, Token)
        return [*children[1:], Named(first, len(children) - 1)]
    if tree.data == "prefix":
        assert isinstance(first, Token)
        sign = {"NOT": OPERATORS["NOT"], "MINUS": NEGATE}.get(first.type)
        return [children[1], *([Apply(sign, 1)] if sign else [])]
    parts: list[Tree[Token] | Part] = [first]
    for operator_, operand in zip(children[1::2], children[2::2], strict=True):
        assert isinstance(operator_, Token)
        parts += [operand, Apply(OPERATORS[operator_.type], 2)]
    return parts
