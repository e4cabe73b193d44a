"""Trace: the result of a simulation, with times, velocities and emission of every segment."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Duty2Switch, Machine
from gusjob.kinematics.arrays import Floats, Indices, picked
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.beam import Beam
from gusjob.simulate.emission import Emission
from gusjob.simulate.events import LaserState, LaserSwitchEvents
from gusjob.simulate.motion import Motion
from gusjob.simulate.power import HeldPower, SegmentEmission


class ChannelTrace(Struct, frozen=True, kw_only=True):
    """One laser channel: its state in each stage and after the last, its emission and its power.

    `emitted`: emission of each segment. `before_motion_power_ms`: power * ms emitted before the first segment, which
    belongs to none. `switch`: the buffered switches, which `emission` refers to.
    """

    channel: int
    lasers: tuple[LaserState, ...]
    laser_at_end: LaserState
    switch: LaserSwitchEvents
    emission: Emission
    power: HeldPower
    emitted: SegmentEmission
    before_motion_power_ms: float

    @property
    def units(self) -> tuple[str, ...]:
        """Units of its power, in the order in which its modes come."""
        states = self.lasers or (self.laser_at_end,)
        return tuple(dict.fromkeys(state.power_mode.unit for state in states))

    def unit_at(self, stages: Indices) -> npt.NDArray[np.uint8]:
        """Index among `units` of the unit in stages."""
        table = [self.units.index(state.power_mode.unit) for state in self.lasers] or [0]
        return picked(np.array(table, dtype=np.uint8), stages)

    def watts_per_unit(self, stages: Indices, machine: Machine) -> Floats:
        """Watts per unit of power in segments of these stages; NaN where the rated power is unknown."""
        laser = machine.laser(self.channel)
        per_stage = [laser.watts_per_unit(state.power_mode, state.pulse_width_us) for state in self.lasers]
        table = np.array([np.nan if w is None else w for w in per_stage] or [np.nan])
        return picked(table, stages) if len(stages) else np.empty(0)

    def joules(self, stages: Indices, machine: Machine) -> Floats:
        """Energy of each segment; NaN where the rated power is unknown. `stages`: the stage of each, (m,)."""
        watts_per_unit = self.watts_per_unit(stages, machine)
        if np.isnan(watts_per_unit).all():
            return np.broadcast_to(np.nan, len(stages))
        joules = self.emitted.power_ms * watts_per_unit
        joules /= 1e3
        return joules

    @property
    def first_emitting(self) -> int | None:
        """Number of the first segment with emission."""
        emits = self.emitted.emission_ms > 0
        return int(emits.argmax()) if emits.any() else None

    def laser_in(self, segment: int) -> LaserState:
        """State of the laser in a segment."""
        return self.lasers[int(self.power.motion.schedule.stage[segment])]


class Trace(Struct, frozen=True, kw_only=True, eq=False):
    """Result of a simulation. Times in ms, positions in pulse; columns have one entry a segment or dwell, (m,).

    `line`: source line of each. `call`: index of its call in the stream. `stage_line` (s,): source line of each stage's
    start. `kind`: SegmentKind of each. `is_sky_written`: a planned job with sky writing. `readings`: (line, channel,
    value) of each reading of a switch. `duty2_switch`: what the switch line carries in duty mode 2.
    """

    name: str
    period_us: float
    line: npt.NDArray[np.int32]
    call: npt.NDArray[np.int32]
    stage_line: npt.NDArray[np.int32]
    motion: Motion
    beam: Beam
    channels: tuple[ChannelTrace, ...]
    readings: tuple[tuple[int, int, int], ...]
    kind: npt.NDArray[np.int8]
    is_sky_written: bool = False
    duty2_switch: Duty2Switch = Duty2Switch.ON

    def __len__(self) -> int:
        """Number of segments, dwells included."""
        return len(self.motion)

    @property
    def schedule(self) -> Schedule:
        """When each segment runs, and how fast."""
        return self.motion.schedule

    @property
    def segments(self) -> Segments:
        """Geometry of the segments; a dwell has no length."""
        return self.motion.segments

    @property
    def period_ms(self) -> float:
        """The controller's tick."""
        return self.period_us / US_PER_MS
