"""Closed sums of power that follows velocity or distance, against a loop over every tick that shares no code with it.

The listings aim at what a sum can miss: limits that are just touched, met in between or exclude each other, ticks on
the ends of segments and phases, segments shorter than a tick and of thousands of ticks, edges between and on ticks.
"""

from __future__ import annotations

import math
from random import Random

import pytest
from oracles.power import Call, simulate
from support.reference import CORNERS, differences, listing_of, report_of

from gusjob.config.machine import Machine

CASES = 250
MOST_ACC = 32_000
MOST_TICKS = 1500
"""Of one segment: the loop takes its time."""


class FollowMaker:
    """Makes a random listing of one or two stages, most of it under velocity follow or distance follow."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.period_us = self.random.choice([1, 2, 10, 50, 100, 250, 1000])
        self.period_ms = self.period_us / 1000
        self.is_even = self.random.random() < 0.3
        """Every phase is a whole number of ticks."""
        self.channels = self.random.choice([[0], [1], [0, 1]])
        self.calls: list[Call] = []
        self.place, self.velocity = (0, 0), 0.0
        self.vel = 0.0

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def make(self) -> list[Call]:
        for _ in range(self.random.choice([1, 1, 2])):
            self.stage()
        return self.calls

    def stage(self) -> None:
        """Setup, segments with calls between them, start."""
        self.calls.append(("GT_CrdClear", 1, 0))
        self.vel = self.new_velocity()
        for channel in self.channels:
            self.set_up(channel)
        self.velocity = 0.0
        count = self.random.randint(1, 5)
        for channel in self.channels:
            self.calls.append(self.follow(channel))
            self.calls.append(("GT_BufLaserOn", 1, 0, channel))
        for left in reversed(range(count)):
            self.even_motion(left == 0) if self.is_even else self.motion(left == 0)
            self.between()
        self.calls += [("GT_CrdStart", 1, 0), ("GT_CrdStatus", 1, "run", "segment", 0)]

    def set_up(self, channel: int) -> None:
        low = self.random.choice([0, 0, 5, 20, 37.5])
        high = self.random.choice([100, 100, 80, 50, 40])
        self.calls.append(("GT_LaserPowerMode", 0, high, low, channel))
        self.calls.append(("GT_SetLevelDelay", self.delay(), self.delay(), channel))
        if self.chance(0.2):
            self.calls.append(("GT_EnaFPK", 9, self.delay(), self.delay(), channel))
        elif self.chance(0.2):
            self.calls.append(("GT_DisFPK", channel))
        self.distance(channel)

    def distance(self, channel: int) -> None:
        """Distance follow or not: limits far away, near, touched at the start, or such that nothing is between."""
        off: Call = ("GT_SetLaserDisMode", 0, 0, (0, 0, 0, 0), (1, 1, 1, 1), channel)
        self.calls.append(off)
        if self.chance(0.5):
            return
        way = self.vel * self.period_ms * 100
        reference = tuple(round(at + self.random.uniform(-1, 1) * way) for at in (*self.place, 0, 0))
        if self.chance(0.2):
            reference = (*self.place, 0, 0)
        ratios = tuple(self.random.choice([0, 5, 20, -10]) * self.random.random() / way for _ in range(2))
        limits = self.random.choice([(0, 100), (0, 100), (10, 60), (30, 35), (90, 95)])
        on: Call = ("GT_SetLaserDisMode", 1, self.random.randrange(2), reference, (1, 1, 2, 1), channel)
        self.calls += [on, ("GT_SetLaserDisRatio", (*ratios, 0.001, 0), *limits, channel)]

    def delay(self) -> int:
        """Whole us: none, whole ticks, or between ticks."""
        ticks = self.random.randint(0, 30)
        most = min(60 * self.period_us, 60_000)
        return self.random.choice([0, ticks * self.period_us, self.random.randint(0, most)])

    def follow(self, channel: int) -> Call:
        """Velocity follow of which the highest power is reached just so at a velocity of the path, early or never."""
        low, high = self.random.choice([(5, 90), (0, 80), (20, 40), (1, 3), (60, 100), (37, 38)])
        reached = self.vel * self.random.choice([1, 1, 1, 0.5, 0.93, 2])
        if self.velocity and self.chance(0.2):
            reached = self.velocity
        if self.chance(0.15):
            return ("GT_BufLaserPrfCmd", 1, self.random.choice([3, 37.5, 50, 80, 99]), 0, channel)
        return ("GT_BufLaserPrfFollow", 1, (high - low) / reached, low, high, 0, channel)

    def between(self) -> None:
        for _ in range(self.random.choice([0, 0, 1, 2])):
            channel = self.random.choice(self.channels)
            switch = self.random.choice(["GT_BufLaserOn", "GT_BufLaserOff"])
            self.calls.append(self.follow(channel) if self.chance(0.6) else (switch, 1, 0, channel))

    def new_velocity(self) -> float:
        """Velocity that a segment can reach within some ticks."""
        if self.is_even:
            return 4.0 * 1000 / math.gcd(1000, self.period_us) * self.random.randint(1, 3)
        return 10 ** self.random.uniform(0.5, 3.5)

    def even_motion(self, stop: bool) -> None:
        """A line whose phases are whole ticks: up to the velocity, at it, down."""
        up, level, down = (self.random.choice([0, 1, 2, 7, 40]) for _ in range(3))
        vel = self.vel
        if self.velocity == 0 and up == 0:
            up = 1
        if self.velocity:
            up, level = 0, level + 1
        down = max(down, 1) if stop else down
        period = self.period_ms
        acc = vel / (period * max(up, down, 1))
        if up and down:
            up = down = max(up, down)
        if acc > MOST_ACC or self.velocity not in (0, vel) or (up == 0 and level == 0 and down == 0):
            self.motion(stop)
            return
        way = round(vel * period * (up / 2 + level + down / 2))
        self.line(way, vel, acc, 0.0 if down else vel)

    def motion(self, stop: bool) -> None:
        """A line, arc or dwell of a tick's share to many ticks; it may begin above its velocity."""
        if self.velocity == 0 and self.chance(0.15):
            dwell: Call = ("GT_BufDelay", 1, self.random.choice([0, 1, 3]), 0)
            self.calls.append(dwell)
            return
        ticks = 10 ** self.random.uniform(-1, math.log10(MOST_TICKS))
        vel = self.vel if self.chance(0.7) else self.new_velocity()
        acc = min(max(vel / (self.period_ms * ticks * self.random.choice([0.01, 0.1, 0.3, 0.5, 3])), 0.01), MOST_ACC)
        length = max(round(vel * self.period_ms * ticks), 1)
        # At least what it takes to stop from here, and no more ticks than the loop can take.
        if stop:
            length = max(length, math.ceil(self.velocity**2 / acc))
        peak = min(vel, math.sqrt(acc * length))
        if length / peak > 4 * MOST_TICKS * self.period_ms:
            acc = min(acc * 1000, MOST_ACC)
        slow2, fast2 = max(self.velocity**2 - 2 * acc * length, 0.0), self.velocity**2 + 2 * acc * length
        if stop and slow2:
            acc = min(self.velocity**2 / length, MOST_ACC)
        low, high = (math.sqrt(slow2 + share * (fast2 - slow2)) for share in (0.01, 0.99))
        vel = max(vel, low * 1.01)
        end = 0.0 if stop or (not slow2 and self.chance(0.2)) else self.random.uniform(low, min(high, vel))
        self.line(length, vel, acc, vel if not stop and low < vel < high and self.chance(0.4) else end)

    def line(self, way: int, vel: float, acc: float, end: float) -> None:
        """A line along an axis, so that its length is whole; or a small arc of about that length."""
        x, y = self.place
        if way > 400 and not self.is_even and end == 0 == self.velocity and self.chance(0.5):
            (ax, ay), steps = self.random.choice(CORNERS), max(way // 400, 1)
            self.calls.append(("GT_ArcXYC", 1, x, y, -ax * steps, -ay * steps, 1, vel, acc, 0.0, 0))
            return
        way *= self.random.choice([-1, 1])
        self.place = (x + way, y) if self.chance(0.5) else (x, y + way)
        self.velocity = end
        self.calls.append(("GT_LnXY", 1, *self.place, vel, acc, end, 0))


@pytest.mark.parametrize("seed", range(CASES))
def test_random_follow(seed: int) -> None:
    """Integral, lowest and highest power and clamped time of every segment are those of the loop over the ticks."""
    maker = FollowMaker(seed)
    calls = maker.make()
    found = differences(
        simulate(calls, maker.period_us), report_of(listing_of(calls), Machine(period_us=maker.period_us))
    )
    assert not found, "\n".join([f"period_us {maker.period_us}", listing_of(calls), *found])
