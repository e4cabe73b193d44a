"""Mark quality: errors, emission outside, energy per mm and corner misses against closed forms. Numbers by hand.

1000 pulse/mm: 100 pulse/ms is 100 mm/s, and a lag of 200 us is 20 um of it.
"""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from msgspec.structs import replace
from support.tools import MACHINE, MARK, Ran, run_job, run_listing, stream_of

from gusjob.config.machine import Machine, Scanner, ScannerModel
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.model import simulate_stream
from gusjob.frontend import check_text, read_listing
from gusjob.ir.intent import Intent, RunKind
from gusjob.report.answer import answer_of
from gusjob.report.files import report_csv, report_json, summary_csv
from gusjob.report.markdown import report_markdown
from gusjob.report.rows import Report, make_report
from gusjob.report.text import report_text
from gusjob.simulate.intervals import Intervals
from gusjob.simulate.kinds import SegmentKind
from gusjob.simulate.quality.energy_bins import BIN_MM
from gusjob.simulate.quality.marks import MARKING_WORDS, _root

HEAD = "GT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\nGT_BufLaserPrfCmd(1,50,0,0)\n"
ON, OFF, START = "GT_BufLaserOn(1,0,0)\n", "GT_BufLaserOff(1,0,0)\n", "GT_CrdStart(1,0)\n"
ACC = 10
LAG_US = 200.0
LAG_UM = 20.0


def move(x: float, y: float, end: float = 100, vel: float = 100) -> str:
    return f"GT_LnXY(1,{x},{y},{vel},{ACC},{end},0)\n"


STEADY = HEAD + move(10000, 0) + ON + move(20000, 0) + OFF + move(30000, 0, 0) + START
"""Emission on for 10 mm and 100 ms at 100 mm/s, with a run-in of 10 mm (105 ms) and a run-out."""


def lagging(model: str, machine: Machine = MACHINE) -> Machine:
    return replace(machine, scanner=Scanner(model=ScannerModel(model), tracking_error_us=LAG_US))


def marks_in(report: Report) -> dict[str, npt.NDArray[Any]]:
    """The table of marks of a report that has one."""
    assert report.marks is not None
    return report.marks


def marks(ran: Ran | Report, row: int = 0) -> dict[str, float]:
    report = ran.report if isinstance(ran, Ran) else ran
    return {name: float(column[row]) for name, column in marks_in(report).items()}


def count(ran: Ran) -> int:
    return len(marks_in(ran.report)["line"])


def test_without_lag_nothing_is_wrong() -> None:
    found = marks(run_listing(STEADY))
    assert found["start_ms"] == pytest.approx(105)
    assert found["length_mm"] == pytest.approx(10)
    assert (found["line"], found["channel"]) == (6, 0)
    for name in ("on_error_um", "off_error_um", "on_miss_um", "off_miss_um", "outside_power_ms"):
        assert found[name] == 0
    # 50 % for 10 ms a mm.
    assert found["power_per_mm_mid"] == pytest.approx(500, rel=1e-9)
    assert found["power_per_mm_peak"] == pytest.approx(500, rel=1e-6)
    assert found["power_per_mm_rms_pct"] < 1e-4
    assert math.isnan(found["corner_miss_um"])


@pytest.mark.parametrize("model", ["delay", "first-order", "second-order"])
def test_a_lag_takes_the_mark_back_and_leaves_its_end_out(model: str) -> None:
    found = marks(run_listing(STEADY, lagging(model)))
    assert found["on_error_um"] == pytest.approx(-LAG_UM)
    assert found["off_error_um"] == pytest.approx(-LAG_UM)
    assert (found["on_miss_um"], found["off_miss_um"]) == pytest.approx((LAG_UM, LAG_UM))
    # Up to S at 50 % for 0.2 ms.
    assert found["outside_power_ms"] == pytest.approx(50 * 0.2)
    assert found["power_per_mm_mid"] == pytest.approx(500)
    assert found["power_per_mm_rms_pct"] < 0.1


