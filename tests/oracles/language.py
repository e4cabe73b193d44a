"""A slow, plain reference of the job language's loops, names, routines and frames, to compare with.

It carries a job out one statement at a time, one number at a time, straight from its text, and writes down what a
machine would be told: flat statements without names, loops or frames. Nothing is shared with the package. Places in
the flat text are absolute and in mm; every other number stays as written, or stands as the value of its expression.
Decided here where the contract is silent:

- Names inside a routine are its own; it may read those of the job, its loops' included in so far as they are running
  where the routine is called. LET in a loop or a branch sets the name of the job or of the routine around it.
- A loop's variable hides a name of the same spelling while the loop runs. LET of it holds to the end of the round.
- What is divided by 0 has no value, nor has anything made of it. A comparison of it is neither true nor false: `and`
  with something false and `or` with something true do not mind.
- A number with a unit and one without are not added or compared, nor are mm and pulse.
- A frame is geometry, so it works on mm; an axis left out stays where it is as seen from the innermost frame.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

UNITS = {
    "um": ("mm", 1, 1000), "mm": ("mm", 1, 1), "pulse": ("pulse", 1, 1),
    "mm/s": ("mm/s", 1, 1), "m/s": ("mm/s", 1000, 1), "mm/min": ("mm/s", 1, 60), "pulse/ms": ("pulse/ms", 1, 1),
    "mm/s2": ("mm/s2", 1, 1), "m/s2": ("mm/s2", 1000, 1), "pulse/ms2": ("pulse/ms2", 1, 1),
    "us": ("us", 1, 1), "ms": ("us", 1000, 1), "s": ("us", 1e6, 1),
    "hz": ("kHz", 1, 1000), "khz": ("kHz", 1, 1), "mhz": ("kHz", 1000, 1),
    "%": ("%", 1, 1), "v": ("V", 1, 1), "mv": ("V", 1, 1000), "deg": ("deg", 1, 1),
}  # fmt: skip
"""A unit as written: the one that it is counted in, and by what it is multiplied and divided for that."""

_SPELLED = "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True))
NUMBER = re.compile(rf"(\d+\.?\d*(?:e[+-]?\d+)?|\.\d+(?:e[+-]?\d+)?)((?:{_SPELLED})(?![a-z0-9_]))?", re.IGNORECASE)
NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
WORD = re.compile(r"DUTY2(?![A-Za-z_0-9.])|[A-Za-z_]+", re.IGNORECASE)
STRING = re.compile(r'"([^"]*)"')
COMPARISON = re.compile(r"<=|>=|==|!=|<|>")
SIGN = re.compile(r"[+-]")
MOST_LINES = 20_000
MOST_DEEP = 60
NEAR = 1e-9


class RefusedError(Exception):
    """The job has a fault."""


class TooLongError(Exception):
    """The job is too long to be worth it."""


@dataclass(frozen=True)
class Value:
    """A number, its unit ('' without one), and whether every machine finds the very same number."""

    number: float
    unit: str = ""
    exact: bool = True


Result = Value | bool | None
"""None: a comparison of what has no value."""


@dataclass
class Flat:
    """The flat statements. `exact`: each number in them but places is the very same everywhere.

    `delicate`: a step hung on a number that rounding may push to the other side.
    """

    lines: list[str] = field(default_factory=list)
    exact: bool = True
    delicate: bool = False


@dataclass
class Cursor:
    """A place in a line."""

    text: str
    at: int = 0

    def take(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        """What matches here, behind blanks; the cursor goes behind it."""
        while self.at < len(self.text) and self.text[self.at].isspace():
            self.at += 1
        found = pattern.match(self.text, self.at)
        self.at = found.end() if found else self.at
        return found

    def has(self, text: str) -> bool:
        """Takes a text if it stands here."""
        return self.take(re.compile(re.escape(text))) is not None

    def word(self, *words: str) -> str:
        """Takes one of the words in upper case, or any; '' if there is none."""
        before = self.at
        found = self.take(WORD if not words else re.compile(rf"(?:{'|'.join(words)})(?![A-Za-z_0-9])", re.IGNORECASE))
        if found is None:
            self.at = before
        return found[0].upper() if found else ""

    def name(self) -> str:
        """Takes a name."""
        found = self.take(NAME)
        if found is None:
            raise RefusedError(f"no name in {self.text!r}")
        return found[0]

    def need(self, text: str) -> None:
        """Takes a text that must stand here."""
        if not self.has(text):
            raise RefusedError(f"no {text} in {self.text!r}")

    def done(self) -> bool:
        """Whether nothing is left."""
        return not self.text[self.at :].strip()


def sine(degrees: float) -> float:
    """Exact at quarter turns."""
    turn = math.fmod(degrees, 360.0)
    if turn % 90 == 0:
        return (0.0, 1.0, 0.0, -1.0)[round(turn / 90) % 4]
    return math.sin(math.radians(turn))


def cosine(degrees: float) -> float:
    """Exact at quarter turns."""
    turn = math.fmod(degrees, 360.0)
    if turn % 90 == 0:
        return (1.0, 0.0, -1.0, 0.0)[round(turn / 90) % 4]
    return math.cos(math.radians(turn))


@dataclass
class Reader:
    """Reads an expression and finds its value on the way."""

    cursor: Cursor
    look_up: Callable[[str], Value]
    flat: Flat

    def either(self) -> Result:
        """... or ..."""
        left = self.both()
        while self.cursor.word("OR"):
            right = self.both()
            sides = truth(left), truth(right)
            left = True if True in sides else None if None in sides else False
        return left

    def both(self) -> Result:
        """... and ..."""
        left = self.inverse()
        while self.cursor.word("AND"):
            right = self.inverse()
            sides = truth(left), truth(right)
            left = False if False in sides else None if None in sides else True
        return left

    def inverse(self) -> Result:
        """not ..."""
        if not self.cursor.word("NOT"):
            return self.comparison()
        inside = truth(self.inverse())
        return None if inside is None else not inside

    def comparison(self) -> Result:
        """One comparison; they do not chain."""
        left = self.sum()
        sign = self.cursor.take(COMPARISON)
        if sign is None:
            return left
        a, b = number(left), number(self.sum())
        same_unit(a, b)
        if not (a.exact and b.exact) and math.isclose(a.number, b.number, rel_tol=NEAR, abs_tol=NEAR):
            self.flat.delicate = True
        x, y = a.number, b.number
        if math.isnan(x) or math.isnan(y):
            return None
        return {"<": x < y, "<=": x <= y, ">": x > y, ">=": x >= y, "==": x == y, "!=": x != y}[sign[0]]

    def sum(self) -> Result:
        """Terms, from left to right."""
        left = self.product()
        while sign := self.cursor.take(SIGN):
            a, b = number(left), number(self.product())
            total = a.number + b.number if sign[0] == "+" else a.number - b.number
            left = finite(Value(total, same_unit(a, b), a.exact and b.exact))
        return left

    def product(self) -> Result:
        """Factors, from left to right."""
        left = self.factor()
        while sign := self.cursor.take(re.compile(r"\*(?!\*)|/|%")):
            a, b = number(left), number(self.factor())
            exact = a.exact and b.exact
            if sign[0] == "*":
                if a.unit and b.unit:
                    raise RefusedError("a unit times a unit")
                left = finite(Value(a.number * b.number, a.unit or b.unit, exact))
                continue
            if sign[0] == "/" and b.unit and a.unit != b.unit:
                raise RefusedError("units do not cancel")
            unit = ("" if b.unit else a.unit) if sign[0] == "/" else same_unit(a, b)
            if b.number == 0:
                left = Value(math.nan, unit)
            elif sign[0] == "/":
                left = finite(Value(a.number / b.number, unit, exact))
            else:
                if not exact:
                    self.edge(a.number / b.number)
                left = finite(Value(a.number % b.number, unit, exact))
        return left

    def factor(self) -> Result:
        """A sign binds less than a power."""
        if sign := self.cursor.take(SIGN):
            inner = number(self.factor())
            return Value(-inner.number, inner.unit, inner.exact) if sign[0] == "-" else inner
        left = self.operand()
        if not self.cursor.has("**"):
            return left
        a, b = number(left), number(self.factor())
        if a.unit or b.unit:
            raise RefusedError("a power of a unit")
        try:
            power = a.number**b.number
        except (ZeroDivisionError, OverflowError):
            power = math.nan
        if isinstance(power, complex) or math.isnan(a.number + b.number):
            power = math.nan
        return finite(Value(power, "", False))

    def operand(self) -> Result:
        """A number, a name, a function, or parentheses."""
        if found := self.cursor.take(NUMBER):
            return literal(found)
        if self.cursor.has("("):
            inside = self.either()
            self.cursor.need(")")
            return inside
        name = self.cursor.name()
        if not self.cursor.has("("):
            return self.look_up(name)
        given = [number(self.either())]
        while self.cursor.has(","):
            given.append(number(self.either()))
        self.cursor.need(")")
        return finite(self.apply(name, given))

    def apply(self, name: str, given: list[Value]) -> Value:
        """A function of numbers."""
        first, exact = given[0], all(v.exact for v in given)
        x, unit = first.number, first.unit
        for other in given[1:]:
            same_unit(first, other)
        if len(given) != {"atan2": 2, "hypot": 2, "min": len(given), "max": len(given)}.get(name, 1):
            raise RefusedError(f"{name} of {len(given)}")
        if any(math.isnan(v.number) for v in given):
            return Value(math.nan, unit)
        match name:
            case "abs":
                return Value(abs(x), unit, exact)
            case "min" | "max":
                values = [v.number for v in given]
                return Value(min(values) if name == "min" else max(values), unit, exact)
            case "floor" | "ceil" | "round" if not unit:
                if not exact:
                    self.edge(x + 0.5 if name == "round" else x)
                whole = math.floor(x) if name == "floor" else math.ceil(x) if name == "ceil" else round(x)
                return Value(float(whole), unit, exact)
            case "hypot":
                return Value(math.hypot(x, given[1].number), unit, False)
            case "atan2":
                if not exact and abs(x) < NEAR and given[1].number < NEAR:
                    self.flat.delicate = True
                return Value(math.degrees(math.atan2(x, given[1].number)), "", False)
            case "sqrt" if not unit:
                return Value(math.sqrt(x) if x >= 0 else math.nan, "", exact)
            case "sin" if unit in ("", "deg"):
                return Value(sine(x), "", False)
            case "cos" if unit in ("", "deg"):
                return Value(cosine(x), "", False)
            case "tan" if unit in ("", "deg"):
                return Value(sine(x) / cosine(x) if cosine(x) else math.nan, "", False)
        raise RefusedError(f"{name} of {x} {unit}")

    def edge(self, value: float) -> None:
        """A step up or down stands at each whole number."""
        if math.isfinite(value) and abs(value - round(value)) < NEAR * max(1.0, abs(value)):
            self.flat.delicate = True


def literal(found: re.Match[str]) -> Value:
    """A number as written."""
    if not found[2]:
        return Value(float(found[1]))
    unit, times, over = UNITS[found[2].lower()]
    return Value(float(found[1]) * times / over, unit)


def truth(value: Result) -> bool | None:
    """What must be a condition."""
    if isinstance(value, Value):
        raise RefusedError("a number in place of a condition")
    return value


def number(value: Result) -> Value:
    """What must be a number."""
    if not isinstance(value, Value):
        raise RefusedError("a condition in place of a number")
    return value


def finite(value: Value) -> Value:
    """What runs away has no value."""
    return value if math.isfinite(value.number) else Value(math.nan, value.unit, value.exact)


def same_unit(a: Value, b: Value) -> str:
    """The unit of both."""
    if a.unit != b.unit:
        raise RefusedError(f"{a.unit or 'plain'} and {b.unit or 'plain'}")
    return a.unit


@dataclass
class Block:
    """A statement and, if it begins a block, what stands inside."""

    text: str
    inside: list[Block] = field(default_factory=list)
    otherwise: list[Block] = field(default_factory=list)


BLOCKS = ("REPEAT", "FOR", "IF", "DEF", "FRAME")


def blocks_of(text: str) -> list[Block]:
    """A text as a tree of statements, without blanks and comments."""
    lines = (re.split(r";|//", line)[0].strip() for line in text.removeprefix("\ufeff").splitlines())
    rest = iter([line for line in lines if line])
    found, end = body_of(rest)
    if end:
        raise RefusedError(f"{end} without a block")
    return found


def body_of(rest: Iterator[str]) -> tuple[list[Block], str]:
    """Statements up to the END or ELSE that closes them, and which of the two it is."""
    found: list[Block] = []
    for line in rest:
        head = Cursor(line).word()
        if head in ("END", "ELSE"):
            return found, head
        block = Block(line)
        found.append(block)
        if head in BLOCKS:
            block.inside, end = body_of(rest)
            if end == "ELSE" and head == "IF":
                block.otherwise, end = body_of(rest)
            if end != "END":
                raise RefusedError(f"{head} without END")
    return found, ""


@dataclass
class Scope:
    """Names of a job or of one call of a routine; running loops have theirs on top."""

    names: dict[str, Value] = field(default_factory=dict)
    loops: list[tuple[str, Value]] = field(default_factory=list)

    def find(self, name: str) -> Value | None:
        """What a name stands for here."""
        running = [value for loop, value in self.loops if loop == name]
        return running[-1] if running else self.names.get(name)

    def put(self, name: str, value: Value) -> None:
        """LET: of the loop's variable, for the rest of the round, if a running loop has that name."""
        for at in reversed(range(len(self.loops))):
            if self.loops[at][0] == name:
                self.loops[at] = name, value
                return
        self.names[name] = value


