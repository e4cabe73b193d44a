"""The VCD file against closed forms worked out here, read with two readers that are not ours.

Jobs stand still or move in trapezoids of known times, in pulses (1000 to the mm), so that every edge is a fraction of
a ms; the file may be off by the rounding to whole ns alone. Time in ms, as fractions, if not named otherwise.
"""

from __future__ import annotations

import re
import tracemalloc
from itertools import pairwise
from math import ceil, floor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from support.tools import MACHINE, stream_of
from support.vcd import (
    DUTY,
    FREQUENCY,
    GO,
    GTS,
    HEAD,
    LIT,
    NS,
    F,
    Spans,
    at_ticks,
    held,
    off,
    periods,
    pulses,
    read,
    run,
    same,
    trapezoid,
    wave,
)

from gusjob.controllers.gus.model import simulate_stream
from gusjob.simulate.outputs.vcd import vcd_pieces


@pytest.mark.parametrize(
    ("khz", "pct", "dwell"),
    [
        ("10", "1", 2), ("10", "25", 3), ("10", "50", 1), ("10", "99.9", 2), ("10", "100", 2), ("10", "0", 2),
        ("2000", "50", 1), ("2000", "1", 1), ("0.5", "25", 5), ("0.5", "60", 5), ("30", "99.9", 4), ("7", "33.3", 5),
    ],
)  # fmt: skip
def test_carrier(khz: str, pct: str, dwell: int) -> None:
    """Wrong: a duty of the other level, a period too many, emission that does not begin with a period."""
    found = wave(DUTY.format(khz) + LIT.format(pct, dwell))
    same(found.spans("PWM0+"), periods(F(1), F(1 + dwell), F(khz), lambda _: F(pct)))
    assert found.spans("PWM1+") == [(NS, (1 + dwell) * NS)]
    assert found.signals["AO0"] == [(0, 0.0)]
    assert found.end == (2 + dwell) * NS


@pytest.mark.parametrize("khz", ["10", "2.5", "30", "0.7"])
@pytest.mark.parametrize(("on", "late"), [(0, 0), (100, 313), (700, 700), (7, 33)])
def test_power_that_changes_while_emitting(khz: str, on: int, late: int) -> None:
    """Wrong: a period that changes its duty half way, or one that begins with the change and has the old one."""
    changes = "LASER POWER 50\nLASER ON\nDWELL 1\nLASER POWER 20\nDWELL 1\nLASER POWER 70\nDWELL 3\nLASER POWER 40\n"
    found = wave(DUTY.format(khz) + f"LASER DELAY ON {on} OFF {late}\n{changes}DWELL 1\nLASER OFF\nDWELL 1\n")
    begin, finish = F(on, 1000), 6 + F(late, 1000)
    power = [(F(0), F(50)), (F(1), F(20)), (F(2), F(70)), (F(5), F(40))]
    want = periods(begin, finish, F(khz), lambda t: max(p for p in power if p[0] <= t)[1])
    same(found.spans("PWM0+"), want)


def test_clamped_by_the_mode() -> None:
    """Wrong: the power as it was asked for, not as the controller puts it out."""
    job = DUTY.format("10 MIN 20 MAX 60") + LIT.format(5, 1) + LIT.format(90, 1)
    want = periods(F(1), F(2), F(10), lambda _: F(20)) + periods(F(4), F(5), F(10), lambda _: F(60))
    same(wave(job).spans("PWM0+"), want)


def test_no_drift() -> None:
    """Wrong: a period of 33333 ns, or an error that grows from window to window."""
    done = run(DUTY.format(30) + "LASER POWER 50\nLASER ON\nDWELL 3400\nLASER OFF\n")
    times = np.array(re.findall(rb"^#(\d+)$", done.stdout_bytes, re.MULTILINE), dtype=np.int64)
    k = np.arange(2 * 3400 * 30 + 1)
    assert len(times) == len(k)
    assert np.abs(times * 60 - k * NS).max() <= 30  # Edge k at k/60 ms, to half a ns; the light's end is the last.


