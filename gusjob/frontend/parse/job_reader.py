"""Job text to rows: each line shape once through the grammar, its numbers all at once."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.expressions import Apply, Expression, Literal
from gusjob.frontend.parse.forms import FORMS, Field
from gusjob.frontend.parse.spelling import may_hold_small_words, small_words
from gusjob.frontend.parse.statements import CONTROLS, Quantity, Statement, read_statement, strip_comment
from gusjob.frontend.scan.shapes import MAX_DIAGNOSTICS, Row, Rows, Slot, Template, number_runs, scan
from gusjob.frontend.source import Source
from gusjob.i18n.phrases import Phrase


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
    FRAME = 21
    """A FRAME begins: its words are the row's."""
    CALL = 22
    CONTROL = 23
    """LET, REPEAT, FOR, IF, ELSE, END, DEF, INCLUDE: its NODE is the index in JobText.nodes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JobText:
    """A job file as read: rows in file order, the statements that they point to, and what could not be read.

    `nodes`: statements with expressions and those that steer; a row's NODE is an index in it.
    """

    source: Source
    rows: Rows
    setups: tuple[Statement, ...]
    nodes: tuple[Statement, ...]
    diagnostics: tuple[Diagnostic, ...]
    diagnostics_not_listed: int
    unread_names: frozenset[str] = frozenset()
    """Names whose LET can't be read."""
    small_words: bool = False
    """Whether some word of the language stands in small letters."""


def plain(text: JobText) -> bool:
    """Whether a text has nothing to carry out: its rows are the job's."""
    return Field.NODE not in text.rows.columns and not (text.rows.op == RowOp.FRAME).any()


def more_diagnostics(text: JobText) -> Diagnostic:
    """How many lines of a text are not listed."""
    fields = {"count": text.diagnostics_not_listed, "code": Phrase("the lines"), "shown": len(text.diagnostics)}
    return Diagnostic(rule=rules.MORE, span=d.NOWHERE, fields=fields, path=text.source.name)


def read_job_text(source: Source) -> JobText:
    """All statements of a job text; after a diagnostic the rest is still read."""
    reader = _JobReader(data=source.data)
    rows = scan(source.data, semicolon_comments=True, learn=reader.learn, read_line=reader.read_line)
    return JobText(
        source=source,
        rows=rows,
        setups=tuple(reader.setups),
        nodes=tuple(reader.nodes),
        diagnostics=tuple(reader.diagnostics),
        diagnostics_not_listed=reader.not_listed,
        unread_names=frozenset(reader.unread_names),
        small_words=reader.small_words,
    )


@dataclass(slots=True)
class _JobReader:
    data: bytes
    leading_zeros: bool | None = None
    """Whether a name or word is followed by digits with a leading zero; None: not yet looked."""
    setups: list[Statement] = field(default_factory=list)
    nodes: list[Statement] = field(default_factory=list)
    diagnostics: list[Diagnostic] = field(default_factory=list)
    not_listed: int = 0
    unread_names: set[str] = field(default_factory=set)
    small_words: bool = False
    looked_at: set[str] = field(default_factory=set)
    """Shapes of lines in which no word stands in small letters."""

    def look_at_letters(self, line: str) -> None:
        """Notice words in small letters in a line that could be read; of each shape one line is looked at."""
        if self.small_words or line.isupper():
            return
        code = strip_comment(line)
        if not may_hold_small_words(code):
            return
        shape = _DIGITS.sub("0", code)
        if shape not in self.looked_at:
            self.small_words = bool(small_words(code))
            self.looked_at.add(shape)

    def learn(self, line: str) -> Template | None:
        """The template of a path, modal or steering statement; None for all others."""
        statement, _ = read_statement(line, 1)
        if statement is not None:
            self.look_at_letters(line)
        op = row_op(statement) if statement else RowOp.SETUP
        runs = number_runs(line.encode()) if line.isascii() else None
        if statement is None or op is RowOp.SETUP or runs is None or statement.text:
            return None  # The digits in a file's name are no numbers: a1.job is not a01.job.
        run_at = {start: i for i, (start, _) in enumerate(runs)}
        slots, system = [], 0
        for column, quantity in quantities(statement):
            if quantity.expression is not None:
                continue
            run = run_at.pop(quantity.column - 1, None)
            if run is None or not quantity.plain:
                return None
            slots.append(Slot(column=column, run=run, times=quantity.times, over=quantity.over))
            system |= quantity.system << (2 * column)
        for number, literal in enumerate(literals(statement)):
            run = run_at.pop(literal.column - 1, None)
            if run is None or not literal.plain or number >= _MAX_CONSTANTS:
                return None
            slots.append(Slot(column=Field.CONSTANT + number, run=run, times=literal.times, over=literal.over))
        constants: tuple[tuple[int, float], ...] = ()
        if is_node(statement):
            if not self.told_apart(_names(statement)):
                return None
            constants = ((Field.NODE, self.node(statement)),)
        fixed = tuple((i, float(line[start : runs[i][1]])) for start, i in run_at.items())
        return Template(op=op, system=system, slots=tuple(slots), constants=constants, fixed=fixed)

    def told_apart(self, names: list[str]) -> bool:
        """Whether shapes tell these names from others: x1 and x01 have one shape, and their digits one value."""
        digits = [run for name in names for run in _DIGITS.findall(name)]
        if not digits:
            return True
        if self.leading_zeros is None:
            self.leading_zeros = _LEADING_ZERO.search(self.data) is not None
        return not self.leading_zeros and max(map(len, digits)) <= _EXACT_DIGITS

    def node(self, statement: Statement) -> float:
        """The NODE of a statement that is carried out."""
        self.nodes.append(statement)
        return float(len(self.nodes) - 1)

    def read_line(self, number: int, text: str) -> Sequence[Row]:
        """One line through the grammar."""
        if len(self.diagnostics) >= MAX_DIAGNOSTICS:
            self.not_listed += 1
            return ()
        statement, diagnostics = read_statement(text, number)
        self.diagnostics += diagnostics
        if statement is None:
            word = text.split(maxsplit=1)[0].upper() if diagnostics and text.strip() else ""
            self.unread_names.update(_LET.findall(text))
            if word not in BLOCK_WORDS:
                return ()
            statement = Statement(form=BROKEN, name=word)
        else:
            self.look_at_letters(text)
        op = row_op(statement)
        values: dict[int, float] = {Field.NODE: self.node(statement)} if is_node(statement) else {}
        if op is RowOp.SETUP:
            self.setups.append(statement)
            values[Field.VALUE] = float(len(self.setups) - 1)
            if statement.channel and statement.channel.expression is None:
                values[Field.CHANNEL] = statement.channel.value
            return (Row(op=op, values=values),)
        system = 0
        for column, quantity in quantities(statement):
            if quantity.expression is None:
                values[column] = quantity.value
                system |= quantity.system << (2 * column)
        for index, literal in enumerate(literals(statement)[:_MAX_CONSTANTS]):
            values[Field.CONSTANT + index] = literal.value
        return (Row(op=op, system=system, values=values),)


