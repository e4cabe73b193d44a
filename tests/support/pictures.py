"""The pictures of the language reference: SVG, drawn from the interpreter's own trace of a job.

Bytes are the same everywhere: numbers are rounded, and a little off the ties, so that the last digits of a sum or an
exponential do not matter. Dark text on a white panel: legible in light and dark themes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt
from msgspec import structs
from support.tools import MACHINE, stream_of

from gusjob.config.machine import Machine, parse_scanner
from gusjob.controllers.gus.model import simulate_stream
from gusjob.simulate import Trace
from gusjob.simulate.kinds import SegmentKind
from gusjob.simulate.quality.energy_bins import BIN_MM
from gusjob.simulate.quality.mark_ends import mark_ends_of

Floats = npt.NDArray[np.float64]

VEL, ACC, LAG_US = 1000.0, 1e6, 250.0
"""Of the marks in all pictures: mm/s, mm/s2, us."""
NPREV, NPOST = 38, 25
"""What AUTO makes of the lag, in 10 us."""

HEAD = f"""LASER MODE DUTY CARRIER 20kHz
LASER POWER 50
VEL {VEL:g}mm/s
ACC {ACC:g}mm/s2
JUMPVEL 2000mm/s
"""

ROW = ((1.0, -2.0), (4.0, -2.0), (6.819, -0.974), (4.521, 0.954))
"""Three sides, 3 mm each: a flat corner (20 degrees) and a sharp one (60 degrees between the sides), mm."""
CORNER = ((1.0, -1.5), (4.0, -1.5), (2.5, 1.098))
"""Two sides, 3 mm each, 60 degrees between them, mm."""

INK, FAINT, EDGE = "#1f2328", "#57606a", "#d0d7de"
LIGHT, BEAM, COMMAND = "#ffb37a", "#0b5fd0", "#d5dbe1"
COLOURS = {"jump": "#8c959f", "run-in": "#0b5fd0", "mark": "#b42318", "run-out": "#1a7f37"}
HEAT = ((1.0, (255, 170, 60)), (2.0, (225, 60, 20)), (5.0, (90, 0, 10)))
"""Energy per mm in times of what is wanted, and its colour; between them in proportion."""


class Point(NamedTuple):
    """A point or a direction: mm, or px."""

    x: float
    y: float

    def plus(self, way: Point, times: float = 1.0) -> Point:
        """So many times `way` from here."""
        return Point(self.x + way.x * times, self.y + way.y * times)

    def to(self, end: Point) -> Point:
        """Unit direction to a point; (0, 0) if that is here."""
        x, y = end.x - self.x, end.y - self.y
        length = math.hypot(x, y)
        return Point(x / length, y / length) if length > 0 else Point(0.0, 0.0)

    def away(self, other: Point) -> float:
        """Distance to a point."""
        return math.hypot(other.x - self.x, other.y - self.y)


def number(value: float) -> str:
    """At most two decimals; what lies on a tie is pushed up, whatever its last digits are."""
    shown = f"{value + 3e-7:.2f}".rstrip("0").rstrip(".")
    return "0" if shown == "-0" else shown


@dataclass(slots=True)
class Canvas:
    """A picture in the making, px."""

    width: int
    height: int
    label: str
    lines: list[str] = field(default_factory=list)

    def add(self, name: str, **values: object) -> None:
        """An element; `_` in a name stands for `-`, a trailing one for nothing."""
        self.lines.append(f"<{name}{_attributes(values)}/>")

    def path(self, points: Iterable[Point], **values: object) -> None:
        """A line through points."""
        at = " ".join(f"{number(p.x)},{number(p.y)}" for p in points)
        self.add("polyline", points=at, fill="none", **values)

    def dot(self, at: Point, radius: float, **values: object) -> None:
        """A circle."""
        self.add("circle", cx=at.x, cy=at.y, r=radius, **values)

    def text(self, at: Point, words: str, size: int = 12, anchor: str = "start", **values: object) -> None:
        """A line of text, its base line at `at`."""
        shown = _attributes({"x": at.x, "y": at.y, "font_size": size, "text_anchor": anchor, "fill": INK, **values})
        self.lines.append(f"<text{shown}>{escape(words)}</text>")

    def panel(self, at: Point, width: float, height: float, title: str, under: str = "") -> None:
        """A white panel with a title."""
        self.add(
            "rect", x=at.x + 0.5, y=at.y + 0.5, width=width - 1, height=height - 1, rx=6, fill="#ffffff", stroke=EDGE
        )
        if title:
            self.text(at.plus(Point(12, 22)), title, 14, font_weight="bold")
        if under:
            self.text(at.plus(Point(12, 40)), under, 12, fill=FAINT)

    def arrow(self, start: Point, end: Point, colour: str) -> None:
        """The head of an arrow in the middle of a line, if that is long enough."""
        along = start.to(end)
        if start.away(end) < 16:
            return
        tip = start.plus(Point(end.x - start.x, end.y - start.y), 0.5).plus(along, 4)
        back, side = tip.plus(along, -8), Point(-along.y, along.x)
        corners = (tip, back.plus(side, 3.5), back.plus(side, -3.5))
        self.add("polygon", points=" ".join(f"{number(p.x)},{number(p.y)}" for p in corners), fill=colour)

    def group(self, name: str) -> None:
        """What follows belongs together, until `close`."""
        self.lines.append(f'<g id="{name}">')

    def close(self) -> None:
        """End of the group."""
        self.lines.append("</g>")

    def svg(self) -> str:
        """The file."""
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{self.width}" height="{self.height}" '
            f'viewBox="0 0 {self.width} {self.height}" font-family="sans-serif" role="img">'
        )
        return "\n".join([head, f"<title>{escape(self.label)}</title>", *self.lines, "</svg>", ""])


def _attributes(values: dict[str, object]) -> str:
    def shown(value: object) -> str:
        return number(float(value)) if isinstance(value, int | float) else escape(str(value), {'"': "&quot;"})

    return "".join(f' {name.rstrip("_").replace("_", "-")}="{shown(value)}"' for name, value in values.items())


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """From mm to px: the origin's place, and px per mm."""

    origin: Point
    scale: float

    def px(self, at: Point) -> Point:
        """Where a point is drawn."""
        return Point(self.origin.x + at.x * self.scale, self.origin.y - at.y * self.scale)