@pytest.mark.parametrize(("ratio", "low", "high", "delay"), [(2, 5, 90, 0), (10, 7, 60, 130), (1, 0, 99, 60)])
def test_velocity_follow(ratio: int, low: int, high: int, delay: int) -> None:
    """Wrong: duty by the velocity of now, not of the last tick; a call off the ticks that does not sample."""
    job = f"LINE X 11\nACC 1\nLASER FOLLOW RATIO {ratio} MIN {low} MAX {high}\nLASER ON\nLINE X 211\nLASER OFF\n"
    found = wave(DUTY.format(20) + f"LASER DELAY ON {delay} OFF {delay}\n{job}")
    since = F(21, 10)
    until, velocity = trapezoid(since, F(200), F(10), F(1))
    assert until == since + 30
    duty = held(since, until + 1, lambda t: min(ratio * velocity(t) + low, F(high)))
    begin, finish = since + F(delay, 1000), until + F(delay, 1000)
    same(found.spans("PWM0+"), periods(begin, finish, F(20), duty))


def test_distance_follow() -> None:
    """Wrong: a distance in pulses, of the wrong axis, sampled between ticks, or not clamped."""
    follow = "LASER DISTANCE REF X 100 Y 0 RATIO X 30 Y 5 MIN 2 MAX 55\n"
    found = wave(
        DUTY.format(20) + follow + "LASER POWER 20\nLASER ON\nACC 1\nLINE Y 200\nLASER OFF\nACC 10\nLINE X 3000\n"
        "LASER ON\nDWELL 2\nLASER OFF\n"
    )
    until, velocity = trapezoid(F(0), F(200), F(10), F(1))

    def y(t: F) -> F:
        return t * t / 2 if t < 10 else 50 + (t - 10) * 10 if t < 20 else 200 - (until - t) ** 2 / 2

    duty = held(F(0), until, lambda t: 20 + 30 * F(1, 10) + 5 * y(t) / 1000)
    later = until + 1 + 300
    want = periods(F(0), until, F(20), duty) + periods(later, later + 2, F(20), lambda _: F(55))
    same(found.spans("PWM0+"), want)
    assert velocity(F(15)) == 10


@pytest.mark.parametrize(("duty2", "plus", "minus"), [("", "0", "1"), ("on", "0", "1"), ("off", "1", "0")])
def test_duty_2(tmp_path: Path, duty2: str, plus: str, minus: str) -> None:
    """Wrong: a switch line that switches in duty mode 2 (constantly high, M 2.2), or no energy.

    "High" is on, as in GT_SetLevelDelay (M 2.2), that is PWM1- high and PWM1+ low (M 1.2); or PWM1+ itself.
    """
    profile = tmp_path / "gusjob.toml"
    profile.write_text(f'duty2_switch = "{duty2}"\n' if duty2 else "")
    body = "12\n" + LIT.format(30, 3)
    found = wave(HEAD + "LASER MODE DUTY2 CARRIER " + body, "--machine", str(profile))
    assert found.signals["PWM1+"] == [(0, plus)]
    assert found.signals["PWM1-"] == [(0, minus)]
    assert off(found.signals["PWM0+"], wave(HEAD + "LASER MODE DUTY CARRIER " + body).signals["PWM0+"]) == []


@pytest.mark.parametrize(("khz", "width"), [("20", 7), ("30", 1), ("0.3", 200), ("0.3", 400), ("499", 2), ("0", 5)])
def test_frequency(khz: str, width: int) -> None:
    """Wrong: a width that goes with the period, a pulse too many, pulses without power."""
    found = wave(FREQUENCY.format(width) + LIT.format(khz, 7))
    want = pulses(F(1), F(8), [(F(1), F(khz))], F(width, 1000)) if F(khz) else []
    same(found.spans("PWM0+"), want)


