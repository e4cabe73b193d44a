"""Job text to rows: each line shape is parsed once, and the numbers of all its lines are read together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.characters import report_hidden, without_consequences
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import (
    BLOCK_WORDS,
    BROKEN,
    GUESSED,
    RowOp,
    Statement,
    literals_in,
    row_numbers,
)
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.frontend.scan.rows import Row, Rows, Template, TemplateBuilder
from gusjob.frontend.scan.scanner import MAX_DIAGNOSTICS, scan
from gusjob.frontend.scan.shapes import ShapeTable
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase
from gusjob.ir.effects import EVERYTHING, OF_LASER

if TYPE_CHECKING:  # Start-up time is part of the tool: a plain job has no line that can't be read.
    from gusjob.frontend.parse.intent import LineIntent

_MAX_CONSTANTS = 16
"""So many numbers in the expressions of a line have columns; further ones are looked up in the statement."""


class JobText(Struct, frozen=True, kw_only=True):
    """A job file as it was parsed.

    Attributes:
        source: The text.
        rows: In file order; they point into `setups` and `nodes`.
        setups: Setup statements.
        nodes: Statements with expressions, and control statements.
        diagnostics: What could not be parsed.
        diagnostics_not_listed: How many further lines were not parsed, since there were too many diagnostics.
        unread_names: Names that lines which can't be parsed may set.
        unclear_lines: Lines whose statement is not known: it may begin or end a block, or define a routine.
        has_lower_case: Whether some keyword is not in upper case.
    """

    source: Source
    rows: Rows
    setups: tuple[Statement, ...]
    nodes: tuple[Statement, ...]
    diagnostics: tuple[Diagnostic, ...]
    diagnostics_not_listed: int
    unread_names: frozenset[str] = frozenset()
    unclear_lines: range = range(0)
    has_lower_case: bool = False

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing to expand: its rows are the job's."""
        return not self.rows.has(Column.NODE) and not (self.rows.op == RowOp.FRAME).any()


def more_diagnostics(text: JobText) -> Diagnostic:
    """The diagnostic that says how many lines of a text are not listed."""
    fields = {"count": text.diagnostics_not_listed, "code": Phrase("the lines"), "shown": len(text.diagnostics)}
    return Diagnostic(rule=rules.NOT_LISTED, span=d.NOWHERE, fields=fields, path=text.source.name)


def read_job_text(source: Source) -> JobText:
    """Parse all statements of a job text; after a diagnostic the rest is still parsed."""
    reader = _JobReader()
    hidden = report_hidden(source.data, source.name)
    rows = scan(source.data, semicolon_comments=True, learn=reader.learn, parse_line=reader.parse_line)
    text = JobText(
        source=source,
        rows=rows,
        setups=tuple(reader.setups),
        nodes=tuple(reader.nodes),
        diagnostics=tuple(without_consequences([*reader.diagnostics, *hidden])),
        diagnostics_not_listed=reader.not_listed,
        unread_names=frozenset(reader.unread_names),
        unclear_lines=reader.unclear_lines,
        has_lower_case=reader.has_lower_case,
    )
    return replace(text, rows=rows.thinned()) if text.is_plain else text