def test_switch_delays_are_errors_that_a_lag_compensates() -> None:
    text = "GT_SetLevelDelay(300,200,0)\n" + STEADY
    late = marks(run_listing(text))
    assert (late["on_error_um"], late["off_error_um"]) == pytest.approx((20, 30))
    assert (late["on_miss_um"], late["off_miss_um"]) == pytest.approx((20, 30))
    assert late["outside_power_ms"] == pytest.approx(50 * 0.3)
    right = marks(run_listing("GT_SetLevelDelay(200,200,0)\n" + STEADY, lagging("delay")))
    assert (right["on_error_um"], right["off_error_um"], right["outside_power_ms"]) == (0, 0, 0)


def test_the_match_head_of_a_mark_from_rest() -> None:
    found = marks(run_listing(HEAD + ON + move(10000, 0, 0) + OFF + START))
    # Up to 0.1 mm/ms with 0.01 mm/ms2 in 10 ms and 0.5 mm; the same down.
    place = np.linspace(0, 10, round(10 / BIN_MM) + 1)
    time = np.where(place < 0.5, np.sqrt(2 * place / 0.01), 10 + (place - 0.5) / 0.1)
    time = np.where(place > 9.5, 110 - np.sqrt(np.maximum(2 * (10 - place) / 0.01, 0)), time)
    energy = 50 * np.diff(time) / BIN_MM
    assert found["power_per_mm_peak"] == pytest.approx(50 * math.sqrt(2 * BIN_MM / 0.01) / BIN_MM, rel=1e-6)
    assert found["power_per_mm_mid"] == pytest.approx(500)
    assert found["power_per_mm_rms_pct"] == pytest.approx(np.sqrt(np.mean((energy / 500 - 1) ** 2)) * 100, rel=1e-6)


def test_emission_at_standstill_counts_for_the_first_bin() -> None:
    text = HEAD + move(1000, 0, 0) + ON + "GT_BufDelay(1,10,0)\n" + move(6000, 0, 0) + OFF + START
    first = 50 * (10 + math.sqrt(2 * BIN_MM / 0.01)) / BIN_MM
    assert marks(run_listing(text))["power_per_mm_peak"] == pytest.approx(first, rel=1e-6)
    assert marks(run_listing(text))["line"] == 6


def test_outside_before_s_and_beyond_e_while_accelerating() -> None:
    # The planner means 5 mm..8 mm; it emits from rest at 4.9 mm to rest at 8.1 mm: 0.1 mm each, 4 ms up to 40 mm/s
    # in 0.08 mm, and 0.5 ms.
    text = HEAD + move(4900, 0, 0) + ON + move(5000, 0, 40, 40) + move(8000, 0, 40) + move(8100, 0, 0, 40) + OFF + START
    stream = listing_stream(text)
    rows = np.flatnonzero(stream.buffered.kind == Buffered.LINE)
    on, off = (int(np.flatnonzero(stream.buffered.kind == kind)[0]) for kind in (Buffered.ON, Buffered.OFF))
    found = marks(report_of(stream, intent_of(stream, {on: int(rows[2]), off: int(rows[2])})))
    assert (found["on_error_um"], found["off_error_um"]) == pytest.approx((-100, 100))
    assert found["outside_power_ms"] == pytest.approx(2 * 50 * 4.5, rel=1e-9)


def listing_stream(text: str) -> Stream:
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    return read_listing(source)[0]


def intent_of(stream: Stream, ends: dict[int, int], runs: dict[int, RunKind] | None = None) -> Intent:
    mark_end = np.full(len(stream.buffered), -1, dtype=np.intp)
    run = np.zeros(len(stream.buffered), dtype=np.int8)
    for row, motion in ends.items():
        mark_end[row] = motion
    for row, what in (runs or {}).items():
        run[row] = what
    return Intent(run=run, mark_end=mark_end)


def report_of(stream: Stream, intent: Intent, machine: Machine = MACHINE) -> Report:
    trace, _ = simulate_stream(replace(stream, intent=intent), machine)
    assert trace is not None
    return make_report(trace, machine)


