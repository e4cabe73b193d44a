"""Frequency mode: pulse width times frequency (M 二.2) at the frequency that the controller uses, and watts."""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest
from msgspec.structs import replace
from support.tools import MACHINE, job_of, run_listing

from gusjob.config.machine import Laser, Machine
from gusjob.lint import check

MODE = "LASER MODE FREQUENCY WIDTH {width} {limits}\nVEL 1000\nACC 1000000\n"
PATH = "LASER ON\nLINE X 1\nLASER OFF\n"
SLOW = replace(MACHINE, lasers=(Laser(max_frequency_khz=25.0),))
RATED_W = 30.0
RATED = replace(MACHINE, lasers=(Laser(rated_w=RATED_W),))


def found(
    power: str, *, width: int = 10, limits: str = "", machine: Machine = MACHINE
) -> list[tuple[str, float, float]]:
    """Code, value and duty or limit of what is reported of the frequency."""
    job = job_of(MODE.format(width=width, limits=limits) + power + PATH)
    wanted = [d for d in check(job, machine) if d.rule.code in ("GJ207", "GJ208")]
    return [(d.rule.code, d.fields["value"], d.fields["duty" if "duty" in d.fields else "limit"]) for d in wanted]


DISTANCE = "LASER DISTANCE REF X 0 Y 0 RATIO X {ratio} Y 0 MIN {low} MAX {high}\n"


@pytest.mark.parametrize(
    ("power", "limits", "expected"),
    [
        # 99 kHz * 10 us = 99 %; 100 kHz take the whole period.
        ("LASER POWER 99\n", "", []),
        ("LASER POWER 100\n", "", [("GJ207", 100.0, 100.0)]),
        # The mode's limits come first: the value is the one that the controller uses.
        ("LASER POWER 150\n", "MAX 120", [("GJ207", 120.0, 120.0)]),
        ("LASER POWER 150\n", "MAX 90", []),
        ("LASER POWER 50\n", "MIN 110", [("GJ207", 110.0, 110.0)]),
        ("LASER POWER 0\n", "MIN 110", [("GJ207", 110.0, 110.0)]),
        ("LASER POWER 0\n", "", []),
        # The ends of velocity follow count as LASER POWER does: 0 kHz has no pulses.
        ("LASER FOLLOW RATIO 0.01 MIN 1 MAX 99\n", "", []),
        ("LASER FOLLOW RATIO 0.01 MIN 0 MAX 99\n", "", []),
        ("LASER FOLLOW RATIO 0.01 MIN 0 MAX 99\n", "MIN 0.2", []),
        ("LASER FOLLOW RATIO 0.01 MIN 0 MAX 99\n", "MIN 0.1", [("GJ207", 0.1, 0.1)]),
        ("LASER FOLLOW RATIO 0.01 MIN 1 MAX 100\n", "", [("GJ207", 100.0, 100.0)]),
        # Limits of distance follow hold for the power.
        (DISTANCE.format(ratio=1, low=1, high=99) + "LASER POWER 150\n", "", []),
        (DISTANCE.format(ratio=1, low=0, high=99) + "LASER POWER 50\n", "", []),
        (DISTANCE.format(ratio=1, low=1, high=120) + "LASER POWER 50\n", "", [("GJ207", 120.0, 120.0)]),
        (DISTANCE.format(ratio=1, low=1, high=120) + "LASER POWER 50\n", "MAX 110", [("GJ207", 110.0, 110.0)]),
        (DISTANCE.format(ratio=-1, low=0.05, high=99) + "LASER POWER 50\n", "", [("GJ207", 0.05, 0.05)]),
        (DISTANCE.format(ratio=-1, low=0, high=99) + "LASER POWER 50\n", "", []),
        ("LASER POWER 100 NOW\n", "", [("GJ207", 100.0, 100.0)]),
        ("LASER POWER 150 NOW\n", "MAX 90", []),
        (DISTANCE.format(ratio=1, low=1, high=99) + "LASER POWER 150 NOW\n", "", []),
    ],
)
def test_the_frequency_that_the_controller_uses_counts(
    power: str, limits: str, expected: list[tuple[str, float, float]]
) -> None:
    assert found(power, limits=limits) == expected


@pytest.mark.parametrize(
    "power", ["LASER POWER 20\n", "LASER POWER 20 NOW\n", DISTANCE.format(ratio=1, low=1, high=20) + "LASER POWER 9\n"]
)
def test_a_wider_pulse_counts_for_what_is_kept(power: str) -> None:
    wider = MODE.format(width=75, limits="").splitlines()[0] + "\n"
    kept = power + PATH + wider + "LASER ON\nLINE X 2\nLASER OFF\n"
    assert found(kept) == [("GJ207", 20.0, 150.0)]
    again = wider.replace("75", "80")
    assert found(kept + again + "LASER ON\nLINE X 3\nLASER OFF\n") == [("GJ207", 20.0, 150.0)]


