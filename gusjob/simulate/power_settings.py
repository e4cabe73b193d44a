"""Power settings in force, and the limits that a power passes.

Order of the limits: base power (direct, or follow clamped to its highest power); distance term added and clamped to its
limits; the mode's limits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from msgspec import Struct

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import Schedule
from gusjob.simulate.events import ChannelEvents, Events, ImmediateAction, LaserState, PowerEvents

CLAMPED = 1e-9
"""Relative distance beyond a limit from which a power counts as clamped: less is rounding."""


class PowerSettings(Struct, frozen=True, kw_only=True, eq=False):
    """Power settings of parts of segments, (p,) each: as in PowerEvents, and the limits of the mode in force."""

    low: Floats
    ratio: Floats
    high: Floats
    mode_low: Floats
    mode_high: Floats
    stage: Indices
    """Stage whose distance settings apply."""

    def pick(self, at: Indices | Bools | slice) -> PowerSettings:
        """Pick the settings at indices, at a mask or of a slice."""
        return PowerSettings(**{name: getattr(self, name)[at] for name in self.__struct_fields__})


class StageLasers(Struct, frozen=True, kw_only=True, eq=False):
    """What the power of a channel depends on in each stage, (s,): limits of the mode, and distance follow.

    The distance term is `constant` + `per_x` * |x - `reference_x`| + `per_y` * |y - `reference_y`|: power per pulse,
    pulse. Axes that neither X nor Y drives are at 0. `low`, `high`: limits of the base power with the term added.
    `actual`: x and y are the beam's position.
    """

    mode_low: Floats
    mode_high: Floats
    by_distance: Bools
    actual: Bools
    per_x: Floats
    per_y: Floats
    reference_x: Floats
    reference_y: Floats
    constant: Floats
    low: Floats
    high: Floats


def stage_lasers(lasers: Sequence[LaserState], axes: Sequence[tuple[int, int]]) -> StageLasers:
    """Collect the states of a channel's laser in each stage.

    Args:
        lasers: State in each stage, s.
        axes: Of each stage, the axes (from 0) that X and Y drive.
    """
    rows = [_stage_laser(laser, *driven) for laser, driven in zip(lasers, axes, strict=True)]
    columns = np.array(rows, dtype=np.float64).reshape(len(rows), len(StageLasers.__struct_fields__)).T
    low, high, by_distance, actual, *distance = columns
    per_x, per_y, reference_x, reference_y, constant, lowest, highest = distance
    return StageLasers(
        mode_low=low,
        mode_high=high,
        by_distance=by_distance > 0,
        actual=actual > 0,
        per_x=per_x,
        per_y=per_y,
        reference_x=reference_x,
        reference_y=reference_y,
        constant=constant,
        low=lowest,
        high=highest,
    )


def _stage_laser(laser: LaserState, x_axis: int, y_axis: int) -> tuple[float, ...]:
    """Return the values of StageLasers in one stage, in its order."""
    if not laser.follows_distance or laser.distance_limits is None:
        return laser.low, laser.high, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -math.inf, math.inf
    columns = laser.ratio_per_mm, laser.scale_pulse_per_mm, laser.reference_pulse
    per_pulse = [ratio / scale if ratio else 0.0 for ratio, scale, _ in zip(*columns, strict=True)]
    moves = dict.fromkeys((x_axis, y_axis))
    still = (
        per * abs(at)
        for axis, (per, at) in enumerate(zip(per_pulse, laser.reference_pulse, strict=True))
        if axis not in moves
    )
    constant = math.fsum(still)
    # An axis that both drive follows Y.
    (per_x, x), (per_y, y) = (
        (per_pulse[axis], laser.reference_pulse[axis]) if axis < len(per_pulse) else (0.0, 0.0)
        for axis in (x_axis, y_axis)
    )
    per_x = 0.0 if x_axis == y_axis else per_x
    actual = float(laser.distance_actual)
    return laser.low, laser.high, 1.0, actual, per_x, per_y, x, y, constant, *laser.distance_limits


class BaseLimits(Struct, frozen=True, kw_only=True, eq=False):
    """What all limits make of a base power without distance follow, (p,).

    It is kept within `lowest` and `highest`. A limit clamps it if it is less than `below` or more than `above`.
    """

    lowest: Floats
    highest: Floats
    below: Floats
    above: Floats


class PowerTimeline(Struct, frozen=True, kw_only=True, eq=False):
    """All settings of one channel's power, buffered and immediate, in the order in which they act.

    The first entry, of stage -1, is a power that was never set (NaN). `time_ms` (e,): when each takes effect. `inside`:
    numbers of those that take effect within their segment, not at its start.
    """

    events: PowerEvents
    time_ms: Floats
    inside: Indices

    def in_force(self, segment: Indices, time: Floats) -> Indices:
        """Return the number of the setting in force in segments at moments, (k,)."""
        found = np.searchsorted(self.events.segment, segment, side="right") - 1
        if len(self.inside):
            # Those of the segment that come later are the last of its settings.
            all_inside = np.searchsorted(self.events.segment[self.inside], segment, side="right")
            begun = np.searchsorted(self.time_ms[self.inside], time, side="right")
            found -= np.maximum(all_inside - begun, 0)
        return found

    def last_of(self, stage: Indices) -> Indices:
        """Return the number of the setting in force at the end of each stage."""
        return np.searchsorted(self.events.stage, stage, side="right") - 1


def power_timeline(channel: ChannelEvents, events: Events, schedule: Schedule) -> PowerTimeline:
    """Merge a channel's buffered and immediate powers."""
    buffered, times = channel.power, schedule.times_ms
    immediate = _immediate_powers(channel, events, schedule)
    count = len(immediate)
    stages = np.concatenate([np.array([e.stage for e in immediate], dtype=np.intp), buffered.stage])
    segment = np.concatenate([np.array([e.segment for e in immediate], dtype=np.intp), buffered.segment])
    low = np.concatenate([np.array([e.power for e in immediate]), buffered.low])
    ratio = np.concatenate([np.zeros(count), buffered.ratio])
    high = np.concatenate([np.full(count, np.inf), buffered.high])
    time = times[np.minimum(segment, len(times) - 1)]
    time[:count] = np.maximum(time[:count], [e.time_ms for e in immediate])
    if count > 1:
        ranks = np.ones(len(low), dtype=np.int8)
        ranks[:count] = [e.rank for e in immediate]
        order = np.lexsort((ranks, time, segment, stages))
        stages, segment, time = stages[order], segment[order], time[order]
        low, ratio, high = low[order], ratio[order], high[order]
    return PowerTimeline(
        events=PowerEvents(stage=stages, segment=segment, low=low, ratio=ratio, high=high),
        time_ms=time,
        inside=np.flatnonzero(time > times[np.minimum(segment, len(times) - 1)]),
    )


