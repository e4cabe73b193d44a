"""Job text to rows: each line shape once through the grammar, its numbers all at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from gusjob.diagnostics import Diagnostic, Span
from gusjob.job import Locate
from gusjob.syntax.forms import FORMS, Field
from gusjob.syntax.shapes import MAX_FAULTS, Row, Rows, Slot, Template, number_runs, scan
from gusjob.syntax.source import Source
from gusjob.syntax.statements import Quantity, Statement, read_statement


class RowOp(IntEnum):
    """What a row of a job text is."""

    LINE = 0
    JUMP = 1
    ARC_CENTRE_CW = 2
    ARC_CENTRE_CCW = 3
    ARC_RADIUS_CW = 4
    ARC_RADIUS_CCW = 5
    DWELL = 6
    POWER = 7
    FOLLOW = 8
    ON = 9
    OFF = 10
    VEL = 11
    ACC = 12
    JUMPVEL = 13
    JUMPACC = 14
    CHANNEL = 15
    UNITS_MM = 16
    UNITS_PULSE = 17
    COORDS_ABS = 18
    COORDS_REL = 19
    SETUP = 20
    """A setup statement; its VALUE is the index in JobText.setups."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobText:
    """A job as read: rows in file order, the setup statements they point to, and what could not be read."""

    source: Source
    rows: Rows
    setups: tuple[Statement, ...]
    diagnostics: tuple[Diagnostic, ...]
    faults_not_listed: int


def locate_in(source: Source) -> Locate:
    """How to find the span of a word (or '' for the statement) in a line: the line is read again."""

    def locate(line: int, word: str) -> Span:
        statement, _ = read_statement(source.line(line), line)
        return statement.span(line, word) if statement else Span(line=line)

    return locate


def read_job_text(source: Source) -> JobText:
    """All statements of a job text; after a fault the rest is still read."""
    reader = _JobReader()
    rows = scan(source.data, semicolon_comments=True, learn=reader.learn, read_line=reader.read_line)
    return JobText(
        source=source,
        rows=rows,
        setups=tuple(reader.setups),
        diagnostics=tuple(reader.diagnostics),
        faults_not_listed=reader.not_listed,
    )


@dataclass(slots=True)
class _JobReader:
    setups: list[Statement] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    not_listed: int = 0

    def learn(self, line: str) -> Template | None:
        """The template of a path or modal statement; None for all others."""
        statement, _ = read_statement(line, 1)
        op = _row_op(statement) if statement else RowOp.SETUP
        runs = number_runs(line.encode()) if line.isascii() else None
        if statement is None or op is RowOp.SETUP or runs is None:
            return None
        run_at = {start: i for i, (start, _) in enumerate(runs)}
        slots, system = [], 0
        for column, quantity in _quantities(statement):
            run = run_at.pop(quantity.column - 1, None)
            if run is None or not quantity.plain:
                return None
            slots.append(Slot(column=column, run=run, times=quantity.times, over=quantity.over))
            system |= quantity.system << (2 * column)
        fixed = tuple((i, float(line[start : runs[i][1]])) for start, i in run_at.items())
        return Template(op=op, system=system, slots=tuple(slots), fixed=fixed)

    def read_line(self, number: int, text: str) -> Sequence[Row]:
        """One line through the grammar."""
        if len(self.diagnostics) >= MAX_FAULTS:
            self.not_listed += 1
            return ()
        statement, faults = read_statement(text, number)
        self.diagnostics += faults
        if statement is None:
            return ()
        op = _row_op(statement)
        if op is RowOp.SETUP:
            self.setups.append(statement)
            return (Row(op=op, values={Field.VALUE: float(len(self.setups) - 1)} | _channel(statement)),)
        values: dict[int, float] = {}
        system = 0
        for column, quantity in _quantities(statement):
            values[column] = quantity.value
            system |= quantity.system << (2 * column)
        return (Row(op=op, system=system, values=values),)


def _channel(statement: Statement) -> dict[int, float]:
    return {Field.CHANNEL: statement.channel.value} if statement.channel else {}


def _quantities(statement: Statement) -> list[tuple[int, Quantity]]:
    words = FORMS[statement.form].words
    found: list[tuple[int, Quantity]] = [(words[name].field, q) for name, q in statement.words.items()]
    return [*found, (Field.CHANNEL, statement.channel)] if statement.channel else found


def _row_op(statement: Statement) -> RowOp:
    match statement.form, statement.options:
        case "arc", options:
            kind = "RADIUS" if "R" in statement.words else "CENTRE"
            return RowOp[f"ARC_{kind}_{options[0]}"]
        case "laser_power" | "laser_switch", options if "NOW" in options:
            return RowOp.SETUP
        case "laser_switch", options:
            return RowOp[options[0]]
        case ("units" | "coords") as form, options:
            return RowOp[f"{form.upper()}_{options[0]}"]
        case ("line" | "jump" | "dwell" | "channel" | "VEL" | "ACC" | "JUMPVEL" | "JUMPACC") as form, _:
            return RowOp[form.upper()]
        case "laser_power", _:
            return RowOp.POWER
        case "laser_follow", _:
            return RowOp.FOLLOW
        case _:
            return RowOp.SETUP
