"""SKYWRITE: planner and interpreter against a second working-out (skywrite_reference) and against closed forms."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, replace
from random import Random

import numpy as np
import pytest
from oracles import skywriting as ref
from oracles.skywriting import Leg, Planned, Point, Sky, Step
from support.tools import MACHINE, diagnostics_in, job_of, run_job

from gusjob.config.machine import Machine, Scanner, ScannerModel
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.ir.setup import SkyWriting
from gusjob.lint import check
from gusjob.simulate import Trace

SEEDS = int(os.environ.get("SKYWRITE_SEEDS", "150"))
"""Random jobs of each kind. Set it high to search for long."""
NEAR = math.sqrt(2) + 1e-6
"""Whole pulses: a point may lie so far from the ideal one."""
LONGER = NEAR + 3
"""The same on a circle: a run is made longer until its arc, with rounded ends and centre, is long enough."""
BEAM = 1.5
"""The beam at light on and off: a switch stands at a whole pulse."""

HARD = {"GJ704", "GJ705", "GJ706"}
"""END_NOT_MET, START_TOO_FAST, STOPS_HARD: what is compiled must not ask for it."""


# Random jobs.

_ROUND = [(x, y) for x in range(-65, 66) for y in range(-65, 66) if x * x + y * y == 65 * 65]
"""36 whole points on a circle."""


@dataclass
class Jobs:
    """Writes random jobs. All points are whole pulses, also those of arcs."""

    rng: Random
    modes: tuple[int, ...] = (1, 2, 3)
    bent: bool = True
    """Arcs and corners that look-ahead slows down, LOOKAHEAD OFF."""

    def one_in(self, n: int) -> bool:
        return self.rng.randrange(n) == 0

    def point(self) -> Point:
        return float(self.rng.randint(-40000, 40000)), float(self.rng.randint(-40000, 40000))

    def sky(self) -> Sky:
        rng = self.rng
        lag = rng.choice((0.2, 5.0, 100.0, 174.0, 250.0, 320.0, 333.3))
        shift = rng.choice((0.0, 0.0, 0.5, -0.5, 20.0, -40.0, -round(lag / 2)))
        nprev, npost = rng.choice(((None, None), (None, None), (11, 9), (30, 60), (40, None), (60, 70)))
        limit = rng.choice((None, None, 0.5, 0.0, 0.99))
        mode = rng.choice(self.modes)
        return Sky(mode=mode, timelag=lag, shift=shift, nprev=nprev, npost=npost, limit=limit if mode == 3 else None)

    def speeds(self, steps: list[Step], every: bool = False) -> None:
        rng = self.rng
        for op, values in (
            ("vel", (50.0, 200.0, 1000.0, 2500.0)), ("acc", (100.0, 250.0, 1000.0)),
            ("jumpvel", (500.0, 4000.0)), ("jumpacc", (200.0, 1000.0)),
        ):  # fmt: skip
            if (every and op in ("vel", "acc")) or self.one_in(4):
                steps.append(Step(op=op, value=rng.choice(values)))

    def arc(self, here: Point) -> Step:
        """From here, to a whole point about a whole centre."""
        rng, scale = self.rng, self.rng.choice((1, 3, 20, 60, 150))
        (ax, ay), (bx, by) = rng.choice(_ROUND), rng.choice(_ROUND)
        centre = here[0] - ax * scale, here[1] - ay * scale
        end = centre[0] + bx * scale, centre[1] + by * scale
        straight = (ax, ay) == (-bx, -by)
        by_radius = end != here and not straight and self.one_in(2)
        return Step(op="arc", at=end, centre=centre, ccw=self.one_in(2), by_radius=by_radius)

    def mark(self, here: Point, heading: Point | None) -> Step:
        """A line, sharp or flat against the one before, or an arc."""
        rng = self.rng
        if self.bent and self.one_in(3):
            return self.arc(here)
        if heading is not None and self.one_in(2):
            turn = rng.choice((0.0, 0.0, rng.uniform(-25, 25), rng.uniform(-100, 100))) if self.bent else 0.0
            long = rng.choice((500.0, 3000.0, 12000.0))
            if turn == 0.0:  # Straight on, to a whole point.
                k = max(round(long / math.hypot(*heading)), 1)
                return Step(op="line", at=(here[0] + k * heading[0], here[1] + k * heading[1]))
            angle = math.atan2(heading[1], heading[0]) + math.radians(turn)
            to = round(here[0] + long * math.cos(angle)), round(here[1] + long * math.sin(angle))
            return Step(op="line", at=(float(to[0]), float(to[1])))
        size = rng.choice((500, 3000, 15000))
        while True:
            dx, dy = rng.randint(-size, size), rng.randint(-size, size)
            if abs(dx) + abs(dy) > 100:
                return Step(op="line", at=(here[0] + dx, here[1] + dy))

    def block(self, steps: list[Step], here: Point) -> Point:
        """What leads there, light on, marks, light off."""
        rng = self.rng
        written = [s.sky for s in steps if s.op == "sky"][-1]
        least = 1 if written is not None and written.mode == 3 else 0  # Light that changes at a flat corner: below.
        for _ in range(max(rng.choice((0, 1, 1, 1, 2)), least)):
            step = rng.choice((Step(op="jump", at=self.point()), Step(op="line", at=self.point()), self.arc(here)))
            if max(map(abs, here)) > 60000:
                step = Step(op="jump", at=self.point())
            steps.append(step)
            here = step.at
        if self.one_in(5):
            steps.append(Step(op="dwell", value=float(rng.randint(1, 3))))
        if self.one_in(3):
            steps.append(Step(op="power", value=float(rng.randint(5, 90)), channel=rng.randrange(2)))
        lit = rng.choice(((0,), (0,), (1,), (0, 1)))
        steps += [Step(op="on", channel=c) for c in lit]
        heading: Point | None = None
        for number in range(rng.choice((1, 1, 2, 3, 5))):
            if number and self.one_in(6):
                steps.append(Step(op="power", value=float(rng.randint(5, 90)), channel=lit[0]))
            step = self.mark(here, heading)
            steps.append(step)
            heading = (step.at[0] - here[0], step.at[1] - here[1]) if step.op == "line" else None
            if heading is not None:
                whole = math.gcd(int(heading[0]), int(heading[1]))
                heading = heading[0] / whole, heading[1] / whole
            here = step.at
        steps += [Step(op="off", channel=c) for c in lit]
        if self.one_in(6):
            steps.append(Step(op="dwell", value=float(rng.randint(1, 3))))
        return here

    def job(self) -> list[Step]:
        rng = self.rng
        steps = [Step(op="power", value=50.0, channel=c) for c in (0, 1)]
        self.speeds(steps, every=True)
        if self.one_in(8):
            steps.append(Step(op="jump", at=self.point()))
        steps.append(Step(op="sky", sky=self.sky()))
        here: Point = (0.0, 0.0)
        for step in steps:
            here = step.at if step.op == "jump" else here
        for _ in range(rng.randint(1, 4)):
            here = self.block(steps, here)
            if self.one_in(3):
                self.speeds(steps)
            if self.one_in(5):
                steps.append(Step(op="wait"))
            if self.one_in(4):
                steps.append(Step(op="sky", sky=None if self.one_in(3) else self.sky()))
                here = self.point()
                steps.append(Step(op="jump", at=here))
            if self.bent and self.one_in(8):
                steps.append(Step(op="ahead", value=float(self.one_in(2))))
        return steps


# The planned path against the reference's.


@dataclass(frozen=True, slots=True, kw_only=True)
class Moves:
    """The motions and dwells of a stream, one entry a timed call."""

    kind: list[int]
    at: list[Point]
    vel: list[float]
    acc: list[float]
    ccw: list[bool]
    dwell: list[float]
    run: list[int]


def moves_of(stream: Stream) -> Moves:
    calls = stream.buffered
    rows = np.flatnonzero(calls.kind <= Buffered.DELAY)
    run = stream.intent.run[rows] if stream.intent is not None else np.zeros(len(rows))
    x, y, here = calls.x[rows].tolist(), calls.y[rows].tolist(), (0.0, 0.0)
    at: list[Point] = []
    for k, *to in zip(calls.kind[rows].tolist(), x, y, strict=True):
        here = here if k == Buffered.DELAY else (to[0], to[1])
        at.append(here)
    return Moves(
        kind=calls.kind[rows].tolist(), at=at, vel=calls.vel[rows].tolist(), acc=calls.acc[rows].tolist(),
        ccw=(calls.r[rows] == 1).tolist(), dwell=calls.p[rows].tolist(), run=[int(r) for r in run],
    )  # fmt: skip


def matched(legs: list[Leg], moves: Moves) -> list[int]:
    """For each leg the number of its last motion; a leg may be split anywhere on its way.

    All ways to share the motions out are followed at once. Ends of marks must be met exactly: they are whole.
    """
    furthest = 0
    ways: dict[int, tuple[int, ...]] = {0: ()}
    for number, at in enumerate(moves.at):
        after: dict[int, tuple[int, ...]] = {}
        for done, ends in ways.items():
            if done == len(legs) or not _runs(legs[done], moves, number):
                continue
            leg = legs[done]
            exact = leg.role == "mark" or (done + 1 < len(legs) and legs[done + 1].role == "mark")
            exact = exact or (leg.role in ("jump", "dark", "added") and _is_whole(leg.way.end))
            bent = any(one.way.centre is not None for one in legs[done : done + 3])
            if math.dist(at, leg.way.end) <= (1e-6 if exact else LONGER if bent else NEAR):
                after.setdefault(done + 1, (*ends, number))
            if leg.role != "dwell" and leg.way.distance(at) <= BEAM:
                after.setdefault(done, ends)
        if not after:
            wanted = legs[furthest] if furthest < len(legs) else None
            raise AssertionError(f"motion {number} to {at} (v {moves.vel[number]:g}) is none of {furthest}: {wanted}")
        ways, furthest = after, max(after)
    assert len(legs) in ways, f"{len(legs)} motions wanted, {furthest} found; the next: {legs[furthest]}"
    return list(ways[len(legs)])


def _is_whole(at: Point) -> bool:
    return at[0] == int(at[0]) and at[1] == int(at[1])


def _runs(leg: Leg, moves: Moves, number: int) -> bool:
    """Whether a motion can be a leg, or a part of it, by kind and speed."""
    kind = moves.kind[number]
    if leg.role == "dwell" or kind == Buffered.DELAY:
        return leg.role == "dwell" and kind == Buffered.DELAY and moves.dwell[number] == leg.dwell
    if (leg.way.centre is None) != (kind == Buffered.LINE):
        return False
    if leg.way.centre is not None and moves.ccw[number] != (leg.way.sweep > 0):
        return False
    return math.isclose(moves.vel[number], leg.vel, rel_tol=1e-2 if leg.way.centre else 1e-9) and math.isclose(
        moves.acc[number], leg.acc, rel_tol=1e-9
    )


def compiled(text: str, machine: Machine = MACHINE) -> tuple[Stream, list[Diagnostic]]:
    """The calls of a job that must be without an error; and all that was said."""
    job = job_of(text, machine)
    said = check(job, machine)
    assert [f.message for f in said if f.severity is Severity.ERROR] == []
    stream, diagnostics = compile_job(job, machine)
    return stream, [*said, *diagnostics]


def ran(stream: Stream, machine: Machine = MACHINE) -> Trace:
    """A run without a fault that a planned path must not have."""
    trace, diagnostics = simulate_stream(stream, machine)
    assert trace is not None
    assert [f"{f.span.line}: {f.rule.code} {f.message}" for f in diagnostics if f.severity is Severity.ERROR] == []
    assert [f"{f.span.line}: {f.rule.code} {f.message}" for f in diagnostics if f.rule.code in HARD] == []
    return trace


def path_at(trace: Trace, time: float) -> tuple[Point, float]:
    """Where the command is at a moment, and how fast."""
    times = trace.schedule.times_ms
    cell = np.array([min(max(int(np.searchsorted(times, time, side="right")) - 1, 0), len(times) - 2)])
    x, y = trace.motion.position(cell, np.array([time]))
    v = trace.motion.velocity(cell, np.array([time]))
    return (float(x[0]), float(y[0])), float(v[0])


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A job, planned twice and run."""

    steps: list[Step]
    text: str
    plan: Planned
    ends: list[int]
    trace: Trace
    gap_us: float = 0.0

    def starts(self, leg: int) -> float:
        """When a leg starts, ms."""
        return float(self.trace.schedule.times_ms[self.ends[leg - 1] + 1 if leg else 0])

    def over(self, leg: int) -> float:
        """When a leg ends, ms."""
        return float(self.trace.schedule.times_ms[self.ends[leg] + 1])


