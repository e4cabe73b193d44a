"""The statements of the job language as a table: which words each takes, of which kind, and which it needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

from gusjob.i18n.phrases import Phrase, both_of
from gusjob.kinematics.units import QuantityKind


class Field(IntEnum):
    """Column of a word's number in the rows of a job."""

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
    """Which of the statements with expressions, or of those that steer (LET, FOR ...), the row is."""
    FRAME = 15
    """The frame that a row stands in, a number of syntax/expand.py; absent: none."""
    TRAIL = 16
    """By which calls and rounds a row came about, a number of job.Trails; absent: it stands in the open."""
    CONSTANT = 17
    """The first of the numbers in the expressions of a row; the others follow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """What a word's number is. `ms`: its canonical time is ms instead of us."""

    field: Field
    kind: QuantityKind
    ms: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """The words a statement takes and the ones it needs. `name` is how messages call it."""

    name: str
    words: dict[str, Word] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    hints: Mapping[str, str] = field(default_factory=dict)


def _w(column: Field, kind: QuantityKind, *, ms: bool = False) -> Word:
    return Word(field=column, kind=kind, ms=ms)


_XY = {"X": _w(Field.X, QuantityKind.LENGTH), "Y": _w(Field.Y, QuantityKind.LENGTH)}
_SPEED = {"VEL": _w(Field.VEL, QuantityKind.VELOCITY), "ACC": _w(Field.ACC, QuantityKind.ACCELERATION)}
_FORCED = {"END": _w(Field.END, QuantityKind.VELOCITY)}
_LIMITS = {"MIN": _w(Field.LOW, QuantityKind.POWER), "MAX": _w(Field.HIGH, QuantityKind.POWER)}
_CENTRE = {
    "I": _w(Field.I, QuantityKind.LENGTH),
    "J": _w(Field.J, QuantityKind.LENGTH),
    "R": _w(Field.R, QuantityKind.LENGTH),
}
_ARC_ONLY = dict.fromkeys("IJR", Phrase("it belongs to {statement}", statement="ARC"))
_OF_FREQUENCY = Phrase("it belongs to {statement}", statement="LASER MODE FREQUENCY")
_DUTY_LIMITS = {"MIN": _w(Field.LOW, QuantityKind.SHARE), "MAX": _w(Field.HIGH, QuantityKind.SHARE)}
_CARRIER = {"CARRIER": _w(Field.VALUE, QuantityKind.FREQUENCY), **_DUTY_LIMITS}
_WIDTH = {"WIDTH": _w(Field.VALUE, QuantityKind.TIME)}