# What the trace holds.


@dataclass(frozen=True, slots=True, kw_only=True)
class Leg:
    """A straight piece of the commanded path, mm: jump, run-in, mark or run-out."""

    role: str
    start: Point
    end: Point


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """Of one emission interval, mm: S, E and the corners between; where the command is at light on and off."""

    points: tuple[Point, ...]
    on: Point
    off: Point
    lit: tuple[Point, ...]
    """The command's way from light on to light off."""


def run(text: str, machine: Machine = MACHINE) -> Trace:
    """The trace of a job in which there is nothing to find fault with."""
    trace, diagnostics = simulate_stream(stream_of(text, machine), machine)
    assert trace is not None
    assert [f.message for f in diagnostics] == []
    return trace


def _points(trace: Trace) -> list[Point]:
    """Start of the first timed call, and the end of each, mm."""
    laid, (px, py) = trace.segments, MACHINE.pulses_per_mm
    first = [Point(float(laid.x0[0]) / px, float(laid.y0[0]) / py)]
    return first + [Point(float(x) / px, float(y) / py) for x, y in zip(laid.x1, laid.y1, strict=True)]


def legs_of(trace: Trace) -> list[Leg]:
    """The commanded path; what the planner split on a straight line is one leg again."""
    ends, points = mark_ends_of(trace, MACHINE, trace.channels[0]), _points(trace)
    motions = zip(ends.first_motion.tolist(), ends.last_motion.tolist(), strict=True)
    marked = {c for a, b in motions for c in range(a, b + 1)}
    legs: list[Leg] = []
    for cell in range(len(trace)):
        meant = SegmentKind(int(trace.kind[cell]))
        role = (
            "mark"
            if cell in marked
            else {SegmentKind.RUN_IN: "run-in", SegmentKind.RUN_OUT: "run-out"}.get(meant, "jump")
        )
        leg = Leg(role=role, start=points[cell], end=points[cell + 1])
        if legs and legs[-1].role == role and _straight_on(legs[-1], leg):
            legs[-1] = replace(legs[-1], end=leg.end)
        else:
            legs.append(leg)
    return legs


