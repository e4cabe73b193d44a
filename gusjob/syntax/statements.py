"""One line of a job to a Statement: which words a statement takes, of which kind, and which it needs."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from lark import Token, Tree, UnexpectedInput

from gusjob import diagnostics as d
from gusjob.diagnostics import Diagnostic, Rule, Span
from gusjob.syntax.lines import misread, parser, subtrees, tokens
from gusjob.syntax.shapes import MAX_LINE
from gusjob.units import UNITS, Kind, PowerUnit, spelling

GRAMMAR = "job.lark"
_TERMINALS = {"QUANTITY": "a number", "PLUS": "a number", "MINUS": "a number"}
LATER_WORDS = ("LET", "REPEAT", "FOR", "IF", "ELSE", "DEF", "CALL", "FRAME", "INCLUDE", "SKYWRITE")
"""Words of the language that come with later versions: named, so that nobody takes them for a misspelling."""


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Word:
    """What a word's number is. `ms`: its canonical time is ms instead of us."""

    field: Field
    kind: Kind
    ms: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """The words a statement takes and the ones it needs. `name` is how messages call it."""

    name: str
    words: dict[str, Word] = field(default_factory=dict)
    needs: tuple[str, ...] = ()
    hints: dict[str, str] = field(default_factory=dict)


def _w(column: Field, kind: Kind, *, ms: bool = False) -> Word:
    return Word(field=column, kind=kind, ms=ms)


_XY = {"X": _w(Field.X, Kind.LENGTH), "Y": _w(Field.Y, Kind.LENGTH)}
_SPEED = {"VEL": _w(Field.VEL, Kind.VELOCITY), "ACC": _w(Field.ACC, Kind.ACCELERATION)}
_FORCED = {"END": _w(Field.END, Kind.VELOCITY)}
_LIMITS = {"MIN": _w(Field.LOW, Kind.POWER), "MAX": _w(Field.HIGH, Kind.POWER)}
_CENTRE = {"I": _w(Field.I, Kind.LENGTH), "J": _w(Field.J, Kind.LENGTH), "R": _w(Field.R, Kind.LENGTH)}
_ARC_ONLY = dict.fromkeys("IJR", "it belongs to ARC")
_DUTY_LIMITS = {"MIN": _w(Field.LOW, Kind.SHARE), "MAX": _w(Field.HIGH, Kind.SHARE)}
_CARRIER = {"CARRIER": _w(Field.VALUE, Kind.FREQUENCY), **_DUTY_LIMITS}
_WIDTH = {"WIDTH": _w(Field.VALUE, Kind.TIME)}
_AXES = {a: _w(c, Kind.LENGTH) for a, c in zip("XYZA", (Field.X, Field.Y, Field.I, Field.J), strict=True)}

