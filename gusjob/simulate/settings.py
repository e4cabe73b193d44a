"""Which power is set where: direct power, follow and the limits that a power goes through.

Order of limits: base power (direct, or follow clamped to its max), distance term added and clamped to its limits, then
the mode's limits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.simulate.clock import Clock
from gusjob.simulate.state import Program

CLAMPED = 1e-9
"""Relative distance beyond a limit from which a power counts as held by it: rounding, not physics."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerCalls:
    """Power calls of one channel in order, (e,): the number of the timed call before which each acts, and what it sets.

    low: direct power, or the follow minimum; ratio 0: direct; high: follow maximum (inf if direct). NaN low: no
    power set yet.
    """

    boundary: Indices
    stage: Indices
    low: Floats
    ratio: Floats
    high: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class Setting:
    """Power settings per piece, (p,) each. `distance`: whether a distance term is added, with its own limits."""

    low: Floats
    ratio: Floats
    high: Floats
    mode_low: Floats
    mode_high: Floats
    laser: Indices
    """Stage whose distance settings hold."""

    def pick(self, at: Indices | Bools) -> Setting:
        """The settings at indices or a mask."""
        return Setting(**{name: getattr(self, name)[at] for name in self.__slots__})


def power_calls(calls: BufferedCalls, clock: Clock, program: Program, channel: int) -> PowerCalls:
    """Every power and follow call of a channel, buffered or immediate, in the order in which they act."""
    kind = calls.kind[clock.rows]
    mine = np.flatnonzero(
        ((kind == Buffered.POWER) | (kind == Buffered.FOLLOW)) & (calls.channel[clock.rows] == channel)
    )
    rows = clock.rows[mine]
    follow = calls.kind[rows] == Buffered.FOLLOW
    stage, boundary = clock.stage_of_row[mine], clock.boundary[mine]
    low = np.where(follow, calls.q[rows], calls.p[rows])
    ratio = np.where(follow, calls.p[rows], 0.0)
    high = np.where(follow, calls.r[rows], np.inf)
    rank = np.full(len(mine), 1, dtype=np.int8)
    extra: list[tuple[int, int, float, int]] = [(-1, 0, float("nan"), 0)]
    for number, run in enumerate(program.stages):
        first = int(clock.stage_first[number])
        extra += [(number, first, a.power, 0) for a in run.at_rest if a.channel == channel and a.power is not None]
        extra += [(number, first, a.power, 2) for a in run.moving if a.channel == channel and a.power is not None]
    more = len(extra)
    stage = np.concatenate([np.array([e[0] for e in extra], dtype=np.intp), stage])
    boundary = np.concatenate([np.array([e[1] for e in extra], dtype=np.intp), boundary])
    low = np.concatenate([np.array([e[2] for e in extra]), low])
    ratio = np.concatenate([np.zeros(more), ratio])
    high = np.concatenate([np.full(more, np.inf), high])
    rank = np.concatenate([np.array([e[3] for e in extra], dtype=np.int8), rank])
    if more > 1:
        # At rest before what is buffered; while moving behind what is buffered before the first motion.
        order = np.lexsort((rank, boundary, stage))
        stage, boundary = stage[order], boundary[order]
        low, ratio, high = low[order], ratio[order], high[order]
    return PowerCalls(boundary=boundary, stage=stage, low=low, ratio=ratio, high=high)


def limited(setting: Setting, base: Floats, distance: tuple[Floats, Floats, Floats] | None) -> tuple[Floats, Bools]:
    """Base power through all limits, and where one of them held it. `distance`: (term, its min, its max)."""
    value = np.minimum(base, setting.high)
    held = base > setting.high * (1 + CLAMPED)
    if distance is not None:
        term, low, high = distance
        raw = value + term
        value = np.clip(raw, low, high)
        held = held | _beyond(raw, low, high)
    mode_low, mode_high = setting.mode_low, setting.mode_high
    held = held | _beyond(value, mode_low, mode_high)
    return np.minimum(np.maximum(value, mode_low), mode_high), held


def _beyond(value: Floats, low: Floats, high: Floats) -> Bools:
    slack = CLAMPED * (1 + np.abs(value))
    return np.asarray((value < low - slack) | (value > high + slack))
