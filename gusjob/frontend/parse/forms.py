"""The forms of the statements as a table: which words each takes, of which kind, and which of them it needs."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

from msgspec import Struct, field

from gusjob.i18n.phrases import Phrase, both_of
from gusjob.kinematics.units import QuantityKind


class Column(IntEnum):
    """Column of a word's number in the rows of a job text."""

    X = 0
    Y = 1
    I = 2  # noqa: E741  (the vendor's and G-code's name)
    J = 3
    R = 4
    VEL = 5
    ACC = 6
    END = 7
    VALUE = 8
    LOW = 9
    HIGH = 10
    RATIO = 11
    AT = 12
    CHANNEL = 13
    NODE = 14
    """Index of the row's statement in JobText.nodes: one with expressions, or a control statement (LET, FOR ...)."""
    FRAME = 15
    """The frame around the row, as numbered by the expansion; absent: none."""
    PROVENANCE = 16
    """By which calls and iterations the row came about, a number of ir Provenance; absent: it is outside of all."""
    CONSTANT = 17
    """The first number in the expressions of a row; the others follow."""


class Word(Struct, frozen=True, kw_only=True):
    """The number of a word: its column and kind. `ms`: a time in ms, not us."""

    column: Column
    kind: QuantityKind
    ms: bool = False


class StatementForm(Struct, frozen=True, kw_only=True):
    """The words that a statement takes.

    Attributes:
        name: What messages call it.
        words: By keyword; '' is the positional number.
        needs: Keywords that must be there.
        hints: What to do about a keyword that belongs to another statement.
    """

    name: str
    words: dict[str, Word] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    hints: Mapping[str, str] = field(default_factory=dict)


def _word(column: Column, kind: QuantityKind, *, ms: bool = False) -> Word:
    return Word(column=column, kind=kind, ms=ms)


_XY = {"X": _word(Column.X, QuantityKind.LENGTH), "Y": _word(Column.Y, QuantityKind.LENGTH)}
_SPEED = {"VEL": _word(Column.VEL, QuantityKind.VELOCITY), "ACC": _word(Column.ACC, QuantityKind.ACCELERATION)}
_FORCED = {"END": _word(Column.END, QuantityKind.VELOCITY)}
_LIMITS = {"MIN": _word(Column.LOW, QuantityKind.POWER), "MAX": _word(Column.HIGH, QuantityKind.POWER)}
_CENTRE = {
    "I": _word(Column.I, QuantityKind.LENGTH),
    "J": _word(Column.J, QuantityKind.LENGTH),
    "R": _word(Column.R, QuantityKind.LENGTH),
}
_ARC_ONLY = dict.fromkeys("IJR", Phrase("it belongs to {statement}", statement="ARC"))
_OF_FREQUENCY = Phrase("it belongs to {statement}", statement="LASER MODE FREQUENCY")
_DUTY_LIMITS = {"MIN": _word(Column.LOW, QuantityKind.SHARE), "MAX": _word(Column.HIGH, QuantityKind.SHARE)}
_CARRIER = {"CARRIER": _word(Column.VALUE, QuantityKind.FREQUENCY), **_DUTY_LIMITS}
_WIDTH = {"WIDTH": _word(Column.VALUE, QuantityKind.TIME)}