def case_of(steps: list[Step], *, pulses: bool = False, head: str = "", frame: tuple[int, Point] | None = None,
            gap_us: float = 0.0) -> Case | None:  # fmt: skip
    """A job that must be planned as the reference says; None where a switch finds no motion, or no mark."""
    text = ref.job_text(steps, pulses=pulses, head=head, frame=frame)
    plan = ref.planned(steps)
    stream, localized = compiled(text)
    errors = [f for f in localized if f.severity is Severity.ERROR]
    assert {f.rule.code for f in errors} <= {"GJ809", "GJ810"}, [f.message for f in errors]
    ends = matched(plan.legs, moves_of(stream))
    if errors or "GJ810" in {f.rule.code for f in localized}:
        return None
    return Case(steps=steps, text=text, plan=plan, ends=ends, trace=ran(stream), gap_us=gap_us)


def on_circles(case: Case) -> None:
    """Arcs lie on the reference's arcs, not only their ends."""
    laid = case.trace.segments
    rounds = set(laid.arc_at.tolist())
    first = 0
    for leg, last in zip(case.plan.legs, case.ends, strict=True):
        for motion in range(first, last + 1):
            if motion in rounds:
                a, b = case.trace.schedule.times_ms[motion], case.trace.schedule.times_ms[motion + 1]
                for share in (0.25, 0.5, 0.75):
                    at, _ = path_at(case.trace, float(a + (b - a) * share))
                    assert leg.way.distance(at) <= 2.0, f"motion {motion} lies {leg.way.distance(at)} off {leg}"
        first = last + 1