def _straight_on(leg: Leg, follower: Leg) -> bool:
    a, b = leg.start.to(leg.end), follower.start.to(follower.end)
    return a.x * b.x + a.y * b.y > 0.999


def marks_of(trace: Trace) -> list[Mark]:
    """The marks of the first laser."""
    ends, points = mark_ends_of(trace, MACHINE, trace.channels[0]), _points(trace)
    shine, times = trace.channels[0].emission, trace.schedule.times_ms
    marks = []
    for k, (start, end) in enumerate(zip(shine.start_ms.tolist(), shine.end_ms.tolist(), strict=True)):
        between = np.flatnonzero((times > start) & (times < end)).tolist()
        on, off = command_at(trace, start), command_at(trace, end)
        inner = [points[c + 1] for c in range(int(ends.first_motion[k]), int(ends.last_motion[k]) + 1)]
        inner.insert(0, points[int(ends.first_motion[k])])
        marks.append(Mark(points=tuple(inner), on=on, off=off, lit=(on, *(points[c] for c in between), off)))
    return marks


def command_at(trace: Trace, time: float) -> Point:
    """Where the command is, mm."""
    cell = int(np.clip(np.searchsorted(trace.schedule.times_ms, time, side="right") - 1, 0, len(trace) - 1))
    x, y = trace.motion.position(np.array([cell]), np.array([time]))
    return Point(float(x[0]) / MACHINE.pulses_per_mm[0], float(y[0]) / MACHINE.pulses_per_mm[1])


def beam_at(trace: Trace, time: Floats) -> tuple[Floats, Floats]:
    """Where the beam is, mm."""
    x, y = trace.beam.position(np.zeros(len(time), dtype=np.intp), time)
    return x / MACHINE.pulses_per_mm[0], y / MACHINE.pulses_per_mm[1]


# The commanded path.


def skywrite_job(mode: int, shift_us: float = 0.0) -> str:
    """The row of three sides in one of the modes."""
    start, *rest = ROW
    sides = "".join(f"LINE X {x:g} Y {y:g}\n" for x, y in rest)
    sky = f"SKYWRITE MODE {mode} TIMELAG {LAG_US:g}us SHIFT {shift_us:g}us\n"
    return f"{HEAD}{sky}JUMP X {start[0]:g} Y {start[1]:g}\nLASER ON\n{sides}LASER OFF\nJUMP X 0 Y 0\n"


SKY_VIEWS = {
    2: View(origin=Point(72, 186), scale=84),
    1: View(origin=Point(29, 524), scale=44),
    3: View(origin=Point(431, 524), scale=44),
}
"""Where each mode is drawn."""


def skywrite_picture() -> str:
    """One row of three sides in modes 2, 1 and 3."""
    canvas = Canvas(800, 722, "The commanded path of three sides with SKYWRITE in modes 1, 2 and 3")
    canvas.panel(Point(0, 0), 800, 412, "Mode 2: each side by itself, jumps from run-out to run-in")
    canvas.panel(Point(0, 420), 396, 230, "Mode 1: back and forth at each end")
    canvas.panel(Point(404, 420), 396, 230, "Mode 3: flat corners go on without a break")
    canvas.panel(Point(0, 658), 800, 64, "")
    for mode, view in SKY_VIEWS.items():
        canvas.group(f"mode-{mode}")
        _draw_sky(canvas, view, run(skywrite_job(mode)), letters=mode == 2)
        canvas.close()
    _scale_bar(canvas, Point(650, 390), SKY_VIEWS[2].scale)
    _scale_bar(canvas, Point(296, 632), SKY_VIEWS[1].scale)
    _scale_bar(canvas, Point(700, 632), SKY_VIEWS[3].scale)
    _sky_legend(canvas)
    return canvas.svg()


