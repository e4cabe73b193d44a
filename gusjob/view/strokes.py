"""The path as strokes: straight pieces, each with its emission, power and velocity.

Strokes are contiguous, from the first motion to the last. They are cut where a segment ends and where emission begins
or ends. A run of at most FINE_STROKES is also cut between acceleration, constant velocity and deceleration, and at the
controller's ticks where power follows velocity or distance or the beam lags. Arcs are cut into chords.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.i18n.phrases import Phrase, figure
from gusjob.kinematics.arrays import Bools, Floats, Indices, counted
from gusjob.kinematics.chords import chord_counts
from gusjob.kinematics.schedule import Schedule
from gusjob.kinematics.units import MS_PER_S
from gusjob.report.rows import Report
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.lengths import mm_per_pulse
from gusjob.simulate.outputs.output_time import output_time_of
from gusjob.simulate.outputs.steps import ticks_in

FINE_STROKES = 300_000
"""Runs of more strokes are cut at segments and at changes of emission only."""

_CHORD_RAD = 0.05
_COARSE_CHORD_RAD = 0.3
_SAME_MS = 1e-9
"""Times that differ by less are equal but for rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """End points of strokes, (n,) each, mm."""

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats

    @property
    def length_mm(self) -> Floats:
        """Length of each stroke, mm."""
        return np.hypot(self.x1 - self.x0, self.y1 - self.y0)


@dataclass(frozen=True, slots=True, kw_only=True)
class EmissionStrokes:
    """The emission of one channel, per stroke.

    Attributes:
        channel: The channel.
        on: Whether the laser emits, (n,).
        power: Mean power during emission, else 0, in the mode's unit, (n,).
        units: Units of the channel's modes.
        unit: Index of the power's unit in `units`, (n,).
        joules_per_unit_ms: Factor from power * ms to joules, (n,); NaN if the rated power is unknown.
    """

    channel: int
    on: Bools
    power: Floats
    units: tuple[str, ...]
    unit: npt.NDArray[np.uint8]
    joules_per_unit_ms: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Strokes:
    """Strokes in order, (n,) each.

    Attributes:
        row: Row of the report.
        start_ms: Start.
        duration_ms: Duration.
        vel0: Path velocity at the start, mm/s.
        vel1: Path velocity at the end, mm/s.
        path: The commanded path.
        beam: The beam's path; None without a scanner.
        emissions: By channel.
        exact: Whether the strokes are cut finely; else `vel0` and `vel1` are the segment's highest velocity.
    """

    row: Indices
    start_ms: Floats
    duration_ms: Floats
    vel0: Floats
    vel1: Floats
    path: Line
    beam: Line | None
    emissions: tuple[EmissionStrokes, ...]
    exact: bool

    @property
    def actual(self) -> Line:
        """The beam's path; without a scanner the commanded path."""
        return self.path if self.beam is None else self.beam

    def per_mm(self, emission: EmissionStrokes) -> Floats:
        """Compute the power integral per mm of the beam's path, unit*ms/mm; NaN without emission or motion."""
        length = self.actual.length_mm
        found = np.full(len(length), np.nan)
        np.divide(emission.power * self.duration_ms, length, out=found, where=emission.on & (length > 0))
        return found


def strokes_of(trace: Trace, machine: Machine, fine_strokes: int = FINE_STROKES) -> Strokes:
    """Cut the path of a run into strokes."""
    schedule = trace.schedule
    cuts, exact = _cuts(trace, machine, fine_strokes)
    row, start = _stroke_starts(schedule, cuts)
    end = np.append(start[1:], schedule.times_ms[-1:])
    continues = np.append(row[1:] == row[:-1], False) if len(row) else np.zeros(0, dtype=np.bool_)
    end = np.where(continues, end, schedule.times_ms[1:][row])
    stage = schedule.stage[row]
    px, py = machine.pulses_per_mm
    scale = mm_per_pulse(trace.segments, machine)[row] * MS_PER_S
    if exact:
        vel0, vel1 = trace.motion.velocity(row, start) * scale, trace.motion.velocity(row, end) * scale
    else:
        vel0 = vel1 = (
            np.where(schedule.dwell, 0.0, np.maximum(schedule.profile.peak, schedule.profile.start))[row] * scale
        )
    x0, y0 = trace.motion.position(row, start)
    x1, y1 = trace.motion.position(row, end)
    beam = None
    if machine.scanner is not None:
        (bx0, by0), (bx1, by1) = trace.beam.position(stage, start), trace.beam.position(stage, end)
        beam = Line(x0=bx0 / px, y0=by0 / py, x1=bx1 / px, y1=by1 / py)
    spans = Intervals(stage=stage, start_ms=start, end_ms=end)
    return Strokes(
        row=row,
        start_ms=start,
        duration_ms=end - start,
        vel0=vel0,
        vel1=vel1,
        path=Line(x0=x0 / px, y0=y0 / py, x1=x1 / px, y1=y1 / py),
        beam=beam,
        emissions=tuple(_emission_strokes(trace, machine, channel, spans) for channel in trace.channels),
        exact=exact,
    )


def _cuts(trace: Trace, machine: Machine, fine_strokes: int) -> tuple[list[tuple[Indices, Floats]], bool]:
    """Return the cuts after each segment's start as (timed call, ms), and whether they are fine."""
    schedule = trace.schedule
    cuts = [_switch_times(schedule, channel) for channel in trace.channels]
    index = np.arange(len(trace))
    rise_end, fall_start = schedule.phases()
    fine = [
        *cuts,
        _chord_times(trace, _CHORD_RAD),
        (index, rise_end),
        (index, fall_start),
        *_tick_times(trace, machine, fine_strokes),
    ]
    if sum(len(call) for call, _ in fine) + len(index) <= fine_strokes:
        return fine, True
    return [*cuts, _chord_times(trace, _COARSE_CHORD_RAD)], False


