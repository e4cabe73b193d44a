"""Expressions: parsed into postfix code once, then run on one number or on many at once.

Numbers carry units, and a name carries the unit of its number: 2*pitch is a length where pitch is one. The kind of a
result depends on the kinds alone, so it is found once for all iterations of a loop.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from lark import Token, Tree
from msgspec import Struct, field

from gusjob.frontend.parse.operators import (
    NAMED_NUMBERS,
    NEGATE,
    OPERATORS,
    PLAIN,
    Function,
    Number,
    NumberType,
    result_type,
)


class Constant(Struct, frozen=True):
    """A number in an expression, by its index in the expression's constants."""

    index: int


class Apply(Struct, frozen=True):
    """An operator or function on the `count` values on top of the stack."""

    function: Function
    count: int


PostfixStep = Constant | str | Apply
"""One step of postfix code; a string is a name."""


class Literal(Struct, frozen=True, kw_only=True):
    """A number in an expression, in canonical units of its kind.

    A template reads it as the number at `column` (from 1), times `times` / `over`.
    """

    value: float
    type: NumberType
    times: float
    over: float
    column: int


class Mismatch(Struct, frozen=True, kw_only=True):
    """Why an expression has no kind: an operator, and operands of kinds that it does not take."""

    function: Function
    given: tuple[NumberType, ...]


class Expression(Struct, frozen=True, kw_only=True, eq=False):
    """Postfix code.

    Attributes:
        code: The steps.
        constants: Its numbers.
        names: The names that it reads.
        column: Where it begins, from 1.
        end_column: The column after it.
    """

    code: tuple[PostfixStep, ...]
    constants: tuple[Literal, ...]
    names: tuple[str, ...]
    column: int
    end_column: int
    _types: dict[tuple[NumberType, ...], NumberType | Mismatch] = field(default_factory=dict)
    _work: dict[int, int] = field(default_factory=dict)

    @property
    def work(self) -> int:
        """How long one value takes, as a multiple of an addition. min and max: by their number of operands."""
        found = self._work.get(0)
        if found is None:
            applied = (step for step in self.code if isinstance(step, Apply))
            found = self._work[0] = 1 + sum(step.function.work * max(step.count - 1, 1) for step in applied)
        return found

    def type(self, names: tuple[NumberType, ...]) -> NumberType | Mismatch:
        """The kind of the result for the kinds of the names that it reads, in the order of `names`."""
        found = self._types.get(names)
        if found is None:
            found = self._types[names] = self._find_type(dict(zip(self.names, names, strict=True)))
        return found

    def _find_type(self, names: Mapping[str, NumberType]) -> NumberType | Mismatch:
        stack: list[NumberType] = []
        for step in self.code:
            match step:
                case Constant(index=index):
                    stack.append(self.constants[index].type)
                case Apply(function=function, count=count):
                    operands = tuple(stack[-count:])
                    found = result_type(function.typing, operands)
                    if found is None:
                        return Mismatch(function=function, given=operands)
                    stack[-count:] = [found]
                case name:
                    stack.append(PLAIN if name in NAMED_NUMBERS else names[name])
        return stack[-1]

    def run(self, value_of: Mapping[str, Number], constants: Sequence[Number]) -> Number:
        """Compute the value: one number, or as many as the values that it reads have."""
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


class NamedFunction(Struct, frozen=True):
    """A function that was written by name, not yet looked up, on the `count` values on top of the stack."""

    token: Token
    count: int


PostfixPart = Token | Apply | NamedFunction


def postfix(root: Tree[Token] | Token) -> list[PostfixPart]:
    """Put a parsed expression in postfix order: operators and functions come after their operands.

    A loop with its own stack, not recursion: an expression can nest as deep as a line is long.
    """
    order: list[PostfixPart] = []
    work: list[Tree[Token] | PostfixPart] = [root]
    while work:
        item = work.pop()
        if isinstance(item, Tree):
            work += reversed(_parts(item))
        else:
            order.append(item)
    return order


def _parts(tree: Tree[Token]) -> list[Tree[Token] | PostfixPart]:
    children = tree.children
    first = children[0]
    if tree.data == "apply":
        assert isinstance(first, Token)
        return [*children[1:], NamedFunction(first, len(children) - 1)]
    if tree.data == "prefix":
        assert isinstance(first, Token)
        sign = {"NOT": OPERATORS["NOT"], "MINUS": NEGATE}.get(first.type)
        return [children[1], *([Apply(sign, 1)] if sign else [])]
    parts: list[Tree[Token] | PostfixPart] = [first]
    for operator, operand in zip(children[1::2], children[2::2], strict=True):
        assert isinstance(operator, Token)
        parts += [operand, Apply(OPERATORS[operator.type], 2)]
    return parts
