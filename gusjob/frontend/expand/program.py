"""A job with all that it includes, as nested blocks of items."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec import Struct

from gusjob.frontend.expand.override_notes import OverrideNotes
from gusjob.frontend.parse.expressions import Expression
from gusjob.frontend.parse.forms import Column, Word
from gusjob.frontend.parse.statement import RowOp, Statement
from gusjob.frontend.scan.rows import Row, Rows, rows_of
from gusjob.frontend.source_map import SourceMap
from gusjob.ir.effects import StateEffect
from gusjob.kinematics.arrays import Indices

MAX_NESTING = 32
"""Blocks within blocks in the text of a file."""


class ExpressionSlot(Struct, frozen=True, kw_only=True):
    """A number of a statement that an expression gives.

    Attributes:
        column: Its destination.
        kind: What kind of number it must be.
        word: What the statement calls it.
        expression: Gives the value.
        constants: Where the expression's own numbers begin among the statement's.
    """

    column: int
    kind: Word
    word: str
    expression: Expression
    constants: int


class ComputedStatements(Struct, frozen=True, kw_only=True, eq=False):
    """Statements of one shape in a run whose numbers are computed when the run is expanded.

    Attributes:
        statement: The first of them.
        slots: The numbers to compute.
        at: Their rows in the run.
        constants: The numbers in their expressions, each one value or one for each row.
        line: Of the first.
    """

    statement: Statement
    slots: tuple[ExpressionSlot, ...]
    at: Indices
    constants: tuple[Any, ...]
    line: int


class StatementRun(Struct, frozen=True, kw_only=True, eq=False):
    """Consecutive statements without control statements: rows of a file.

    Attributes:
        rows: All of them.
        computed: Those with expressions.
        calls: Those that are CALLs.
        setups: How many setup statements there are.
    """

    rows: Rows
    computed: tuple[ComputedStatements, ...] = ()
    calls: tuple[ComputedStatements, ...] = ()
    setups: int = 0

    @property
    def line(self) -> int:
        """Line of the first statement."""
        return int(self.rows.line[0])


def unread_run(line: int, effects: StateEffect) -> StatementRun:
    """A run of one row that stands for what could not be read or run at a line."""
    values: dict[int, float] = {Column.VALUE: float(effects), Column.CHANNEL: -1.0}
    return StatementRun(rows=rows_of([(line, Row(op=RowOp.UNREAD, values=values))]))


class Let(Struct, frozen=True, kw_only=True, eq=False):
    """LET. `constants` as in ComputedStatements."""

    name: str
    expression: Expression
    constants: tuple[Any, ...]
    line: int


class Loop(Struct, frozen=True, kw_only=True, eq=False):
    """REPEAT (start 0, step 1) and FOR. `bounds`: [count], or [from, to] or [from, to, step]."""

    statement: Statement
    bounds: tuple[Expression, ...]
    constants: tuple[Any, ...]
    body: Block
    line: int

    @property
    def step_kind(self) -> str:
        """Kind of its provenance steps: 'round', or 'nth' where an iteration has no name."""
        return "round" if self.variable else "nth"

    @property
    def variable(self) -> str:
        """The loop's variable; '' for REPEAT without AS."""
        return self.statement.names[0] if self.statement.names else ""


class Branch(Struct, frozen=True, kw_only=True, eq=False):
    """IF."""

    condition: Expression
    constants: tuple[Any, ...]
    then: Block
    otherwise: Block
    line: int


class Frame(Struct, frozen=True, kw_only=True, eq=False):
    """FRAME: `head` is its own row."""

    head: StatementRun
    body: Block
    line: int


class IncludedFile(Struct, frozen=True, kw_only=True, eq=False):
    """INCLUDE."""

    body: Block
    line: int


Item = StatementRun | Let | Loop | Branch | Frame | IncludedFile
Block = tuple[Item, ...]


class Routine(Struct, frozen=True, kw_only=True):
    """DEF."""

    name: str
    parameters: tuple[str, ...]
    body: Block
    line: int


class Program(Struct, frozen=True, kw_only=True):
    """A job with all that it includes.

    Attributes:
        block: The items of the job.
        routines: By name.
        setups: Statements that SETUP rows point to.
        sequential_loops: `id`s of the loops that run iteration by iteration (see NameUsage).
        sources: The texts.
        lets: Lines that set each name.
        unread_names: Names that lines which can't be read may set; ANY_NAME among them: any name.
        override_notes: Finds the overrides that a diagnostic depends on; None without overrides.
    """

    block: Block
    routines: dict[str, Routine]
    setups: list[Statement]
    sequential_loops: frozenset[int]
    sources: SourceMap
    lets: dict[str, list[int]]
    unread_names: frozenset[str] = frozenset()
    override_notes: OverrideNotes | None = None


def split_constants(constants: Sequence[Any], expressions: Sequence[Expression]) -> list[Sequence[Any]]:
    """Divide the constants of a statement among its expressions."""
    parts, first = [], 0
    for expression in expressions:
        parts.append(constants[first : first + len(expression.constants)])
        first += len(expression.constants)
    return parts
