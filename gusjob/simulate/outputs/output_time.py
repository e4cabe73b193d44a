"""Time axis of the outputs: each stage waits until emission and switch of the one before have ended.

A report counts its stages back to back. On the outputs the off delay of a stage's last mark comes before the next
stage's setup and motion, so a stage that ends in a delay shifts what follows it by that delay.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import Trace


class OutputTime(Struct, frozen=True, kw_only=True, eq=False):
    """Start and end of stages on the outputs, (s,) ms, and by how much each is later there than in the schedule."""

    start_ms: Floats
    end_ms: Floats
    shift_ms: Floats

    @property
    def total_ms(self) -> float:
        """End of the last stage."""
        return float(self.end_ms[-1]) if len(self.end_ms) else 0.0

    def stage_at(self, time_ms: Floats) -> Indices:
        """Stage at each moment; of stages that take no time, the last."""
        stage = np.searchsorted(self.start_ms, time_ms, side="right") - 1
        return np.asarray(np.clip(stage, 0, max(len(self.start_ms) - 1, 0)))


def output_time_of(trace: Trace) -> OutputTime:
    """Compute the time axis of a trace's outputs."""
    starts, ends = trace.schedule.stage_start(), trace.schedule.stage_end()
    rest = np.zeros(len(starts))
    for channel in trace.channels:
        emission = channel.emission
        for intervals in (emission.switch, emission.intervals):
            np.maximum.at(rest, intervals.stage, intervals.end_ms - ends[intervals.stage])
        for stage, laser in enumerate(channel.lasers):
            if laser.fpk_us is not None:  # Its pulse may outlast a mark.
                mine = (emission.switch.stage == stage) & ~emission.carried
                pulse_end = emission.switch.start_ms[mine] + laser.fpk_us[0] / US_PER_MS
                rest[stage] = max(rest[stage], float((pulse_end - ends[stage]).max(initial=0.0)))
    shift = np.concatenate([[0.0], np.cumsum(rest)[:-1]]) if len(rest) else rest
    start = starts + shift
    return OutputTime(start_ms=start, end_ms=np.append(start[1:], ends[-1:] + shift[-1:] + rest[-1:]), shift_ms=shift)