def test_frequency_that_changes() -> None:
    """Wrong: a phase that begins anew with the frequency."""
    job = "LASER POWER 2.5\nLASER ON\nDWELL 1\nLASER POWER 5\nDWELL 2\nLASER POWER 0\nDWELL 1\nLASER POWER 0.3\n"
    found = wave(FREQUENCY.format(50) + "LASER DELAY ON 0 OFF 31\n" + job + "DWELL 9\nLASER OFF\n")
    steps = [(F(0), F(5, 2)), (F(1), F(5)), (F(3), F(0)), (F(4), F(3, 10))]
    want = pulses(F(0), F(13031, 1000), steps, F(1, 20))
    assert want[3][0] == F(11, 10)
    same(found.spans("PWM0+"), want)


@pytest.mark.parametrize(("low", "least"), [(0, "0.4"), (1, "0"), (20, "0")])
def test_frequency_follow(low: int, least: str) -> None:
    """Wrong: pulses at the frequency of now; a number of pulses that is not the integral of the frequency."""
    job = f"ACC 1\nLASER FOLLOW RATIO 3 MIN {low} MAX 45\nLASER ON\nLINE X 200\nLASER OFF\n"
    got = wave(FREQUENCY.format(f"3 MIN {least}") + job).spans("PWM0+")
    until, velocity = trapezoid(F(0), F(200), F(10), F(1))
    steps = [(t, max(min(3 * velocity(t) + low, F(45)), F(least))) for t in at_ticks(F(0), until)]
    turns = sum((f * (after - at) for (at, f), (after, _) in pairwise([*steps, (until, F(0))])), F(0))
    assert len(got) in (floor(turns), ceil(turns), floor(turns) + 1)
    same(got, pulses(F(0), until, steps, F(3, 1000)))


def test_pulses_wider_than_their_period() -> None:
    """Wrong: a line that goes back and forth, or high between pulses that meet."""
    head = "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(1,2000,0,0)\nGT_SetPulseWidth(100,0)\nGT_CrdClear(1,0)\n"
    body = "GT_BufLaserPrfCmd(1,{},0,0)\nGT_BufLaserOn(1,0,0)\nGT_BufDelay(1,3,0)\nGT_BufLaserOff(1,0,0)\n"
    for khz in (10, 12.5, 40):
        found = run(head + body.format(khz) + "GT_BufDelay(1,1,0)\nGT_CrdStart(1,0)\n", name="x.gts")
        assert read(found.stdout_bytes).spans("PWM0+") == [(0, 3 * NS)]


def test_analog() -> None:
    """Wrong: volts while off without a pre-voltage, none with it, or an energy line that pulses."""
    analog = HEAD + "LASER MODE ANALOG MAX 8\n"
    body = "DWELL 1\nLASER POWER 3\nLASER ON\nDWELL 1\nLASER POWER 9\nDWELL 1\nLASER OFF\nDWELL 2\n"
    for before, volts in (("", 0.0), ("LASER PREVOLT 1.25\n", 1.25)):
        found = wave(analog + "LASER DELAY ON 5 OFF 12\n" + before + body)
        lit = [(0, volts), (1_005_000, 3.0), (2_000_000, 8.0), (3_012_000, volts)]
        assert found.signals["AO0"] == lit
        assert found.signals["PWM0+"] == [(0, "1")]
        assert found.spans("PWM1+") == [(1_005_000, 3_012_000)]


@pytest.mark.parametrize("late", [0, 10])
def test_analog_at_the_end(late: int) -> None:
    """Wrong: volts that stay where the emission was, when emission and run end together."""
    job = f"LASER MODE ANALOG\nLASER DELAY ON 0 OFF {late}\nLASER POWER 3\nLASER ON\nDWELL 1\nLASER OFF\n"
    found = wave(HEAD + job)
    assert found.signals["PWM1+"] == [(0, "0"), (NS + 1000 * late, "1")]
    assert found.signals["AO0"] == [(0, 3.0), (NS + 1000 * late, 0.0)]