def at_speed(case: Case) -> None:
    """Mark speed at S and E, in the constant part of run-in and run-out, and in whole marks of modes 1 and 2."""
    for mark in case.plan.marks:
        if len(mark.rows) > 1:
            continue  # Flat corners: look-ahead decides.
        v, legs = mark.rows[0].vel, case.plan.legs
        start, over = case.starts(mark.legs[0]), case.over(mark.legs[-1])
        begin = start - mark.sky.run_in_us / 1000
        end = over + mark.sky.run_out_us / 1000
        times = [begin, (begin + start) / 2, start, *np.linspace(start, over, 7)[1:-1], over, (over + end) / 2, end]
        for time in times:
            inside = min(max(time, begin + 2e-6), end - 2e-6)
            where = f"{(time - start) * 1000:g} us behind S, {(time - over) * 1000:g} behind E of {legs[mark.legs[0]]}"
            # A small arc from whole pulse to whole pulse is a bit shorter or longer than it should be.
            slack = 0.0 if mark.rows[0].way.centre is None else NEAR / mark.rows[0].way.radius
            assert path_at(case.trace, inside)[1] == pytest.approx(v, rel=1e-6 + slack), where


def lights(case: Case) -> None:
    """As many emissions as marks and lit channels; each begins at S and ends at E for a beam that lags by TIMELAG."""
    for channel in (0, 1):
        marks = [m for m in case.plan.marks if channel in m.rows[0].lit]
        found = [c.emission for c in case.trace.channels if c.channel == channel]
        count = len(found[0].start_ms) if found else 0
        assert count == len(marks) + _plain_lights(case.steps, channel), (channel, len(marks))
        # Nothing but marks between the first and the last: light of marks without sky writing lies in between.
        starts = found[0].start_ms if found else np.empty(0)
        for mark in marks:
            early = (mark.sky.on_us + case.gap_us) / 1000
            start, over = case.starts(mark.legs[0]), case.over(mark.legs[-1])
            number = int(np.argmin(np.abs(starts - early - start)))
            on, off = float(starts[number]), float(found[0].end_ms[number])
            _switched_at(case, "on", on - case.gap_us / 1000, start, mark.sky.on_us, mark.s)
            _switched_at(case, "off", off, over, mark.sky.lag, mark.e)


def _switched_at(case: Case, what: str, moment: float, passed: float, late_us: float, at: Point) -> None:
    """A switch comes `late_us` behind the moment at which the command passes a point, to the next whole pulse."""
    due, _ = path_at(case.trace, passed + late_us / 1000)
    done, _ = path_at(case.trace, moment)
    assert math.dist(due, done) <= BEAM, f"{what} {math.dist(due, done):.3f} pulse off, due {passed + late_us / 1000}"
    beam, v = path_at(case.trace, moment - late_us / 1000)
    slow = min(path_at(case.trace, moment + shift)[1] for shift in (-0.004, 0.0, 0.004))
    if slow > v / 1.05:  # Near standstill a pulse takes long.
        assert math.dist(beam, at) <= BEAM, f"{what}: beam {math.dist(beam, at):.3f} pulse off"
    assert abs(moment - passed - late_us / 1000) <= 0.1


def _plain_lights(steps: list[Step], channel: int) -> int:
    """Emissions of marks without sky writing: light that goes off and on between two motions stays on."""
    rows = ref.rows_of(steps)
    lit = [channel in row.lit and row.kind != "dwell" and row.sky is None for row in rows]
    same = [False, *(a and b.stage == c.stage for a, b, c in zip(lit, rows, rows[1:], strict=False))]
    return sum(now and not before for now, before in zip(lit, same, strict=True))


CHECKS = (on_circles, at_speed, lights)


def random_case(seed: int) -> Case | None:
    rng = Random(seed)
    steps = Jobs(rng).job()
    pulses, head, frame, gap = rng.random() < 0.2, "", None, 0.0
    if rng.random() < 0.3:
        head = "\n".join(f"LASER DELAY ON {20 + 5 * c} OFF {30 + 10 * c} CHANNEL {c}" for c in (0, 1))
    if rng.random() < 0.15:
        gap = 4.0
        head += "\nLASER FPK WIDTH 3 GAP 4 OFFDELAY 7\nLASER FPK WIDTH 3 GAP 4 OFFDELAY 7 CHANNEL 1"
    if rng.random() < 0.2:
        frame = rng.randrange(4), (float(rng.randint(-5000, 5000)), float(rng.randint(-5000, 5000)))
        moved = [replace(s, at=ref.framed(s.at, frame), centre=ref.framed(s.centre, frame)) for s in steps]
        moving = [i for i, s in enumerate(moved) if s.op in ("jump", "line", "arc")]
        # Inside a FRAME the path starts where it is: the first motion must not be an arc from (0, 0).
        if moving and moved[moving[0]].op != "arc":
            steps = moved
        else:
            frame = None
    return case_of(steps, pulses=pulses, head=head, frame=frame, gap_us=gap)


