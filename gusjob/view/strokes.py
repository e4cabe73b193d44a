"""The path in strokes: straight pieces, each with its light, its power and its velocity.

Strokes follow one another in time and place, from the first motion to the last. They are cut where a segment ends and
where light comes or goes; in a run that is not too long also where the velocity changes its law, and at the
controller's ticks where power follows something or the beam lags behind. Arcs are cut into chords.
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
"""Up to so many strokes are cut as fine as the controller works; longer runs by segments and light alone."""

_CHORD_RAD = 0.05
_COARSE_CHORD_RAD = 0.3
_SAME_MS = 1e-9
"""Moments nearer than that are one: rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Line:
    """Ends of strokes, (n,) each, mm."""

    x0: Floats
    y0: Floats
    x1: Floats
    y1: Floats

    @property
    def length_mm(self) -> Floats:
        """Length of each."""
        return np.hypot(self.x1 - self.x0, self.y1 - self.y0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Light:
    """One channel in strokes, (n,): light or none, mean power while there is light (else 0), in the mode's unit.

    `joules_per_unit_ms` (n,): what turns power * ms into joules; NaN where the rated power is unknown. `unit` (n,):
    place of the power's unit among `units`.
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

    `row`: row of the report. `vel0`, `vel1`: path velocity at start and end, mm/s. `path`: as commanded; `beam`: where
    the beam is, with a scanner. `exact`: cut as fine as the controller works; else `vel0` and `vel1` are the segment's
    highest velocity, and power is a mean.
    """

    row: Indices
    start_ms: Floats
    duration_ms: Floats
    vel0: Floats
    vel1: Floats
    path: Line
    beam: Line | None
    lights: tuple[Light, ...]
    exact: bool

    @property
    def burnt(self) -> Line:
        """Where light falls."""
        return self.path if self.beam is None else self.beam

    def per_mm(self, light: Light) -> Floats:
        """Power integral per mm of the beam's way under light, unit*ms/mm; NaN where nothing shines or moves."""
        length = self.burnt.length_mm
        found = np.full(len(length), np.nan)
        np.divide(light.power * self.duration_ms, length, out=found, where=light.on & (length > 0))
        return found


def strokes_of(trace: Trace, machine: Machine, fine_strokes: int = FINE_STROKES) -> Strokes:
    """The strokes of a run."""
    schedule = trace.schedule
    cuts, exact = _cuts(trace, machine, fine_strokes)
    row, start = _in_order(schedule, cuts)
    end = np.append(start[1:], schedule.times_ms[-1:])
    goes_on = np.append(row[1:] == row[:-1], False) if len(row) else np.zeros(0, dtype=np.bool_)
    end = np.where(goes_on, end, schedule.times_ms[1:][row])
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
        lights=tuple(_light(trace, machine, channel, spans) for channel in trace.channels),
        exact=exact,
    )


def _cuts(trace: Trace, machine: Machine, fine_strokes: int) -> tuple[list[tuple[Indices, Floats]], bool]:
    """(timed call, moment) of the cuts behind each segment's start, and whether they are fine."""
    schedule = trace.schedule
    cuts = [_light_edges(schedule, channel) for channel in trace.channels]
    number = np.arange(len(trace))
    risen, falls = schedule.phases()
    fine = [*cuts, _chords(trace, _CHORD_RAD), (number, risen), (number, falls), *_ticks(trace, machine, fine_strokes)]
    if sum(len(cell) for cell, _ in fine) + len(number) <= fine_strokes:
        return fine, True
    return [*cuts, _chords(trace, _COARSE_CHORD_RAD)], False


def _light_edges(schedule: Schedule, channel: ChannelTrace) -> tuple[Indices, Floats]:
    """Where light comes and goes while its stage moves."""
    shine = channel.emission
    stage = np.concatenate([shine.stage, shine.stage])
    time = np.concatenate([shine.start_ms, shine.end_ms])
    inside = (time >= schedule.stage_start()[stage]) & (time < schedule.stage_end()[stage])
    return schedule.segment_at(stage[inside], time[inside]), time[inside]


