"""The path as strokes: straight pieces, each with its emission, power and velocity.

Strokes are contiguous, from the first motion to the last. They are cut where a segment ends and where emission begins
or ends. A run of at most FINE_STROKES is also cut between acceleration, constant velocity and deceleration, where
energy per mm changes, and at the controller's ticks where power follows velocity or distance or the beam lags. Arcs are
cut into chords.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from msgspec import Struct

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
from gusjob.simulate.quality.energy_bins import NO_BINS, EnergyBins, energy_bins_of

FINE_STROKES = 300_000
"""Runs of more strokes are cut at segments and at changes of emission only."""

_CHORD_RAD = 0.05
_COARSE_CHORD_RAD = 0.3
_ENERGY_STEPS = 6
"""Energy per mm is constant in a stroke up to a step, of which there are so many in a factor of two."""
_ENERGY_OFFSET = 0.3819
"""Keeps the ends of the steps away from round values, at which rounding errors would cut each bin."""
_ONE_BIN = 1.0 + 1e-6
"""A stroke that is not longer has the value of the bin of its middle."""
_SAME_MS = 1e-9
"""Times that differ by less are equal but for rounding."""


class Line(Struct, frozen=True, kw_only=True, eq=False):
    """End points of strokes, (n,) each, mm."""

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats

    @property
    def length_mm(self) -> Floats:
        """Length of each stroke, mm."""
        return np.hypot(self.x1 - self.x0, self.y1 - self.y0)


class EmissionStrokes(Struct, frozen=True, kw_only=True, eq=False):
    """The emission of one channel, per stroke.

    Attributes:
        channel: The channel.
        on: Whether the laser emits, (n,).
        power: Mean power during emission, else 0, in the mode's unit, (n,).
        per_mm: Energy per mm: mean of the report's bins along the stroke, unit*ms/mm, (n,); NaN without emission, and
            in marks that do not move. Fine strokes are cut where it changes, and at the ends of each mark's peak.
        peak_per_mm: Highest energy per mm of all bins, by unit, (units,); NaN if there is none.
        units: Units of the channel's modes.
        unit: Index of the power's unit in `units`, (n,).
        joules_per_unit_ms: Factor from power * ms to joules, (n,); NaN if the rated power is unknown.
    """

    channel: int
    on: Bools
    power: Floats
    per_mm: Floats
    peak_per_mm: Floats
    units: tuple[str, ...]
    unit: npt.NDArray[np.uint8]
    joules_per_unit_ms: Floats


class Strokes(Struct, frozen=True, kw_only=True, eq=False):
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


def strokes_of(trace: Trace, machine: Machine, fine_strokes: int = FINE_STROKES, *, energy: bool = True) -> Strokes:
    """Cut the path of a run into strokes. `energy`: compute energy per mm too, and cut where it changes."""
    schedule = trace.schedule
    bins = [energy_bins_of(trace, machine, channel) if energy else NO_BINS for channel in trace.channels]
    cuts = _cuts(trace, machine, bins, fine_strokes)
    row, start = _stroke_starts(schedule, cuts.times)
    end = np.append(start[1:], schedule.times_ms[-1:])
    continues = np.append(row[1:] == row[:-1], False) if len(row) else np.zeros(0, dtype=np.bool_)
    end = np.where(continues, end, schedule.times_ms[1:][row])
    stage = schedule.stage[row]
    px, py = machine.pulses_per_mm
    scale = mm_per_pulse(trace.segments, machine)[row] * MS_PER_S
    if cuts.exact:
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
        emissions=tuple(
            _emission_strokes(trace, machine, channel, spans, of)
            for channel, of in zip(trace.channels, bins, strict=True)
        ),
        exact=cuts.exact,
    )


class _Cuts(Struct, frozen=True, kw_only=True, eq=False):
    """Cuts after each segment's start as (timed call, ms). `exact`: whether they are fine."""

    times: list[tuple[Indices, Floats]]
    exact: bool


def _cuts(trace: Trace, machine: Machine, bins: list[EnergyBins], fine_strokes: int) -> _Cuts:
    """Return the finest cuts that make no more than so many strokes."""
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
    finest = [*fine, *(_energy_times(trace, channel, of) for channel, of in zip(trace.channels, bins, strict=True))]
    for times in (finest, fine):
        if sum(len(call) for call, _ in times) + len(index) <= fine_strokes:
            return _Cuts(times=times, exact=True)
    return _Cuts(times=[*cuts, _chord_times(trace, _COARSE_CHORD_RAD)], exact=False)


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


def _energy_times(trace: Trace, channel: ChannelTrace, bins: EnergyBins) -> tuple[Indices, Floats]:
    """Return the times at which energy per mm passes from step to step of a geometric scale, and the peak's ends."""
    with np.errstate(divide="ignore"):
        step = np.floor(np.log2(bins.per_mm) * _ENERGY_STEPS + _ENERGY_OFFSET)
    mark, peak = bins.mark, _peak_bins(bins)
    changes = np.flatnonzero(step[1:] != step[:-1]) + 1
    cuts = np.unique(np.concatenate([changes, peak, peak[peak + 1 < len(mark)] + 1]))
    cuts = cuts[(cuts > 0) & (mark[cuts] == mark[cuts - 1])]
    schedule, stage, time = trace.schedule, channel.emission.stage[mark[cuts]], bins.start_ms[cuts]
    inside = (time >= schedule.stage_start()[stage]) & (time < schedule.stage_end()[stage])
    return schedule.segment_at(stage[inside], time[inside]), time[inside]


