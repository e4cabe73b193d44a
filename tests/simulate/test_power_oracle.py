"""The simulation against numbers worked out by hand, and against the plain reference on random listings."""

from __future__ import annotations

import math
from collections.abc import Callable
from random import Random
from typing import Any

import pytest
from oracles.power import Call, simulate
from support.reference import CORNERS, differences, listing_of, near, report_of

from gusjob.config.machine import Machine

CASES = 150
Row = dict[str, Any]
FULL_SCALE = (100, 900, 10, 100)
"""Power of each mode at its upper end; frequencies stay where a pulse of 1 us fits."""


def by_reference(calls: list[Call], period_us: float) -> list[Row]:
    """Rows of the reference, names as in the report."""
    rows: list[Row] = []
    for row in simulate(calls, period_us):
        flat = {name: row[name] for name in ("start_ms", "duration_ms", "length_mm")}
        for channel, values in row["channels"].items():
            flat |= {f"ch{channel}_{name}": value for name, value in values.items()}
        rows.append(flat)
    return rows


def by_package(calls: list[Call], period_us: float) -> list[Row]:
    """Rows of the package; None where a column holds NaN."""
    columns = report_of(listing_of(calls), Machine(period_us=period_us)).columns
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return [{n: None if v != v else v for n, v in zip(columns, row, strict=True)} for row in rows]


Run = Callable[[list[Call], float], list[Row]]
both = pytest.mark.parametrize("run", [by_reference, by_package], ids=["reference", "package"])


def expect(rows: list[Row], column: str, wanted: list[float | None]) -> None:
    """A column holds what was worked out by hand."""
    found = [row[column] for row in rows]
    same = [a is b if a is None or b is None else near(a, b) for a, b in zip(found, wanted, strict=True)]
    assert all(same), f"{column}: {found}, by hand {wanted}"


def line(x: int, y: int, vel: float = 2, acc: float = 2, end: float = 0) -> Call:
    return "GT_LnXY", 1, x, y, vel, acc, end, 0


def dwell(ms: int) -> Call:
    return "GT_BufDelay", 1, ms, 0


def power(value: float, channel: int = 0) -> Call:
    return "GT_BufLaserPrfCmd", 1, value, 0, channel


def follow(ratio: float, low: int, high: int, channel: int = 0) -> Call:
    return "GT_BufLaserPrfFollow", 1, ratio, low, high, 0, channel


def delays(off: int, on: int) -> Call:
    return "GT_SetLevelDelay", off, on, 0


ON, OFF = ("GT_BufLaserOn", 1, 0, 0), ("GT_BufLaserOff", 1, 0, 0)
ON1, OFF1 = ("GT_BufLaserOn", 1, 0, 1), ("GT_BufLaserOff", 1, 0, 1)
START, WAIT = ("GT_CrdStart", 1, 0), ("GT_CrdStatus", 1, "run", "segment", 0)
DUTY, DUTY1 = ("GT_LaserPowerMode", 0, 100, 0, 0), ("GT_LaserPowerMode", 0, 100, 0, 1)

# The short move of many tests: 10 pulse at 2 pulse/ms, 2 pulse/ms2. Up to speed in 2/2 = 1 ms over 1 pulse, down the
# same, in between 8 pulse in 4 ms: 6 ms. With GT_BufLaserPrfFollow ratio 10, min 5 the power at the ticks of 250 us is
#   t   0  0.25  0.5  0.75  1.0 ... 4.75 (16 ticks)  5.0  5.25  5.5  5.75  6.0
#   v   0  0.5   1    1.5   2                        2    1.5   1    0.5   0
#   p   5  10    15   20    25                       25   20    15   10    5
# and its integral over the move (50 + 16 * 25 + 70) * 0.25 = 130.
SHORT = line(10, 0)


