"""Power settings in force, and the limits that a power passes.

Order of the limits: base power (direct, or follow clamped to its highest power); distance term added and clamped to its
limits; the mode's limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.schedule import Schedule
from gusjob.simulate.events import ChannelEvents, Events, PowerEvents

CLAMPED = 1e-9
"""Relative distance beyond a limit from which a power counts as clamped: less is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerSettings:
    """Power settings of parts of segments, (p,) each: as in PowerEvents, and the limits of the mode in force."""

    low: Floats
    ratio: Floats
    high: Floats
    mode_low: Floats
    mode_high: Floats
    stage: Indices
    """Stage whose distance settings apply."""

    def pick(self, at: Indices | Bools) -> PowerSettings:
        """Pick the settings at indices or at a mask."""
        return PowerSettings(**{name: getattr(self, name)[at] for name in self.__slots__})


def all_power_events(channel: ChannelEvents, events: Events, schedule: Schedule) -> PowerEvents:
    """Merge a channel's buffered and immediate powers in the order in which they act.

    The first entry, of stage -1, is a power that was never set (NaN).
    """
    buffered = channel.power
    immediate: list[tuple[int, int, float, int]] = [(-1, 0, float("nan"), 0)]
    for number, stage in enumerate(events.stages):
        first = int(schedule.stage_first[number])
        for actions, rank in ((stage.at_rest, 0), (stage.moving, 2)):
            mine = [a.power for a in actions if a.channel == channel.channel and a.power is not None]
            immediate += [(number, first, power, rank) for power in mine]
    count = len(immediate)
    stages = np.concatenate([np.array([e[0] for e in immediate], dtype=np.intp), buffered.stage])
    segment = np.concatenate([np.array([e[1] for e in immediate], dtype=np.intp), buffered.segment])
    low = np.concatenate([np.array([e[2] for e in immediate]), buffered.low])
    ratio = np.concatenate([np.zeros(count), buffered.ratio])
    high = np.concatenate([np.full(count, np.inf), buffered.high])
    if count > 1:
        # At rest: before what is buffered. While the stage moves: after what is buffered before its first segment.
        ranks = np.array([e[3] for e in immediate], dtype=np.int8)
        order = np.lexsort((np.append(ranks, np.ones(len(buffered.low), dtype=np.int8)), segment, stages))
        stages, segment = stages[order], segment[order]
        low, ratio, high = low[order], ratio[order], high[order]
    return PowerEvents(stage=stages, segment=segment, low=low, ratio=ratio, high=high)


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
    value = np.minimum(base, settings.high)
    clamped = base > settings.high * (1 + CLAMPED)
    if distance is not None:
        term, low, high = distance
        raw = value + term
        value = np.clip(raw, low, high)
        clamped = clamped | _beyond(raw, low, high)
    mode_low, mode_high = settings.mode_low, settings.mode_high
    clamped = clamped | _beyond(value, mode_low, mode_high)
    return np.minimum(np.maximum(value, mode_low), mode_high), clamped


def _beyond(value: Floats, low: Floats, high: Floats) -> Bools:
    slack = CLAMPED * (1 + np.abs(value))
    return np.asarray((value < low - slack) | (value > high + slack))
