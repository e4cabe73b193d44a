"""The shutdown: laser off first, then the motion stopped."""

from __future__ import annotations

import time

import numpy as np
import pytest
from support.controller import Fault, needs_controller
from support.hardware import (
    END_2,
    EVERYTHING,
    LONG,
    MARK_FIRST,
    STATES,
    SYSTEM_2,
    Bench,
    RequestAt,
    fresh,
    listed,
    made_calls,
    zigzag,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Interlock, Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.driver import shutdown
from gusjob.controllers.gus.driver.requirements import Outputs
from gusjob.controllers.gus.driver.shutdown import Shutdown

pytestmark = needs_controller


@pytest.mark.parametrize("ask", ["smooth", "abrupt"])
@pytest.mark.parametrize("system", [1, 2])
def test_stop_has_system_and_axes_and_follows_laser_off(gus: Bench, ask: str, system: int) -> None:
    fresh(gus, poll_us=3_000)
    if system == 2:
        stream = listed(SYSTEM_2 + zigzag(200) + END_2)
    else:
        stream = stream_of(
            MARK + "VEL 50\nLASER POWER 40\nLASER ON\nREPEAT 200 AS i\nLINE X (i % 2) Y (i / 100)\nEND\nLASER OFF\n"
        )
    ran = gus.run(stream, gus.machine(Machine()), tick=RequestAt(5, ask))
    assert ran.codes == ["GJ911"]
    calls = made_calls(gus)
    stop = next(i for i, call in enumerate(calls) if call.startswith("GT_Stop"))
    # Both systems, whichever it is: bits 8 and 9; abrupt, with the axes 1 and 2.
    assert calls[stop] == f"GT_Stop({0x300},{0 if ask == 'smooth' else 0x300 | 3})"
    # Off, where it was then, only then the stop; and off again behind it.
    last = max(i for i, call in enumerate(calls[:stop]) if not call.startswith(("GT_GetCrdPos", "GT_CrdSpace")))
    assert calls[last].startswith("GT_SetHSIOOpt(0")
    assert any(call.startswith("GT_SetHSIOOpt(0") for call in calls[stop + 1 :])
    assert calls[-1] == "GT_Close()"
    assert gus.controller.state().moving == 0
    assert len(gus.controller.rows()) < 200


def test_all_systems_are_stopped_and_waited_for(gus: Bench) -> None:
    """A listing that uses both: the one that moves is not the last one."""
    fresh(gus, poll_us=1_000)
    first = (SYSTEM_2 + zigzag(100) + END_2).replace("(2,", "(1,")
    first = first.replace("GT_CrdStart(1,2)", "GT_CrdStart(1,1)")
    second = "GT_SetCrdPrm(2,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(2,1)\n"
    stream = listed(first + second + zigzag(3) + "GT_CrdStart(2,2)\n")
    ran = gus.run(stream, gus.machine(Machine()), tick=RequestAt(5, "smooth"))
    assert ran.codes == ["GJ911"]
    assert [call for call in made_calls(gus) if call.startswith("GT_Stop")] == ["GT_Stop(768,0)"]
    assert gus.controller.state().moving == 0


@pytest.mark.parametrize("how", ["twice", "late"])
def test_a_smooth_stop_that_takes_long_becomes_an_abrupt_one(
    gus: Bench, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """By itself, or as soon as the user insists."""
    monkeypatch.setattr(shutdown, "_SMOOTH_S", 0.05 if how == "late" else 20.0)
    fresh(gus, poll_us=3_000)

    def tick(control: Control) -> None:
        if control.status.row >= 10 and not control.stop:
            gus.controller.option("stuck", 1)
            control.request_stop("test")
        elif control.stop == 1 and control.status.phase is Phase.STOPPING and how == "twice":
            control.request_stop("test")
        if time.perf_counter() - began_s > 5:  # It would never end.
            gus.controller.option("stuck", 0)

    began_s = time.perf_counter()
    assert gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick).codes == ["GJ911"]
    stops = [call for call in made_calls(gus) if call.startswith("GT_Stop")]
    assert stops == ["GT_Stop(768,0)", "GT_Stop(768,771)"]


def test_every_channel_that_is_on_is_switched_off(gus: Bench) -> None:
    stream, machine = stream_of(STATES), gus.machine(Machine())
    fresh(gus, poll_us=3_000)
    row, lit = int(np.flatnonzero(stream.buffered.kind == Buffered.ARC_CENTRE)[0]) - 1, list[tuple[bool, bool]]()

    def tick(control: Control) -> None:
        if control.status.phase is Phase.RUNNING and control.status.row >= row and not control.stop:
            lit.append(gus.controller.state().switched_on)
            control.request_stop("test", abrupt=True)

    assert gus.run(stream, machine, tick=tick).codes == ["GJ911"]
    assert lit == [(True, True)]
    state = gus.controller.state()
    assert (state.switched_on, state.emitting, state.moving) == ((False, False), (False, False), 0)


def test_after_a_failure_the_stop_is_abrupt_and_the_controller_closed(gus: Bench) -> None:
    machine = gus.machine(Machine(), interlock=Interlock(di_type=4, input=0, value=1))
    fresh(gus, poll_us=3_000, di=1)
    gus.controller.fault(Fault.DI, "GT_CrdStatus", 12, 1, 0)
    assert gus.run(stream_of(LONG), machine).codes == ["GJ910"]
    calls = made_calls(gus)
    assert "GT_Stop(768,771)" in calls
    assert "GT_Stop(768,0)" not in calls
    assert calls[-1] == "GT_Close()"


def test_unknown_motion_is_reported(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutdown, "_REST_S", 0.1)
    fresh(gus, poll_us=3_000)
    gus.controller.fault(Fault.RETURN, "GT_CrdStatus", 12, -1, 7)
    ran = gus.run(stream_of(LONG), gus.machine(Machine()))
    assert "GJ913" in ran.codes
    assert not ran.session.is_off
    assert "GT_Reset()" in made_calls(gus)


def test_a_stop_that_is_refused_is_tried_again(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)
    gus.controller.fault(Fault.RETURN, "GT_Stop", 1, 2, 7)
    assert gus.run(stream_of(LONG), gus.machine(Machine()), tick=RequestAt(10, "smooth")).codes == ["GJ911"]
    stops = [call for call in made_calls(gus) if call.startswith("GT_Stop")]
    assert stops == ["GT_Stop(768,0)", "GT_Stop(768,771)", "GT_Stop(768,771)"]
    assert gus.controller.state().moving == 0


def test_a_laser_that_can_not_be_switched_off_is_reported(gus: Bench) -> None:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 3, -1, 7)
    gus.controller.fault(Fault.RETURN, "GT_BufDelay", 1, -1, 7)
    ran = gus.run(stream, machine)
    assert ran.codes[0] == "GJ912"
    names = gus.controller.names()
    # Without power, and in the end reset: then it is dark all the same.
    assert names.index("GT_LaserPrfCmd", names.index("GT_BufDelay")) < names.index("GT_Reset")
    assert not any(gus.controller.state().emitting)