FORMS: dict[str, Form] = {
    "units": Form(name="UNITS"),
    "coords": Form(name="COORDS"),
    "crd": Form(name="CRD", words={"": _w(Field.VALUE, Kind.PLAIN), "FIFO": _w(Field.LOW, Kind.PLAIN)}),
    "channel": Form(name="CHANNEL", words={"": _w(Field.VALUE, Kind.PLAIN)}),
    "VEL": Form(name="VEL", words={"": _w(Field.VALUE, Kind.VELOCITY)}),
    "ACC": Form(name="ACC", words={"": _w(Field.VALUE, Kind.ACCELERATION)}),
    "JUMPVEL": Form(name="JUMPVEL", words={"": _w(Field.VALUE, Kind.VELOCITY)}),
    "JUMPACC": Form(name="JUMPACC", words={"": _w(Field.VALUE, Kind.ACCELERATION)}),
    "line": Form(name="LINE", words={**_XY, **_SPEED, **_FORCED}, hints=_ARC_ONLY),
    "jump": Form(
        name="JUMP",
        words=_XY,
        hints={
            **_ARC_ONLY,
            "VEL": "write JUMPVEL before it",
            "ACC": "write JUMPACC before it",
            "END": "it belongs to LINE and ARC",
        },
    ),
    "arc": Form(name="ARC", words={**_XY, **_CENTRE, **_SPEED, **_FORCED}),
    "dwell": Form(name="DWELL", words={"": _w(Field.VALUE, Kind.TIME, ms=True)}),
    "wait": Form(name="WAIT"),
    "lookahead": Form(
        name="LOOKAHEAD",
        words={"TIME": _w(Field.VALUE, Kind.TIME, ms=True), "ACC": _w(Field.ACC, Kind.ACCELERATION)},
    ),
    "DUTY": Form(
        name="LASER MODE DUTY",
        words=_CARRIER,
        needs=("CARRIER",),
        hints={"WIDTH": "it belongs to LASER MODE FREQUENCY"},
    ),
    "DUTY2": Form(
        name="LASER MODE DUTY2",
        words=_CARRIER,
        needs=("CARRIER",),
        hints={"WIDTH": "it belongs to LASER MODE FREQUENCY"},
    ),
    "FREQUENCY": Form(
        name="LASER MODE FREQUENCY",
        words={**_WIDTH, "MIN": _w(Field.LOW, Kind.FREQUENCY), "MAX": _w(Field.HIGH, Kind.FREQUENCY)},
        needs=("WIDTH",),
        hints={"CARRIER": "in frequency mode the power is the frequency; a carrier belongs to LASER MODE DUTY"},
    ),
    "ANALOG": Form(
        name="LASER MODE ANALOG",
        words={"MIN": _w(Field.LOW, Kind.VOLTAGE), "MAX": _w(Field.HIGH, Kind.VOLTAGE)},
        hints={
            "CARRIER": "it belongs to LASER MODE DUTY and DUTY2",
            "WIDTH": "it belongs to LASER MODE FREQUENCY",
        },
    ),
    "laser_delay": Form(
        name="LASER DELAY",
        words={"ON": _w(Field.VALUE, Kind.TIME), "OFF": _w(Field.LOW, Kind.TIME)},
        needs=("ON", "OFF"),
    ),
    "laser_standby": Form(
        name="LASER STANDBY",
        words={"FREQ": _w(Field.VALUE, Kind.FREQUENCY), "DUTY": _w(Field.LOW, Kind.SHARE)},
        needs=("FREQ", "DUTY"),
    ),
    "laser_prevolt": Form(name="LASER PREVOLT", words={"": _w(Field.VALUE, Kind.VOLTAGE)}),
    "laser_fpk": Form(
        name="LASER FPK",
        words={
            "WIDTH": _w(Field.VALUE, Kind.TIME),
            "GAP": _w(Field.LOW, Kind.TIME),
            "OFFDELAY": _w(Field.HIGH, Kind.TIME),
        },
        needs=("WIDTH", "GAP", "OFFDELAY"),
    ),
    "laser_distance": Form(name="LASER DISTANCE", words=_LIMITS, needs=("REF", "RATIO", "MIN", "MAX")),
    "laser_power": Form(name="LASER POWER", words={"": _w(Field.VALUE, Kind.POWER)}),
    "laser_follow": Form(
        name="LASER FOLLOW",
        words={"RATIO": _w(Field.RATIO, Kind.PLAIN), **_LIMITS, "AT": _w(Field.AT, Kind.VELOCITY)},
        needs=("MIN", "MAX"),
    ),
    "laser_switch": Form(name="LASER ON"),
}

