"""Rows of job files to a Program: blocks are matched with their ENDs, included files are read."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import FIRST_HERE, INCLUDED, Collector, Diagnostic, Remark, Rule
from gusjob.frontend.expand.let_overrides import LetOverrides
from gusjob.frontend.expand.name_usage import NameUsage
from gusjob.frontend.expand.override_notes import NameSetter, OverrideNotes
from gusjob.frontend.expand.program import (
    MAX_NESTING,
    Block,
    Branch,
    ComputedStatements,
    ExpressionSlot,
    Frame,
    IncludedFile,
    Item,
    Let,
    Loop,
    Program,
    Routine,
    StatementRun,
    unread_run,
)
from gusjob.frontend.includes import find_include
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.intent import ANY_NAME
from gusjob.frontend.parse.job_reader import JobText, more_diagnostics, read_job_text
from gusjob.frontend.parse.statement import BLOCK_WORDS, BROKEN, GUESSED, RowOp, Statement, literals_in
from gusjob.frontend.scan.rows import Rows, groups_of
from gusjob.frontend.source import Source
from gusjob.frontend.source_map import SourceMap
from gusjob.i18n.phrases import Phrase, any_of, did_you_mean, printable
from gusjob.i18n.spelling import nearest
from gusjob.ir.effects import EVERYTHING, FRAME_EFFECTS, UNCLEAR
from gusjob.ir.overrides import NO_OVERRIDES, Overrides
from gusjob.kinematics.arrays import Indices

_FEW_CALLS = 8
"""A run of statements with more CALLs than this expands all of them at once."""


def build_program(
    text: JobText, machine: Machine, overrides: Overrides = NO_OVERRIDES
) -> tuple[Program, list[Diagnostic]]:
    """The program of a job's text, with all the files that it includes. `overrides`: values of its LETs."""
    builder = _ProgramBuilder(machine=machine, top=text.source, overrides=LetOverrides(overrides))
    block, _ = builder.add_file(text, ())
    builder.check_calls()
    usage = NameUsage(builder.routines)
    sequential_loops = usage.sequential_loops(block)
    builder.note_unused(usage.reads)
    lets: dict[str, list[int]] = {}
    for let in builder.lets:
        lets.setdefault(let.name, []).append(let.line)
    program = Program(
        block=block,
        routines=builder.routines,
        setups=builder.setups,
        sequential_loops=sequential_loops,
        sources=builder.sources,
        lets=lets,
        unread_names=frozenset(builder.unread_names),
        override_notes=builder.override_notes(),
    )
    found = builder.overrides.diagnostics(builder.sources, builder.unread_names)
    return program, [*builder.diagnostics, *builder.collector.finish(rules.NOT_LISTED), *found]


