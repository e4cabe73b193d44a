"""A program carried out: loops, branches, routines and frames become rows.

Where no round of a loop hangs on another, all rounds are carried out at once: a name then has one value for each of
them, a lane. So a statement costs its arrays, not its rounds. Loops that carry a value from round to round go one by
one, and what they come to is written down and made into rows together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.expand.evaluate import Evaluator, kind_words
from gusjob.frontend.expand.lanes import Lanes, Scope, some
from gusjob.frontend.expand.ledger import MAX_STEPS, Full, Ledger
from gusjob.frontend.expand.pieces import Noted, Piece, Sink, Writer, merged
from gusjob.frontend.expand.program import Block, Branch, Computed, Frame, Included, Item, Let, Loop, Program, Run
from gusjob.frontend.parse.expressions import PLAIN, TRUTH, Type, Typing
from gusjob.frontend.parse.job_reader import RowOp
from gusjob.frontend.parse.statements import Statement
from gusjob.frontend.scan.shapes import Rows
from gusjob.i18n.phrases import Phrase, both_of
from gusjob.ir.provenance import Provenance
from gusjob.kinematics.arrays import Floats, Ints

_CALL_STEPS = 40
_LOOP_STEPS = 100
_ONE_LANE_STEPS = 2
_MANY_LANES_STEPS = 30
_FEW_ROUNDS = 4
"""So few rounds are quicker one by one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expanded:
    """Rows in the order in which they are carried out; `frame_parent`: for each frame (from 1) the one around it."""

    rows: Rows
    setups: tuple[Statement, ...]
    frame_parent: Ints
    trails: Provenance
    diagnostics: tuple[Diagnostic, ...]


def expand(program: Program, machine: Machine) -> Expanded:
    """All rows of a program."""
    ledger = Ledger(sources=program.sources, machine=machine)
    executor = _Executor(
        program=program,
        ledger=ledger,
        numbers=Evaluator(ledger=ledger, failed=set(program.unread_names)),
        writer=Writer(setups=list(program.setups)),
    )
    names = Scope({}, {})
    sink: Sink = []
    with np.errstate(all="ignore"):
        try:
            executor.block(program.block, Lanes(count=1, scope=names, top=names), sink)
        except Full:
            sink = []
        done = executor.writer.collected(sink, 1)
    return Expanded(
        rows=done.rows,
        setups=tuple(executor.writer.setups),
        frame_parent=np.concatenate([np.zeros(1, dtype=np.int64), *executor.frame_parents]),
        trails=ledger.trails,
        diagnostics=tuple(ledger.found()),
    )


