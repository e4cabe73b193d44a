"""Run a program: loops, conditions, routines and frames become rows.

Where no iteration of a loop depends on another, all iterations run at once: a name then has one value for each of them,
a lane. So the cost of a statement is that of its arrays, not of its iterations. Loops that carry a value from one
iteration to the next run one by one; what they make is noted and turned into rows together.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.expand.carried_values import carried_values, lets_of
from gusjob.frontend.expand.evaluator import Evaluator, Site
from gusjob.frontend.expand.expanded_job import ExpandedJob
from gusjob.frontend.expand.lanes import Lanes, Scope, any_lane
from gusjob.frontend.expand.ledger import MAX_STEPS, Ledger, LimitReached
from gusjob.frontend.expand.loop_range import LoopRange, loop_range
from gusjob.frontend.expand.program import (
    Block,
    Branch,
    ComputedStatements,
    Frame,
    IncludedFile,
    Item,
    Let,
    Loop,
    Program,
    StatementRun,
    split_constants,
    unread_run,
)
from gusjob.frontend.expand.row_writer import ExpandedRun, LaneRows, Output, RowWriter, merge_lanes
from gusjob.frontend.parse.intent import ANY_NAME
from gusjob.frontend.parse.operators import TRUTH
from gusjob.frontend.parse.statement import RowOp
from gusjob.ir.effects import UNCLEAR
from gusjob.kinematics.arrays import Floats, Ints, counted

# Steps of half a microsecond, measured, without the numbers to compute.
_CALL_STEPS = 60
_LOOP_STEPS = 300
_ITERATION_STEPS = 6
_LET_STEPS = 1
_ONE_LANE_STEPS = 5
_MANY_LANES_STEPS = 60
_PART_STEPS = 60
_START_STEPS = 100
_LANES_PER_STEP = 50
_FEW_ITERATIONS = 16
"""So few iterations with values that they carry are faster one by one."""
_LANES_AT_ONCE = 32_768
"""More iterations run in parts: each name has a number for each of them."""


def expand(program: Program, name: str, machine: Machine) -> tuple[ExpandedJob, list[Diagnostic]]:
    """Run a program; `name` is that of the job."""
    ledger = Ledger(sources=program.sources, machine=machine)
    expander = _Expander(
        program=program,
        ledger=ledger,
        evaluator=Evaluator(ledger=ledger, unset=set(program.unread_names)),
        writer=RowWriter(setups=list(program.setups)),
    )
    names = Scope()
    output: Output = []
    with np.errstate(all="ignore"):
        try:
            expander.block(program.block, Lanes(count=1, scope=names, top=names), output)
        except LimitReached:
            output = []
        done = expander.writer.collect(output, 1)
    expanded = ExpandedJob(
        name=name,
        rows=done.rows,
        setups=tuple(expander.writer.setups),
        sources=program.sources,
        frame_parent=np.concatenate([np.zeros(1, dtype=np.int64), *expander.frame_parents]),
        provenance=ledger.provenance,
        lets=program.lets,
        override_notes=program.override_notes,
    )
    return expanded, ledger.diagnostics()


class _Expander(Struct):
    program: Program
    ledger: Ledger
    evaluator: Evaluator
    writer: RowWriter
    frame_parents: list[Ints] = field(default_factory=list)
    frames: int = 1

    # Blocks.

    def block(self, block: Block, lanes: Lanes, output: Output) -> None:
        """Run the items of a block in their order."""
        lanes.depth += 1
        if block:
            self.ledger.check_depth(block[0], lanes)
        for item in block:
            self.item(item, lanes, output)
        lanes.depth -= 1

    def item(self, item: Item, lanes: Lanes, output: Output) -> None:
        """Run one item."""
        match item:
            case StatementRun():
                self.run(item, lanes, output)
            case Let():
                self.let(item, lanes)
            case Loop():
                self.loop(item, lanes, output)
            case Branch():
                self.branch(item, lanes, output)
            case Frame():
                self.frame(item, lanes, output)
            case IncludedFile():
                self.included(item, lanes, output)

    def count_item(self, line: int, lanes: Lanes) -> None:
        """Count the work of one item."""
        steps = _ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS
        self.ledger.count_steps(steps, line, lanes.provenance)

    def count_call_steps(self, steps: int, line: int, lanes: Lanes) -> None:
        """Count the work of calls; outside of loops and routines there are no more of them than lines."""
        if any_lane(lanes.provenance > 0):
            self.ledger.count_steps(steps, line, lanes.provenance)

    def let(self, item: Let, lanes: Lanes) -> None:
        """Set a name."""
        self.count_item(item.line, lanes)
        site = Site(lanes, item.line, "#0")
        value, kind = self.evaluator.named_number(item.expression, item.constants, site, "LET", item.name)
        lanes.scope.set(item.name, value, kind)

    def included(self, item: IncludedFile, lanes: Lanes, output: Output) -> None:
        """Run an included file."""
        before = lanes.provenance
        first = self.ledger.provenance.add(item.line, (), before, (), kind="include", count=lanes.count)
        lanes.provenance = lanes.numbered(first)
        self.ledger.count_steps(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, before)
        self.block(item.body, lanes, output)
        lanes.provenance = before

    def branch(self, item: Branch, lanes: Lanes, output: Output) -> None:
        """Run an IF."""
        self.count_item(item.line, lanes)
        site = Site(lanes, item.line, "#0")
        truth, kind = self.evaluator.number(item.condition, item.constants, site)
        if kind[0] != TRUTH:
            if not np.all(np.isnan(truth)):
                self.evaluator.report(rules.NOT_A_CONDITION, site)
            self.skipped(item.line, lanes, output)
            return
        if any_lane(truth != truth):
            self.skipped(item.line, lanes, output)
        for block, holds in ((item.then, truth == 1), (item.otherwise, truth == 0)):
            if not any_lane(holds):
                continue
            if not any_lane(~holds):
                self.block(block, lanes, output)
            else:
                which = np.flatnonzero(holds)
                part = lanes.take(which)
                rows = self.block_of_part(block, part)
                self.bring_back(part, lanes, which, np.arange(len(which)))
                output.append(LaneRows(rows.rows, which[rows.lane]))

    def block_of_part(self, block: Block, part: Lanes) -> LaneRows:
        """Run a block in lanes of its own."""
        if block:
            self.ledger.count_steps(_PART_STEPS + part.count // _LANES_PER_STEP, block[0].line, part.provenance)
        output: Output = []
        self.block(block, part, output)
        return self.writer.collect(output, part.count)

    def bring_back(self, part: Lanes, lanes: Lanes, to: Ints, source: Ints) -> None:
        """Take over names that were set in other lanes: lane `source` of `part` gives lane `to` its value."""
        for name, (value, kind) in part.scope.own.items():
            known = lanes.scope.get(name) or lanes.top.get(name)  # A name that a routine has not set is the job's.
            old = None if known is None else known[0]
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
            lanes.scope.set(name, fresh if lanes.count > 1 else fresh[0], kind)

    # Loops.

    def loop(self, item: Loop, lanes: Lanes, output: Output) -> None:
        """Run REPEAT or FOR."""
        span = loop_range(item, self.evaluator, lanes)
        if span.is_faulty:
            self.skipped(item.line, lanes, output)
        if not any_lane(span.count > 0):
            return
        hidden = lanes.scope.own.get(item.variable)
        if id(item) in self.program.sequential_loops:
            self.one_iteration_at_a_time(item, lanes, output, span)
        else:
            self.at_once(item, lanes, output, span)
        lanes.scope.own.pop(item.variable, None)
        if hidden is not None:
            lanes.scope.set(item.variable, *hidden)

    def in_one_lane(self, item: Loop, lanes: Lanes, output: Output, span: LoopRange) -> None:
        """Run the iterations of the only lane, each after the one before it."""
        lets = lets_of(item)
        for begin in range(0, int(span.count), _LANES_AT_ONCE):
            number = np.arange(begin, min(begin + _LANES_AT_ONCE, int(span.count)))
            if (
                lets is None
                or len(number) < _FEW_ITERATIONS
                or not self.lets_first(item, lets, lanes, output, span, number)
            ):
                self.one_by_one(item, lanes, output, span, number)

    def one_by_one(self, item: Loop, lanes: Lanes, output: Output, span: LoopRange, number: Ints) -> None:
        """Run some iterations of the only lane completely, one after the other."""
        before = lanes.provenance
        values = span.start + number * span.step
        first = self.add_iterations(item, before, values, number)
        for at, value in enumerate(values):
            self.ledger.count_steps(_ITERATION_STEPS, item.line, before)
            lanes.provenance = first + at
            if item.variable:
                lanes.scope.set(item.variable, value, span.kind)
            self.block(item.body, lanes, output)
        lanes.provenance = before

    def lets_first(
        self, item: Loop, lets: tuple[Let, ...], lanes: Lanes, output: Output, span: LoopRange, number: Ints
    ) -> bool:
        """Run the LETs of some iterations of the only lane, then their statements at once; False if that can't be."""
        steps = sum(_LET_STEPS + let.expression.work for let in lets)
        self.ledger.count_steps(steps * len(number), item.line, lanes.provenance)
        values = span.start + number * span.step
        carried = carried_values(lets, item.variable, span.kind, values, (lanes.scope, lanes.top))
        if carried is None:
            return False
        part = lanes.take(np.zeros(len(number), dtype=np.int64))
        self.enter_iterations(item, part, values, number, span)
        for name, named in carried.before.items():
            part.scope.set(name, *named)
        rows: Output = []
        after = iter(carried.after)
        for one in item.body:
            if isinstance(one, Let):
                part.scope.set(one.name, *next(after))
            else:
                self.item(one, part, rows)
        made = self.writer.collect(rows, part.count).rows
        output.append(LaneRows(made, np.zeros(len(made.op), dtype=np.int64)))
        part.scope.own.pop(item.variable, None)
        self.bring_back(part, lanes, np.zeros(1, dtype=np.int64), np.array([len(number) - 1]))
        return True

    def one_iteration_at_a_time(self, item: Loop, lanes: Lanes, output: Output, span: LoopRange) -> None:
        """Run a sequential loop: iteration by iteration, all lanes together."""
        if lanes.count == 1:
            self.ledger.count_steps(_START_STEPS, item.line, lanes.provenance)
            if span.count > MAX_STEPS:
                self.ledger.count_steps(MAX_STEPS + 1, item.line, lanes.provenance)
            self.in_one_lane(item, lanes, output, span)
            return
        starts, steps, counts = span.by_lane(lanes.count)
        number = 0
        while len(active := np.flatnonzero(counts > number)):
            self.ledger.count_steps(_LOOP_STEPS, item.line, lanes.provenance)
            part = lanes.take(active)
            values = starts[active] + number * steps[active]
            self.enter_iterations(item, part, values, np.full(len(active), number), span)
            rows = self.block_of_part(item.body, part)
            self.bring_back(part, lanes, active, np.arange(len(active)))
            output.append(LaneRows(rows.rows, active[rows.lane]))
            number += 1

    def at_once(self, item: Loop, lanes: Lanes, output: Output, span: LoopRange) -> None:
        """Run all iterations of all lanes together."""
        starts, steps, float_counts = span.by_lane(lanes.count)
        self.ledger.count_iterations(float(np.sum(float_counts)), item.line, lanes.provenance)
        counts = float_counts.astype(np.int64)
        outer, number = counted(counts)
        ends = np.cumsum(counts)
        for begin in range(0, len(outer), _LANES_AT_ONCE):
            self.ledger.count_steps(_LOOP_STEPS, item.line, lanes.provenance)
            some = slice(begin, begin + _LANES_AT_ONCE)
            part = lanes.take(outer[some])
            values = starts[outer[some]] + number[some] * steps[outer[some]]
            self.enter_iterations(item, part, values, number[some], span)
            rows = self.block_of_part(item.body, part)
            part.scope.own.pop(item.variable, None)
            ended = np.flatnonzero((counts > 0) & (ends > begin) & (ends <= begin + part.count))
            self.bring_back(part, lanes, ended, ends[ended] - 1 - begin)
            output.append(LaneRows(rows.rows, outer[some][rows.lane]))

    def enter_iterations(self, item: Loop, part: Lanes, values: Floats, number: Ints, span: LoopRange) -> None:
        """Set the loop's variable and the provenance of many iterations. `number`: of each, from 0."""
        part.provenance = part.numbered(self.add_iterations(item, part.provenance, values, number))
        if item.variable:
            part.scope.set(item.variable, values if part.count > 1 else values[0], span.kind)

    def add_iterations(self, item: Loop, around: Any, values: Floats, number: Ints) -> int:
        """Add the provenance of iterations, and return that of the first."""
        names = (item.variable or "round",)
        shown = values if item.variable else number + 1.0
        return self.ledger.provenance.add(item.line, names, around, (shown,), kind=item.step_kind, count=len(number))

    # Routines and frames.

    def call(self, call: ComputedStatements, lanes: Lanes, output: Output) -> None:
        """Run a CALL, once in each lane."""
        statement = call.statement
        routine = self.program.routines.get(statement.names[0])
        if routine is None or len(routine.parameters) != len(statement.arguments):
            self.unread(call.line, lanes, output)
            return
        self.count_call_steps(_CALL_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, call.line, lanes)
        scope = Scope()
        constants = split_constants(call.constants, statement.arguments)
        arguments = zip(routine.parameters, statement.arguments, constants, strict=True)
        for number, (name, argument, own) in enumerate(arguments):
            site = Site(lanes, call.line, f"#{number}")
            scope.set(name, *self.evaluator.named_number(argument, own, site, "CALL", name))
        first = self.ledger.provenance.add(
            call.line,
            routine.parameters,
            lanes.provenance,
            tuple(value for value, _ in scope.own.values()),
            kind="call",
            count=lanes.count,
        )
        inside = replace(lanes, scope=scope, provenance=lanes.numbered(first))
        self.block(routine.body, inside, output)

    def frame(self, item: Frame, lanes: Lanes, output: Output) -> None:
        """Run a FRAME: its own row and those inside have its number."""
        before = lanes.frame
        self.frame_parents.append(np.array(np.broadcast_to(np.asarray(before, dtype=np.int64), lanes.count)))
        lanes.frame = lanes.numbered(self.frames)
        self.frames += lanes.count
        self.run(item.head, lanes, output)
        self.block(item.body, lanes, output)
        lanes.frame = before

    # Runs of statements.

    def skipped(self, line: int, lanes: Lanes, output: Output) -> None:
        """Add a row for a block that does not run because of an error: any name may be set in it."""
        self.evaluator.unset.add(ANY_NAME)
        self.unread(line, lanes, output)

    def unread(self, line: int, lanes: Lanes, output: Output) -> None:
        """Add a row for what could not be run at a line: nothing is known behind it."""
        run = ExpandedRun(unread_run(line, UNCLEAR), (), (), lanes.provenance, lanes.frame)
        output.append(run if lanes.count == 1 else self.writer.rows_of(run, lanes.count))

    def run(self, run: StatementRun, lanes: Lanes, output: Output) -> None:
        """Run consecutive statements: compute the numbers of those with expressions."""
        self.count_item(run.line, lanes)
        if len(run.rows.op) == 1 and run.calls:
            self.call(run.calls[0], lanes, output)
            return
        self.ledger.count_statements(run, lanes)
        numbers: list[Any] = []
        systems: list[int] = []
        for computed in run.computed:
            for slot in computed.slots:
                constants = computed.constants[slot.constants : slot.constants + len(slot.expression.constants)]
                site = Site(lanes, computed.line, slot.word)
                found, kind = self.evaluator.number(slot.expression, constants, site, len(computed.at))
                value, system = self.evaluator.fitted(found, kind, slot, lanes, computed)
                numbers.append(value)
                systems.append(system)
        expanded = ExpandedRun(run, tuple(numbers), tuple(systems), lanes.provenance, lanes.frame)
        if run.calls:
            self.with_calls(expanded, lanes, output)
        elif lanes.count == 1:
            output.append(expanded)
        else:
            output.append(self.writer.rows_of(expanded, lanes.count))

    def with_calls(self, expanded: ExpandedRun, lanes: Lanes, output: Output) -> None:
        """Add a run with many CALLs: each of its rows in each lane is a lane, and all CALLs of a shape run at once."""
        run = expanded.run
        rows = len(run.rows.op)
        self.count_call_steps(_LOOP_STEPS * (1 + len(run.calls)), run.line, lanes)
        plain = self.writer.rows_of(expanded, lanes.count, lane_is_place=True)
        kept = plain.rows.op != RowOp.CALL
        parts = [LaneRows(plain.rows.pick(kept), plain.lane[kept])]
        for call in run.calls:
            outer = np.repeat(np.arange(lanes.count), len(call.at))
            part = lanes.take(outer)
            self.ledger.count_calls(part, call.line)
            constants = tuple(
                np.tile(c, lanes.count) if isinstance(c, np.ndarray) and lanes.count > 1 else c for c in call.constants
            )
            called: Output = []
            self.call(replace(call, constants=constants), part, called)
            done = self.writer.collect(called, part.count)
            place = outer * rows + np.tile(call.at, lanes.count)
            parts.append(LaneRows(done.rows, place[done.lane]))
        together = merge_lanes(parts)
        output.append(LaneRows(together.rows, together.lane // rows))