def test_analog_follow() -> None:
    """Wrong: volts that change elsewhere than at ticks, or not by ratio * velocity + minimum."""
    found = wave(
        HEAD + "LASER MODE ANALOG\nLINE X 11\nACC 1\nLASER FOLLOW RATIO 0.5 MIN 1 MAX 4\n"
        "LASER ON\nLINE X 211\nLASER OFF\nDWELL 1\n"
    )
    until, velocity = trapezoid(F(21, 10), F(200), F(10), F(1))
    want = [(0, 0.0)]
    for t in at_ticks(F(21, 10), until):
        volts = float(min(velocity(t) / 2 + 1, F(4)))
        if volts != want[-1][1]:
            want.append((round(t * NS), volts))
    got = found.signals["AO0"]
    assert off([t for t, _ in got], [t for t, _ in [*want, (round(until * NS), 0.0)]]) == []
    assert [v for _, v in got] == pytest.approx([*(v for _, v in want), 0.0], abs=1e-9)


@pytest.mark.parametrize(
    ("on", "late", "want"),
    [
        (0, 0, [(1000, 2000), (3000, 4000)]),
        (17, 333, [(1017, 2333), (3017, 4333)]),
        (250, 100, [(1250, 2100), (3250, 4100)]),
        (0, 1000, [(1000, 5000)]),
        (100, 1500, [(1100, 5500)]),
    ],
)
def test_switch_delays(on: int, late: int, want: list[tuple[int, int]]) -> None:
    """Wrong: the delays swapped, a gap where edges meet or cross, energy that does not keep to the switch."""
    job = "LASER POWER 100\nDWELL 1\nLASER ON\nDWELL 1\nLASER OFF\nDWELL 1\nLASER ON\nDWELL 1\nLASER OFF\nDWELL 2\n"
    found = wave(DUTY.format(10) + f"LASER DELAY ON {on} OFF {late}\n" + job)
    assert found.spans("PWM1+") == [(a * 1000, b * 1000) for a, b in want]
    assert off(found.spans("PWM0+"), found.spans("PWM1+")) == []
    assert found.end == 6 * NS


def test_stages_wait_for_the_delay() -> None:
    """Wrong: a stage that begins while the emission of the one before is still on."""
    job = "LASER DELAY ON 0 OFF 700\nLASER POWER 40\nLASER ON\nDWELL 1\nLASER OFF\nWAIT\nLASER ON\nDWELL 2\nLASER OFF\n"
    found = wave(DUTY.format(10) + job)
    assert found.spans("PWM1+") == [(0, 4_400_000)]
    same(found.spans("PWM0+"), periods(F(0), F(44, 10), F(10), lambda _: F(40)))
    assert found.end == 4_400_000


WAIT = "LASER ON\nDWELL 1\nWAIT\nLASER POWER 1.5\nLINE X 11\nLASER OFF\nDWELL 1\n"


def test_emission_over_a_wait() -> None:
    """Wrong: a wait that switches the laser off, a power or a source line that changes at another moment."""
    found = wave(DUTY.format(10) + "LASER POWER 40\n" + WAIT)
    same(found.spans("PWM0+"), periods(F(0), F(31, 10), F(10), lambda t: F(40) if t < 1 else F(3, 2)))
    assert found.spans("PWM1+") == [(0, 3_100_000)]
    assert found.signals["line"] == [(0, 8), (1_000_000, 11), (3_100_000, 13)]


@pytest.mark.parametrize("mode", ["DUTY CARRIER 0.7", "FREQUENCY WIDTH 50"])
def test_period_over_a_wait(mode: str) -> None:
    """Wrong: a period that a wait cuts short, though emission goes on over it."""
    found = wave(HEAD + f"LASER MODE {mode}\nLASER POWER 0.7\n" + WAIT)
    if mode.startswith("DUTY"):
        want = periods(F(0), F(31, 10), F(7, 10), lambda t: F(7, 10) if t < 1 else F(3, 2))
    else:
        want = pulses(F(0), F(31, 10), [(F(0), F(7, 10)), (F(1), F(3, 2))], F(50, 1000))
    same(found.spans("PWM0+"), want)


