"""A program carried out: loops, branches, routines and frames become rows.

Where no round of a loop hangs on another, all rounds are carried out at once: a name then has one value for each of
them, a lane. So a statement costs its arrays, not its rounds. Loops that carry a value from round to round go one by
one, and what they come to is written down and made into rows together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from gusjob import diagnostics as d
from gusjob import rules
from gusjob.diagnostics import Collector, Diagnostic, Rule
from gusjob.job import Trails, trail_remarks
from gusjob.machine import Machine
from gusjob.syntax.expressions import PLAIN, TRUTH, Expression, Mismatch, Number, Type
from gusjob.syntax.forms import Field, Word
from gusjob.syntax.job_reader import RowOp
from gusjob.syntax.lines import nearest
from gusjob.syntax.program import (
    Block,
    Branch,
    Computed,
    Frame,
    Included,
    Item,
    Let,
    Loop,
    Program,
    Run,
    Slot,
)
from gusjob.syntax.shapes import MAX_NUMBER, Rows, join
from gusjob.syntax.statements import POWER_KINDS, WANTED, Statement
from gusjob.units import Kind, System

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

MAX_STEPS = 4_000_000
"""Steps of work. What is carried out one by one, in loops that carry values and in routines that call themselves,
comes to some five a statement; what is carried out at once, to some three in a hundred rounds."""
MAX_SETUPS = 50_000
"""Setup statements that loops and routines make."""
_CALL_STEPS = 40
_LOOP_STEPS = 100
_ONE_LANE_STEPS = 2
_MANY_LANES_STEPS = 30
_LANES_A_STEP = 10
_FEW_ROUNDS = 4
"""So few rounds are quicker one by one."""
_NOTHING: Type = (Kind.PLAIN, 0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Expanded:
    """Rows in the order in which they are carried out; `frame_parent`: for each frame (from 1) the one around it."""

    rows: Rows
    setups: tuple[Statement, ...]
    frame_parent: Ints
    trails: Trails
    diagnostics: tuple[Diagnostic, ...]


@dataclass(slots=True)
class _Scope:
    """Names: values (one for all lanes, or one each) and kinds."""

    values: dict[str, Number]
    types: dict[str, Type]

    def take(self, lanes: Ints) -> _Scope:
        """The same names for some of the lanes, in any order and number."""
        return _Scope({k: _taken(v, lanes) for k, v in self.values.items()}, self.types.copy())


def _some(truth: Any) -> bool:
    """Whether something holds in some lane; quick for one lane, which np.any is not."""
    return bool(truth.any()) if isinstance(truth, np.ndarray) else bool(truth)


def _taken(value: Any, lanes: Ints) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    return value[lanes[0]] if len(lanes) == 1 else value[lanes]


@dataclass(slots=True)
class _Lanes:
    """Rounds that are carried out together. With one lane every value is a number, with more it may be an array.

    `scope`: names in force; `top`: those of the job, which a routine may read. `trail`, `frame`: numbers, one or one
    a lane. `depth`: of calls and blocks.
    """

    count: int
    scope: _Scope
    top: _Scope
    trail: Any = 0
    frame: Any = 0
    depth: int = 0

    def take(self, lanes: Ints) -> _Lanes:
        """Some of the lanes."""
        top = self.top.take(lanes)
        scope = top if self.scope is self.top else self.scope.take(lanes)
        return _Lanes(
            count=len(lanes), scope=scope, top=top, trail=_taken(self.trail, lanes), frame=_taken(self.frame, lanes),
            depth=self.depth,
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Piece:
    """Rows of some lanes."""

    rows: Rows
    lane: Ints


@dataclass(frozen=True, slots=True)
class _Noted:
    """A run that one lane has carried out, not yet made into rows."""

    run: Run
    systems: tuple[int, ...]
    numbers: tuple[Any, ...]
    trail: Any
    frame: Any


_Sink = list[_Piece | _Noted]


class _Full(Exception):  # noqa: N818  (no error: the way out of a program that is too large, caught in `expand`)
    """A limit is reached; what was reported says which."""


def expand(program: Program, machine: Machine) -> Expanded:
    """All rows of a program."""
    executor = _Executor(
        program=program, machine=machine, setups=list(program.setups), failed=set(program.unread_names)
    )
    names = _Scope({}, {})
    sink: _Sink = []
    with np.errstate(all="ignore"):
        try:
            executor.block(program.block, _Lanes(count=1, scope=names, top=names), sink)
        except _Full:
            sink = []
        done = executor.collected(sink, 1)
    return Expanded(
        rows=done.rows,
        setups=tuple(executor.setups),
        frame_parent=np.concatenate([np.zeros(1, dtype=np.int64), *executor.frame_parents]),
        trails=executor.trails,
        diagnostics=tuple(executor.found()),
    )


@dataclass(slots=True)
class _Executor:
    program: Program
    machine: Machine
    setups: list[Statement]
    trails: Trails = field(default_factory=Trails)
    frame_parents: list[Ints] = field(default_factory=list)
    frames: int = 1
    rows: int = 0
    rounds_made: float = 0.0
    setup_rows: int = 0
    steps: int = 0
    faults: dict[tuple[str, int, str], tuple[Rule, int, dict[str, Any], int]] = field(default_factory=dict)
    """By code, line and word: the rule, the first one's trail and fields, and how many there are."""
    failed: set[str] = field(default_factory=set)
    """Names whose LET has no value or can't be read: that was said where they are set."""

    # What is wrong.

    def fault(self, rule: Rule, line: int, word: str, trail: Any, count: int = 1, /, **fields: object) -> None:
        """A fault at a word of a line, in one or more lanes."""
        key = (rule.code, line, word)
        known = self.faults.get(key)
        if known is None:
            first = int(trail[0] if isinstance(trail, np.ndarray) else trail)
            self.faults[key] = (rule, first, dict(fields), count)
        else:
            self.faults[key] = (*known[:3], known[3] + count)

    def found(self) -> list[Diagnostic]:
        """All faults, each once."""
        sources = self.program.sources
        collector = Collector("")
        for (_, line, word), (rule, trail, fields, count) in self.faults.items():
            if collector.room(rule):
                remarks = trail_remarks(self.trails, trail, sources.locate)
                collector.add(rule, sources.locate(line, word), fields, count, remarks)
            else:
                collector.uncounted(rule, 1)
        return collector.done(rules.MORE)

    def stop(self, rule: Rule, line: int, trail: Any, **fields: object) -> NoReturn:
        """Report a limit and leave."""
        self.fault(rule, line, "", trail, **fields)
        raise _Full

    def spend(self, steps: int, line: int, trail: Any) -> None:
        """Count the work."""
        self.steps += steps
        if self.steps > MAX_STEPS:
            self.stop(rules.TOO_SLOW, line, trail, limit=MAX_STEPS)

    # Numbers.

    def number(
        self, expression: Expression, constants: Sequence[Any], lanes: _Lanes, line: int, word: str, rows: int = 1
    ) -> tuple[Any, Type]:
        """The value of an expression and its kind; NaN where it has none, which is reported.

        With more than one row and lane the result has the shape (lanes, rows), or one that broadcasts to it.
        """
        scope, top = lanes.scope, lanes.top
        values: dict[str, Any] = {}
        types = []
        for name in expression.names:
            value = scope.values.get(name)
            source = scope
            if value is None:
                value, source = top.values.get(name), top
            if value is None:
                return self.unknown(name, lanes, line, word)
            values[name] = value.reshape(-1, 1) if rows > 1 and isinstance(value, np.ndarray) else value
            types.append(source.types[name])
        kind = expression.type(tuple(types))
        if isinstance(kind, Mismatch):
            self.mismatch(kind, lanes, line, word)
            return np.float64(np.nan), _NOTHING
        self.spend(len(expression.code) // 3 * (1 + max(lanes.count, rows) // _LANES_A_STEP), line, lanes.trail)
        value = expression.run(values, constants)
        if not (np.isfinite(value).all() if isinstance(value, np.ndarray) else math.isfinite(value)):
            value = self.no_value(expression, value, values, lanes, line, word)
        return value, kind

    def unknown(self, name: str, lanes: _Lanes, line: int, word: str) -> tuple[Any, Type]:
        """A name that was never set."""
        if (rules.UNKNOWN_NAME.code, line, word) in self.faults:
            self.fault(rules.UNKNOWN_NAME, line, word, lanes.trail, lanes.count)
        elif name not in self.failed:
            near = nearest(name, {**lanes.scope.values, **lanes.top.values})
            hint = f"; did you mean {near}?" if near else f": write LET {name} = ... before it"
            self.fault(rules.UNKNOWN_NAME, line, word, lanes.trail, lanes.count, name=name, hint=hint)
        return np.float64(np.nan), _NOTHING

    def mismatch(self, found: Mismatch, lanes: _Lanes, line: int, word: str) -> None:
        """Operands that do not fit."""
        given = " and ".join(_kind_words(kind) for kind in found.given[:4])
        fields = {"operator": found.function.name, "wants": found.function.typing.value, "given": given}
        self.fault(rules.MISMATCH, line, word, lanes.trail, lanes.count, **fields)

    def no_value(
        self, expression: Expression, value: Any, values: dict[str, Any], lanes: _Lanes, line: int, word: str
    ) -> Any:
        """Division by zero, the root of a negative number, a name that not every lane has set."""
        wrong = ~np.isfinite(value)
        for name in expression.names:
            unset = np.isnan(values[name])
            if np.any(unset):
                if name not in self.failed:
                    count = int(np.count_nonzero(np.broadcast_to(unset, np.shape(value)) if np.ndim(value) else unset))
                    hint = ": not every way leads through its LET"
                    self.fault(rules.UNKNOWN_NAME, line, word, self.first(lanes, unset), count, name=name, hint=hint)
                wrong = wrong & ~unset
        if np.any(wrong):
            fields = {"value": "no number" if np.any(np.isnan(value)) else "a number without end"}
            self.fault(rules.NO_VALUE, line, word, self.first(lanes, wrong), int(np.count_nonzero(wrong)), **fields)
        return np.where(np.isfinite(value), value, np.nan)[()]

    def first(self, lanes: _Lanes, where: Any) -> Any:
        """The trail of the first lane at which something holds."""
        if not isinstance(lanes.trail, np.ndarray) or np.ndim(where) == 0:
            return lanes.trail
        by_lane = where if np.ndim(where) == 1 else where.any(axis=1)
        return lanes.trail[int(np.argmax(by_lane))] if len(by_lane) == lanes.count else lanes.trail

    def fitted(self, value: Any, kind: Type, slot: Slot, lanes: _Lanes, one: Computed) -> tuple[Any, int]:
        """A value as the word needs it, and the system it was written in."""
        word, line = slot.kind, one.line
        fits = kind == PLAIN or kind[0] == word.kind or (word.kind is Kind.POWER and kind[0] in POWER_KINDS)
        if word.kind is Kind.PLAIN:
            fits = kind == PLAIN
        if not fits:
            if not np.all(np.isnan(value)):
                name = one.statement.name if slot.word == "value" else f"{one.statement.name} {slot.word}"
                self.wrong_kind(kind, word, lanes, line, slot.word, name)
            return np.float64(np.nan), 0
        if kind[0] == Kind.TIME and word.ms:
            value = value / 1000.0
        large = abs(value) > MAX_NUMBER
        if _some(large):
            shown = d.number(float(np.max(np.abs(value))))
            self.fault(
                rules.TOO_BIG, line, slot.word, self.first(lanes, large), int(np.count_nonzero(large)), value=shown,
                limit=MAX_NUMBER,
            )  # fmt: skip
            value = np.where(large, np.nan, value)[()]
        return value, kind[1] if kind != PLAIN else 0

    def wrong_kind(self, kind: Type, word: Word, lanes: _Lanes, line: int, place: str, what: str) -> None:
        """A comparison, or a number with a unit of another kind."""
        if kind[0] == TRUTH:
            self.fault(rules.NOT_A_NUMBER, line, place, lanes.trail, lanes.count, what=what)
            return
        shown = Kind(kind[0]).words
        fields = {"what": what, "wanted": WANTED[word.kind], "unit": "this expression", "kind": shown, "hint": ""}
        self.fault(rules.WRONG_UNIT, line, place, lanes.trail, lanes.count, **fields)

    def count_of(self, value: Any, kind: Type, lanes: _Lanes, line: int, word: str) -> Any:
        """A plain number for REPEAT and FOR; NaN where it is none."""
        if kind[0] == TRUTH:
            self.fault(rules.NOT_A_NUMBER, line, word, lanes.trail, lanes.count, what="a loop")
            return np.float64(np.nan)
        return value

    # Blocks.

    def block(self, block: Block, lanes: _Lanes, sink: _Sink) -> None:
        """Carry out the items of a block in their order."""
        lanes.depth += 1
        if lanes.depth > self.machine.expansion_max_depth and block:
            self.too_deep(block[0], lanes)
        for item in block:
            self.item(item, lanes, sink)
        lanes.depth -= 1

    def too_deep(self, item: Item, lanes: _Lanes) -> None:
        """Blocks and calls inside each other have a limit: a routine may call itself."""
        line = int(item.rows.line[0]) if isinstance(item, Run) else item.line
        limit = self.machine.expansion_max_depth
        self.stop(rules.TOO_DEEP, line, lanes.trail, limit=limit, key="max_depth")

    def item(self, item: Item, lanes: _Lanes, sink: _Sink) -> None:
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
                first = self.trails.add(item.line, (), before, (), kind="include", count=lanes.count)
                lanes.trail = first + np.arange(lanes.count) if lanes.count > 1 else first
                self.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, before)
                self.block(item.body, lanes, sink)
                lanes.trail = before

    def let(self, item: Let, lanes: _Lanes) -> None:
        """Set a name."""
        self.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, lanes.trail)
        value, kind = self.number(item.expression, item.constants, lanes, item.line, "#0")
        if kind[0] == TRUTH:
            self.fault(rules.NOT_A_NUMBER, item.line, "#0", lanes.trail, lanes.count, what="LET")
            value, kind = np.float64(np.nan), _NOTHING
        if _some(value != value):
            self.failed.add(item.name)
        lanes.scope.values[item.name] = value
        lanes.scope.types[item.name] = kind

    def branch(self, item: Branch, lanes: _Lanes, sink: _Sink) -> None:
        """IF."""
        self.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, item.line, lanes.trail)
        truth, kind = self.number(item.condition, item.constants, lanes, item.line, "#0")
        if kind[0] != TRUTH:
            if not np.all(np.isnan(truth)):
                self.fault(rules.NOT_A_CONDITION, item.line, "#0", lanes.trail, lanes.count)
            return
        for block, holds in ((item.then, truth == 1), (item.otherwise, truth == 0)):
            if not _some(holds):
                continue
            if not _some(~holds):
                self.block(block, lanes, sink)
            else:
                self.some(block, lanes, np.flatnonzero(holds), sink)

    def some(self, block: Block, lanes: _Lanes, which: Ints, sink: _Sink) -> None:
        """Carry out a block in some of the lanes, and bring back what it sets."""
        part = lanes.take(which)
        inner: _Sink = []
        self.block(block, part, inner)
        self.bring_back(part, lanes, which, np.arange(len(which)))
        done = self.collected(inner, part.count)
        sink.append(_Piece(done.rows, which[done.lane]))

    def bring_back(self, part: _Lanes, lanes: _Lanes, to: Ints, source: Ints) -> None:
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

    def loop(self, item: Loop, lanes: _Lanes, sink: _Sink) -> None:
        """REPEAT and FOR."""
        start, step, count, kind = self.bounds(item, lanes)
        if not _some(count > 0):
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

    def bounds(self, item: Loop, lanes: _Lanes) -> tuple[Any, Any, Any, Type]:
        """Start, step and number of rounds, for all lanes or for each; the kind of the loop's variable."""
        found, kinds, constants = [], [], 0
        for number, bound in enumerate(item.bounds):
            own = item.constants[constants : constants + len(bound.constants)]
            constants += len(bound.constants)
            value, kind = self.number(bound, own, lanes, item.line, f"#{number}")
            found.append(self.count_of(value, kind, lanes, item.line, f"#{number}"))
            kinds.append(kind)
        if len(found) == 1:
            return np.float64(0), np.float64(1), self.rounds(item, lanes, found[0], kinds[0]), PLAIN
        start, end = found[0], found[1]
        step = found[2] if len(found) > 2 else np.float64(1)
        if any(kind != kinds[0] for kind in kinds) and not any(np.all(np.isnan(v)) for v in found):
            given = " and ".join(_kind_words(kind) for kind in kinds)
            fields = {"operator": "FOR", "wants": "takes numbers of one kind", "given": given}
            self.fault(rules.MISMATCH, item.line, "", lanes.trail, lanes.count, **fields)
            return start, step, np.float64(0), PLAIN
        if np.any(step == 0):
            hint = "it would never end"
            self.fault(rules.COUNT, item.line, "#2", self.first(lanes, step == 0), what="STEP", value=0.0, hint=hint)
        # A last round that rounding has moved behind the end still counts.
        rounds = np.floor((end - start) / step * (1 + 1e-12) + 1e-9) + 1
        counted = np.where((step != 0) & np.isfinite(rounds), np.maximum(rounds, 0), 0.0)[()]
        return start, step, counted, kinds[0]

    def rounds(self, item: Loop, lanes: _Lanes, count: Any, kind: Type) -> Any:
        """REPEAT's number of rounds."""
        wrong = ~np.isnan(count) & ((count < 0) | (count != np.floor(count)))
        if kind != PLAIN and not np.all(np.isnan(count)):
            fields = {"operator": "REPEAT", "wants": "takes a plain number", "given": _kind_words(kind)}
            self.fault(rules.MISMATCH, item.line, "#0", lanes.trail, lanes.count, **fields)
            return np.float64(0)
        if np.any(wrong):
            value = float(count[wrong][0] if isinstance(count, np.ndarray) else count)
            self.fault(
                rules.COUNT, item.line, "#0", self.first(lanes, wrong), int(np.count_nonzero(wrong)), what="REPEAT",
                value=value, hint="rounds are counted: 0, 1, 2 ...",
            )  # fmt: skip
        return np.where(wrong | np.isnan(count), 0.0, count)[()]

    def one_by_one(self, item: Loop, lanes: _Lanes, sink: _Sink, start: Any, step: Any, count: int, kind: Type) -> None:
        """Rounds of the one lane there is, one behind the other."""
        before = lanes.trail
        names = (item.variable or "round",)
        for number in range(count):
            self.spend(1, item.line, before)
            value = start + number * step
            lanes.trail = self.trails.add(
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
        self, item: Loop, lanes: _Lanes, sink: _Sink, start: Any, step: Any, count: Any, kind: Type
    ) -> None:
        """A loop that carries values: all lanes together, round by round."""
        if lanes.count == 1:
            if count > MAX_STEPS:
                self.spend(MAX_STEPS + 1, item.line, lanes.trail)
            self.one_by_one(item, lanes, sink, start, step, int(count), kind)
            return
        counts = np.broadcast_to(count, lanes.count)
        starts, steps = np.broadcast_to(start, lanes.count), np.broadcast_to(step, lanes.count)
        number = 0
        while len(active := np.flatnonzero(counts > number)):
            self.spend(_MANY_LANES_STEPS, item.line, lanes.trail)
            part = lanes.take(active)
            values = starts[active] + number * steps[active]
            self.enter_round(item, part, values, np.full(len(active), number), kind)
            inner: _Sink = []
            self.block(item.body, part, inner)
            self.bring_back(part, lanes, active, np.arange(len(active)))
            done = self.collected(inner, part.count)
            sink.append(_Piece(done.rows, active[done.lane]))
            number += 1

    def at_once(self, item: Loop, lanes: _Lanes, sink: _Sink, start: Any, step: Any, count: Any, kind: Type) -> None:
        """All rounds of all lanes together."""
        total = float(np.sum(np.broadcast_to(count, lanes.count)))
        limit = self.machine.expansion_max_statements
        self.rounds_made += total
        if self.rounds_made > limit:
            self.stop(rules.TOO_MANY, item.line, lanes.trail, what="rounds", limit=limit, key="max_statements")
        self.spend(_LOOP_STEPS, item.line, lanes.trail)
        counts = np.broadcast_to(count, lanes.count).astype(np.int64)
        outer = np.repeat(np.arange(lanes.count), counts)
        ends = np.cumsum(counts)
        number = np.arange(len(outer)) - (ends - counts)[outer]
        part = lanes.take(outer)
        values = np.broadcast_to(start, lanes.count)[outer] + number * np.broadcast_to(step, lanes.count)[outer]
        self.enter_round(item, part, values, number, kind)
        inner: _Sink = []
        self.block(item.body, part, inner)
        part.scope.values.pop(item.variable, None)
        some = np.flatnonzero(counts > 0)
        self.bring_back(part, lanes, some, ends[some] - 1)
        done = self.collected(inner, part.count)
        sink.append(_Piece(done.rows, outer[done.lane]))

    def enter_round(self, item: Loop, part: _Lanes, values: Floats, number: Ints, kind: Type) -> None:
        """Set the loop's variable and the trails of many rounds."""
        named = (item.variable or "round",)
        shown = values if item.variable else number + 1.0
        first = self.trails.add(item.line, named, part.trail, (shown,), kind=item.kind, count=part.count)
        part.trail = first + np.arange(part.count) if part.count > 1 else first
        if item.variable:
            part.scope.values[item.variable] = values if part.count > 1 else values[0]
            part.scope.types[item.variable] = kind

    # Routines and frames.

    def call(self, call: Computed, lanes: _Lanes, sink: _Sink) -> None:
        """CALL, once in each lane."""
        routine = self.program.routines.get(call.statement.names[0])
        if routine is None or len(routine.parameters) != len(call.statement.arguments):
            return
        self.spend(_CALL_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, call.line, lanes.trail)
        scope = _Scope({}, {})
        constants = 0
        for number, (name, argument) in enumerate(zip(routine.parameters, call.statement.arguments, strict=True)):
            own = call.constants[constants : constants + len(argument.constants)]
            constants += len(argument.constants)
            value, kind = self.number(argument, own, lanes, call.line, f"#{number}")
            if kind[0] == TRUTH:
                self.fault(rules.NOT_A_NUMBER, call.line, f"#{number}", lanes.trail, lanes.count, what="CALL")
                value, kind = np.float64(np.nan), _NOTHING
            if _some(value != value):
                self.failed.add(name)
            scope.values[name], scope.types[name] = value, kind
        first = self.trails.add(
            call.line, routine.parameters, lanes.trail, tuple(scope.values.values()), kind="call", count=lanes.count
        )
        inside = _Lanes(
            count=lanes.count, scope=scope, top=lanes.top,
            trail=first + np.arange(lanes.count) if lanes.count > 1 else first,
            frame=lanes.frame, depth=lanes.depth,
        )  # fmt: skip
        self.block(routine.body, inside, sink)

    def frame(self, item: Frame, lanes: _Lanes, sink: _Sink) -> None:
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

    def run(self, run: Run, lanes: _Lanes, sink: _Sink) -> None:
        """Plain statements, and what is computed of them."""
        line = int(run.rows.line[0])
        self.spend(_ONE_LANE_STEPS if lanes.count == 1 else _MANY_LANES_STEPS, line, lanes.trail)
        if len(run.rows.op) == 1 and run.calls:
            self.call(run.calls[0], lanes, sink)
            return
        self.room(run, lanes, line)
        numbers: list[Any] = []
        systems: list[int] = []
        for one in run.computed:
            for slot in one.slots:
                constants = one.constants[slot.constants : slot.constants + len(slot.expression.constants)]
                found, kind = self.number(slot.expression, constants, lanes, one.line, slot.word, len(one.at))
                value, system = self.fitted(found, kind, slot, lanes, one)
                numbers.append(value)
                systems.append(system)
        if run.calls:
            self.with_calls(run, tuple(systems), numbers, lanes, sink)
        elif lanes.count == 1:
            sink.append(_Noted(run, tuple(systems), tuple(numbers), lanes.trail, lanes.frame))
        else:
            sink.append(self.spread(run, tuple(systems), numbers, lanes.count, lanes.trail, lanes.frame))

    def with_calls(self, run: Run, systems: tuple[int, ...], numbers: list[Any], lanes: _Lanes, sink: _Sink) -> None:
        """A run with many CALLs: each of its rows in each lane is a lane, and all CALLs of a form go at once."""
        rows = len(run.rows.op)
        plain = self.spread(run, systems, numbers, lanes.count, lanes.trail, lanes.frame, keep_place=True)
        kept = plain.rows.op != RowOp.CALL
        pieces: _Sink = [_Piece(plain.rows.pick(kept), plain.lane[kept])]
        for call in run.calls:
            outer = np.repeat(np.arange(lanes.count), len(call.at))
            part = lanes.take(outer)
            constants = tuple(
                np.tile(c, lanes.count) if isinstance(c, np.ndarray) and lanes.count > 1 else c for c in call.constants
            )
            inner: _Sink = []
            self.call(replace(call, constants=constants), part, inner)
            done = self.collected(inner, part.count)
            place = outer * rows + np.tile(call.at, lanes.count)
            pieces.append(_Piece(done.rows, place[done.lane]))
        merged = _merged([p for p in pieces if isinstance(p, _Piece)])
        sink.append(_Piece(merged.rows, merged.lane // rows))

    def room(self, run: Run, lanes: _Lanes, line: int) -> None:
        """Count rows before they are made. Those that stand in the open once cost no more than they are."""
        if not _some(lanes.trail > 0):
            return
        self.rows += len(run.rows.op) * lanes.count
        self.setup_rows += run.setups * lanes.count
        limit = self.machine.expansion_max_statements
        if self.rows > limit:
            self.stop(rules.TOO_MANY, line, lanes.trail, what="statements", limit=limit, key="max_statements")
        if self.setup_rows > MAX_SETUPS:
            at = int(np.flatnonzero(run.rows.op == RowOp.SETUP)[0])
            self.stop(rules.TOO_MANY_SETUPS, int(run.rows.line[at]), lanes.trail, limit=MAX_SETUPS)

    def spread(
        self,
        run: Run,
        systems: tuple[int, ...],
        numbers: Sequence[Any],
        count: int,
        trail: Any,
        frame: Any,
        *,
        keep_place: bool = False,
    ) -> _Piece:
        """The rows of a run in `count` lanes. `keep_place`: the lane tells the row's place in the run, too."""
        base, rows = run.rows, len(run.rows.op)

        def tiled(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return values if count == 1 else np.tile(values, count)

        op, line, system = tiled(base.op), tiled(base.line), tiled(base.system)
        columns = {k: tiled(v) for k, v in base.columns.items()}
        dropped: list[Ints] = []
        slots = zip(numbers, systems, strict=True)
        for one in run.computed:
            at = (np.arange(count)[:, None] * rows + one.at).ravel()
            found = {}
            for slot in one.slots:
                value, written = next(slots)
                if isinstance(value, np.ndarray) and value.ndim == 1 and len(one.at) == 1:
                    value = value[:, None]
                full = np.broadcast_to(value, (count, len(one.at))).ravel() + 0.0
                found[slot.word] = (full, written)
                dropped.append(at[np.isnan(full)])
                if base.op[one.at[0]] != RowOp.SETUP or slot.word == "CHANNEL":
                    columns[slot.column] = _with(columns.get(slot.column), len(op), at, full)
                    system = system if not written else _added(system, at, written << (2 * slot.column))
            if base.op[one.at[0]] == RowOp.SETUP:
                columns[Field.VALUE] = _with(columns[Field.VALUE], len(op), at, self.filled_in(one.statement, found))
        for column, numbers_ in ((Field.TRAIL, trail), (Field.FRAME, frame)):
            if isinstance(numbers_, np.ndarray):
                columns[column] = np.repeat(numbers_, rows).astype(np.float64)
            elif numbers_:
                columns[column] = np.broadcast_to(np.float64(numbers_), len(op))
        lane = np.arange(len(op)) if keep_place else np.repeat(np.arange(count), rows)
        made = Rows(op=op, line=line, system=system, columns=columns)
        gone = np.concatenate(dropped) if dropped else np.empty(0, dtype=np.int64)
        if not len(gone):
            return _Piece(made, lane)
        kept = np.ones(len(op), dtype=np.bool_)
        kept[gone] = False
        return _Piece(made.pick(kept), lane[kept])

    def filled_in(self, statement: Statement, found: dict[str, tuple[Floats, int]]) -> Floats:
        """A setup statement with each set of numbers that its expressions came to; the numbers of the new ones."""
        first = len(self.setups)
        count = len(next(iter(found.values()))[0])
        for i in range(count):
            self.setups.append(_filled_in(statement, {word: (float(v[i]), s) for word, (v, s) in found.items()}))
        return first + np.arange(count, dtype=np.float64)

    def collected(self, sink: _Sink, count: int) -> _Piece:
        """All that lanes have carried out, ordered by lane, in each lane in its order."""
        if count > 1:
            return _merged([piece for piece in sink if isinstance(piece, _Piece)])
        pieces: list[_Piece] = []
        notes: list[_Noted] = []
        for entry in sink:
            if isinstance(entry, _Noted):
                notes.append(entry)
            else:
                pieces += [*self.written_out(notes), entry]
                notes = []
        pieces += self.written_out(notes)
        joined = join([piece.rows for piece in pieces])
        return _Piece(joined, np.zeros(len(joined.op), dtype=np.int64))

    def written_out(self, notes: list[_Noted]) -> list[_Piece]:
        """The rows of runs that were carried out one by one."""
        if not notes:
            return []
        groups: dict[tuple[int, tuple[int, ...]], list[int]] = {}
        for place, note in enumerate(notes):
            groups.setdefault((id(note.run), note.systems), []).append(place)
        pieces = []
        for places in groups.values():
            which = [notes[i] for i in places]
            count = len(which)
            first = which[0]
            numbers: list[Any] = list(first.numbers)
            trail, frame = first.trail, first.frame
            if count > 1:
                numbers = [
                    np.array([note.numbers[k] for note in which]).reshape(count, -1) for k in range(len(numbers))
                ]
                trail = np.array([note.trail for note in which])
                frame = np.array([note.frame for note in which])
            piece = self.spread(first.run, first.systems, numbers, count, trail, frame)
            pieces.append(_Piece(piece.rows, np.array(places)[piece.lane]))
        return [_merged(pieces)]


def _merged(pieces: list[_Piece]) -> _Piece:
    """Pieces in the order of their lanes; in one lane, in the order of the pieces."""
    if len(pieces) == 1:
        return pieces[0]
    rows = join([piece.rows for piece in pieces])
    lane = np.concatenate([piece.lane for piece in pieces]) if pieces else np.empty(0, dtype=np.int64)
    order = np.argsort(lane, kind="stable")
    return _Piece(rows.pick(order), lane[order])


def _with(column: Floats | None, rows: int, at: Ints, values: Floats) -> Floats:
    """A column with other values in some rows; the column itself is shared and stays as it is."""
    fresh = np.full(rows, np.nan) if column is None else column.copy()
    fresh[at] = values
    return fresh


def _added(system: npt.NDArray[np.int32], at: Ints, bits: int) -> npt.NDArray[np.int32]:
    fresh = system.copy()
    fresh[at] |= bits
    return fresh


def _kind_words(kind: Type) -> str:
    """A kind for messages; a length or speed says whether it is in mm or in pulses."""
    if kind[0] == TRUTH:
        return "a comparison"
    of = {System.MM: " in mm", System.PULSE: " in pulses"} if kind[0] <= Kind.ACCELERATION else {}
    return Kind(kind[0]).words + of.get(System(kind[1]), "") if of else Kind(kind[0]).words


def _filled_in(statement: Statement, values: dict[str, tuple[float, int]]) -> Statement:
    """A setup statement with the numbers (and their systems) that its expressions came to."""

    def fill(quantity: Any, word: str) -> Any:
        if word not in values:
            return quantity
        value, system = values[word]
        return replace(quantity, value=value, system=system, expression=None)

    return replace(
        statement,
        words={name: fill(q, name or "value") for name, q in statement.words.items()},
        axes={
            head: {axis: fill(q, f"{head} {axis}") for axis, q in places.items()}
            for head, places in statement.axes.items()
        },
        channel=fill(statement.channel, "CHANNEL"),
    )
