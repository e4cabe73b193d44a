"""Loops that carry values from one iteration to the next: their LETs, iteration by iteration, before all else.

Only LETs carry values. So where a loop has LETs and plain statements alone, its LETs run first; then all iterations of
its statements run at once, with the values that each name had in each of them.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.frontend.expand.lanes import Named, Scope
from gusjob.frontend.expand.program import Let, Loop, StatementRun
from gusjob.frontend.parse.expressions import Mismatch
from gusjob.frontend.parse.operators import TRUTH, Number, NumberType
from gusjob.kinematics.arrays import Floats


class CarriedValues(Struct, frozen=True, kw_only=True):
    """Values of the names that a loop sets, one for each iteration.

    Attributes:
        before: Names that had a value before the loop, as each iteration begins.
        after: What each LET of the loop gives, in their order.
    """

    before: dict[str, Named]
    after: tuple[Named, ...]


def lets_of(loop: Loop) -> tuple[Let, ...] | None:
    """The LETs of a loop; None if it contains more than LETs and statements without CALL."""
    if any(
        not isinstance(item, Let | StatementRun) or (isinstance(item, StatementRun) and item.calls)
        for item in loop.body
    ):
        return None
    return tuple(item for item in loop.body if isinstance(item, Let))


def carried_values(
    lets: tuple[Let, ...], variable: str, kind: NumberType, iterations: Floats, scopes: tuple[Scope, Scope]
) -> CarriedValues | None:
    """Run the LETs of a loop in one lane.

    Args:
        lets: The LETs.
        variable: The loop's variable.
        kind: Its kind.
        iterations: Its value in each iteration.
        scopes: Where names are looked up, the first one first.

    Returns:
        None where a name or value is missing, or where a name does not keep its kind.
    """
    names = {name for let in lets for name in (let.name, *let.expression.names)} - {variable}
    found = {name: scopes[0].get(name) or scopes[1].get(name) for name in names}
    start = {name: named for name, named in found.items() if named is not None}
    kinds = _kinds(lets, {variable: kind, **{name: named[1] for name, named in start.items()}})
    if kinds is None:
        return None
    values = _run(lets, variable, iterations, {name: named[0] for name, named in start.items()})
    if not all(np.isfinite(value).all() for value in values):
        return None
    last = {let.name: value for let, value in zip(lets, values, strict=True)}
    before = {
        name: (np.concatenate([[start[name][0]], value[:-1]]) if len(value) > 1 else start[name][0], start[name][1])
        for name, value in last.items()
        if name in start
    }
    after = tuple((value if len(value) > 1 else value[0], one) for value, one in zip(values, kinds, strict=True))
    return CarriedValues(before=before, after=after)


def _kinds(lets: tuple[Let, ...], known: dict[str, NumberType]) -> tuple[NumberType, ...] | None:
    """The kind that each LET gives; None where one has none or where a later iteration gives another one."""
    kinds = []
    first = dict(known)
    for let in lets:
        if any(name not in known for name in let.expression.names):
            return None
        kind = let.expression.type(tuple(known[name] for name in let.expression.names))
        if isinstance(kind, Mismatch) or kind[0] == TRUTH:
            return None
        known[let.name] = kind
        kinds.append(kind)
    return tuple(kinds) if all(known[name] == kind for name, kind in first.items()) else None


def _run(lets: tuple[Let, ...], variable: str, iterations: Floats, values: dict[str, Number]) -> list[Floats]:
    """What each LET gives in each iteration."""
    found: list[list[Number]] = [[] for _ in lets]
    steps = [(let.name, let.expression.run, let.constants, own.append) for let, own in zip(lets, found, strict=True)]
    for iteration in iterations:
        values[variable] = iteration
        for name, run, constants, keep in steps:
            value = values[name] = run(values, constants)
            keep(value)
    return [np.array(own, dtype=np.float64) for own in found]
