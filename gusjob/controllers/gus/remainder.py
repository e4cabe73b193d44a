"""The remainder of a stream from a position: the controller's state there rebuilt, a jump to it, and the rest."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.controllers.gus.calls import POWER_KINDS, SIGNATURES, Buffered, BufferedCalls, Call, Stream, crd_start
from gusjob.controllers.gus.geometry import call_segments
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, PositionRange
from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.kinematics.geometry import CLOSE_ENDS_PULSE, Segments
from gusjob.kinematics.schedule import reachable_ends

CRD_CALLS = ("GT_SetCrdPrm", "GT_SetCrdStopDec", "GT_CrdClear", "GT_CrdStart", "GT_CrdStatus", "GT_Stop", "GT_Reset")
"""Immediate calls of the coordinate system; all others are calls of a laser."""
_IMMEDIATE_EFFECTS = ("GT_SetHSIOOpt", "GT_LaserPrfCmd", "GT_GetHSIOOpt")
"""Laser calls that are no settings: switch and power are rebuilt as buffered calls."""
_REVOKED_BY = {
    "GT_LaserPowerMode": ("GT_LaserOutFrq", "GT_SetPulseWidth"),
    "GT_EnaFPK": ("GT_DisFPK",),
    "GT_DisFPK": ("GT_EnaFPK",),
    "GT_SetLaserDisMode": ("GT_SetLaserDisRatio",),
}
"""The earlier settings that a setting revokes. The others are in force, in the order of the manual's examples."""


class Remainder(Struct, frozen=True, kw_only=True):
    """A stream to run: after its first `lead_rows` rows it is the whole job from `begin` on.

    `start_pulse`: where its first motion begins; after a jump to the position that is where the jump ends.
    """

    stream: Stream
    lead_rows: int = 0
    begin: PathPosition = JOB_START
    start_pulse: tuple[float, float] = (0.0, 0.0)

    def job_row(self, row: int) -> int:
        """Convert a row of this stream to a row of the whole job."""
        return self.begin.row + max(row - self.lead_rows, 0)

    def job_position(self, position: PathPosition) -> PathPosition:
        """Convert a position in this stream to one in the whole job.

        The first row behind the lead may be the end of a longer one.
        """
        if position.row < self.lead_rows:
            return self.begin
        begun_pulse = self.begin.along_pulse if position.row == self.lead_rows else 0.0
        along_pulse = begun_pulse + position.along_pulse
        return PathPosition(row=self.job_row(position.row), along_pulse=along_pulse)

    def job_range(self, found: PositionRange) -> PositionRange:
        """Convert a range in this stream to one in the whole job."""
        return PositionRange(earliest=self.job_position(found.earliest), latest=self.job_position(found.latest))


def whole_job(stream: Stream, head_pulse: tuple[float, float] | None) -> Remainder:
    """Make the whole stream ready to run from any position of the head.

    Its calls assume that the head begins at 0, 0. If the first motion is a jump, it gets to its end by itself;
    before any other motion a jump to 0, 0 is added.

    Args:
        stream: the whole job.
        head_pulse: where the head is; None if unknown.
    """
    timed = np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)
    away = head_pulse is None or math.hypot(*head_pulse) >= 1
    if not len(timed) or not away:
        return Remainder(stream=stream)
    first = int(timed[0])
    emits = any(_switch_state(stream, first, channel).on for channel in CHANNELS)
    if stream.buffered.kind[first] <= Buffered.LINE_TO_REST and not emits:
        return Remainder(stream=stream)
    return remainder_from(stream, JOB_START, head_pulse)


