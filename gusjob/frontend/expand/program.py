"""Rows of job files to a program: runs of plain statements, loops, branches, routines, frames, included files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import FIRST_HERE, INCLUDED, Collector, Diagnostic, Remark, Rule
from gusjob.frontend.files import SourceMap, included
from gusjob.frontend.parse.expressions import Expression
from gusjob.frontend.parse.forms import CHANNEL_WORD, FORMS, RATIO_WORD, REF_WORD, Field, Word
from gusjob.frontend.parse.job_reader import (
    BLOCK_WORDS,
    BROKEN,
    JobText,
    RowOp,
    literals,
    more_diagnostics,
    read_job_text,
)
from gusjob.frontend.parse.lines import nearest
from gusjob.frontend.parse.statements import Statement
from gusjob.frontend.scan.shapes import Rows
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase, any_of, did_you_mean, printable
from gusjob.kinematics.arrays import Indices

MAX_NESTING = 32
"""Blocks within blocks in the text of a file."""
_FEW_CALLS = 8
"""A run of statements with more CALLs than this carries them all out at once."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """A number of a statement that an expression gives: the column it goes to, and what kind it must be.

    `word` is how the statement calls it; `constants` where the expression's own numbers begin among the statement's.
    """

    column: int
    kind: Word
    word: str
    expression: Expression
    constants: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Computed:
    """Statements of one form in a run whose numbers are found when the run is carried out.

    `at`: their rows in the run; `constants`: the numbers in their expressions, one or as many as there are rows;
    `line` of the first.
    """

    statement: Statement
    slots: tuple[Slot, ...]
    at: Indices
    constants: tuple[Any, ...]
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Run:
    """Statements one behind the other: rows of a file, what of them is computed, how many are setup statements."""

    rows: Rows
    computed: tuple[Computed, ...] = ()
    calls: tuple[Computed, ...] = ()
    setups: int = 0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Let:
    """LET. `constants` as in Computed."""

    name: str
    expression: Expression
    constants: tuple[Any, ...]
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Loop:
    """REPEAT (start 0, step 1) and FOR. `bounds`: [count], or [from, to] or [from, to, step]."""

    statement: Statement
    bounds: tuple[Expression, ...]
    constants: tuple[Any, ...]
    body: Block
    line: int

    @property
    def kind(self) -> str:
        """Of its rounds: 'round', or 'nth' where they have no name."""
        return "round" if self.variable else "nth"

    @property
    def variable(self) -> str:
        """The loop's variable; '' for REPEAT without AS."""
        return self.statement.names[0] if self.statement.names else ""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Branch:
    """IF."""

    condition: Expression
    constants: tuple[Any, ...]
    then: Block
    otherwise: Block
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """FRAME: `head` is its own row."""

    head: Run
    body: Block
    line: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Included:
    """INCLUDE."""

    body: Block
    line: int