@dataclass(slots=True)
class _Executor:
    program: Program
    ledger: Ledger
    numbers: Evaluator
    writer: Writer
    frame_parents: list[Ints] = field(default_factory=list)
    frames: int = 1

    # Blocks.

    def block(self, block: Block, lanes: Lanes, sink: Sink) -> None:
        """Carry out the items of a block in their order."""
        lanes.depth += 1
        if block:
            self.ledger.go_deeper(block[0], lanes)
        for item in block:
            self.item(item, lanes, sink)
        lanes.depth -= 1

    def item(self, item: Item, lanes: Lanes, sink: Sink) -> None:
        match item:
            case Run():
                self.run(item, lanes, sink)
            case Let():
                self.let(item, lanes)
            case Loop():
                self.loop(item, lanes, sink)
            case Branch():
                self.branch(item, lanes, sink)
            case Frame():
                self.frame(item, lanes, sink)
            case Included():
                before = lanes.trail
                first = self.ledger.trails.add(item.line, (), before, (), kind="include", count=lanes.count)
                lanes.trail = first + np.arange(lanes.count) if lanes.count > 1 else first
                self.ledger.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, before)
                self.block(item.body, lanes, sink)
                lanes.trail = before

    def let(self, item: Let, lanes: Lanes) -> None:
        """Set a name."""
        self.ledger.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, lanes.trail)
        found = self.numbers.argument(item.expression, item.constants, lanes, item.line, "#0", "LET", item.name)
        lanes.scope.values[item.name], lanes.scope.types[item.name] = found

    def branch(self, item: Branch, lanes: Lanes, sink: Sink) -> None:
        """IF."""
        self.ledger.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, lanes.trail)
        truth, kind = self.numbers.number(item.condition, item.constants, lanes, item.line, "#0")
        if kind[0] != TRUTH:
            if not np.all(np.isnan(truth)):
                self.ledger.diagnostic(rules.NOT_A_CONDITION, item.line, "#0", lanes.trail, lanes.count)
            return
        for block, holds in ((item.then, truth == 1), (item.otherwise, truth == 0)):
            if not some(holds):
                continue
            if not some(~holds):
                self.block(block, lanes, sink)
            else:
                self.in_some(block, lanes, np.flatnonzero(holds), sink)

    def in_some(self, block: Block, lanes: Lanes, which: Ints, sink: Sink) -> None:
        """Carry out a block in some of the lanes, and bring back what it sets."""
        part = lanes.take(which)
        inner: Sink = []
        self.block(block, part, inner)
        self.bring_back(part, lanes, which, np.arange(len(which)))
        done = self.writer.collected(inner, part.count)
        sink.append(Piece(done.rows, which[done.lane]))

    def bring_back(self, part: Lanes, lanes: Lanes, to: Ints, source: Ints) -> None:
        """Names that were set in other lanes: lane `source` of those gives lane `to` of these its value."""
        for name, value in part.scope.values.items():
            old = lanes.scope.values.get(name)
            if old is None:  # Where a routine has not set it, it is the job's.
                old = lanes.top.values.get(name)
            if (
                old is not None
                and not isinstance(value, np.ndarray)
                and not isinstance(old, np.ndarray)
                and (value == old or (math.isnan(value) and math.isnan(old)))
            ):
                continue
            start: Any = np.nan if old is None else old
            fresh = np.array(np.broadcast_to(start, lanes.count), dtype=np.float64)
            fresh[to] = value[source] if isinstance(value, np.ndarray) else value
            lanes.scope.values[name] = fresh if lanes.count > 1 else fresh[0]
            lanes.scope.types[name] = part.scope.types[name]

    # Loops.

    def loop(self, item: Loop, lanes: Lanes, sink: Sink) -> None:
        """REPEAT and FOR."""
        start, step, count, kind = self.bounds(item, lanes)
        if not some(count > 0):
            return
        hidden = (lanes.scope.values.get(item.variable), lanes.scope.types.get(item.variable))
        if id(item) in self.program.carried:
            self.round_by_round(item, lanes, sink, start, step, count, kind)
        elif lanes.count == 1 and count <= _FEW_ROUNDS:
            self.one_by_one(item, lanes, sink, start, step, int(count), kind)
        else:
            self.at_once(item, lanes, sink, start, step, count, kind)
        lanes.scope.values.pop(item.variable, None)
        lanes.scope.types.pop(item.variable, None)
        value, outer_kind = hidden
        if value is not None and outer_kind is not None:
            lanes.scope.values[item.variable], lanes.scope.types[item.variable] = value, outer_kind

    def bounds(self, item: Loop, lanes: Lanes) -> tuple[Any, Any, Any, Type]:
        """Start, step and number of rounds, for all lanes or for each; the kind of the loop's variable."""
        found, kinds, constants = [], [], 0
        for number, bound in enumerate(item.bounds):
            own = item.constants[constants : constants + len(bound.constants)]
            constants += len(bound.constants)
            value, kind = self.numbers.number(bound, own, lanes, item.line, f"#{number}")
            found.append(self.numbers.count_of(value, kind, lanes, item.line, f"#{number}"))
            kinds.append(kind)
        if len(found) == 1:
            return np.float64(0), np.float64(1), self.rounds(item, lanes, found[0], kinds[0]), PLAIN
        start, end = found[0], found[1]
        step = found[2] if len(found) > 2 else np.float64(1)
        if any(kind != kinds[0] for kind in kinds) and not any(np.all(np.isnan(v)) for v in found):
            given = both_of(kind_words(kind) for kind in kinds)
            fields = {"operator": "FOR", "wants": Typing.SAME.value, "given": given}
            self.ledger.diagnostic(rules.MISMATCH, item.line, "", lanes.trail, lanes.count, **fields)
            return start, step, np.float64(0), PLAIN
        if np.any(step == 0):
            hint = Phrase("it would never end")
            self.ledger.diagnostic(
                rules.COUNT, item.line, "#2", lanes.first_trail(step == 0), what="STEP", value=0.0, hint=hint
            )
        # A last round that rounding has moved behind the end still counts.
        rounds = np.floor((end - start) / step * (1 + 1e-12) + 1e-9) + 1
        counted = np.where((step != 0) & np.isfinite(rounds), np.maximum(rounds, 0), 0.0)[()]
        return start, step, counted, kinds[0]

    def rounds(self, item: Loop, lanes: Lanes, count: Any, kind: Type) -> Any:
        """REPEAT's number of rounds."""
        wrong = ~np.isnan(count) & ((count < 0) | (count != np.floor(count)))
        if kind != PLAIN and not np.all(np.isnan(count)):
            fields = {"operator": "REPEAT", "wants": Phrase("takes a plain number"), "given": kind_words(kind)}
            self.ledger.diagnostic(rules.MISMATCH, item.line, "#0", lanes.trail, lanes.count, **fields)
            return np.float64(0)
        if np.any(wrong):
            value = float(count[wrong][0] if isinstance(count, np.ndarray) else count)
            self.ledger.diagnostic(
                rules.COUNT, item.line, "#0", lanes.first_trail(wrong), int(np.count_nonzero(wrong)), what="REPEAT",
                value=value, hint=Phrase("rounds are counted: 0, 1, 2 ..."),
            )  # fmt: skip
        return np.where(wrong | np.isnan(count), 0.0, count)[()]

    def one_by_one(self, item: Loop, lanes: Lanes, sink: Sink, start: Any, step: Any, count: int, kind: Type) -> None:
        """Rounds of the one lane there is, one behind the other."""
        before = lanes.trail
        names = (item.variable or "round",)
        for number in range(count):
            self.ledger.spend(1, item.line, before)
            value = start + number * step
            lanes.trail = self.ledger.trails.add(
                item.line,
                names,
                before,
                (value if item.variable else number + 1,),
                kind=item.kind,
                count=1,
            )
            if item.variable:
                lanes.scope.values[item.variable], lanes.scope.types[item.variable] = value, kind
            self.block(item.body, lanes, sink)
        lanes.trail = before

    def round_by_round(
        self, item: Loop, lanes: Lanes, sink: Sink, start: Any, step: Any, count: Any, kind: Type
    ) -> None:
        """A loop that carries values: all lanes together, round by round."""
        if lanes.count == 1:
            if count > MAX_STEPS:
                self.ledger.spend(MAX_STEPS + 1, item.line, lanes.trail)
            self.one_by_one(item, lanes, sink, start, step, int(count), kind)
            return
        counts = np.broadcast_to(count, lanes.count)
        starts, steps = np.broadcast_to(start, lanes.count), np.broadcast_to(step, lanes.count)
        number = 0
        while len(active := np.flatnonzero(counts > number)):
            self.ledger.spend(_MANY_LANES_STEPS, item.line, lanes.trail)
            part = lanes.take(active)
            values = starts[active] + number * steps[active]
            self.enter_round(item, part, values, np.full(len(active), number), kind)
            inner: Sink = []
            self.block(item.body, part, inner)
            self.bring_back(part, lanes, active, np.arange(len(active)))
            done = self.writer.collected(inner, part.count)
            sink.append(Piece(done.rows, active[done.lane]))
            number += 1

    def at_once(self, item: Loop, lanes: Lanes, sink: Sink, start: Any, step: Any, count: Any, kind: Type) -> None:
        """All rounds of all lanes together."""
        total = float(np.sum(np.broadcast_to(count, lanes.count)))
        self.ledger.go_round(total, item.line, lanes.trail)
        self.ledger.spend(_LOOP_STEPS, item.line, lanes.trail)
        counts = np.broadcast_to(count, lanes.count).astype(np.int64)
        outer = np.repeat(np.arange(lanes.count), counts)
        ends = np.cumsum(counts)
        number = np.arange(len(outer)) - (ends - counts)[outer]
        part = lanes.take(outer)
        values = np.broadcast_to(start, lanes.count)[outer] + number * np.broadcast_to(step, lanes.count)[outer]
        self.enter_round(item, part, values, number, kind)
        inner: Sink = []
        self.block(item.body, part, inner)
        part.scope.values.pop(item.variable, None)
        entered = np.flatnonzero(counts > 0)
        self.bring_back(part, lanes, entered, ends[entered] - 1)
        done = self.writer.collected(inner, part.count)
        sink.append(Piece(done.rows, outer[done.lane]))

    def enter_round(self, item: Loop, part: Lanes, values: Floats, number: Ints, kind: Type) -> None:
        """Set the loop's variable and the trails of many rounds."""
        named = (item.variable or "round",)
        shown = values if item.variable else number + 1.0
        first = self.ledger.trails.add(item.line, named, part.trail, (shown,), kind=item.kind, count=part.count)
        part.trail = first + np.arange(part.count) if part.count > 1 else first
        if item.variable:
            part.scope.values[item.variable] = values if part.count > 1 else values[0]
            part.scope.types[item.variable] = kind

    # Routines and frames.

    def call(self, call: Computed, lanes: Lanes, sink: Sink) -> None:
        """CALL, once in each lane."""
        routine = self.program.routines.get(call.statement.names[0])
        if routine is None or len(routine.parameters) != len(call.statement.arguments):
            return
        self.ledger.spend(_CALL_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, call.line, lanes.trail)
        scope = Scope({}, {})
        constants = 0
        for number, (name, argument) in enumerate(zip(routine.parameters, call.statement.arguments, strict=True)):
            own = call.constants[constants : constants + len(argument.constants)]
            constants += len(argument.constants)
            found = self.numbers.argument(argument, own, lanes, call.line, f"#{number}", "CALL", name)
            scope.values[name], scope.types[name] = found
        first = self.ledger.trails.add(
            call.line, routine.parameters, lanes.trail, tuple(scope.values.values()), kind="call", count=lanes.count
        )
        inside = Lanes(
            count=lanes.count, scope=scope, top=lanes.top,
            trail=first + np.arange(lanes.count) if lanes.count > 1 else first,
            frame=lanes.frame, depth=lanes.depth,
        )  # fmt: skip
        self.block(routine.body, inside, sink)

    def frame(self, item: Frame, lanes: Lanes, sink: Sink) -> None:
        """FRAME: its own row bears its number, and what is inside stands in it."""
        before = lanes.frame
        parents = np.broadcast_to(np.asarray(before, dtype=np.int64), lanes.count)
        self.frame_parents.append(np.array(parents))
        lanes.frame = self.frames + np.arange(lanes.count) if lanes.count > 1 else self.frames
        self.frames += lanes.count
        self.run(item.head, lanes, sink)
        self.block(item.body, lanes, sink)
        lanes.frame = before

    # Runs.

    def run(self, run: Run, lanes: Lanes, sink: Sink) -> None:
        """Plain statements, and what is computed of them."""
        line = int(run.rows.line[0])
        self.ledger.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, line, lanes.trail)
        if len(run.rows.op) == 1 and run.calls:
            self.call(run.calls[0], lanes, sink)
            return
        self.ledger.make(run, lanes, line)
        numbers: list[Any] = []
        systems: list[int] = []
        for one in run.computed:
            for slot in one.slots:
                constants = one.constants[slot.constants : slot.constants + len(slot.expression.constants)]
                found, kind = self.numbers.number(slot.expression, constants, lanes, one.line, slot.word, len(one.at))
                value, system = self.numbers.fitted(found, kind, slot, lanes, one)
                numbers.append(value)
                systems.append(system)
        if run.calls:
            self.with_calls(run, tuple(systems), numbers, lanes, sink)
        elif lanes.count == 1:
            sink.append(Noted(run, tuple(systems), tuple(numbers), lanes.trail, lanes.frame))
        else:
            sink.append(self.writer.spread(run, tuple(systems), numbers, lanes.count, lanes.trail, lanes.frame))

    def with_calls(self, run: Run, systems: tuple[int, ...], numbers: list[Any], lanes: Lanes, sink: Sink) -> None:
        """A run with many CALLs: each of its rows in each lane is a lane, and all CALLs of a form go at once."""
        rows = len(run.rows.op)
        plain = self.writer.spread(run, systems, numbers, lanes.count, lanes.trail, lanes.frame, keep_place=True)
        kept = plain.rows.op != RowOp.CALL
        pieces: Sink = [Piece(plain.rows.pick(kept), plain.lane[kept])]
        for call in run.calls:
            outer = np.repeat(np.arange(lanes.count), len(call.at))
            part = lanes.take(outer)
            constants = tuple(
                np.tile(c, lanes.count) if isinstance(c, np.ndarray) and lanes.count > 1 else c for c in call.constants
            )
            inner: Sink = []
            self.call(replace(call, constants=constants), part, inner)
            done = self.writer.collected(inner, part.count)
            place = outer * rows + np.tile(call.at, lanes.count)
            pieces.append(Piece(done.rows, place[done.lane]))
        together = merged([p for p in pieces if isinstance(p, Piece)])
        sink.append(Piece(together.rows, together.lane // rows))