@pytest.mark.parametrize(
    ("width", "gap", "late"), [(50, 120, 70), (200, 120, 0), (120, 120, 3), (10, 900, 0), (1500, 0, 10), (999, 1, 999)]
)
def test_first_pulse_killer(width: int, gap: int, late: int) -> None:
    """Wrong: a pulse from the emission instead of the on edge, its width cut, emission without gap or too short."""
    job = f"LASER DELAY ON 5 OFF 9\nLASER FPK WIDTH {width} GAP {gap} OFFDELAY {late}\n"
    found = wave(DUTY.format(10) + job + LIT.format(30, 1) + LIT.format(60, 1))
    begin, finish = F(5 + gap, 1000), 1 + F(9 + late, 1000)
    first = periods(1 + begin, 1 + finish, F(10), lambda _: F(30))
    same(found.spans("PWM0+"), first + periods(4 + begin, 4 + finish, F(10), lambda _: F(60)))
    assert found.spans("PWM1+") == [(on + 5000, on + 5000 + width * 1000) for on in (NS, 4 * NS)]


@pytest.mark.parametrize("mode", ["DUTY CARRIER 10", "FREQUENCY WIDTH 20", "ANALOG"])
def test_power_after_the_motion(mode: str) -> None:
    """Wrong: the power of the mark in the emission that its off delay leaves after the motion."""
    job = f"LASER MODE {mode}\nLASER DELAY ON 0 OFF 2000\nLASER POWER 3\nLASER ON\nDWELL 1\nLASER OFF\nLASER POWER 5\n"
    found = wave(HEAD + job + "WAIT\nDWELL 1\n")
    if mode == "ANALOG":
        assert found.signals["AO0"] == [(0, 3.0), (NS, 5.0), (3 * NS, 0.0)]
    elif mode.startswith("DUTY"):
        same(found.spans("PWM0+"), periods(F(0), F(3), F(10), lambda t: F(3 if t < 1 else 5)))
    else:
        same(found.spans("PWM0+"), pulses(F(0), F(3), [(F(0), F(3)), (F(1), F(5))], F(1, 50)))
    assert found.spans("PWM1+") == [(0, 3 * NS)]


def test_on_edge_still_delayed_at_a_wait() -> None:
    """Wrong: energy while the switch is off."""
    job = "LASER DELAY ON 500 OFF 700\nLASER POWER 100\nDWELL 1\nLASER ON\nWAIT\nDWELL 2\nLASER OFF\nDWELL 1\n"
    found = wave(DUTY.format(10) + job)
    assert off(found.spans("PWM0+"), found.spans("PWM1+")) == []


def test_prevoltage_that_changes() -> None:
    """Wrong: a pre-voltage before its stage, or one that outlives it."""
    job = "LASER PREVOLT 1\nDWELL 1\nLASER PREVOLT 2\nDWELL 1\nLASER PREVOLT OFF\nDWELL 1\n"
    found = wave(HEAD + "LASER MODE ANALOG\n" + job + LIT.format(3, 1))
    volts = [(0, 1.0), (1, 2.0), (2, 0.0), (4, 3.0), (5, 0.0)]
    assert found.signals["AO0"] == [(ms * NS, v) for ms, v in volts]


def test_first_pulse_killer_ends() -> None:
    """Wrong: FPK pulses when it is off again, or the switch when it is on."""
    job = "LASER FPK WIDTH 30 GAP 40 OFFDELAY 0\n" + LIT.format(50, 1) + "LASER FPK OFF\n" + LIT.format(50, 1)
    found = wave(DUTY.format(10) + job)
    assert found.spans("PWM1+") == [(1_000_000, 1_030_000), (4_000_000, 5_000_000)]
    want = periods(F(104, 100), F(2), F(10), lambda _: F(50)) + periods(F(4), F(5), F(10), lambda _: F(50))
    same(found.spans("PWM0+"), want)


