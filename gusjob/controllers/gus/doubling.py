"""Doubling: what a resumed run marks twice, so that nothing is left out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Stream, Value
from gusjob.controllers.gus.path_position import PathPosition, PositionRange, TimedPath
from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.kinematics.units import US_PER_MS

_SLACK_PULSE = 4.0
"""Length that rounding may add: of the positions at both ends, and of the point where the run continues."""
_OFF_LAG = {"GT_SetLevelDelay": 0, "GT_EnaFPK": 2}
"""Index of the argument that extends the emission after the laser is switched off, us (M 二.6, 二.7)."""
_PASSES = 5
"""Number of passes in which a length is adjusted to the rows that it passes."""


def before_laser_on(stream: Stream, position: PathPosition) -> PathPosition:
    """Move a position back so far that a run that begins there from rest leaves out no emission from it on.

    Level delay and first pulse killer delay the emission after the laser is switched on, and extend it after it is
    switched off (M 二.6, 二.7). The result is the position itself where neither matters.
    """
    switches = [_ChannelSwitches.of(stream, channel) for channel in CHANNELS]
    # The emission that is extended must have begun before, too.
    found = min((_before_tail(stream, one, position) for one in switches), key=lambda one: one.key)
    return min((_before_on(stream, one, found) for one in switches), key=lambda one: one.key)


class _ChannelSwitches(Struct, frozen=True, kw_only=True, eq=False):
    """The switches of one channel: the rows from which each one acts, ascending, and whether it switches on, (k,)."""

    channel: int
    row: Indices
    on: Bools

    @classmethod
    def of(cls, stream: Stream, channel: int) -> _ChannelSwitches:
        calls = stream.buffered
        at = np.flatnonzero((calls.channel == channel) & (calls.kind >= Buffered.ON) & (calls.kind <= Buffered.OFF))
        immediate = [c for c in stream.calls if c.name == "GT_SetHSIOOpt" and c.args[-1] == channel]
        row = np.concatenate([[0], at + 1, np.array([call.at for call in immediate], dtype=np.int64)])
        on = np.concatenate([[False], calls.kind[at] == Buffered.ON, [call.args[0] == 1 for call in immediate]])
        order = np.argsort(row, kind="stable")
        return cls(channel=channel, row=row[order], on=on[order].astype(np.bool_))

    def before(self, row: int) -> int:
        """Return the number of the last switch that acts at a row."""
        return int(np.searchsorted(self.row, row, side="right")) - 1


def _before_on(stream: Stream, switches: _ChannelSwitches, position: PathPosition) -> PathPosition:
    """Move a position in a mark back by the path from rest to the begin of the emission."""
    calls, row = stream.buffered, position.row
    last = switches.before(row)
    lag_ms = _lags_ms(stream, row, switches.channel)[0]
    if row >= len(calls) or not switches.on[last] or lag_ms <= 0:
        return position

    def length_pulse(acc: float, vel: float) -> float:
        return min(acc * lag_ms**2 / 2, vel * lag_ms)

    return _moved_back(calls, position, int(switches.row[last]), length_pulse)


def _before_tail(stream: Stream, switches: _ChannelSwitches, position: PathPosition) -> PathPosition:
    """Move a position near the end of a mark back, so that the emission after its end is as long as in the job.

    It is as long as the head moves in the delay: the run must have the job's velocity where the laser is switched off.
    """
    calls, path = stream.buffered, TimedPath.of(stream.buffered, (0.0, 0.0))
    lag_ms = _longest_off_lag_ms(stream, switches.channel)
    last = switches.before(position.row)
    number = last if last > 0 and not switches.on[last] else last + 1
    if lag_ms <= 0 or number >= len(switches.row) or switches.on[number]:
        return position
    end = int(switches.row[number]) - 1  # The row of the switch.
    moves = np.flatnonzero(calls.kind[: max(end, 0)] < Buffered.DELAY)
    if not len(moves):
        return position
    vel, boundary = float(calls.vel_end[moves[-1]]), PathPosition(row=end)
    if position.key >= boundary.key:
        fastest = float(calls.vel[end : position.row + 1].max(initial=vel))
        if path.between(boundary, position)[1].sum() > fastest * lag_ms:
            return position

    def run_up_pulse(acc: float, _vel: float) -> float:
        return vel**2 / (2 * acc) + _SLACK_PULSE

    found = _moved_back(calls, boundary, 0, run_up_pulse, least_acc=True)
    return min(found, position, key=lambda one: one.key)


def _moved_back(
    calls: BufferedCalls,
    position: PathPosition,
    first: int,
    length_pulse: Callable[[float, float], float],
    *,
    least_acc: bool = False,
) -> PathPosition:
    """Move a position back by a length that depends on acceleration and velocity of the rows that it then passes."""
    path, found = TimedPath.of(calls, (0.0, 0.0)), position
    for _ in range(_PASSES):
        kinds = calls.kind[found.row : position.row + 1]
        rows = found.row + np.flatnonzero(kinds < Buffered.DELAY)
        if not len(rows):  # At a dwell: the motion before it.
            rows = np.flatnonzero(calls.kind[: position.row] < Buffered.DELAY)[-1:]
        if not len(rows):
            return found
        acc = calls.acc[rows].min() if least_acc else calls.acc[rows].max()
        before, found = (
            found,
            path.rewind_along(position, length_pulse(float(acc), float(calls.vel[rows].max())), first),
        )
        if found.row == before.row:
            break
    return found


def doubling_mm(stream: Stream, found: PositionRange, machine: Machine) -> float:
    """Return the length of the marks that may be made twice by a run that begins at the start of a range, mm.

    Args:
        stream: the whole job.
        found: where the laser went off.
        machine: has the pulses in a mm.
    """
    calls, path = stream.buffered, TimedPath.of(stream.buffered, (0.0, 0.0))
    begin, end = before_laser_on(stream, found.earliest), found.latest
    rows, lengths = path.between(begin, end)
    if not len(rows):
        return 0.0
    offs = np.count_nonzero(calls.kind[begin.row : end.row + 1] == Buffered.OFF)
    tail_ms = max(_longest_off_lag_ms(stream, channel) for channel in CHANNELS)
    tails_pulse = offs * tail_ms * float(calls.vel[rows].max(initial=0.0))
    on = np.logical_or.reduce([is_on(stream, channel)[rows] for channel in CHANNELS])
    pulse = float(lengths[on].sum()) + tails_pulse + _SLACK_PULSE
    return float(pulse / min(machine.pulses_per_mm))


def is_on(stream: Stream, channel: int) -> Bools:
    """Return whether the laser of a channel is switched on while each row is run, (n,)."""
    switches = _ChannelSwitches.of(stream, channel)
    found: Bools = switches.on[np.searchsorted(switches.row, np.arange(len(stream.buffered)), side="right") - 1]
    return found


def _longest_off_lag_ms(stream: Stream, channel: int) -> float:
    """Return a limit of the time for which emission lasts after the laser is switched off, in the whole job."""
    longest = dict.fromkeys(_OFF_LAG, 0.0)
    for call in stream.calls:
        if call.name in _OFF_LAG and call.args[-1] == channel:
            longest[call.name] = max(longest[call.name], _microseconds(call.args[_OFF_LAG[call.name]]))
    return sum(longest.values()) / US_PER_MS


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


def _microseconds(value: Value) -> float:
    assert isinstance(value, float)
    return value
