"""What is left of a stream from a place on: the controller's state there rebuilt, a dark way to it, and the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from gusjob.controllers.gus.calls import SIGNATURES, Buffered, BufferedCalls, Call, Stream, crd_start
from gusjob.controllers.gus.geometry import call_segments
from gusjob.controllers.gus.place import START, Place
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.schedule import reachable_ends

CRD_CALLS = ("GT_SetCrdPrm", "GT_CrdClear", "GT_CrdStart", "GT_CrdStatus")
_NOW = ("GT_SetHSIOOpt", "GT_LaserPrfCmd", "GT_GetHSIOOpt")
_UNDONE_BY = {
    "GT_LaserPowerMode": ("GT_LaserOutFrq", "GT_SetPulseWidth"),
    "GT_EnaFPK": ("GT_DisFPK",),
    "GT_DisFPK": ("GT_EnaFPK",),
    "GT_SetLaserDisMode": ("GT_SetLaserDisRatio",),
}
"""What a setting takes away of earlier ones. In force are the others, in the order of the manual's examples."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A stream to run: behind the first `lead` rows it is what is left of the whole job from a place on."""

    stream: Stream
    lead: int = 0
    begin: Place = START
    start: tuple[float, float] = (0.0, 0.0)
    """Where its first motion begins, pulse; behind a way of its own that is where the way leads."""

    def row(self, index: int) -> int:
        """The whole job's row for a row of this part."""
        return self.begin.row + max(index - self.lead, 0)

    def place(self, here: Place) -> Place:
        """The whole job's place for a place in this part. Its first row may be the end of a longer one."""
        if here.row < self.lead:
            return self.begin
        begun = self.begin.run_pulse if here.row == self.lead else 0.0
        return Place(row=self.row(here.row), run_pulse=begun + here.run_pulse, sure=here.sure)


def whole(stream: Stream, head: tuple[float, float] | None) -> Part:
    """The whole stream, from wherever the head is (None: nobody knows).

    Its calls take it for granted that the head begins at 0, 0. A first motion that is dark and straight gets there by
    itself; before any other one a dark way to 0, 0 is put.
    """
    timed = np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)
    away = head is None or math.hypot(*head) >= 1
    if not len(timed) or not away:
        return Part(stream=stream)
    first = int(timed[0])
    lit = any(_light_at(stream, first, channel).on for channel in (0, 1))
    if stream.buffered.kind[first] == Buffered.LINE and not lit:
        return Part(stream=stream)
    return rest(stream, START, head)


def rest(stream: Stream, place: Place, head: tuple[float, float] | None = None) -> Part:
    """What is left from a place on.

    The calls that set the lasers up, GT_SetCrdPrm, GT_CrdClear, a dark move to the place (left out if the head, pulse,
    is there), the power in force, the switch if it was on, and the rest as it was; but for end velocities that can't be
    reached from rest, and the row in which the place lies, which begins there.
    """
    calls, place = stream.buffered, settled(stream.buffered, place)
    row = place.row
    if row >= len(calls):
        behind = tuple(replace(c, at=0) for c in stream.calls if c.at >= row and c.name not in CRD_CALLS)
        return Part(stream=replace(stream, buffered=calls.pick(np.arange(0)), calls=behind, intent=None), begin=place)
    start = point(calls, place)
    line, crd, fifo = int(calls.line[row]), int(calls.crd[row]), int(calls.fifo[row])
    lead = _Lead(calls=calls, line=line, crd=crd, fifo=fifo)
    if head is None or math.hypot(head[0] - start[0], head[1] - start[1]) >= 1:
        vel, acc = _speed(calls, row)
        lead.add(Buffered.LINE, x=start[0], y=start[1], vel=vel, acc=acc)
    for channel in (0, 1):
        state = _light_at(stream, row, channel)
        if isinstance(state.power, int):
            lead.rows.append(calls.pick(np.array([state.power])))
        elif state.power is not None:
            lead.add(Buffered.POWER, p=state.power, channel=channel)
        if state.on:
            lead.add(Buffered.ON, channel=channel)
    left = calls.pick(np.arange(row, len(calls)))
    if place.run_pulse > 0:
        _begin_within(left, calls, row, start)
    count = len(lead.rows)
    made = Stream(
        name=stream.name,
        buffered=_joined([*lead.rows, left]),
        calls=tuple(_calls(stream, row, count - row, line, crd, fifo)),
    )
    _reach(made, start)
    return Part(stream=made, lead=count, begin=place, start=start)


