"""Forecast of a run from the simulation: shown before the start, and used for the progress."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.dry_run import box_pulse
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.simulate import ChannelTrace, Trace


class ChannelForecast(Struct, frozen=True, kw_only=True, eq=False):
    """One laser in one unit of power.

    For each timed call, (m,): `power`, the highest, NaN without emission; `watts`, the same; `emission_ms`.
    """

    channel: int
    unit: str
    power: Floats
    watts: Floats
    emission_ms: Floats

    def remaining(self, number: int) -> tuple[float, float, float]:
        """Sum up from a timed call on.

        Returns:
            Emission in ms, the highest power, the highest watts (NaN: unknown; 0 without emission).
        """
        emitting = self.emission_ms[number:] > 0
        if not emitting.any():
            return 0.0, 0.0, 0.0
        power, watts = self.power[number:][emitting], self.watts[number:][emitting]
        return float(self.emission_ms[number:].sum()), float(power.max()), float(watts.max())


class Forecast(Struct, frozen=True, kw_only=True, eq=False):
    """What a run of n rows will do.

    `row_ms` (n+1,): planned start of each row, and the end; `timed` (n,): number of the timed call that the row comes
    before or is; `box_mm`: (x low, x high, y low, y high) of the marks (of all motion without marks), None without
    motion.
    """

    duration_ms: float
    row_ms: Floats
    timed: Indices
    box_mm: tuple[float, float, float, float] | None
    channels: tuple[ChannelForecast, ...]

    @property
    def emits(self) -> bool:
        """Whether any laser emits."""
        return any(channel.emission_ms.any() for channel in self.channels)

    def done_ms(self, row: int) -> float:
        """Return the planned time at which a row begins."""
        return float(self.row_ms[min(max(row, 0), len(self.row_ms) - 1)])

    def number(self, row: int) -> int:
        """Return the number of the timed call that a row comes before or is."""
        return int(self.timed[row]) if row < len(self.timed) else len(self.timed)

    def power(self, channel: ChannelForecast, row: int) -> float:
        """Return the highest power while a row is run, NaN without emission."""
        if not len(self.timed) or not len(channel.power):
            return float("nan")
        return float(channel.power[min(self.timed[min(row, len(self.timed) - 1)], len(channel.power) - 1)])


def forecast(stream: Stream, trace: Trace, machine: Machine) -> Forecast:
    """Compute what a run of a stream will do."""
    schedule = trace.schedule
    timed = np.searchsorted(trace.call, np.arange(len(stream.buffered)))
    box = box_pulse(trace)
    per_x, per_y = machine.pulses_per_mm
    return Forecast(
        duration_ms=float(schedule.times_ms[-1]),
        row_ms=np.append(schedule.times_ms[np.minimum(timed, len(trace))], schedule.times_ms[-1]),
        timed=timed,
        box_mm=None if box is None else (box[0] / per_x, box[1] / per_x, box[2] / per_y, box[3] / per_y),
        channels=tuple(found for channel in trace.channels for found in _channel(channel, trace, machine)),
    )


def _channel(channel: ChannelTrace, trace: Trace, machine: Machine) -> Iterator[ChannelForecast]:
    """Yield one forecast for each unit of power: a channel that changes from duty to analog has two."""
    emitted, stages = channel.emitted, trace.schedule.stage
    of_stage = np.array([laser.power_mode.unit for laser in channel.lasers] or [channel.laser_at_end.power_mode.unit])
    unit_of = of_stage[stages] if len(stages) else np.empty(0, dtype=of_stage.dtype)
    watts = emitted.power_max * channel.watts_per_unit(stages, machine)
    for unit in dict.fromkeys(of_stage.tolist()):
        mine = unit_of == unit
        emitting = mine & (emitted.emission_ms > 0)
        yield ChannelForecast(
            channel=channel.channel,
            unit=unit,
            power=np.where(emitting, emitted.power_max, np.nan),
            watts=np.where(emitting, watts, np.nan),
            emission_ms=np.where(mine, emitted.emission_ms, 0.0),
        )
