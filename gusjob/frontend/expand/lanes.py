"""Lanes: loop iterations that run together, with one value of each name for all of them or one for each."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct, field

from gusjob.frontend.parse.operators import Number, NumberType
from gusjob.kinematics.arrays import Ints

Named = tuple[Number, NumberType]
"""The value of a name (one for all lanes, or one for each) and its kind."""


class Scope(Struct):
    """Names, and those around them in other lanes, which are taken over when they are first read.

    Attributes:
        own: Names that are set in these lanes.
        around: The names around, None for none.
        lanes: The lane of `around` that each of these lanes was.
        taken: Names taken over.
    """

    own: dict[str, Named] = field(default_factory=dict)
    around: Scope | None = None
    lanes: Ints | None = None
    taken: dict[str, Named] = field(default_factory=dict)

    def take(self, lanes: Ints) -> Scope:
        """The same names for some of the lanes, in any order and number."""
        return Scope(around=self, lanes=lanes)

    def get(self, name: str) -> Named | None:
        """The value and kind of a name; None if it is not set."""
        found = self.own.get(name) or self.taken.get(name)
        if found is None and self.around is not None and (outer := self.around.get(name)) is not None:
            assert self.lanes is not None
            found = self.taken[name] = (take_lanes(outer[0], self.lanes), outer[1])
        return found

    def set(self, name: str, value: Number, kind: NumberType) -> None:
        """Set a name."""
        self.own[name] = value, kind

    def names(self) -> list[str]:
        """All names that are set."""
        return sorted({*self.own, *(self.around.names() if self.around else ())})


class Lanes(Struct):
    """Iterations that run together. With one lane every value is a number, with more it may be an array.

    Attributes:
        count: How many there are.
        scope: Names in force.
        top: Names of the job, which a routine may read.
        provenance: Node of Provenance, one for all lanes or one for each.
        frame: Number of the frame, one for all lanes or one for each.
        depth: Of calls and blocks.
    """

    count: int
    scope: Scope
    top: Scope
    provenance: Any = 0
    frame: Any = 0
    depth: int = 0

    def take(self, lanes: Ints) -> Lanes:
        """Some of the lanes, in any order and number."""
        top = self.top.take(lanes)
        return Lanes(
            count=len(lanes),
            scope=top if self.scope is self.top else self.scope.take(lanes),
            top=top,
            provenance=take_lanes(self.provenance, lanes),
            frame=take_lanes(self.frame, lanes),
            depth=self.depth,
        )

    def numbered(self, first: int) -> Any:
        """Consecutive numbers for the lanes: an array, or one number for one lane."""
        return first + np.arange(self.count) if self.count > 1 else first

    def first_provenance(self, where: Any) -> Any:
        """The provenance of the first lane at which something holds."""
        if not isinstance(self.provenance, np.ndarray) or np.ndim(where) == 0:
            return self.provenance
        by_lane = where if np.ndim(where) == 1 else where.any(axis=1)
        return self.provenance[int(np.argmax(by_lane))] if len(by_lane) == self.count else self.provenance


def take_lanes(value: Any, lanes: Ints) -> Any:
    """A value in some of the lanes."""
    if not isinstance(value, np.ndarray):
        return value
    return value[lanes[0]] if len(lanes) == 1 else value[lanes]


def any_lane(truth: Any) -> bool:
    """Whether something holds in some lane; fast for one lane, which np.any is not."""
    return bool(truth.any()) if isinstance(truth, np.ndarray) else bool(truth)
