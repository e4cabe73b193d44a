"""When light has to come and go, for a beam that lags: the moments at which the beam is nearest to the marks' ends.

Where the beam is does not hang on when the light comes, so one run shows all delays at once. A beam that starts from
rest is at the same point for a while: of all delays that are as near as can be, within a slack, the last is taken for
light on and the first for light off, so that no light stands on a point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.mark_ends import MarkPoints, mark_ends_of

_MOST_MARKS = 2000
"""So many marks, evenly picked, speak for all."""
_LAGS = 12
"""How many tracking errors behind the command light may come: the beam has come to rest long before."""
_COARSE = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Band:
    """The first and last of the delays behind the command, whole us, that are as near as can be within a slack.

    `miss_mm`: how far the beam is off with the nearest of all, RMS over the marks.
    """

    first_us: int
    last_us: int
    miss_mm: float


def nearest_delays(
    trace: Trace, machine: Machine, channel: ChannelTrace, *, slack_pulse: float, most_us: float
) -> tuple[Band, Band] | None:
    """Delays of light on and light off, up to `most_us`, for light that is switched where the marks of a channel begin
    and end; None without such marks. Of a job with sky writing, the marks that are sky-written."""
    ends, schedule = mark_ends_of(trace, machine, channel), trace.schedule
    shine = channel.emission
    switched = (shine.on_event >= 0) & (shine.off_event >= 0)
    if trace.run_kind is not None:
        switched &= trace.run_kind[np.maximum(ends.first_motion - 1, 0)] == RunKind.RUN_IN
    marks = np.flatnonzero(switched)
    if not len(marks) or machine.scanner is None:
        return None
    marks = marks[np.unique(np.linspace(0, len(marks) - 1, min(len(marks), _MOST_MARKS)).astype(np.intp))]
    most = int(min(_LAGS * machine.scanner.tracking_error_us, most_us))
    on, off = (
        _MarkEnds(
            trace=trace,
            machine=machine,
            stage=shine.stage[marks],
            time=schedule.times_ms[at[marks]],
            place=place.pick(marks),
        )
        for at, place in ((ends.start_segment, ends.start), (ends.end_segment, ends.end))
    )
    slack_mm = slack_pulse / min(machine.pulses_per_mm)
    return on.band(most, slack_mm), off.band(most, slack_mm)


@dataclass(frozen=True, slots=True, kw_only=True)
class _MarkEnds:
    """One end of marks: where it is meant to be, and when the command is there."""

    trace: Trace
    machine: Machine
    stage: Indices
    time: Floats
    place: MarkPoints

    def miss_mm(self, delay_us: float) -> float:
        """How far the beam is off a time after the command was there, RMS."""
        x, y = self.trace.beam.position(self.stage, self.time + delay_us / US_PER_MS)
        px, py = self.machine.pulses_per_mm
        return float(np.sqrt(np.mean(((x - self.place.x) / px) ** 2 + ((y - self.place.y) / py) ** 2)))

    def band(self, most_us: int, slack_mm: float) -> Band:
        """The delays from 0 to `most_us` that are as near as can be within a slack."""
        best = self._nearest_us(most_us)
        miss = self.miss_mm(best)
        first, last = (self._edge_us(best, way, most_us, miss + slack_mm) for way in (-1, 1))
        return Band(first_us=first, last_us=last, miss_mm=miss)

    def _nearest_us(self, most_us: int) -> int:
        """The nearest of all delays, on a grid that grows finer around it."""
        low, high = 0, most_us
        while True:
            step = -(-(high - low) // _COARSE) or 1
            best = min(range(low, high + 1, step), key=self.miss_mm)
            if step == 1:
                return best
            low, high = max(best - step, 0), min(best + step, most_us)

    def _edge_us(self, best: int, way: int, most_us: int, near_mm: float) -> int:
        """How far one can go from the nearest delay in one way and stay near."""
        room = most_us - best if way > 0 else best
        step = max(most_us // _COARSE, 1)
        near, far = 0, min(step, room + 1)
        while far <= room and self.miss_mm(best + way * far) <= near_mm:
            near, far = far, min(far + step, room + 1)
        while far - near > 1:
            middle = (near + far) // 2
            if self.miss_mm(best + way * middle) <= near_mm:
                near = middle
            else:
                far = middle
        return best + way * near