def text_of(report: Report) -> str:
    """The report for people, with its tables."""
    return report_text(report, answer_of(report, []), tables=True)


def test_the_planner_says_where_a_mark_begins_and_ends() -> None:
    # The emission comes and goes 20 um (a lag) after S = 10 mm and E = 20 mm; one corner is passed between E and off.
    text = (
        HEAD
        + move(10000, 0)
        + move(10020, 0)
        + ON
        + move(20000, 0)
        + move(20000, 20)
        + OFF
        + move(20000, 5000, 0)
        + START
    )
    stream = listing_stream(text)
    rows = np.flatnonzero(stream.buffered.kind == Buffered.LINE).tolist()
    on, off = (int(np.flatnonzero(stream.buffered.kind == kind)[0]) for kind in (Buffered.ON, Buffered.OFF))
    intent = intent_of(stream, {on: rows[1], off: rows[2]}, {rows[0]: RunKind.RUN_IN, rows[4]: RunKind.RUN_OUT})
    report = report_of(stream, intent, lagging("delay"))
    found = marks(report)
    assert (found["on_error_um"], found["off_error_um"], found["outside_power_ms"]) == (0, 0, 0)
    assert math.isnan(found["corner_miss_um"])
    assert [SegmentKind(k).word for k in report.columns["kind"].tolist()] == [
        "run_in",
        "mark",
        "mark",
        "jump",
        "run_out",
    ]
    assert (report.totals["run_in_mm"], report.totals["run_out_mm"]) == pytest.approx((10, 4.98))
    assert "run-ins 10 mm, run-outs 4.98 mm" in text_of(report)
    assert "| run-ins mm | run-outs mm |" in report_markdown(report, [], name="x")
    # Without it S and E are where the switch stands.
    plain = marks(run_listing(text, lagging("delay")))
    assert plain["on_error_um"] == pytest.approx(-20)
    assert plain["off_miss_um"] == pytest.approx(20)
    assert plain["corner_miss_um"] == 0


def corner_miss(lag_um: float, order: int) -> float:
    """Least distance to a corner of 90 degrees that is passed at constant speed, by a fine grid; time in lags."""
    time = np.linspace(0, 8, 800_001)
    if order == 1:
        x, y = -np.exp(-time), time - 1 + np.exp(-time)
    else:  # Two filters of half the lag: what is left of a ramp is (1 + t) * exp(-2*t) beside t - 1.
        x, y = -(1 + time) * np.exp(-2 * time), time - 1 + (1 + time) * np.exp(-2 * time)
    return lag_um * float(np.hypot(x, y).min())


@pytest.mark.parametrize(("model", "order"), [("first-order", 1), ("second-order", 2)])
def test_a_corner_is_cut(model: str, order: int) -> None:
    text = HEAD + move(5000, 0) + ON + move(10000, 0) + move(10000, 10000) + OFF + move(10000, 15000, 0) + START
    found = marks(run_listing(text, lagging(model)))
    assert found["corner_miss_um"] == pytest.approx(corner_miss(LAG_UM, order), rel=1e-3)
    if order == 1:
        assert found["corner_miss_um"] == pytest.approx(0.51 * LAG_UM, rel=0.01)
    for other in (MACHINE, lagging("delay")):
        assert marks(run_listing(text, other))["corner_miss_um"] == 0


def test_only_corners_inside_the_mark_count_and_the_worst_of_them() -> None:
    slow = move(10000, 10000) + move(9990, 20000) + move(20000, 20000) + OFF + move(20000, 30000)
    text = HEAD + move(10000, 0) + ON + slow + move(0, 0, 0) + START
    # Turns by 0.06 degrees (none), then by about 90; those at S and at E do not count.
    assert marks(run_listing(text, lagging("first-order")))["corner_miss_um"] == pytest.approx(10.2, rel=0.02)
    flat = HEAD + move(10000, 0) + ON + move(10000, 10000) + OFF + move(0, 10000, 0) + START
    assert math.isnan(marks(run_listing(flat, lagging("first-order")))["corner_miss_um"])