@both
def test_manual_routine(run: Run) -> None:
    """The first routine of the manual's section 4.3: two trapezoids under direct power."""
    calls = [DUTY, ON, power(50), line(100000, 0, 50), power(30), line(0, 10000, 50), OFF, START]
    # Up to speed in 50/2 = 25 ms over 625 pulse, down the same; (100000 - 1250) / 50 = 1975 ms in between: 2025 ms.
    # The second is sqrt(1e10 + 1e8) pulse long: 50 + (length - 1250) / 50 ms.
    length = math.sqrt(1e10 + 1e8)
    second = 50 + (length - 1250) / 50
    rows = run(calls, 250)
    expect(rows, "duration_ms", [2025, second])
    expect(rows, "start_ms", [0, 2025])
    expect(rows, "length_mm", [100, length / 1000])
    expect(rows, "ch0_power_ms", [50 * 2025, 30 * second])
    expect(rows, "ch0_emission_ms", [2025, second])


@both
def test_triangle(run: Run) -> None:
    """Too short for its velocity: 8 pulse at 2 pulse/ms2, half of it up in sqrt(2 * 4 / 2) = 2 ms, half down."""
    expect(run([DUTY, line(8, 0, 50), START], 250), "duration_ms", [4])


@both
def test_end_velocity_and_slower_segment(run: Run) -> None:
    """Velocities go on from segment to segment; one that starts too fast slows down first."""
    calls = [DUTY, line(25, 0, 10, 2, 10), line(58, 0, 4, 2), START]
    # 25 pulse: 0 to 10 in 5 ms. 33 pulse: 10 to 4 in 3 ms over 21 pulse, 4 to 0 in 2 ms over 4; 8 pulse in 2 ms.
    expect(run(calls, 250), "duration_ms", [5, 7])


@both
def test_follow_on_a_trapezoid(run: Run) -> None:
    """Power of each tick is held until the next; the sum is in the table above."""
    rows = run([DUTY, ON, follow(10, 5, 100), SHORT, OFF, START], 250)
    expect(rows, "ch0_power_ms", [130])
    expect(rows, "ch0_power_min", [5])
    expect(rows, "ch0_power_max", [25])
    expect(rows, "ch0_clamped_ms", [0])


@both
def test_follow_held_at_its_max(run: Run) -> None:
    """Max 18 holds 20 + 16 * 25 + 25 + 20, that is 19 ticks or 4.75 ms."""
    rows = run([DUTY, ON, follow(10, 5, 18), SHORT, OFF, START], 250)
    # 5 + 10 + 15 + 19 * 18 + 15 + 10 = 397
    expect(rows, "ch0_power_ms", [397 * 0.25])
    expect(rows, "ch0_power_max", [18])
    expect(rows, "ch0_clamped_ms", [4.75])


@both
def test_edges_inside_ticks(run: Run) -> None:
    """On 0.3 ms late, off 0.1 ms: the first tick's share is cut, the tail is at rest."""
    rows = run([DUTY, delays(100, 300), ON, follow(10, 5, 100), SHORT, OFF, START], 250)
    # 0.3..0.5 at 10, two ticks 15 + 20, 16 * 25, 70, and 6.0..6.1 at 5.
    expect(rows, "ch0_power_ms", [0.2 * 10 + (35 + 400 + 70) * 0.25 + 0.1 * 5])
    expect(rows, "ch0_emission_ms", [5.8])


@both
def test_tail_over_ticks(run: Run) -> None:
    """Off delay of 0.7 ms: after the end velocity is 0, also at the ticks there."""
    rows = run([DUTY, delays(700, 0), ON, follow(10, 5, 100), SHORT, OFF, START], 250)
    expect(rows, "ch0_power_ms", [130 + 0.7 * 5])
    expect(rows, "ch0_power_min", [5])
    rows = run([DUTY, delays(700, 0), ON, follow(10, 5, 100), dwell(1), OFF, START], 250)
    expect(rows, "ch0_power_ms", [1.7 * 5])