@pytest.mark.parametrize(("khz", "pct"), [("4", "10"), ("0.7", "50"), ("30", "1.5"), ("5", "0"), ("5", "100")])
@pytest.mark.parametrize("mode", ["DUTY CARRIER 10", "FREQUENCY WIDTH 20"])
def test_standby(mode: str, khz: str, pct: str) -> None:
    """Wrong: no pulses before the first or after the last emission, pulses in one, a phase kept over one."""
    job = f"LASER MODE {mode}\nLASER DELAY ON 13 OFF 37\nLASER STANDBY FREQ {khz} DUTY {pct}\n"
    found = wave(HEAD + job + LIT.format(20, 1) + LIT.format(20, 1))
    on, late = F(13, 1000), F(37, 1000)
    want: Spans = []
    for start, begin, finish in ((F(0), 1 + on, 2 + late), (2 + late, 4 + on, 5 + late)):
        want += periods(start, begin, F(khz), lambda _: F(pct))
        if mode.startswith("DUTY"):
            want += periods(begin, finish, F(10), lambda _: F(20))
        else:
            want += pulses(begin, finish, [(begin, F(20))], F(20, 1000))
    same(found.spans("PWM0+"), want + periods(5 + late, F(6), F(khz), lambda _: F(pct)))
    assert found.spans("PWM1+") == [(1_013_000, 2_037_000), (4_013_000, 5_037_000)]


def test_standby_continues_over_stages() -> None:
    """Wrong: standby that begins anew with a stage, or goes on when it is off."""
    job = "LASER STANDBY FREQ 0.7 DUTY 30\nDWELL 2\nWAIT\nDWELL 3\nLASER STANDBY OFF\nDWELL 2\n"
    want = periods(F(0), F(5), F(7, 10), lambda _: F(30))
    same(wave(DUTY.format(10) + job + LIT.format(100, 1)).spans("PWM0+"), [*want, (F(8), F(9))])


def test_standby_is_for_pwm_and_prevoltage_for_analog() -> None:
    """Wrong: a listing's standby in analog mode, or its pre-voltage in a duty mode."""
    both = "GT_SetWaitPulse(1,4,10,0)\nGT_SetPreVltg(1,2,0)\nGT_LaserOutFrq(10,0)\n"
    analog = read(run(GTS.format("2,10,0", both) + GO, name="x.gts").stdout_bytes)
    assert analog.signals["PWM0+"] == [(0, "1")]
    assert analog.signals["AO0"][:2] == [(0, 2.0), (NS, 5.0)]
    duty = read(run(GTS.format("0,100,0", both) + GO, name="x.gts").stdout_bytes)
    assert duty.signals["AO0"] == [(0, 0.0)]


def test_both_channels() -> None:
    """Wrong: the lines of the other channel, or one that changes with the other."""
    job = "LASER MODE ANALOG CHANNEL 1\nLASER PREVOLT 0.5 CHANNEL 1\nLASER POWER 20\nLASER POWER 7 CHANNEL 1\n"
    found = wave(
        DUTY.format(10) + job + "DWELL 1\nLASER ON\nDWELL 1\nLASER ON CHANNEL 1\nDWELL 1\nLASER OFF\n"
        "LASER POWER 4 CHANNEL 1\nDWELL 1\nLASER OFF CHANNEL 1\nDWELL 1\n"
    )
    assert list(found.signals) == [
        "PWM0+", "PWM0-", "PWM1+", "PWM1-", "AO0", "PWM2+", "PWM2-", "PWM3+", "PWM3-", "AO1", "line",
    ]  # fmt: skip
    same(found.spans("PWM0+"), periods(F(1), F(3), F(10), lambda _: F(20)))
    assert found.spans("PWM1+") == [(NS, 3 * NS)]
    assert found.spans("PWM2+") == []
    assert found.spans("PWM3+") == [(2 * NS, 4 * NS)]
    assert found.signals["AO0"] == [(0, 0.0)]
    assert found.signals["AO1"] == [(0, 0.5), (2 * NS, 7.0), (3 * NS, 4.0), (4 * NS, 0.5)]