class _ProgramBuilder(Struct):
    machine: Machine
    top: Source
    sources: SourceMap = field(default_factory=SourceMap)
    setups: list[Statement] = field(default_factory=list)
    routines: dict[str, Routine] = field(default_factory=dict)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    """Errors of parsing the included files."""
    collector: Collector = field(default_factory=lambda: Collector(""))
    included: dict[Path, tuple[Block, int]] = field(default_factory=dict)
    """Included files: their blocks, and how deep these nest."""
    calls: list[ComputedStatements] = field(default_factory=list)
    lets: list[Let] = field(default_factory=list)
    unread_names: set[str] = field(default_factory=set)
    overrides: LetOverrides = field(default_factory=LetOverrides)
    has_unread_routines: bool = False
    """Whether a DEF, or a line that may be one, can't be parsed: an unknown routine may be that one."""
    has_unread_lines: bool = False
    """Whether some line can't be parsed: it may read any name."""

    def report(
        self, rule: Rule, line: int, word: str = "", /, remarks: tuple[Remark, ...] = (), **fields: object
    ) -> None:
        """Add a diagnostic at a word of a line."""
        if self.collector.remaining(rule):
            self.collector.add(rule, self.sources.locate(line, word), fields, remarks=remarks)
        else:
            self.collector.count_unlisted(rule, 1)

    def override_notes(self) -> OverrideNotes | None:
        """What finds the overrides that a diagnostic depends on; None without overrides."""
        if not self.overrides.applied:
            return None
        setters = (NameSetter(name=let.name, line=let.line, reads=let.expression.names) for let in self.lets)
        return OverrideNotes(
            sources=self.sources,
            overrides=self.overrides.values,
            applied=self.overrides.applied,
            setters=tuple(setters),
            scopes=tuple(self.overrides.scopes),
        )

    def add_file(self, text: JobText, chain: tuple[Path, ...], line: int = 0) -> tuple[Block, int]:
        """The block of a whole file and its depth.

        Args:
            text: The file.
            chain: The files that include it, outermost first.
            line: The line of its INCLUDE.
        """
        base = self.sources.add(text.source, line)
        first_setup = len(self.setups)
        self.setups += text.setups
        self.unread_names |= text.unread_names
        self.has_unread_lines |= bool(text.diagnostics)
        self.has_unread_routines |= bool(text.unclear_lines)
        builder = _FileBuilder(job=self, text=text, base=base, first_setup=first_setup, chain=chain)
        return builder.block(), builder.depth

    def include(self, name: str, source: Source, line: int, chain: tuple[Path, ...]) -> tuple[Block, int]:
        """The block of an included file and its depth; a row that stands for it if it may not or can't be read."""
        found = self.included_block(name, source, line, chain)
        if found is None:
            self.unread_names.add(ANY_NAME)
            self.has_unread_routines = self.has_unread_lines = True
        return found or ((unread_run(line, EVERYTHING),), 0)

    def included_block(self, name: str, source: Source, line: int, chain: tuple[Path, ...]) -> tuple[Block, int] | None:
        """The block of an included file and its depth; None and a diagnostic if it may not or can't be read."""
        limit = self.machine.expansion_max_includes
        if len(chain) >= limit:
            self.report(rules.EXPANSION_TOO_DEEP, line, limit=limit, key="max_includes")
            return None
        include = find_include(name, source, self.top)
        path, found = include.path, include.source
        if path is not None:
            self.sources.included_paths.append(path)
        if path is None or found is None:
            self.report(rules.BAD_INCLUDE, line, file=printable(name), reason=include.reason)
            return None
        if path in chain or (self.top.path is not None and path == self.top.path.resolve()):
            self.report(rules.BAD_INCLUDE, line, file=printable(name), reason=Phrase("it includes itself"))
            return None
        if path not in self.included:
            text = read_job_text(found)
            here = (Remark(text=INCLUDED, span=self.sources.locate(line, "")),)
            for diagnostic in text.diagnostics:
                span = replace(diagnostic.span, path=found.name)
                self.diagnostics.append(replace(diagnostic, span=span, remarks=(*diagnostic.remarks, *here)))
            if text.diagnostics_not_listed:
                self.diagnostics.append(more_diagnostics(text))
            self.included[path] = self.add_file(text, (*chain, path), line)
        return self.included[path]

    def note_unused(self, reads: set[str]) -> None:
        """Note the names that the job itself sets and nothing reads, and the routines that nothing calls."""
        if self.has_unread_lines:
            return
        own_lines = self.top.count_lines()
        called = {call.statement.names[0] for call in self.calls}
        for routine in self.routines.values():
            if routine.name not in called and routine.line <= own_lines:
                self.report(rules.UNUSED_ROUTINE, routine.line, name=routine.name)
        seen: set[str] = set()
        for let in self.lets:
            if let.name not in reads and let.name not in seen and let.line <= own_lines:
                seen.add(let.name)
                self.report(rules.UNUSED_NAME, let.line, name=let.name)

    def check_calls(self) -> None:
        """Check that every CALL names a routine that exists, with as many values as it takes."""
        for call in self.calls:
            name, given = call.statement.names[0], len(call.statement.arguments)
            routine = self.routines.get(name)
            if routine is None and self.has_unread_routines:
                continue  # It may be the one whose DEF can't be parsed.
            if routine is None:
                hint = did_you_mean(nearest(name, self.routines))
                self.report(rules.UNKNOWN_ROUTINE, call.line, name=name, hint=hint)
            elif given != len(routine.parameters):
                count, takes = len(routine.parameters), f"({', '.join(routine.parameters)})"
                self.report(rules.ROUTINE_VALUES, call.line, name=name, wanted=count, takes=takes, found=given)


class _OpenBlock(Struct):
    """A block that has begun and not yet ended."""

    form: str
    row: int
    items: list[Item] = field(default_factory=list)
    otherwise: list[Item] | None = None

    @property
    def target(self) -> list[Item]:
        """The list that takes the next item."""
        return self.items if self.otherwise is None else self.otherwise