@both
def test_tail_holds_the_last_tick(run: Run) -> None:
    """9 pulse take 5.5 ms. At ticks of 1 ms: 5, 4 * 25, and 15 at 5 ms (v = 1), which holds until 6 ms."""
    rows = run([DUTY, delays(700, 0), ON, follow(10, 5, 100), line(9, 0), OFF, START], 1000)
    # 5.5..6.0 still at 15, then 6.0..6.2 at 5.
    expect(rows, "ch0_power_ms", [5 + 100 + 15 * 0.5 + 0.5 * 15 + 0.2 * 5])
    expect(rows, "ch0_emission_ms", [6.2])


@both
def test_power_call_after_the_last_segment(run: Run) -> None:
    """It acts at the segment's end, so on the tail alone."""
    rows = run([DUTY, delays(700, 0), ON, power(50), SHORT, power(80), OFF, START], 250)
    expect(rows, "ch0_power_ms", [6 * 50 + 0.7 * 80])
    expect(rows, "ch0_power_max", [80])


@both
@pytest.mark.parametrize(
    ("off", "on", "emission"),
    [
        (400, 300, [5.7, 6.4]),  # Off at 6.4, on at 6.3: they cross, the light stays on, 0.3 to 12.4.
        (300, 300, [5.7, 6.3]),  # They meet: the same.
        (200, 300, [5.7, 6.1]),  # Dark from 6.2 to 6.3: 0.2 + 5.7 + 0.2.
    ],
)
def test_edges_that_merge(run: Run, off: int, on: int, emission: list[float]) -> None:
    """Two moves of 6 ms, off and on between them."""
    calls = [DUTY, delays(off, on), power(40), ON, SHORT, OFF, ON, line(20, 0), OFF, START]
    rows = run(calls, 250)
    expect(rows, "ch0_emission_ms", [*emission])
    expect(rows, "ch0_power_ms", [40 * e for e in emission])


@both
def test_on_that_its_off_overtakes(run: Run) -> None:
    """On at 2.0 ms, off at 1.4 ms: no emission at all; the next on at 3 + 2 ms counts."""
    rows = run([DUTY, delays(400, 2000), power(40), ON, dwell(1), OFF, dwell(2), ON, dwell(6), OFF, START], 250)
    expect(rows, "ch0_emission_ms", [0, 0, 4.4])
    expect(rows, "ch0_power_min", [None, None, 40])


@both
def test_segment_shorter_than_a_tick(run: Run) -> None:
    """0.4 ms between ticks of 1 ms takes its share of the tick that it lies in."""
    path = [line(25, 0, 10, 2, 10), line(29, 0, 10, 2, 10), line(54, 0, 10, 2)]
    rows = run([DUTY, ON, follow(3, 2, 90), *path, OFF, START], 1000)
    # 5 ms up: v = 0 2 4 6 8, p = 2 8 14 20 26. 5.0..5.4 at v = 10, p = 32, held until 6.0.
    # Then v = 8.8 6.8 4.8 2.8 0.8, p = 28.4 22.4 16.4 10.4 4.4, the last for 0.4 ms.
    expect(rows, "ch0_power_ms", [70, 32 * 0.4, 32 * 0.6 + 77.6 + 4.4 * 0.4])
    expect(rows, "duration_ms", [5, 0.4, 5])
    # A follow call at 5.4 ms samples at once: v = 10, then 8.8 6.8 4.8 2.8 and 0.8 for 0.4 ms.
    rows = run([DUTY, ON, follow(3, 2, 90), *path[:2], follow(1, 0, 90), path[2], OFF, START], 1000)
    expect(rows, "ch0_power_ms", [70, 32 * 0.4, 10 * 0.6 + 23.2 + 0.8 * 0.4])