def test_channel_1_alone() -> None:
    """Wrong: lines of a channel that the job never names."""
    found = wave(HEAD + "CHANNEL 1\nLASER MODE FREQUENCY WIDTH 20\n" + LIT.format(4, 2))
    assert list(found.signals) == ["PWM2+", "PWM2-", "PWM3+", "PWM3-", "AO1", "line"]
    same(found.spans("PWM2+"), pulses(F(1), F(3), [(F(1), F(4))], F(20, 1000)))


def test_mode_that_changes() -> None:
    """Wrong: a mode before its stage, or one that outlives it."""
    found = wave(
        DUTY.format(10) + LIT.format(50, 1) + "LASER MODE ANALOG\nLASER PREVOLT 1\n" + LIT.format(3, 1)
        + "LASER MODE FREQUENCY WIDTH 10\n" + LIT.format(5, 1) + "LASER MODE DUTY2 CARRIER 3\n" + LIT.format(9, 1)
    )  # fmt: skip
    want = periods(F(1), F(2), F(10), lambda _: F(50)) + pulses(F(7), F(8), [(F(7), F(5))], F(10, 1000))
    same(found.spans("PWM0+"), want + periods(F(10), F(11), F(3), lambda _: F(9)))
    assert found.signals["AO0"] == [(0, 0.0), (3 * NS, 1.0), (4 * NS, 3.0), (5 * NS, 1.0), (6 * NS, 0.0)]
    assert found.spans("PWM1+") == [(k * NS, (k + 1) * NS) for k in (1, 4, 7)] + [(9 * NS, 12 * NS)]


def test_listing_switched_at_once() -> None:
    """Wrong: GT_SetHSIOOpt at rest without effect, or emission that is left on ending before the run."""
    head = GTS.format("0,100,0", "GT_LaserOutFrq(10,0)\n") + "GT_BufDelay(1,2,0)\n"
    for calls in ("GT_SetHSIOOpt(1,0)\nGT_CrdStart(1,0)\n", "GT_CrdStart(1,0)\nGT_SetHSIOOpt(1,0)\n"):
        left_on = read(run(head + calls, name="x.gts").stdout_bytes)
        assert left_on.spans("PWM1+") == [(0, 2 * NS)]
        same(left_on.spans("PWM0+"), periods(F(0), F(2), F(10), lambda _: F(5)))
    wait, again = "GT_CrdStatus(1,run,segment,0)\n", "GT_CrdClear(1,0)\nGT_BufDelay(1,3,0)\nGT_CrdStart(1,0)\n"
    stages = head + "GT_CrdStart(1,0)\n" + wait + "GT_SetHSIOOpt(1,0)\n" + again + wait + "GT_SetHSIOOpt(0,0)\n" + again
    assert read(run(stages, name="x.gts").stdout_bytes).spans("PWM1+") == [(2 * NS, 5 * NS)]


def test_listing_without_a_carrier() -> None:
    """Wrong: a level where it is unknown, or none where there is no emission."""
    found = read(run(GTS.format("0,100,0", "") + GO, name="x.gts").stdout_bytes)
    assert found.signals["PWM0+"] == [(0, "1"), (NS, "x"), (3 * NS, "1")]
    assert found.signals["PWM0-"] == [(0, "0"), (NS, "x"), (3 * NS, "0")]
    assert found.spans("PWM1+") == [(NS, 3 * NS)]