def remainder_from(stream: Stream, position: PathPosition, head_pulse: tuple[float, float] | None = None) -> Remainder:
    """Make the stream that runs the rest of a job.

    It has the calls that set up the lasers, GT_SetCrdPrm, GT_CrdClear, a jump to the position, the power in force,
    the switch if it was on, and the rest of the job unchanged but for two things: end velocities that can't be reached
    from rest are lowered, and the row in which the position lies begins there.

    Args:
        stream: the whole job.
        position: where to begin.
        head_pulse: where the head is; the jump is left out if that is the position. None if unknown.
    """
    calls, position = stream.buffered, at_next_motion(stream.buffered, position)
    row = position.row
    if row >= len(calls):
        after = tuple(replace(c, at=0) for c in stream.calls if c.at >= row and c.name not in CRD_CALLS)
        empty = replace(stream, buffered=calls.pick(np.arange(0)), calls=after, intent=None)
        return Remainder(stream=empty, begin=position)
    start = point_pulse(calls, position)
    line, crd, fifo = int(calls.line[row]), int(calls.crd[row]), int(calls.fifo[row])
    lead = _LeadIn(calls=calls, line=line, crd=crd, fifo=fifo)
    is_away = head_pulse is None or math.hypot(head_pulse[0] - start[0], head_pulse[1] - start[1]) >= 1
    if is_away and (calls.kind < Buffered.DELAY).any():  # A job of dwells runs where the head is.
        vel, acc = _velocity_and_acceleration(calls, row)
        lead.add(Buffered.LINE, x=start[0], y=start[1], vel=vel, acc=acc)
    for channel in CHANNELS:
        state = _switch_state(stream, row, channel)
        if state.source is not None:
            lead.rows.append(calls.pick(np.array([state.source])))
        if isinstance(state.power, int):
            lead.rows.append(calls.pick(np.array([state.power])))
        elif state.power is not None:
            lead.add(Buffered.POWER, p=state.power, channel=channel)
        if state.on:
            lead.add(Buffered.ON, channel=channel)
    left = calls.pick(np.arange(row, len(calls)))
    if position.along_pulse > 0:
        _begin_within(left, calls, position, start)
    count = len(lead.rows)
    made = Stream(
        name=stream.name,
        buffered=_concatenated([*lead.rows, left]),
        calls=tuple(_calls(stream, row, count - row, line, crd, fifo)),
    )
    _lower_end_velocities(made, start)
    return Remainder(stream=made, lead_rows=count, begin=position, start_pulse=start)


def at_next_motion(calls: BufferedCalls, position: PathPosition) -> PathPosition:
    """Move a position to the row that is to be run next.

    Untimed calls before the next motion, switches and powers, are counted as done: a laser that is switched off there
    would come on for a moment otherwise. At least a pulse of a motion is left: an arc that ends where it begins would
    be a full circle.
    """
    row, along = position.row, position.along_pulse
    if row < len(calls) and along > 0:
        start = point_pulse(calls, position)
        if start == (float(calls.x[row]), float(calls.y[row])):
            x, y = point_pulse(calls, PathPosition(row=row))
            length = float(_segment(calls, row).length[0])
            row, along = (row, 0.0) if (x, y) == start and along < length / 2 else (row + 1, 0.0)
    timed = np.flatnonzero(calls.kind[row:] <= Buffered.DELAY)
    row = row + int(timed[0]) if len(timed) else len(calls)
    return PathPosition(row=row, along_pulse=along)


class _LeadIn(Struct, frozen=True, kw_only=True):
    """The rows before the rest of the job."""

    calls: BufferedCalls
    line: int
    crd: int
    fifo: int
    rows: list[BufferedCalls] = field(default_factory=list)

    def add(self, kind: Buffered, **columns: float) -> None:
        made = {name: np.zeros(1, dtype=self.calls.column(name).dtype) for name in self.calls.__struct_fields__}
        for name, value in {"kind": kind, "line": self.line, "crd": self.crd, "fifo": self.fifo, **columns}.items():
            made[name][0] = value
        self.rows.append(BufferedCalls(**made))


class _SwitchState(Struct, frozen=True, kw_only=True):
    """A channel's state before a row. `power`: the row that set it, a power that was set immediately, or None.

    `source`: the row that set the source of a follow, or None.
    """

    on: bool
    power: int | float | None
    source: int | None


def _switch_state(stream: Stream, row: int, channel: int) -> _SwitchState:
    """Find the state that the calls before a row leave. A new power mode revokes the power."""
    calls = stream.buffered
    mine = (calls.channel[:row] == channel) & (calls.kind[:row] >= Buffered.ON)
    at = np.flatnonzero(mine)
    switches = at[calls.kind[at] <= Buffered.OFF]
    powers, sources = at[np.isin(calls.kind[at], POWER_KINDS)], at[calls.kind[at] == Buffered.FOLLOW_SOURCE]
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
    source = int(sources[-1]) if len(sources) else None
    return _SwitchState(on=bool(switch[1]), power=power[1], source=source)


def _calls(stream: Stream, row: int, shift: int, line: int, crd: int, fifo: int) -> Iterator[Call]:
    """Yield the immediate calls: settings in force, the coordinate system, and the calls after the row."""
    settings = dict[tuple[str, object], Call]()
    built = dict[str, Call]()
    for call in stream.calls:
        if call.at > row:
            continue
        if call.name in ("GT_SetCrdPrm", "GT_SetCrdStopDec") and call.args[0] == crd:
            built[call.name] = call
        elif call.name not in (*CRD_CALLS, *_IMMEDIATE_EFFECTS):
            # An axis belongs to a channel: 7 is channel 0, 8 is channel 1 (M 二.2).
            channel = call.args[0] if call.name == "GT_SetAxisMode" else call.args[-1]
            for name in _REVOKED_BY.get(call.name, ()):
                settings.pop((name, channel), None)
            settings[call.name, channel] = call
    order = list(SIGNATURES)
    settings = dict(sorted(settings.items(), key=lambda item: order.index(item[0][0])))
    for call in (*settings.values(), *built.values()):
        yield replace(call, at=0)
    yield Call(name="GT_CrdClear", args=(float(crd), float(fifo)), at=0, line=line)
    after = [replace(call, at=call.at + shift) for call in stream.calls if call.at > row]
    first = next((i for i, call in enumerate(after) if call.name in CRD_CALLS), len(after))
    if first == len(after) or after[first].name != "GT_CrdStart":
        # The stage was started early: its rows were sent while it ran.
        at = after[first].at if first < len(after) else len(stream.buffered) + shift
        after.insert(first, crd_start(crd, fifo, at=at, line=line))
    yield from after