@both
def test_first_pulse_killer(run: Run) -> None:
    """On delay 0.1 and gap 0.15, off delay 0.05 and late closing 0.25: emission 0.25 to 2.3 and 3.25 to 5.3."""
    setup = [DUTY, delays(50, 100), ("GT_EnaFPK", 9, 150, 250, 0), ("GT_LaserPrfCmd", 40, 0)]
    rows = run([*setup, ON, dwell(2), OFF, dwell(1), ON, dwell(2), OFF, START], 250)
    expect(rows, "ch0_emission_ms", [1.75, 0.3, 2.05])
    expect(rows, "ch0_power_ms", [70, 12, 82])
    # Disabled again: 0.1 to 2.05.
    expect(run([*setup, ("GT_DisFPK", 0), ON, dwell(2), OFF, START], 250), "ch0_emission_ms", [1.95])


@both
def test_first_pulse_killer_and_merged_edges(run: Run) -> None:
    """Off at 2.1 and on at 2.05 are no edges at all, so there is no gap of 0.5 ms between them."""
    setup = [DUTY, delays(100, 50), ("GT_EnaFPK", 9, 500, 0, 0), ("GT_LaserPrfCmd", 40, 0)]
    rows = run([*setup, ON, dwell(2), OFF, ON, dwell(2), OFF, START], 250)
    expect(rows, "ch0_emission_ms", [1.45, 2.1])


@both
@pytest.mark.parametrize("off", [0, 50])
def test_first_pulse_killer_ends_an_emission_that_was_on(run: Run, off: int) -> None:
    """Laser on at rest, off at the start: it closes 0.25 ms after the off edge, whatever the off delay."""
    setup = [DUTY, delays(off, 100), ("GT_EnaFPK", 9, 150, 250, 0), ("GT_LaserPrfCmd", 40, 0)]
    rows = run([*setup, ("GT_SetHSIOOpt", 1, 0), OFF, SHORT, START], 250)
    expect(rows, "ch0_emission_ms", [off / 1000 + 0.25])


@both
def test_order_of_limits(run: Run) -> None:
    """Follow max 18, then 5 %/mm at 2 mm on Y and its limits 17..26, then the mode's 0..25."""
    setup = [DUTY, line(0, 2000), START, WAIT]
    distance = ("GT_SetLaserDisMode", 1, 0, (0, 0, 0, 0), (1000, 1000, 1000, 1000), 0)
    limits = ("GT_SetLaserDisRatio", (0, 5, 0, 0), 17, 26, 0)
    mode = ("GT_LaserPowerMode", 0, 25, 0, 0)
    move = [ON, follow(10, 5, 18), line(10, 2000), OFF, START]
    # Follow alone: 5 10 15 18*19 15 10 (held: 19 ticks). With 10 added: 15 20 25 28*19 25 20. Limited to 17..26:
    # 17 20 25 26*19 25 20, the first held too.
    rows = run([*setup, distance, limits, *move], 250)
    expect(rows[1:], "ch0_power_ms", [(17 + 20 + 25 + 26 * 19 + 25 + 20) * 0.25])
    expect(rows[1:], "ch0_clamped_ms", [20 * 0.25])
    # The mode's 25 comes last: 17 20 25 25*19 25 20. A power of 25 lies on the limit and is not held by it.
    rows = run([*setup, mode, distance, limits, *move], 250)
    expect(rows[1:], "ch0_power_ms", [(17 + 20 + 25 * 21 + 20) * 0.25])
    expect(rows[1:], "ch0_clamped_ms", [20 * 0.25])
    expect(rows[1:], "ch0_power_min", [17])
    expect(rows[1:], "ch0_power_max", [25])


@both
def test_mode_limits_hold_direct_power(run: Run) -> None:
    """Power never set is 0 and lifted to the mode's MIN; 50 is cut to MAX; inside nothing holds it."""
    calls = [("GT_LaserPowerMode", 0, 40, 10, 0), ON, dwell(1), power(50), dwell(2), power(20), dwell(3), OFF, START]
    rows = run(calls, 250)
    expect(rows, "ch0_power_ms", [10, 80, 60])
    expect(rows, "ch0_clamped_ms", [1, 2, 0])