def test_listing_follows_distance() -> None:
    """Wrong: a distance term that a listing sets without effect."""
    follow = "long pos[4] = {0,0,0,0};\ndouble scale[4] = {1000,1000,1000,1000};\ndouble ratio[4] = {10,0,0,0};\n"
    calls = "GT_LaserOutFrq(20,0)\nGT_SetLaserDisMode(1,0,pos,scale,0)\nGT_SetLaserDisRatio(ratio,0,100,0)\n"
    move = "GT_BufLaserOn(1,0,0)\nGT_LnXY(1,4000,0,100,10,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"
    found = read(run(follow + GTS.format("0,100,0", calls) + move, name="x.gts").stdout_bytes)
    until = F(50)

    def x(t: F) -> F:
        return 5 * t * t if t < 10 else 500 + (t - 10) * 100 if t < 40 else 4000 - 5 * (until - t) ** 2

    same(found.spans("PWM0+"), periods(F(0), until, F(20), held(F(0), until, lambda t: 5 + 10 * x(t) / 1000)))


STEP = st.tuples(st.integers(1, 3), st.booleans(), st.integers(0, 99), st.booleans(), st.integers(0, 99))
CARRIER = st.sampled_from(["10", "7", "0.9", "33.3"])
DELAYS = st.tuples(st.integers(0, 999), st.integers(0, 999))


@settings(max_examples=40, phases=(Phase.explicit, Phase.generate))
@given(st.lists(STEP, min_size=1, max_size=6), DELAYS, CARRIER, st.sampled_from([1, 4]))
def test_any_dwells(
    steps: list[tuple[int, bool, int, bool, int]], delays: tuple[int, int], khz: str, khz_1: int
) -> None:
    """Wrong: any edge of the switches and of both channels' energy, in jobs that dwell with the laser on and off."""
    on, late = F(delays[0], 1000), F(delays[1], 1000)
    delay = f"LASER DELAY ON {delays[0]} OFF {delays[1]}"
    job = [f"LASER MODE DUTY CARRIER {khz}", f"LASER MODE DUTY2 CARRIER {khz_1} CHANNEL 1", delay, delay + " CHANNEL 1"]
    spans: tuple[Spans, Spans] = ([], [])
    powers: tuple[list[tuple[F, F]], list[tuple[F, F]]] = ([], [])
    now, shining = F(0), [False, False]
    for ms, *states in [*steps, (2, False, 1, False, 1)]:
        for channel in (0, 1):
            lit, power = bool(states[2 * channel]), int(states[2 * channel + 1])
            job.append(f"LASER POWER {power} CHANNEL {channel}")
            powers[channel].append((now, F(power)))
            if lit and not shining[channel]:
                job.append(f"LASER ON CHANNEL {channel}")
                if spans[channel] and spans[channel][-1][1] >= now + on:
                    spans[channel][-1] = (spans[channel][-1][0], F(0))
                else:
                    spans[channel].append((now + on, F(0)))
            if shining[channel] and not lit:
                job.append(f"LASER OFF CHANNEL {channel}")
                spans[channel][-1] = (spans[channel][-1][0], now + late)
            shining[channel] = lit
        job.append(f"DWELL {ms}")
        now += ms
    found = wave(HEAD + "\n".join(job) + "\n")
    same(found.spans("PWM1+"), spans[0])
    assert found.signals["PWM3+"] == [(0, "0")]
    for channel, carrier in ((0, F(khz)), (1, F(khz_1))):

        def duty(t: F, power: list[tuple[F, F]] = powers[channel]) -> F:
            return max(p for p in power if p[0] <= t)[1]

        low = [part for begin, finish in spans[channel] for part in periods(begin, finish, carrier, duty)]
        same(found.spans(f"PWM{2 * channel}+"), low)


def test_memory_does_not_grow_with_the_emission() -> None:
    """Wrong: all edges of a run at once."""
    peaks = []
    for seconds in (2, 20):
        job = DUTY.format(2) + "LASER POWER 37\nLASER ON\n" + "DWELL 1000\n" * seconds + "LASER OFF\n"
        trace, _ = simulate_stream(stream_of(job), MACHINE)
        assert trace is not None
        tracemalloc.start()
        try:
            size = sum(len(piece) for piece in vcd_pieces(trace, trace.line, "1"))
            peaks.append(tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
        assert size > seconds * 60_000
    assert peaks[1] < 1.3 * peaks[0]
