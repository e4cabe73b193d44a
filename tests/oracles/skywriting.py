"""SKYWRITE computed a second time: one motion after the other, in plain numbers, from the rules alone.

All in the controller's units: pulse, pulse/ms, pulse/ms2; times of SKYWRITE in us. Points are ideal: not rounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

MAX_ACC = 1000.0
"""The default machine's acceleration, pulse/ms2: on an arc v^2/r stays within it while look-ahead is on."""
MM = 1000.0
"""Pulses per mm of the default machine. So 1 mm/s is 1 pulse/ms, and 1000 mm/s2 are 1 pulse/ms2."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """SKYWRITE as written; None is AUTO."""

    mode: int
    timelag: float
    shift: float = 0.0
    nprev: int | None = None
    npost: int | None = None
    limit: float | None = None

    @property
    def lag(self) -> float:
        """Below 1/4 us it counts as 0."""
        return self.timelag if self.timelag >= 0.25 else 0.0

    @property
    def run_in_us(self) -> float:
        return 10.0 * (math.floor(0.15 * self.timelag + 0.5) if self.nprev is None else self.nprev)

    @property
    def run_out_us(self) -> float:
        return 10.0 * (math.floor(0.10 * self.timelag + 0.5) if self.npost is None else self.npost)

    @property
    def on_us(self) -> float:
        """When the light goes on, from S."""
        return max(self.lag + self.shift, -self.run_in_us)

    @property
    def cosine(self) -> float:
        return 0.9 if self.limit is None else self.limit

    def text(self) -> str:
        words = [f"SKYWRITE MODE {self.mode} TIMELAG {self.timelag!r}us"]
        words += [f"SHIFT {self.shift!r}us"] if self.shift else []
        words += [f"NPREV {self.nprev}"] if self.nprev is not None else []
        words += ["NPOST AUTO" if self.npost is None else f"NPOST {self.npost}"]
        words += [f"LIMIT {self.limit!r}"] if self.limit is not None else []
        return " ".join(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A statement. Points absolute.

    `op`: jump line arc dwell wait on off power follow sky vel acc jumpvel jumpacc ahead.
    """

    op: str
    at: Point = (0.0, 0.0)
    centre: Point = (0.0, 0.0)
    ccw: bool = True
    by_radius: bool = False
    value: float = 0.0
    """Speed, acceleration, power, dwell in ms, 1 or 0 for LOOKAHEAD; of FOLLOW the velocity that gives 80 %."""
    channel: int = 0
    sky: Sky | None = None


def job_text(steps: list[Step], *, pulses: bool = False, head: str = "", frame: tuple[int, Point] | None = None) -> str:
    """The job; `frame`: quarter turns and a shift (pulse), which the steps have behind them already."""
    unit = 1.0 if pulses else 1 / MM
    lines = ["LASER MODE DUTY CARRIER 10", "LASER MODE DUTY CARRIER 10 CHANNEL 1", *head.splitlines()]
    lines += ["UNITS PULSE"] if pulses else []
    if frame is not None:
        quarters, shift = frame
        lines.append(f"FRAME ROTATE {90 * quarters} SHIFT X {shift[0] / MM!r}mm Y {shift[1] / MM!r}mm")
    here = (0.0, 0.0)
    for step in steps:
        at, centre = _unframed(step.at, frame), _unframed(step.centre, frame)
        x, y = round(at[0] * unit, 6), round(at[1] * unit, 6)
        match step.op:
            case "jump" | "line":
                lines.append(f"{step.op.upper()} X {x!r} Y {y!r}")
            case "arc":
                i, j = centre[0] - here[0], centre[1] - here[1]
                turn = f"ARC {'CCW' if step.ccw else 'CW'}"
                if step.by_radius:
                    radius = math.hypot(i, j)
                    sweep = sweep_of(here, at, centre, ccw=step.ccw)
                    sign = -1.0 if abs(sweep) > math.pi else 1.0
                    lines.append(f"{turn} X {x!r} Y {y!r} R {round(sign * radius * unit, 6)!r}")
                elif here == at:
                    lines.append(f"{turn} I {round(i * unit, 6)!r} J {round(j * unit, 6)!r}")
                else:
                    lines.append(f"{turn} X {x!r} Y {y!r} I {round(i * unit, 6)!r} J {round(j * unit, 6)!r}")
            case "dwell":
                lines.append(f"DWELL {step.value:g}")
            case "wait":
                lines.append("WAIT")
            case "on" | "off":
                lines.append(f"LASER {step.op.upper()} CHANNEL {step.channel}")
            case "power":
                lines.append(f"LASER POWER {step.value!r} CHANNEL {step.channel}")
            case "follow":
                lines.append(f"LASER FOLLOW MIN 1 MAX 80 AT {step.value!r} CHANNEL {step.channel}")
            case "sky":
                lines.append(step.sky.text() if step.sky else "SKYWRITE OFF")
            case "ahead":
                lines.append("LOOKAHEAD" if step.value else "LOOKAHEAD OFF")
            case "acc" | "jumpacc":
                lines.append(f"{step.op.upper()} {step.value * (1.0 if pulses else 1000.0)!r}")
            case _:
                lines.append(f"{step.op.upper()} {step.value!r}")
        if step.op in ("jump", "line", "arc"):
            here = at
    lines += ["END"] if frame is not None else []
    return "\n".join(lines) + "\n"


