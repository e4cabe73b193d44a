"""Kinds of segments: what is commanded decides, never what a delay, the first pulse killer or the power make of it.

Lengths by hand: two marks of 10 mm and two jumps of 5 mm, along X.
"""

from __future__ import annotations

import pytest
from support.tools import MARK, Ran, run_job, run_listing

from gusjob.simulate.kinds import SegmentKind

SETTINGS = (
    "",
    "LASER DELAY ON 0 OFF 60us\n",
    "LASER DELAY ON 100us OFF 2000us\n",
    "LASER DELAY ON 65000us OFF 65000us\n",
    "LASER FPK WIDTH 10us GAP 20us OFFDELAY 500us\n",
    "LASER DELAY ON 300us OFF 500us\nLASER FPK WIDTH 10us GAP 2000us OFFDELAY 10us\n",
)
"""The longest delays are longer than a mark, and than a jump."""
SKY_WRITING = (
    "SKYWRITE MODE 1 TIMELAG 250us\n",
    "SKYWRITE MODE 2 TIMELAG 250us SHIFT 30us NPREV 10 NPOST 5\n",
    "SKYWRITE MODE 3 TIMELAG 250us\n",
    "SKYWRITE MODE 3 TIMELAG 400us NPOST 0\n",
)
DASHES = "LASER POWER 40\nJUMP X 5\nLASER ON\nLINE X 15\nLASER OFF\nJUMP X 20\nLASER ON\nLINE X 30\nLASER OFF\n"


def kinds(ran: Ran) -> list[str]:
    """The kind of each segment."""
    return [SegmentKind(int(kind)).word for kind in ran.column("kind")]


@pytest.mark.parametrize("setting", SETTINGS)
def test_delays_change_no_kind(setting: str) -> None:
    ran = run_job(MARK + setting + DASHES)
    assert kinds(ran) == ["jump", "mark", "jump", "mark"]
    assert (ran.report.totals["mark_mm"], ran.report.totals["jump_mm"]) == (20, 10)


def test_the_tail_of_an_off_delay_is_emission_of_the_jump() -> None:
    ran = run_job(MARK + "LASER DELAY ON 60us OFF 60us\n" + DASHES)
    assert kinds(ran)[2] == "jump"
    assert ran.column("ch0_emission_ms")[2] == pytest.approx(0.06)


@pytest.mark.parametrize("setting", [setting for setting in SETTINGS if "65000" not in setting])
@pytest.mark.parametrize("sky", SKY_WRITING)
def test_a_sky_written_mark_is_what_lies_between_its_ends(sky: str, setting: str) -> None:
    """Also where a switch is inside the mark, in the run-out, or in the jump behind it."""
    ran = run_job(MARK + setting + sky + DASHES)
    x, kind = ran.column("x_mm"), kinds(ran)
    assert ran.report.totals["mark_mm"] == pytest.approx(20, abs=1e-9)
    ends = [at for at, one in zip(x, kind, strict=True) if one == "mark"]
    assert (ends.count(15), ends.count(30)) == (1, 1)
    assert all(5 < at <= 15 or 20 < at <= 30 for at in ends)
    first, last = kind.index("mark"), len(kind) - 1 - kind[::-1].index("mark")
    assert (kind[first - 1], kind[last + 1]) == ("run_in", "run_out")


def test_a_delay_beyond_a_sky_written_mark() -> None:
    """Mode 1 returns to E: laser-off comes while it does, the return is no mark all the same."""
    ran = run_job(MARK + "LASER DELAY ON 65000us OFF 65000us\nSKYWRITE MODE 1 TIMELAG 250us\n" + DASHES)
    assert ran.report.totals["mark_mm"] == pytest.approx(20, abs=1e-9)


X = "GT_LnXY(1,{},0,100,10,0,0)\n"
START = "GT_CrdStart(1,0)\n"
END = "GT_CrdStatus(1,run,segment,0)\n"
HEAD = "GT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\nGT_LaserPrfCmd(40,0)\nGT_CrdClear(1,0)\n"
ON, OFF = "GT_BufLaserOn(1,0,0)\n", "GT_BufLaserOff(1,0,0)\n"
NOW_ON, NOW_OFF = "GT_SetHSIOOpt(1,0)\n", "GT_SetHSIOOpt(0,0)\n"


@pytest.mark.parametrize(
    ("calls", "expected"),
    [
        ([X, ON, X, OFF, X, START], ["jump", "mark", "jump"]),
        ([X, ON, X, ON, X, OFF, OFF, X, START], ["jump", "mark", "mark", "jump"]),
        ([ON, X, OFF, ON, X, OFF, START], ["mark", "mark"]),
        ([NOW_ON, X, X, START, END, NOW_OFF, X, START], ["mark", "mark", "jump"]),
        ([ON, X, START, END, X, OFF, X, START], ["mark", "mark", "jump"]),
        ([X, X, START, NOW_ON, END, NOW_OFF, X, START], ["mark", "mark", "jump"]),
        ([ON, X, X, START, NOW_OFF, END, X, START], ["jump", "jump", "jump"]),
        ([ON, "GT_BufDelay(1,20,0)\n", X, OFF, X, START], ["dwell", "mark", "jump"]),
        (["GT_SetLevelDelay(60000,60000,0)\n", ON, X, OFF, X, START], ["mark", "jump"]),
    ],
    ids=["buffered", "twice", "off and on", "at rest", "through a stage", "on while it moves", "off while it moves",
         "dwell", "delays"],
)  # fmt: skip
def test_kinds_of_a_listing(calls: list[str], expected: list[str]) -> None:
    places = iter(range(5000, 100000, 5000))
    text = HEAD + "".join(call.format(next(places)) if call is X else call for call in calls)
    assert kinds(run_listing(text)) == expected


def test_any_channel_makes_a_mark() -> None:
    job = MARK + "LASER MODE ANALOG CHANNEL 1\nLASER POWER 5 CHANNEL 1\nLASER POWER 40\n"
    ran = run_job(job + "LASER ON CHANNEL 1\nLINE X 1\nLASER OFF CHANNEL 1\nLASER ON\nLINE X 2\nLASER OFF\nJUMP X 3\n")
    assert kinds(ran) == ["mark", "mark", "jump"]
