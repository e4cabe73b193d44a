"""Calls of the sister series that the laser manual does not have. Numbers by hand."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from support.controller import CC
from support.tools import Ran, run_listing

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.gus.driver.library import load_library
from gusjob.controllers.gus.driver.requirements import check_stream, needed_calls
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.path_position import PathPosition
from gusjob.controllers.gus.remainder import remainder_from
from gusjob.frontend import check_text, read_listing

HEAD = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},500,10,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(1,0)
"""
ON, OFF, START, WAIT = (
    "GT_BufLaserOn(1,0,0)\n",
    "GT_BufLaserOff(1,0,0)\n",
    "GT_CrdStart(1,0)\n",
    "GT_CrdStatus(1,r,s,0)\n",
)
LINE, BACK = "GT_LnXY(1,10000,0,50,2,0,0)\n", "GT_LnXY(1,0,0,50,2,0,0)\n"
"""225 ms each."""


def messages(ran: Ran) -> list[tuple[int, str, str]]:
    return [(d.span.line, d.rule.code, d.message) for d in ran.diagnostics]


def test_a_line_to_rest_ends_at_velocity_0() -> None:
    """200 ms at 50 pulse/ms and a ramp of 25 ms at each end: the next line starts at rest."""
    ran = run_listing(HEAD + "GT_LnXYG0(1,10000,0,50,2,0)\n" + "GT_LnXY(1,20000,0,50,2,50,0)\n" + START)
    assert ran.column("duration_ms") == pytest.approx([225, 212.5])
    assert ran.column("length_mm") == [10, 10]


def test_a_follow_with_limits_that_are_not_whole() -> None:
    """At 50 pulse/ms 0.5*50 + 2.5 is above the limit of 20.5."""
    follow = "GT_BufLaserFollowRatio(1,0.5,2.5,20.5,0,0)\n"
    ran = run_listing(HEAD + follow + ON + LINE + OFF + START, Machine(period_us=1))
    assert ran.column("ch0_power_min") == pytest.approx([2.5], abs=0.01)
    assert ran.column("ch0_power_max") == [20.5]
    whole = run_listing(HEAD + "GT_BufLaserPrfFollow(1,0.5,2,20,0,0)\n" + ON + LINE + OFF + START)
    same = run_listing(HEAD + "GT_BufLaserFollowRatio(1,0.5,2,20,0,0)\n" + ON + LINE + OFF + START)
    assert same.column("ch0_power_ms") == whole.column("ch0_power_ms")


def test_the_limits_of_a_follow_have_the_range_of_a_power() -> None:
    ran = run_listing(
        HEAD + "GT_BufLaserFollowRatio(1,0.5,20.5,2.5,0,0)\nGT_BufLaserFollowRatio(1,0.5,2,101,0,0)\n" + START
    )
    assert sorted((line, code) for line, code, _ in messages(ran)) == [(6, "GJ701"), (7, "GJ701")]


def test_after_the_end_of_a_follow_no_power_is_set() -> None:
    text = HEAD + "GT_BufLaserPrfFollow(1,1,10,90,0,0)\n" + ON + LINE + "GT_BufLaserFollowOff(1,0,0)\n"
    ran = run_listing(text + BACK + OFF + START)
    assert ran.column("ch0_power_ms")[1] == 0
    assert [(line, code) for line, code, _ in messages(ran)] == [(10, "GJ712")]
    again = run_listing(text + "GT_BufLaserPrfCmd(1,40,0,0)\n" + BACK + OFF + START)
    assert again.column("ch0_power_ms")[1] == pytest.approx(40 * 225)
    assert messages(again) == []


def test_the_end_of_a_follow_does_not_change_a_direct_power() -> None:
    follow, end = "GT_BufLaserPrfFollow(1,1,10,90,0,0)\n", "GT_BufLaserFollowOff(1,0,0)\n"
    ran = run_listing(HEAD + follow + end + "GT_BufLaserPrfCmd(1,40,0,0)\n" + end + ON + LINE + OFF + START)
    assert ran.column("ch0_power_ms") == pytest.approx([40 * 225])


def test_a_follow_of_the_planned_velocity_is_what_there_is_anyway() -> None:
    text = "GT_BufLaserPrfFollow(1,1,10,90,0,0)\n" + ON + LINE + OFF + START
    plain, planned = run_listing(HEAD + text), run_listing(HEAD + "GT_BufLaserFollowMode(1,0,0,0,0)\n" + text)
    assert planned.column("ch0_power_ms") == plain.column("ch0_power_ms")
    assert messages(planned) == []


def test_what_is_not_simulated_of_a_follow_is_reported() -> None:
    ran = run_listing(HEAD + "GT_BufLaserFollowMode(1,1,0,0,5.5)\nGT_BufLaserFollowMode(1,2,0,0,0)\n" + LINE + START)
    assert messages(ran) == [
        (7, "GJ701", "GT_BufLaserFollowMode returns 7: source 2 is outside [0, 1]"),
        (
            6,
            "GJ702",
            "GT_BufLaserFollowMode: source 1 is the measured velocity; the simulation follows the planned one",
        ),
        (6, "GJ702", "GT_BufLaserFollowMode: startPower is not documented; it is not simulated"),
    ]


