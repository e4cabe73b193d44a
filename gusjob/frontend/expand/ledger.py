"""What a program has done wrong while it is carried out, and how much it has done: both have bounds."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NoReturn

import numpy as np

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule
from gusjob.frontend.expand.lanes import Lanes, some
from gusjob.frontend.expand.program import Item, Run
from gusjob.frontend.files import SourceMap
from gusjob.frontend.parse.job_reader import RowOp
from gusjob.i18n.phrases import Phrase
from gusjob.ir.provenance import Provenance

MAX_STEPS = 4_000_000
"""Steps of work. What is carried out one by one, in loops that carry values and in routines that call themselves,
comes to some five a statement; what is carried out at once, to some three in a hundred rounds."""
MAX_SETUPS = 50_000
"""Setup statements that loops and routines make."""


class Full(Exception):  # noqa: N818  (no error: the way out of a program that is too large, caught in `expand`)
    """A limit is reached; what was reported says which."""


@dataclass(slots=True)
class Ledger:
    """Diagnostics, each statement's once; statements, rounds and steps, counted against their limits."""

    sources: SourceMap
    machine: Machine
    trails: Provenance = field(default_factory=Provenance)
    statements: int = 0
    rounds: float = 0.0
    setups: int = 0
    steps: int = 0
    diagnostics: dict[tuple[str, int, str], tuple[Rule, int, dict[str, Any], int]] = field(default_factory=dict)
    """By code, line and word: the rule, the first one's trail and fields, and how many there are."""

    def diagnostic(self, rule: Rule, line: int, word: str, trail: Any, count: int = 1, /, **fields: object) -> None:
        """A diagnostic at a word of a line, in one or more lanes."""
        key = (rule.code, line, word)
        known = self.diagnostics.get(key)
        if known is None:
            first = int(trail[0] if isinstance(trail, np.ndarray) else trail)
            self.diagnostics[key] = (rule, first, dict(fields), count)
        else:
            self.diagnostics[key] = (*known[:3], known[3] + count)

    def found(self) -> list[Diagnostic]:
        """All diagnostics, each once."""
        collector = Collector("")
        for (_, line, word), (rule, trail, fields, count) in self.diagnostics.items():
            if collector.room(rule):
                remarks = self.trails.remarks(trail, self.sources.locate)
                collector.add(rule, self.sources.locate(line, word), fields, count, remarks)
            else:
                collector.uncounted(rule, 1)
        return collector.done(rules.MORE)

    def stop(self, rule: Rule, line: int, trail: Any, **fields: object) -> NoReturn:
        """Report a limit and leave."""
        self.diagnostic(rule, line, "", trail, **fields)
        raise Full

    def spend(self, steps: int, line: int, trail: Any) -> None:
        """Count the work."""
        self.steps += steps
        if self.steps > MAX_STEPS:
            self.stop(rules.TOO_SLOW, line, trail, limit=MAX_STEPS)

    def make(self, run: Run, lanes: Lanes, line: int) -> None:
        """Count the statements of a run before they are made; those in the open cost no more than they are."""
        if not some(lanes.trail > 0):
            return
        self.statements += len(run.rows.op) * lanes.count
        self.setups += run.setups * lanes.count
        limit = self.machine.expansion_max_statements
        if self.statements > limit:
            self.stop(rules.TOO_MANY, line, lanes.trail, what=Phrase("statements"), limit=limit, key="max_statements")
        if self.setups > MAX_SETUPS:
            at = int(np.flatnonzero(run.rows.op == RowOp.SETUP)[0])
            self.stop(rules.TOO_MANY_SETUPS, int(run.rows.line[at]), lanes.trail, limit=MAX_SETUPS)

    def go_round(self, rounds: float, line: int, trail: Any) -> None:
        """Count rounds before they are carried out."""
        limit = self.machine.expansion_max_statements
        self.rounds += rounds
        if self.rounds > limit:
            self.stop(rules.TOO_MANY, line, trail, what=Phrase("rounds"), limit=limit, key="max_statements")

    def go_deeper(self, item: Item, lanes: Lanes) -> None:
        """Blocks and calls inside each other have a limit: a routine may call itself."""
        limit = self.machine.expansion_max_depth
        if lanes.depth <= limit:
            return
        line = int(item.rows.line[0]) if isinstance(item, Run) else item.line
        self.stop(rules.TOO_DEEP, line, lanes.trail, limit=limit, key="max_depth")
