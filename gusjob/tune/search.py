"""When light has to come and go, for a beam that lags: the moments at which the beam is nearest to the marks' ends.

Where the beam is does not hang on when the light comes, so one run shows all delays at once. A beam that starts from
rest is at the same point for a while: of all delays that are as near as can be, within a slack, the last is taken for
light on and the first for light off, so that no light stands on a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.interpreter import ChannelTrace, Trace
from gusjob.machine import Machine
from gusjob.report.ends import Place, ends_of
from gusjob.units import US_PER_MS

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]

_MOST_MARKS = 2000
"""So many marks, evenly picked, speak for all."""
_LAGS = 12
"""How many tracking errors behind the command light may come: the beam has come to rest long before."""
_COARSE = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearest:
    """Delays behind the command, whole us, and how far the beam is off then, RMS over the marks, mm."""

    on_us: int
    off_us: int
    on_miss_mm: float
    off_miss_mm: float


def nearest(trace: Trace, machine: Machine, channel: ChannelTrace, slack_pulse: float) -> Nearest | None:
    """For light that is switched where the marks of a channel begin and end; None without such marks."""
    ends, clock = ends_of(trace, machine, channel), trace.clock
    shine = channel.emission
    marks = np.flatnonzero((shine.on_row >= 0) & (shine.off_row >= 0))
    if not len(marks) or machine.scanner is None:
        return None
    marks = marks[np.unique(np.linspace(0, len(marks) - 1, min(len(marks), _MOST_MARKS)).astype(np.intp))]
    most_us = max(int(_LAGS * machine.scanner.tracking_error_us), 1)
    on, off = (
        _Side(
            trace=trace, machine=machine, stage=shine.stage[marks], time=clock.times[at[marks]], place=place.pick(marks)
        )
        for at, place in ((ends.on, ends.begin), (ends.off, ends.finish))
    )
    slack_mm = slack_pulse / min(machine.pulses_per_mm)
    on_us, off_us = on.best_us(most_us, slack_mm, last=True), off.best_us(most_us, slack_mm, last=False)
    return Nearest(on_us=on_us, off_us=off_us, on_miss_mm=on.miss_mm(on_us), off_miss_mm=off.miss_mm(off_us))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Side:
    """One end of marks: where it is meant to be, and when the command is there."""

    trace: Trace
    machine: Machine
    stage: Indices
    time: Floats
    place: Place

    def miss_mm(self, delay_us: float) -> float:
        """How far the beam is off a time after the command was there, RMS."""
        x, y = self.trace.beam.position(self.stage, self.time + delay_us / US_PER_MS)
        px, py = self.machine.pulses_per_mm
        return float(np.sqrt(np.mean(((x - self.place.x) / px) ** 2 + ((y - self.place.y) / py) ** 2)))

    def best_us(self, most_us: int, slack_mm: float, *, last: bool) -> int:
        """The last, or first, whole delay that is as near as can be within a slack."""
        step = max(most_us // _COARSE, 1)
        best = min(range(0, most_us + 1, step), key=self.miss_mm)
        best = min(range(max(best - step, 0), best + step + 1), key=self.miss_mm)
        near = self.miss_mm(best) + slack_mm
        way = step if last else -step
        while 0 <= best + way <= most_us and self.miss_mm(best + way) <= near:
            best += way
        while abs(way) > 1:  # Halve the last step.
            way = int(way / 2)
            if best + way >= 0 and self.miss_mm(best + way) <= near:
                best += way
        return best