def settled(calls: BufferedCalls, place: Place) -> Place:
    """A place at the row that is to be run next.

    What stands before the next motion, switches and powers, is not run but counted as done: light that goes off there
    would else come on for a moment. And what is left of a motion is at least a pulse: an arc that ends where it begins
    would be a full circle.
    """
    row, run = place.row, place.run_pulse
    if row < len(calls) and run > 0:
        start = point(calls, place)
        if start == (float(calls.x[row]), float(calls.y[row])):
            x, y = point(calls, Place(row=row))
            length = float(_laid(calls, row).length[0])
            row, run = (row, 0.0) if (x, y) == start and run < length / 2 else (row + 1, 0.0)
    timed = np.flatnonzero(calls.kind[row:] <= Buffered.DELAY)
    row = row + int(timed[0]) if len(timed) else len(calls)
    return Place(row=row, run_pulse=run, sure=place.sure)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Lead:
    """The rows before what is left."""

    calls: BufferedCalls
    line: int
    crd: int
    fifo: int
    rows: list[BufferedCalls] = field(default_factory=list)

    def add(self, kind: Buffered, **columns: float) -> None:
        made = {name: np.zeros(1, dtype=self.calls.column(name).dtype) for name in self.calls.__slots__}
        for name, value in {"kind": kind, "line": self.line, "crd": self.crd, "fifo": self.fifo, **columns}.items():
            made[name][0] = value
        self.rows.append(BufferedCalls(**made))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Light:
    """A channel at a row. `power`: the row that set it, a power that was set at once, or None."""

    on: bool
    power: int | float | None


def _light_at(stream: Stream, row: int, channel: int) -> _Light:
    """What the last calls before a row left behind. A new mode takes the power away."""
    calls = stream.buffered
    mine = (calls.channel[:row] == channel) & (calls.kind[:row] >= Buffered.ON)
    at = np.flatnonzero(mine)
    switches = at[calls.kind[at] <= Buffered.OFF]
    powers = at[calls.kind[at] >= Buffered.POWER]
    switch = (int(switches[-1]) + 1, calls.kind[switches[-1]] == Buffered.ON) if len(switches) else (-1, False)
    power: tuple[int, int | float | None] = (int(powers[-1]) + 1, int(powers[-1])) if len(powers) else (-1, None)
    mode: float | None = None
    for call in stream.calls:
        if call.at > row or call.name in CRD_CALLS or call.args[-1] != channel:
            continue
        if call.name == "GT_SetHSIOOpt" and call.at >= switch[0]:
            switch = (call.at, call.args[0] == 1)
        elif call.name == "GT_LaserPrfCmd" and call.at >= power[0]:
            assert isinstance(call.args[0], float)
            power = (call.at, call.args[0])
        elif call.name == "GT_LaserPowerMode":
            assert isinstance(call.args[0], float)
            if call.args[0] != mode and call.at >= power[0]:
                power = (call.at, None)
            mode = call.args[0]
    return _Light(on=bool(switch[1]), power=power[1])


def _calls(stream: Stream, row: int, shift: int, line: int, crd: int, fifo: int) -> Iterator[Call]:
    """The calls that are not buffered: settings in force, the coordinate system, and those behind the row."""
    settings = dict[tuple[str, object], Call]()
    built: Call | None = None
    for call in stream.calls:
        if call.at > row:
            continue
        if call.name == "GT_SetCrdPrm" and call.args[0] == crd:
            built = call
        elif call.name not in (*CRD_CALLS, *_NOW):
            # An axis stands for its channel: 7 is channel 0, 8 is channel 1 (M 二.2).
            channel = call.args[0] if call.name == "GT_SetAxisMode" else call.args[-1]
            for name in _UNDONE_BY.get(call.name, ()):
                settings.pop((name, channel), None)
            settings[call.name, channel] = call
    order = list(SIGNATURES)
    settings = dict(sorted(settings.items(), key=lambda item: order.index(item[0][0])))
    for call in (*settings.values(), *([built] if built else [])):
        yield replace(call, at=0)
    yield Call(name="GT_CrdClear", args=(float(crd), float(fifo)), at=0, line=line)
    behind = [replace(call, at=call.at + shift) for call in stream.calls if call.at > row]
    starts = next((i for i, call in enumerate(behind) if call.name in CRD_CALLS), len(behind))
    if starts == len(behind) or behind[starts].name != "GT_CrdStart":
        # It was started early: its rows came while it ran.
        at = behind[starts].at if starts < len(behind) else len(stream.buffered) + shift
        behind.insert(starts, crd_start(crd, fifo, at=at, line=line))
    yield from behind