def turned(at: Point, quarters: int) -> Point:
    for _ in range(quarters % 4):
        at = (-at[1], at[0])
    return at


def framed(at: Point, frame: tuple[int, Point]) -> Point:
    """Turned by quarters, then shifted."""
    x, y = turned(at, frame[0])
    return x + frame[1][0], y + frame[1][1]


def _unframed(at: Point, frame: tuple[int, Point] | None) -> Point:
    if frame is None:
        return at
    return turned((at[0] - frame[1][0], at[1] - frame[1][1]), -frame[0] % 4)


def sweep_of(start: Point, end: Point, centre: Point, *, ccw: bool) -> float:
    """Signed; a full turn where the ends are one."""
    if start == end:
        return 2 * math.pi if ccw else -2 * math.pi
    first = math.atan2(start[1] - centre[1], start[0] - centre[0])
    last = math.atan2(end[1] - centre[1], end[0] - centre[0])
    return (last - first) % (2 * math.pi) if ccw else -((first - last) % (2 * math.pi))


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A line, or an arc about `centre` with a signed sweep."""

    start: Point
    end: Point
    centre: Point | None = None
    sweep: float = 0.0

    @property
    def radius(self) -> float:
        assert self.centre is not None
        return math.hypot(self.start[0] - self.centre[0], self.start[1] - self.centre[1])

    @property
    def length(self) -> float:
        if self.centre is None:
            return math.hypot(self.end[0] - self.start[0], self.end[1] - self.start[1])
        return self.radius * abs(self.sweep)

    def heading(self, share: float) -> Point:
        """Unit vector of travel at the start (0) or the end (1)."""
        if self.centre is None:
            return (self.end[0] - self.start[0]) / self.length, (self.end[1] - self.start[1]) / self.length
        at = self.start if share == 0 else self.end
        x, y = (at[0] - self.centre[0]) / self.radius, (at[1] - self.centre[1]) / self.radius
        return (-y, x) if self.sweep > 0 else (y, -x)

    def distance(self, at: Point) -> float:
        """How far a point lies off it."""
        if self.centre is None:
            if self.length == 0:
                return math.dist(at, self.start)
            hx, hy = self.heading(0)
            along = (at[0] - self.start[0]) * hx + (at[1] - self.start[1]) * hy
            along = min(max(along, 0.0), self.length)
            return math.dist(at, (self.start[0] + hx * along, self.start[1] + hy * along))
        first = math.atan2(self.start[1] - self.centre[1], self.start[0] - self.centre[0])
        angle = math.atan2(at[1] - self.centre[1], at[0] - self.centre[0])
        part = (angle - first) % (2 * math.pi) if self.sweep > 0 else (first - angle) % (2 * math.pi)
        off = abs(math.dist(at, self.centre) - self.radius)
        return off if part <= abs(self.sweep) else min(math.dist(at, self.start), math.dist(at, self.end))


def run_in(mark: Way, distance: float) -> list[Way]:
    """The ways from P to the start of a mark: along its own circle for half a turn at most, before that straight on."""
    s, (hx, hy) = mark.start, mark.heading(0)
    if mark.centre is None:
        return [Way(start=(s[0] - hx * distance, s[1] - hy * distance), end=s)]
    on_circle = min(distance, math.pi * mark.radius)
    angle = math.copysign(on_circle / mark.radius, mark.sweep)
    begin = _rotated(s, mark.centre, -angle)
    arc = Way(start=begin, end=s, centre=mark.centre, sweep=angle)
    if on_circle == distance:
        return [arc]
    hx, hy = arc.heading(0)
    rest = distance - on_circle
    return [Way(start=(begin[0] - hx * rest, begin[1] - hy * rest), end=begin), arc]


def run_out(mark: Way, distance: float) -> list[Way]:
    """The ways from the end of a mark to Q."""
    back = run_in(reverse(mark), distance)
    return [reverse(way) for way in reversed(back)]


def reverse(way: Way) -> Way:
    return Way(start=way.end, end=way.start, centre=way.centre, sweep=-way.sweep)


def _rotated(at: Point, centre: Point, angle: float) -> Point:
    x, y = at[0] - centre[0], at[1] - centre[1]
    c, s = math.cos(angle), math.sin(angle)
    return centre[0] + x * c - y * s, centre[1] + x * s + y * c


@dataclass(slots=True, kw_only=True)
class Row:
    """A motion or dwell as written. `channels_on`: channels whose laser is on."""

    kind: str
    way: Way
    vel: float = 0.0
    acc: float = 0.0
    dwell: float = 0.0
    channels_on: tuple[int, ...] = ()
    sky: Sky | None = None
    written: int = 0
    """Which SKYWRITE statement holds."""
    stage: int = 0
    ahead: bool = True
    jump_vel: float = 0.0
    jump_acc: float = 0.0
    switched: bool = False
    """Whether some light was switched between the motion before and this one."""

    @property
    def is_sky(self) -> bool:
        return self.sky is not None and self.kind in ("line", "arc") and bool(self.channels_on)

    @property
    def is_lead(self) -> bool:
        """What may end at P instead of S."""
        return self.kind == "jump" or (self.kind == "line" and not self.channels_on)


@dataclass(slots=True, kw_only=True)
class Leg:
    """A motion or dwell as planned. `role`: jump dark mark in out back (mode 1) dwell, 'added' for an added jump."""

    role: str
    way: Way
    vel: float = 0.0
    acc: float = 0.0
    dwell: float = 0.0
    stage: int = 0


@dataclass(slots=True, kw_only=True)
class Mark:
    """A mark, or a row of marks that goes on: `legs` are its motions' numbers."""

    rows: list[Row]
    sky: Sky
    legs: list[int] = field(default_factory=list)
    ins: list[int] = field(default_factory=list)
    """Forward run-in."""
    outs: list[int] = field(default_factory=list)

    @property
    def s(self) -> Point:
        return self.rows[0].way.start

    @property
    def e(self) -> Point:
        return self.rows[-1].way.end

    @property
    def passed(self) -> list[Point]:
        """Vertices that are passed with the light on: flat corners of a polyline in mode 3."""
        return [row.way.end for row in self.rows[:-1]]

    def in_length(self) -> float:
        """From P to S."""
        v, a = self.rows[0].vel, self.rows[0].acc
        return v * v / (2 * a) + v * self.sky.run_in_us / 1000

    def out_us(self, *, stands: bool) -> float:
        """How long the run-out is at mark speed: where motion ends behind it, and with it the light would have to go
        off later than run-out, braking and a jump back to E take, as long as the light is on."""
        last, run_us = self.rows[-1], self.sky.run_out_us
        v, a, jump_v, jump_a = last.vel, last.acc, last.jump_vel, last.jump_acc
        back = v * v / (2 * a) + v * run_us / 1000
        full = jump_v * jump_v / jump_a
        back_ms = 2 * math.sqrt(back / jump_a) if back < full else back / jump_v + jump_v / jump_a
        moves_us = run_us + (v / a + back_ms) * 1000
        return self.sky.lag if stands and self.sky.mode != 1 and moves_us < self.sky.lag else run_us

    def out_length(self, *, stands: bool) -> float:
        """From E to Q."""
        v, a = self.rows[-1].vel, self.rows[-1].acc
        return v * v / (2 * a) + v * self.out_us(stands=stands) / 1000


