"""A parsed statement as data, the row that it becomes, and where its words are in the source."""

from __future__ import annotations

from collections.abc import Iterator
from enum import IntEnum

from msgspec import Struct, field

from gusjob.diagnostics.model import Span
from gusjob.frontend.parse.expressions import Expression, Literal
from gusjob.frontend.parse.forms import CHANNEL_WORD, FORMS, RATIO_WORD, REF_WORD, Column, Word
from gusjob.kinematics.units import PowerUnit

CONTROL_FORMS = {"let", "repeat", "for", "if", "else", "end", "def", "call", "frame", "include"}
"""Forms that decide which statements are run, and how often."""
BLOCK_WORDS = ("REPEAT", "FOR", "IF", "DEF", "FRAME")
"""First words of statements that begin a block."""
BROKEN = "broken"
"""Form of a line that can't be parsed but begins a block: its END is not another diagnostic."""
GUESSED = "guessed"
"""Option of such a line whose first word is misspelt, so that it may not begin a block after all."""


class RowOp(IntEnum):
    """Kind of a row of a job text."""

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
    UNREAD = 24
    """A line that can't be read, or a statement without a value: its VALUE is its effects, bits of ir.effects."""


class Quantity(Struct, frozen=True, kw_only=True):
    """A number in canonical units of its kind.

    Attributes:
        value: The number; NaN if an expression gives it.
        times: Factor of its unit.
        over: Divisor of its unit.
        system: A units.UnitSystem, or a units.PowerUnit where the kind is POWER.
        column: Where it begins, from 1.
        end_column: The column after it.
        expression: The expression in parentheses that gives the value when the statement is run.
    """

    value: float
    times: float
    over: float
    system: int
    column: int
    end_column: int
    expression: Expression | None = None


class Statement(Struct, frozen=True, kw_only=True):
    """A line that was parsed.

    Attributes:
        form: Key in FORMS.
        name: What messages call the statement.
        options: Keywords that are not words with numbers (CW, OFF, NOW ...).
        words: By keyword; '' is a positional number.
        axes: Numbers of REF and RATIO of LASER DISTANCE, by axis.
        channel: The number of CHANNEL at the end.
        names: Of a control statement: a routine and its parameters, the name of a LET, a loop's variable.
        arguments: Of a control statement: bare expressions in their order.
        text: The file of INCLUDE.
        column: Where the statement begins, from 1.
        end_column: The column after it.
    """

    form: str
    name: str
    options: tuple[str, ...] = ()
    words: dict[str, Quantity] = field(default_factory=dict)
    axes: dict[str, dict[str, Quantity]] = field(default_factory=dict)
    channel: Quantity | None = None
    names: tuple[str, ...] = ()
    arguments: tuple[Expression, ...] = ()
    text: str = ""
    column: int = 1
    end_column: int = 1

    def span(self, line: int, word: str, path: str = "") -> Span:
        """Locate a word ('#0': the first argument); the whole statement if it has no such word."""
        found: Quantity | Expression | None = self.words.get(word) if word else None
        head, _, axis = word.partition(" ")
        if axis:
            found = self.axes.get(head, {}).get(axis)
        if word == "CHANNEL" and self.channel:
            found = self.channel
        elif word == "value":
            found = self.words.get("")
        elif word.startswith("#"):
            found = self.arguments[int(word[1:])] if int(word[1:]) < len(self.arguments) else None
        start, end = (found.column, found.end_column) if found else (self.column, self.end_column)
        return Span(line=line, column=start, end_line=line, end_column=end, path=path)

    def numbers(self) -> Iterator[tuple[str, Word, Quantity]]:
        """Every number with its keyword ('' if positional, 'REF X' for an axis) and its word in the table of forms.

        This is the order in which rows hold the numbers of the expressions.
        """
        words = FORMS[self.form].words if self.form in FORMS else {}
        for name, quantity in self.words.items():
            yield name, words[name], quantity
        if self.channel:
            yield "CHANNEL", CHANNEL_WORD, self.channel
        for head, by_axis in self.axes.items():
            word = REF_WORD if head == "REF" else RATIO_WORD
            for axis, quantity in by_axis.items():
                yield f"{head} {axis}", word, quantity

    @property
    def has_expressions(self) -> bool:
        """Whether an expression gives one of its numbers."""
        return any(quantity.expression is not None for _, _, quantity in self.numbers())

    @property
    def is_node(self) -> bool:
        """Whether the expansion needs the statement itself: it has expressions, or it is a control statement."""
        is_control = self.form in CONTROL_FORMS and self.form != "frame"
        return is_control or self.form == BROKEN or self.has_expressions

    @property
    def row_op(self) -> RowOp:
        """The row that the statement becomes."""
        match self.form, self.options:
            case "arc", options:
                kind = "RADIUS" if "R" in self.words else "CENTRE"
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
            case form, _ if form in CONTROL_FORMS or form == BROKEN:
                return RowOp.CONTROL
            case _:
                return RowOp.SETUP


def row_numbers(statement: Statement) -> list[tuple[Column, Quantity]]:
    """Each number of a path or modal statement with its column."""
    return [(word.column, quantity) for _, word, quantity in statement.numbers()]


def expressions_in(statement: Statement) -> list[Expression]:
    """All expressions of a statement: those of its numbers, then its arguments."""
    return [*(q.expression for _, _, q in statement.numbers() if q.expression is not None), *statement.arguments]


def literals_in(statement: Statement) -> list[Literal]:
    """The numbers in the expressions of a statement, in the order in which rows hold them."""
    return [literal for expression in expressions_in(statement) for literal in expression.constants]


def unit_of(quantity: Quantity | None) -> PowerUnit:
    """The unit in which a power was written."""
    return PowerUnit(quantity.system) if quantity else PowerUnit.NONE