@both
def test_distance_follow(run: Run) -> None:
    """Direct power is sampled at the ticks, and at power calls."""
    distance = ("GT_SetLaserDisMode", 1, 0, (3, 0, 0, 0), (1, 1, 1, 1), 0)
    limits = ("GT_SetLaserDisRatio", (1, 0, 0, 0), 0, 100, 0)
    # At ticks of 1 ms x = 0 1 3 5 7 9, so |x - 3| = 3 2 0 2 4 6.
    rows = run([DUTY, distance, limits, power(50), ON, SHORT, OFF, START], 1000)
    expect(rows, "ch0_power_ms", [6 * 50 + 17])
    # The same in two segments, 3 pulse in 2 ms and 7 in 4 ms, with a power call on the tick between them.
    path = [line(3, 0, 2, 2, 2), power(60), line(10, 0)]
    rows = run([DUTY, distance, limits, power(50), ON, *path, OFF, START], 1000)
    expect(rows, "ch0_power_ms", [100 + 5, 240 + 12])


@both
def test_power_call_samples_distance_between_ticks(run: Run) -> None:
    """A call at 1.5 ms, x = 2, between ticks at x = 1 and x = 3; the other channel is not sampled there."""
    setup: list[Call] = [DUTY, DUTY1]
    for channel in (0, 1):
        setup.append(("GT_SetLaserDisMode", 1, 0, (0, 0, 0, 0), (1, 1, 1, 1), channel))
        setup.append(("GT_SetLaserDisRatio", (2, 0, 0, 0), 0, 100, channel))
    path = [line(2, 0, 2, 2, 2), power(60), line(10, 0)]
    rows = run([*setup, power(50), power(50, 1), ON, ON1, *path, OFF, OFF1, START], 1000)
    # Channel 0: 0..1 at 50, 1..1.5 at 52; 1.5..2 at 64, then x = 3 5 7 9: 66 70 74 78.
    expect(rows, "ch0_power_ms", [50 + 52 * 0.5, 64 * 0.5 + 288])
    # Channel 1: 52 goes on until 2 ms; 56 60 64 68.
    expect(rows, "ch1_power_ms", [50 + 52 * 0.5, 52 * 0.5 + 248])


@both
def test_two_channels(run: Run) -> None:
    """Switches, delays and powers of the channels do not touch each other."""
    late = ("GT_SetLevelDelay", 700, 0, 1)
    calls = [DUTY, DUTY1, late, power(40), follow(10, 5, 100, 1), ON, SHORT, OFF, ON1, line(20, 0), OFF1, START]
    rows = run(calls, 250)
    expect(rows, "ch0_power_ms", [240, 0])
    expect(rows, "ch1_power_ms", [0, 130 + 0.7 * 5])
    expect(rows, "ch1_power_max", [None, 25])


@both
@pytest.mark.parametrize("direction", [0, 1])
def test_distance_on_an_arc(run: Run, direction: int) -> None:
    """Half a circle of radius 100: a triangle of T = 2 * sqrt(L / acc) ms; at 0.6 T it has 0.4 T still to slow down in,
    so acc * (0.4 T)^2 / 2 = 0.32 L to go: 0.68 * 180 degrees are done, 32.4 degrees beyond the side."""
    total = 2 * math.sqrt(100 * math.pi / 2)
    distance = ("GT_SetLaserDisMode", 1, 0, (200, 0, 0, 0), (1, 1, 1, 1), 0)
    limits = ("GT_SetLaserDisRatio", (0.1, 0, 0, 0), 0, 100, 0)
    arc = ("GT_ArcXYC", 1, 0, 200, 0, 100, direction, 50, 2, 0, 0)
    x = 100 * math.cos(math.radians(32.4)) * (1 if direction else -1)
    rows = run([DUTY, distance, limits, power(10), ON, arc, OFF, START], 600 * total)
    expect(rows, "duration_ms", [total])
    expect(rows, "ch0_power_ms", [0.6 * total * (10 + 20) + 0.4 * total * (10 + 0.1 * (200 - x))])