@pytest.mark.parametrize("part", range(10))
def test_random_jobs(part: int) -> None:
    """Path, speeds and light of random jobs are the reference's."""
    refused = 0
    for seed in range(part * SEEDS // 10, (part + 1) * SEEDS // 10):
        case = random_case(seed)
        refused += case is None
        if case is not None:
            for holds in CHECKS:
                holds(case)
    assert refused <= 1 + SEEDS // 50


# RTC5's own numbers (manual p. 115, p. 481 f.).

RTC5 = Sky(mode=2, timelag=174.0, shift=-40.0, nprev=11, npost=9)
FAST = 1000.0
"""pulse/ms, that is mm/s."""


def head(sky: Sky, vel: float = FAST, acc: float = 1000.0) -> list[Step]:
    speeds = [Step(op="vel", value=vel), Step(op="acc", value=acc), Step(op="power", value=50.0)]
    return [*speeds, Step(op="sky", sky=sky), Step(op="jump", at=(5000.0, 5000.0))]


def marked(steps: list[Step], *path: Point) -> list[Step]:
    lines = [Step(op="line", at=at) for at in path]
    return [*steps, Step(op="on"), *lines, Step(op="off")]


def must(case: Case | None) -> Case:
    assert case is not None
    return case


def test_rtc5_switches() -> None:
    """Timelag 174 us, LaserOnShift -80 (-40 us): on at 134 us behind the start, off at 174 us behind the end."""
    case = must(case_of(marked(head(RTC5), (15000.0, 5000.0))))
    emission, mark = case.trace.channels[0].emission, case.plan.marks[0]
    assert emission.start_ms[0] - case.starts(mark.legs[0]) == pytest.approx(0.134, abs=1e-9)
    assert emission.end_ms[0] - case.over(mark.legs[-1]) == pytest.approx(0.174, abs=1e-3)  # Braking from 90 us on.


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("acc", [1000.0, 250.0])
def test_rtc5_run_times(mode: int, acc: float) -> None:
    """10 us * Nprev at mark speed before S, 10 us * Npost behind E; beyond that v/a for each acceleration.

    Mode 1 goes there and back: 20 us * Nprev in all, as v/a goes to nothing. It turns at P and Q, and stands at S and E
    before and behind: the way of length d takes 2*sqrt(d/a) where nothing needs mark speed, a triangle.
    """
    sky = replace(RTC5, mode=mode)
    machine = Machine(lookahead_acc_pulse_per_ms2=1e-6)
    steps = [*marked(head(sky, acc=acc), (15000.0, 5000.0)), Step(op="jump", at=(0.0, 20000.0))]
    plan = ref.planned(steps)
    stream, _ = compiled(ref.job_text(steps), machine)
    ends, times = matched(plan.legs, moves_of(stream)), ran(stream, machine).schedule.times_ms
    mark, ramp = plan.marks[0], FAST / acc
    first, last = ends[mark.legs[0] - 1], ends[mark.legs[-1]]
    begin = ends[mark.legs[0] - (3 if mode == 1 else 2)]
    behind = ends[mark.legs[-1] + (2 if mode == 1 else 1)]
    come, gone = float(times[first + 1] - times[begin + 1]), float(times[behind + 1] - times[last + 1])
    back_in, back_out = (2 * math.sqrt((FAST * t + FAST * ramp / 2) / acc) for t in (0.11, 0.09))
    assert come == pytest.approx(0.11 + ramp + (back_in if mode == 1 else 0.0), abs=2e-3)
    assert gone == pytest.approx(0.09 + ramp + (back_out if mode == 1 else 0.0), abs=2e-3)


def test_rtc5_corner_jump() -> None:
    """In mode 2 the jump at a 90 degree corner is sqrt(ro^2 + ri^2): 0.1421 mm. A GUS adds v^2/2a to ro and ri."""
    for acc in (1000.0, 32000.0):
        machine = Machine(max_acceleration_mm_s2=acc * 1000)
        steps = marked(head(RTC5, acc=acc), (15000.0, 5000.0), (15000.0, 15000.0))
        stream, _ = compiled(ref.job_text(steps), machine)
        plan, moves = ref.planned(steps, acc), moves_of(stream)
        ends = matched(plan.legs, moves)
        number = next(i for i, leg in enumerate(plan.legs) if leg.role == "added")
        ramp = FAST * FAST / (2 * acc)
        ideal = math.hypot(90.0 + ramp, 110.0 + ramp)
        q, p = moves.at[ends[number - 1]], moves.at[ends[number]]
        assert math.dist(q, p) == pytest.approx(ideal, abs=NEAR)
        assert plan.legs[number].way.length == pytest.approx(ideal, rel=1e-12)
    assert math.hypot(90.0, 110.0) == pytest.approx(142.1, abs=0.05)
    # 32000 pulse/ms2 is the most a GUS takes: v^2/2a is 15.6 um there, and the jump 163.9 um.
    assert ideal == pytest.approx(163.9, abs=0.5)


def test_a_shift_is_clipped() -> None:
    """The light is on no earlier than 10 us * Nprev before S."""
    case = must(case_of(marked(head(replace(RTC5, shift=-400.0)), (15000.0, 5000.0))))
    on = case.trace.channels[0].emission.start_ms[0] - case.starts(case.plan.marks[0].legs[0])
    assert on == pytest.approx(-0.110, abs=1e-9)
    text = ref.job_text(marked(head(replace(RTC5, shift=-400.0)), (15000.0, 5000.0)))
    assert "GJ803" in {code for _, code in diagnostics_in(text)}


def test_auto() -> None:
    """A stored configuration: Timelag 320, 48, 32."""
    case = must(case_of(marked(head(Sky(mode=2, timelag=320.0)), (15000.0, 5000.0))))
    mark = case.plan.marks[0]
    assert (mark.sky.run_in_us, mark.sky.run_out_us) == (480.0, 320.0)
    moves = moves_of(compiled(case.text)[0])
    assert moves.at[case.ends[mark.ins[0] - 1]] == (5000.0 - 980, 5000.0)
    assert moves.at[case.ends[mark.outs[-1]]] == (15000.0 + 820, 5000.0)


# Energy.


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("follow", [False, True])
@pytest.mark.parametrize("shift", [0.0, -20.0])
def test_energy_per_mm_is_constant(mode: int, follow: bool, shift: float) -> None:
    sky = Sky(mode=mode, timelag=200.0, shift=shift, nprev=60, npost=46)
    for seed in range(6):
        rng = Random(seed)
        vel, acc = rng.choice((200.0, 1000.0)), rng.choice((250.0, 1000.0))
        steps = head(sky, vel, acc)
        if follow:
            steps.append(Step(op="follow", value=5000.0))
        for _ in range(4):
            x, y = rng.randint(-9000, 9000), rng.randint(-9000, 9000)
            steps = marked(
                [*steps, Step(op="jump", at=(x, y))], (x + rng.randint(1000, 9000), y + rng.randint(0, 9000))
            )
        case = must(case_of(steps))
        power = 1.0 + 79.0 * vel / 5000.0 if follow else 50.0
        found = case.trace.channels[0].emitted
        lit = found.emission_ms > 0
        assert found.power_min[lit] == pytest.approx(power, rel=1e-3)
        assert found.power_max[lit] == pytest.approx(power, rel=1e-3)
        wanted = sum(m.rows[0].way.length / vel - shift / 1000 for m in case.plan.marks) * power
        slack = len(case.plan.marks) * 2 * BEAM / vel * power
        assert found.power_ms.sum() == pytest.approx(wanted, abs=slack)


@pytest.mark.parametrize("vel", [200.0, 1000.0])
def test_power_at_a_flat_corner_acts_where_the_beam_is(vel: float) -> None:
    """TIMELAG behind the corner."""
    sky = Sky(mode=3, timelag=250.0)
    steps = [*head(sky, vel), Step(op="on"), Step(op="line", at=(10000.0, 5000.0)), Step(op="power", value=20.0)]
    steps += [Step(op="line", at=(20000.0, 5000.0)), Step(op="off")]
    found = must(case_of(steps)).trace.channels[0].emitted
    assert found.power_ms.sum() == pytest.approx((5000.0 * 50 + 10000.0 * 20) / vel, abs=2 * BEAM * 50 / vel)


def test_power_at_a_sharp_corner_is_that_of_each_mark() -> None:
    sky = Sky(mode=2, timelag=250.0)
    steps = [*head(sky), Step(op="on"), Step(op="line", at=(10000.0, 5000.0)), Step(op="power", value=20.0)]
    steps += [Step(op="line", at=(10000.0, 15000.0)), Step(op="off")]
    found = must(case_of(steps)).trace.channels[0].emitted
    assert found.power_ms.sum() == pytest.approx((5000.0 * 50 + 10000.0 * 20) / FAST, abs=2 * BEAM * 50 / FAST)


@pytest.mark.parametrize("mode", [1, 2, 3])
def test_power_set_before_the_light_goes_off_waits_for_the_beam(mode: int) -> None:
    """LINE, LASER POWER, LASER OFF: all of the mark has the power that it was run with."""
    sky = Sky(mode=mode, timelag=250.0)
    steps = [*head(sky), Step(op="on"), Step(op="line", at=(10000.0, 5000.0)), Step(op="power", value=20.0)]
    steps += [Step(op="off"), Step(op="jump", at=(0.0, 0.0))]
    steps += [Step(op="on"), Step(op="line", at=(10000.0, 0.0)), Step(op="off")]
    found = must(case_of(steps)).trace.channels[0].emitted
    assert found.power_ms.sum() == pytest.approx((5000.0 * 50 + 10000.0 * 20) / FAST, abs=2 * BEAM * 50 / FAST)


# Faults.


@pytest.mark.parametrize(
    ("at", "to", "what", "axis", "over"),
    [
        ((-149500.0, 0.0), (-100000.0, 0.0), "run-in", "X", -149.5 - 0.88 + 150.0),
        ((0.0, 100000.0), (0.0, 149252.0), "run-out", "Y", 149.252 + 0.75 - 150.0),
        ((0.0, -149122.0), (0.0, -140000.0), "run-in", "Y", -149.122 - 0.88 + 150.0),
    ],
)
def test_how_far_outside_the_field(at: Point, to: Point, what: str, axis: str, over: float) -> None:
    sky = Sky(mode=2, timelag=250.0)
    text = ref.job_text([*marked([*head(sky)[:-1], Step(op="jump", at=at)], to)])
    _, localized = compile_job(job_of(text), MACHINE)
    found = [f for f in localized if f.rule.code == "GJ808"]
    assert [(f.fields["what"], f.fields["axis"]) for f in found] == [(what, axis)]
    assert found[0].fields["over"] == pytest.approx(abs(over), abs=1.5e-3)


def test_inside_the_field_to_the_pulse() -> None:
    sky = Sky(mode=2, timelag=250.0)
    steps = marked([*head(sky)[:-1], Step(op="jump", at=(-149120.0, 0.0))], (149250.0, 0.0))
    assert not {f.rule.code for f in compiled(ref.job_text(steps))[1]} & {"GJ808"}


@pytest.mark.parametrize("circle", ["ARC CW I 0 J -3.9", "ARC CCW I 0.065", "ARC CW I 2 J 1"])
@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("start", ["X 28.009 Y -16.057", "X 28 Y -16", "X 0.003 Y 1.001", "X -0.007 Y 0.009"])
def test_a_full_circle_is_burnt_whole(circle: str, mode: int, start: str) -> None:
    top = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 100\nACC 1000000\n"
    body = f"JUMP {start}\nLASER ON\n{circle}\nLASER OFF\n"
    lit = run_job(top + f"SKYWRITE MODE {mode} TIMELAG 174us\n" + body)
    radius = {"-3.9": 3.9, "0.065": 0.065, "1": math.sqrt(5)}[circle.split()[-1]]
    assert sum(lit.column("ch0_emission_ms")) == pytest.approx(2 * math.pi * radius / 0.1, abs=0.05)


def test_mode_1_begins_at_its_start() -> None:
    """Also behind a mark of mode 2 without a jump in between: its reverse run is no arc from somewhere else."""
    sky = Sky(mode=2, timelag=250.0)
    steps = marked(head(sky), (15000.0, 5000.0))
    steps += [Step(op="sky", sky=replace(sky, mode=1)), Step(op="on")]
    steps += [Step(op="arc", at=(15000.0, 9000.0), centre=(15000.0, 7000.0)), Step(op="off")]
    on_circles(must(case_of(steps)))


@pytest.mark.parametrize("shift", [-100.0, 0.0, 100.0])
def test_light_that_changes_at_a_flat_corner(shift: float) -> None:
    """Off and on again where the path goes on: the light stays on, as at any flat corner of mode 3."""
    sky = Sky(mode=3, timelag=250.0, shift=shift)
    steps = marked(marked(head(sky), (15000.0, 5000.0)), (25000.0, 5000.0))
    stream, _ = compiled(ref.job_text(steps))
    emission = ran(stream).channels[0].emission
    total = float((emission.end_ms - emission.start_ms).sum())
    assert len(emission.start_ms) == 1
    assert total == pytest.approx(20.0 - shift / 1000, abs=2 * BEAM / FAST)


@pytest.mark.parametrize("first", [0, 1])
def test_another_channel_from_a_flat_corner_on(first: int) -> None:
    """One goes off TIMELAG behind the corner, the other on TIMELAG (and SHIFT) behind it."""
    sky = Sky(mode=3, timelag=250.0, shift=20.0)
    steps = [*head(sky), Step(op="power", value=50.0, channel=1), Step(op="on", channel=first)]
    steps += [Step(op="line", at=(15000.0, 5000.0)), Step(op="off", channel=first), Step(op="on", channel=1 - first)]
    steps += [Step(op="line", at=(25000.0, 5000.0)), Step(op="off", channel=1 - first)]
    trace = ran(compiled(ref.job_text(steps))[0])
    one, other = trace.channels[first].emission, trace.channels[1 - first].emission
    begin, end = one.start_ms[0] - 0.27, other.end_ms[0] - 0.25
    assert one.end_ms[0] == pytest.approx(begin + 10.0 + 0.25, abs=2 * BEAM / FAST)
    assert other.start_ms[0] == pytest.approx(begin + 10.0 + 0.27, abs=2 * BEAM / FAST)
    assert end == pytest.approx(begin + 20.0, abs=2 * BEAM / FAST)


def test_light_switched_off_at_rest_does_not_stand_in_the_way() -> None:
    text = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 100\nACC 1000\nLASER ON NOW\nLINE X 5\nLASER OFF NOW\n"
    assert "GJ801" not in {code for _, code in diagnostics_in(text + "SKYWRITE MODE 2 TIMELAG 250us\nLINE X 8\n")}


def test_dry_arcs_of_unequal_axes_are_one_mark() -> None:
    """An arc that becomes chords is run in and out of once, in modes 1 and 2 too."""
    machine = Machine(pulses_per_mm=(1000.0, 800.0))
    text = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 100\nACC 1000000\nSKYWRITE MODE 2 TIMELAG 250us\nLASER ON\n"
    stream, localized = compiled(text + "ARC CCW X 2 Y 2 I 0 J 2\nLASER OFF\n", machine)
    assert [f.rule.code for f in localized if f.severity is Severity.ERROR] == []
    trace = ran(stream, machine)
    assert len(trace.channels[0].emission.start_ms) == 1


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("arc", ["ARC CCW X 20 Y 10 R 5", "ARC CW I 5 J 2"])
def test_an_arc_on_unequal_axes_is_at_speed_all_the_way(arc: str, mode: int) -> None:
    """It becomes chords, but stays one mark: 50 % at 1000 mm/s are 50 %*ms/mm everywhere."""
    machine = replace(MACHINE, pulses_per_mm=(1000.0, 800.0))
    found = run_job(
        "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 1000\nACC 500000\n"
        f"SKYWRITE MODE {mode} TIMELAG 250us\nJUMP X 20 Y 0\nLASER ON\n{arc}\nLASER OFF\nJUMP X 0\n",
        replace(machine, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    assert found.report.marks is not None
    assert len(found.report.marks["line"]) == 1
    assert found.report.marks["power_per_mm_peak"] == pytest.approx([50], rel=5e-3)
    assert found.report.marks["power_per_mm_rms_pct"] == pytest.approx([0], abs=0.1)
    assert abs(found.report.marks["off_error_um"][0]) < 2


@pytest.mark.parametrize(("shift", "to"), [("5000", 10.0), ("299.5us", 5.3), ("6000", 10.0)])
def test_a_mark_that_stays_dark_is_refused(shift: str, to: float) -> None:
    """SHIFT as long as the mark, or longer, or shorter by less than a pulse."""
    text = (
        "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 1000\nACC 500000\n"
        f"SKYWRITE MODE 2 TIMELAG 250us SHIFT {shift}\nJUMP X 5\nLASER ON\nLINE X {to}\nLASER OFF\nJUMP X 0\n"
    )
    assert "GJ810" in {f.rule.code for f in compiled(text)[1]}


HEAD_MM = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 1000\nACC 1000000\n"
"""Up to 1000 mm/s in 1 ms and 500 um."""
LATE = replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0))


def said_of(text: str, machine: Machine = MACHINE) -> list[Diagnostic]:
    """What check and planning say, errors too."""
    job = job_of(text, machine)
    return [*check(job, machine), *compile_job(job, machine)[1]]


@pytest.mark.parametrize(("x", "y"), [(7, 3), (1.1, 5.3), (3, 7), (-2.3, 9.1), (8, 1), (5, -9)])
def test_straight_on_is_flat_for_any_limit(x: float, y: float) -> None:
    text = f"SKYWRITE MODE 3 TIMELAG 250us LIMIT 1\nLASER ON\nLINE X {x} Y {y}\nLINE X {2 * x} Y {2 * y}\nLASER OFF\n"
    assert len(moves_of(compiled(HEAD_MM + text)[0]).at) == len(
        moves_of(compiled(HEAD_MM + text.replace("LIMIT 1", "LIMIT 0.9"))[0]).at
    )


def test_a_round_of_a_loop_is_a_mark_of_its_own() -> None:
    """Lines of one statement are no pieces of an arc: each has its run-in of 880 um."""
    text = "SKYWRITE MODE 2 TIMELAG 250us\nLASER ON\nREPEAT 3 AS k\nLINE X (5 * k + 5) Y (k * k)\nEND\nLASER OFF\n"
    assert len(ran(compiled(HEAD_MM + text)[0]).channels[0].emission.start_ms) == 3


@pytest.mark.parametrize("radius", [0.5, 2.0])
def test_chords_of_an_arc_are_slowed_as_the_arc_is(radius: float) -> None:
    """v^2/r stays within the machine's acceleration at the narrowest place, where X has the finer pulses."""
    machine = replace(MACHINE, pulses_per_mm=(1000.0, 800.0))
    text = HEAD_MM.replace("1000\n", "9000\n").replace("1000000", "5000000") + "SKYWRITE MODE 2 TIMELAG 250us\n"
    found = run_job(f"{text}JUMP X 20\nLASER ON\nARC CCW I {radius} J 0\nLASER OFF\nJUMP X 0\n", machine).report.marks
    assert found is not None
    fastest = math.sqrt(machine.max_acceleration_pulse_per_ms2 * radius / 1000)
    assert 50 / fastest <= found["power_per_mm_mid"][0] <= 1.08 * 50 / fastest
    assert found["power_per_mm_rms_pct"][0] < 1


def test_each_stage_has_its_own_laser_delay() -> None:
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\n"
    for x, (on, off) in ((5, (20, 30)), (20, (100, 180)), (40, (0, 240))):
        text += f"LASER DELAY ON {on} OFF {off}\nJUMP X {x}\nLASER ON\nLINE X {x + 5}\nLASER OFF\nJUMP X {x + 9}\n"
    found = run_job(text, LATE).report.marks
    assert found is not None
    assert found["on_error_um"] == pytest.approx([0, 0, 0], abs=1e-6)
    assert found["off_error_um"] == pytest.approx([0, 0, 0], abs=1e-6)


@pytest.mark.parametrize(("lag", "furthest"), [(1500, 500), (4000, 4500)])
@pytest.mark.parametrize("then", ["DWELL 20", "WAIT"])
def test_a_run_out_in_front_of_a_rest_lasts_until_the_light_goes(lag: int, furthest: int, then: str) -> None:
    """Down in 1 ms and 500 um, back to E in 1.41 ms more: enough for 1.5 ms, not for 4."""
    text = HEAD_MM + f"SKYWRITE MODE 2 TIMELAG {lag}us NPREV 0 NPOST 0\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
    stream, localized = compiled(text + then + "\nJUMP X 0\n")
    assert [f for f in localized if f.severity is not Severity.NOTE] == []
    assert max(moves_of(stream).at) == (10000.0 + furthest, 0.0)


def test_jumps_at_corners_go_at_the_jumpvel_in_force_there() -> None:
    text = HEAD_MM + "JUMPVEL 3000\nSKYWRITE MODE 2 TIMELAG 250us\nJUMP X 5\nLASER ON\nLINE X 10\n"
    moves = moves_of(compiled(text + "JUMPVEL 2000\nLINE X 10 Y 5\nLASER OFF\nJUMP X 0\n")[0])
    assert [v for v in moves.vel if v != 1000.0] == [3000.0, 2000.0, 2000.0]


def test_a_jump_in_front_of_a_wait_goes_where_it_is_sent() -> None:
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us NPREV 0\nJUMP X 5\nWAIT\nLASER ON\nLINE X 10\nLASER OFF\nJUMP X 0\n"
    assert moves_of(compiled(text)[0]).at[:3] == [(5000.0, 0.0), (4500.0, 0.0), (5000.0, 0.0)]


@pytest.mark.parametrize(("length", "slow"), [(0.405, [("ends", 900.0)]), (0.485, [])])
def test_how_much_slower_a_mark_may_end(length: float, slow: list[tuple[str, float]]) -> None:
    """From rest at a flat corner v^2 = 2*a*s: 900 mm/s behind 405 um, 985 behind 485."""
    text = HEAD_MM + "SKYWRITE MODE 3 TIMELAG 250us LIMIT 0.5\nJUMP X 5\nLASER ON\nLINE X 10\n"
    text += f"LINE X {10 + 0.8 * length} Y {0.6 * length}\nLASER OFF\nJUMP X 0\n"
    found = [f.fields for f in said_of(text, Machine(lookahead_acc_pulse_per_ms2=1e-6)) if f.rule.code == "GJ811"]
    assert [(f["what"], f["value"]) for f in found] == [(what, pytest.approx(v, rel=1e-3)) for what, v in slow]


@pytest.mark.parametrize("other", [0, 1])
def test_light_that_changes_at_a_flat_corner_is_not_dark(other: int) -> None:
    """Off and on at one point, of one channel or of two, is no mark without light."""
    text = HEAD_MM + f"LASER MODE DUTY CARRIER 10 CHANNEL {other}\nLASER POWER 50 CHANNEL {other}\n"
    text += "SKYWRITE MODE 3 TIMELAG 250us\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
    text += f"LASER ON CHANNEL {other}\nLINE X 20\nLASER OFF CHANNEL {other}\n"
    assert [f.rule.code for f in said_of(text) if f.severity is not Severity.NOTE] == []


@pytest.mark.parametrize("other", [0, 1])
def test_messages_say_the_least_that_would_do(other: int) -> None:
    line, rule = (
        ("SKYWRITE MODE 2 TIMELAG 100us SHIFT -114.5us NPREV 11 NPOST 10\n", "GJ803"),
        ("LASER FOLLOW MIN 5 MAX 45 AT 500mm/s\nSKYWRITE MODE 2 TIMELAG 114.5us NPREV 11 NPOST 10\n", "GJ807"),
    )[other]
    found = [f for f in said_of(HEAD_MM + line + "LINE X 1\n") if f.rule.code == rule]
    assert [f.fields["least"] for f in found] == [12]


def test_the_worst_point_outside_the_field_is_told() -> None:
    """100 mm to -149.5 mm and 880 um more: -150.38."""
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\nJUMP X -149.5\nLASER ON\nLINE X -100\nLASER OFF\n"
    assert [f.fields["value"] for f in said_of(text) if f.rule.code == "GJ808"] == [pytest.approx(-150.38, abs=2e-3)]


def test_timelag_below_a_quarter_us_is_none() -> None:
    sky = SkyWriting(mode=2, timelag_us=0.25, shift_us=0, nprev=1, npost=1, limit=0, limit_given=False)
    lower = replace(sky, timelag_us=0.249)
    assert (sky.lag_us, lower.lag_us, lower.is_on, replace(sky, timelag_us=0.125).is_on) == (0.25, 0.0, True, True)
    assert not replace(sky, timelag_us=0.124).is_on


def test_a_wait_parts_marks_that_go_straight_on() -> None:
    text = HEAD_MM + "SKYWRITE MODE 3 TIMELAG 250us\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\nWAIT\nLASER ON\n"
    emission = ran(compiled(text + "LINE X 20\nLASER OFF\nJUMP X 0\n")[0]).channels[0].emission
    assert emission.end_ms - emission.start_ms == pytest.approx([5, 10], abs=2e-3)


def test_a_delay_does_not_hide_that_a_mark_is_dark() -> None:
    """On is called before off, but acts 100 us behind it."""
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 400us SHIFT 200us\nLASER DELAY ON 300 OFF 0\nJUMP X 5\nLASER ON\n"
    assert "GJ810" in {f.rule.code for f in said_of(text + "LINE X 5.1\nLASER OFF\nJUMP X 9\n")}


@pytest.mark.parametrize(("lag", "coarse"), [(300, False), (450, True)])
def test_light_that_goes_off_nearly_at_rest_is_told(lag: int, coarse: bool) -> None:
    """Braking from 500 mm/s in 0.5 ms: 200 mm/s at 0.3 ms, 50 at 0.45."""
    text = HEAD_MM.replace("VEL 1000", "VEL 500") + f"SKYWRITE MODE 2 TIMELAG {lag}us NPREV 75 NPOST 0\nJUMP X 1\n"
    said = said_of(text + "LASER ON\nLINE X 5\nLASER OFF\nJUMP X 0\n")
    assert ("GJ812" in {f.rule.code for f in said}) == coarse


def test_a_run_in_that_leaves_its_circle_keeps_its_speed() -> None:
    """Half a turn of 63 um is too short to reach 140 mm/s at 100 pulse/ms2: 98 um."""
    text = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 140\nACC 100000\nSKYWRITE MODE 2 TIMELAG 250us\n"
    said = said_of(text + "JUMP X 5\nLASER ON\nARC CCW I 0.02 J 0\nLASER OFF\nJUMP X 0\n")
    assert [f.rule.code for f in said if f.severity is not Severity.NOTE] == []


def test_a_run_in_may_leave_the_field_between_its_ends() -> None:
    """Centre 149.505 mm to the left, radius 0.5: S is 0.3 rad behind the leftmost point, P 0.63 rad before S."""
    x, y = -149.505 - 0.5 * math.cos(0.3), -0.5 * math.sin(0.3)
    to = f"X {-149.505 - 0.5 * math.cos(1.8):.6f} Y {-0.5 * math.sin(1.8):.6f} R 0.5"
    text = HEAD_MM.replace("VEL 1000", "VEL 500") + f"SKYWRITE MODE 2 TIMELAG 250us\nJUMP X {x:.6f} Y {y:.6f}\n"
    found = [f.fields for f in said_of(text + f"LASER ON\nARC CCW {to}\nLASER OFF\n") if f.rule.code == "GJ808"]
    assert [(f["what"], f["value"]) for f in found] == [("run-in", pytest.approx(-150.005, abs=1.5e-3))]


def test_each_axis_has_its_own_field() -> None:
    text = HEAD_MM + "SKYWRITE MODE 2 TIMELAG 250us\nJUMP Y 40\nLASER ON\nLINE Y 49.5\nLASER OFF\nJUMP Y 0\n"
    said = said_of(text, replace(MACHINE, field_y_mm=(-50.0, 50.0)))
    assert [f.fields["axis"] for f in said if f.rule.code == "GJ808"] == ["Y"]


def test_light_comes_at_the_start_of_a_full_circle_not_at_its_end() -> None:
    """A quarter of a pulse behind S, which is E too."""
    text = HEAD_MM.replace("VEL 1000", "VEL 500") + "SKYWRITE MODE 2 TIMELAG 0.5us NPREV 10 NPOST 10\nJUMP X 5\n"
    emission = ran(compiled(text + "LASER ON\nARC CCW I 1 J 0\nLASER OFF\nJUMP X 0\n")[0]).channels[0].emission
    assert emission.end_ms - emission.start_ms == pytest.approx([math.tau / 0.5], abs=0.02)


@pytest.mark.parametrize(("lag", "late"), [(2410, []), (2420, [5.8])])
def test_how_long_the_light_may_take_behind_the_last_mark(lag: int, late: list[float]) -> None:
    """Mode 1: down in 1 ms, back to E in sqrt(2) ms."""
    text = HEAD_MM + f"SKYWRITE MODE 1 TIMELAG {lag}us NPREV 0 NPOST 0\nJUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\n"
    said = said_of(text, Machine(lookahead_acc_pulse_per_ms2=1e-6))
    assert [f.fields["early"] for f in said if f.rule.code == "GJ809"] == [pytest.approx(v, abs=0.1) for v in late]


_PATHS = {
    "line": ("LINE X 25 Y 3.5\n", 1),
    "arc": ("ARC CCW X 20 Y 10 R 5\n", 1),
    "circle": ("ARC CW I -3 J 2\n", 1),
    "polyline": ("LINE X 23\nLINE X 26 Y 0.3\nARC CCW X 26.3 Y 3 R 2\nLINE X 22 Y 5\n", None),
}


@pytest.mark.parametrize("power", ["LASER POWER 50", "LASER FOLLOW MIN 1 MAX 50 AT 800"])
@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("path", _PATHS)
def test_a_report_of_any_mark_is_even_and_in_place(path: str, mode: int, power: str) -> None:
    """With the pure delay for which TIMELAG stands: ends within a pulse, 50 % at 800 mm/s everywhere, none outside."""
    lines, count = _PATHS[path]
    found = run_job(
        f"LASER MODE DUTY CARRIER 10\n{power}\nVEL 800\nACC 500000\n"
        f"SKYWRITE MODE {mode} TIMELAG 250us NPREV 60 NPOST 60 LIMIT 0.999\n"
        f"JUMP X 20 Y 0\nLASER ON\n{lines}LASER OFF\nJUMP X 0\n",
        replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    marks = found.report.marks
    assert marks is not None
    assert len(marks["line"]) == (count or 4)
    for name in ("on_error_um", "off_error_um", "on_miss_um", "off_miss_um"):
        assert np.abs(marks[name]).max() <= 2, name
    assert marks["outside_power_ms"].max() <= 50 * 2 / 800
    assert marks["power_per_mm_mid"] == pytest.approx(50 / 0.8, rel=1e-3)
    # Half a pulse where an arc is split is 1 % of one bin of 50 um, and 0.13 % of sixty.
    assert marks["power_per_mm_rms_pct"] == pytest.approx(0, abs=0.1 if path in ("line", "circle") else 0.15)


def test_a_killer_that_is_off_again_delays_nothing() -> None:
    found = run_job(
        "LASER MODE FREQUENCY WIDTH 5us MAX 100\nLASER FPK WIDTH 20 GAP 0 OFFDELAY 90\nLASER FPK OFF\n"
        "SKYWRITE MODE 2 TIMELAG 250us\nLASER POWER 30\nVEL 800\nACC 500000\n"
        "JUMP X 5\nLASER ON\nLINE X 9\nLASER OFF\nJUMP X 0\n",
        replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    assert found.report.marks is not None
    assert found.report.marks["off_error_um"] == pytest.approx([0], abs=1)


def test_two_channels_wait_each_for_its_own() -> None:
    """Channel 1 is set while channel 0 is on its way: neither holds up the other."""
    found = run_job(
        "LASER MODE DUTY CARRIER 10\nLASER MODE DUTY CARRIER 10 CHANNEL 1\nLASER DELAY ON 5 OFF 5\n"
        "LASER DELAY ON 200 OFF 210 CHANNEL 1\nLASER POWER 50\nLASER POWER 20 CHANNEL 1\nVEL 800\nACC 500000\n"
        "SKYWRITE MODE 3 TIMELAG 250us NPREV 60 NPOST 60\nJUMP X 5\nLASER ON\nLINE X 9\nLASER ON CHANNEL 1\nLINE X 12\n"
        "LASER OFF\nLASER OFF CHANNEL 1\nJUMP X 0\n",
        replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0)),
    )
    marks = found.report.marks
    assert marks is not None
    assert marks["channel"].tolist() == [0, 1]
    assert marks["length_mm"] == pytest.approx([7, 3], abs=2e-3)
    assert np.abs(marks["on_error_um"]).max() <= 1
    assert np.abs(marks["off_error_um"]).max() <= 1