FORMS: dict[str, Form] = {
    "units": Form(name="UNITS"),
    "coords": Form(name="COORDS"),
    "crd": Form(name="CRD", words={"": _w(Field.VALUE, QuantityKind.PLAIN), "FIFO": _w(Field.LOW, QuantityKind.PLAIN)}),
    "channel": Form(name="CHANNEL", words={"": _w(Field.VALUE, QuantityKind.PLAIN)}),
    "VEL": Form(name="VEL", words={"": _w(Field.VALUE, QuantityKind.VELOCITY)}),
    "ACC": Form(name="ACC", words={"": _w(Field.VALUE, QuantityKind.ACCELERATION)}),
    "JUMPVEL": Form(name="JUMPVEL", words={"": _w(Field.VALUE, QuantityKind.VELOCITY)}),
    "JUMPACC": Form(name="JUMPACC", words={"": _w(Field.VALUE, QuantityKind.ACCELERATION)}),
    "line": Form(name="LINE", words={**_XY, **_SPEED, **_FORCED}, hints=_ARC_ONLY),
    "jump": Form(
        name="JUMP",
        words=_XY,
        hints={
            **_ARC_ONLY,
            "VEL": Phrase("write {statement} before it", statement="JUMPVEL"),
            "ACC": Phrase("write {statement} before it", statement="JUMPACC"),
            "END": Phrase("it belongs to {statement}", statement=both_of(("LINE", "ARC"))),
        },
    ),
    "arc": Form(name="ARC", words={**_XY, **_CENTRE, **_SPEED, **_FORCED}),
    "dwell": Form(name="DWELL", words={"": _w(Field.VALUE, QuantityKind.TIME, ms=True)}),
    "wait": Form(name="WAIT"),
    "lookahead": Form(
        name="LOOKAHEAD",
        words={"TIME": _w(Field.VALUE, QuantityKind.TIME, ms=True), "ACC": _w(Field.ACC, QuantityKind.ACCELERATION)},
    ),
    "skywrite": Form(
        name="SKYWRITE",
        words={
            "MODE": _w(Field.VALUE, QuantityKind.PLAIN),
            "TIMELAG": _w(Field.LOW, QuantityKind.TIME),
            "SHIFT": _w(Field.HIGH, QuantityKind.TIME),
            "NPREV": _w(Field.RATIO, QuantityKind.PLAIN),
            "NPOST": _w(Field.AT, QuantityKind.PLAIN),
            "LIMIT": _w(Field.END, QuantityKind.PLAIN),
        },
        needs=("MODE", "TIMELAG"),
    ),
    "DUTY": Form(
        name="LASER MODE DUTY",
        words=_CARRIER,
        needs=("CARRIER",),
        hints={"WIDTH": _OF_FREQUENCY},
    ),
    "DUTY2": Form(
        name="LASER MODE DUTY2",
        words=_CARRIER,
        needs=("CARRIER",),
        hints={"WIDTH": _OF_FREQUENCY},
    ),
    "FREQUENCY": Form(
        name="LASER MODE FREQUENCY",
        words={**_WIDTH, "MIN": _w(Field.LOW, QuantityKind.FREQUENCY), "MAX": _w(Field.HIGH, QuantityKind.FREQUENCY)},
        needs=("WIDTH",),
        hints={"CARRIER": Phrase("in frequency mode the power is the frequency; a carrier belongs to LASER MODE DUTY")},
    ),
    "ANALOG": Form(
        name="LASER MODE ANALOG",
        words={"MIN": _w(Field.LOW, QuantityKind.VOLTAGE), "MAX": _w(Field.HIGH, QuantityKind.VOLTAGE)},
        hints={
            "CARRIER": Phrase("it belongs to {statement}", statement=both_of(("LASER MODE DUTY", "DUTY2"))),
            "WIDTH": _OF_FREQUENCY,
        },
    ),
    "laser_delay": Form(
        name="LASER DELAY",
        words={"ON": _w(Field.VALUE, QuantityKind.TIME), "OFF": _w(Field.LOW, QuantityKind.TIME)},
        needs=("ON", "OFF"),
    ),
    "laser_standby": Form(
        name="LASER STANDBY",
        words={"FREQ": _w(Field.VALUE, QuantityKind.FREQUENCY), "DUTY": _w(Field.LOW, QuantityKind.SHARE)},
        needs=("FREQ", "DUTY"),
    ),
    "laser_prevolt": Form(name="LASER PREVOLT", words={"": _w(Field.VALUE, QuantityKind.VOLTAGE)}),
    "laser_fpk": Form(
        name="LASER FPK",
        words={
            "WIDTH": _w(Field.VALUE, QuantityKind.TIME),
            "GAP": _w(Field.LOW, QuantityKind.TIME),
            "OFFDELAY": _w(Field.HIGH, QuantityKind.TIME),
        },
        needs=("WIDTH", "GAP", "OFFDELAY"),
    ),
    "laser_distance": Form(name="LASER DISTANCE", words=_LIMITS, needs=("REF", "RATIO", "MIN", "MAX")),
    "laser_power": Form(name="LASER POWER", words={"": _w(Field.VALUE, QuantityKind.POWER)}),
    "laser_follow": Form(
        name="LASER FOLLOW",
        words={"RATIO": _w(Field.RATIO, QuantityKind.PLAIN), **_LIMITS, "AT": _w(Field.AT, QuantityKind.VELOCITY)},
        needs=("MIN", "MAX"),
    ),
    "laser_switch": Form(name="LASER ON"),
    "let": Form(name="LET"),
    "repeat": Form(name="REPEAT"),
    "for": Form(name="FOR"),
    "if": Form(name="IF"),
    "else": Form(name="ELSE"),
    "end": Form(name="END"),
    "def": Form(name="DEF"),
    "call": Form(name="CALL"),
    "include": Form(name="INCLUDE"),
    "frame": Form(
        name="FRAME",
        words={**_XY, "ROTATE": _w(Field.VALUE, QuantityKind.ANGLE), "SCALE": _w(Field.RATIO, QuantityKind.PLAIN)},
    ),
}


CHANNEL_WORD = _w(Field.CHANNEL, QuantityKind.PLAIN)
"""CHANNEL n at the end of a LASER statement."""

REF_WORD, RATIO_WORD = _w(Field.X, QuantityKind.LENGTH), _w(Field.X, QuantityKind.PLAIN)
"""An axis behind REF and behind RATIO of LASER DISTANCE (they are no columns)."""
