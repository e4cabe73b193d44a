"""Diagnostics of an expansion, and counts against its limits."""

from __future__ import annotations

from typing import Any, NoReturn

import numpy as np
from msgspec import Struct, field

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule
from gusjob.frontend.expand.lanes import Lanes, any_lane
from gusjob.frontend.expand.program import Item, StatementRun
from gusjob.frontend.parse.statement import RowOp
from gusjob.frontend.source_map import SourceMap
from gusjob.i18n.phrases import Phrase
from gusjob.ir.provenance import Provenance

MAX_STEPS = 4_000_000
"""Steps of work, about two seconds. A statement that runs alone (in sequential loops, in routines that call themselves)
takes about ten steps, a loop about 200; in lanes a hundred iterations of a statement take about three."""
MAX_SETUPS = 50_000
"""Setup statements that loops and routines make."""


class LimitReached(Exception):  # noqa: N818  (not an error: ends the expansion of a program that is too large)
    """A limit is reached; the last diagnostic says which."""


class Ledger(Struct):
    """Diagnostics, one for each statement; statements, iterations and steps, counted against their limits."""

    sources: SourceMap
    machine: Machine
    provenance: Provenance = field(default_factory=Provenance)
    statements: int = 0
    iterations: float = 0.0
    setups: int = 0
    steps: int = 0
    reported: dict[tuple[str, int, str], tuple[Rule, int, dict[str, Any], int]] = field(default_factory=dict)
    """By code, line and word: the rule, the first one's provenance and fields, and how many there are."""

    def report(self, rule: Rule, line: int, word: str, provenance: Any, count: int = 1, /, **fields: object) -> None:
        """Report a diagnostic at a word of a line, in one or more lanes."""
        key = (rule.code, line, word)
        known = self.reported.get(key)
        if known is None:
            first = int(provenance[0] if isinstance(provenance, np.ndarray) else provenance)
            self.reported[key] = (rule, first, dict(fields), count)
        else:
            self.reported[key] = (*known[:3], known[3] + count)

    def diagnostics(self) -> list[Diagnostic]:
        """All diagnostics, each once."""
        collector = Collector("")
        for (_, line, word), (rule, provenance, fields, count) in self.reported.items():
            if collector.remaining(rule):
                remarks = self.provenance.remarks(provenance, self.sources.locate)
                collector.add(rule, self.sources.locate(line, word), fields, count, remarks)
            else:
                collector.count_unlisted(rule, 1)
        return collector.finish(rules.NOT_LISTED)

    def stop(self, rule: Rule, line: int, provenance: Any, **fields: object) -> NoReturn:
        """Report a limit and end the expansion."""
        self.report(rule, line, "", provenance, **fields)
        raise LimitReached

    def count_steps(self, steps: int, line: int, provenance: Any) -> None:
        """Count work."""
        self.steps += steps
        if self.steps > MAX_STEPS:
            self.stop(rules.EXPANSION_TOO_SLOW, line, provenance, limit=MAX_STEPS)

    def count_statements(self, run: StatementRun, lanes: Lanes) -> None:
        """Count the statements of a run before they are made; those outside of loops and routines do not count."""
        if not any_lane(lanes.provenance > 0):
            return
        self.statements += len(run.rows.op) * lanes.count
        self.setups += run.setups * lanes.count
        limit = self.machine.expansion_max_statements
        if self.statements > limit:
            what, key = Phrase("statements"), "max_statements"
            self.stop(rules.EXPANSION_TOO_LARGE, run.line, lanes.provenance, what=what, limit=limit, key=key)
        if self.setups > MAX_SETUPS:
            at = int(np.flatnonzero(run.rows.op == RowOp.SETUP)[0])
            self.stop(rules.TOO_MANY_SETUPS, int(run.rows.line[at]), lanes.provenance, limit=MAX_SETUPS)

    def count_iterations(self, iterations: float, line: int, provenance: Any) -> None:
        """Count iterations before they run."""
        limit = self.machine.expansion_max_statements
        self.iterations += iterations
        if self.iterations > limit:
            what, key = Phrase("iterations"), "max_statements"
            self.stop(rules.EXPANSION_TOO_LARGE, line, provenance, what=what, limit=limit, key=key)

    def count_calls(self, lanes: Lanes, line: int) -> None:
        """Count calls before they run; those outside of loops and routines do not count."""
        if any_lane(lanes.provenance > 0):
            self.count_iterations(lanes.count, line, lanes.provenance)

    def check_depth(self, item: Item, lanes: Lanes) -> None:
        """Check how deep blocks and calls nest: a routine may call itself."""
        limit = self.machine.expansion_max_depth
        if lanes.depth > limit:
            self.stop(rules.EXPANSION_TOO_DEEP, item.line, lanes.provenance, limit=limit, key="max_depth")
