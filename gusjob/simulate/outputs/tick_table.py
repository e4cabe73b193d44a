"""Columns of ticks: the trace sampled at the controller's period."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import MS_PER_S, US_PER_MS
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.lengths import mm_per_pulse
from gusjob.simulate.outputs.output_time import OutputTime, output_time_of
from gusjob.tables.columns import CategoryColumn, Columns

_PIECE_TICKS = 1 << 17
_ON_TICK = 1e-9
"""Share of a period by which rounding may put a tick outside its stage."""


def tick_table(
    trace: Trace,
    machine: Machine,
    lines: npt.NDArray[np.int32],
    start_ms: float = 0.0,
    end_ms: float | None = None,
) -> Iterator[Columns]:
    """Make a table with one row a tick, in pieces.

    Args:
        trace: The simulation.
        machine: Its machine.
        lines: Source line of each segment to be shown, (m,).
        start_ms: First moment.
        end_ms: Last moment, included; None: the end of the run.

    Returns:
        Columns: time_ms as in the VCD file (see output_time.py); stage, from 1; segment, the row of the report, from 0;
        line; x_mm, y_mm, the commanded position; vel_mm_s along the path; with a scanner beam_x_mm, beam_y_mm. Of each
        channel: power held from this tick on, in the mode's unit, whether the laser emits or not; on, 1 while it emits;
        emission_us, emission until the next tick; the unit, if the mode changes.
    """
    output_time = output_time_of(trace)
    scale = np.append(mm_per_pulse(trace.segments, machine), 0.0)
    stop = output_time.total_ms if end_ms is None else end_ms
    first, count = _tick_ranges(trace, output_time, start_ms, stop)
    ends = np.cumsum(count)
    total = int(count.sum())
    for begin in range(0, max(total, 1), _PIECE_TICKS):
        number = np.arange(begin, min(begin + _PIECE_TICKS, total))
        stage = np.searchsorted(ends, number, side="right")
        tick = (first[stage] + number - (ends - count)[stage]).astype(np.float64)
        yield _rows(trace, machine, output_time, lines, scale, stage, tick)


def _tick_ranges(trace: Trace, output_time: OutputTime, start_ms: float, end_ms: float) -> tuple[Indices, Indices]:
    """First tick and number of ticks of each stage between two moments, the end of motion and emission included."""
    period = trace.period_ms
    first = np.maximum(np.ceil((start_ms - output_time.start_ms) / period - _ON_TICK), 0.0)
    last = np.floor((np.minimum(output_time.end_ms, end_ms) - output_time.start_ms) / period + _ON_TICK)
    return first.astype(np.intp), np.maximum(last - first + 1, 0.0).astype(np.intp)


def _rows(
    trace: Trace,
    machine: Machine,
    output_time: OutputTime,
    lines: npt.NDArray[np.int32],
    scale: Floats,
    stage: Indices,
    tick: Floats,
) -> Columns:
    schedule, (px, py) = trace.schedule, machine.pulses_per_mm
    time = schedule.stage_start()[stage] + tick * trace.period_ms
    end = schedule.stage_end()[stage]
    time = np.where(np.abs(time - end) < _ON_TICK * trace.period_ms, end, time)
    segment = schedule.segment_at(stage, time)
    x, y = trace.motion.position(segment, time)
    table: Columns = {
        "time_ms": output_time.start_ms[stage] + tick * trace.period_ms,
        "stage": (stage + 1).astype(np.int32),
        "segment": segment.astype(np.int32),
        "line": np.append(lines, np.int32(0))[segment],
        "x_mm": x / px,
        "y_mm": y / py,
        "vel_mm_s": trace.motion.velocity(segment, time) * scale[segment] * MS_PER_S,
    }
    if machine.scanner is not None:
        beam_x, beam_y = trace.beam.position(stage, time)
        table |= {"beam_x_mm": beam_x / px, "beam_y_mm": beam_y / py}
    for channel in trace.channels:
        name = f"ch{channel.channel}_"
        on, emission_ms = _emission(trace, output_time, channel, stage, time)
        table[f"{name}power"] = channel.power.value(stage, time)
        table[f"{name}on"] = on.astype(np.int8)
        table[f"{name}emission_us"] = emission_ms * US_PER_MS
        if len(channel.units) > 1:
            table[f"{name}unit"] = CategoryColumn(codes=channel.unit_at(stage), categories=channel.units)
    return table


def _emission(
    trace: Trace, output_time: OutputTime, channel: ChannelTrace, stage: Indices, time: Floats
) -> tuple[Bools, Floats]:
    """Whether a channel emits at moments, and how long until a period later, ms."""
    emission = channel.emission
    shift = output_time.shift_ms
    start, end = emission.start_ms + shift[emission.stage], emission.end_ms + shift[emission.stage]
    done = np.concatenate([[0.0], np.cumsum(end - start)])
    begin, stop = np.append(start, np.inf), np.append(end, np.inf)

    def before(moment: Floats) -> Floats:
        """Emission time until a moment."""
        number = np.searchsorted(start, moment, side="right")
        last = np.maximum(number - 1, 0)
        unfinished = np.where(number > 0, np.maximum(stop[last] - np.maximum(moment, begin[last]), 0.0), 0.0)
        return np.asarray(done[number] - unfinished)

    now = time + shift[stage]
    number = np.searchsorted(start, now, side="right") - 1
    on = (number >= 0) & (now < stop[number]) & (np.append(emission.stage, -1)[number] == stage)
    return on, before(np.minimum(now + trace.period_ms, output_time.end_ms[stage])) - before(now)
