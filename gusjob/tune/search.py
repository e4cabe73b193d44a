"""Search of the switching times at which a lagging beam is nearest to the ends of the marks.

The path of the beam does not depend on the laser's switching, so one simulation is enough for all delays. A beam that
starts from rest stays near the same point for a while. Of all delays that are nearest within a slack, the last is used
for laser on and the first for laser off, so that the laser does not dwell on a point.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.kinematics.units import US_PER_MS
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.kinds import SegmentKind
from gusjob.simulate.quality.mark_ends import MarkPoints, mark_ends_of

_MOST_MARKS = 2000
"""Maximum number of marks, evenly selected, that are evaluated."""
_LAGS = 12
"""Longest delay in tracking errors: the beam has come to rest long before."""
_COARSE = 128


class Band(Struct, frozen=True, kw_only=True):
    """The first and last of the delays, in whole us, that are nearest within a slack.

    `miss_mm`: distance of the beam from the intended points with the nearest delay, RMS over the marks.
    """

    first_us: int
    last_us: int
    miss_mm: float


def nearest_delays(
    trace: Trace, machine: Machine, channel: ChannelTrace, *, slack_pulse: float, most_us: float
) -> tuple[Band, Band] | None:
    """Find the delays of laser on and laser off.

    Only marks count that are switched by calls at their begin and end; with sky writing only sky-written marks.

    Args:
        trace: The run.
        machine: Its machine, with a scanner.
        channel: The channel.
        slack_pulse: Slack of the distance, pulses.
        most_us: Longest delay.

    Returns:
        Bands for laser on and laser off; None without such marks.
    """
    ends, schedule = mark_ends_of(trace, machine, channel), trace.schedule
    emission = channel.emission
    is_switched = (emission.on_event >= 0) & (emission.off_event >= 0)
    if trace.is_sky_written:
        is_switched &= trace.kind[np.maximum(ends.first_motion - 1, 0)] == SegmentKind.RUN_IN
    marks = np.flatnonzero(is_switched)
    if not len(marks) or machine.scanner is None:
        return None
    marks = marks[np.unique(np.linspace(0, len(marks) - 1, min(len(marks), _MOST_MARKS)).astype(np.intp))]
    most = longest_us(machine, most_us)
    on, off = (
        _TargetPoints(
            trace=trace,
            machine=machine,
            stage=emission.stage[marks],
            time=schedule.times_ms[at[marks]],
            target=target.pick(marks),
        )
        for at, target in ((ends.start_segment, ends.start), (ends.end_segment, ends.end))
    )
    slack_mm = slack_pulse / min(machine.pulses_per_mm)
    return on.band(most, slack_mm), off.band(most, slack_mm)


def longest_us(machine: Machine, most_us: float) -> int:
    """Longest delay that is tried: up to `most_us`, and no longer than the beam needs to come to rest."""
    lag_us = machine.scanner.tracking_error_us if machine.scanner is not None else 0.0
    return int(min(_LAGS * lag_us, most_us))


class _TargetPoints(Struct, frozen=True, kw_only=True, eq=False):
    """The begins or ends of marks: intended points, and the times at which the command reaches them."""

    trace: Trace
    machine: Machine
    stage: Indices
    time: Floats
    target: MarkPoints

    def miss_mm(self, delay_us: float) -> float:
        """Compute the distance of the beam from the intended points after a delay, mm, RMS."""
        x, y = self.trace.beam.position(self.stage, self.time + delay_us / US_PER_MS)
        px, py = self.machine.pulses_per_mm
        return float(np.sqrt(np.mean(((x - self.target.x) / px) ** 2 + ((y - self.target.y) / py) ** 2)))

    def band(self, most_us: int, slack_mm: float) -> Band:
        """Find the delays from 0 to `most_us` that are nearest within a slack."""
        best = self._nearest_us(most_us)
        miss = self.miss_mm(best)
        first, last = (self._edge_us(best, direction, most_us, miss + slack_mm) for direction in (-1, 1))
        return Band(first_us=first, last_us=last, miss_mm=miss)

    def _nearest_us(self, most_us: int) -> int:
        """Find the nearest delay on a grid that becomes finer around it."""
        low, high = 0, most_us
        while True:
            step = -(-(high - low) // _COARSE) or 1
            best = min(range(low, high + 1, step), key=self.miss_mm)
            if step == 1:
                return best
            low, high = max(best - step, 0), min(best + step, most_us)

    def _edge_us(self, best: int, direction: int, most_us: int, max_miss_mm: float) -> int:
        """Find the last delay in one direction from the nearest one within a maximum miss."""
        limit = most_us - best if direction > 0 else best
        step = max(most_us // _COARSE, 1)
        inside, outside = 0, min(step, limit + 1)
        while outside <= limit and self.miss_mm(best + direction * outside) <= max_miss_mm:
            inside, outside = outside, min(outside + step, limit + 1)
        while outside - inside > 1:
            middle = (inside + outside) // 2
            if self.miss_mm(best + direction * middle) <= max_miss_mm:
                inside = middle
            else:
                outside = middle
        return best + direction * inside