class _FileBuilder(Struct, kw_only=True):
    job: _ProgramBuilder
    text: JobText
    base: int
    """Offset of the file's line numbers."""
    first_setup: int
    """Offset of the file's setup statements."""
    chain: tuple[Path, ...]
    depth: int = 0
    """Depth of nested blocks."""

    def block(self) -> Block:
        """All items of the file; DEFs go to the job's routines."""
        rows = self._numbered_rows()
        op = rows.op
        stack = [_OpenBlock(form="", row=-1)]
        first = 0
        for at in np.flatnonzero((op == RowOp.FRAME) | (op == RowOp.CONTROL)).tolist():
            stack[-1].target.extend(self._runs(rows, first, at))
            first = at + 1
            self._add_control(rows, at, None if op[at] == RowOp.FRAME else self._node(rows, at), stack)
        stack[-1].target.extend(self._runs(rows, first, len(op)))
        while len(stack) > 1:  # What is inside still counts: it may switch the laser off.
            open_ = stack[-1]
            line = int(rows.line[open_.row])
            # The END may be a line whose statement is not known.
            if self.text.unclear_lines.stop <= line and not self._is_guessed(rows, open_):
                word = self._node(rows, open_.row).name if open_.form == BROKEN else open_.form.upper()
                self.job.report(rules.MISSING_END, line, word=word)
            self._close_block(rows, stack, int(rows.line[-1]) + 1)
        return tuple(stack[0].items)

    def _is_guessed(self, rows: Rows, block: _OpenBlock) -> bool:
        """Whether a block's first word is misspelt: it may not begin one."""
        return block.form == BROKEN and GUESSED in self._node(rows, block.row).options

    def _report_unmatched(self, line: int, word: str, begins: str) -> None:
        """Report an END or ELSE without a block, unless a line whose statement is not known may begin it."""
        if not 0 < self.text.unclear_lines.start < line - self.base:
            self.job.report(rules.UNMATCHED_END, line, word=word, begins=begins)

    def _node(self, rows: Rows, at: int) -> Statement:
        """The statement of a row that is a node."""
        return self.text.nodes[int(rows.column(Column.NODE)[at])]

    def _numbered_rows(self) -> Rows:
        """The rows with line numbers and setup indices of the whole job."""
        rows = self.text.rows
        line = rows.line + np.int32(self.base) if self.base else rows.line
        columns = rows.columns
        if self.first_setup and (rows.op == RowOp.SETUP).any():
            value = rows.column(Column.VALUE)
            columns = {**columns, Column.VALUE: np.where(rows.op == RowOp.SETUP, value + self.first_setup, value)}
        return Rows(op=rows.op, line=line, system=rows.system, columns=columns)

    def _add_control(self, rows: Rows, at: int, statement: Statement | None, stack: list[_OpenBlock]) -> None:
        """Add the item of a control statement, or begin or end a block. `statement`: None for FRAME."""
        line = int(rows.line[at])
        form = "frame" if statement is None else statement.form
        match form:
            case "let":
                assert statement is not None
                own = statement
                statement = self.job.overrides.at_let(
                    own, line, is_own=not self.chain, is_local=any(map(self._is_routine, stack[1:]))
                )
                constants = self._constants(rows, at, own) if statement is own else _literal_values(statement)
                let = Let(name=statement.names[0], expression=statement.arguments[0], constants=constants, line=line)
                self.job.lets.append(let)
                stack[-1].target.append(let)
            case "include":
                assert statement is not None
                block, depth = self.job.include(statement.text, self.text.source, line, self.chain)
                if len(stack) + depth > MAX_NESTING:
                    self.job.report(rules.BLOCKS_TOO_DEEP, line, limit=MAX_NESTING)
                    return
                self.depth = max(self.depth, len(stack) + depth)
                stack[-1].target.append(IncludedFile(body=block, line=line))
            case "else":
                if stack[-1].form == BROKEN and self._node(rows, stack[-1].row).name == "IF":
                    stack[-1].target.append(unread_run(line, UNCLEAR))
                    return
                if stack[-1].form != "if" or stack[-1].otherwise is not None:
                    self._report_unmatched(line, "ELSE", "IF")
                else:
                    stack[-1].otherwise = []
            case "end":
                if len(stack) == 1:
                    self._report_unmatched(line, "END", any_of(BLOCK_WORDS))
                else:
                    self._close_block(rows, stack, line)
            case _:
                if form == "def" and len(stack) > 1:
                    self.job.report(rules.NESTED_DEF, line)
                if len(stack) == MAX_NESTING + 1:
                    self.job.report(rules.BLOCKS_TOO_DEEP, line, limit=MAX_NESTING)
                self.depth = max(self.depth, len(stack))
                stack.append(_OpenBlock(form=form, row=at))

    def _is_routine(self, block: _OpenBlock) -> bool:
        """Whether a block is a DEF, also one that can't be parsed."""
        return block.form == "def" or (block.form == BROKEN and self._node(self.text.rows, block.row).name == "DEF")

    def _close_block(self, rows: Rows, stack: list[_OpenBlock], end_line: int) -> None:
        """END: the innermost block becomes an item of the one around it."""
        done = stack.pop()
        at, line = done.row, int(rows.line[done.row])
        body, items = tuple(done.items), stack[-1].target
        if len(stack) > MAX_NESTING:
            return
        if done.form == BROKEN:
            self._add_broken(self._node(rows, at).name, body, line, items)
            return
        if done.form == "frame":
            items.append(Frame(head=self._run(rows, at, at + 1), body=body, line=line))
            return
        statement = self._node(rows, at)
        constants = self._constants(rows, at, statement)
        self.job.overrides.add_scope(statement, line, end_line)
        match done.form:
            case "if":
                condition, otherwise = statement.arguments[0], tuple(done.otherwise or ())
                items.append(
                    Branch(condition=condition, constants=constants, then=body, otherwise=otherwise, line=line)
                )
            case "def":
                self._add_routine(statement, body, line)
            case _:
                bounds = statement.arguments
                items.append(Loop(statement=statement, bounds=bounds, constants=constants, body=body, line=line))

    def _add_broken(self, word: str, body: Block, line: int, items: list[Item]) -> None:
        """Add the body of a block whose head can't be parsed, once; what it leaves behind is not known."""
        if word == "DEF":
            self.job.has_unread_routines = True
            return
        before = [unread_run(line, FRAME_EFFECTS)] if word == "FRAME" else []
        items.extend([*before, *body, unread_run(line, UNCLEAR)])

    def _add_routine(self, statement: Statement, body: Block, line: int) -> None:
        name, *parameters = statement.names
        if name in self.job.routines:
            here = self.job.sources.locate(self.job.routines[name].line, "")
            self.job.report(rules.DUPLICATE_DEF, line, remarks=(Remark(text=FIRST_HERE, span=here),), name=name)
        else:
            self.job.routines[name] = Routine(name=name, parameters=tuple(parameters), body=body, line=line)

    def _constants(self, rows: Rows, at: int | Indices, statement: Statement) -> tuple[Any, ...]:
        """The numbers in the expressions of a statement, as its rows have them."""
        own = literals_in(statement)
        columns = [rows.columns.get(Column.CONSTANT + i) for i in range(len(own))]
        found = [np.float64(own[i].value) if column is None else column[at] for i, column in enumerate(columns)]
        # A number that has no column is in the statement alone, which then is one line's.
        return tuple(
            np.float64(number.value) if np.isnan(value).any() else value
            for number, value in zip(own, found, strict=True)
        )

    def _runs(self, rows: Rows, first: int, last: int) -> Iterator[Item]:
        """Rows without control statements as runs: few CALLs are runs of their own, many are part of one run."""
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

    def _run(self, rows: Rows, first: int, last: int) -> StatementRun:
        part = rows.pick(slice(first, last))
        node = part.columns.pop(Column.NODE, None)
        setups = int(np.count_nonzero(part.op == RowOp.SETUP))
        if node is None:
            return StatementRun(rows=part, setups=setups)
        at = np.flatnonzero(~np.isnan(node))
        computed: list[ComputedStatements] = []
        calls: list[ComputedStatements] = []
        for number, members in groups_of(node[at]):
            where = at[members]
            statement = self.text.nodes[int(number)]
            found = ComputedStatements(
                statement=statement,
                slots=tuple(_slots(statement)),
                at=where,
                constants=self._constants(part, where if len(where) > 1 else int(where[0]), statement),
                line=int(part.line[where[0]]),
            )
            (calls if statement.form == "call" else computed).append(found)
        self.job.calls += calls
        # The numbers of expressions are in `computed`; the rows keep their own columns.
        columns = {column: values for column, values in part.columns.items() if column < Column.NODE}
        kept = Rows(op=part.op, line=part.line, system=part.system, columns=columns)
        return StatementRun(rows=kept, computed=tuple(computed), calls=tuple(calls), setups=setups)


def _literal_values(statement: Statement) -> tuple[Any, ...]:
    """The numbers in the expressions of a statement that no row has."""
    return tuple(np.float64(literal.value) for literal in literals_in(statement))


def _slots(statement: Statement) -> Iterator[ExpressionSlot]:
    """The numbers of a statement that expressions give."""
    constants = 0
    for name, word, quantity in statement.numbers():
        if quantity.expression is not None:
            yield ExpressionSlot(
                column=word.column,
                kind=word,
                word=name or "value",
                expression=quantity.expression,
                constants=constants,
            )
            constants += len(quantity.expression.constants)