def _peak_bins(bins: EnergyBins) -> Indices:
    """Return the first of the highest bins of each mark."""
    if not len(bins.per_mm):
        return np.zeros(0, dtype=np.intp)
    mark, highest = bins.mark, np.maximum.reduceat(bins.per_mm, bins.first[:-1])
    at = np.flatnonzero(bins.per_mm == highest[mark])
    return np.asarray(at[np.unique(mark[at], return_index=True)[1]])


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


def _mean_per_mm(bins: EnergyBins, shift_ms: Floats, ends_ms: Floats, start_ms: Floats, end_ms: Floats) -> Floats:
    """Return the mean energy per mm of strokes over the bins' length.

    Args:
        bins: The bins.
        shift_ms: Shift of each bin to output time.
        ends_ms: End of each mark in output time.
        start_ms: Start of each stroke in output time.
        end_ms: End of each.
    """
    value = bins.per_mm
    if not len(value) or not len(start_ms):
        return np.full(len(start_ms), np.nan)
    begin = bins.start_ms + shift_ms
    end = np.append(begin[1:], ends_ms[-1:])
    end[bins.first[1:] - 1] = ends_ms
    upto = np.concatenate([[0.0], np.cumsum(np.where(np.isnan(value), 0.0, value))])
    middle = np.maximum(np.searchsorted(begin, (start_ms + end_ms) / 2, side="right") - 1, 0)

    def places(time: Floats) -> tuple[Floats, Floats]:
        """Return the length up to a time, in bins, and the integral up to there."""
        at = np.maximum(np.searchsorted(begin, time, side="right") - 1, 0)
        long = end[at] - begin[at]
        share = np.divide(time - begin[at], long, out=np.zeros_like(time), where=long > 0)
        share = np.clip(share, 0.0, 1.0)
        return at + share, upto[at] + share * (upto[at + 1] - upto[at])

    (first, low), (last, high) = places(start_ms), places(end_ms)
    found = value[middle].copy()
    several = last - first > _ONE_BIN
    np.divide(high - low, last - first, out=found, where=several & ~np.isnan(found))
    return np.asarray(found)


def _emission_strokes(
    trace: Trace, machine: Machine, channel: ChannelTrace, spans: Intervals, bins: EnergyBins
) -> EmissionStrokes:
    """Return a channel's emission in strokes; emission begins or ends inside none of them."""
    intervals, shift = channel.emission, output_time_of(trace).shift_ms
    starts = intervals.start_ms + shift[intervals.stage]
    middles = (spans.start_ms + spans.end_ms) / 2 + shift[spans.stage]
    index = np.searchsorted(starts, middles, side="right") - 1
    ends = np.append(intervals.end_ms + shift[intervals.stage], -np.inf)
    on = (middles < ends[index]) & (np.append(intervals.stage, -1)[index] == spans.stage)
    emitting = np.flatnonzero(on & (spans.end_ms > spans.start_ms))
    power, per_mm = np.zeros(len(on)), np.full(len(on), np.nan)
    part = Intervals(stage=spans.stage[emitting], start_ms=spans.start_ms[emitting], end_ms=spans.end_ms[emitting])
    power[emitting] = channel.power.integral(part) / (part.end_ms - part.start_ms)
    per_mm[emitting] = _mean_per_mm(
        bins,
        shift_ms=shift[intervals.stage][bins.mark],
        ends_ms=intervals.end_ms + shift[intervals.stage],
        start_ms=part.start_ms + shift[part.stage],
        end_ms=part.end_ms + shift[part.stage],
    )
    return EmissionStrokes(
        channel=channel.channel,
        on=on,
        power=power,
        per_mm=per_mm,
        peak_per_mm=_peaks(channel, bins),
        units=channel.units,
        unit=channel.unit_at(spans.stage),
        joules_per_unit_ms=channel.watts_per_unit(spans.stage, machine) / MS_PER_S,
    )


def _peaks(channel: ChannelTrace, bins: EnergyBins) -> Floats:
    """Return the highest energy per mm of each unit."""
    unit = channel.unit_at(channel.emission.stage)[bins.mark]
    peaks = np.full(len(channel.units), -np.inf)
    known = ~np.isnan(bins.per_mm)
    np.maximum.at(peaks, unit[known], bins.per_mm[known])
    return np.where(np.isinf(peaks), np.nan, peaks)


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
                "Emission while standing still is not drawn (channel {channel}: {power} {unit}·ms).",
                power=figure(undrawn, 4),
                unit=entry["unit"],
                channel=emission.channel,
            )
    if entries and entries[-1]["lit_at_end"]:
        yield Phrase("Channel {channel} is left ON.", channel=emission.channel)
