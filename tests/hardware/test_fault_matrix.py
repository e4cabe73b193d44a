"""Every call fails in every way: afterwards the laser is off and nothing moves."""

from __future__ import annotations

import re
import time

import pytest
from support.controller import Fault, Row, needs_controller
from support.hardware import (
    EVERYTHING,
    Bench,
    continues,
    fresh,
    is_safe,
    laser_off_at,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine

pytestmark = needs_controller


CODES = (1, 2, 3, 7, 8, -1, -6, -7, -8)


POLLS = ("GT_CrdStatus", "GT_CrdSpace", "GT_GetCrdPos")


@pytest.mark.slow
def test_fault_matrix_each_call_and_each_code(gus: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """Each call of a job fails once with each code; then the run is gone on with, and the path is whole."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    whole, names = gus.controller.rows(), gus.controller.names()
    cases = failed = 0
    for nth, name in enumerate(names, 1):
        # One poll is like another: the first few with every code, the others with two.
        for code in CODES if name not in POLLS or names[:nth].count(name) <= 4 else (1, -7):
            for what in (Fault.RETURN, Fault.AFTER) if code == -7 else (Fault.RETURN,):
                fresh(gus)
                gus.controller.fault(what, nth=nth, value=code)
                ran, case = gus.run(stream, machine), f"{what.name} {code} at call {nth}, {name}"
                cases += 1
                assert is_safe(gus), case
                if not ran.faults:
                    rows = gus.controller.rows()
                    assert rows[:, : Row.POWER1_MS] == pytest.approx(whole[:, : Row.POWER1_MS]), case
                    continue
                failed += 1
                assert {fault.rule.code for fault in ran.faults} <= {"GJ903", "GJ904"}, case
                # Looks come by time: the call may be another one than in the run without faults.
                really = gus.controller.names()[nth - 1]
                assert any(really in fault.message for fault in ran.faults), (case, really)
                assert all(1 <= fault.span.line <= len(EVERYTHING.splitlines()) for fault in ran.faults), case
                done = gus.controller.rows()
                broken = laser_off_at(done, gus.controller.edges())
                again, place = gus.resumed(stream, machine, ran.journal)
                assert again.faults == [], (case, again.faults)
                assert is_safe(gus), case
                assert place is not None
                if place.row < len(stream.buffered):
                    assert not isinstance(continues(whole, gus.controller.rows()[len(done) :], broken), str), case
    with capsys.disabled():
        print(f"\nfault matrix: {cases} cases, {failed} failed safely and were resumed, {cases - failed} did no harm")
    assert cases > 800


@pytest.mark.slow
def test_fault_matrix_link_lost(gus: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """The link dies at each point: for a while, then the light goes off as soon as it is back; or for ever."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine(), link_patience_s=0.08)
    assert gus.run(stream, machine).faults == []
    names, cases = gus.controller.names(), 0
    for nth in range(3, len(names) + 1):
        for count in (3, -1) if nth % 8 == 0 else (3,):
            fresh(gus)
            gus.controller.fault(Fault.RETURN, nth=nth, count=count, value=-7)
            cases += 1
            ran, case = gus.run(stream, machine), f"{count} calls from {nth}, {names[nth - 1]}"
            said, made = " ".join(fault.message for fault in ran.faults), gus.controller.names()
            if count > 0:
                assert is_safe(gus), case
                assert "MAY BE ON" not in said, case
            elif len(made) < nth or made[nth - 1] == "GT_Close":
                assert is_safe(gus), case  # Looks come by time: this run was done with fewer, or with its last call.
            else:
                # Nothing can be switched any more: that is said, first of all.
                assert ran.codes[0] == "GJ912", case
                assert "THE LASER OF CHANNEL 0 MAY BE ON" in said, case
                assert "emergency stop" in said, case
            assert "cable" in said or not ran.faults, case
    with capsys.disabled():
        print(f"\nlink lost: {cases} cases")


@pytest.mark.slow
def test_fault_matrix_hang(gus: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    """Each call hangs: another thread turns the light off, and the hung one makes no call any more."""
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine(), call_timeout_s=0.03)
    assert gus.run(stream, machine).faults == []
    names = gus.controller.names()
    for nth in range(1, len(names) + 1):
        if names[nth - 1] in ("GT_Open", "GT_Close"):
            continue  # Ten times as long.
        fresh(gus)
        gus.controller.fault(Fault.HANG, nth=nth)
        ran = gus.run(stream, machine)
        case = f"call {nth}, {names[nth - 1]}"
        if not ran.faults and len(gus.controller.calls()) < nth:
            continue  # Looks come by time: this run was done with fewer.
        assert "GJ905" in ran.codes, case
        assert re.search(r"(GT_\w+|a buffered call) has not returned", " ".join(f.message for f in ran.faults)), case
        if nth > 2:  # Before, nobody knows what the library is, and nothing was switched on.
            assert is_safe(gus), case
        made = len(gus.controller.calls())
        gus.controller.release()
        time.sleep(0.002)
        assert len(gus.controller.calls()) <= made + 1, case
    with capsys.disabled():
        print(f"\nhang: {len(names) - 2} cases")


@pytest.mark.slow
@pytest.mark.parametrize(("what", "codes"), [(Fault.HALT, {"GJ907"}), (Fault.DRY, {"GJ906", "GJ907"})])
def test_fault_matrix_motion_stopped_by_something_else(gus: Bench, what: Fault, codes: set[str]) -> None:
    """An emergency stop at each point, and a FIFO that ran dry: noticed, dark, and gone on with."""
    text = MARK + "LASER POWER 40\nLASER ON\nREPEAT 40 AS i\nLINE X (i % 2) Y (i / 10)\nEND\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, slots=16)
    gus.controller.option("poll_us", 5_000)
    assert gus.run(stream, machine).faults == []
    whole, calls, noticed = gus.controller.rows(), len(gus.controller.calls()), 0
    for nth in range(1, calls + 1, 11):
        fresh(gus, slots=16)
        gus.controller.option("poll_us", 5_000)
        gus.controller.fault(what, nth=nth)
        ran = gus.run(stream, machine)
        assert is_safe(gus), nth
        if not ran.faults:
            continue
        assert set(ran.codes) <= codes, (nth, ran.faults)
        noticed += 1
        done = gus.controller.rows()
        broken = laser_off_at(done, gus.controller.edges()[:0])
        again, _ = gus.resumed(stream, machine, ran.journal)
        assert again.faults == [], nth
        found = continues(whole, gus.controller.rows()[len(done) :], broken)
        assert not isinstance(found, str), (nth, found)
    assert noticed > 20
