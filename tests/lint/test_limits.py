"""Limits are compared with what is sent: at the limit nothing is reported and the limit is sent, beyond it is."""

from __future__ import annotations

import pytest
from msgspec.structs import replace
from support.tools import MACHINE, MARK, calls_of, diagnostics_in, run_listing

from gusjob.config.machine import Laser
from gusjob.frontend import check_text, read_job
from gusjob.lint import check


def codes(text: str) -> set[str]:
    return {code for _, code in diagnostics_in(text)}


@pytest.mark.parametrize(
    ("statement", "call"),
    [
        ("JUMP X (0.1*3*500)", "GT_LnXY(1,150000,0,"),
        ("JUMP Y (-0.1*3*500)", "GT_LnXY(1,0,-150000,"),
        ("JUMP X 150.0004", "GT_LnXY(1,150000,0,"),
        ("JUMP X 150.00000000000003", "GT_LnXY(1,150000,0,"),
        ("JUMP X (0.1*3*500) Y 0\nARC CW I (-0.1*3*500) J 0", "GT_ArcXYC(1,150000,0,-150000,0,0,"),
        ("DWELL (0.1*3*10)", "GT_BufDelay(1,3,0)"),
        ("DWELL (0.1*3*10ms)", "GT_BufDelay(1,3,0)"),
        ("LASER DELAY ON (0.1*3*10) OFF (0.1*3*20)", "GT_SetLevelDelay(6,3,0)"),
        ("LASER FPK WIDTH (0.1*3*10) GAP (0.1*3*10) OFFDELAY (0.1*3*10)", "GT_EnaFPK(3,3,3,0)"),
        ("LASER STANDBY FREQ (0.1*3*20000/3) DUTY (0.1*3*1000/3)", "GT_SetWaitPulse(1,2000,100,0)"),
        ("LASER STANDBY FREQ 5 DUTY (0.3-0.1*3)", "GT_SetWaitPulse(1,5,0,0)"),
        ("LASER MODE DUTY CARRIER (0.1*3*20000/3) MAX (0.1*3*1000/3)", "GT_LaserPowerMode(0,100,0,0)"),
        ("LASER MODE DUTY CARRIER (0.1*3*20000/3) MAX 100", "GT_LaserOutFrq(2000,0)"),
        ("LASER MODE FREQUENCY WIDTH (0.1*3*10)", "GT_SetPulseWidth(3,0)"),
        ("LASER MODE ANALOG MAX (0.1*3*100/3)\nLASER PREVOLT (0.1*3*100/3)", "GT_SetPreVltg(1,10,0)"),
        ("LASER POWER (0.1*3*1000/3) NOW", "GT_LaserPrfCmd(100,0)"),
        ("LASER POWER 100.00000000000001 NOW", "GT_LaserPrfCmd(100,0)"),
        ("LASER POWER (0.1*3*100)", "GT_BufLaserPrfCmd(1,30,0,0)"),
        ("LASER FOLLOW RATIO (0.1*3) MIN (0.1*3*10) MAX (0.1*3*100)", "GT_BufLaserPrfFollow(1,0.3,3,30,0,0)"),
        ("VEL (0.1*3*1e5/3)\nJUMP X 50", "GT_LnXY(1,50000,0,10000,10,"),
        ("ACC (0.1*3*1e7/3)\nJUMP X 50", "GT_LnXY(1,50000,0,100,1000,"),
        ("LINE X 50 VEL 30 END (0.1*3*100)\nLINE X 90", ",30,10,30,0)"),
        ("REPEAT (0.1*3*10)\nDWELL 7\nEND", "GT_BufDelay(1,7,0)"),
        ("LASER POWER 30 CHANNEL (0.3-0.1*3)", "GT_BufLaserPrfCmd(1,30,0,0)"),
        ("SKYWRITE MODE (0.1*3*10) TIMELAG (0.1*3*1000) SHIFT (0.1*3*5) NPREV (0.1*3*100) NPOST (0.1*3*100)", ""),
        ("LOOKAHEAD TIME (0.1*3*1000/3) ACC 1pulse/ms2", ""),
        (
            "LASER DISTANCE REF X (0.1*3*10pulse) Y 0 RATIO X 1 Y 1 MIN (0.3-0.1*3) MAX (0.1*3*1000/3)",
            "GT_SetLaserDisRatio({1,1,0,0},0,100,0)",
        ),
    ],
)
def test_a_value_at_its_limit_is_sent_as_the_limit(statement: str, call: str) -> None:
    serious = {"GJ201", "GJ204", "GJ503", "GJ504", "GJ507", "GJ805", "GJ124", "GJ206"}
    text = f"{MARK}{statement}\nJUMP X 1 Y 1\n"
    assert not serious & codes(text)
    assert any(call in line for line in calls_of(text))