FORMS: dict[str, StatementForm] = {
    "units": StatementForm(name="UNITS"),
    "coords": StatementForm(name="COORDS"),
    "crd": StatementForm(
        name="CRD", words={"": _word(Column.VALUE, QuantityKind.PLAIN), "FIFO": _word(Column.LOW, QuantityKind.PLAIN)}
    ),
    "channel": StatementForm(name="CHANNEL", words={"": _word(Column.VALUE, QuantityKind.PLAIN)}),
    "VEL": StatementForm(name="VEL", words={"": _word(Column.VALUE, QuantityKind.VELOCITY)}),
    "ACC": StatementForm(name="ACC", words={"": _word(Column.VALUE, QuantityKind.ACCELERATION)}),
    "JUMPVEL": StatementForm(name="JUMPVEL", words={"": _word(Column.VALUE, QuantityKind.VELOCITY)}),
    "JUMPACC": StatementForm(name="JUMPACC", words={"": _word(Column.VALUE, QuantityKind.ACCELERATION)}),
    "line": StatementForm(name="LINE", words={**_XY, **_SPEED, **_FORCED}, hints=_ARC_ONLY),
    "jump": StatementForm(
        name="JUMP",
        words=_XY,
        hints={
            **_ARC_ONLY,
            "VEL": Phrase("write {statement} before it", statement="JUMPVEL"),
            "ACC": Phrase("write {statement} before it", statement="JUMPACC"),
            "END": Phrase("it belongs to {statement}", statement=both_of(("LINE", "ARC"))),
        },
    ),
    "arc": StatementForm(name="ARC", words={**_XY, **_CENTRE, **_SPEED, **_FORCED}),
    "dwell": StatementForm(name="DWELL", words={"": _word(Column.VALUE, QuantityKind.TIME, ms=True)}),
    "wait": StatementForm(name="WAIT"),
    "lookahead": StatementForm(
        name="LOOKAHEAD",
        words={
            "TIME": _word(Column.VALUE, QuantityKind.TIME, ms=True),
            "ACC": _word(Column.ACC, QuantityKind.ACCELERATION),
        },
    ),
    "skywrite": StatementForm(
        name="SKYWRITE",
        words={
            "MODE": _word(Column.VALUE, QuantityKind.PLAIN),
            "TIMELAG": _word(Column.LOW, QuantityKind.TIME),
            "SHIFT": _word(Column.HIGH, QuantityKind.TIME),
            "NPREV": _word(Column.RATIO, QuantityKind.PLAIN),
            "NPOST": _word(Column.AT, QuantityKind.PLAIN),
            "LIMIT": _word(Column.END, QuantityKind.PLAIN),
        },
        needs=("MODE", "TIMELAG"),
    ),
    "DUTY": StatementForm(
        name="LASER MODE DUTY",
        words=_CARRIER,
        needs=("CARRIER",),
        hints={"WIDTH": _OF_FREQUENCY},
    ),
    "DUTY2": StatementForm(
        name="LASER MODE DUTY2",
        words=_CARRIER,
        needs=("CARRIER",),
        hints={"WIDTH": _OF_FREQUENCY},
    ),
    "FREQUENCY": StatementForm(
        name="LASER MODE FREQUENCY",
        words={
            **_WIDTH,
            "MIN": _word(Column.LOW, QuantityKind.FREQUENCY),
            "MAX": _word(Column.HIGH, QuantityKind.FREQUENCY),
        },
        needs=("WIDTH",),
        hints={"CARRIER": Phrase("in frequency mode the power is the frequency; a carrier belongs to LASER MODE DUTY")},
    ),
    "ANALOG": StatementForm(
        name="LASER MODE ANALOG",
        words={"MIN": _word(Column.LOW, QuantityKind.VOLTAGE), "MAX": _word(Column.HIGH, QuantityKind.VOLTAGE)},
        hints={
            "CARRIER": Phrase("it belongs to {statement}", statement=both_of(("LASER MODE DUTY", "DUTY2"))),
            "WIDTH": _OF_FREQUENCY,
        },
    ),
    "laser_delay": StatementForm(
        name="LASER DELAY",
        words={"ON": _word(Column.VALUE, QuantityKind.TIME), "OFF": _word(Column.LOW, QuantityKind.TIME)},
        needs=("ON", "OFF"),
    ),
    "laser_standby": StatementForm(
        name="LASER STANDBY",
        words={"FREQ": _word(Column.VALUE, QuantityKind.FREQUENCY), "DUTY": _word(Column.LOW, QuantityKind.SHARE)},
        needs=("FREQ", "DUTY"),
    ),
    "laser_prevolt": StatementForm(name="LASER PREVOLT", words={"": _word(Column.VALUE, QuantityKind.VOLTAGE)}),
    "laser_fpk": StatementForm(
        name="LASER FPK",
        words={
            "WIDTH": _word(Column.VALUE, QuantityKind.TIME),
            "GAP": _word(Column.LOW, QuantityKind.TIME),
            "OFFDELAY": _word(Column.HIGH, QuantityKind.TIME),
        },
        needs=("WIDTH", "GAP", "OFFDELAY"),
    ),
    "laser_distance": StatementForm(name="LASER DISTANCE", words=_LIMITS, needs=("REF", "RATIO", "MIN", "MAX")),
    "laser_power": StatementForm(name="LASER POWER", words={"": _word(Column.VALUE, QuantityKind.POWER)}),
    "laser_follow": StatementForm(
        name="LASER FOLLOW",
        words={
            "RATIO": _word(Column.RATIO, QuantityKind.PLAIN),
            **_LIMITS,
            "AT": _word(Column.AT, QuantityKind.VELOCITY),
        },
        needs=("MIN", "MAX"),
    ),
    "laser_switch": StatementForm(name="LASER ON"),
    "let": StatementForm(name="LET"),
    "repeat": StatementForm(name="REPEAT"),
    "for": StatementForm(name="FOR"),
    "if": StatementForm(name="IF"),
    "else": StatementForm(name="ELSE"),
    "end": StatementForm(name="END"),
    "def": StatementForm(name="DEF"),
    "call": StatementForm(name="CALL"),
    "include": StatementForm(name="INCLUDE"),
    "frame": StatementForm(
        name="FRAME",
        words={
            **_XY,
            "ROTATE": _word(Column.VALUE, QuantityKind.ANGLE),
            "SCALE": _word(Column.RATIO, QuantityKind.PLAIN),
        },
    ),
}


CHANNEL_WORD = _word(Column.CHANNEL, QuantityKind.PLAIN)
"""CHANNEL n at the end of a LASER statement."""

REF_WORD, RATIO_WORD = _word(Column.X, QuantityKind.LENGTH), _word(Column.X, QuantityKind.PLAIN)
"""An axis after REF and after RATIO of LASER DISTANCE (these numbers have no columns)."""