@dataclass(frozen=True)
class Placed:
    """A frame: scale, then a turn counter-clockwise, then a shift."""

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0
    scale: float = 1.0

    def turned(self, x: float, y: float) -> tuple[float, float]:
        """A direction inside as seen from outside."""
        c, s = cosine(self.turn), sine(self.turn)
        return self.scale * (x * c - y * s), self.scale * (x * s + y * c)

    def out(self, x: float, y: float) -> tuple[float, float]:
        """A place inside as seen from outside."""
        x, y = self.turned(x, y)
        return x + self.x, y + self.y

    def into(self, x: float, y: float) -> tuple[float, float]:
        """A place outside as seen from inside."""
        c, s = cosine(self.turn), sine(self.turn)
        x, y = x - self.x, y - self.y
        return (x * c + y * s) / self.scale, (y * c - x * s) / self.scale


@dataclass
class Carrier:
    """Carries a job out."""

    pulses_per_mm: tuple[float, float]
    included: dict[str, str]
    flat: Flat = field(default_factory=Flat)
    in_pulses: bool = False
    relative: bool = False
    x: float = 0.0
    y: float = 0.0
    frames: list[Placed] = field(default_factory=list)
    routines: dict[str, tuple[list[str], list[Block]]] = field(default_factory=dict)
    scopes: list[Scope] = field(default_factory=lambda: [Scope()])

    def define(self, blocks: list[Block]) -> None:
        """Routines are known everywhere, also before their DEF."""
        for block in blocks:
            cursor = Cursor(block.text)
            match cursor.word():
                case "INCLUDE":
                    self.define(blocks_of(self.file(cursor)))
                case "DEF":
                    name, takes = cursor.name(), []
                    if cursor.has("(") and not cursor.has(")"):
                        takes = [cursor.name()]
                        while cursor.has(","):
                            takes.append(cursor.name())
                        cursor.need(")")
                    if name in self.routines:
                        raise RefusedError(f"{name} twice")
                    self.routines[name] = takes, block.inside
                case _:
                    self.define(block.inside + block.otherwise)

    def file(self, cursor: Cursor) -> str:
        """The text of an INCLUDE."""
        found = cursor.take(STRING)
        if found is None or found[1] not in self.included:
            raise RefusedError("no such file")
        return self.included[found[1]]

    def look_up(self, name: str) -> Value:
        """A name's value here: the routine's own, else the job's."""
        if name == "pi":
            return Value(math.pi)
        value = self.scopes[-1].find(name)
        if value is None:
            value = self.scopes[0].find(name)
        if value is None:
            raise RefusedError(f"{name} has no value")
        return value

    def value(self, cursor: Cursor) -> Value:
        """A bare expression that is a number."""
        value = number(self.result(cursor))
        if math.isnan(value.number):
            raise RefusedError("no value")
        return value

    def result(self, cursor: Cursor) -> Result:
        """A bare expression."""
        return Reader(cursor, self.look_up, self.flat).either()

    def carry_out(self, blocks: list[Block]) -> None:
        """Statements in their order."""
        for block in blocks:
            self.statement(block)

    def statement(self, block: Block) -> None:
        """One statement with all that stands in it."""
        cursor = Cursor(block.text)
        match cursor.word():
            case "LET":
                name = cursor.name()
                cursor.need("=")
                value = self.value(cursor)
                self.end(cursor)
                self.scopes[-1].put(name, value)
            case "REPEAT":
                count = self.plain(cursor)
                if count.number < 0 or count.number != math.floor(count.number):
                    raise RefusedError(f"{count.number} rounds")
                if not count.exact:
                    self.flat.delicate = True
                name = cursor.name() if cursor.word("AS") else ""
                self.loop(name, [Value(float(k)) for k in range(int(count.number))], block.inside)
            case "FOR":
                self.counted(cursor, block.inside)
            case "IF":
                so = truth(self.result(cursor))
                self.end(cursor)
                if so is None:
                    raise RefusedError("no value")
                self.carry_out(block.inside if so else block.otherwise)
            case "DEF":
                pass
            case "CALL":
                self.call(cursor)
            case "FRAME":
                self.frames.append(self.frame(cursor))
                self.carry_out(block.inside)
                self.frames.pop()
            case "INCLUDE":
                self.carry_out(blocks_of(self.file(cursor)))
            case "COORDS":
                self.relative = cursor.word() == "REL"
            case ("LINE" | "JUMP" | "ARC") as head:
                self.move(head, cursor)
            case head:
                if head == "UNITS":
                    self.in_pulses = cursor.word() == "PULSE"
                self.write(self.with_values(block.text))

    def end(self, cursor: Cursor) -> None:
        """Nothing more may stand in a statement."""
        if not cursor.done():
            raise RefusedError(f"{cursor.text!r} goes on")

    def write(self, line: str) -> None:
        """A flat statement."""
        if len(self.flat.lines) >= MOST_LINES:
            raise TooLongError
        self.flat.lines.append(line)

    def plain(self, cursor: Cursor) -> Value:
        """A number without a unit."""
        value = self.value(cursor)
        if value.unit:
            raise RefusedError(f"{value.unit} in place of a plain number")
        return value

    def counted(self, cursor: Cursor, inside: list[Block]) -> None:
        """FOR v FROM a TO b STEP s."""
        name = cursor.name()
        ends = []
        for word in ("FROM", "TO"):
            if not cursor.word(word):
                raise RefusedError(f"no {word}")
            ends.append(self.value(cursor))
        first, last = ends
        step = self.value(cursor) if cursor.word("STEP") else Value(1.0, first.unit)
        unit = same_unit(first, last)
        same_unit(first, step)
        if step.number == 0:
            raise RefusedError("no step")
        exact = first.exact and last.exact and step.exact
        reach = (last.number - first.number) / step.number * (1 + 1e-12) + 1e-9
        if not exact and abs(reach - round(reach)) < 1e-7:
            self.flat.delicate = True
        rounds = max(math.floor(reach) + 1, 0)
        if rounds > MOST_LINES:
            raise TooLongError
        values = [Value(first.number + k * step.number, unit, exact) for k in range(rounds)]
        self.loop(name, values, inside)

    def loop(self, name: str, values: list[Value], inside: list[Block]) -> None:
        """Rounds of a loop."""
        scope = self.scopes[-1]
        if len(values) > MOST_LINES:
            raise TooLongError
        for value in values:
            scope.loops.append((name, value))
            self.carry_out(inside)
            scope.loops.pop()

    def call(self, cursor: Cursor) -> None:
        """CALL name(values)."""
        name = cursor.name()
        given: list[Value] = []
        if cursor.has("(") and not cursor.has(")"):
            given.append(self.value(cursor))
            while cursor.has(","):
                given.append(self.value(cursor))
            cursor.need(")")
        if name not in self.routines or len(self.routines[name][0]) != len(given):
            raise RefusedError(f"no routine {name} of {len(given)}")
        if len(self.scopes) > MOST_DEEP:
            raise TooLongError
        takes, inside = self.routines[name]
        self.scopes.append(Scope(dict(zip(takes, given, strict=True))))
        self.carry_out(inside)
        self.scopes.pop()

    def frame(self, cursor: Cursor) -> Placed:
        """FRAME [SHIFT X x Y y] [ROTATE deg] [SCALE s]."""
        x = y = turn = 0.0
        scale = 1.0
        while word := cursor.word():
            cursor.has("=")
            match word:
                case "X":
                    x = self.length(cursor, 0)
                case "Y":
                    y = self.length(cursor, 1)
                case "ROTATE":
                    value = self.group(cursor)
                    if value.unit not in ("", "deg"):
                        raise RefusedError("no angle")
                    turn = value.number
                case "SCALE":
                    value = self.group(cursor)
                    if value.unit or value.number <= 0:
                        raise RefusedError("no scale")
                    scale = value.number
        return Placed(x, y, turn, scale)

    def group(self, cursor: Cursor) -> Value:
        """A number, or an expression in parentheses, with or without a sign."""
        sign = cursor.take(SIGN)
        if cursor.has("("):
            value = self.value(cursor)
            cursor.need(")")
        else:
            found = cursor.take(NUMBER)
            if found is None:
                raise RefusedError(f"no number in {cursor.text!r}")
            value = literal(found)
        return Value(-value.number, value.unit, value.exact) if sign and sign[0] == "-" else value

    def length(self, cursor: Cursor, axis: int) -> float:
        """A length in mm along an axis."""
        value = self.group(cursor)
        if value.unit not in ("", "mm", "pulse"):
            raise RefusedError(f"{value.unit} in place of a length")
        if value.unit == "pulse" or (self.in_pulses and not value.unit):
            return value.number / self.pulses_per_mm[axis]
        return value.number

    def with_values(self, text: str) -> str:
        """A statement with numbers in place of its expressions."""
        cursor = Cursor(text)
        found = ""
        while cursor.at < len(text):
            letter = text[cursor.at]
            if letter != "(":
                found += letter
                cursor.at += 1
                continue
            value = self.group(cursor)
            bare = found.rstrip()
            if bare.endswith(("+", "-")):
                found = bare[:-1]
                value = Value(-value.number, value.unit, value.exact) if bare.endswith("-") else value
            found += f" {self.written(value)} "
        return found.strip()

    def written(self, value: Value) -> str:
        """A number that is no place."""
        self.flat.exact &= value.exact
        return f"{value.number!r}{value.unit}"

    def move(self, head: str, cursor: Cursor) -> None:
        """LINE, JUMP and ARC: the place in mm as seen from the ground, all other words as they are."""
        if head == "ARC":
            head += f" {cursor.word()}"
        places: dict[str, float] = {}
        others = ""
        while word := cursor.word():
            cursor.has("=")
            if word in "XIR":
                places[word] = self.length(cursor, 0)
            elif word in "YJ":
                places[word] = self.length(cursor, 1)
            else:
                others += f" {word} {self.written(self.group(cursor))}"
        self.end(cursor)
        full_circle = "I" in places and "X" not in places and "Y" not in places
        if not full_circle:
            self.go(places)
            head += f" X {self.x!r}mm Y {self.y!r}mm"
        if "I" in places or "J" in places:
            i, j = places.get("I", 0.0), places.get("J", 0.0)
            for frame in reversed(self.frames):
                i, j = frame.turned(i, j)
            head += f" I {i!r}mm J {j!r}mm"
        if "R" in places:
            radius = places["R"]
            for frame in self.frames:
                radius *= frame.scale
            head += f" R {radius!r}mm"
        self.write(head + others)

    def go(self, places: dict[str, float]) -> None:
        """To the place that X and Y name."""
        if self.relative:
            x, y = places.get("X", 0.0), places.get("Y", 0.0)
            for frame in reversed(self.frames):
                x, y = frame.turned(x, y)
            x, y = self.x + x, self.y + y
        else:
            x, y = self.x, self.y
            for frame in self.frames:
                x, y = frame.into(x, y)
            x, y = places.get("X", x), places.get("Y", y)
            for frame in reversed(self.frames):
                x, y = frame.out(x, y)
        self.x, self.y = x, y


def flatten(
    text: str, pulses_per_mm: tuple[float, float] = (1000.0, 1000.0), included: dict[str, str] | None = None
) -> Flat:
    """A job's statements as they are carried out; RefusedError if it has a fault."""
    carrier = Carrier(pulses_per_mm, included or {})
    blocks = blocks_of(text)
    carrier.define(blocks)
    carrier.carry_out(blocks)
    return carrier.flat