def _draw_sky(canvas: Canvas, view: View, trace: Trace, *, letters: bool) -> None:
    legs, marks = legs_of(trace), marks_of(trace)
    for mark in marks:
        canvas.path(
            map(view.px, mark.lit), class_="light", stroke=LIGHT, stroke_width=11 if letters else 9,
            stroke_linejoin="round",
        )  # fmt: skip
    for at, leg in enumerate(legs):
        _draw_leg(canvas, view, legs, at, leg)
    home = view.px(legs[0].start)
    canvas.dot(home, 3, fill=FAINT)
    for mark in marks:
        for place in (mark.points[0], mark.points[-1]):
            canvas.dot(view.px(place), 2.5, class_="end", fill=INK)
        canvas.dot(view.px(mark.on), 4.5, class_="on", fill="#ffdd00", stroke=INK, stroke_width=1.5)
        canvas.dot(view.px(mark.off), 4.5, class_="off", fill="#ffffff", stroke=INK, stroke_width=1.5)
    if letters:
        _letters(canvas, view, legs, marks)
        _measures(canvas, view, marks)
    else:
        _few_letters(canvas, view, marks)


def _draw_leg(canvas: Canvas, view: View, legs: list[Leg], at: int, leg: Leg) -> None:
    """A leg; one that goes back on its neighbour is drawn a little beside it."""
    start, end = view.px(leg.start), view.px(leg.end)
    along = start.to(end)
    beside = Point(-along.y * 5, along.x * 5)
    points, first = [start, end], 0
    if leg.role == "run-in" and legs[at + 1].role == "run-in":
        points = [start.plus(beside), end.plus(beside), end]
    if leg.role == "run-out" and legs[at - 1].role == "run-out":
        points, first = [start, start.plus(beside), end.plus(beside)], 1
    dashes: dict[str, object] = {"stroke_dasharray": "5 4"} if leg.role == "jump" else {}
    width = 1.5 if leg.role == "jump" else 2.5
    canvas.path(points, class_=leg.role, stroke=COLOURS[leg.role], stroke_width=width, **dashes)
    canvas.arrow(points[first], points[first + 1], COLOURS[leg.role])


def _letters(canvas: Canvas, view: View, legs: list[Leg], marks: list[Mark]) -> None:
    """P, S, E, Q where there is room: behind run-ins, before run-outs, inside of flat and outside of sharp corners."""
    for leg in legs:
        start, end = view.px(leg.start), view.px(leg.end)
        along = start.to(end)
        if leg.role == "run-in":
            _letter(canvas, start.plus(along, -12), "P")
        if leg.role == "run-out":
            _letter(canvas, end.plus(along, 12), "Q")
    for before, after in zip([None, *marks], [*marks, None], strict=True):
        come = Point(0, 0) if before is None else view.px(before.points[-2]).to(view.px(before.points[-1]))
        leave = Point(0, 0) if after is None else view.px(after.points[0]).to(view.px(after.points[1]))
        if before is None and after is not None:
            _letter(canvas, view.px(after.points[0]).plus(Point(leave.y, -leave.x), 16), "S")
        elif after is None and before is not None:
            _letter(canvas, view.px(before.points[-1]).plus(Point(come.y, -come.x), 16), "E")
        elif before is not None:
            inside = Point(0, 0).to(Point(leave.x - come.x, leave.y - come.y))
            sharp = come.x * leave.x + come.y * leave.y < 0
            _letter(canvas, view.px(before.points[-1]).plus(inside, -39 if sharp else 22), "E, S")


def _few_letters(canvas: Canvas, view: View, marks: list[Mark]) -> None:
    """S and E at both ends of all."""
    first, last = marks[0].points, marks[-1].points
    leave, come = view.px(first[0]).to(view.px(first[1])), view.px(last[-2]).to(view.px(last[-1]))
    _letter(canvas, view.px(first[0]).plus(Point(-leave.y, leave.x), 16), "S")
    _letter(canvas, view.px(last[-1]).plus(Point(come.y, -come.x), 18), "E")


def _letter(canvas: Canvas, at: Point, word: str) -> None:
    canvas.text(at.plus(Point(0, 4.5)), word, 13, "middle", font_weight="bold")


