"""Whole random jobs that use every statement of the language, most of them without an error."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from random import Random

MODES = ("DUTY", "DUTY2", "FREQUENCY", "ANALOG")
UNIT = {"DUTY": "%", "DUTY2": "%", "FREQUENCY": "kHz", "ANALOG": "V"}
POWERS = {"DUTY": (1.0, 99.0), "DUTY2": (1.0, 99.0), "FREQUENCY": (2.0, 40.0), "ANALOG": (0.5, 9.5)}
"""Powers that fit the mode; in frequency mode a laser pulse of 1..20 us fits them, too."""
HIGHEST = {"DUTY": 100.0, "DUTY2": 100.0, "FREQUENCY": 60.0, "ANALOG": 10.0}

LENGTHS = (0.0, 0.0001, 0.0005, 0.001, 0.0015, 0.01, 0.1, 0.3, 1.0, 2.5, 10.0, 30.0)
SPEEDS = (10.0, 20.0, 33.3, 100.0, 250.0, 800.0, 1000.0, 5000.0, 9999.0)
ACCELERATIONS = (2.0, 100.0, 1000.0, 5000.0, 50000.0, 1e5)
ODD = ("0", "-1", "1e9", "1e308", "99999", "0.5", "-0.0", "1e-15", "50%", "5kHz", "3ms", "(1/3)", "(0-7)", "(2**0.5)")
"""Mostly out of range or of the wrong kind. No velocity that would take hours rather than ages."""

NUMBERS = ("a", "b", "n1")
"""Names for plain numbers from 0.5 to 5."""
TOP = 2
"""How deep blocks are nested."""


@dataclass(slots=True)
class State:
    """What is in force at the line to be written."""

    units: str = "MM"
    coords: str = "ABS"
    channel: int = 0
    modes: list[str] = field(default_factory=lambda: ["", ""])
    powered: list[bool] = field(default_factory=lambda: [False, False])
    is_on: list[bool] = field(default_factory=lambda: [False, False])
    distance: list[bool] = field(default_factory=lambda: [False, False])

    def copy(self) -> State:
        return replace(
            self, modes=[*self.modes], powered=[*self.powered], is_on=[*self.is_on], distance=[*self.distance]
        )


@dataclass
class Writer:
    """Write one job. `odd`: one number or statement in so many is wrong, 0 for none; `unequal`: for unequal axes."""

    rng: Random
    odd: int = 0
    unequal: bool = False
    lines: list[str] = field(default_factory=list)
    state: State = field(default_factory=State)
    names: list[str] = field(default_factory=list)
    lengths: list[str] = field(default_factory=list)
    routines: list[tuple[str, int]] = field(default_factory=list)
    iterations: int = 1
    kept: bool = False
    """Whether a routine relies on the modes as they are."""
    local: bool = False
    """Whether the line is inside a routine."""
    sky: bool = False
    """Whether the job uses sky writing: then the laser is switched along the path everywhere."""

    # Choices.

    def one_in(self, n: int) -> bool:
        return self.rng.randrange(n) == n - 1

    def some(self, *choices: str) -> str:
        return choices[self.rng.randrange(len(choices))]

    def of(self, values: tuple[float, ...]) -> float:
        return values[self.rng.randrange(len(values))]

    def slip(self) -> bool:
        """Whether to make a mistake here: now and then, in some jobs."""
        return bool(self.odd) and self.one_in(self.odd)

    # Spelling.

    def put(self, *words: str) -> None:
        """A statement, in one of its spellings."""
        line = " ".join(word for word in words if word)
        match self.rng.randrange(12):
            case 0:
                line = line.lower()
            case 1:
                line += "   ; written twice: LINE X 1"
            case 2:
                line = f"  {line} // {len(self.lines)}"
            case _:
                pass
        self.lines.append(line)

    def word(self, name: str, value: str) -> str:
        """A keyword and its number: X 1, X=1, X1."""
        glue = self.some(" ", " ", " ", "=", "")
        return name + (" " if name[-1].isdigit() else glue) + value

    def words(self, *pairs: str) -> str:
        """Words in any order."""
        found = [pair for pair in pairs if pair]
        if self.one_in(3):
            self.rng.shuffle(found)
        return " ".join(found)

    def text(self, value: float) -> str:
        return self.some(f"{value:.6g}", f"{value:.6g}", f"{value!r}", f"{value:.6e}")

    def number(self, value: float, unit: str = "") -> str:
        """A number or an expression that comes to about `value`; with a unit in it never a name."""
        if self.slip():
            return self.some(*ODD)
        if unit or not self.one_in(5):
            return self.text(value) + unit
        name = self.rng.choice(self.names) if self.names else ""
        match self.rng.randrange(6):
            case 0 if name:
                return f"({self.text(value)}*{name}/{name})"
            case 1 if name:
                return f"({self.text(value)} + {name} - {name})"
            case 2:
                return f"(2*{self.text(value / 2)})"
            case 3:
                return f"(min({self.text(value)}, {self.text(value + 1)}))"
            case 4:
                return f"({self.text(value)}*hypot(3, 4)/5)" if value >= 0 else f"-({self.text(-value)})"
            case _:
                return f"({self.text(value)} + sin(180))"

    def whole(self, value: int, unit: str = "") -> str:
        """A whole number."""
        if self.slip():
            return self.some("0.5", "-1", "1e9", "70000", "-0.0", "2.0")
        return f"{value}{unit}" if unit or not self.one_in(6) else f"({value - 1} + 1)"

    def length(self, mm: float) -> str:
        """A length; bare numbers in the units in force."""
        match self.rng.randrange(10):
            case 0:
                return self.number(mm, "mm")
            case 1:
                return self.number(mm * 1000, "um")
            case 2:
                return self.number(round(mm * 1000), "pulse")
            case 3 if self.lengths:
                name = self.rng.choice(self.lengths)
                return f"({name} - {name} + {self.text(abs(mm))}mm)" if mm >= 0 else f"-({self.text(-mm)}mm + 0*{name})"
            case _:
                return self.number(mm if self.state.units == "MM" else mm * 1000)

    def speed(self, mm_s: float) -> str:
        match self.rng.randrange(8):
            case 0:
                return self.number(mm_s, "mm/s")
            case 1:
                return self.number(mm_s / 1000, "m/s")
            case 2:
                return self.number(mm_s * 60, "mm/min")
            case 3:
                return self.number(mm_s * 0.4, "pulse/ms")
            case _:
                return self.number(mm_s if self.state.units == "MM" else mm_s * 0.4)

    def acceleration(self, mm_s2: float) -> str:
        match self.rng.randrange(8):
            case 0:
                return self.number(mm_s2, "mm/s2")
            case 1:
                return self.number(mm_s2 / 1000, "m/s2")
            case 2:
                return self.number(mm_s2 * 4e-4, "pulse/ms2")
            case _:
                return self.number(mm_s2 if self.state.units == "MM" else mm_s2 * 4e-4)

    def power(self, channel: int, *, whole: bool = False, low: float = 0.0, high: float = 1.0) -> str:
        """A power in the channel's mode, between two shares of its range."""
        mode = self.state.modes[channel] or "DUTY"
        least, most = POWERS[mode]
        value = least + (most - least) * self.rng.uniform(low, high)
        if whole:
            value = float(max(round(value), 1 if mode != "FREQUENCY" else 2))
        unit = UNIT[mode] if self.one_in(3) else ""
        if mode == "FREQUENCY" and unit and self.one_in(2):
            value, unit = value * 1000, "Hz"
        elif mode == "ANALOG" and unit and self.one_in(2):
            value, unit = value * 1000, "mV"
        return self.number(value if whole else round(value, 3), unit)

    def tail(self, channel: int) -> str:
        """CHANNEL where it is not the one in force, and sometimes where it is."""
        return f"CHANNEL {channel}" if channel != self.state.channel or self.one_in(8) else ""

    # Setup.

    def a_channel(self) -> int:
        """A channel that has a mode, if there is one."""
        known = [c for c in (0, 1) if self.state.modes[c]]
        return self.rng.choice(known) if known and not self.slip() else self.rng.randrange(2)

    def laser(self, channel: int, *words: str) -> None:
        """A LASER statement for a channel."""
        self.put("LASER", *words, self.tail(channel))

    def mode(self, channel: int, mode: str) -> None:
        state = self.state
        before = state.modes[channel]
        if state.distance[channel] and not self.slip():
            self.laser(channel, "DISTANCE OFF")
            state.distance[channel] = False
        if mode == "DUTY2" and before in ("DUTY", "FREQUENCY"):
            self.laser(channel, "FPK OFF")
        least, most = POWERS[mode]
        low = self.word("MIN", self.number(self.of((0.0, least)))) if self.one_in(3) else ""
        high = self.word("MAX", self.number(self.of((most, HIGHEST[mode])))) if self.one_in(3) else ""
        own = ""
        if mode in ("DUTY", "DUTY2"):
            own = self.word("CARRIER", self.number(self.of((1.0, 10.0, 20.5, 2000.0)), self.some("", "kHz")))
        elif mode == "FREQUENCY":
            own = self.word("WIDTH", self.whole(self.rng.randint(1, 20), self.some("", "us")))
        self.laser(channel, f"MODE {mode}", self.words(own, low, high))
        state.powered[channel] &= before == mode
        state.modes[channel] = mode

    def setup(self, channel: int) -> None:
        """A statement at rest that keeps the kind of mode."""
        mode = self.state.modes[channel]
        if self.slip():
            mode = self.some(*MODES)
        times = (0, 1, 10, 50, 200, 1000, 65535)
        match self.rng.randrange(9):
            case 0 | 1:
                on, off = sorted(self.rng.choice(times) for _ in range(2))
                if self.one_in(5):
                    on, off = off, on
                unit = self.some("", "us")
                words = [self.word("ON", self.whole(on, unit)), self.word("OFF", self.whole(off, unit))]
                self.laser(channel, "DELAY", self.words(*words))
            case 2 if mode not in ("", "ANALOG"):
                frequency = self.word("FREQ", self.number(self.of((0.5, 5.0, 2000.0))))
                pulse = self.words(frequency, self.word("DUTY", self.number(self.of((0.0, 2.0, 100.0)))))
                self.laser(channel, "STANDBY", self.some("OFF", pulse, pulse))
            case 3 if mode in ("DUTY", "FREQUENCY"):
                fpk = self.words(
                    self.word("WIDTH", self.whole(self.rng.choice(times[1:]))),
                    self.word("GAP", self.whole(self.rng.choice(times))),
                    self.word("OFFDELAY", self.whole(self.rng.choice(times))),
                )
                self.laser(channel, "FPK", self.some("OFF", fpk, fpk))
            case 4 if mode == "ANALOG":
                volts = self.number(self.of((0.0, 0.4, 10.0)), self.some("", "V"))
                self.laser(channel, "PREVOLT", self.some("OFF", volts))
            case 5 if mode:
                self.distance(channel)
            case 6 if mode and self.state.powered[channel]:
                self.mode(channel, mode)
            case 7 if mode:
                self.laser(channel, "POWER", self.power(channel), "NOW")
                self.state.powered[channel] = True
            case _:
                if self.one_in(2):
                    self.put("WAIT")
                elif self.one_in(3):
                    self.put("LOOKAHEAD OFF")
                else:
                    time = self.word("TIME", self.number(self.of((0.1, 1.0, 5.0, 100.0)), self.some("", "ms")))
                    acc = self.word("ACC", self.acceleration(self.of((10.0, 1000.0, 50000.0))))
                    self.put("LOOKAHEAD", self.some("", time, acc, self.words(time, acc)))

    def skywrite(self) -> None:
        """SKYWRITE, only while the laser is off."""
        if any(self.state.is_on) and not self.slip():
            return
        if self.one_in(4):
            self.put("SKYWRITE OFF")
            return
        mode = self.rng.randint(1, 3)
        lag = self.of((0.0, 0.2, 5.0, 100.0, 174.0, 250.0, 320.0, 333.3, 1000.0))
        shift = self.of((0.5, -0.5, 20.0, -40.0, -200.0, 300.0))
        steps = ("0", "1", "11", "30", "AUTO")
        self.put(
            f"SKYWRITE MODE {self.whole(mode)}",
            self.words(
                self.word("TIMELAG", self.number(lag, self.some("", "us"))),
                self.word("SHIFT", self.number(shift, self.some("", "us"))) if self.one_in(3) else "",
                f"NPREV {self.some(*steps)}" if self.one_in(3) else "",
                f"NPOST {self.some(*steps)}" if self.one_in(3) else "",
                self.word("LIMIT", self.number(self.of((-1.0, 0.0, 0.5, 0.9, 1.0))))
                if mode == 3 or self.slip()
                else "",
            ),
        )

    def distance(self, channel: int) -> None:
        if self.state.distance[channel] and self.one_in(3):
            self.laser(channel, "DISTANCE OFF")
            self.state.distance[channel] = False
            return
        axes = self.some("XY", "XY", "XYZA")
        places = " ".join(self.word(axis, self.length(self.of(LENGTHS))) for axis in axes)
        ratios = " ".join(self.word(axis, self.number(self.of((0.0, 0.01, 1.0, -0.5, 30.0)))) for axis in axes)
        low, high = self.word("MIN", self.power(channel, high=0.4)), self.word("MAX", self.power(channel, low=0.6))
        source = self.some("", "", "SOURCE PLANNED", "SOURCE ACTUAL")
        self.laser(channel, "DISTANCE", self.words(f"REF {places}", f"RATIO {ratios}", low, high, source))
        self.state.distance[channel] = True

    # The path.

    def give_power(self, channel: int) -> None:
        """LASER POWER or LASER FOLLOW."""
        if not self.state.modes[channel] and not self.slip():
            return
        if self.one_in(3):
            low = self.word("MIN", self.power(channel, whole=True, high=0.4))
            high = self.word("MAX", self.power(channel, whole=True, low=0.6))
            by_velocity = not self.unequal and self.one_in(2)
            if self.unequal and self.state.units != "PULSE" and not self.slip():
                self.state.units = "PULSE"
                self.put("UNITS PULSE")
            if by_velocity or self.slip():
                rate = self.word("AT", self.speed(self.of(SPEEDS)))
            else:
                rate = self.word("RATIO", self.number(self.of((0.001, 0.1, 1.0, 7.5))))
            self.laser(channel, "FOLLOW", self.words(rate, low, high))
        else:
            self.laser(channel, "POWER", self.power(channel))
        self.state.powered[channel] = True

    def switch(self, channel: int) -> None:
        state = self.state
        on = not state.is_on[channel]
        if self.one_in(12):
            on = not on
        if on and not self.slip():
            if not state.modes[channel]:
                return
            if not state.powered[channel]:
                self.give_power(channel)
        now = "NOW" if self.one_in(8) and (not self.sky or self.slip()) else ""
        self.laser(channel, "ON" if on else "OFF", now)
        state.is_on[channel] = on

    def dark(self) -> None:
        """Every channel off."""
        for channel in (0, 1):
            if self.state.is_on[channel] and not self.slip():
                self.laser(channel, "OFF", "NOW" if self.one_in(8) and not self.sky else "")
                self.state.is_on[channel] = False

    def target(self) -> tuple[float, float]:
        """A target or a distance: near and far, on whole numbers and between them."""
        if self.state.coords == "REL":
            signs = self.rng.choice((-1, 1)), self.rng.choice((-1, 1))
            near = LENGTHS[:-2]
            return signs[0] * self.of(near), signs[1] * self.of(near)
        if self.one_in(3):
            return self.of(LENGTHS), -self.of(LENGTHS)
        return round(self.rng.uniform(-30, 30), 3), round(self.rng.uniform(-30, 30), 3)

    def motion_words(self) -> str:
        """VEL, ACC and END of a motion."""
        found = []
        if self.one_in(8):
            found.append(self.word("VEL", self.speed(self.of(SPEEDS[3:6]))))
        if self.one_in(8):
            found.append(self.word("ACC", self.acceleration(self.of(ACCELERATIONS[1:]))))
        if self.one_in(12) and not (self.sky and any(self.state.is_on)):
            found.append(self.word("END", self.speed(self.of((0.0, 0.0, 0.5, 5.0)))))
        return " ".join(found)

    def straight(self, head: str) -> None:
        if head == "JUMP":
            self.dark()
        x, y = self.target()
        words = [self.word("X", self.length(x)), self.word("Y", self.length(y))]
        if self.one_in(3):
            del words[self.rng.randrange(2)]
        self.put(head, self.words(*words, self.motion_words() if head == "LINE" else ""))

    def arc(self) -> None:
        """Full circles, and arcs from a known position."""
        state = self.state
        turn = f"ARC {self.some('CW', 'CCW')}"
        radius = self.of((0.0004, 0.001, 0.01, 0.5, 3.0, 12.0, 40.0))
        towards = math.radians(self.rng.choice((0.0, 90.0, 45.0, self.rng.uniform(0, 360))))
        cx, cy = radius * math.cos(towards), radius * math.sin(towards)
        if self.one_in(3):
            i, j = self.centre(cx, cy)
            self.put(turn, self.words(self.word("I", i), self.word("J", j), self.motion_words()))
            return
        swept = math.radians(self.rng.choice((180.0, 90.0, 359.99, 0.01, self.rng.uniform(1, 359))))
        dx = cx - cx * math.cos(swept) + cy * math.sin(swept)
        dy = cy - cx * math.sin(swept) - cy * math.cos(swept)
        x0 = y0 = 0.0
        if state.coords == "ABS":
            x0, y0 = self.target()
            self.put(self.some("LINE", "LINE", "LINE" if any(state.is_on) else "JUMP"), f"X {x0!r}mm Y {y0!r}mm")
        ends = self.words(self.word("X", self.exact(x0 + dx)), self.word("Y", self.exact(y0 + dy)))
        if self.one_in(2):
            centre = self.word("I", self.exact(cx)), self.word("J", self.exact(cy))
            self.put(turn, ends, self.words(*centre, self.motion_words()))
        else:
            chord = math.hypot(dx, dy) / 2
            r = max(chord * self.of((1.0, 1.0001, 1.2, 5.0)), radius if self.one_in(2) else 0.0)
            self.put(
                turn, ends, self.words(self.word("R", self.some("", "", "-") + self.exact(r)), self.motion_words())
            )

    def centre(self, cx: float, cy: float) -> tuple[str, str]:
        """I and J: on unequal axes in one unit, otherwise in any."""
        if not self.unequal or self.slip():
            return self.length(cx), self.length(cy)
        unit, scale = self.rng.choice((("mm", 1.0), ("um", 1000.0), ("pulse", 1000.0)))
        return self.number(cx * scale, unit), self.number(cy * scale, unit)

    def exact(self, mm: float) -> str:
        """A length to many digits."""
        if self.slip():
            return self.some(*ODD)
        return f"{mm:.9f}mm" if self.state.units == "PULSE" or self.one_in(2) else f"{mm!r}"

    def speeds(self, every: bool = False) -> None:
        for word, values, text in (
            ("VEL", SPEEDS, self.speed),
            ("ACC", ACCELERATIONS, self.acceleration),
            ("JUMPVEL", SPEEDS, self.speed),
            ("JUMPACC", ACCELERATIONS, self.acceleration),
        ):
            if (every and word in ("VEL", "ACC") and not self.slip()) or self.one_in(3):
                self.put(self.word(word, text(self.of(values))))

    # Names, loops, routines, frames.

    def let(self) -> None:
        name = self.rng.choice(NUMBERS)
        if name in self.names and self.one_in(2):
            grown = f"{name}*1.1 + {self.of((0.0, 0.5, -0.25))!r}"
            self.put(f"LET {name} = min(max({grown}, 0.5), 5)")
            return
        if self.iterations > 1 or self.local:
            return
        if self.one_in(4):
            self.put(f"LET pitch = {self.some('500um', '1.5mm', '250pulse')}")
            self.lengths = ["pitch"]
            return
        self.put(f"LET {name} = {self.of((1.0, 1.5, 2.0, 3.0)):g}")
        self.names = sorted({*self.names, name})

    def condition(self) -> str:
        left = self.rng.choice(self.names) if self.names else "pi"
        one = f"{left} {self.some('==', '!=', '<', '<=', '>', '>=')} {self.of((1.0, 2.0, 2.5)):g}"
        other = f"floor({left}) % 2 == {self.some('0', '1')}"
        return self.some(one, other, f"not {one}", f"{one} and {other}", f"({one}) or not ({other})")

    @contextmanager
    def body(self, *, runs: int) -> Iterator[None]:
        """A block: after it the same is in force as before it, whether it runs or not."""
        before, iterations, names = self.state.copy(), self.iterations, list(self.names)
        self.iterations *= max(runs, 1)
        yield
        now = self.state
        for channel in (0, 1):
            if now.is_on[channel] != before.is_on[channel] and not self.slip():
                if before.is_on[channel] and not now.powered[channel]:
                    self.give_power(channel)
                self.laser(channel, "ON" if before.is_on[channel] else "OFF")
            if now.distance[channel] != before.distance[channel] and not self.slip():
                self.laser(channel, "DISTANCE OFF")
                before.distance[channel] = True
            now.is_on[channel] = before.is_on[channel]
        for word in ("units", "coords", "channel"):
            if getattr(now, word) != getattr(before, word) and not self.slip():
                self.put(word.upper(), str(getattr(before, word)))
        self.state, self.iterations, self.names = before, iterations, names

    def block(self, depth: int) -> None:
        state, kept = self.state, self.kept
        self.kept = True
        match self.rng.randrange(5):
            case 0:
                runs = self.rng.choice((0, 1, 2, 3, 5, 6))
                named = self.one_in(2)
                self.put(f"REPEAT {self.some('0.5', '-1', '1e9') if self.slip() else runs}", "AS i" if named else "")
                with self.body(runs=runs):
                    self.statements(depth - 1)
                    if named:
                        self.put("LINE", self.word("X", f"(i % 3 * 0.1mm{' + 1mm' if state.coords == 'ABS' else ''})"))
            case 1:
                to = self.rng.choice((0, 2, 4, 6))
                first, last, steps = (
                    (f"{to}", self.whole(0), ("-2", "(-1)")) if self.one_in(3) else ("0", f"{to}", ("1", "0.5"))
                )
                self.put(f"FOR v FROM {first} TO {last} STEP {self.some(*steps)}")
                with self.body(runs=to + 1):
                    self.statements(depth - 1)
                    self.put("LINE", self.word("Y", "(v * 1mm/3)"))
            case 2:
                self.put("IF", self.condition())
                with self.body(runs=1):
                    self.statements(depth - 1)
                if self.one_in(2):
                    self.put("ELSE")
                    with self.body(runs=1):
                        self.statements(depth - 1)
            case _:
                along = self.word("X", self.length(self.of((0.0, 1.0, 0.3333))))
                shift = f"SHIFT {self.words(along, self.word('Y', self.length(self.of((-2.0, 0.5)))))}"
                rotate = self.word(
                    "ROTATE", self.number(self.of((0.0, 30.0, 90.0, 180.0, -45.5)), self.some("", "deg"))
                )
                scale = self.word("SCALE", self.number(self.of((1.0, 0.5, 1.25, 0.001))))
                self.put("FRAME", self.words(*(w for w in (shift, rotate, scale) if self.one_in(2))))
                with self.body(runs=1):
                    self.statements(depth - 1)
        if not self.slip():
            self.put("END")
        self.kept = kept

    def routine(self) -> None:
        """A DEF that needs modes and velocities only, with the laser off."""
        name = f"part{len(self.routines)}"
        values = self.rng.randrange(3)
        outside, names, lengths = self.state.copy(), self.names, self.lengths
        self.put(f"DEF {name}" + (f"({', '.join('pq'[:values])})" if values or self.one_in(2) else ""))
        self.state.units, self.state.coords, self.state.channel = "MM", "REL", 0
        self.state.is_on, self.state.powered = [False, False], [False, False]
        self.names, self.lengths, self.local = list("pq"[:values]), [], True
        self.kept = True
        for line in ("UNITS MM", "COORDS REL", "CHANNEL 0"):
            self.put(line)
        with self.body(runs=4):
            self.statements(1)
        self.put("END")
        self.state, self.names, self.lengths, self.local = outside, names, lengths, False
        self.routines.append((name, values))

    def call(self) -> None:
        if not self.routines or self.local:
            return
        self.dark()
        name, values = self.rng.choice(self.routines)
        given = ", ".join(self.number(self.of((1.0, 2.0, 0.5))) for _ in range(values))
        self.put(f"CALL {name}" + (f"({given})" if values or self.one_in(2) else ""))
        state = self.state
        for word in (f"UNITS {state.units}", f"COORDS {state.coords}", f"CHANNEL {state.channel}"):
            if not self.slip():
                self.put(word)
        state.powered = [False, False]

    def statements(self, depth: int) -> None:
        for _ in range(self.rng.randint(*((1, 6) if depth < TOP else (4, 22)))):
            self.statement(depth)

    def statement(self, depth: int) -> None:
        state = self.state
        pick = self.rng.randrange(36)
        if self.sky and self.one_in(10):
            self.skywrite()
        elif pick < 8:
            self.straight(self.some("LINE", "LINE", "LINE", "JUMP"))
        elif pick < 11:
            self.arc()
        elif pick < 15:
            self.switch(self.a_channel())
        elif pick < 18:
            self.give_power(self.a_channel())
        elif pick < 19:
            if self.sky and any(state.is_on) and not self.slip():
                return
            self.put(self.word("DWELL", self.whole(self.rng.choice((0, 1, 2, 20)), self.some("", "ms"))))
        elif pick < 22:
            if not any(state.is_on) or (self.one_in(4) and not self.sky):
                self.setup(self.a_channel())
        elif pick < 23:
            state.units = self.some("MM", "PULSE")
            self.put("UNITS", state.units)
        elif pick < 24:
            state.coords = self.some("ABS", "REL")
            self.put("COORDS", state.coords)
        elif pick < 25:
            state.channel = self.rng.randrange(2)
            self.put("CHANNEL", str(state.channel))
        elif pick < 26:
            self.speeds()
        elif pick < 27:
            self.let()
        elif pick < 30:
            if depth and self.iterations < 30:
                self.block(depth)
        elif pick < 33:
            if self.routines:
                self.call()
            elif depth == TOP:
                self.routine()
        elif pick < 34:
            if depth == TOP and len(self.routines) < 3:
                self.routine()
        elif pick < 35 and not self.kept and not any(state.is_on) and self.one_in(2):
            self.mode(self.a_channel(), self.some(*MODES))
        else:
            self.straight("LINE")

    def job(self) -> str:
        """The whole job."""
        if self.one_in(4):
            self.put(f"CRD {self.whole(self.rng.randint(1, 2))}", self.some("", "FIFO 0", "FIFO 1"))
        if self.one_in(3):
            self.state.units = "PULSE"
            self.put("UNITS PULSE")
        if self.one_in(2):
            self.let()
        self.sky = self.one_in(3)
        for channel in (0, 1):
            if not self.rng.randrange(channel + 1) and not self.slip():
                self.mode(channel, self.some(*MODES))
                if self.one_in(2):
                    self.setup(channel)
        self.speeds(every=True)
        self.statements(TOP)
        self.dark()
        return "\n".join(self.lines) + "\n"
