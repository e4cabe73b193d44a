"""Events: what a controller does with its calls, in terms that hold for any controller.

A controller's model turns its stream of calls into events, the simulation turns events into a trace. Units: pulse,
pulse/ms, pulse/ms2, ms, us; power in the unit of the laser's power mode.

A buffered switch or power takes no time: it acts between two segments. Its position is `segment`, the number of the
segment before which it acts (m: after the last one). Segments, dwells included, are numbered through all stages.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.ranges import MODE_LIMIT, PowerMode
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import Segments


class LaserState(Struct, frozen=True, kw_only=True):
    """State of a laser channel except its switch and its power.

    `mode` None: never set, the controller runs in duty mode with limits 0 to 100 %. `fpk_us`: width, gap, off delay.
    `standby`: kHz and %.
    """

    mode: PowerMode | None = None
    low: float = MODE_LIMIT[PowerMode.DUTY].low
    high: float = MODE_LIMIT[PowerMode.DUTY].high
    carrier_khz: float | None = None
    pulse_width_us: float = 0.0
    on_delay_us: float = 0.0
    off_delay_us: float = 0.0
    standby: tuple[float, float] | None = None
    prevoltage_v: float | None = None
    fpk_us: tuple[float, float, float] | None = None
    distance: bool = False
    distance_actual: bool = False
    """Distance follow reads the beam's position, not the planned one."""
    reference_pulse: tuple[float, ...] = (0.0,) * 4
    scale_pulse_per_mm: tuple[float, ...] = (1.0,) * 4
    ratio_per_mm: tuple[float, ...] = (0.0,) * 4
    distance_limits: tuple[float, float] | None = None
    """None: no ratio and no limits were ever set."""

    @property
    def power_mode(self) -> PowerMode:
        """The mode in force."""
        return PowerMode.DUTY if self.mode is None else self.mode

    @property
    def follows_distance(self) -> bool:
        """Whether a distance term is added and clamped (a term of ratio 0 is clamped too)."""
        return self.distance and self.distance_limits is not None


class ImmediateAction(Struct, frozen=True, kw_only=True):
    """An immediate switch, power, or reading of the switch.

    `on`: of a switch. `power`: NaN: no power is set any more. `time_ms`: time since the start of the stage that moves;
    NaN: not known, or at rest. `clock_ms`: time of its call on the recorder's clock; NaN: not known.
    """

    channel: int
    on: bool | None = None
    power: float | None = None
    line: int = 0
    time_ms: float = math.nan
    clock_ms: float = math.nan

    def moment(self, start_ms: float, end_ms: float) -> float:
        """Return when it acts, ms, if a stage that moves from `start_ms` to `end_ms` is in progress."""
        return start_ms if math.isnan(self.time_ms) else min(max(start_ms + self.time_ms, start_ms), end_ms)

    @property
    def reads(self) -> bool:
        """Whether it reads the switch."""
        return self.on is None and self.power is None


class StageEvents(Struct, frozen=True, kw_only=True):
    """One stage: its source line, the laser state of each channel, immediate actions before it and while it moves.

    An action while the stage moves acts at its time, or if that is not known at the stage's start, after what is
    buffered before the first segment. `axes`: the axes (from 0) that X and Y drive. `start_ms`, `rest_ms`: when it
    starts, and is at rest, on the recorder's clock; NaN: not known.
    """

    line: int
    lasers: tuple[LaserState, ...]
    at_rest: tuple[ImmediateAction, ...] = ()
    moving: tuple[ImmediateAction, ...] = ()
    axes: tuple[int, int] = (0, 1)
    start_ms: float = math.nan
    rest_ms: float = math.nan


class MotionEvents(Struct, frozen=True, kw_only=True, eq=False):
    """Segments and dwells of all stages in order, (m,).

    Positions are of the machine, whatever the origin of a coordinate system. A dwell has a segment of no length, and
    `dwell_ms`; `vel`, `acc`, `vel_end` are not read there. `line`: source line. `call`: index of the call in its
    stream. `run_kind`: purpose of each jump (RunKind) where the planner states it, else None. `even_time_ms`: least
    time of each at constant velocity; None: none has one.
    """

    segments: Segments
    vel: Floats
    acc: Floats
    vel_end: Floats
    dwell: Bools
    dwell_ms: Floats
    line: npt.NDArray[np.int32]
    call: npt.NDArray[np.int32]
    run_kind: npt.NDArray[np.int8] | None = None
    even_time_ms: Floats | None = None

    def __len__(self) -> int:
        return len(self.dwell)


class LaserSwitchEvents(Struct, frozen=True, kw_only=True, eq=False):
    """Buffered switches of one channel in order, (e,).

    `mark_segment`: number of the segment before which the intended start or end of the mark is: `segment`, or where the
    planner puts it.
    """

    stage: Indices
    segment: Indices
    on: Bools
    mark_segment: Indices


class PowerEvents(Struct, frozen=True, kw_only=True, eq=False):
    """Settings of one channel's power in order, (e,).

    `low`: direct power, or the lowest power of a follow; NaN: no power is set. `ratio`: power per pulse/ms of a follow,
    0 for direct power. `high`: highest power of a follow, inf for direct power.
    """

    stage: Indices
    segment: Indices
    low: Floats
    ratio: Floats
    high: Floats


class ChannelEvents(Struct, frozen=True, kw_only=True):
    """Buffered events of one laser channel, and its state after the last stage."""

    channel: int
    switch: LaserSwitchEvents
    power: PowerEvents
    laser_at_end: LaserState


class Events(Struct, frozen=True, kw_only=True, eq=False):
    """Everything that a controller does with a stream.

    `stage_first` (s+1,): number of each stage's first segment, and m. `channels`: those that any call names.
    `at_end`: immediate actions after the last stage.
    """

    name: str
    stages: tuple[StageEvents, ...]
    stage_first: Indices
    motion: MotionEvents
    channels: tuple[ChannelEvents, ...]
    at_end: tuple[ImmediateAction, ...] = ()
