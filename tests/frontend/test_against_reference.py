"""Random jobs of loops, names, routines and frames: the package and the plain reference make the same calls of them."""

from __future__ import annotations

import math
import os
import re
from dataclasses import dataclass, field
from random import Random

import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st
from oracles.language import RefusedError, TooLongError, flatten
from support.tools import MACHINE, MARK

from gusjob.config.machine import Machine
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.lower import compile_job
from gusjob.diagnostics.model import has_errors
from gusjob.frontend import check_text, read_job

EXAMPLES = int(os.environ.get("LANGUAGE_EXAMPLES", "50"))
"""Set it high to search for long."""

UNEQUAL = Machine(pulses_per_mm=(655.36, 500.0))
HEAD = MARK + "LOOKAHEAD OFF\n"
FARTHEST = 1e5
"""mm; farther out rounding of the numbers themselves is seen in the pulses."""

NAMES = ("a", "b", "i", "x", "pitch", "n1", "_u")
ONES = ("0.5", "2", "3", "1.25", "7", "0.1", "1e1", "4.")
SPEEDS = ("100mm/s", "0.2m/s", "3000mm/min", "80.5mm/s")
LENGTHS = ("2mm", "500um", "1.25mm")


@dataclass
class Names:
    """Which names surely have a value here: plain ones, velocities, lengths."""

    plain: set[str] = field(default_factory=set)
    speeds: set[str] = field(default_factory=set)
    lengths: set[str] = field(default_factory=set)

    def copy(self) -> Names:
        return Names(set(self.plain), set(self.speeds), set(self.lengths))

    def both(self, other: Names) -> Names:
        """Names that have a value in either case."""
        return Names(self.plain & other.plain, self.speeds & other.speeds, self.lengths & other.lengths)