def _chords(trace: Trace, step_rad: float) -> tuple[Indices, Floats]:
    """Arcs in equal times."""
    schedule, arc_at, arcs = trace.schedule, trace.segments.arc_at, trace.segments.arcs
    count = chord_counts(arcs.sweep, step_rad) - 1
    which, part = counted(count)
    cell = arc_at[which]
    return cell, schedule.times_ms[cell] + schedule.duration_ms[cell] * ((part + 1) / (count[which] + 1))


def _ticks(trace: Trace, machine: Machine, most: int) -> list[tuple[Indices, Floats]]:
    """Ticks of the stages in which something is to be seen between them; too many: as many as are too many."""
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


def _in_order(schedule: Schedule, cuts: list[tuple[Indices, Floats]]) -> tuple[Indices, Floats]:
    """Start of each stroke: (timed call, ms). Every timed call has one, however short it is."""
    starts = schedule.times_ms[:-1]
    number = np.arange(len(starts))
    cell = np.concatenate([number, *(cell for cell, _ in cuts)])
    time = np.concatenate([starts, *(time for _, time in cuts)])
    first = np.zeros(len(cell), dtype=np.bool_)
    first[: len(number)] = True
    real = first | ((time > starts[cell] + _SAME_MS) & (time < schedule.times_ms[1:][cell] - _SAME_MS))
    cell, time, first = cell[real], time[real], first[real]
    order = np.lexsort((time, cell))
    cell, time, first = cell[order], time[order], first[order]
    apart = np.ones(len(cell), dtype=np.bool_)
    apart[1:] = first[1:] | (time[1:] > time[:-1] + _SAME_MS)
    return cell[apart], time[apart]


def _light(trace: Trace, machine: Machine, channel: ChannelTrace, spans: Intervals) -> Light:
    """A channel's light in strokes, none of which has an edge of that light inside."""
    shine, shift = channel.emission, output_time_of(trace).shift_ms
    begin = shine.start_ms + shift[shine.stage]
    middle = (spans.start_ms + spans.end_ms) / 2 + shift[spans.stage]
    number = np.searchsorted(begin, middle, side="right") - 1
    behind = np.append(shine.end_ms + shift[shine.stage], -np.inf)
    on = (middle < behind[number]) & (np.append(shine.stage, -1)[number] == spans.stage)
    lit = np.flatnonzero(on & (spans.end_ms > spans.start_ms))
    power = np.zeros(len(on))
    part = Intervals(stage=spans.stage[lit], start_ms=spans.start_ms[lit], end_ms=spans.end_ms[lit])
    power[lit] = channel.power.integral(part) / (part.end_ms - part.start_ms)
    return Light(
        channel=channel.channel,
        on=on,
        power=power,
        units=channel.units,
        unit=channel.unit_at(spans.stage),
        joules_per_unit_ms=channel.watts_per_unit(spans.stage, machine) / MS_PER_S,
    )


_SAME = 1e-6
"""Part of the light that rounding may lose."""


def left_out(report: Report, strokes: Strokes, light: Light) -> Iterator[Phrase]:
    """What is to be said of light that belongs to no stroke."""
    energy = light.power * strokes.duration_ms
    entries = [entry for entry in report.totals["channels"] if entry["channel"] == light.channel]
    for entry in entries:
        drawn = float(energy[light.unit == light.units.index(entry["unit"])].sum())
        rest = entry["power_ms"] + entry["before_motion_power_ms"] - drawn
        if rest > _SAME * entry["power_ms"]:
            yield Phrase(
                "Not drawn: {power} {unit}*ms of light of channel {channel} before the motion or behind the end of a "
                "stage.",
                power=figure(rest, 4),
                unit=entry["unit"],
                channel=light.channel,
            )
    if entries and entries[-1]["lit_at_end"]:
        yield Phrase("Channel {channel} is left ON.", channel=light.channel)