def test_a_closed_square() -> None:
    square = move(9000, 5000, 0) + move(9000, 9000, 0) + move(5000, 9000, 0) + move(5000, 5000, 0)
    text = HEAD + move(5000, 5000, 0) + ON + square + OFF + move(0, 0, 0) + START
    found = marks(run_listing(text))
    assert found["length_mm"] == pytest.approx(16)
    assert (found["on_error_um"], found["off_error_um"], found["outside_power_ms"], found["corner_miss_um"]) == (0,) * 4
    late = marks(run_listing(text, lagging("delay")))
    # At both ends at rest, 0.2 ms late: a*t^2/2 is missing at E; at S (come from 45 degrees) as much, along the side.
    assert late["off_error_um"] == pytest.approx(-0.2)
    assert late["on_miss_um"] == pytest.approx(0.2)
    assert late["on_error_um"] == pytest.approx(-0.2 * math.sqrt(0.5))
    assert late["outside_power_ms"] == 0


def test_arcs_are_even_and_end_where_they_began() -> None:
    circle = f"GT_ArcXYC(1,20000,0,0,5000,1,100,{ACC},100,0)\n"
    text = HEAD + move(20000, 0) + ON + circle + OFF + move(30000, 0, 0) + START
    plain, late = marks(run_listing(text)), marks(run_listing(text, lagging("delay")))
    assert plain["length_mm"] == pytest.approx(math.tau * 5, rel=5e-4)
    assert (plain["on_miss_um"], plain["off_miss_um"]) == pytest.approx((0, 0), abs=1e-5)
    assert plain["power_per_mm_mid"] == pytest.approx(500, rel=1e-3)
    assert plain["power_per_mm_rms_pct"] < 0.1
    assert late["power_per_mm_rms_pct"] < 0.1
    # 20 um after on a radius of 5 mm: along the tangent r*sin(phi).
    assert late["off_error_um"] == pytest.approx(-5000 * math.sin(20 / 5000), rel=1e-6)
    assert late["off_miss_um"] == pytest.approx(10000 * math.sin(10 / 5000), rel=1e-6)


def test_unequal_axes() -> None:
    machine = replace(MACHINE, pulses_per_mm=(1000.0, 2000.0))
    up = HEAD + move(0, 10000) + ON + move(0, 20000) + OFF + move(0, 30000, 0) + START
    found = marks(run_listing(up, lagging("delay", machine)))
    assert found["length_mm"] == pytest.approx(5)
    assert found["on_error_um"] == pytest.approx(-10)
    assert found["power_per_mm_mid"] == pytest.approx(1000)
    slant = HEAD + move(6000, 8000) + ON + move(12000, 16000) + OFF + move(18000, 24000, 0) + START
    # 20 pulse of lag are 12 um and 8 um.
    found = marks(run_listing(slant, lagging("delay", machine)))
    assert (found["on_error_um"], found["off_miss_um"]) == pytest.approx((-math.hypot(12, 8), math.hypot(12, 8)))


def test_two_channels_have_their_own_marks() -> None:
    other = [
        "GT_LaserPowerMode(2,10,0,1)\nGT_BufLaserPrfCmd(1,5,0,1)\n",
        "GT_BufLaserOn(1,0,1)\n",
        "GT_BufLaserOff(1,0,1)\n",
    ]
    text = (
        other[0]
        + HEAD
        + move(10000, 0)
        + ON
        + move(12000, 0)
        + other[1]
        + move(14000, 0)
        + OFF
        + move(16000, 0)
        + other[2]
        + move(30000, 0, 0)
        + START
    )
    ran = run_listing(text)
    assert marks_in(ran.report)["channel"].tolist() == [0, 1]
    assert marks_in(ran.report)["start_ms"] == pytest.approx([105, 125])
    assert marks_in(ran.report)["length_mm"] == pytest.approx([4, 4])
    assert marks_in(ran.report)["power_per_mm_mid"] == pytest.approx([500, 50])
    assert [(e["channel"], e["unit"], e["marks"]) for e in ran.report.totals["marking"]] == [(0, "%", 1), (1, "V", 1)]
    assert [e["worst"]["power_per_mm_mid"] for e in ran.report.totals["marking"]] == pytest.approx([500, 50])