class _ImmediatePower(Struct, frozen=True, kw_only=True):
    """An immediate power. `rank`: before (0) or after (2) what is buffered at the same moment (1)."""

    stage: int = -1
    segment: int = 0
    power: float = math.nan
    time_ms: float = -math.inf
    rank: int = 0


def _immediate_powers(channel: ChannelEvents, events: Events, schedule: Schedule) -> list[_ImmediatePower]:
    """List the immediate powers, after one that was never set: at rest, then while the stage moves."""
    found = [_ImmediatePower()]
    starts, ends, firsts = schedule.stage_start(), schedule.stage_end(), schedule.stage_first
    for number, stage in enumerate(events.stages):
        first, last = int(firsts[number]), int(firsts[number + 1]) - 1
        found += [
            _ImmediatePower(stage=number, segment=first, power=power) for power, _ in _powers(channel, stage.at_rest)
        ]
        for power, action in _powers(channel, stage.moving):
            time, at = action.moment(float(starts[number]), float(ends[number])), first
            if time > starts[number]:
                at = min(int(np.searchsorted(schedule.times_ms, time, side="right")) - 1, last)
            found.append(_ImmediatePower(stage=number, segment=at, power=power, time_ms=time, rank=2))
    return found


def _powers(channel: ChannelEvents, actions: Iterable[ImmediateAction]) -> Iterator[tuple[float, ImmediateAction]]:
    """Yield the actions that set a channel's power."""
    for action in actions:
        if action.channel == channel.channel and action.power is not None:
            yield action.power, action


def limited(
    settings: PowerSettings, base: Floats, distance: tuple[Floats, Floats, Floats] | None
) -> tuple[Floats, Bools]:
    """Pass a base power through all limits.

    Args:
        settings: Settings in force, (p,).
        base: Base power, (p,).
        distance: Distance term, its lowest and its highest power, (p,) each; None: no distance follow.

    Returns:
        The power, and where a limit clamped it, (p,).
    """
    mode_low, mode_high = settings.mode_low, settings.mode_high
    if distance is None and ((base <= np.minimum(settings.high, mode_high)) & (base >= mode_low)).all():
        return base, np.zeros(len(base), dtype=np.bool_)
    value = np.minimum(base, settings.high)
    clamped = base > settings.high * (1 + CLAMPED)
    if distance is not None:
        term, low, high = distance
        raw = value + term
        value = np.clip(raw, low, high)
        clamped = clamped | _beyond(raw, low, high)
    clamped = clamped | _beyond(value, mode_low, mode_high)
    return np.minimum(np.maximum(value, mode_low), mode_high), clamped


def base_limits(settings: PowerSettings) -> BaseLimits:
    """Compute the limits of base powers that no distance term is added to, as `limited` applies them."""
    high, mode_low, mode_high = settings.high, settings.mode_low, settings.mode_high
    too_high = _edge(mode_high, 1)
    return BaseLimits(
        lowest=np.minimum(mode_low, mode_high),
        highest=np.minimum(np.maximum(high, mode_low), mode_high),
        below=_edge(mode_low, -1),
        above=np.where(too_high < high, too_high, high * (1 + CLAMPED)),
    )


def _edge(limit: Floats, side: int) -> Floats:
    """Power from which _beyond counts it as beyond a limit. `side`: 1 above, -1 below."""
    least = limit + side * CLAMPED
    return np.asarray(least / (1 - side * CLAMPED * np.sign(least)))


def _beyond(value: Floats, low: Floats, high: Floats) -> Bools:
    slack = CLAMPED * (1 + np.abs(value))
    return np.asarray((value < low - slack) | (value > high + slack))