_POWER_KINDS = {Kind.SHARE, Kind.FREQUENCY, Kind.VOLTAGE}
_DEFAULT_UNITS = {
    Kind.LENGTH: "a length (um, mm, pulse)",
    Kind.VELOCITY: "a velocity (mm/s, m/s, mm/min, pulse/ms)",
    Kind.ACCELERATION: "an acceleration (mm/s2, m/s2, pulse/ms2)",
    Kind.TIME: "a time (us, ms, s)",
    Kind.FREQUENCY: "a frequency (Hz, kHz, MHz)",
    Kind.SHARE: "a share (%)",
    Kind.VOLTAGE: "a voltage (V, mV)",
    Kind.ANGLE: "an angle (deg)",
    Kind.PLAIN: "a plain number without unit",
    Kind.POWER: "a power (%, kHz, V)",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A number in canonical units of its kind, and where it stands (columns from 1, end behind).

    `times`, `over`: its unit's factors; `system`: a units.System, or a PowerUnit where the kind is POWER; `text` as
    written.
    """

    value: float
    times: float
    over: float
    system: int
    column: int
    end_column: int
    plain: bool
    """Sign and digits are one run and nothing else but a unit follows: a template may read it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """A line that was read.

    `form` is the key in FORMS; `options` the keywords that are no words with numbers (CW, OFF, NOW ...); `words` by
    keyword, '' for a positional number; `axes` of REF and RATIO of LASER DISTANCE; `channel` of CHANNEL at the end.
    """

    form: str
    name: str
    options: tuple[str, ...] = ()
    words: dict[str, Quantity] = field(default_factory=dict)
    axes: dict[str, dict[str, Quantity]] = field(default_factory=dict)
    channel: Quantity | None = None
    column: int = 1
    end_column: int = 1

    def span(self, line: int, word: str) -> Span:
        """Where `word` stands; the whole statement if it has no such word."""
        found = self.channel if word == "CHANNEL" and self.channel else self.words.get(word) if word else None
        found = found or (self.words.get("") if word == "value" else None)
        start, end = (found.column, found.end_column) if found else (self.column, self.end_column)
        return Span(line=line, column=start, end_line=line, end_column=end)


def strip_comment(line: str) -> str:
    """A line without its comment."""
    cut = min((i for i in (line.find(";"), line.find("//")) if i >= 0), default=len(line))
    return line[:cut]


def read_statement(text: str, line: int) -> tuple[Statement | None, list[Diagnostic]]:
    """A line (with or without comment) to its statement; None with diagnostics, or without any if the line is blank."""
    if len(text) > MAX_LINE:
        return None, [_at(d.NO_END, line, 1, 2, size=len(text), limit=MAX_LINE)]
    text = strip_comment(text)
    try:
        tree = parser(GRAMMAR).parse(text)
    except UnexpectedInput as error:
        return None, [_unreadable(error, text, line)]
    if not tree.children:
        return None, []
    root = tree.children[0]
    assert isinstance(root, Tree)
    return _Reader(line=line, text=text).statement(root)


def _at(rule: Rule, line: int, column: int, end_column: int, **fields: object) -> Diagnostic:
    return Diagnostic(
        rule=rule, span=Span(line=line, column=column, end_line=line, end_column=end_column), fields=fields
    )


def _unreadable(error: UnexpectedInput, text: str, line: int) -> Diagnostic:
    fault = misread(error, GRAMMAR, text, _TERMINALS)
    first = text.split()[0].upper() if text.split() else ""
    if first in LATER_WORDS or first.partition("(")[0] in LATER_WORDS:
        start = len(text) - len(text.lstrip()) + 1
        return _at(d.LATER, line, start, start + len(first), word=first)
    if not text[: fault.column - 1].strip():
        return _at(d.UNKNOWN_STATEMENT, line, fault.column, fault.end_column, found=fault.found, hint=fault.hint)
    return _at(
        d.UNEXPECTED,
        line,
        fault.column,
        fault.end_column,
        found=fault.found,
        expected=fault.expectation,
        hint=fault.hint,
    )


@dataclass(slots=True)
class _Reader:
    line: int
    text: str
    faults: list[Diagnostic] = field(default_factory=list)

    def statement(self, tree: Tree[Token]) -> tuple[Statement | None, list[Diagnostic]]:
        all_tokens = [t for t in tree.scan_values(lambda _: True) if isinstance(t, Token)]
        column = all_tokens[0].column or 1
        end_column = len(self.text.rstrip()) + 1
        channel = None
        if tree.data == "laser":
            for tail in (t for t in subtrees(tree) if t.data == "tail"):
                channel = self.quantity(subtrees(tail)[0], _w(Field.CHANNEL, Kind.PLAIN), "CHANNEL")
            tree = next(t for t in subtrees(tree) if t.data != "tail")
        heads = [t.type for t in tokens(tree)]
        form_key = str(tree.data)
        if form_key == "modal":
            form_key = heads[0]
        elif form_key == "laser_mode":
            form_key = heads[1]
        form = FORMS[form_key]
        words: dict[str, Quantity] = {}
        axes: dict[str, dict[str, Quantity]] = {}
        options = [h for h in heads if h not in form.name.split() or form_key in ("modal", "laser_switch")]
        for part in subtrees(tree):
            if part.data == "value":
                self.word(form, "", part, words)
            elif part.data == "word":
                self.word(form, tokens(part)[0].type, subtrees(part)[0], words, tokens(part)[0])
            elif part.data == "choice":
                if {"PLANNED", "ACTUAL"} & set(options):
                    self.twice(tokens(part)[0])
                options.append(tokens(part)[1].type)
            else:
                self.axes(tokens(part)[0], part, axes)
        self.needs(form, {**words, **axes}, options, column, end_column)
        if self.faults:
            return None, self.faults
        return Statement(
            form=form_key,
            name=form.name,
            options=tuple(options),
            words=words,
            axes=axes,
            channel=channel,
            column=column,
            end_column=end_column,
        ), []

    def twice(self, token: Token) -> None:
        self.faults.append(self.token_fault(d.TWICE, token, word=token.type))

    def token_fault(self, rule: Rule, token: Token, **fields: object) -> Diagnostic:
        start = token.column or 1
        return _at(rule, self.line, start, start + len(token), **fields)

    def axes(self, head: Token, part: Tree[Token], axes: dict[str, dict[str, Quantity]]) -> None:
        if head.type in axes:
            self.twice(head)
        found: dict[str, Quantity] = {}
        for word in subtrees(part):
            axis = tokens(word)[0]
            kind = Kind.LENGTH if head.type == "REF" else Kind.PLAIN
            if axis.type in found:
                self.twice(axis)
            quantity = self.quantity(subtrees(word)[0], _w(_AXES[axis.type].field, kind), f"{head.type} {axis.type}")
            if quantity:
                found[axis.type] = quantity
        for axis_name in "XY":
            if axis_name not in found and not self.faults:
                hint = "; it needs X and Y, Z and A are free"
                self.faults.append(
                    self.token_fault(
                        d.MISSING, head, statement=f"LASER DISTANCE {head.type}", word=axis_name, hint=hint
                    )
                )
        axes[head.type] = found

    def word(
        self, form: Form, name: str, value: Tree[Token], words: dict[str, Quantity], token: Token | None = None
    ) -> None:
        if token is not None and name not in form.words:
            hint = form.hints.get(name, f"it takes {', '.join(w for w in form.words if w) or 'no words'}")
            self.faults.append(self.token_fault(d.FOREIGN, token, word=name, statement=form.name, hint=hint))
            return
        if name in words and token is not None:
            self.twice(token)
            return
        quantity = self.quantity(value, form.words[name], f"{form.name} {name}".strip())
        if quantity is not None:
            words[name] = quantity

    def needs(self, form: Form, words: dict[str, object], options: list[str], column: int, end_column: int) -> None:
        if "OFF" in options:
            return
        missing = [w for w in form.needs if w not in words]
        hint = ""
        if form.name in ("LINE", "JUMP") and not {"X", "Y"} & words.keys():
            missing, hint = ["X or Y"], ""
        if form.name == "ARC":
            missing, hint = _arc_needs(words)
        if form.name == "LASER FOLLOW" and not missing and ("RATIO" in words) == ("AT" in words):
            missing = ["either RATIO or AT, not both" if "AT" in words else "RATIO or AT"]
            hint = "; RATIO r, or AT v for the ratio that reaches MAX at velocity v"
        for word in missing:
            if not self.faults:
                self.faults.append(
                    _at(d.MISSING, self.line, column, end_column, statement=form.name, word=word, hint=hint)
                )

    def quantity(self, value: Tree[Token], word: Word, what: str) -> Quantity | None:
        parts = tokens(value)
        token = parts[-1]
        sign = parts[0] if len(parts) > 1 else token
        start, end = sign.column or 1, (token.column or 1) + len(token)
        number_text, unit_text = _split_unit(str(token))
        times, over, system = 1.0, 1.0, 0
        if unit_text:
            unit = UNITS[unit_text.lower()]
            if unit.kind is not word.kind and not (word.kind is Kind.POWER and unit.kind in _POWER_KINDS):
                self.faults.append(
                    _at(
                        d.WRONG_UNIT,
                        self.line,
                        start,
                        end,
                        what=what,
                        wanted=_DEFAULT_UNITS[word.kind],
                        unit=spelling(unit_text),
                        kind=unit.kind.words,
                        hint="",
                    )
                )
                return None
            times, over, system = unit.times, unit.over * (1000.0 if word.ms else 1.0), unit.system
        magnitude = float(number_text)
        if magnitude == float("inf"):
            self.faults.append(_at(d.TOO_BIG, self.line, start, end, value=f"{token[:20]}..."))
            return None
        signed = -magnitude if sign.type == "MINUS" else magnitude
        glued = sign is token or (sign.column or 0) + 1 == token.column
        return Quantity(
            value=signed * times / over,
            times=times,
            over=over,
            system=system,
            column=start,
            end_column=end,
            plain=glued and "e" not in number_text.lower(),
        )


def _split_unit(token: str) -> tuple[str, str]:
    lower = token.lower()
    unit = max((u for u in UNITS if lower.endswith(u)), key=len, default="")
    return (token[: -len(unit)], token[-len(unit) :]) if unit else (token, "")


def _arc_needs(words: dict[str, object]) -> tuple[list[str], str]:
    ends, centre, radius = {"X", "Y"} & words.keys(), {"I", "J"} & words.keys(), "R" in words
    if radius and centre:
        return ["either R or I J, not both"], ""
    if not radius and not centre:
        return ["I and J, or R"], "; I J is the centre relative to the start, R the radius"
    if radius and not ends:
        return ["X or Y"], "; a full circle is written with I J"
    return [], ""


def unit_of(quantity: Quantity | None) -> PowerUnit:
    """The unit a power was written in."""
    return PowerUnit(quantity.system) if quantity else PowerUnit.NONE