def test_emission_switched_at_rest_is_meant_from_the_start_of_its_stage() -> None:
    ran = run_job(MARK + "LASER POWER 10 NOW\nLASER ON NOW\nLINE X 1\nLASER OFF NOW\nLINE X 2\n", lagging("delay"))
    assert count(ran) == 1
    found = marks(ran)
    assert found["on_error_um"] == 0
    # 100 mm/s, 10000 mm/s2: the last 0.2 ms cover a*t^2/2 = 0.2 um.
    assert found["off_error_um"] == pytest.approx(-0.2)
    assert found["length_mm"] == pytest.approx(1, abs=1e-3)


def test_an_immediate_off_of_a_running_stage_is_meant_for_its_start() -> None:
    text = (
        HEAD + "GT_SetLevelDelay(10000,0,0)\nGT_SetHSIOOpt(1,0)\n" + move(10000, 0, 0) + START + "GT_SetHSIOOpt(0,0)\n"
    )
    found = marks(run_listing(text))
    # 10 ms of off delay at 10 pulse/ms2: 500 um.
    assert found["off_error_um"] == pytest.approx(500)


def test_a_mark_through_a_wait_is_two_marks() -> None:
    ran = run_job(MARK + "LASER POWER 10\nLASER ON\nLINE X 1\nWAIT\nLINE X 3\nLASER OFF\n")
    assert marks_in(ran.report)["length_mm"] == pytest.approx([1, 2])
    assert marks_in(ran.report)["off_miss_um"].tolist() == [0, 0]
    assert marks_in(ran.report)["line"].tolist() == [6, 8]


def test_merged_emission_keeps_the_first_on_and_the_last_off() -> None:
    gap = OFF + ON
    text = "GT_SetLevelDelay(200,0,0)\n" + STEADY.replace(move(20000, 0), move(15000, 0) + gap + move(20000, 0))
    ran = run_listing(text)
    assert count(ran) == 1
    assert marks(ran)["length_mm"] == pytest.approx(10.02)
    assert (marks(ran)["on_error_um"], marks(ran)["off_error_um"]) == pytest.approx((0, 20))
    stream = listing_stream(text)
    trace, _ = simulate_stream(stream, MACHINE)
    assert trace is not None
    emission = trace.channels[0].emission
    assert trace.channels[0].switch.on.tolist() == [True, False, True, False]
    assert (emission.on_event.tolist(), emission.off_event.tolist()) == ([0], [3])


def test_emission_through_stages_has_no_events_of_its_own() -> None:
    trace, _ = simulate_stream(
        stream_of(MARK + "LASER POWER 10\nLASER ON\nLINE X 1\nWAIT\nLINE X 2\nLASER OFF\n"), MACHINE
    )
    assert trace is not None
    emission = trace.channels[0].emission
    assert [event >= 0 for event in emission.on_event.tolist()] == [True, False]
    assert [event >= 0 for event in emission.off_event.tolist()] == [False, True]


def test_follow_makes_up_for_slow_ends() -> None:
    follow = "GT_BufLaserPrfFollow(1,0.5,0,100,0,0)\n"
    body = ON + move(10000, 0, 0) + OFF + START
    direct, followed = (marks(run_listing(text)) for text in (HEAD + body, HEAD + follow + body))
    assert followed["power_per_mm_mid"] == pytest.approx(500)
    assert followed["power_per_mm_rms_pct"] < direct["power_per_mm_rms_pct"] / 5