def test_names_are_kept_when_a_listing_is_written_again() -> None:
    text = (
        "GT_Reset()\nGT_SetCrdStopDec(1,2.5,100)\nGT_LnXYG0(1,1000,-2000,50.5,2,0)\nGT_BufLaserFollowMode(1,0,0,1,0.5)\n"
        "GT_BufLaserFollowRatio(1,0.1,2.5,97.5,0,0)\nGT_BufLaserFollowOff(1,0,1)\nGT_Stop(256,0)\n"
    )
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert diagnostics == []
    assert "".join(listing(stream)) == text


def test_a_stop_at_rest_has_no_effect() -> None:
    text = HEAD + ON + LINE + OFF + START + WAIT
    stopped, plain = run_listing(text + "GT_Stop(256,256)\n" + BACK + START), run_listing(text + BACK + START)
    assert stopped.column("ch0_emission_ms") == plain.column("ch0_emission_ms") == pytest.approx([225, 0])
    assert messages(stopped) == messages(plain)


def test_a_run_that_is_stopped_at_an_unknown_time_has_no_report() -> None:
    for call in ("GT_Stop(256,0)", "GT_Reset()"):
        source, _ = check_text((HEAD + LINE + START + call + "\n").encode(), "test.gts")
        assert source is not None
        trace, diagnostics = simulate_stream(read_listing(source)[0], Machine(), is_listing=True)
        assert trace is None
        assert [(d.span.line, d.rule.code) for d in diagnostics] == [(8, "GJ725")]


def test_a_reset_loses_the_settings() -> None:
    settings = "GT_SetLevelDelay(200,100,0)\nGT_LaserPrfCmd(20,0)\nGT_SetHSIOOpt(1,0)\n"
    text = HEAD + settings + "GT_Reset()\n"
    ran = run_listing(text + ON + LINE + OFF + START)
    # Delays are gone, and no power is set; the switch is off before the line.
    assert ran.column("ch0_emission_ms") == pytest.approx([225])
    assert ran.column("ch0_power_ms") == [0]
    text = "GT_Reset: the switch goes off; modes, limits, delays and coordinate systems set before are lost"
    assert messages(ran)[0] == (9, "GJ702", text)
    assert {code for _, code, _ in messages(ran)} == {"GJ702", "GJ710", "GJ712", "GJ715", "GJ726"}


def test_a_reset_clears_the_buffers() -> None:
    ran = run_listing(HEAD + LINE + "GT_Reset()\n" + HEAD + BACK + START)
    assert ran.column("line") == [13]
    assert "GT_Reset: 1 buffered calls are cleared and never run" in [text for _, _, text in messages(ran)]


def test_a_reset_at_power_up_loses_nothing() -> None:
    text = HEAD + "GT_BufLaserPrfCmd(1,40,0,0)\n" + ON + LINE + OFF + START
    assert messages(run_listing("GT_Reset()\n" + text)) == []
    assert run_listing("GT_Reset()\n" + text).column("ch0_power_ms") == pytest.approx([40 * 225])


def test_the_rest_of_a_run_has_the_follow_and_its_source() -> None:
    follow = "GT_BufLaserFollowMode(1,0,0,0,0)\nGT_BufLaserFollowRatio(1,0.1,2.5,97.5,0,0)\n"
    source, _ = check_text(
        (HEAD + "GT_SetCrdStopDec(1,5,50)\n" + follow + ON + LINE + BACK + START).encode(), "test.gts"
    )
    assert source is not None
    stream = read_listing(source)[0]
    calls = "".join(listing(remainder_from(stream, PathPosition(row=4)).stream))
    state = "GT_CrdClear(1,0)\nGT_LnXY(1,10000,0,50,2,0,0)\n" + follow + ON + BACK + START
    assert calls.endswith("{0,0,0,0,0,0,0,0}})\nGT_SetCrdStopDec(1,5,50)\n" + state)


def test_a_gus_library_does_not_have_the_follow_of_the_sister_series(tmp_path: Path) -> None:
    if CC is None:
        pytest.skip("no C compiler")
    source, _ = check_text((HEAD + "GT_BufLaserFollowRatio(1,0.1,2,97,0,0)\n" + LINE + START).encode(), "test.gts")
    assert source is not None
    needed = needed_calls(read_listing(source)[0], Machine())
    library = tmp_path / "none.so"
    empty = tmp_path / "none.c"
    empty.write_text("int none;\n", encoding="ascii")
    subprocess.run([CC, "-shared", "-fPIC", str(empty), "-o", str(library)], check=True)
    _, (fault,) = load_library(str(library), Abi.GUS, 0, needed)
    assert fault.rule.code == "GJ902"
    assert "GT_BufLaserFollowRatio" in fault.message


@pytest.mark.parametrize("call", ["GT_Stop(256,0)", "GT_Reset()"])
def test_a_run_on_hardware_makes_no_stop_of_its_own(call: str) -> None:
    source, _ = check_text((HEAD + LINE + START + WAIT + call + "\n" + call + "\n").encode(), "test.gts")
    assert source is not None
    (refused,) = check_stream(read_listing(source)[0])
    assert (refused.rule.code, refused.span.line) == ("GJ921", 9)
