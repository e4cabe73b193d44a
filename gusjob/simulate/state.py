"""What a run is made of: how lasers stand, what each stage runs, what was done at rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gusjob.controllers.gus.ranges import MODE_LIMIT, PowerMode
from gusjob.diagnostics.model import Diagnostic
from gusjob.kinematics.arrays import Indices

EXECUTION_ERROR, PARAMETER_ERROR = 1, 7
"""Return codes (sister series)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserState:
    """How a channel stands, all but its switch and power. Mode None: never set, taken as duty 0..100 %."""

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
    """None: GT_SetLaserDisRatio was never called."""

    @property
    def power_mode(self) -> PowerMode:
        """The mode in force."""
        return PowerMode.DUTY if self.mode is None else self.mode

    @property
    def follows_distance(self) -> bool:
        """Whether a distance term is added and clamped (a term of ratio 0 is clamped too)."""
        return self.distance and self.distance_limits is not None


@dataclass(frozen=True, slots=True, kw_only=True)
class Action:
    """An immediate switch or power. `power` None: the switch."""

    channel: int
    on: bool = False
    power: float | None = None
    line: int = 0


@dataclass(slots=True, kw_only=True)
class StageRun:
    """One start of a coordinate system: buffered rows in order, lasers in force, immediate actions.

    `waiting`: how many of the first parts were in the FIFO before the start.
    """

    crd: int
    fifo: int
    line: int
    parts: list[Indices]
    lasers: tuple[LaserState, LaserState]
    at_rest: list[Action]
    moving: list[Action] = field(default_factory=list)
    vel_max: float = float("inf")
    axes: tuple[int, int] = (0, 1)
    waiting: int = 0

    @property
    def rows(self) -> Indices:
        """Buffered rows in order."""
        return np.concatenate(self.parts) if self.parts else np.empty(0, dtype=np.intp)


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """What ran.

    Stages, what was done at rest behind the last one, switch readings (line, channel, value), channels named.
    """

    stages: tuple[StageRun, ...]
    at_end: tuple[Action, ...]
    lasers: tuple[LaserState, LaserState]
    readings: tuple[tuple[int, int, int], ...]
    channels: tuple[int, ...]
    diagnostics: tuple[Diagnostic, ...]