@pytest.mark.parametrize("power", ["GT_BufLaserPrfFollow(1,0.5,0,100,0,0)\n", ""])
def test_parts_of_a_segment_add_up_to_its_energy(power: str) -> None:
    text = "GT_SetLevelDelay(300,0,0)\n" + HEAD + power + ON + move(10000, 0, 0) + OFF + START
    trace, _ = simulate_stream(listing_stream(text), MACHINE)
    assert trace is not None
    (channel,) = trace.channels
    edges = np.linspace(0, 110.3, 1001)
    spans = Intervals(stage=np.zeros(1000, dtype=np.intp), start_ms=edges[:-1], end_ms=edges[1:])
    parts = channel.power.integral(spans)
    assert parts.sum() == pytest.approx(channel.emitted.power_ms[0], rel=1e-12)
    if not power:
        assert parts == pytest.approx(50 * 0.1103)


def test_emission_without_motion() -> None:
    found = marks(run_listing(HEAD + ON + "GT_BufDelay(1,10,0)\n" + OFF + START))
    assert found["length_mm"] == 0
    assert (found["on_error_um"], found["off_miss_um"], found["outside_power_ms"]) == (0, 0, 0)
    for name in ("power_per_mm_mid", "power_per_mm_peak", "power_per_mm_rms_pct", "corner_miss_um"):
        assert math.isnan(found[name])


def test_the_off_delay_after_a_stage_emits_at_its_end() -> None:
    text = "GT_SetLevelDelay(500,0,0)\n" + HEAD + ON + move(10000, 0, 0) + OFF + START
    found = marks(run_listing(text, lagging("first-order")))
    # In 0.5 ms what is missing at the end (about a*lag^2 = 0.4 um) has faded.
    assert abs(found["off_error_um"]) < 0.1
    more = HEAD.splitlines(keepends=True)[2] + ON + move(0, 0, 0) + OFF + START
    both = run_listing(text + "GT_CrdStatus(1,run,segment,0)\n" + more)
    assert marks_in(both.report)["off_miss_um"].tolist() == [0, 0]


def test_nothing_marked() -> None:
    for ran in (run_job(MARK), run_job(MARK + "LINE X 1\n"), run_listing(HEAD + START), run_listing("")):
        assert count(ran) == 0 if ran.report.marks else True
        assert ran.report.totals["marking"] == []
        assert json.loads(b"".join(report_json(ran.report, [], summary=False)))["marks"] is not None
        text_of(ran.report)
    dark = run_listing(HEAD + ON + START + "GT_SetHSIOOpt(0,0)\n")
    text_of(dark.report)


def test_the_report_holds_marks_and_their_totals() -> None:
    two = STEADY.replace(START, move(20000, 0, 0) + ON + move(10000, 0, 0) + OFF + START)
    ran = run_listing(two, lagging("delay"))
    found = json.loads(b"".join(report_json(ran.report, [], summary=False)))
    assert found["scanner"] == {"model": "delay", "tracking_error_us": LAG_US}
    assert {len(column) for column in found["marks"].values()} == {2}
    assert found["marks"]["on_error_um"] == pytest.approx([-20, -0.2])
    (entry,) = found["totals"]["marking"]
    assert (entry["channel"], entry["unit"], entry["marks"]) == (0, "%", 2)
    assert entry["worst"].keys() == entry["typical"].keys() == MARKING_WORDS.keys()
    assert entry["worst"]["on_error_um"] == pytest.approx(-20)
    assert entry["typical"]["on_error_um"] == pytest.approx(10.1)
    assert entry["worst"]["corner_miss_um"] is None
    short = json.loads(b"".join(report_json(ran.report, [], summary=True)))
    assert "marks" not in short
    assert short["totals"] == found["totals"]
    plain = json.loads(b"".join(report_json(run_listing(two).report, [], summary=True)))
    assert plain["scanner"] is None


