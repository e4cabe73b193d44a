"""What came out of a run: every segment's times, velocities and light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.ir.intent import Intent
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate.beam import Beam
from gusjob.simulate.clock import Clock
from gusjob.simulate.emission import Emission
from gusjob.simulate.path import Motion
from gusjob.simulate.power import Emitted, held_power, integrals
from gusjob.simulate.settings import PowerCalls
from gusjob.simulate.spans import Spans
from gusjob.simulate.state import LaserState


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelTrace:
    """One laser: its state in each stage and behind the last, when it shone, and what each timed call emitted.

    `lost_power_ms`: light before the first motion, which belongs to no segment. `powers`: what the emission was
    integrated with.
    """

    channel: int
    lasers: tuple[LaserState, ...]
    at_end: LaserState
    emission: Emission
    powers: PowerCalls
    emitted: Emitted
    lost_power_ms: float
    lit_at_end: bool

    @property
    def units(self) -> tuple[str, ...]:
        """Units of its power, in the order in which its modes come."""
        states = self.lasers or (self.at_end,)
        return tuple(dict.fromkeys(state.power_mode.unit for state in states))

    def unit_at(self, stages: Indices) -> npt.NDArray[np.uint8]:
        """Place of the unit among `units` in stages."""
        table = [self.units.index(state.power_mode.unit) for state in self.lasers] or [0]
        return np.array(table, dtype=np.uint8)[stages]

    def watts_per_unit(self, stages: Indices, machine: Machine) -> Floats:
        """Watts per unit of power in segments of these stages; NaN where the rated power is unknown."""
        laser = machine.laser(self.channel)
        per_stage = [laser.watts_per_unit(state.power_mode, state.pulse_width_us) for state in self.lasers]
        table = np.array([np.nan if w is None else w for w in per_stage] or [np.nan])
        return table[stages] if len(stages) else np.empty(0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """A run. Times in ms, positions in pulse; one entry a timed call (motion or dwell), (m,).

    `line`: source line of each. `intent`: of a planned job with sky writing, else None.
    """

    name: str
    period_us: float
    line: npt.NDArray[np.int32]
    clock: Clock
    motion: Motion
    beam: Beam
    channels: tuple[ChannelTrace, ...]
    readings: tuple[tuple[int, int, int], ...]
    intent: Intent | None = None

    @property
    def period_ms(self) -> float:
        """The controller's tick."""
        return self.period_us / US_PER_MS

    def power_ms(self, channel: ChannelTrace, spans: Spans) -> Floats:
        """Integral of a channel's held power over spans of time, (k,), unit * ms."""
        return integrals(self.motion, self.beam, channel.powers, list(channel.lasers), self.period_ms, spans)

    def held_power(self, channel: ChannelTrace, stage: Indices, time_ms: Floats) -> Floats:
        """A channel's power at moments of stages, (k,), whether its light is on or not."""
        lasers = list(channel.lasers)
        return held_power(self.motion, self.beam, channel.powers, lasers, self.period_ms, stage, time_ms)