def point(calls: BufferedCalls, place: Place) -> tuple[float, float]:
    """The whole pulse where a place is."""
    timed = np.flatnonzero(calls.kind[: place.row + 1] <= Buffered.DELAY)
    moves = timed[calls.kind[timed] < Buffered.DELAY]
    before = moves[moves < place.row]
    start = (float(calls.x[before[-1]]), float(calls.y[before[-1]])) if len(before) else (0.0, 0.0)
    if place.run_pulse <= 0:
        return start
    laid = call_segments(calls, np.array([place.row]), np.zeros(1, dtype=np.bool_), start)
    x, y = laid.points(np.array([0]), place.run_pulse / laid.length)
    return float(np.rint(x[0])), float(np.rint(y[0]))


def _speed(calls: BufferedCalls, row: int) -> tuple[float, float]:
    """Velocity and acceleration of the first motion from a row on, for the way to it."""
    moves = np.flatnonzero(calls.kind[row:] < Buffered.DELAY)
    at = row + int(moves[0]) if len(moves) else int(np.flatnonzero(calls.kind < Buffered.DELAY)[-1])
    return float(calls.vel[at]), float(calls.acc[at])


def _begin_within(left: BufferedCalls, calls: BufferedCalls, row: int, start: tuple[float, float]) -> None:
    """The first row of what is left begins at `start`; an arc goes on about its centre, which is an offset."""
    if calls.kind[row] in (Buffered.ARC_CENTRE, Buffered.ARC_RADIUS):
        cx, cy = _centre(calls, row)
        left.kind[0] = Buffered.ARC_CENTRE
        left.p[0], left.q[0] = np.rint(cx - start[0]), np.rint(cy - start[1])


def about_centre(calls: BufferedCalls, row: int) -> None:
    """An arc by its radius as one about its centre, which goes on to be right where its end is moved along it."""
    if calls.kind[row] == Buffered.ARC_RADIUS:
        (cx, cy), start = _centre(calls, row), point(calls, Place(row=row))
        calls.kind[row] = Buffered.ARC_CENTRE
        calls.p[row], calls.q[row] = np.rint(cx - start[0]), np.rint(cy - start[1])


def _centre(calls: BufferedCalls, row: int) -> tuple[float, float]:
    arcs = _laid(calls, row).arcs
    return float(arcs.cx[0]), float(arcs.cy[0])


def _laid(calls: BufferedCalls, row: int) -> Segments:
    """One motion."""
    return call_segments(calls, np.array([row]), np.zeros(1, dtype=np.bool_), point(calls, Place(row=row)))


def _joined(pieces: list[BufferedCalls]) -> BufferedCalls:
    names = BufferedCalls.__slots__
    return BufferedCalls(**{name: np.concatenate([piece.column(name) for piece in pieces]) for name in names})


def _reach(stream: Stream, start: tuple[float, float]) -> None:
    """Lower the end velocities of the first stage to what can be reached from rest."""
    calls = stream.buffered
    last = next((c.at for c in stream.calls if c.name == "GT_CrdStart"), len(calls))
    rows = np.flatnonzero(calls.kind[:last] <= Buffered.DELAY)
    if not len(rows):
        return
    dwell = calls.kind[rows] == Buffered.DELAY
    laid = call_segments(calls, rows, dwell, start)
    given = calls.vel_end[rows]
    ends = np.array([0, len(rows)])
    reached = np.minimum(given, reachable_ends(laid.length, calls.vel[rows], calls.acc[rows], given, dwell, ends))
    calls.vel_end[rows] = np.where(dwell, calls.vel_end[rows], reached)