BLOCK_WORDS = ("REPEAT", "FOR", "IF", "DEF", "FRAME")
BROKEN = "broken"
"""Form of a line that can't be read but surely begins a block: its END is not another diagnostic."""
_LET = re.compile(r"^\s*LET\s+(\w+)", re.IGNORECASE)
_DIGITS = re.compile(r"[0-9]+")
_LEADING_ZERO = re.compile(rb"[A-Za-z_]0[0-9]")
_EXACT_DIGITS = 15
_MAX_CONSTANTS = 16
"""So many numbers in the expressions of a line are read by column; longer ones are looked up in the statement."""


def is_node(statement: Statement) -> bool:
    """Whether a statement is carried out by itself: it has expressions, or it steers."""
    return (
        statement.has_expressions
        or (statement.form in CONTROLS and statement.form != "frame")
        or (statement.form == BROKEN)
    )


def expressions(statement: Statement) -> list[Expression]:
    """All expressions of a statement: of its words, its channel, its axes, then its arguments."""
    numbers = [q for _, q in quantities(statement)]
    numbers += [q for places in statement.axes.values() for q in places.values()]
    return [*(q.expression for q in numbers if q.expression is not None), *statement.arguments]


def literals(statement: Statement) -> list[Literal]:
    """The numbers in the expressions of a statement, in the order in which rows hold them."""
    return [literal for expression in expressions(statement) for literal in expression.constants]


def _names(statement: Statement) -> list[str]:
    """Every name in a statement, of functions too."""
    code = [step for expression in expressions(statement) for step in expression.code]
    functions = [step.function.name for step in code if isinstance(step, Apply)]
    return [*statement.names, *functions, *(step for step in code if isinstance(step, str))]


def quantities(statement: Statement) -> list[tuple[int, Quantity]]:
    """Each number of a path or modal statement with its column."""
    words = FORMS[statement.form].words if statement.form in FORMS else {}
    found: list[tuple[int, Quantity]] = [(words[name].field, q) for name, q in statement.words.items()]
    return [*found, (Field.CHANNEL, statement.channel)] if statement.channel else found


def row_op(statement: Statement) -> RowOp:
    """What row a statement becomes."""
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
        case ("line" | "jump" | "dwell" | "channel" | "frame" | "call") as form, _:
            return RowOp[form.upper()]
        case ("VEL" | "ACC" | "JUMPVEL" | "JUMPACC") as form, _:
            return RowOp[form]
        case "laser_power", _:
            return RowOp.POWER
        case "laser_follow", _:
            return RowOp.FOLLOW
        case form, _ if form in CONTROLS or form == BROKEN:
            return RowOp.CONTROL
        case _:
            return RowOp.SETUP
