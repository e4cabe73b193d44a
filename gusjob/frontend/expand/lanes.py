"""Rounds that are carried out together: one lane each, with a value of each name for all lanes or for each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gusjob.frontend.parse.expressions import Number, Type
from gusjob.kinematics.arrays import Ints


@dataclass(slots=True)
class Scope:
    """Names: values (one for all lanes, or one each) and kinds."""

    values: dict[str, Number]
    types: dict[str, Type]

    def take(self, lanes: Ints) -> Scope:
        """The same names for some of the lanes, in any order and number."""
        return Scope({k: taken(v, lanes) for k, v in self.values.items()}, self.types.copy())


def some(truth: Any) -> bool:
    """Whether something holds in some lane; quick for one lane, which np.any is not."""
    return bool(truth.any()) if isinstance(truth, np.ndarray) else bool(truth)


def taken(value: Any, lanes: Ints) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    return value[lanes[0]] if len(lanes) == 1 else value[lanes]


@dataclass(slots=True)
class Lanes:
    """Rounds that are carried out together. With one lane every value is a number, with more it may be an array.

    `scope`: names in force; `top`: those of the job, which a routine may read. `trail`, `frame`: numbers, one or one
    a lane. `depth`: of calls and blocks.
    """

    count: int
    scope: Scope
    top: Scope
    trail: Any = 0
    frame: Any = 0
    depth: int = 0

    def take(self, lanes: Ints) -> Lanes:
        """Some of the lanes."""
        top = self.top.take(lanes)
        scope = top if self.scope is self.top else self.scope.take(lanes)
        return Lanes(
            count=len(lanes), scope=scope, top=top, trail=taken(self.trail, lanes), frame=taken(self.frame, lanes),
            depth=self.depth,
        )  # fmt: skip

    def first_trail(self, where: Any) -> Any:
        """The trail of the first lane at which something holds."""
        if not isinstance(self.trail, np.ndarray) or np.ndim(where) == 0:
            return self.trail
        by_lane = where if np.ndim(where) == 1 else where.any(axis=1)
        return self.trail[int(np.argmax(by_lane))] if len(by_lane) == self.count else self.trail