@pytest.mark.parametrize(
    ("power", "limits", "expected"),
    [
        ("LASER POWER 60\n", "", [("GJ208", 60.0, 25.0)]),
        ("LASER POWER 60\n", "MAX 20", []),
        ("LASER POWER 60 NOW\n", "MAX 30", [("GJ208", 30.0, 25.0)]),
        ("LASER FOLLOW RATIO 0.01 MIN 1 MAX 60\n", "MAX 30", [("GJ208", 30.0, 25.0)]),
        (DISTANCE.format(ratio=1, low=1, high=60) + "LASER POWER 9\n", "", [("GJ208", 60.0, 25.0)]),
    ],
)
def test_the_laser_follows_the_frequency_that_the_controller_uses(
    power: str, limits: str, expected: list[tuple[str, float, float]]
) -> None:
    assert found(power, limits=limits, machine=SLOW) == expected


def _any_listing(random: Random) -> str:
    """Calls of a channel in any order, with any frequencies, widths and limits."""

    def khz() -> str:
        return random.choice(["0", "5", "20", "45", "90"])

    x, lines = 0, []
    calls: list[Callable[[], str]] = [
        lambda: f"GT_LaserPowerMode({random.choice('0111123')},{random.choice(['5', '10'])},{random.choice('05')},0)",
        lambda: f"GT_LaserPowerMode(1,{random.choice(['50', '100'])},{khz()},0)",
        lambda: f"GT_SetPulseWidth({random.choice([1, 10, 30, 75])},0)",
        lambda: "GT_LaserOutFrq(10,0)",
        lambda: f"GT_LaserPrfCmd({khz()},0)",
        lambda: f"GT_SetLaserDisMode({random.choice('011')},0,{{0,0,0,0}},{{1000,1000,1000,1000}},0)",
        lambda: f"GT_SetLaserDisRatio({{{random.choice(['-5', '0', '5'])},0,0,0}},{khz()},{khz()},0)",
        lambda: f"GT_BufLaserPrfCmd(1,{khz()},0,0)",
        lambda: f"GT_BufLaserPrfFollow(1,{random.choice(['0.01', '1'])},{khz()},{khz()},0,0)",
        lambda: "GT_SetHSIOOpt(1,0)",
        lambda: f"GT_BufLaser{random.choice(['On', 'On', 'Off'])}(1,0,0)",
        lambda: "GT_CrdStart(1,0)",
        lambda: "GT_CrdStatus(1,run,segment,0)",
        lambda: "GT_CrdStatus(1,run,segment,0)\n" + random.choice(["GT_Reset()", "", ""]),
    ]
    for _ in range(random.randint(4, 40)):
        lines.append(random.choice(calls)())
        if random.random() < 0.4:
            x += random.choice([-3000, 500, 4000])
            lines.append(f"GT_LnXY(1,{x},0,50,5,0,0)")
    return "\n".join([*lines, "GT_CrdStart(1,0)"]) + "\n"


def test_watts_above_the_rated_power_have_an_error() -> None:
    """The most that a laser emits is its rated power, in every mode (M 二.2: the pulse fits its period)."""
    above = 0
    for seed in range(400):
        ran = run_listing(_any_listing(Random(seed)), RATED)
        for channel in ran.report.totals["channels"]:
            most_j = RATED_W * channel["emission_ms"] / 1e3
            if (channel["power_max_w"] or 0.0) > RATED_W * (1 - 1e-9) and channel["unit"] == "kHz":
                above += 1
                assert "GJ207" in ran.codes(), f"seed {seed}"
            if "GJ207" not in ran.codes() and channel["joules"] is not None:
                assert channel["joules"] <= most_j * (1 + 1e-9), f"seed {seed}"
    assert above > 20


NO_WIDTH = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(1,2000,0,0)
GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(1,0)
GT_BufLaserPrfCmd(1,30,0,0)
GT_BufLaserOn(1,0,0)
GT_LnXY(1,10000,0,50,2,0,0)
GT_BufLaserOff(1,0,0)
GT_CrdStart(1,0)
"""
LATER = NO_WIDTH[NO_WIDTH.index("GT_CrdClear") :].replace("10000,0,50", "20000,0,50")


@pytest.mark.parametrize("more", ["", "GT_CrdStatus(1,run,segment,0)\nGT_SetPulseWidth(5,0)\n" + LATER])
def test_without_a_pulse_width_the_watts_are_not_known(more: str) -> None:
    """The controller keeps the width of an earlier program."""
    ran = run_listing(NO_WIDTH + more, RATED)
    assert "GJ702" in ran.codes()
    (channel,) = ran.report.totals["channels"]
    assert (channel["joules"], channel["power_max_w"]) == (None, None)
    assert channel["emission_ms"] > 0
