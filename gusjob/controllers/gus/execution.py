"""Result of executing a stream: what runs in each stage, and the laser states and immediate actions around it."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct, field

from gusjob.controllers.gus.calls import BufferedCalls, Call
from gusjob.diagnostics.model import Diagnostic
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.simulate.events import ImmediateAction, LaserState


class CrdSettings(Struct, frozen=True, kw_only=True):
    """What GT_SetCrdPrm sets (sister).

    `axes`: the axes (from 0) that X and Y drive. `vel_max`, `acc_max`: limits of all segments. `even_time_ms`: least
    time of a segment at constant velocity. `origin_pulse`: position of the origin on the machine.
    """

    axes: tuple[int, int] = (0, 1)
    vel_max_pulse_per_ms: float = float("inf")
    acc_max_pulse_per_ms2: float = float("inf")
    even_time_ms: float = 0.0
    origin_pulse: tuple[float, float] = (0.0, 0.0)


class RunCalls(Struct, frozen=True, kw_only=True, eq=False):
    """The buffered calls that run: those of a stream, then (k,) what became of those in which a stop came.

    `made_from` (k,): the row of the stream. `made_piece` (k,): it runs exactly as it is, whatever the limits.
    """

    calls: BufferedCalls
    made_from: Indices
    made_piece: Bools

    @classmethod
    def of(cls, calls: BufferedCalls) -> RunCalls:
        """Make those of a stream that nothing stops."""
        return cls(calls=calls, made_from=np.empty(0, dtype=np.intp), made_piece=np.empty(0, dtype=np.bool_))

    @property
    def sent(self) -> int:
        """Number of calls of the stream."""
        return len(self.calls) - len(self.made_from)

    def source(self, row: Indices) -> Indices:
        """Return the rows of the stream that rows are, or are made from."""
        if not len(self.made_from):
            return row
        return np.where(row < self.sent, row, self.made_from[np.maximum(row - self.sent, 0)])

    def is_piece(self, row: Indices) -> Bools:
        """Return which rows run exactly as they are."""
        if not len(self.made_from):
            return np.broadcast_to(np.False_, len(row))
        return np.asarray((row >= self.sent) & self.made_piece[np.maximum(row - self.sent, 0)])

    def with_made(self, made: BufferedCalls, made_from: Indices, made_piece: Bools) -> RunCalls:
        """Add rows that are made from rows of these calls."""
        names = BufferedCalls.__struct_fields__
        both = {name: np.concatenate([self.calls.column(name), made.column(name)]) for name in names}
        return RunCalls(
            calls=BufferedCalls(**both),
            made_from=np.concatenate([self.made_from, self.source(made_from)]),
            made_piece=np.concatenate([self.made_piece, made_piece]),
        )


class FirstStop(Struct, frozen=True, kw_only=True, eq=False):
    """The first stop of a stage: time since its start, deceleration as of stop_stage, and what would run without it."""

    time_ms: float
    dec_pulse_per_ms2: float
    run: RunCalls
    parts: list[Indices]


class StageRun(Struct, kw_only=True):
    """One start of a coordinate system: its buffered rows in order, lasers in force, immediate actions.

    `waiting`: how many of the first parts are in the FIFO before the start. `settings`: of its coordinate system.
    `start_ms`, `rest_ms`: time of its GT_CrdStart, and when it is at rest, on the recorder's clock, NaN if that is not
    known. `stop`: the last GT_Stop that ends it; its motion then ends `stop_ms` after its start.
    """

    crd: int
    fifo: int
    line: int
    parts: list[Indices]
    lasers: tuple[LaserState, LaserState]
    at_rest: list[ImmediateAction]
    moving: list[ImmediateAction] = field(default_factory=list)
    settings: CrdSettings = CrdSettings()
    start_ms: float = math.nan
    rest_ms: float = math.nan
    waiting: int = 0
    stop: Call | None = None
    stop_ms: float = math.inf
    first_stop: FirstStop | None = None

    @property
    def rows(self) -> Indices:
        """Buffered rows in order."""
        if len(self.parts) == 1:
            return self.parts[0]
        return np.concatenate(self.parts) if self.parts else np.empty(0, dtype=np.intp)


class AcceptedCall(Struct, frozen=True, kw_only=True):
    """A call that is not buffered and that the controller accepts.

    `moving`: a stage runs after the call. `stage`: number of this stage, or of the next one.
    """

    call: Call
    stage: int
    moving: bool


class Execution(Struct, frozen=True, kw_only=True):
    """Everything that the controller does with a stream. Rows are those of `run`.

    `at_end`: immediate actions after the last stage. `lasers`: state after it. `channels`: those that any call names.
    `is_known`: whether the stream determines what runs: no call stops a stage at an unknown time. `accepted`:
    in order.
    """

    run: RunCalls
    stages: tuple[StageRun, ...]
    at_end: tuple[ImmediateAction, ...]
    lasers: tuple[LaserState, LaserState]
    channels: tuple[int, ...]
    is_known: bool
    diagnostics: tuple[Diagnostic, ...]
    accepted: tuple[AcceptedCall, ...] = ()