@both
def test_lengths_of_arcs(run: Run) -> None:
    """Quarters and the rest of a circle of radius 100, by centre and by radius."""
    speed = (50, 2, 0, 0)
    calls = [
        DUTY,
        ("GT_ArcXYC", 1, 100, 100, 0, 100, 1, *speed),  # Left turn about (0, 100): a quarter.
        ("GT_ArcXYC", 1, 100, 100, 0, 100, 0, *speed),  # Ends where it starts: all of it.
        ("GT_ArcXYC", 1, 0, 0, -100, 0, 1, *speed),  # Left turn about (0, 100) from its right side: three quarters.
        ("GT_ArcXYR", 1, 100, 100, 100, 0, *speed),  # The short way.
        ("GT_ArcXYR", 1, 0, 0, -100, 0, *speed),  # The long way.
        START,
    ]
    quarters = [1, 4, 3, 1, 3]
    expect(run(calls, 250), "length_mm", [q * math.pi / 20 for q in quarters])


@both
def test_stages(run: Run) -> None:
    """An on edge still delayed when a stage ends has taken effect when the next starts; ticks count from each start."""
    calls = [DUTY, delays(0, 2000), follow(10, 5, 100), line(9, 0), ON, START, WAIT, line(19, 0), OFF, START]
    rows = run(calls, 250)
    expect(rows, "start_ms", [0, 5.5])
    expect(rows, "ch0_power_ms", [0, 130])


@both
def test_change_of_mode_drops_power(run: Run) -> None:
    """Another mode: 0 until a power call. The same mode with other limits: as it was."""
    stage = [ON, dwell(1), OFF, START, WAIT]
    rows = run([DUTY, power(50), *stage, ("GT_LaserPowerMode", 0, 80, 20, 0), *stage], 250)
    expect(rows, "ch0_power_ms", [50, 50])
    rows = run([DUTY, power(50), *stage, ("GT_LaserPowerMode", 2, 10, 1, 0), *stage], 250)
    expect(rows, "ch0_power_ms", [50, 1])
    expect(rows, "ch0_clamped_ms", [0, 1])


@both
def test_edge_on_a_tick(run: Run) -> None:
    """29 ticks of 50 us in binary are not 1.45 ms, and the stage starts at no round time: still that tick is the first.

    At 1.45 ms v = 2.9, so the lowest power is 10 + 0.5 * 2.9."""
    first = [DUTY, line(101, 0, 50), START, WAIT, delays(0, 1450)]
    calls = [*first, follow(0.5, 10, 90), ON, line(2101, 0, 50, 2, 50), OFF, line(4101, 0, 50), START]
    expect(run(calls, 50)[1:2], "ch0_power_min", [11.45])


