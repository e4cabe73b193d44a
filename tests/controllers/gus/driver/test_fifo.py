"""Filling the FIFO: every call once and in order, as compiled; what is found wrong while it runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.controller import GTS, GTS_MULTI, GUS, Fault, Row, needs_controller
from support.hardware import (
    END_2,
    EVERYTHING,
    LONG_WITH_DWELL,
    SYSTEM_2,
    Bench,
    fresh,
    listed,
    made_calls,
    recorded,
    zigzag,
)
from support.tools import MARK, ROOT, stream_in, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import HOST_CALLS, SIGNATURES, Stream
from gusjob.controllers.gus.driver import fifo
from gusjob.controllers.gus.listing import listing
from gusjob.controllers.gus.model import simulate_stream
from gusjob.pipeline import examine_file

pytestmark = needs_controller


JOBS = [path for path in sorted((ROOT / "jobs").rglob("*.job")) if "shared" not in path.parts]


BEGIN = (
    "GT_SetLaserDisMode(0,0,{0,0,0,0},{1,1,1,1}", "GT_DisFPK(", "GT_SetLevelDelay(0,0,", "GT_SetWaitPulse(0,",
    "GT_SetPreVltg(0,0,",
)  # fmt: skip
"""What makes the lasers as a job takes them for granted."""


HOST = {*HOST_CALLS, "GT_CrdStatus"}


def plain(call: str) -> str:
    """A call with its numbers in one form, -0 as 0."""
    return re.sub(r"(?<![A-Za-z_])-?\d[\d.]*(e[+-]?\d+)?", lambda m: repr(float(m[0]) + 0.0), call)


def job_calls(calls: list[tuple[int, str]]) -> list[str]:
    """The calls of the job among those that were made and taken; but for those that only turn the light off."""
    # Before the axes are on the controller is set up, and behind that the lasers are as a job takes them for granted.
    began = max((i for i, (_, call) in enumerate(calls) if call.startswith("GT_AxisOn")), default=0)
    began += 1 + sum(call.startswith(BEGIN) for _, call in calls[began : began + 11])
    mine = [call for code, call in calls[began:] if code == 0 and call.partition("(")[0] not in HOST]
    return [plain(call) for call in mine if not call.startswith(("GT_SetHSIOOpt(0", "GT_CrdStart"))]


def of_file(path: Path) -> tuple[Stream, Machine]:
    loaded = examine_file(path, None)
    stream = stream_in(loaded)
    assert stream is not None, loaded.diagnostics
    return stream, loaded.machine


@pytest.mark.parametrize("path", JOBS, ids=lambda p: p.stem)
def test_a_job_is_sent_as_compiled_and_run_as_simulated(gus: Bench, path: Path) -> None:
    stream, machine = of_file(path)
    ran = gus.run(stream, gus.machine(machine))
    assert ran.faults == []
    wanted = [plain(line) for line in "".join(listing(stream)).splitlines()]
    wanted = [c for c in wanted if not c.startswith(("GT_CrdStart", "GT_CrdStatus", "GT_SetHSIOOpt(0"))]
    assert job_calls(gus.controller.calls()) == wanted
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    rows, period_ms = gus.controller.rows(), machine.period_us / 1000
    assert len(rows) == len(trace)
    if not len(rows):
        return
    assert np.abs(rows[:, Row.START_MS] - trace.schedule.times_ms[:-1]).max() < period_ms / 1000
    assert np.abs(rows[:, Row.DURATION_MS] - trace.schedule.duration_ms).max() < period_ms / 1000
    assert np.abs(rows[:, Row.X1] - trace.segments.x1).max() < 1e-6
    assert np.abs(rows[:, Row.Y1] - trace.segments.y1).max() < 1e-6
    for channel in trace.channels:
        lit_ms = rows[:, Row.EMISSION0_MS + channel.channel]
        energy = rows[:, Row.POWER0_MS + channel.channel]
        assert np.abs(lit_ms - channel.emitted.emission_ms).max() < period_ms / 1000
        assert energy == pytest.approx(channel.emitted.power_ms, rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("abi", [GUS, GTS, GTS_MULTI])
@pytest.mark.parametrize(("slots", "counts_all", "freed_early"), [(4096, 1, 0), (7, 1, 0), (7, 0, 1), (4096, 0, 1)])
def test_every_abi_and_fifo(
    benches: dict[int, Bench], monkeypatch: pytest.MonkeyPatch, abi: int, slots: int, counts_all: int, freed_early: int
) -> None:
    monkeypatch.setattr(fifo, "POLL_S", 0.0005)
    made, stream = benches[abi], stream_of(EVERYTHING)
    fresh(made, slots=slots, segment_counts_all=counts_all, slot_freed_at_start=freed_early)
    made.controller.option("poll_us", 5_000)
    assert made.run(stream, made.machine(Machine())).faults == []
    received = job_calls(made.controller.calls())
    wanted = [plain(line) for line in "".join(listing(stream)).splitlines()]
    if abi != GUS:  # Their own spelling of the manual's calls.
        wanted = [c.replace("GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio") for c in wanted]
        wanted = [re.sub(r"^(GT_LaserPowerMode\(.*)\)$", r"\1,0.0)", c) for c in wanted]
    assert received == [c for c in wanted if not c.startswith(("GT_CrdSta", "GT_SetHSIOOpt(0"))]
    state = made.controller.state()
    assert (state.x, state.y, state.queued, state.open) == (1000, 2000, 0, False)


def test_buffered_calls_are_sent_once_and_in_order_over_a_full_fifo(gus: Bench) -> None:
    stream = stream_of(MARK + "LASER POWER 30\nLASER ON\nREPEAT 600 AS i\nLINE X (i % 7) Y (i % 2)\nEND\nLASER OFF\n")
    fresh(gus, slots=64)
    gus.controller.option("poll_us", 8_000)
    assert gus.run(stream, gus.machine(Machine())).faults == []
    refused = [call for code, call in gus.controller.calls() if code == 1]
    assert refused == []  # GT_CrdSpace tells how many are taken.
    wanted = [plain(c) for c in "".join(listing(stream)).splitlines() if c.startswith("GT_LnXY")]
    assert [c for c in job_calls(gus.controller.calls()) if c.startswith("GT_LnXY")] == wanted


@pytest.mark.parametrize("code", [1])
def test_a_call_refused_as_if_the_fifo_were_full_is_sent_again(gus: Bench, code: int) -> None:
    stream = stream_of(EVERYTHING)
    buffered = [name for name in SIGNATURES if SIGNATURES[name].buffered is not None]
    for name in buffered:
        for nth in (1, 2, 3):
            fresh(gus)
            gus.controller.fault(Fault.RETURN, name, nth, 2, code)
            assert gus.run(stream, gus.machine(Machine())).faults == []
            wanted = [plain(c) for c in "".join(listing(stream)).splitlines()]
            wanted = [c for c in wanted if not c.startswith(("GT_CrdSta", "GT_SetHSIOOpt(0"))]
            assert job_calls(gus.controller.calls()) == wanted, (name, nth)


def test_the_other_coordinate_system_and_fifo(gus: Bench) -> None:
    """Longer than the FIFO: it is started early, by a call that stands in no job."""
    fresh(gus, slots=8, poll_us=5_000)
    ran = gus.run(listed(SYSTEM_2 + zigzag(30) + END_2), gus.machine(Machine()))
    assert ran.faults == []
    assert [c for c in made_calls(gus) if c.startswith("GT_CrdStart")] == ["GT_CrdStart(2,2)"]
    assert len(gus.controller.rows()) == 30


@pytest.mark.parametrize(("option", "code"), [("deaf", "GJ908"), ("stuck", "GJ908")])
def test_motion_that_does_not_go_on(gus: Bench, monkeypatch: pytest.MonkeyPatch, option: str, code: str) -> None:
    monkeypatch.setattr(fifo, "START_S", 0.05)
    monkeypatch.setattr(fifo, "STILL_S", 0.05)
    gus.controller.option(option, 1)
    ran = gus.run(stream_of(MARK + "LASER POWER 20\nLASER ON\nLINE X 5\nLASER OFF\n"), gus.machine(Machine()))
    assert code in ran.codes
    assert not any(gus.controller.state().emitting)


def test_a_long_dwell_counts_as_progress(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fifo, "STILL_S", 0.02)
    fresh(gus, poll_us=5_000)
    assert gus.run(stream_of(MARK + "LINE X 1\nDWELL 2000\nLINE X 0\n"), gus.machine(Machine())).faults == []


def test_a_fifo_that_runs_dry_before_all_is_sent_is_seen_at_once(gus: Bench) -> None:
    """Not when the next call finds its way into a FIFO that stands still."""
    fresh(gus, slots=16)
    gus.controller.options(poll_us=5_000)
    gus.controller.fault(Fault.DRY, "GT_CrdStatus", 12)
    ran = gus.run(stream_of(LONG_WITH_DWELL), gus.machine(Machine()))
    assert ran.codes == ["GJ906"]
    names = gus.controller.names()
    dry = [i for i, name in enumerate(names) if name == "GT_CrdStatus"][11]
    assert "GT_LnXY" not in names[dry:]


def test_a_refused_call_is_named_with_its_line_and_recorded(gus: Bench) -> None:
    lines = EVERYTHING.splitlines()
    for name, nth, text in (
        ("GT_LnXY", 3, "LINE X 5 Y 3"), ("GT_ArcXYR", 1, "ARC CW X 8 Y 3 R 4"), ("GT_BufDelay", 1, "DWELL 3"),
        ("GT_LaserPrfCmd", 1, "LASER POWER 25 NOW"), ("GT_BufLaserPrfFollow", 1, "LASER FOLLOW MIN 5 MAX 60 AT 100"),
    ):  # fmt: skip
        fresh(gus)
        gus.controller.fault(Fault.RETURN, name, nth, 1, 7)
        ran = gus.run(stream_of(EVERYTHING), gus.machine(Machine()))
        assert ran.codes == ["GJ904"], name
        assert lines[ran.faults[0].span.line - 1] == text
        refused = [line for line in recorded(ran) if line.get("code") == 7]
        assert [(line["call"], lines[line["line"] - 1]) for line in refused] == [(name, text)]


def test_a_call_that_stays_refused_ends_the_run(gus: Bench) -> None:
    """As if the FIFO were full, though it has room."""
    gus.controller.fault(Fault.RETURN, "GT_LnXY", 2, -1, 1)
    ran = gus.run(stream_of(EVERYTHING), gus.machine(Machine()))
    assert ran.codes == ["GJ904"]
    assert gus.controller.names().count("GT_LnXY") == 6


def test_a_fifo_without_room_is_a_wrong_library(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_CrdSpace", 1, 1, 0)  # It finds 0.
    ran = gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ903"]


def test_a_fifo_that_a_listing_does_not_clear_is_empty_all_the_same(gus: Bench) -> None:
    """An earlier run, which was stopped, left calls in it: they must not be run as part of the listing."""
    fresh(gus, poll_us=3_000)
    head = SYSTEM_2.replace("GT_CrdClear(2,1)\n", "")
    gus.controller.library.GT_Open(0, 1)
    machine = gus.machine(Machine())
    gus.controller.fault(Fault.RETURN, "GT_CrdStart", 1, 1, 1)
    left = gus.run(listed(SYSTEM_2 + zigzag(20) + END_2), machine)
    assert left.codes == ["GJ904"]
    assert gus.controller.state().queued > 20
    gus.controller.clear_faults()
    ran = gus.run(listed(head + "GT_LnXY(2,0,700,50,10,0,1)\n" + END_2), machine)
    assert ran.faults == []
    assert gus.controller.rows()[:, Row.Y1].tolist() == [700]
