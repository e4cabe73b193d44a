"""The trace tick by tick, as a table in pieces: what a data acquisition at the controller's period would see."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from gusjob.columns import Columns, Words
from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import MS_PER_S, US_PER_MS
from gusjob.report.rows import scale_mm
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.outputs.timeline import Timeline, timeline_of

_PIECE_TICKS = 1 << 17
_ON_TICK = 1e-9
"""Part of a period by which rounding may put a tick outside its stage."""


def samples(
    trace: Trace,
    machine: Machine,
    lines: npt.NDArray[np.int32],
    start_ms: float = 0.0,
    end_ms: float | None = None,
) -> Iterator[Columns]:
    """A row a tick from `start_ms` to `end_ms` (the end), both included.

    time_ms counts as in the VCD file (see timeline); stage from 1; segment: row of the report, from 0; line: its
    source line (`lines` as they are to be shown); x_mm, y_mm the commanded position; vel_mm_s along the path; with a
    scanner beam_x_mm, beam_y_mm, where the beam really is; of each channel: power held from this tick on (in the mode's
    unit, whether there is light or not), on (1: light at this moment) and emission_us, light until the next tick; where
    the mode changes, the unit.
    """
    timeline = timeline_of(trace)
    scale = np.append(scale_mm(trace, machine), 0.0)
    stop = timeline.total_ms if end_ms is None else end_ms
    first, count = _tick_ranges(trace, timeline, start_ms, stop)
    ends = np.cumsum(count)
    total = int(count.sum())
    for begin in range(0, max(total, 1), _PIECE_TICKS):
        number = np.arange(begin, min(begin + _PIECE_TICKS, total))
        stage = np.searchsorted(ends, number, side="right")
        tick = (first[stage] + number - (ends - count)[stage]).astype(np.float64)
        yield _rows(trace, machine, timeline, lines, scale, stage, tick)


def _tick_ranges(trace: Trace, timeline: Timeline, start_ms: float, end_ms: float) -> tuple[Indices, Indices]:
    """First tick and number of ticks of each stage that lie in a time, its end (of motion and light) included."""
    period = trace.period_ms
    first = np.maximum(np.ceil((start_ms - timeline.start_ms) / period - _ON_TICK), 0.0)
    last = np.floor((np.minimum(timeline.end_ms, end_ms) - timeline.start_ms) / period + _ON_TICK)
    return first.astype(np.intp), np.maximum(last - first + 1, 0.0).astype(np.intp)


def _rows(
    trace: Trace,
    machine: Machine,
    timeline: Timeline,
    lines: npt.NDArray[np.int32],
    scale: Floats,
    stage: Indices,
    tick: Floats,
) -> Columns:
    clock, (px, py) = trace.clock, machine.pulses_per_mm
    time = clock.stage_start()[stage] + tick * trace.period_ms
    end = clock.stage_end()[stage]
    time = np.where(np.abs(time - end) < _ON_TICK * trace.period_ms, end, time)
    cell = clock.segment_at(stage, time)
    x, y = trace.motion.position(cell, time)
    table: Columns = {
        "time_ms": timeline.start_ms[stage] + tick * trace.period_ms,
        "stage": (stage + 1).astype(np.int32),
        "segment": cell.astype(np.int32),
        "line": np.append(lines, np.int32(0))[cell],
        "x_mm": x / px,
        "y_mm": y / py,
        "vel_mm_s": trace.motion.velocity(cell, time) * scale[cell] * MS_PER_S,
    }
    if machine.scanner is not None:
        beam_x, beam_y = trace.beam.position(stage, time)
        table |= {"beam_x_mm": beam_x / px, "beam_y_mm": beam_y / py}
    for channel in trace.channels:
        name = f"ch{channel.channel}_"
        on, light_ms = _light(trace, timeline, channel, stage, time)
        table[f"{name}power"] = trace.held_power(channel, stage, time)
        table[f"{name}on"] = on.astype(np.int8)
        table[f"{name}emission_us"] = light_ms * US_PER_MS
        if len(channel.units) > 1:
            table[f"{name}unit"] = Words(codes=channel.unit_at(stage), words=channel.units)
    return table


def _light(
    trace: Trace, timeline: Timeline, channel: ChannelTrace, stage: Indices, time: Floats
) -> tuple[Bools, Floats]:
    """Whether there is light at moments, and for how long until a period later, ms."""
    shine = channel.emission
    shift = timeline.shift_ms
    start, end = shine.start_ms + shift[shine.stage], shine.end_ms + shift[shine.stage]
    done = np.concatenate([[0.0], np.cumsum(end - start)])
    begin, behind = np.append(start, np.inf), np.append(end, np.inf)

    def before(moment: Floats) -> Floats:
        """Light until a moment."""
        number = np.searchsorted(start, moment, side="right")
        last = np.maximum(number - 1, 0)
        unfinished = np.where(number > 0, np.maximum(behind[last] - np.maximum(moment, begin[last]), 0.0), 0.0)
        return np.asarray(done[number] - unfinished)

    now = time + shift[stage]
    number = np.searchsorted(start, now, side="right") - 1
    on = (number >= 0) & (now < behind[number]) & (np.append(shine.stage, -1)[number] == stage)
    return on, before(np.minimum(now + trace.period_ms, timeline.end_ms[stage])) - before(now)