def test_people_see_worst_and_typical() -> None:
    report = run_listing(STEADY, lagging("delay")).report
    text = text_of(report)
    assert "channel 0: 1 mark, worst (typical): on error -20 (20) um, off error -20 (20) um" in text
    assert "outside 10 (10) %·ms" in text
    assert "on err um" in text
    assert "on err um" not in report_text(report, answer_of(report, []))
    assert "| 0 | on error | um | 1 | -20 | 20 |" in report_markdown(report, [], name="x")
    assert b"marking" not in b"".join(summary_csv(report))
    assert b"on_error" not in b"".join(report_csv(report))


def test_marks_can_be_left_out() -> None:
    trace, _ = simulate_stream(listing_stream(STEADY), MACHINE)
    assert trace is not None
    report = make_report(trace, MACHINE, marking=False)
    assert (report.marks, report.totals["marking"]) == (None, None)
    assert b', "marks": null' in b"".join(report_json(report, [], summary=False))


def test_lines_count_in_their_own_file() -> None:
    trace, _ = simulate_stream(listing_stream(STEADY), MACHINE)
    assert trace is not None
    report = make_report(trace, MACHINE, (("a.job", 0), ("b.job", 4)))
    assert (marks_in(report)["line"].tolist(), marks_in(report)["file"].tolist()) == ([2], [1])


def test_many_marks_at_once() -> None:
    """A thousand marks, each as the first: every mark has its own pieces, bins and corners."""
    one = ON + move(1000, 0, 0) + move(1000, 1000, 0) + OFF + move(0, 0, 0)
    for model in ("delay", "first-order"):
        ran = run_listing(HEAD + one * 1000 + START, lagging(model))
        for name, column in marks_in(ran.report).items():
            if name not in ("line", "start_ms"):
                assert column[1:] == pytest.approx(column[1], rel=1e-6, abs=1e-6), name


def test_a_laser_left_on_has_no_off() -> None:
    trace, _ = simulate_stream(listing_stream(HEAD + ON + move(10000, 0, 0) + START), MACHINE)
    assert trace is not None
    assert trace.channels[0].emission.off_event.tolist() == [-1]
    assert marks_in(make_report(trace, MACHINE))["off_miss_um"].tolist() == [0]


def test_a_mark_that_never_comes_to_s_is_outside_once() -> None:
    """Emission for 0.1 ms, 20 um before S: all of it is before S, and none of it beyond E."""
    text = STEADY.replace(move(20000, 0), move(10010, 0))
    found = marks(run_listing(text, lagging("delay")))
    assert found["outside_power_ms"] == pytest.approx(50 * 0.1)


def test_the_error_of_emission_carried_into_a_stage_is_along_its_first_motion() -> None:
    text = "GT_SetLevelDelay(0,1000,0)\n" + HEAD + move(10000, 0, 0) + START + "GT_CrdStatus(1,run,segment,0)\n"
    text += HEAD.splitlines(keepends=True)[2] + ON + "GT_BufDelay(1,1,0)\n" + move(10000, 10000, 0) + OFF + START
    found = marks(run_listing("GT_SetLevelDelay(0,2000,0)\n" + text.partition("\n")[2]))
    # On 2 ms after a dwell of 1 ms: 1 ms at 10 pulse/ms2 along Y.
    assert found["on_error_um"] == pytest.approx(5)


def test_a_mark_entirely_before_s_and_beyond_e_is_outside_once() -> None:
    """There and back inside the lag: at 9980..9995 um the beam is before S = 10000, and beyond E = 10005 (come at from
    above)."""
    text = STEADY.replace(move(20000, 0), move(10010, 0) + move(10005, 0))
    found = marks(run_listing(text, lagging("delay")))
    assert (found["on_error_um"], found["off_error_um"]) == pytest.approx((-20, 10))
    assert found["outside_power_ms"] == pytest.approx(50 * 0.15)


@pytest.mark.parametrize(("degrees", "misses"), [(0.95, [False]), (1.05, [True])])
def test_a_corner_turns_by_more_than_a_degree(degrees: float, misses: list[bool]) -> None:
    up = 100_000 * math.tan(math.radians(degrees))
    text = STEADY.replace(move(20000, 0), move(110_000, 0) + move(210_000, round(up)))
    assert (~np.isnan(marks_in(run_listing(text).report)["corner_miss_um"])).tolist() == misses