def test_a_laser_that_does_not_go_off_stops_the_motion_at_once(gus: Bench) -> None:
    """And takes its power, before it is tried again for as long as the link is given."""
    machine = gus.machine(Machine(), link_patience_s=1.0)

    def tick(control: Control) -> None:
        if control.status.x_pulse > 500 and not control.stop:
            gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 1, 6, -7)
            control.request_stop("test")

    gus.controller.option("poll_us", 3_000)
    text = MARK + "VEL 10\nLASER POWER 9\nLASER ON\nLINE X 100\nLASER OFF\n"
    ran = gus.run(stream_of(text), machine, tick=tick)
    assert ran.codes == ["GJ911"]
    names = gus.controller.names()
    behind = names[len(names) - 1 - names[::-1].index("GT_CrdStart") :]
    first_off = behind.index("GT_SetHSIOOpt")
    assert "GT_LaserPrfCmd" in behind[first_off : first_off + 4]
    assert "GT_Stop" in behind[first_off : first_off + 6]


def test_the_first_channel_that_goes_off_gives_the_position(gus: Bench) -> None:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    ran = gus.run(stream, machine)
    gus.controller.library.GT_Open(0, 1)
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 2, 2, -7)
    ran.session.link.take_over()
    shutdown = Shutdown(ran.session.link, Outputs(channels=(0, 1), crds=(1,), axes=(1, 2)), 1.0)
    ran.session.link.journal.write = len
    began = ran.session.link.journal.now_s() + ran.session.link.journal.start_s
    assert shutdown.laser_off() == []
    assert shutdown.off_since_s - began < 0.015  # Channel 1 slept twice for 20 ms after it.


def test_a_channel_that_refuses_is_tried_three_times(gus: Bench) -> None:
    ran = gus.run(stream_of(MARK_FIRST), gus.machine(Machine()))
    gus.controller.library.GT_Open(0, 1)
    ran.session.link.take_over()
    ran.session.link.journal.write = len
    shutdown = Shutdown(ran.session.link, Outputs(channels=(0, 1), crds=(1,), axes=(1, 2)), 1.0)
    for refusals, channels in ((4, []), (5, [0]), (6, [0, 1])):
        gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 1, refusals, 7)
        assert [diagnostic.fields["channel"] for diagnostic in shutdown.laser_off()] == channels
