"""Helpers for tests of sky writing: random jobs, and a planned path compared with the oracle's."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from random import Random

import numpy as np
import pytest
from msgspec.structs import replace
from oracles import skywriting as ref
from oracles.skywriting import Leg, Planned, Point, Sky, Step
from support.tools import MACHINE, job_of

from gusjob.config.machine import Machine, Scanner, ScannerModel
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.lower import compile_job
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.lint import check
from gusjob.simulate import Trace

SEEDS = int(os.environ.get("SKYWRITE_SEEDS", "150"))

"""Random jobs of each kind. Set it high to search for long."""

NEAR = math.sqrt(2) + 1e-6

"""Whole pulses: a point may lie so far from the ideal one."""

LONGER = NEAR + 3

"""The same on a circle: a run is made longer until its arc, with rounded ends and centre, is long enough."""

LIKE_LINE = 2.0
"""A part of an arc that is no longer, in pulses, may be a line: the controller could draw the whole circle."""
BEAM = 1.5

"""Error of the beam at laser-on and laser-off: a switch is at a whole pulse."""

LEAST_ACC = 100.0

"""Least acceleration of random jobs, pulse/ms2."""

HALF = math.sqrt(0.5) + 1e-6

"""A point that is not whole is rounded by so much at most."""

HARD = {"GJ704", "GJ705", "GJ706"}

"""END_NOT_MET, START_TOO_FAST, STOPS_HARD: compiled jobs must not have them."""

# Random jobs.
_ROUND = [(x, y) for x in range(-65, 66) for y in range(-65, 66) if x * x + y * y == 65 * 65]

"""36 whole points on a circle."""


@dataclass
class Jobs:
    """Writes random jobs. All points are whole pulses, also those of arcs; but not those of fine curves."""

    rng: Random
    modes: tuple[int, ...] = (1, 2, 3)
    bent: bool = True
    """Arcs and corners that look-ahead slows down, LOOKAHEAD OFF."""
    heading: Point | None = None
    """Of the mark before: a line to a whole point."""

    def one_in(self, n: int) -> bool:
        return self.rng.randrange(n) == 0

    def point(self) -> Point:
        return float(self.rng.randint(-40000, 40000)), float(self.rng.randint(-40000, 40000))

    def sky(self) -> Sky:
        rng = self.rng
        lag = rng.choice((0.2, 5.0, 100.0, 174.0, 250.0, 320.0, 333.3))
        shift = rng.choice((0.0, 0.0, 0.5, -0.5, 20.0, -40.0, -round(lag / 2)))
        nprev, npost = rng.choice(
            ((None, None), (None, None), (11, 9), (30, 60), (40, None), (60, 70), (30, 0), (0, 5))
        )
        limit = rng.choice((None, None, 0.5, 0.0, 0.99))
        mode = rng.choice(self.modes)
        return Sky(mode=mode, timelag=lag, shift=shift, nprev=nprev, npost=npost, limit=limit if mode == 3 else None)

    def speeds(self, steps: list[Step], every: bool = False) -> None:
        rng = self.rng
        for op, values in (
            ("vel", (50.0, 200.0, 1000.0, 2500.0)), ("acc", (LEAST_ACC, 250.0, 1000.0)),
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

    def curve(self, here: Point) -> list[Step]:
        """A curve of short lines between points that are not whole: pulses make corners of their own."""
        rng, found = self.rng, []
        long, angle = rng.choice((0.8, 3.0, 12.0)), rng.uniform(0, math.tau)
        turn = rng.uniform(-0.1, 0.1)
        x, y = here
        for _ in range(rng.randint(2, 40)):
            x, y = round(x + long * math.cos(angle), 3), round(y + long * math.sin(angle), 3)
            found.append(Step(op="line", at=(x, y)))
            angle += turn
        return found

    def block(self, steps: list[Step], here: Point) -> Point:
        """Motions to a mark, laser on, marks, laser off."""
        rng = self.rng
        written = [s.sky for s in steps if s.op == "sky"][-1]
        least = 1 if written is not None and written.mode == 3 else 0  # Switches at a flat corner: tested elsewhere.
        for _ in range(max(rng.choice((0, 1, 1, 1, 2)), least)):
            step = rng.choice((Step(op="jump", at=self.point()), Step(op="line", at=self.point()), self.arc(here)))
            if self.heading is not None and self.one_in(3):  # Straight on, as in a dashed line.
                k = max(round(rng.choice((300.0, 2000.0, 9000.0)) / math.hypot(*self.heading)), 1)
                step = Step(op="jump", at=(here[0] + k * self.heading[0], here[1] + k * self.heading[1]))
            if max(map(abs, here)) > 60000:
                step = Step(op="jump", at=self.point())
            self.heading = None
            steps.append(step)
            here = step.at
        if self.one_in(5):
            steps.append(Step(op="dwell", value=float(rng.randint(1, 3))))
        if self.one_in(3):
            steps.append(Step(op="power", value=float(rng.randint(5, 90)), channel=rng.randrange(2)))
        channels_on = rng.choice(((0,), (0,), (1,), (0, 1)))
        steps += [Step(op="on", channel=c) for c in channels_on]
        heading: Point | None = None
        for number in range(rng.choice((1, 1, 2, 3, 5))):
            if number and self.one_in(6):
                steps.append(Step(op="power", value=float(rng.randint(5, 90)), channel=channels_on[0]))
            step = self.mark(here, heading)
            if self.bent and least and self.one_in(4):
                steps += self.curve(here)[:-1]
                step = Step(op="line", at=(float(round(steps[-1].at[0] + 7)), float(round(steps[-1].at[1] - 4))))
                here = steps[-1].at
            steps.append(step)
            heading = (step.at[0] - here[0], step.at[1] - here[1]) if step.op == "line" else None
            if heading is not None and not (heading[0].is_integer() and heading[1].is_integer()):
                heading = None
            if heading is not None:
                whole = math.gcd(int(heading[0]), int(heading[1]))
                heading = heading[0] / whole, heading[1] / whole
            here = step.at
        self.heading = heading
        steps += [Step(op="off", channel=c) for c in channels_on]
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
    """For each leg the number of its last motion; a leg may be split anywhere.

    All assignments of motions to legs are followed at once. Ends of marks must be met exactly, if they are whole.
    """
    furthest = 0
    run = NEAR if all(_is_whole(leg.way.end) for leg in legs if leg.role == "mark") else NEAR + HALF
    assigned: dict[int, tuple[int, ...]] = {0: ()}
    for number, at in enumerate(moves.at):
        after: dict[int, tuple[int, ...]] = {}
        for done, ends in assigned.items():
            if done == len(legs) or not _runs(legs[done], moves, number):
                continue
            leg = legs[done]
            exact = leg.role == "mark" or (done + 1 < len(legs) and legs[done + 1].role == "mark")
            exact = exact or (leg.role in ("jump", "dark", "added") and _is_whole(leg.way.end))
            bent = any(one.way.centre is not None for one in legs[done : done + 3])
            near = (1e-6 if _is_whole(leg.way.end) else HALF) if exact else LONGER if bent else run
            if math.dist(at, leg.way.end) <= near:
                after.setdefault(done + 1, (*ends, number))
            # A jump begins where the run on a circle before it ends.
            behind_arc = leg.role in ("jump", "dark", "added") and done > 0 and legs[done - 1].way.centre is not None
            if leg.role != "dwell" and leg.way.distance(at) <= (LONGER if behind_arc else BEAM):
                after.setdefault(done, ends)
        if not after:
            expected = legs[furthest] if furthest < len(legs) else None
            raise AssertionError(f"motion {number} to {at} (v {moves.vel[number]:g}) is none of {furthest}: {expected}")
        assigned, furthest = after, max(after)
    assert len(legs) in assigned, f"{len(legs)} motions expected, {furthest} found; the next: {legs[furthest]}"
    return list(assigned[len(legs)])


def _is_whole(at: Point) -> bool:
    return at[0] == int(at[0]) and at[1] == int(at[1])


def _runs(leg: Leg, moves: Moves, number: int) -> bool:
    """Whether a motion can be a leg, or a part of it, by kind and speed."""
    kind = moves.kind[number]
    if leg.role == "dwell" or kind == Buffered.DELAY:
        return leg.role == "dwell" and kind == Buffered.DELAY and moves.dwell[number] == leg.dwell
    is_short = math.dist(moves.at[number], moves.at[number - 1] if number else (0.0, 0.0)) <= LIKE_LINE
    if (leg.way.centre is None) != (kind == Buffered.LINE) and not (leg.way.centre is not None and is_short):
        return False
    if leg.way.centre is not None and kind != Buffered.LINE and moves.ccw[number] != (leg.way.sweep > 0):
        return False
    return math.isclose(moves.vel[number], leg.vel, rel_tol=1e-2 if leg.way.centre else 1e-9) and math.isclose(
        moves.acc[number], leg.acc, rel_tol=1e-9
    )


def compiled(text: str, machine: Machine = MACHINE) -> tuple[Stream, list[Diagnostic]]:
    """The calls of a job that must be without an error, and all diagnostics."""
    job = job_of(text, machine)
    found = check(job, machine)
    assert [f.message for f in found if f.severity is Severity.ERROR] == []
    stream, diagnostics = compile_job(job, machine)
    return stream, [*found, *diagnostics]


def ran(stream: Stream, machine: Machine = MACHINE) -> Trace:
    """Simulate a stream that must have no error."""
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
    """A job that must be planned as by the oracle; None where a switch has no motion, or no mark."""
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
    arcs = set(case.trace.segments.arc_at.tolist())
    first = 0
    for leg, last in zip(case.plan.legs, case.ends, strict=True):
        for motion in range(first, last + 1):
            if motion in arcs:
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


def emissions(case: Case) -> None:
    """As many emissions as marks and channels; each begins at S and ends at E for a beam that lags by TIMELAG."""
    for channel in (0, 1):
        marks = [m for m in case.plan.marks if channel in m.rows[0].channels_on]
        found = [c.emission for c in case.trace.channels if c.channel == channel]
        count = len(found[0].start_ms) if found else 0
        assert count == len(marks) + _plain_emissions(case.steps, channel), (channel, len(marks))
        # Nothing but marks between the first and the last: emission of marks without sky writing is in between.
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
    steady = slow > v / 1.05  # Near standstill a pulse takes long.
    if steady:
        assert math.dist(beam, at) <= BEAM, f"{what}: beam {math.dist(beam, at):.3f} pulse off"
    assert abs(moment - passed - late_us / 1000) <= (0.1 if steady else math.sqrt(2 * BEAM / LEAST_ACC))


def _plain_emissions(steps: list[Step], channel: int) -> int:
    """Emissions of marks without sky writing: a laser that goes off and on between two motions stays on."""
    rows = ref.rows_of(steps)
    channels_on = [channel in row.channels_on and row.kind != "dwell" and row.sky is None for row in rows]
    same = [False, *(a and b.stage == c.stage for a, b, c in zip(channels_on, rows, rows[1:], strict=False))]
    return sum(now and not before for now, before in zip(channels_on, same, strict=True))


CHECKS = (on_circles, at_speed, emissions)

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


HEAD_MM = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 1000\nACC 1000000\n"

"""Up to 1000 mm/s in 1 ms and 500 um."""

LATE = replace(MACHINE, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=250.0))


def diagnostics_of(text: str, machine: Machine = MACHINE) -> list[Diagnostic]:
    """Diagnostics of lint and planner, errors included."""
    job = job_of(text, machine)
    return [*check(job, machine), *compile_job(job, machine)[1]]