LAGGED = "GT_SetLevelDelay(200,200,0)\n"
"""Emission as late as the beam of a scanner that is late by 200 us."""


@pytest.mark.parametrize(
    "path",
    [move(10000, 0, 0), f"GT_ArcXYC(1,0,0,0,5000,1,100,{ACC},0,0)\n", "GT_BufDelay(1,3,0)\n" + move(700, 300, 0)],
)
def test_emission_as_late_as_the_beam_is_emission_without_a_lag(path: str) -> None:
    """The parts of the path move with the beam, past the end of the stage too: every figure is the same."""
    text = HEAD + ON + path + OFF + START
    plain, late = marks(run_listing(text)), marks(run_listing(LAGGED + text, lagging("delay")))
    for name in MARKING_WORDS:
        assert late[name] == pytest.approx(plain[name], rel=1e-9, abs=1e-9, nan_ok=True), name


@pytest.mark.parametrize("model", ["first-order", "second-order"])
def test_where_a_beam_cuts_a_corner_it_burns_more(model: str) -> None:
    """In Y 1 - f of the speed while f is left in X: least v/sqrt(2) at f = 1/2, for either filter."""
    slow = replace(MACHINE, scanner=Scanner(model=ScannerModel(model), tracking_error_us=10_000))
    text = HEAD + move(100_000, 0) + ON + move(110_000, 0) + move(110_000, 50_000) + OFF + move(110_000, 90_000, 0)
    assert marks(run_listing(text + START, slow))["power_per_mm_peak"] == pytest.approx(500 * math.sqrt(2), rel=3e-3)


def test_the_error_of_an_off_before_the_first_motion_of_a_stage_is_along_that() -> None:
    """Not along X, in which the stage before ended: off 1 ms after a dwell, a*t^2/2 along Y."""
    power = HEAD.splitlines(keepends=True)[2]
    text = "GT_SetLevelDelay(1000,0,0)\n" + HEAD + move(10000, 0, 0) + START + "GT_CrdStatus(1,run,segment,0)\n"
    text += power + ON + "GT_BufDelay(1,1,0)\n" + OFF + move(10000, 10000, 0) + START
    assert marks(run_listing(text))["off_error_um"] == pytest.approx(5)


def test_roots_of_parabolas() -> None:
    """(s - 1/4)*(s + 2) bends up, (s - 1/4)*(2 - s) bends down, s - 1/4 is straight."""
    share = np.array([[0.0], [0.5], [1.0]])
    values = (share - 0.25) * np.concatenate([share + 2, 2 - share, np.ones_like(share)], axis=1)
    assert _root(values) == pytest.approx([0.25, 0.25, 0.25], rel=1e-12)


def test_the_worst_corner_counts() -> None:
    text = HEAD + move(10000, 0) + ON + move(20000, 0) + move(30000, 2000) + move(28000, 12000) + OFF
    found = marks(run_listing(text + move(26000, 22000, 0) + START, lagging("first-order")))
    # The turn by 11 degrees misses by far less than that by 90.
    assert found["corner_miss_um"] == pytest.approx(corner_miss(LAG_UM, 1), rel=1e-2)


def test_a_corner_miss_on_unequal_axes_is_in_mm() -> None:
    """20 um of lag in X, 10 um in Y."""
    machine = lagging("first-order", replace(MACHINE, pulses_per_mm=(1000.0, 2000.0)))
    text = HEAD + move(5000, 0) + ON + move(10000, 0) + move(10000, 10000) + OFF + move(10000, 15000, 0) + START
    time = np.linspace(0, 8, 800_001)
    least = float(np.hypot(20 * np.exp(-time), 10 * (time - 1 + np.exp(-time))).min())
    assert marks(run_listing(text, machine))["corner_miss_um"] == pytest.approx(least, rel=2e-3)