@dataclass
class Writer:
    """Writes a job, mostly one without errors."""

    rng: Random
    arcs: bool = True
    lines: list[str] = field(default_factory=list)
    routines: list[tuple[str, int]] = field(default_factory=list)
    repeats: int = 1
    """How often the current position in the text runs."""
    variables: list[str] = field(default_factory=list)
    """Names of the loops around the current position, and of the routine's own values."""
    job_names: Names | None = None
    """In a routine: names of the job that are set before anything is called."""

    def put(self, line: str) -> None:
        self.lines.append(line)

    def some(self, *choices: str) -> str:
        return self.rng.choice(choices)

    def one_in(self, n: int) -> bool:
        return self.rng.randrange(n) == n - 1

    def plain(self, names: Names, depth: int = 2) -> str:
        """An expression without a unit."""
        known = sorted(names.plain | (self.job_names.plain if self.job_names else set()))
        if depth == 0 or self.one_in(3):
            changing = [v for v in self.variables if v in names.plain]
            if changing and self.one_in(2):
                return changing[-1]
            if known and not self.one_in(3):
                return self.rng.choice(known)
            if self.one_in(300):
                return self.rng.choice(NAMES)
            return self.rng.choice(ONES) if self.rng.randrange(4) else str(self.rng.randrange(-9, 30))
        left, right = self.plain(names, depth - 1), self.plain(names, depth - 1)
        match self.rng.randrange(30):
            case 0 | 1 | 2 | 16 | 17 | 18 | 19:
                return f"{left}+{right}"
            case 3 | 4 | 20 | 21:
                return f"{left} - {right}"
            case 5 | 6 | 22 | 23:
                return f"({left})*{self.rng.choice(ONES)}"
            case 7 | 24:
                return f"({left})/{self.rng.choice(ONES)}"
            case 8 | 25:
                return f"({left}) % {self.rng.choice(ONES)}"
            case 9 | 26:
                return f"{self.some('min', 'max')}({left}, {right})"
            case 10 | 27:
                return f"{self.some('abs', 'floor', 'ceil', 'round')}({left})"
            case 11:
                return f"{self.some('sin', 'cos')}({self.some('30', '90', '45')}*({left}))*3"
            case 12:
                return f"-({left})"
            case 13:
                return f"(abs({left}) % 4)**{self.some('2', '0.5', '2**0.5', '3')}"
            case 14 | 28:
                return f"sqrt(abs({left}))"
            case _:
                return f"{self.some('hypot', 'atan2')}({left}, {right})"

    def bounded(self, names: Names, high: int) -> str:
        """A plain number from 0 up to high."""
        return f"({self.plain(names)}) % {high}"

    def condition(self, names: Names, depth: int = 2) -> str:
        if depth and self.one_in(3):
            left, right = self.condition(names, depth - 1), self.condition(names, depth - 1)
            return self.some(f"{left} and {right}", f"{left} OR {right}", f"not {left}", f"({left}) and not ({right})")
        sign = self.some("==", "!=", "<", "<=", ">", ">=")
        if self.one_in(3):
            known = sorted(names.plain)
            if known and self.one_in(2):
                name = self.rng.choice(known)
                return self.some(f"{name} != 0 and 3/{name} {sign} 2", f"2 {sign} 5/{name} or {name} == 0")
            return f"floor({self.plain(names, 1)}) % 2 {sign} {self.some('0', '1')}"
        return f"{self.plain(names, 1)} {sign} {self.plain(names, 1)}"

    def position(self, names: Names) -> str:
        """The number of a word of motion."""
        lengths = sorted(names.lengths)
        match self.rng.randrange(6):
            case 0:
                return str(self.rng.randrange(-20, 20))
            case 1:
                return f"{self.rng.uniform(-9, 9):.4f}{self.some('', 'mm')}"
            case 2 if lengths:
                return f"({self.rng.choice(lengths)}*({self.plain(names, 1)}))"
            case 3:
                return f"{self.some('-', '+', '')}(({self.plain(names)}) % 50)"
            case _:
                return f"({self.plain(names)})"

    def block(self, names: Names, size: int, depth: int) -> None:
        """Some statements."""
        for _ in range(self.rng.randint(0 if self.one_in(8) else 1, size)):
            self.statement(names, depth)

    def statement(self, names: Names, depth: int) -> None:
        pick = self.rng.randrange(24)
        if pick < 6 or (depth == 0 and pick < 16):
            self.motion(names)
        elif pick < 9:
            self.let(names)
        elif pick < 11:
            self.put(f"{self.some('repeat', 'REPEAT')} {self.repeat_count()}{self.loop_name(names)}")
            self.looped(names, depth)
        elif pick < 13:
            self.counted(names, depth)
        elif pick < 15:
            self.branch(names, depth)
        elif pick < 16:
            self.frame(names, depth)
        elif pick < 19:
            self.call(names)
        elif pick < 22:
            self.other(names)
        elif self.repeats <= 4:
            self.run(names)

    def motion(self, names: Names) -> None:
        pick = self.rng.randrange(12)
        if pick < 2 and self.arcs:
            self.arc(names)
            return
        head = self.some("LINE", "LINE", "LINE", "JUMP")
        x, y = f" X {self.position(names)}", f" Y={self.position(names)}"
        words = self.some(x + y, x + y, x, y, y + x)
        if head == "LINE" and self.one_in(6):
            words += f" VEL (5+{self.bounded(names, 90)})"
        self.put(head + words)

    def arc(self, names: Names) -> None:
        turn = self.some("ARC CW", "ARC CCW")
        i, j = self.plain(names, 1), self.plain(names, 1)
        match self.rng.randrange(3):
            case 0:
                self.put(f"{turn} I (3+abs({i})) J ({j})")
            case 1:
                self.put("COORDS REL")
                self.put(f"{turn} X (1+abs({i})%9) Y ({j} % 9) R {self.some('', '-')}(20+{self.plain(names, 0)}%7)")
            case _:
                self.put("COORDS REL")
                self.put(f"{turn} X (2+({i})%9+2) Y 2 I ((({i})%9+4)/2) J 1")
        if self.one_in(2):
            self.put("COORDS ABS")

    def let(self, names: Names) -> None:
        name = self.rng.choice(NAMES)
        if self.job_names and self.job_names.plain and self.one_in(2):
            name = self.rng.choice(sorted(self.job_names.plain))
        match self.rng.randrange(8):
            case 0:
                name = self.some("v", "fast")
                known = sorted(names.speeds)
                speed = f"{self.rng.choice(known)}*{self.rng.choice(ONES)}" if known else self.rng.choice(SPEEDS)
                self.put(f"LET {name} = min({speed}, 9m/s)")
                names.speeds.add(name)
                return
            case 1:
                name = self.some("w", "wide")
                known = sorted(names.lengths)
                length = self.rng.choice(LENGTHS)
                more = f" + {self.rng.choice(known)}/2" if known else ""
                self.put(f"LET {name} = {length}*({self.plain(names, 0)}){more}")
                names.lengths.add(name)
                return
            case 2 | 3 if name in names.plain:
                self.put(f"LET {name} = {name}*{self.some('1.1', '0.5', '-0.9', '1')}+{self.plain(names, 0)}")
            case _:
                self.put(f"LET {name} = {self.plain(names)}")
        names.plain.add(name)

    def repeat_count(self) -> str:
        """How many iterations; more than four run together."""
        self.count = self.rng.choice((0, 1, 2, 3, 4, 5, 6, 7, 12)) if self.repeats <= 24 else self.rng.randrange(3)
        return self.some(str(self.count), f"{self.count}", f"({self.count}*2)/2")

    count: int = 0

    def loop_name(self, names: Names) -> str:
        self.variable = self.rng.choice(NAMES) if self.rng.randrange(4) else ""
        return f" AS {self.variable}" if self.variable else ""

    variable: str = ""

    def looped(self, names: Names, depth: int) -> None:
        """The body of a loop whose head is written."""
        before, repeats = names.copy(), self.repeats
        inside = names.copy()
        if self.variable:
            inside.plain.add(self.variable)
        always = self.count > 0
        variable = self.variable
        self.repeats *= max(self.count, 1)
        self.variables += [variable] * bool(variable)
        self.block(inside, 4, depth - 1)
        self.put("END")
        self.repeats = repeats
        self.variables = self.variables[: len(self.variables) - bool(variable)]
        if always:
            known = inside.plain - ({variable} if variable and variable not in before.plain else set())
            names.plain, names.speeds, names.lengths = known, inside.speeds, inside.lengths

    def counted(self, names: Names, depth: int) -> None:
        variable = self.rng.choice(NAMES)
        self.repeat_count()
        count = self.count
        step = self.rng.choice((1.0, 0.5, 0.1, -1.0, -0.3, 2.0))
        first = self.rng.choice((0.0, 1.0, -2.5, 0.1))
        last = first + step * (count - 1 + self.rng.choice((0, 0, 0.5)))
        start = f"{first}+0*({self.plain(names, 0)})" if self.one_in(3) else f"{first}"
        tail = f" STEP {step}" if step != 1 or self.one_in(2) else ""
        self.put(f"FOR {variable} FROM {start} TO {last!r}{tail}")
        self.variable = variable
        self.looped(names, depth)

    def branch(self, names: Names, depth: int) -> None:
        self.put(f"IF {self.condition(names)}")
        one, other = names.copy(), names.copy()
        if self.one_in(3):
            self.let(one)
        self.block(one, 3, depth - 1)
        if self.one_in(2):
            self.put("ELSE")
            self.block(other, 3, depth - 1)
        self.put("END")
        sure = one.both(other)
        names.plain, names.speeds, names.lengths = sure.plain, sure.speeds, sure.lengths

    def frame(self, names: Names, depth: int) -> None:
        words = [
            f" SHIFT{self.some(' X ', ' Y 2 X ')}{self.position(names)}",
            f" ROTATE {self.some('90', '-90', '180', '30deg', '(' + self.plain(names) + ')')}",
            f" SCALE {self.some('2', '0.5', '(1+' + self.bounded(names, 2) + ')')}",
        ]
        self.rng.shuffle(words)
        self.put("FRAME" + "".join(words[: self.rng.randint(0, 3)]))
        self.block(names, 4, depth - 1)
        self.put("END")

    def call(self, names: Names) -> None:
        if self.routines and self.repeats <= 60:
            name, takes = self.rng.choice(self.routines)
            values = [self.plain(names, 1) for _ in range(takes)]
            if name == "again":
                values[0] = str(self.rng.randrange(4))
            self.put(f"CALL {name}({', '.join(values)})" if takes or self.one_in(2) else f"CALL {name}")

    def other(self, names: Names) -> None:
        speeds = sorted(names.speeds)
        match self.rng.randrange(9):
            case 0 | 1:
                self.put(f"LASER POWER ({self.bounded(names, 90)}){self.some('', ' CHANNEL 1')}")
            case 2:
                self.put(f"DWELL (1+floor({self.bounded(names, 20)}))")
            case 3:
                self.put(f"VEL (2+{self.bounded(names, 90)})")
            case 4 if speeds:
                self.put(f"{self.some('VEL', 'JUMPVEL')} (abs({self.rng.choice(speeds)})*2)")
            case 5 if self.repeats <= 12:
                self.put(f"LASER DELAY ON (floor({self.bounded(names, 30)})) OFF (40+floor({self.bounded(names, 9)}))")
            case 6 if self.one_in(3) and self.repeats <= 12:
                self.put(f"LASER MODE DUTY CARRIER (5+{self.bounded(names, 9)}) MAX (50+{self.bounded(names, 40)})")
            case 7:
                self.put(self.some("COORDS REL", "COORDS ABS", "COORDS ABS", "ACC (9000+1000)", "CHANNEL (1-1)"))
            case 8 if self.one_in(3):
                self.put("UNITS PULSE")
                self.put(f"LINE X ({self.plain(names)}) Y (2000+{self.plain(names)}) VEL (20+{self.bounded(names, 9)})")
                self.put("UNITS MM" if self.rng.randrange(4) else "LASER ON")
            case _:
                self.put(self.some("LASER ON", "LASER OFF", "WAIT"))

    def run(self, names: Names) -> None:
        """Many lines of one shape, calls or not."""
        x, y = self.plain(names), self.plain(names, 1)
        takes = [r for r in self.routines if r[0] != "again"]
        name, count = self.rng.choice(takes) if takes else ("", 0)
        values = [self.plain(names, 1) for _ in range(count)]
        calls = bool(name) and not self.one_in(3)
        for k in range(self.rng.randrange(5, 30)):
            if calls:
                given = ", ".join(f"{v}+{k}" if self.rng.randrange(5) else v for v in values)
                self.put(f"CALL {name}({given})" if values else f"CALL {name}")
            else:
                self.put(f"LINE X ({x}+{k}*0.5) Y ({y} - {k}/4)")
            if self.one_in(12):
                self.put(self.some("LINE X 1", "LASER POWER 20", f"LET a = {k}", "LINE Y (2*3)", "COORDS ABS"))
                names.plain |= {"a"} if self.lines[-1].startswith("LET") else set()

    def routine(self, name: str, sure: Names) -> None:
        self.job_names = sure
        takes = list(dict.fromkeys(self.rng.choice(NAMES) for _ in range(self.rng.randrange(4))))
        own = Names(plain=set(takes))
        self.put(f"DEF {name}({', '.join(takes)})" if takes or self.one_in(2) else f"DEF {name}")
        repeats, self.repeats = self.repeats, 13
        self.variables = takes[:1]
        self.block(own, 4, 2)
        self.variables = []
        self.repeats = repeats
        self.put("END")
        self.routines.append((name, len(takes)))
        self.job_names = None

    def again(self, sure: Names) -> None:
        """A routine that calls itself."""
        self.job_names = sure
        names = Names(plain={"n", "s"})
        self.put("DEF again(n, s)")
        self.statement(names, 0)
        self.put("IF n > 0")
        self.put(f"CALL again(n - 1, s*{self.some('0.5', '2')}+1)")
        self.statement(names, 0)
        if self.one_in(2):
            self.put("CALL again(n-1, s)")
        self.put("ELSE")
        self.motion(names)
        self.put("END")
        self.put("END")
        self.routines.append(("again", 2))
        self.job_names = None

    def forked(self, sure: Names) -> None:
        """A routine that sets names in some of its calls alone, and reads those of the job in the others."""
        self.job_names = sure
        own = Names(plain={"p"})
        self.variables = ["p"]
        self.put("DEF forked(p)")
        for _ in range(self.rng.randint(1, 3)):
            name = self.rng.choice(sorted(sure.plain) or NAMES)
            self.put(f"IF {self.some('p % 2 == 0', 'p > 2', 'not p < 4', self.condition(own))}")
            self.put(f"LET {name} = {self.plain(own, 1)}")
            self.put(self.some("END", "ELSE\nLINE X (p)\nEND", f"ELSE\nLET {name} = p\nEND"))
            self.statement(own, 1)
            self.motion(own)
        self.put("END")
        self.variables, self.job_names = [], None
        self.routines.append(("forked", 1))

    def job(self) -> str:
        names = Names()
        for _ in range(self.rng.randrange(4)):
            self.let(names)
        sure = names.copy()
        for k in range(self.rng.randrange(4)):
            self.routine(f"r{k}" if self.one_in(2) else f"part_{k}", sure)
        if self.one_in(4):
            self.again(sure)
        if self.one_in(3):
            self.forked(sure)
            self.put(f"REPEAT {self.rng.choice((3, 6, 9))} AS i\nCALL forked(i{self.some('', '+1', '*0.5')})\nEND")
        self.block(names, 10, 3)
        return HEAD + "".join(f"{line}\n" for line in self.lines)


