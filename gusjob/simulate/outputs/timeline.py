"""The time of signals: stages one behind the other, each waiting until light and switch of the one before are done.

A report counts its stages back to back. On a wire the off delay of a stage's last mark is seen before the next stage's
setup and motion, so a stage that ends in a delay moves what follows it by that delay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Floats, Indices
from gusjob.simulate import Trace


@dataclass(frozen=True, slots=True, kw_only=True)
class Timeline:
    """When stages start and end on the wires, (s,) ms, and by how much each is later there than in the report."""

    start_ms: Floats
    end_ms: Floats
    shift_ms: Floats

    @property
    def total_ms(self) -> float:
        """The end of all."""
        return float(self.end_ms[-1]) if len(self.end_ms) else 0.0

    def stage_at(self, time_ms: Floats) -> Indices:
        """The stage that moments lie in; of stages that take no time, the last."""
        stage = np.searchsorted(self.start_ms, time_ms, side="right") - 1
        return np.asarray(np.clip(stage, 0, max(len(self.start_ms) - 1, 0)))


def timeline_of(trace: Trace) -> Timeline:
    """The time axis of a run's signals."""
    clock = trace.clock
    starts, ends = clock.stage_start(), clock.stage_end()
    rest = np.zeros(len(starts))
    for channel in trace.channels:
        shine = channel.emission
        for spans in (shine.switch, shine):
            np.maximum.at(rest, spans.stage, spans.end_ms - ends[spans.stage])
        for stage, laser in enumerate(channel.lasers):
            if laser.fpk_us is not None:  # Its pulse may outlast a mark.
                mine = (shine.switch.stage == stage) & ~shine.carried
                fired = shine.switch.start_ms[mine] + laser.fpk_us[0] / 1e3
                rest[stage] = max(rest[stage], float((fired - ends[stage]).max(initial=0.0)))
    shift = np.concatenate([[0.0], np.cumsum(rest)[:-1]]) if len(rest) else rest
    start = starts + shift
    return Timeline(start_ms=start, end_ms=np.append(start[1:], ends[-1:] + shift[-1:] + rest[-1:]), shift_ms=shift)