class Maker:
    """Makes a random but valid program, of which no two moments coincide by chance."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.period_us = self.random.choice([50, 250, 1000])
        self.pulses_per_mm = self.random.choice([1000, 512.5])
        self.channels = self.random.choice([[0], [1], [0, 1], [0, 1]])
        self.mode = [0, 0]
        self.distance = [False, False]
        self.place = (0, 0)
        self.velocity = 0.0
        self.calls: list[Call] = []

    def make(self) -> list[Call]:
        """All calls, 1-3 stages of 1-5 segments."""
        for channel in self.channels:
            self.set_mode(channel)
        for stage in range(self.random.randint(1, 3)):
            self.calls.append(("GT_CrdClear", 1, 0))
            for channel in self.channels:
                if stage and self.chance(0.2):
                    self.set_mode(channel)
                self.set_up(channel)
            count = self.random.randint(1, 5)
            rest_until = len(self.calls)
            self.velocity = 0.0
            for left in reversed(range(count)):
                self.events()
                if self.chance(0.05):
                    self.set_up(self.random.choice(self.channels))
                    rest_until = len(self.calls)
                self.motion(stop=left == 0)
            self.events()
            # What is sent after the start joins the running stage.
            start = self.random.randint(rest_until, len(self.calls)) if self.chance(0.2) else len(self.calls)
            self.calls.insert(start, ("GT_CrdStart", 1, 0))
            self.calls.append(("GT_CrdStatus", 1, "run", "segment", 0))
        if self.chance(0.3):
            self.calls.pop()
        return self.calls

    def chance(self, share: float) -> bool:
        return self.random.random() < share

    def power(self, channel: int) -> float:
        return round(self.random.uniform(0.01, 0.99) * FULL_SCALE[self.mode[channel]], 3)

    def powers(self, channel: int) -> tuple[float, float]:
        low, high = sorted((self.power(channel), self.power(channel)))
        return low, high + 0.001

    def delay(self, rest: int) -> int:
        """Some us, 0 or of a remainder of their own to 50, so that no edge falls on a tick."""
        return self.random.choice([0, rest, 50 + rest, 300 + rest, 50 * self.random.randint(0, 60) + rest])

    def set_mode(self, channel: int) -> None:
        mode = self.mode[channel] = self.random.randrange(4)
        high = self.power(channel) if self.chance(0.5) else FULL_SCALE[mode]
        low = round(high * self.random.random() / 2, 3) if self.chance(0.5) else 0
        if mode != 2:
            self.calls.append(("GT_SetAxisMode", 7 + channel, 1))
        self.calls.append(("GT_LaserPowerMode", mode, high, low, channel))
        if mode == 1:
            self.calls.append(("GT_SetPulseWidth", 1, channel))
        elif mode != 2:
            self.calls.append(("GT_LaserOutFrq", 10, channel))
        self.set_distance(channel)

    def set_distance(self, channel: int) -> None:
        if self.chance(0.6):
            if self.distance[channel]:
                self.calls.append(("GT_SetLaserDisMode", 0, 0, (0, 0, 0, 0), (1000, 1000, 1, 1), channel))
            self.distance[channel] = False
            return
        self.distance[channel] = True
        reference = tuple(self.random.randint(-9000, 9000) for _ in range(4))
        scale = (self.random.choice([1000, 400.5]), 1000, 1000, 1000)
        full = FULL_SCALE[self.mode[channel]]
        ratio = [round(self.random.uniform(-0.2, 0.2) * full, 4) for _ in range(2)]
        ratio += [self.random.choice([0, 0.003 * full]) for _ in range(2)]
        self.calls.append(("GT_SetLaserDisMode", 1, self.random.randrange(2), reference, scale, channel))
        self.calls.append(("GT_SetLaserDisRatio", tuple(ratio), *self.powers(channel), channel))

    def set_up(self, channel: int) -> None:
        """Some setup calls at rest."""
        if self.chance(0.5):
            self.calls.append(("GT_SetLevelDelay", self.delay(3), self.delay(7), channel))
        if self.chance(0.4):
            self.calls.append(("GT_EnaFPK", 9, self.delay(11), self.delay(13), channel))
        elif self.chance(0.3):
            self.calls.append(("GT_DisFPK", channel))
        if self.chance(0.3):
            self.calls.append(("GT_LaserPrfCmd", self.power(channel), channel))
        if self.chance(0.3):
            self.calls.append(("GT_SetHSIOOpt", self.random.randrange(2), channel))
        if self.chance(0.2):
            self.set_distance(channel)

    def events(self) -> None:
        """Buffered laser calls between two motions."""
        for _ in range(self.random.choice([0, 1, 1, 2, 3, 5])):
            channel = self.random.choice(self.channels)
            match self.random.randrange(5):
                case 0 | 1:
                    self.calls.append(("GT_BufLaserOn", 1, 0, channel))
                case 2:
                    self.calls.append(("GT_BufLaserOff", 1, 0, channel))
                case 3:
                    self.calls.append(("GT_BufLaserPrfCmd", 1, self.power(channel), 0, channel))
                case _:
                    full = FULL_SCALE[self.mode[channel]]
                    low, high = sorted(self.random.sample(range(full + 1), 2))
                    ratio = self.random.uniform(0.002, 0.03) * full
                    self.calls.append(("GT_BufLaserPrfFollow", 1, ratio, low, high, 0, channel))

    def motion(self, stop: bool) -> None:
        """A dwell, line or arc; with `stop` it ends at rest."""
        at_rest = self.velocity == 0
        if at_rest and self.chance(0.1):
            self.calls.append(("GT_BufDelay", 1, self.random.choice([0, 1, 2, 7]), 0))
            return
        acc = self.random.uniform(0.3, 8)
        x, y = self.place
        size = 10 ** self.random.uniform(0.3, 4)
        if stop:
            size = max(size, self.velocity**2 / acc)
        shape = self.random.randrange(4)
        name = "GT_LnXY"
        extra: tuple[float, ...] = ()
        if at_rest and self.chance(0.04):
            to, length = self.place, 0.0
        elif shape == 0:
            name = "GT_ArcXYC"
            steps = math.ceil(size / 65)
            (ax, ay), (bx, by) = self.corner(steps), self.corner(steps)
            direction = self.random.randrange(2)
            extra = (-ax, -ay, direction)
            to = (x - ax + bx, y - ay + by)
            turn = math.atan2(by, bx) - math.atan2(ay, ax)
            length = 65 * steps * ((turn if direction else -turn) % (2 * math.pi) or 2 * math.pi)
        else:
            angle = self.random.uniform(-math.pi, math.pi)
            to = (x + round(size * math.cos(angle)), y + round(size * math.sin(angle)))
            if to == self.place:
                to = (x + 1, y)
            length = math.dist(to, self.place)
            if shape == 1:
                name = "GT_ArcXYR"
                radius = self.random.choice([-1, 1]) * round(length * self.random.uniform(0.51, 3), 3)
                extra = (radius, self.random.randrange(2))
        if stop and self.velocity**2 > 2 * acc * length * 0.99:
            acc = self.velocity**2 / length
        # End velocities within reach lie between these; 1 % away from both, so that rounding decides nothing.
        slow2, fast2 = max(self.velocity**2 - 2 * acc * length, 0.0), self.velocity**2 + 2 * acc * length
        low, high = (math.sqrt(slow2 + share * (fast2 - slow2)) for share in (0.01, 0.99))
        vel = max(self.random.uniform(5, 120), low * 1.01)
        end = 0.0
        if not stop and length and (slow2 or self.chance(0.7)):
            end = self.random.uniform(low, min(high, vel))
        self.calls.append((name, 1, *to, *extra, vel, acc, end, 0))
        self.place, self.velocity = to, end

    def corner(self, steps: int) -> tuple[int, int]:
        x, y = self.random.choice(CORNERS)
        return x * steps * self.random.choice([-1, 1]), y * steps * self.random.choice([-1, 1])


@pytest.mark.parametrize("seed", range(CASES))
def test_random_listing(seed: int) -> None:
    """Every segment of a random listing comes out as in the reference."""
    maker = Maker(seed)
    calls = maker.make()
    machine = Machine(period_us=maker.period_us, pulses_per_mm=(maker.pulses_per_mm, maker.pulses_per_mm))
    text = listing_of(calls)
    found = differences(simulate(calls, maker.period_us, maker.pulses_per_mm), report_of(text, machine))
    assert not found, "\n".join([text, *found])