def compiled(text: str, machine: Machine) -> list[str] | None:
    """The calls of a job; None if it is refused."""
    source, _ = check_text(text.encode(), "test.job")
    assert source is not None
    job, diagnostics = read_job(source, machine)
    if has_errors(diagnostics):
        return None
    stream, diagnostics = compile_job(job, machine)
    return None if has_errors(diagnostics) else "".join(listing(stream)).splitlines()


COORDINATE = re.compile(r" (X|Y|I|J|R) (-?[0-9.e+-]+)mm")
CALL = re.compile(r"(GT_\w+)\((.*)\)")
MOTIONS = {"GT_LnXY": 2, "GT_ArcXYC": 4, "GT_ArcXYR": 2}
"""How many coordinates a call has after the coordinate system."""


@dataclass
class Followed:
    """Follows the flat motions, to know which positions are so near a half pulse that rounding is ambiguous."""

    machine: Machine
    x: float = 0.0
    y: float = 0.0
    edge: bool = False
    was_edge: bool = False

    def go(self, line: str) -> None:
        words = {word: float(v) for word, v in COORDINATE.findall(line)}
        self.was_edge = self.edge
        self.edge = False
        centre_x, centre_y = self.x + words.get("I", 0.0), self.y + words.get("J", 0.0)
        self.x, self.y = words.get("X", self.x), words.get("Y", self.y)
        for mm, scale in zip((self.x, self.y, centre_x, centre_y), self.machine.pulses_per_mm * 2, strict=True):
            pulses = mm * scale
            self.edge |= abs(pulses - math.floor(pulses) - 0.5) < 1e-6


