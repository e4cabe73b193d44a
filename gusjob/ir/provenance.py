"""Provenance: from which calls, loop iterations and included files a statement came."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec import Struct, field

from gusjob.diagnostics.model import CALLED, IN_ITERATION, INCLUDED, ITERATION_NUMBER, Remark, Span
from gusjob.i18n.phrases import Phrase, number

MAX_REMARKS = 8
"""Steps of a provenance that a diagnostic shows."""

Locate = Callable[[int, str], Span]
"""Line and a word in it ('VEL', or '' for the whole statement) to its span."""


class ProvenanceStep(Struct, frozen=True, kw_only=True):
    """One call, iteration or inclusion, with the values of its names.

    `kind`: 'call', 'round' (an iteration), 'nth' (an iteration without a name) or 'include'.
    """

    line: int
    kind: str
    values: dict[str, float]

    def remark(self, locate: Locate) -> Remark:
        """Describe the step for a diagnostic."""
        values = ", ".join(f"{name} = {number(value)}" for name, value in self.values.items())
        match self.kind:
            case "call":
                text, fields = CALLED, {"values": Phrase(": {values}", values=values) if values else ""}
            case "include":
                text, fields = INCLUDED, {}
            case "nth":
                text, fields = ITERATION_NUMBER, {"number": number(next(iter(self.values.values())))}
            case _:
                text, fields = IN_ITERATION, {"values": values}
        return Remark(text=text, span=locate(self.line, ""), fields=fields)


class Provenance(Struct):
    """A tree of steps: each node is a step and the node around it. Node 0 is the job's own text.

    Nodes are kept in batches, since a loop of a million iterations makes a million of them.
    """

    firsts: list[int] = field(default_factory=list)
    """Number of each batch's first node, ascending."""
    batches: list[tuple[int, str, tuple[str, ...], Any, tuple[Any, ...]]] = field(default_factory=list)
    """Line, kind, names, node around it, values."""
    count: int = 1

    def add(
        self, line: int, names: tuple[str, ...], around: Any, values: tuple[Any, ...], *, kind: str, count: int
    ) -> int:
        """Add `count` nodes and return the number of the first.

        Args:
            line: Line of the call, loop or INCLUDE.
            names: Names that have a value in the step.
            around: Number of the node around: one for all nodes, or (count,).
            values: For each name its value: one for all nodes, or (count,).
            kind: As in ProvenanceStep.
            count: Number of nodes.
        """
        first = self.count
        self.firsts.append(first)
        self.batches.append((line, kind, names, around, values))
        self.count += count
        return first

    def steps(self, node: int) -> list[ProvenanceStep]:
        """List the steps from a node outwards, the innermost first."""
        found = []
        while node > 0:
            batch = bisect_right(self.firsts, node) - 1
            line, kind, names, around, values = self.batches[batch]
            member = node - self.firsts[batch]
            shown = {name: float(_member(value, member)) for name, value in zip(names, values, strict=True)}
            found.append(ProvenanceStep(line=line, kind=kind, values=shown))
            node = int(_member(around, member))
        return found

    def remarks(self, node: int, locate: Locate) -> tuple[Remark, ...]:
        """Describe where a statement came from: its calls and iterations, the innermost first."""
        return tuple(step.remark(locate) for step in self.steps(node)[:MAX_REMARKS])


def _member(values: Any, member: int) -> Any:
    return values[member] if isinstance(values, np.ndarray) else values