class _JobReader(Struct):
    setups: list[Statement] = field(default_factory=list)
    nodes: list[Statement] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    not_listed: int = 0
    unread_shapes: int = 0
    """How many shapes can't be parsed."""
    unread_names: set[str] = field(default_factory=set)
    unclear_lines: range = range(0)
    has_lower_case: bool = False
    lower_case: ShapeTable[bool] = field(default_factory=lambda: ShapeTable(_has_lower_case_keywords))

    def check_case(self, line: str) -> None:
        """Notice keywords in lower case in a line that was parsed."""
        if not self.has_lower_case and not line.isupper():
            code = strip_comment(line).encode("utf-8", "replace")
            self.has_lower_case = self.lower_case.of_line(code)

    def learn(self, line: str) -> Template | None:
        """The template of a path, modal or control statement; None for all others."""
        if self.unread_shapes >= MAX_DIAGNOSTICS:
            return None  # So many lines have diagnostics that further ones are only counted.
        statement, _ = parse_statement(line, 1)
        if statement is None:
            self.unread_shapes += 1
            return None
        self.check_case(line)
        builder = TemplateBuilder.of_line(line)
        if statement.row_op is RowOp.SETUP or builder is None or statement.text:
            return None  # The digits in a file's name are not numbers: a1.job is not a01.job.
        system = 0
        for column, quantity in row_numbers(statement):
            if quantity.expression is None:
                if not builder.add(column, quantity.column - 1, times=quantity.times, over=quantity.over):
                    return None
                system |= quantity.system << (2 * column)
        for number, literal in enumerate(literals_in(statement)):
            target, start = Column.CONSTANT + number, literal.column - 1
            if number >= _MAX_CONSTANTS or not builder.add(target, start, times=literal.times, over=literal.over):
                return None
        constants: tuple[tuple[int, float], ...] = ()
        if statement.is_node:
            constants = ((Column.NODE, self.add_node(statement)),)
        return builder.build(statement.row_op, system=system, constants=constants)

    def add_unclear(self, line: int) -> None:
        """Note that the statement of a line is not known."""
        self.unclear_lines = range(self.unclear_lines.start or line, line + 1)

    def unread(self, number: int, code: str) -> Sequence[Row]:
        """The row of a line that can't be parsed: what it may change is not known behind it."""
        from gusjob.frontend.parse.intent import intent_of

        intent = intent_of(code)
        self.unread_names |= intent.names
        if not intent.form:
            self.add_unclear(number)
        if (control := _broken(intent)) is not None:
            return (Row(op=control.row_op, values={Column.NODE: self.add_node(control)}),)
        values: dict[int, float] = {Column.VALUE: float(intent.effects)}
        if intent.effects & OF_LASER:
            values[Column.CHANNEL] = float(intent.channel)
        return (Row(op=RowOp.UNREAD, values=values),)

    def add_node(self, statement: Statement) -> float:
        """Add a statement to `nodes`; returns its NODE."""
        self.nodes.append(statement)
        return float(len(self.nodes) - 1)

    def parse_line(self, number: int, text: str) -> Sequence[Row]:
        """Parse one line."""
        if len(self.diagnostics) >= MAX_DIAGNOSTICS:
            self.not_listed += 1
            self.add_unclear(number)
            return _NOT_PARSED
        statement, diagnostics = parse_statement(text, number)
        self.diagnostics += diagnostics
        if statement is None:
            return self.unread(number, strip_comment(text)) if diagnostics else ()
        self.check_case(text)
        op = statement.row_op
        values: dict[int, float] = {Column.NODE: self.add_node(statement)} if statement.is_node else {}
        if op is RowOp.SETUP:
            self.setups.append(statement)
            values[Column.VALUE] = float(len(self.setups) - 1)
            if statement.channel and statement.channel.expression is None:
                values[Column.CHANNEL] = statement.channel.value
            return (Row(op=op, values=values),)
        system = 0
        for column, quantity in row_numbers(statement):
            if quantity.expression is None:
                values[column] = quantity.value
                system |= quantity.system << (2 * column)
        for index, literal in enumerate(literals_in(statement)[:_MAX_CONSTANTS]):
            values[Column.CONSTANT + index] = literal.value
        return (Row(op=op, system=system, values=values),)


_NOT_PARSED = (Row(op=RowOp.UNREAD, values={Column.VALUE: float(EVERYTHING), Column.CHANNEL: -1.0}),)


def _has_lower_case_keywords(code: bytes) -> bool:
    from gusjob.frontend.parse.keyword_case import has_lower_case_keywords

    return not code.isupper() and has_lower_case_keywords(code.decode())


def _broken(intent: LineIntent) -> Statement | None:
    """The statement that stands for one that begins or ends a block and can't be parsed."""
    name = intent.form.upper()
    if name in BLOCK_WORDS:
        return Statement(form=BROKEN, name=name, options=(GUESSED,) if intent.guessed else ())
    return Statement(form=intent.form, name=name) if intent.form in ("else", "end") else None