def rows_of(steps: list[Step], max_acc: float = MAX_ACC) -> list[Row]:
    """The motions as written, with what is in force at each."""
    rows: list[Row] = []
    here, channels_on, sky, stage, moved, ahead = (0.0, 0.0), {0: False, 1: False}, None, 0, False, True
    switched, written = False, 0
    speed: dict[str, float] = {}
    for step in steps:
        match step.op:
            case "on" | "off":
                channels_on[step.channel] = step.op == "on"
                switched = True
            case "sky":
                sky = step.sky if step.sky and step.sky.timelag >= 0.125 else None
                written += 1
            case "wait":
                stage, moved = stage + moved, False
            case "ahead":
                ahead = bool(step.value)
            case "vel" | "acc" | "jumpvel" | "jumpacc":
                speed[step.op] = step.value
            case "dwell" | "jump" | "line" | "arc":
                way = Way(start=here, end=here if step.op == "dwell" else step.at)
                if step.op == "arc":
                    way = replace(way, centre=step.centre, sweep=sweep_of(here, step.at, step.centre, ccw=step.ccw))
                jump_vel = speed.get("jumpvel", speed["vel"])
                jump_acc = speed.get("jumpacc", speed["acc"])
                vel, acc = (jump_vel, jump_acc) if step.op == "jump" else (speed["vel"], speed["acc"])
                if step.op == "arc" and ahead:
                    vel = min(vel, math.sqrt(max_acc * way.radius))
                rows.append(
                    Row(
                        kind=step.op, way=way, vel=vel, acc=acc, dwell=step.value if step.op == "dwell" else 0.0,
                        channels_on=tuple(c for c in (0, 1) if channels_on[c]),
                        sky=sky, written=written, stage=stage, ahead=ahead,
                        jump_vel=jump_vel, jump_acc=jump_acc, switched=switched,
                    )
                )  # fmt: skip
                here, moved, switched = way.end, True, False
            case _:
                pass
    return rows