def point_pulse(calls: BufferedCalls, position: PathPosition) -> tuple[float, float]:
    """Return the coordinates of a position, in whole pulses."""
    timed = np.flatnonzero(calls.kind[: position.row + 1] <= Buffered.DELAY)
    moves = timed[calls.kind[timed] < Buffered.DELAY]
    before = moves[moves < position.row]
    start = (float(calls.x[before[-1]]), float(calls.y[before[-1]])) if len(before) else (0.0, 0.0)
    if position.along_pulse <= 0:
        return start
    segments = call_segments(calls, np.array([position.row]), np.zeros(1, dtype=np.bool_), start)
    x, y = segments.points(np.array([0]), position.along_pulse / segments.length)
    return float(np.rint(x[0])), float(np.rint(y[0]))


def _velocity_and_acceleration(calls: BufferedCalls, row: int) -> tuple[float, float]:
    """Return those of the first motion from a row on, for the jump to it."""
    moves = np.flatnonzero(calls.kind[row:] < Buffered.DELAY)
    at = row + int(moves[0]) if len(moves) else int(np.flatnonzero(calls.kind < Buffered.DELAY)[-1])
    return float(calls.vel[at]), float(calls.acc[at])


def _begin_within(
    left: BufferedCalls, calls: BufferedCalls, position: PathPosition, start: tuple[float, float]
) -> None:
    """Let the first row of the rest begin at `start`; the centre of an arc is an offset from there.

    The last two pulses of an arc are a line: about the centre a rounded start could make a full circle of them.
    """
    row = position.row
    if calls.kind[row] in (Buffered.ARC_CENTRE, Buffered.ARC_RADIUS):
        segment = _segment(calls, row)
        if float(segment.length[0]) - position.along_pulse <= CLOSE_ENDS_PULSE:
            left.kind[0], left.p[0], left.q[0], left.r[0] = Buffered.LINE, 0.0, 0.0, 0.0
            return
        left.kind[0] = Buffered.ARC_CENTRE
        left.p[0], left.q[0] = float(segment.arcs.cx[0]) - start[0], float(segment.arcs.cy[0]) - start[1]


def as_centre_arc(calls: BufferedCalls, row: int) -> None:
    """Turn an arc by radius into one about its centre, which stays right if its end is moved along it."""
    if calls.kind[row] == Buffered.ARC_RADIUS:
        (cx, cy), start = _centre(calls, row), point_pulse(calls, PathPosition(row=row))
        calls.kind[row] = Buffered.ARC_CENTRE
        calls.p[row], calls.q[row] = cx - start[0], cy - start[1]


def _centre(calls: BufferedCalls, row: int) -> tuple[float, float]:
    arcs = _segment(calls, row).arcs
    return float(arcs.cx[0]), float(arcs.cy[0])


def _segment(calls: BufferedCalls, row: int) -> Segments:
    """Return one motion as a segment."""
    return call_segments(calls, np.array([row]), np.zeros(1, dtype=np.bool_), point_pulse(calls, PathPosition(row=row)))


def _concatenated(pieces: list[BufferedCalls]) -> BufferedCalls:
    names = BufferedCalls.__struct_fields__
    return BufferedCalls(**{name: np.concatenate([piece.column(name) for piece in pieces]) for name in names})


def _lower_end_velocities(stream: Stream, start: tuple[float, float]) -> None:
    """Lower the end velocities of the first stage to those that can be reached from rest."""
    calls = stream.buffered
    last = next((c.at for c in stream.calls if c.name == "GT_CrdStart"), len(calls))
    rows = np.flatnonzero(calls.kind[:last] <= Buffered.DELAY)
    if not len(rows):
        return
    dwell = calls.kind[rows] == Buffered.DELAY
    segments = call_segments(calls, rows, dwell, start)
    given = calls.vel_end[rows]
    ends = np.array([0, len(rows)])
    reached = np.minimum(given, reachable_ends(segments.length, calls.vel[rows], calls.acc[rows], given, dwell, ends))
    calls.vel_end[rows] = np.where(dwell, calls.vel_end[rows], reached)