@pytest.mark.parametrize(
    ("statement", "code", "shown"),
    [
        ("JUMP X 150.0006", "GJ503", "X 150.0006 mm"),
        ("DWELL 3.00000000001", "GJ204", "DWELL 3.00000000001 ms"),
        ("LASER POWER 100.0000000002 NOW", "GJ201", "100.0000000002 %"),
        ("LASER DELAY ON 65535.0000002 OFF 65535", "GJ201", "65535.0000002 us"),
        ("VEL 10000.00000005", "GJ504", "10000.00000005 mm/s"),
        ("LINE X 5 VEL 30 END 30.0000000001\nLINE X 90", "GJ507", "END 30.0000000001 mm/s"),
    ],
)
def test_a_value_beyond_its_limit_is_shown_with_all_its_digits(statement: str, code: str, shown: str) -> None:
    source, _ = check_text(f"{MARK}{statement}\n".encode(), "test.job")
    assert source is not None
    job, _ = read_job(source, MACHINE)
    (message,) = [f.message for f in check(job, MACHINE) if f.rule.code == code]
    assert shown in message


def test_a_field_between_two_pulses_ends_at_the_one_inside() -> None:
    machine = replace(MACHINE, field_x_mm=(-10.0007, 10.0007))
    assert machine.field_pulse[0] == (-10000, 10000)
    for x, expected in ((10.0004, []), (10.0006, [(4, "GJ503")]), (-10.0005, []), (-10.0006, [(4, "GJ503")])):
        assert diagnostics_in(f"{MARK}JUMP X {x}\n", machine) == expected


def test_an_arc_reaches_as_far_as_it_is_sent() -> None:
    """A circle through (r cos 45, r sin 45) about 0: rounded, its radius is below 150000.5 pulse, so it is inside."""
    assert codes(f"{MARK}JUMP X (150*cos(45)) Y (150*sin(45))\nARC CW I (-150*cos(45)) J (-150*sin(45))\n") == set()
    far = f"{MARK}JUMP X (150.001*cos(45)) Y (150.001*sin(45))\nARC CW I (-150.001*cos(45)) J (-150.001*sin(45))\n"
    assert codes(far) == {"GJ503"}


def test_the_highest_frequency_of_a_laser() -> None:
    machine = replace(MACHINE, lasers=(Laser(channel=0, max_frequency_khz=0.3),))
    text = MARK.replace("CARRIER 10", "CARRIER {}")
    assert diagnostics_in(text.format("(0.1*3)"), machine) == []
    assert diagnostics_in(text.format(0.3000001), machine) == [(1, "GJ208")]


@pytest.mark.parametrize(
    ("call", "shown"),
    [
        ("GT_LaserPrfCmd(100.00000000000001,0)", "100.00000000000001 % is outside"),
        ("GT_LaserOutFrq(2000.0000000000002,0)", "2000.0000000000002 kHz is outside"),
        ("GT_SetPreVltg(1,10.000000000000002,0)", "10.000000000000002 V is outside"),
    ],
)
def test_a_listing_is_compared_as_it_is_written(call: str, shown: str) -> None:
    head = "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\n"
    analog = "GT_LaserPowerMode(2,10,0,0)\n"
    (message,) = [
        f.message
        for f in run_listing((analog if "Vltg" in call else head) + call + "\n").diagnostics
        if f.rule.code == "GJ701"
    ]
    assert shown in message