def marks_of(rows: list[Row]) -> dict[int, Mark]:
    """Marks by the number of their first motion: every one by itself, in mode 3 those that go on as one."""
    found: dict[int, Mark] = {}
    last: Mark | None = None
    for number, row in enumerate(rows):
        before = rows[number - 1] if number else None
        if not row.is_sky:
            last = None
            continue
        assert row.sky is not None
        if last is not None and before is not None and row.sky.mode == 3 and _goes_on(before, row):
            last.rows.append(row)
            continue
        last = found[number] = Mark(rows=[row], sky=row.sky)
    return found


def _goes_on(before: Row, row: Row) -> bool:
    if before.stage != row.stage or before.written != row.written:
        return False
    assert row.sky is not None
    (ax, ay), (bx, by) = before.way.heading(1), row.way.heading(0)
    return ax * bx + ay * by >= row.sky.cosine


@dataclass(slots=True)
class Planned:
    legs: list[Leg]
    marks: list[Mark]


def planned(steps: list[Step], max_acc: float = MAX_ACC) -> Planned:
    """The whole path, with run-ins, run-outs and jumps."""
    rows = rows_of(steps, max_acc)
    marks = marks_of(rows)
    ends = {first + len(mark.rows) - 1: mark for first, mark in marks.items()}
    target: dict[int, Point] = {}
    led: set[int] = set()
    for first, found in marks.items():
        if found.sky.mode == 1:
            continue
        lead = first - 1
        while lead >= 0 and rows[lead].kind == "dwell":
            lead -= 1
        if lead >= 0 and rows[lead].is_lead and rows[lead].stage == rows[first].stage:
            target[lead] = run_in(found.rows[0].way, found.in_length())[0].start
            led.add(first)
    legs: list[Leg] = []
    here: Point = (0.0, 0.0)

    def go(role: str, way: Way, row: Row, vel: float, acc: float) -> None:
        nonlocal here
        legs.append(Leg(role=role, way=way, vel=vel, acc=acc, stage=row.stage))
        here = way.end

    def jump(to: Point, row: Row) -> None:
        go("added", Way(start=here, end=to), row, row.jump_vel, row.jump_acc)

    mark: Mark | None = None
    for number, row in enumerate(rows):
        if row.kind == "dwell":
            legs.append(Leg(role="dwell", way=Way(start=here, end=here), dwell=row.dwell, stage=row.stage))
            continue
        if number in marks:
            mark = marks[number]
            ins = run_in(row.way, mark.in_length())
            if mark.sky.mode == 1:
                for way in reversed(ins):
                    go("back", reverse(way), row, row.vel, row.acc)
            elif number not in led:
                jump(ins[0].start, row)
            for way in ins:
                mark.ins.append(len(legs))
                go("in", way, row, row.vel, row.acc)
        if row.is_sky:
            assert mark is not None
            mark.legs.append(len(legs))
            go("mark", row.way, row, row.vel, row.acc)
        else:
            way = replace(row.way, start=here, end=target.get(number, row.way.end))
            go("jump" if row.kind == "jump" else "dark", way, row, row.vel, row.acc)
        if number in ends:
            assert mark is not None
            outs = run_out(row.way, mark.out_length(stands=_stands_behind(rows, number)))
            for way in outs:
                mark.outs.append(len(legs))
                go("out", way, row, row.vel, row.acc)
            if mark.sky.mode == 1:
                for way in reversed(outs):
                    go("back", reverse(way), row, row.vel, row.acc)
            elif _must_come_back(rows, marks, number, mark):
                jump(mark.e, row)
    return Planned(legs, list(marks.values()))


def _stands_behind(rows: list[Row], last: int) -> bool:
    """Whether motion ends behind a row."""
    follows = rows[last + 1] if last + 1 < len(rows) else None
    return follows is None or follows.stage != rows[last].stage or follows.kind == "dwell"


def _must_come_back(rows: list[Row], marks: dict[int, Mark], last: int, mark: Mark) -> bool:
    """Whether something follows that starts at E, or the motion is over before the light is."""
    row, stands = rows[last], _stands_behind(rows, last)
    if stands and mark.out_us(stands=stands) / 1000 + row.vel / row.acc < mark.sky.lag / 1000:
        return True
    behind = last + 1
    while behind < len(rows) and rows[behind].kind == "dwell":
        behind += 1
    if behind == len(rows) or rows[behind].is_lead:
        return False
    return behind not in marks or marks[behind].sky.mode == 1