def _switch_times(schedule: Schedule, channel: ChannelTrace) -> tuple[Indices, Floats]:
    """Return the times at which emission begins and ends during its stage's motion."""
    intervals = channel.emission
    stage = np.concatenate([intervals.stage, intervals.stage])
    time = np.concatenate([intervals.start_ms, intervals.end_ms])
    inside = (time >= schedule.stage_start()[stage]) & (time < schedule.stage_end()[stage])
    return schedule.segment_at(stage[inside], time[inside]), time[inside]


def _chord_times(trace: Trace, step_rad: float) -> tuple[Indices, Floats]:
    """Return times that cut arcs into chords of equal duration."""
    schedule, segments = trace.schedule, trace.segments
    count = chord_counts(segments.arcs.sweep, step_rad) - 1
    arc, part = counted(count)
    call = segments.arc_at[arc]
    return call, schedule.times_ms[call] + schedule.duration_ms[call] * ((part + 1) / (count[arc] + 1))


def _tick_times(trace: Trace, machine: Machine, most: int) -> list[tuple[Indices, Floats]]:
    """Return the ticks at which the beam or a following power changes; more than `most` zeros if there are too many."""
    schedule = trace.schedule
    stages = np.arange(len(schedule.stage_first) - 1)
    whole = Intervals(stage=stages, start_ms=schedule.stage_start(), end_ms=schedule.stage_end())
    spans = [c.emission.intervals for c in trace.channels if c.power.follows]
    found = []
    for of in [whole] if machine.scanner is not None else spans:
        if (of.end_ms - of.start_ms).sum() / trace.period_ms > most:
            return [(np.zeros(most + 1, dtype=np.intp), np.zeros(most + 1))]
        which, time = ticks_in(trace, of)
        inside = time < schedule.stage_end()[of.stage[which]]
        stage, time = of.stage[which[inside]], time[inside]
        found.append((schedule.segment_at(stage, time), time))
    return found


def _stroke_starts(schedule: Schedule, cuts: list[tuple[Indices, Floats]]) -> tuple[Indices, Floats]:
    """Return the start of each stroke, (timed call, ms). Every timed call has at least one stroke."""
    starts = schedule.times_ms[:-1]
    index = np.arange(len(starts))
    call = np.concatenate([index, *(call for call, _ in cuts)])
    time = np.concatenate([starts, *(time for _, time in cuts)])
    first = np.zeros(len(call), dtype=np.bool_)
    first[: len(index)] = True
    real = first | ((time > starts[call] + _SAME_MS) & (time < schedule.times_ms[1:][call] - _SAME_MS))
    call, time, first = call[real], time[real], first[real]
    order = np.lexsort((time, call))
    call, time, first = call[order], time[order], first[order]
    distinct = np.ones(len(call), dtype=np.bool_)
    distinct[1:] = first[1:] | (time[1:] > time[:-1] + _SAME_MS)
    return call[distinct], time[distinct]


def _emission_strokes(trace: Trace, machine: Machine, channel: ChannelTrace, spans: Intervals) -> EmissionStrokes:
    """Return a channel's emission in strokes; emission begins or ends inside none of them."""
    intervals, shift = channel.emission, output_time_of(trace).shift_ms
    starts = intervals.start_ms + shift[intervals.stage]
    middles = (spans.start_ms + spans.end_ms) / 2 + shift[spans.stage]
    index = np.searchsorted(starts, middles, side="right") - 1
    ends = np.append(intervals.end_ms + shift[intervals.stage], -np.inf)
    on = (middles < ends[index]) & (np.append(intervals.stage, -1)[index] == spans.stage)
    emitting = np.flatnonzero(on & (spans.end_ms > spans.start_ms))
    power = np.zeros(len(on))
    part = Intervals(stage=spans.stage[emitting], start_ms=spans.start_ms[emitting], end_ms=spans.end_ms[emitting])
    power[emitting] = channel.power.integral(part) / (part.end_ms - part.start_ms)
    return EmissionStrokes(
        channel=channel.channel,
        on=on,
        power=power,
        units=channel.units,
        unit=channel.unit_at(spans.stage),
        joules_per_unit_ms=channel.watts_per_unit(spans.stage, machine) / MS_PER_S,
    )


_SAME = 1e-6
"""Share of the emission that rounding may lose."""


def undrawn_emission(report: Report, strokes: Strokes, emission: EmissionStrokes) -> Iterator[Phrase]:
    """Yield remarks on emission outside of all strokes."""
    energy = emission.power * strokes.duration_ms
    entries = [entry for entry in report.totals["channels"] if entry["channel"] == emission.channel]
    for entry in entries:
        drawn = float(energy[emission.unit == emission.units.index(entry["unit"])].sum())
        undrawn = entry["power_ms"] + entry["before_motion_power_ms"] - drawn
        if undrawn > _SAME * entry["power_ms"]:
            yield Phrase(
                "Emission while standing still is not drawn (channel {channel}: {power} {unit}*ms).",
                power=figure(undrawn, 4),
                unit=entry["unit"],
                channel=emission.channel,
            )
    if entries and entries[-1]["lit_at_end"]:
        yield Phrase("Channel {channel} is left ON.", channel=emission.channel)
