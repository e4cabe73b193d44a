"""Doubling: what a resumed run marks twice, so that nothing is left out."""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.path_position import PathPosition, PositionRange, TimedPath
from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.kinematics.arrays import Bools
from gusjob.kinematics.units import US_PER_MS

_SLACK_PULSE = 4.0
"""Length that rounding may add: of the positions at both ends, and of the point where the run continues."""


def before_laser_on(stream: Stream, position: PathPosition) -> PathPosition:
    """Move a position back by the path from rest to the begin of the emission, so that this path is not left out.

    Level delay and first pulse killer delay the emission after the laser is switched on (M 二.6, 二.7). A position at
    which the laser is off does not change, and no position is moved back beyond a switch of the laser.
    """
    calls, row = stream.buffered, position.row
    on = [channel for channel in CHANNELS if row < len(calls) and is_on(stream, channel)[row]]
    lag_ms = max((_lags_ms(stream, row, channel)[0] for channel in on), default=0.0)
    moves = np.flatnonzero(calls.kind[: row + 1] < Buffered.DELAY)
    if lag_ms <= 0 or not len(moves):
        return position
    switches = np.flatnonzero((calls.kind[:row] == Buffered.ON) | (calls.kind[:row] == Buffered.OFF))
    stages = [call.at for call in stream.calls if call.name == "GT_CrdClear" and call.at <= row]
    first = max([0, *stages, *(switches[-1:] + 1).tolist()])
    acc, vel = float(calls.acc[moves[-1]]), float(calls.vel[moves[-1]])
    length_pulse = min(acc * lag_ms**2 / 2, vel * lag_ms)
    return TimedPath.of(calls, (0.0, 0.0)).rewind_along(position, length_pulse, first)


def doubling_mm(stream: Stream, found: PositionRange, machine: Machine) -> float:
    """Return the length of the marks that may be made twice by a run that begins at the start of a range, mm.

    Args:
        stream: the whole job.
        found: where the laser went off.
        machine: has the pulses in a mm.
    """
    calls, path = stream.buffered, TimedPath.of(stream.buffered, (0.0, 0.0))
    begin, end = before_laser_on(stream, found.earliest), found.latest
    low, number = (int(np.searchsorted(path.timed, row)) for row in (begin.row, end.row))
    high = min(number + 1, len(path.timed))
    if end.key <= begin.key or high <= low:
        return 0.0
    rows, lengths = path.timed[low:high], path.lengths(low, high).copy()
    if number < len(path.timed):
        lengths[-1] = end.along_pulse if rows[-1] == end.row else 0.0
    lengths[0] -= begin.along_pulse if rows[0] == begin.row else 0.0
    offs = np.count_nonzero(calls.kind[begin.row : end.row + 1] == Buffered.OFF)
    tail_ms = max(_lags_ms(stream, len(calls), channel)[1] for channel in CHANNELS)
    tails_pulse = offs * tail_ms * float(calls.vel[rows].max(initial=0.0))
    on = np.logical_or.reduce([is_on(stream, channel)[rows] for channel in CHANNELS])
    pulse = float(lengths[on].sum()) + tails_pulse + _SLACK_PULSE
    return float(pulse / min(machine.pulses_per_mm))


def is_on(stream: Stream, channel: int) -> Bools:
    """Return whether the laser of a channel is switched on while each row is run, (n,)."""
    calls = stream.buffered
    at = np.flatnonzero((calls.channel == channel) & (calls.kind >= Buffered.ON) & (calls.kind <= Buffered.OFF))
    immediate = [c for c in stream.calls if c.name == "GT_SetHSIOOpt" and c.args[-1] == channel]
    rows = np.concatenate([[0], at + 1, np.array([call.at for call in immediate], dtype=np.int64)])
    values = np.concatenate([[False], calls.kind[at] == Buffered.ON, [call.args[0] == 1 for call in immediate]])
    order = np.argsort(rows, kind="stable")
    rows, values = rows[order], values[order].astype(np.bool_)
    found: Bools = values[np.searchsorted(rows, np.arange(len(calls)), side="right") - 1]
    return found


def _lags_ms(stream: Stream, row: int, channel: int) -> tuple[float, float]:
    """Return the delays of the emission after the laser is switched on and off, by the settings before a row."""
    levels, killer = (0.0, 0.0), (0.0, 0.0)
    for call in stream.calls:
        if call.at > row or call.args[-1:] != (float(channel),):
            continue
        numbers = [value for value in call.args if isinstance(value, float)]
        if call.name == "GT_SetLevelDelay":
            levels = numbers[1], numbers[0]
        elif call.name == "GT_EnaFPK":
            killer = numbers[1], numbers[2]
        elif call.name == "GT_DisFPK":
            killer = (0.0, 0.0)
    return (levels[0] + killer[0]) / US_PER_MS, (levels[1] + killer[1]) / US_PER_MS