def _measures(canvas: Canvas, view: View, marks: list[Mark]) -> None:
    """Lengths at the first S and at the last E."""
    start, end = marks[0].points, marks[-1].points
    along, out = start[0].to(start[1]), end[-2].to(end[-1])
    run_in, run_out = _run_mm(NPREV), _run_mm(NPOST)
    _measure(canvas, view, (start[0].plus(along, -run_in), start[0]), f"run-in {run_in:.2f} mm", 22)
    _measure(canvas, view, (start[0], marks[0].on), f"v*TIMELAG {start[0].away(marks[0].on):.2f} mm", 22, ahead=True)
    _measure(canvas, view, (end[-1], end[-1].plus(out, run_out)), f"run-out {run_out:.2f} mm", 42)
    _measure(canvas, view, (end[-1], marks[-1].off), f"v*TIMELAG {end[-1].away(marks[-1].off):.2f} mm", 18)


def _run_mm(steps: int) -> float:
    """Length of a run: what speeding up takes, and the steps of 10 us at mark speed."""
    return VEL**2 / (2 * ACC) + VEL * steps * 1e-5


def _measure(
    canvas: Canvas, view: View, span: tuple[Point, Point], words: str, beside: float, *, ahead: bool = False
) -> None:
    """A length with its words, so far to the right of the way (seen along it), px; `ahead`: words before its end."""
    start, end = view.px(span[0]), view.px(span[1])
    along = start.to(end)
    side = Point(-along.y, along.x)
    for place in (start, end):
        canvas.path(
            [place.plus(side, beside - 5), place.plus(side, beside + 5)], class_="measure", stroke=FAINT, stroke_width=1
        )
    canvas.path([start.plus(side, beside), end.plus(side, beside)], class_="measure", stroke=FAINT, stroke_width=1)
    middle = start.plus(Point(end.x - start.x, end.y - start.y), 0.5).plus(side, beside)
    if ahead:
        canvas.text(end.plus(side, beside).plus(Point(8, 4)), words, 12)
    elif abs(along.y) < 0.1:
        canvas.text(middle.plus(Point(0, 18)), words, 12, "middle")
    else:
        canvas.text(middle.plus(Point(14, 1)), words, 12)


def _scale_bar(canvas: Canvas, at: Point, scale: float) -> None:
    """1 mm."""
    end = at.plus(Point(scale, 0))
    for place in (at, end):
        canvas.path([place.plus(Point(0, -4)), place.plus(Point(0, 4))], stroke=INK, stroke_width=1.5)
    canvas.path([at, end], stroke=INK, stroke_width=1.5)
    canvas.text(end.plus(Point(7, 4)), "1 mm", 12)


def _sky_legend(canvas: Canvas) -> None:
    at = Point(20, 680)
    for role, width in (("jump", 100), ("run-in", 108), ("mark", 100), ("run-out", 120)):
        dashes: dict[str, object] = {"stroke_dasharray": "5 4"} if role == "jump" else {}
        canvas.path([at, at.plus(Point(34, 0))], stroke=COLOURS[role], stroke_width=2.5, **dashes)
        canvas.arrow(at, at.plus(Point(34, 0)), COLOURS[role])
        canvas.text(at.plus(Point(42, 4)), role, 13)
        at = at.plus(Point(width, 0))
    canvas.path([at, at.plus(Point(34, 0))], stroke=LIGHT, stroke_width=11)
    canvas.text(at.plus(Point(42, 4)), "light commanded on", 13)
    at = Point(37, 704)
    canvas.dot(at, 4.5, fill="#ffdd00", stroke=INK, stroke_width=1.5)
    canvas.text(at.plus(Point(12, 4)), "on: TIMELAG + SHIFT after S", 13)
    canvas.dot(at.plus(Point(231, 0)), 4.5, fill="#ffffff", stroke=INK, stroke_width=1.5)
    canvas.text(at.plus(Point(243, 4)), "off: TIMELAG after E", 13)
    canvas.text(at.plus(Point(411, 4)), f"{VEL:g} mm/s, TIMELAG {LAG_US:g} us", 13, fill=FAINT)