def arguments(call: str) -> tuple[str, list[float]]:
    """A call's name and its numbers, those in braces too."""
    found = CALL.fullmatch(call)
    assert found is not None
    numbers = re.findall(r"-?[0-9][0-9.e+-]*", found[2])
    return found[1], [float(n) for n in numbers]


def same(one: str, other: str, near: Followed, *, exact: bool) -> bool:
    """Whether two calls agree; `near`: whether a position of this motion or of the one before is near a half pulse."""
    name, ours = arguments(one)
    other_name, theirs = arguments(other)
    if name != other_name or len(ours) != len(theirs):
        return False
    coordinates = range(1, 1 + MOTIONS.get(name, 0))
    edge = near.edge or near.was_edge
    for k, (a, b) in enumerate(zip(ours, theirs, strict=True)):
        if k in coordinates:
            if abs(a - b) > edge:
                return False
        elif name == "GT_ArcXYR" and k == 3:
            if not math.isclose(a, b, rel_tol=1e-12):
                return False
        elif coordinates and edge and not near.machine.equal_axes:
            continue  # Velocity depends on the direction, and so on the pulse.
        elif a != b and (exact or not math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-12)):
            return False
    return True


def difference(text: str, machine: Machine = MACHINE) -> str | None:
    """Where the package and the reference disagree over a job; None: nowhere."""
    try:
        flat = flatten(text, machine.pulses_per_mm)
    except RefusedError as error:
        return None if compiled(text, machine) is None else f"refused by the reference: {error}"
    except TooLongError:
        return None
    if flat.delicate:
        return None
    moves = [line for line in flat.lines if COORDINATE.search(line)]
    if any(abs(float(v)) > FARTHEST for line in moves for _, v in COORDINATE.findall(line)):
        return None
    expected = compiled("\n".join(flat.lines), machine)
    found = compiled(text, machine)
    if expected is None or found is None:
        return None if expected is found else f"refused: {found is None}, the flat job: {expected is None}"
    if len(expected) != len(found):
        return f"{len(found)} calls, the flat job {len(expected)}"
    rest = iter(moves)
    near = Followed(machine)
    exact = flat.exact and machine.equal_axes
    for n, (a, b) in enumerate(zip(expected, found, strict=True)):
        line = next(rest) if a.split("(")[0] in MOTIONS else ""
        if line:
            near.go(line)
        if a != b and not same(a, b, near, exact=exact):
            return f"call {n}: {b}, the flat job {a} ({line})"
    return None


@pytest.mark.slow
@given(st.randoms(use_true_random=False))
@settings(max_examples=EXAMPLES)
def test_random_jobs(rng: Random) -> None:
    text = Writer(rng).job()
    note(text)
    assert difference(text) is None


@given(st.randoms(use_true_random=False))
@settings(max_examples=EXAMPLES // 4)
def test_random_jobs_on_unequal_axes(rng: Random) -> None:
    text = Writer(rng, arcs=False).job()
    note(text)
    assert difference(text, UNEQUAL) is None


@pytest.mark.parametrize("seed", range(EXAMPLES))
def test_larger_random_jobs(seed: int) -> None:
    text = Writer(Random(seed)).job()
    assert difference(text) is None, text