Item = Run | Let | Loop | Branch | Frame | Included
Block = tuple[Item, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Routine:
    """DEF."""

    name: str
    parameters: tuple[str, ...]
    body: Block
    line: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """A job with all that it includes.

    `setups`: statements that SETUP rows point to; `carried`: see `Analysis`; `lets`: lines that set each name.
    """

    block: Block
    routines: dict[str, Routine]
    setups: list[Statement]
    carried: frozenset[int]
    sources: SourceMap
    lets: dict[str, list[int]]
    unread_names: frozenset[str] = frozenset()


@dataclass(slots=True)
class _Open:
    """A block that is being read."""

    form: str
    row: int
    items: list[Item] = field(default_factory=list)
    otherwise: list[Item] | None = None

    @property
    def inner(self) -> list[Item]:
        """Where the next item goes."""
        return self.items if self.otherwise is None else self.otherwise


def read_program(text: JobText, machine: Machine) -> tuple[Program, list[Diagnostic]]:
    """The program of a job's text, with all the files that it includes."""
    builder = _Builder(machine=machine, top=text.source)
    block, _ = builder.file(text, ())
    builder.check_calls()
    analysis = Analysis(builder.routines)
    carried = analysis.carried(block)
    builder.unused(analysis.reads)
    lets: dict[str, list[int]] = {}
    for let in builder.lets:
        lets.setdefault(let.name, []).append(let.line)
    program = Program(
        block=block,
        routines=builder.routines,
        setups=builder.setups,
        carried=carried,
        sources=builder.sources,
        lets=lets,
        unread_names=frozenset(builder.unread_names),
    )
    return program, [*builder.diagnostics, *builder.collector.done(rules.MORE)]


@dataclass(slots=True)
class _Builder:
    machine: Machine
    top: Source
    sources: SourceMap = field(default_factory=SourceMap)
    setups: list[Statement] = field(default_factory=list)
    routines: dict[str, Routine] = field(default_factory=dict)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    """What could not be read in the included files."""
    collector: Collector = field(default_factory=lambda: Collector(""))
    read: dict[Path, tuple[Block, int]] = field(default_factory=dict)
    """Included files: their blocks, and how deep blocks stand inside each other in them."""
    calls: list[Computed] = field(default_factory=list)
    lets: list[Let] = field(default_factory=list)
    unread_names: set[str] = field(default_factory=set)
    unread_routines: bool = False
    """Whether a DEF can't be read: a routine that is not known may be that one."""

    def diagnostic(
        self, rule: Rule, line: int, word: str = "", /, remarks: tuple[Remark, ...] = (), **fields: object
    ) -> None:
        if self.collector.room(rule):
            self.collector.add(rule, self.sources.locate(line, word), fields, remarks=remarks)
        else:
            self.collector.uncounted(rule, 1)

    def file(self, text: JobText, chain: tuple[Path, ...]) -> tuple[Block, int]:
        """The block of a whole file and its height; `chain`: the files that include it, from the job down."""
        base = self.sources.add(text.source)
        first_setup = len(self.setups)
        self.setups += text.setups
        self.unread_names |= text.unread_names
        builder = _FileBuilder(self, text, base, first_setup, chain)
        return builder.block(), builder.height

    def include(self, name: str, source: Source, line: int, chain: tuple[Path, ...]) -> tuple[Block, int]:
        """The block of an included file and its height; nothing, and a diagnostic, if it must not or can't be read."""
        limit = self.machine.expansion_max_includes
        if len(chain) >= limit:
            self.diagnostic(rules.TOO_DEEP, line, limit=limit, key="max_includes")
            return (), 0
        found, reason = included(name, source, self.top)
        if found is None:
            self.diagnostic(rules.INCLUDE, line, file=printable(name), reason=reason)
            return (), 0
        path = found.path
        assert path is not None
        if path in chain or (self.top.path is not None and path == self.top.path.resolve()):
            self.diagnostic(rules.INCLUDE, line, file=printable(name), reason=Phrase("it includes itself"))
            return (), 0
        if path not in self.read:
            text = read_job_text(found)
            here = (Remark(text=INCLUDED, span=self.sources.locate(line, "")),)
            for diagnostic in text.diagnostics:
                span = replace(diagnostic.span, path=found.name)
                self.diagnostics.append(replace(diagnostic, span=span, remarks=(*diagnostic.remarks, *here)))
            if text.diagnostics_not_listed:
                self.diagnostics.append(more_diagnostics(text))
            self.read[path] = self.file(text, (*chain, path))
        return self.read[path]

    def unused(self, reads: set[str]) -> None:
        """Notes on names that the job itself sets and nothing reads, and on routines that nothing calls."""
        own = self.top.count_lines()
        called = {call.statement.names[0] for call in self.calls}
        for routine in self.routines.values():
            if routine.name not in called and routine.line <= own:
                self.diagnostic(rules.NEVER_CALLED, routine.line, name=routine.name)
        seen: set[str] = set()
        for let in self.lets:
            if let.name not in reads and let.name not in seen and let.line <= own:
                seen.add(let.name)
                self.diagnostic(rules.NEVER_READ, let.line, name=let.name)

    def check_calls(self) -> None:
        """Every CALL names a routine that there is, with as many values as it takes."""
        for call in self.calls:
            name, given = call.statement.names[0], len(call.statement.arguments)
            routine = self.routines.get(name)
            if routine is None and self.unread_routines:
                continue  # It may be the one whose DEF can't be read.
            if routine is None:
                hint = did_you_mean(nearest(name, self.routines))
                self.diagnostic(rules.NO_ROUTINE, call.line, name=name, hint=hint)
            elif given != len(routine.parameters):
                takes = ", ".join(routine.parameters)
                self.diagnostic(
                    rules.CALL_VALUES,
                    call.line,
                    name=name,
                    wanted=len(routine.parameters),
                    takes=f"({takes})",
                    found=given,
                )


@dataclass(slots=True)
class _FileBuilder:
    job: _Builder
    text: JobText
    base: int
    first_setup: int
    chain: tuple[Path, ...]
    height: int = 0
    """How deep blocks stand inside each other."""

    def block(self) -> Block:
        """All items of the file; DEFs go to the job's routines."""
        rows = self._numbered()
        op = rows.op
        node = rows.column(Field.NODE)
        stack = [_Open(form="", row=-1)]
        first = 0
        steering = np.flatnonzero((op == RowOp.FRAME) | (op == RowOp.CONTROL))
        for at in steering.tolist():
            stack[-1].inner.extend(self._straight(rows, first, at))
            first = at + 1
            statement = None if op[at] == RowOp.FRAME else self.text.nodes[int(node[at])]
            self._steer(rows, at, statement, stack)
        stack[-1].inner.extend(self._straight(rows, first, len(op)))
        while len(stack) > 1:  # What is inside still counts: it may switch the light off.
            left = stack[-1]
            word = self.text.nodes[int(node[left.row])].name if left.form == BROKEN else left.form.upper()
            self.job.diagnostic(rules.UNCLOSED, int(rows.line[left.row]), word=word)
            self._close(rows, stack)
        return tuple(stack[0].items)

    def _numbered(self) -> Rows:
        """The rows with line numbers and setup indices of the whole job."""
        rows = self.text.rows
        line = rows.line + np.int32(self.base) if self.base else rows.line
        columns = rows.columns
        if self.first_setup and (rows.op == RowOp.SETUP).any():
            value = rows.column(Field.VALUE)
            columns = {**columns, Field.VALUE: np.where(rows.op == RowOp.SETUP, value + self.first_setup, value)}
        return Rows(op=rows.op, line=line, system=rows.system, columns=columns)

    def _steer(self, rows: Rows, at: int, statement: Statement | None, stack: list[_Open]) -> None:
        """One statement that steers: it adds an item, or begins or ends a block."""
        line = int(rows.line[at])
        form = "frame" if statement is None else statement.form
        match form:
            case "let":
                assert statement is not None
                constants = self._constants(rows, at, statement)
                found = Let(name=statement.names[0], expression=statement.arguments[0], constants=constants, line=line)
                self.job.lets.append(found)
                stack[-1].inner.append(found)
            case "include":
                assert statement is not None
                block, height = self.job.include(statement.text, self.text.source, line, self.chain)
                if len(stack) + height > MAX_NESTING:
                    self.job.diagnostic(rules.NESTED, line, limit=MAX_NESTING)
                    return
                self.height = max(self.height, len(stack) + height)
                stack[-1].inner.append(Included(body=block, line=line))
            case "else":
                if stack[-1].form != "if" or stack[-1].otherwise is not None:
                    self.job.diagnostic(rules.STRAY, line, word="ELSE", begins="IF")
                else:
                    stack[-1].otherwise = []
            case "end":
                if len(stack) == 1:
                    self.job.diagnostic(rules.STRAY, line, word="END", begins=any_of(BLOCK_WORDS))
                else:
                    self._close(rows, stack)
            case _:
                if form == "def" and len(stack) > 1:
                    self.job.diagnostic(rules.DEF_INSIDE, line)
                if len(stack) == MAX_NESTING + 1:
                    self.job.diagnostic(rules.NESTED, line, limit=MAX_NESTING)
                self.height = max(self.height, len(stack))
                stack.append(_Open(form=form, row=at))

    def _close(self, rows: Rows, stack: list[_Open]) -> None:
        """END: the innermost block becomes an item of the one around it."""
        done = stack.pop()
        at, line = done.row, int(rows.line[done.row])
        body, items = tuple(done.items), stack[-1].inner
        if done.form == BROKEN and self.text.nodes[int(rows.column(Field.NODE)[at])].name == "DEF":
            self.job.unread_routines = True
        if len(stack) > MAX_NESTING or done.form == BROKEN:
            return
        if done.form == "frame":
            head = self._run(rows, at, at + 1)
            items.append(Frame(head=head, body=body, line=line))
            return
        statement = self.text.nodes[int(rows.column(Field.NODE)[at])]
        constants = self._constants(rows, at, statement)
        match done.form:
            case "if":
                otherwise = tuple(done.otherwise or ())
                items.append(
                    Branch(
                        condition=statement.arguments[0], constants=constants, then=body, otherwise=otherwise, line=line
                    )
                )
            case "def":
                name, *parameters = statement.names
                if name in self.job.routines:
                    here = self.job.sources.locate(self.job.routines[name].line, "")
                    self.job.diagnostic(rules.DEF_TWICE, line, remarks=(Remark(text=FIRST_HERE, span=here),), name=name)
                else:
                    self.job.routines[name] = Routine(name=name, parameters=tuple(parameters), body=body, line=line)
            case _:
                items.append(
                    Loop(statement=statement, bounds=statement.arguments, constants=constants, body=body, line=line)
                )

    def _constants(self, rows: Rows, at: int | Indices, statement: Statement) -> tuple[Any, ...]:
        """The numbers in the expressions of a statement, as its rows have them."""
        own = literals(statement)
        columns = [rows.columns.get(Field.CONSTANT + i) for i in range(len(own))]
        found = [np.float64(own[i].value) if column is None else column[at] for i, column in enumerate(columns)]
        # A number that has no column stands in the statement alone, which then is one line's.
        return tuple(
            np.float64(number.value) if np.isnan(value).any() else value
            for number, value in zip(own, found, strict=True)
        )

    def _straight(self, rows: Rows, first: int, last: int) -> Iterator[Item]:
        """Rows without a statement that steers."""
        if first == last:
            return
        calls = np.flatnonzero(rows.op[first:last] == RowOp.CALL) + first
        if len(calls) > _FEW_CALLS:
            yield self._run(rows, first, last)
            return
        for call in calls.tolist():
            if call > first:
                yield self._run(rows, first, call)
            yield self._run(rows, call, call + 1)
            first = call + 1
        if first < last:
            yield self._run(rows, first, last)

    def _run(self, rows: Rows, first: int, last: int) -> Run:
        part = rows.pick(slice(first, last))
        node = part.columns.pop(Field.NODE, None)
        setups = int(np.count_nonzero(part.op == RowOp.SETUP))
        if node is None:
            return Run(rows=part, setups=setups)
        at = np.flatnonzero(~np.isnan(node))
        computed, calls = [], []
        order = at[np.argsort(node[at], kind="stable")]
        numbers, begins = np.unique(node[order], return_index=True)
        for number, where in zip(numbers.tolist(), np.split(order, begins[1:])[: len(numbers)], strict=True):
            statement = self.text.nodes[int(number)]
            found = Computed(
                statement=statement,
                slots=tuple(_slots(statement)),
                at=where,
                constants=self._constants(part, where if len(where) > 1 else int(where[0]), statement),
                line=int(part.line[where[0]]),
            )
            if statement.form == "call":
                calls.append(found)
            else:
                computed.append(found)
        self.job.calls += calls
        # Numbers of expressions are known here; what goes on are the rows' own columns.
        columns = {k: v for k, v in part.columns.items() if k < Field.NODE}
        kept = Rows(op=part.op, line=part.line, system=part.system, columns=columns)
        return Run(rows=kept, computed=tuple(computed), calls=tuple(calls), setups=setups)


def _slots(statement: Statement) -> Iterator[Slot]:
    """The numbers of a statement that expressions give, in the order of `literals`."""
    constants = 0
    form = FORMS[statement.form]
    words = [(name, form.words[name], q) for name, q in statement.words.items()]
    words += [("CHANNEL", CHANNEL_WORD, statement.channel)] if statement.channel else []
    for head, places in statement.axes.items():
        kind = REF_WORD if head == "REF" else RATIO_WORD
        words += [(f"{head} {axis}", kind, q) for axis, q in places.items()]
    for name, kind, quantity in words:
        if quantity.expression is not None:
            yield Slot(
                column=kind.field, kind=kind, word=name or "value", expression=quantity.expression, constants=constants
            )
            constants += len(quantity.expression.constants)


@dataclass(slots=True)
class _Use:
    """Names in a block: read before the block sets them; surely set; perhaps set; and how often each is read."""

    exposed: set[str] = field(default_factory=set)
    surely: set[str] = field(default_factory=set)
    perhaps: set[str] = field(default_factory=set)
    reads: Counter[str] = field(default_factory=Counter)

    def read(self, names: Iterator[str] | tuple[str, ...] | set[str]) -> None:
        """Names that are read here."""
        for name in names:
            self.reads[name] += 1
            if name not in self.surely:
                self.exposed.add(name)

    def then(self, other: _Use) -> None:
        """What comes behind."""
        self.exposed |= other.exposed - self.surely
        self.surely |= other.surely
        self.perhaps |= other.perhaps
        self.reads += other.reads


@dataclass(slots=True)
class Analysis:
    """Which loops must go round by round: those where a round reads what another one set.

    All others are carried out at once, with one value of each name for each round.
    """

    routines: dict[str, Routine]
    found: set[int] = field(default_factory=set)
    free: dict[str, set[str]] = field(default_factory=dict)
    files: dict[int, _Use] = field(default_factory=dict)
    """Included blocks by their `id`: a file may be included many times."""
    marked: set[int] = field(default_factory=set)
    reads: set[str] = field(default_factory=set)
    """Names that are read anywhere."""

    def carried(self, block: Block) -> frozenset[int]:
        """`id`s of the loops of a program that go round by round."""
        for name in self.routines:
            self._free(name)
        for scope in (block, *(r.body for r in self.routines.values())):
            reads = self.use(scope).reads
            self.reads |= set(reads)
            self._mark(scope, reads)
        return frozenset(self.found)

    def _free(self, name: str) -> set[str]:
        """Names that a routine, or one that it calls, may read from outside."""
        if name not in self.free:
            self.free[name] = set()
            use = self.use(self.routines[name].body)
            self.free[name] = set(use.reads) - set(self.routines[name].parameters)
        return self.free[name]

    def use(self, block: Block) -> _Use:
        """How a block uses names."""
        total = _Use()
        for item in block:
            total.then(self._item(item))
        return total

    def _item(self, item: Item) -> _Use:
        use = _Use()
        match item:
            case Run():
                for one in (*item.computed, *item.calls):
                    for expression in (*(s.expression for s in one.slots), *one.statement.arguments):
                        use.read(expression.names)
                for call in item.calls:
                    if call.statement.names[0] in self.routines:
                        use.read(self._free(call.statement.names[0]))
            case Let():
                use.read(item.expression.names)
                use.surely.add(item.name)
                use.perhaps.add(item.name)
            case Loop():
                for bound in item.bounds:
                    use.read(bound.names)
                inner = self.use(item.body)
                inner.exposed.discard(item.variable)
                inner.surely.clear()
                use.then(inner)
            case Branch():
                use.read(item.condition.names)
                then, otherwise = self.use(item.then), self.use(item.otherwise)
                both = _Use(
                    exposed=then.exposed | otherwise.exposed,
                    surely=then.surely & otherwise.surely,
                    perhaps=then.perhaps | otherwise.perhaps,
                    reads=then.reads + otherwise.reads,
                )
                use.then(both)
            case Frame():
                for one in item.head.computed:
                    for slot in one.slots:
                        use.read(slot.expression.names)
                use.then(self.use(item.body))
            case Included():
                if id(item.body) not in self.files:
                    self.files[id(item.body)] = self.use(item.body)
                use.then(self.files[id(item.body)])
        return use

    def _mark(self, block: Block, scope_reads: Counter[str]) -> None:
        for item in block:
            match item:
                case Loop():
                    use = self.use(item.body)
                    elsewhere = {name for name in use.perhaps - use.surely if scope_reads[name] > use.reads[name]}
                    if (use.exposed - {item.variable}) & use.perhaps or elsewhere:
                        self.found.add(id(item))
                    self._mark(item.body, scope_reads)
                case Branch():
                    self._mark(item.then, scope_reads)
                    self._mark(item.otherwise, scope_reads)
                case Frame():
                    self._mark(item.body, scope_reads)
                case Included():
                    if id(item.body) not in self.marked:
                        self.marked.add(id(item.body))
                        self._mark(item.body, scope_reads)
                case _:
                    pass