# The beam.


def beam_job(*, sky: bool) -> str:
    """Two sides in one go, with or without sky writing."""
    start, *rest = CORNER
    sides = "".join(f"LINE X {x:g} Y {y:g}\n" for x, y in rest)
    head = f"SKYWRITE MODE 2 TIMELAG {LAG_US:g}us\n" if sky else ""
    return f"{HEAD}{head}JUMP X {start[0]:g} Y {start[1]:g}\nLASER ON\n{sides}LASER OFF\nJUMP X 0 Y 0\n"


def beam_machine() -> Machine:
    """The default machine with a scanner that lags."""
    scanner = parse_scanner(f"first-order:{LAG_US:g}us")
    assert not isinstance(scanner, str)
    return structs.replace(MACHINE, scanner=scanner)


DOT_US = 100
"""A dot of the beam's way each."""
DOT_MM = 0.1
"""How wide it is drawn: a usual spot."""
_SAMPLE_US = 0.5
_MOST = 8.0
"""Times the wanted energy per mm that the diagram shows."""

BEAM_VIEWS = {False: View(origin=Point(28, 200), scale=73), True: View(origin=Point(432, 200), scale=73)}
"""Where the way is drawn without and with sky writing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Burnt:
    """What the beam does in one emission interval: time (ms) and mm run at the edges of bins of equal length, and the
    energy per mm in each, in times of that at mark speed."""

    time: Floats
    run: Floats
    energy: Floats

    def at(self, time: Floats) -> Floats:
        """Energy per mm where the beam is."""
        return np.asarray(self.energy[np.clip(np.searchsorted(self.time, time) - 1, 0, len(self.energy) - 1)])


def burnt(trace: Trace) -> list[Burnt]:
    """Each mark in bins of BIN_MM, as in the report."""
    shine, found = trace.channels[0].emission, []
    for start, end in zip(shine.start_ms.tolist(), shine.end_ms.tolist(), strict=True):
        time = np.linspace(start, end, round((end - start) * 1000 / _SAMPLE_US) + 1)
        x, y = beam_at(trace, time)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        edge = np.linspace(0.0, way[-1], math.ceil(way[-1] / BIN_MM - 1e-6) + 1)
        edge_ms = np.interp(edge, way, time)
        energy = np.diff(edge_ms) * VEL / 1000 / np.diff(edge)
        found.append(Burnt(time=edge_ms, run=edge, energy=energy))
    return found


def beam_picture() -> str:
    """The beam behind the command, without and with sky writing, and the energy per mm along it."""
    canvas = Canvas(800, 610, "The beam of a lagging scanner without and with SKYWRITE")
    for sky, view in BEAM_VIEWS.items():
        left = view.origin.x - 28
        title = f"SKYWRITE MODE 2 TIMELAG {LAG_US:g}us" if sky else "Without sky writing"
        under = "mark speed from S to E, a sharp corner" if sky else "match-heads at S, at E and in the corner"
        canvas.panel(Point(left, 0), 396, 400, title, under)
        canvas.panel(Point(left, 408), 396, 158, "", "")
        trace = run(beam_job(sky=sky), beam_machine())
        canvas.group("with" if sky else "without")
        _draw_beam(canvas, view, trace)
        _diagram(canvas, Point(left, 408), burnt(trace))
        canvas.close()
        _scale_bar(canvas, Point(left + 20, 384), view.scale)
    canvas.panel(Point(0, 574), 800, 36, "")
    _beam_legend(canvas)
    return canvas.svg()


def _draw_beam(canvas: Canvas, view: View, trace: Trace) -> None:
    for leg in legs_of(trace):
        canvas.path(
            [view.px(leg.start), view.px(leg.end)], class_="command", stroke=COMMAND, stroke_width=6,
            stroke_linecap="round",
        )  # fmt: skip
    time = np.arange(0.0, float(trace.schedule.times_ms[-1]) + 1.0, DOT_US / 1000)
    canvas.path(map(view.px, map(Point, *beam_at(trace, time))), class_="beam", stroke=BEAM, stroke_width=1.5)
    shine = trace.channels[0].emission
    spans = zip(burnt(trace), shine.start_ms.tolist(), shine.end_ms.tolist(), strict=True)
    for mark, start, end in spans:
        moments = start + np.arange(0.0, end - start + 1e-3, DOT_US / 1000)
        for x, y, hot in zip(*beam_at(trace, moments), mark.at(moments), strict=True):
            canvas.dot(view.px(Point(x, y)), DOT_MM / 2 * view.scale, class_="burnt", fill=heat(float(hot)))
    sides = [Point(*p) for p in CORNER]
    for place, toward, word in ((sides[0], sides[1], "S"), (sides[2], sides[1], "E")):
        away = view.px(place).to(view.px(toward))
        beside = Point(-away.y, away.x) if word == "S" else Point(away.y, -away.x)
        canvas.dot(view.px(place), 2.5, class_="end", fill=INK)
        _letter(canvas, view.px(place).plus(beside, 18), word)


def heat(energy: float) -> str:
    """The colour of an energy per mm."""
    level = [h[0] for h in HEAT]
    parts = (round(float(np.interp(energy, level, [h[1][k] for h in HEAT])) + 3e-7) for k in range(3))
    return "#" + "".join(f"{p:02x}" for p in parts)


def _diagram(canvas: Canvas, corner: Point, marks: list[Burnt]) -> None:
    """Energy per mm over the beam's way under light, one mark behind the other."""
    left, bottom, width, height = corner.x + 40, corner.y + 122, 330.0, 86.0
    canvas.text(corner.plus(Point(12, 20)), "energy per mm, times the wanted", 12)
    across, up = width / 6.5, height / _MOST

    def place(run_mm: float, energy: float) -> Point:
        return Point(left + run_mm * across, bottom - energy * up)

    for level in (0, 1, 4, 8):
        canvas.path([place(0, level), place(6.5, level)], class_="grid", stroke=EDGE if level else INK, stroke_width=1)
        canvas.text(place(0, level).plus(Point(-7, 4)), f"{level}", 11, "end", fill=FAINT)
    for mm in range(0, 7, 2):
        canvas.text(place(mm, 0).plus(Point(0, 15)), f"{mm}", 11, "middle", fill=FAINT)
    canvas.text(place(6.5, 0).plus(Point(0, 28)), "mm along the beam's way under light", 11, "end", fill=FAINT)
    done = 0.0
    for mark in marks:
        steps = [place(done, 0)]
        for k, energy in enumerate(mark.energy.tolist()):
            steps += [place(done + float(mark.run[k]), energy), place(done + float(mark.run[k + 1]), energy)]
        done += float(mark.run[-1])
        steps.append(place(done, 0))
        canvas.add(
            "polygon", class_="energy", points=" ".join(f"{number(p.x)},{number(p.y)}" for p in steps),
            fill=LIGHT, stroke=COLOURS["mark"], stroke_width=1,
        )  # fmt: skip


def _beam_legend(canvas: Canvas) -> None:
    at = Point(20, 592)
    canvas.path([at, at.plus(Point(30, 0))], stroke=COMMAND, stroke_width=6, stroke_linecap="round")
    canvas.text(at.plus(Point(40, 4)), "command", 13)
    canvas.path([at.plus(Point(118, 0)), at.plus(Point(148, 0))], stroke=BEAM, stroke_width=1.5)
    canvas.text(at.plus(Point(156, 4)), f"beam, {LAG_US:g} us behind", 13)
    canvas.text(at.plus(Point(322, 4)), f"a dot every {DOT_US} us; energy per mm", 13)
    for (energy, _), x, more in zip(HEAT, (570, 622, 674), ("", "", " or more"), strict=True):
        canvas.dot(at.plus(Point(x, 0)), DOT_MM / 2 * BEAM_VIEWS[True].scale, fill=heat(energy))
        canvas.text(at.plus(Point(x + 8, 4)), f"{energy:g}x{more}", 13)


PICTURES: dict[str, Callable[[], str]] = {"skywrite.svg": skywrite_picture, "beam.svg": beam_picture}
"""Files in grammar/ and what draws them."""
