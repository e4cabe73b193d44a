"""What planted faults (mutants) showed to be untested: runs on the virtual controller, and the parts behind them."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from support.controller import GUS, Fault, Row, needs_controller
from support.hardware import EVERYTHING, Bench, Ran, bench
from support.tools import MARK, stream_of

from gusjob.cli.hardware import fingerprint
from gusjob.cli.run_command import command
from gusjob.config.machine import Interlock, Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.driver import fifo, session
from gusjob.controllers.gus.driver import shutdown as way_out
from gusjob.controllers.gus.driver.session import outputs_of
from gusjob.controllers.gus.geometry import call_segments
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.place import Place, Route
from gusjob.controllers.gus.remainder import rest
from gusjob.frontend import check_text, read_listing
from gusjob.hardware.forecast import forecast
from gusjob.hardware.runner import signals
from gusjob.hardware.sent import sent_calls

pytestmark = needs_controller


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return bench(tmp_path_factory.mktemp("controller"), GUS)


@pytest.fixture
def gus(made: Bench, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A GUS in virtual time, switched off and on again."""
    monkeypatch.setattr(fifo, "POLL_S", 0.0005)
    monkeypatch.setattr(session, "_PAUSE_S", 0.002)
    fresh(made)
    yield made
    made.controller.reset()


def fresh(made: Bench, **options: float) -> None:
    made.controller.reset()
    made.controller.options(**({"poll_us": 40_000, "call_us": 5} | options))


def listed(text: str) -> Stream:
    """The calls of a listing."""
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    stream, faults = read_listing(source)
    assert faults == []
    return stream


def recorded(ran: Ran) -> list[dict[str, Any]]:
    return [json.loads(line) for line in ran.journal.read_text(encoding="utf-8").splitlines()]


def made_calls(gus: Bench) -> list[str]:
    return [call for _, call in gus.controller.calls()]


SYSTEM_2 = """GT_SetAxisMode(7,1)
GT_LaserPowerMode(0,100,0,0)
GT_LaserOutFrq(10,0)
GT_SetCrdPrm(2,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})
GT_CrdClear(2,1)
GT_BufLaserPrfCmd(2,40,1,0)
GT_BufLaserOn(2,1,0)
"""
"""The head of a listing in coordinate system 2 and FIFO 1."""


def zigzag(count: int, vel: float = 50.0) -> str:
    return "".join(f"GT_LnXY(2,{1000 * (i % 2)},{i},{vel},10,0,1)\n" for i in range(count))


END_2 = "GT_BufLaserOff(2,1,0)\nGT_CrdStart(2,2)\nGT_CrdStatus(2,run,segment,1)\n"


class When:
    """Does something once a run has come to a row, then something in the pause, once."""

    def __init__(self, row: int, ask: str) -> None:
        self.row, self.ask, self.asked = row, ask, False

    def __call__(self, control: Control) -> None:
        if not self.asked and control.view.phase is Phase.RUNNING and control.view.row >= self.row:
            self.asked = True
            control.ask_pause() if self.ask == "pause" else control.ask_stop("test", abrupt=self.ask == "abrupt")


# What is sent and asked.


def test_the_other_coordinate_system_and_fifo(gus: Bench) -> None:
    """Longer than the FIFO: it is started early, by a call that stands in no job."""
    fresh(gus, slots=8, poll_us=5_000)
    ran = gus.run(listed(SYSTEM_2 + zigzag(30) + END_2), gus.machine(Machine()))
    assert ran.faults == []
    assert [c for c in made_calls(gus) if c.startswith("GT_CrdStart")] == ["GT_CrdStart(2,2)"]
    assert len(gus.controller.rows()) == 30


@pytest.mark.parametrize("ask", ["smooth", "abrupt"])
@pytest.mark.parametrize("system", [1, 2])
def test_stop_names_system_and_axes_and_comes_behind_light_off(gus: Bench, ask: str, system: int) -> None:
    fresh(gus, poll_us=3_000)
    if system == 2:
        stream = listed(SYSTEM_2 + zigzag(200) + END_2)
    else:
        stream = stream_of(
            MARK + "VEL 50\nLASER POWER 40\nLASER ON\nREPEAT 200 AS i\nLINE X (i % 2) Y (i / 100)\nEND\nLASER OFF\n"
        )
    ran = gus.run(stream, gus.machine(Machine()), tick=When(5, ask))
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


def test_the_axes_are_those_of_the_profile(gus: Bench) -> None:
    stream = listed(SYSTEM_2.replace("{1,2,0,0,", "{0,0,1,2,") + zigzag(2) + END_2)
    outputs = outputs_of(stream)
    assert (outputs.axes, outputs.crds, outputs.channels) == ((3, 4), (2,), (0,))


def test_the_configuration_is_loaded_before_the_axes_are_on(gus: Bench) -> None:
    machine = gus.machine(Machine(), configuration="field.cfg", axes_off_after=True)
    assert gus.run(stream_of(MARK + "LINE X 1\n"), machine).faults == []
    calls = made_calls(gus)
    assert [c for c in calls if c.startswith(("GT_LoadConfig", "GT_Axis", "GT_Close", "GT_SetCrdPrm"))][:3] == [
        next(c for c in calls if c.startswith("GT_LoadConfig") and "field.cfg" in c), "GT_AxisOn(1)", "GT_AxisOn(2)",
    ]  # fmt: skip
    assert calls[-3:] == ["GT_AxisOff(1)", "GT_AxisOff(2)", "GT_Close()"]


def test_a_long_dwell_is_no_standstill(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fifo, "STILL_S", 0.02)
    fresh(gus, poll_us=5_000)
    assert gus.run(stream_of(MARK + "LINE X 1\nDWELL 2000\nLINE X 0\n"), gus.machine(Machine())).faults == []


def test_opening_may_take_longer_than_other_calls(gus: Bench) -> None:
    machine = gus.machine(Machine(), call_timeout_s=0.05)
    gus.controller.fault(Fault.HANG, "GT_Open", 1, 1, 0.15)
    assert gus.run(stream_of(MARK + "LINE X 1\n"), machine).faults == []
    fresh(gus)
    gus.controller.fault(Fault.HANG, "GT_ClrSts", 1, 1, 0.15)
    assert "GJ905" in gus.run(stream_of(MARK + "LINE X 1\n"), machine).codes


# How it stops.


def test_all_systems_are_stopped_and_waited_for(gus: Bench) -> None:
    """A listing that uses both: the one that moves is not the last one."""
    fresh(gus, poll_us=1_000)
    first = (SYSTEM_2 + zigzag(100) + END_2).replace("(2,", "(1,")
    first = first.replace("GT_CrdStart(1,2)", "GT_CrdStart(1,1)")
    second = "GT_SetCrdPrm(2,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(2,1)\n"
    stream = listed(first + second + zigzag(3) + "GT_CrdStart(2,2)\n")
    ran = gus.run(stream, gus.machine(Machine()), tick=When(5, "smooth"))
    assert ran.codes == ["GJ911"]
    assert [call for call in made_calls(gus) if call.startswith("GT_Stop")] == ["GT_Stop(768,0)"]
    assert gus.controller.state().moving == 0


@pytest.mark.parametrize("how", ["twice", "late"])
def test_a_smooth_stop_that_takes_long_becomes_an_abrupt_one(
    gus: Bench, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    """By itself, or as soon as the user insists."""
    monkeypatch.setattr(way_out, "_SMOOTH_S", 0.05 if how == "late" else 20.0)
    fresh(gus, poll_us=3_000)

    def tick(control: Control) -> None:
        if control.view.row >= 10 and not control.stop:
            gus.controller.option("stuck", 1)
            control.ask_stop("test")
        elif control.stop == 1 and control.view.phase is Phase.STOPPING and how == "twice":
            control.ask_stop("test")
        if time.perf_counter() - began_s > 5:  # It would never end.
            gus.controller.option("stuck", 0)

    began_s = time.perf_counter()
    assert gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick).codes == ["GJ911"]
    stops = [call for call in made_calls(gus) if call.startswith("GT_Stop")]
    assert stops == ["GT_Stop(768,0)", "GT_Stop(768,771)"]


def test_every_lit_channel_goes_off(gus: Bench) -> None:
    stream, machine = stream_of(STATES), gus.machine(Machine())
    fresh(gus, poll_us=3_000)
    row, lit = int(np.flatnonzero(stream.buffered.kind == Buffered.ARC_CENTRE)[0]) - 1, list[tuple[bool, bool]]()

    def tick(control: Control) -> None:
        if control.view.phase is Phase.RUNNING and control.view.row >= row and not control.stop:
            lit.append(gus.controller.state().switched_on)
            control.ask_stop("test", abrupt=True)

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


def test_motion_of_which_nobody_knows_is_said(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(way_out, "_REST_S", 0.1)
    fresh(gus, poll_us=3_000)
    gus.controller.fault(Fault.RETURN, "GT_CrdStatus", 12, -1, 7)
    ran = gus.run(stream_of(LONG), gus.machine(Machine()))
    assert "GJ913" in ran.codes
    assert not ran.session.reached.sure
    assert "GT_Reset()" in made_calls(gus)


def test_a_stop_that_is_refused_is_tried_again(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)
    gus.controller.fault(Fault.RETURN, "GT_Stop", 1, 2, 7)
    assert gus.run(stream_of(LONG), gus.machine(Machine()), tick=When(10, "smooth")).codes == ["GJ911"]
    stops = [call for call in made_calls(gus) if call.startswith("GT_Stop")]
    assert stops == ["GT_Stop(768,0)", "GT_Stop(768,771)", "GT_Stop(768,771)"]
    assert gus.controller.state().moving == 0


# What is found wrong.


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


def test_the_end_is_wrong_in_y_alone(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_GetCrdPos", 1, -1, 0)  # It always finds X 0 Y 0.
    ran = gus.run(stream_of(MARK + "LINE X 0 Y 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ909"]


@pytest.mark.parametrize(("error", "codes"), [(2, []), (3, ["GJ909"])])
def test_the_tolerance_of_the_end(gus: Bench, error: int, codes: list[str]) -> None:
    gus.controller.option("pos_error", error)
    assert gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine())).codes == codes


def test_a_link_that_fails_at_the_probe_is_no_wrong_library(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 1, 1, -7)
    ran = gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ904"]
    assert "cable" in ran.faults[0].message


def test_a_fifo_without_room_is_a_wrong_library(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_CrdSpace", 1, 1, 0)  # It finds 0.
    ran = gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ903"]


# In a pause.

LONG = (
    MARK + "VEL 50\nLASER POWER 40\nLASER ON\nREPEAT 60 AS i\nLINE X (i % 2 * 3) Y (i / 10)\nEND\nLASER OFF\n"
)  # fmt: skip


def test_the_interlock_is_looked_after_in_a_pause(gus: Bench) -> None:
    machine = gus.machine(Machine(), interlock=Interlock(di_type=4, input=0, value=1))
    fresh(gus, poll_us=3_000, di=1)
    asking, ticks = When(10, "pause"), [0]

    def tick(control: Control) -> None:
        asking(control)
        if control.view.phase is Phase.PAUSED:
            ticks[0] += 1
            gus.controller.option("di", 0)
            if ticks[0] == 10:  # It was not noticed.
                control.ask_stop("the test", abrupt=True)

    assert gus.run(stream_of(LONG), machine, tick=tick).codes == ["GJ910"]


def test_the_light_is_looked_after_in_a_pause(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)
    asking, lit = When(10, "pause"), list[bool]()

    def tick(control: Control) -> None:
        asking(control)
        if control.view.phase is Phase.PAUSED:
            if not lit:
                gus.controller.library.GT_SetHSIOOpt(1, 0)
            else:
                control.ask_pause()
            lit.append(any(gus.controller.state().switched_on))

    assert gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick).faults == []
    assert len(lit) >= 2
    assert not lit[-1]


def test_going_on_after_a_pause_needs_no_way_and_begins_where_it_was(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)
    assert gus.run(stream_of(LONG), gus.machine(Machine())).faults == []
    whole = gus.controller.rows()
    fresh(gus, poll_us=3_000)
    asking = When(10, "pause")

    def tick(control: Control) -> None:
        asking(control)
        if control.view.phase is Phase.PAUSED:
            control.ask_pause()

    ran = gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick)
    assert ran.faults == []
    (paused,) = [line for line in recorded(ran) if "broken" in line]
    parts = [line for line in recorded(ran) if "part" in line]
    assert [(line["part"], line["run"]) for line in parts] == [(0, 0), (paused["broken"], paused["run"])]
    lit_ms = gus.controller.rows()[:, Row.EMISSION0_MS].sum()
    assert lit_ms == pytest.approx(whole[:, Row.EMISSION0_MS].sum(), rel=0.05)


# Going on.

STATES = (
    "LASER DELAY ON 50us OFF 60us\n"
    + MARK
    + """LASER POWER 30
LASER ON
LINE X 5 VEL 80
LINE X 5 Y 5
LASER OFF
LASER DELAY ON 20us OFF 30us
LASER POWER 55 NOW
LASER ON
LINE X 0 Y 5
LASER FOLLOW MIN 5 MAX 60 AT 100
LINE X 0 Y 0
LASER OFF
LASER FPK WIDTH 100us GAP 20us OFFDELAY 5us
LASER ON
LINE X 3
LINE X 6
LASER OFF
LASER FPK OFF
LASER MODE FREQUENCY WIDTH 5us CHANNEL 1
LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 0 MIN 0 MAX 100
LASER ON
LASER POWER 20 CHANNEL 1
LASER ON CHANNEL 1
LINE X 1 Y 2
LINE X 2 Y 9
ARC CCW I 3 J 0
LASER OFF CHANNEL 1
LASER OFF
"""
)


def test_begun_at_any_row_the_lasers_are_as_they_were(gus: Bench) -> None:
    """Power and light of all that is left, whatever was set before: modes, delays, FPK, follow, both channels."""
    stream, machine = stream_of(STATES), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    timed = np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)
    light = [Row.EMISSION0_MS, Row.EMISSION1_MS, Row.POWER0_MS, Row.POWER1_MS]
    for row in range(len(stream.buffered)):
        fresh(gus)
        assert gus.run(stream, machine, begin=Place(row=row)).faults == []
        rows = gus.controller.rows()
        first = int(np.searchsorted(timed, row))
        left = whole[first:]
        rows = rows[len(rows) - len(left) :]
        assert rows[:, [Row.X1, Row.Y1]] == pytest.approx(left[:, [Row.X1, Row.Y1]], abs=1e-6), row
        # In the first motion the light comes later by the delay, and it may start from rest.
        assert (rows[:1, light] > 0).tolist() == (left[:1, light] > 0).tolist(), row
        if len(rows) > 1:
            same_time = np.abs(rows[1:, Row.DURATION_MS] - left[1:, Row.DURATION_MS]) < 1e-6
            assert same_time.all(), row
            assert rows[1:, light] == pytest.approx(left[1:, light], rel=1e-4, abs=1e-3), row
        for channel in (0, 1) if len(left) else ():
            lit, energy = left[0, Row.EMISSION0_MS + channel], left[0, Row.POWER0_MS + channel]
            if lit:
                mean = rows[0, Row.POWER0_MS + channel] / rows[0, Row.EMISSION0_MS + channel]
                assert mean == pytest.approx(energy / lit, rel=0.15), (row, channel)


def test_what_is_in_force_is_set_again_in_its_order(gus: Bench) -> None:
    """Begun at the last row: what the lasers know is what they would know, no more and nothing of the past."""
    stream = stream_of(STATES)
    part = rest(stream, Place(row=int(np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)[-1])))
    set_up = [(c.name, c.args) for c in part.stream.calls if c.at == 0 and c.name != "GT_CrdClear"]
    settings = [(c.name, c.args) for c in stream.calls if c.name not in (
        "GT_CrdClear", "GT_CrdStart", "GT_CrdStatus", "GT_SetCrdPrm", "GT_LaserPrfCmd", "GT_EnaFPK"
    )]  # fmt: skip
    old = next(i for i, (name, _) in enumerate(settings) if name == "GT_SetLevelDelay")
    wanted = settings[:old] + settings[old + 1 :]
    built = [("GT_SetCrdPrm", c.args) for c in stream.calls if c.name == "GT_SetCrdPrm"][-1:]
    assert sorted(map(str, set_up)) == sorted(map(str, wanted + built))
    names = [name for name, _ in set_up]
    assert names.index("GT_LaserPowerMode") < names.index("GT_LaserOutFrq")
    assert names[-1] == "GT_SetCrdPrm"
    assert all(line > 0 for line in part.stream.buffered.line.tolist())
    # In the second stage it is the delays of then, and no call of later.
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.FOLLOW)[0])
    early = [(c.name, c.args) for c in rest(stream, Place(row=row)).stream.calls if c.at == 0]
    assert [args for name, args in early if name == "GT_SetLevelDelay"] == [(30.0, 20.0, 0.0)]
    assert not {"GT_EnaFPK", "GT_DisFPK", "GT_SetLaserDisMode"} & {name for name, _ in early}


def test_a_new_mode_takes_the_power_away_and_the_same_one_does_not(gus: Bench) -> None:
    for mode, found in ((1, []), (0, [40.0])):
        stream = listed(
            SYSTEM_2 + zigzag(2) + "GT_BufLaserOff(2,1,0)\nGT_CrdStart(2,2)\nGT_CrdStatus(2,run,segment,1)\n"
            f"GT_LaserPowerMode({mode},100,0,0)\nGT_CrdClear(2,1)\n" + zigzag(2) + "GT_CrdStart(2,2)\n"
        )
        part = rest(stream, Place(row=len(stream.buffered) - 2))
        lead = part.stream.buffered.pick(np.arange(part.lead))
        assert lead.p[lead.kind == Buffered.POWER].tolist() == found
        starts = [(c.name, c.args) for c in part.stream.calls if c.name in ("GT_CrdStart", "GT_CrdClear")]
        assert starts == [("GT_CrdClear", (2.0, 1.0)), ("GT_CrdStart", (2.0, 2.0))]


def test_settings_of_an_older_mode_are_not_set_again() -> None:
    text = SYSTEM_2.replace("GT_SetCrdPrm", "GT_LaserPowerMode(1,2000,0,0)\nGT_SetPulseWidth(5,0)\nGT_SetCrdPrm", 1)
    part = rest(listed(text + zigzag(3) + "GT_CrdStart(2,2)\n"), Place(row=3))
    names = [call.name for call in part.stream.calls if call.at == 0]
    assert names == ["GT_SetAxisMode", "GT_LaserPowerMode", "GT_SetPulseWidth", "GT_SetCrdPrm", "GT_CrdClear"]


def test_light_switched_on_at_once_is_switched_on_again(gus: Bench) -> None:
    text = SYSTEM_2.replace("GT_BufLaserOn(2,1,0)\n", "") + zigzag(3) + "GT_SetHSIOOpt(1,0)\nGT_CrdStart(2,2)\n"
    later = "GT_CrdStatus(2,run,segment,1)\nGT_SetHSIOOpt(1,0)\nGT_CrdClear(2,1)\n" + zigzag(3)
    stream = listed(text + later + "GT_CrdStart(2,2)\n")
    for row, on in ((5, True), (4, True)):
        part = rest(stream, Place(row=row))
        assert (Buffered.ON in part.stream.buffered.kind[: part.lead].tolist()) == on, row


def test_end_velocities_are_those_that_can_be_reached_from_rest() -> None:
    """Begun 3 pulse before a corner that is passed at full speed: the way is too short for it."""
    stream = stream_of(MARK + "LASER POWER 30\nLASER ON\nLINE X 5\nLINE X 10\nLASER OFF\n")
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.LINE)[0])
    assert stream.buffered.vel_end[row] == 100
    part = rest(stream, Place(row=row, run_pulse=4990.0))
    calls = part.stream.buffered
    assert calls.vel_end[part.lead] == pytest.approx((2 * 10 * 10) ** 0.5, rel=0.02)
    assert calls.vel_end[-2] == 0
    assert stream.buffered.vel_end[row] == 100  # The job's own are not touched.


@pytest.mark.parametrize("arc", ["ARC CCW I 5 J 1", "ARC CW X 8 Y 3 R 6", "ARC CCW X 8 Y 3 R -6"])
def test_begun_within_an_arc_it_stays_on_it(arc: str) -> None:
    stream = stream_of(MARK + f"JUMP X 1 Y 2\n{arc}\n")
    trace, _ = simulate_stream(stream, Machine())
    assert trace is not None
    row = int(np.flatnonzero(stream.buffered.kind <= Buffered.ARC_RADIUS)[-1])
    laid = trace.segments
    length = float(laid.length[-1])
    for share in (0.1, 0.6, 0.9):
        part = rest(stream, Place(row=row, run_pulse=share * length))
        begun, faults = simulate_stream(part.stream, Machine())
        assert begun is not None
        assert faults == []
        there = begun.segments
        assert float(there.length[-1]) == pytest.approx((1 - share) * length, abs=5)
        middle = laid.points(np.array([len(laid.length) - 1]), np.array([(1 + share) / 2]))
        found = there.points(np.array([len(there.length) - 1]), np.array([0.5]))
        assert np.abs(np.array(middle) - np.array(found)).max() < 2


def test_gone_on_with_twice(gus: Bench) -> None:
    """A run that goes on breaks again, within the row in which it began: the place is the whole job's."""
    text = MARK + "VEL 50\nLASER POWER 40\nLASER ON\nLINE X 40\nLINE X 40 Y 1\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, poll_us=2_000)

    def at(x: float) -> Callable[[Control], None]:
        def tick(control: Control) -> None:
            if control.view.phase is Phase.RUNNING and control.view.x_pulse >= x and not control.stop:
                control.ask_stop("test", abrupt=True)

        return tick

    first = gus.run(stream, machine, tick=at(2000))
    assert first.codes == ["GJ911"]
    lit = gus.controller.rows()[:, Row.POWER0_MS].sum()
    reached = [first.session.reached]
    journal = first.journal
    for x in (12_000, 24_000):
        place = reached[-1]
        assert place.sure
        assert place.row == int(np.flatnonzero(stream.buffered.kind == Buffered.LINE)[0])
        fresh(gus, poll_us=2_000)
        gus.controller.library.GT_Open(0, 1)
        again = gus.run(stream, machine, begin=place, tick=at(x))
        assert again.codes == ["GJ911"]
        lit += gus.controller.rows()[:, Row.POWER0_MS].sum()
        reached.append(again.session.reached)
        journal = again.journal
        rows = [line["row"] for line in recorded(again) if "row" in line and "call" in line]
        assert sorted(set(rows)) == [-1, *range(place.row, len(stream.buffered))]
    along = [place.run_pulse for place in reached]
    assert along == sorted(along)
    assert 0 < along[0] < along[1] < along[2] < 40_000
    fresh(gus, poll_us=20_000)
    last, _ = gus.resumed(stream, machine, journal)
    assert last.faults == []
    lit += gus.controller.rows()[:, Row.POWER0_MS].sum()
    fresh(gus, poll_us=20_000)
    assert gus.run(stream, machine).faults == []
    # The light goes on a little earlier each time than it went off.
    assert lit == pytest.approx(gus.controller.rows()[:, Row.POWER0_MS].sum(), rel=0.1)


def test_a_run_that_was_done_leaves_nothing(gus: Bench) -> None:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    ran = gus.run(stream, machine)
    assert ran.faults == []
    end = recorded(ran)[-1]
    assert (end["end"], end["row"], end["sure"], end["faults"]) == ("done", len(stream.buffered), True, [])


def test_a_bug_is_no_run_that_was_done(gus: Bench) -> None:
    folder_before = set(gus.folder.glob("*.journal"))

    def tick(control: Control) -> None:
        if control.view.row > 10:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick)
    (journal,) = set(gus.folder.glob("*.journal")) - folder_before
    end = json.loads(journal.read_bytes().splitlines()[-1])
    assert end["end"] == "failed"


def as_if_killed(ran: Ran) -> Path:
    """Its journal without the end, as a process leaves it that is killed."""
    text = b"".join(line for line in ran.journal.read_bytes().splitlines(keepends=True) if b',"broken":' not in line)
    path = ran.journal.with_suffix(".killed")
    path.write_bytes(text[: text.rfind(b"{", 0, text.rfind(b'"end":'))] + b'{"t":1.0,"code":0,"row"')
    return path


@pytest.mark.parametrize(
    "before",
    [
        "LINE X 5\nLINE X 0\n",
        "LINE X 5\n",
    ],
)
@pytest.mark.parametrize("how", ["stopped", "killed"])
def test_a_part_without_a_way_to_it_is_found_again(gus: Bench, before: str, how: str) -> None:
    """Stopped in a dwell, where the head rests; gone on with from there and broken; gone on with once more."""
    text = MARK + "VEL 50\nLASER POWER 40\n" + before + "DWELL 3000\nLASER ON\nLINE X 40\nLINE X 0\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, poll_us=2_000)
    dwell = int(np.flatnonzero(stream.buffered.kind == Buffered.DELAY)[0])
    first = gus.run(stream, machine, tick=When(dwell, "abrupt"))
    assert first.session.reached == Place(row=dwell)

    def tick(control: Control) -> None:
        if control.view.phase is Phase.RUNNING and control.view.x_pulse >= 15_000 and not control.stop:
            control.ask_stop("test", abrupt=True)

    again = gus.run(stream, machine, begin=first.session.reached, tick=tick)
    assert again.codes == ["GJ911"]
    assert [line["lead"] for line in recorded(again) if "part" in line] == [1]  # Its power; no way.
    x, begun = gus.controller.state().x, 0.0 if "X 0" in before else 5000.0
    last, place = gus.resumed(stream, machine, again.journal if how == "stopped" else as_if_killed(again))
    assert last.faults == []
    assert place is not None
    assert place.row == dwell + 2
    assert x - begun - 2 - 50 * 25 < place.run_pulse < x - begun + 2


def test_a_controller_that_was_started_anew_or_moved_is_not_guessed_at(gus: Bench) -> None:
    stream, machine = stream_of(LONG), gus.machine(Machine())
    fresh(gus, poll_us=3_000)
    killed = as_if_killed(gus.run(stream, machine, tick=When(20, "abrupt")))
    gus.controller.option("pos_error", 500)
    ran, place = gus.resumed(stream, machine, killed)
    assert (place, ran.codes) == (None, ["GJ914"])
    assert "not on the path" in ran.faults[0].message
    fresh(gus)
    ran, place = gus.resumed(stream, machine, killed)
    assert (place, ran.codes) == (None, ["GJ914"])


# Where on the path.


def route_of(text: str) -> tuple[Route, Stream]:
    stream = stream_of(MARK + text)
    return Route.of(stream.buffered, (0, 0)), stream


def test_back_never_goes_over_a_dwell() -> None:
    route, _ = route_of("LINE X 5\nLINE X 5 Y 5\nDWELL 3\nLINE X 0 Y 5\nLINE X 0 Y 0\n")
    ms = 1 / float(route.calls.vel[0])
    assert route.back(Place(row=1, run_pulse=0.0), 10 * ms) == Place(row=0, run_pulse=4990.0)
    assert route.back(Place(row=1, run_pulse=0.0), 7000 * ms) == Place(row=0, run_pulse=0.0)
    assert route.back(Place(row=1, run_pulse=4.0), 10 * ms) == Place(row=0, run_pulse=4994.0)
    assert route.back(Place(row=3), 10 * ms) == Place(row=3)
    assert route.back(Place(row=2), 10 * ms) == Place(row=2)
    assert route.back(Place(row=0), 10 * ms) == Place(row=0)
    assert route.back(Place(row=4, run_pulse=100.0), 10 * ms) == Place(row=4, run_pulse=90.0)


def test_behind_a_dwell_the_motion_before_it_gives_the_start() -> None:
    route, _ = route_of("LINE X 5\nDWELL 3\nDWELL 4\nLINE X 5 Y 5\n")
    assert route.place(4, 4, 5000, 1000) == Place(row=3, run_pulse=1000.0)
    assert route.place(3, 3, 5000, 1000) == Place(row=3, run_pulse=1000.0)


def test_where_two_calls_fit_the_earlier_one_is_taken() -> None:
    route, _ = route_of("LINE X 5\nLINE X 0\nLINE X 5\n")
    assert route.place(2, 2, 2000, 0) == Place(row=1, run_pulse=3000.0)
    assert not route.place(2, 2, 2000, 3).sure
    assert route.place(2, 2, 2000, 1).sure


@pytest.mark.parametrize("way", ["CCW", "CW"])
def test_places_on_an_arc_and_beyond_its_ends(way: str) -> None:
    """A quarter circle about 0, 0."""
    end = "Y 5" if way == "CCW" else "Y -5"
    stream = stream_of(MARK + f"JUMP X 5 Y 0\nARC {way} X 0 {end} R 5\n")
    route = Route.of(stream.buffered, (0, 0))
    number = len(route.timed) - 1
    laid = call_segments(stream.buffered, route.timed, np.zeros(len(route.timed), dtype=np.bool_))
    length, sign = float(laid.length[-1]), 1 if way == "CCW" else -1
    for share in (0.0, 0.25, 0.7, 1.0):
        turn = sign * share * np.pi / 2
        distance, run, _ = route.nearest(number, 5000 * np.cos(turn), 5000 * np.sin(turn))
        assert distance == pytest.approx(0, abs=1e-6)
        assert run == pytest.approx(share * length, abs=1e-6)
    assert route.nearest(number, 4999, -10 * sign)[1] == 0
    assert route.nearest(number, -10, 4999 * sign)[1] == length


# The report of a journal.


@pytest.mark.parametrize("how", ["stopped", "paused", "gone on"])
def test_the_report_of_a_journal_is_what_was_run(gus: Bench, how: str) -> None:
    """Radius arcs under way when it ends: the report's light and path are the controller's, up to where light ended."""
    text = MARK + "VEL 50\nLASER POWER 40\nLASER ON\n" + "ARC CW X 20 R 10\nARC CW X 0 R 10\n" * 4 + "LASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, poll_us=3_000)
    asking = When(4, "pause" if how == "paused" else "abrupt")

    def tick(control: Control) -> None:
        asking(control)
        if control.view.phase is Phase.PAUSED:
            control.ask_pause()

    ran = gus.run(stream, machine, tick=tick)
    if how == "gone on":
        fresh(gus, poll_us=3_000)
        ran = gus.run(stream, machine, begin=ran.session.reached, tick=When(7, "abrupt"))
    done = gus.controller.rows()
    source, _ = check_text(ran.journal.read_bytes(), "x.journal")
    assert source is not None
    sent, faults = sent_calls(source)
    assert faults == [] and sent is not None
    trace, found = simulate_stream(sent, machine, is_listing=True)
    assert trace is not None
    assert {fault.rule.severity.name for fault in found} <= {"WARNING", "NOTE"}
    light_ms = sum(float(channel.emitted.emission_ms.sum()) for channel in trace.channels)
    assert light_ms == pytest.approx(done[:, Row.EMISSION0_MS].sum(), rel=0.02)
    length = float(trace.segments.length.sum())
    assert length == pytest.approx(done[:, Row.LENGTH].sum(), rel=0.02)
    assert set(sent.buffered.line.tolist()) <= set(stream.buffered.line.tolist())


def reported(ran: Ran, machine: Machine) -> tuple[Stream, float]:
    """A journal as a stream, and the length of its path, pulse."""
    source, _ = check_text(ran.journal.read_bytes(), "x.journal")
    assert source is not None
    sent, faults = sent_calls(source)
    assert faults == [] and sent is not None
    trace, _ = simulate_stream(sent, machine, is_listing=True)
    assert trace is not None
    return sent, float(trace.segments.length.sum())


@pytest.mark.parametrize("arc", ["LINE X 80", "ARC CCW X 20 R -15", "ARC CW X 1 R -30"])
def test_the_report_of_a_run_that_began_and_ended_within_one_call(gus: Bench, arc: str) -> None:
    stream = stream_of(MARK + f"VEL 50\nLASER POWER 40\nLASER ON\n{arc}\nLASER OFF\n")
    machine, row = gus.machine(Machine()), 2
    fresh(gus, poll_us=3_000)

    def after(ms: float) -> Callable[[Control], None]:
        def tick(control: Control) -> None:
            if gus.controller.state().running >= ms and not control.stop:
                control.ask_stop("test", abrupt=True)

        return tick

    first = gus.run(stream, machine, tick=after(250))
    assert first.session.reached.row == row
    done = gus.controller.rows()
    assert reported(first, machine)[1] == pytest.approx(done[:, Row.LENGTH].sum(), rel=0.05, abs=300)
    ran_ms = gus.controller.state().running
    again = gus.run(stream, machine, begin=first.session.reached, tick=after(ran_ms + 250))
    assert again.session.reached.row == row
    assert again.session.reached.run_pulse > first.session.reached.run_pulse
    more = gus.controller.rows()[len(done) :]
    sent, length = reported(again, machine)
    assert sent.buffered.vel_end.tolist()[-1] == 50  # The light went off in full motion.
    # It is interpreted from 0, 0, where the head was not: but for the way to where it began.
    way = float(np.hypot(*more[0, [Row.X1, Row.Y1]]))
    assert length - way == pytest.approx(more[1:, Row.LENGTH].sum(), rel=0.05, abs=300)


def test_refused_calls_are_not_in_the_report(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_LnXY", 2, 2, 1)
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    ran = gus.run(stream, machine)
    assert ran.faults == []
    assert len(reported(ran, machine)[0].buffered) == len(stream.buffered)


# The command.


def invoked(gus: Bench, folder: Path, text: str, *options: str) -> tuple[int, str]:
    job = folder / "part.job"
    job.write_text(text, encoding="utf-8")
    argv = [str(job), "--backend", "gts", "--library", str(gus.path), "--abi", "gus", "--yes", "--progress", "none"]
    done = CliRunner().invoke(command, [*argv, *options])
    assert done.exception is None or isinstance(done.exception, SystemExit)
    return done.exit_code, done.output


def test_a_journal_is_never_written_over(gus: Bench, tmp_path: Path) -> None:
    there = tmp_path / "there.journal"
    there.write_text("old", encoding="utf-8")
    code, localized = invoked(gus, tmp_path, MARK + "LINE X 1\n", "--journal", str(there))
    assert code == 2
    assert "exists already" in localized
    assert there.read_text(encoding="utf-8") == "old"
    assert gus.controller.calls() == []


def test_the_plan_tells_the_time_that_is_left(gus: Bench, tmp_path: Path) -> None:
    text = MARK + "LINE X 10\nDWELL 3000\nLINE X 0\n"
    code, localized = invoked(gus, tmp_path, text)
    assert code == 0
    assert "time     3.22 s" in localized
    code, localized = invoked(gus, tmp_path, text, "--from-line", "6")
    assert code == 0
    assert "time     0.11 s" in localized


def test_what_may_still_be_on_is_not_called_safe(gus: Bench, tmp_path: Path) -> None:
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 3, -1, 7)
    gus.controller.fault(Fault.RETURN, "GT_BufDelay", 1, -1, 7)
    code, localized = invoked(gus, tmp_path, EVERYTHING)
    assert code == 1
    assert "GJ912" in localized
    assert "LOOK AT THE MACHINE" in localized
    assert "the light is off" not in localized


def test_two_streams_that_differ_in_any_call_have_two_fingerprints() -> None:
    texts = (EVERYTHING, EVERYTHING.replace("GAP 20us", "GAP 21us"), EVERYTHING.replace("ARC CW X 8", "ARC CW X 7"))
    assert len({fingerprint(stream_of(text)) for text in texts}) == 3
    assert fingerprint(stream_of(EVERYTHING)) == fingerprint(stream_of(EVERYTHING))


def test_the_box_has_each_axis_own_scale() -> None:
    machine = Machine(pulses_per_mm=(1000.0, 500.0))
    stream = stream_of(MARK + "LASER POWER 3\nJUMP X 1 Y 2\nLASER ON\nLINE X 4 Y 8\nLASER OFF\n", machine)
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    assert forecast(stream, trace, machine).box_mm == pytest.approx((1, 4, 2, 8))


def test_a_channel_that_is_only_switched_at_once_is_turned_off_too() -> None:
    head = SYSTEM_2.replace("GT_BufLaserOn(2,1,0)\n", "").replace("GT_BufLaserPrfCmd(2,40,1,0)\n", "")
    stream = listed(head + zigzag(2) + "GT_SetHSIOOpt(1,1)\nGT_CrdStart(2,2)\n")
    assert outputs_of(stream).channels == (0, 1)


@pytest.mark.skipif(not hasattr(signal, "SIGTSTP"), reason="signals of POSIX")
def test_what_signals_ask_for() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGTSTP)}
    for numbers, stop, pause in (
        ([signal.SIGINT], 1, False), ([signal.SIGINT, signal.SIGINT], 2, False), ([signal.SIGTERM], 2, False),
        ([signal.SIGHUP], 2, False), ([signal.SIGTSTP], 0, True), ([signal.SIGTSTP, signal.SIGTSTP], 0, False),
    ):  # fmt: skip
        control = Control()
        with signals(control):
            for number in numbers:
                signal.raise_signal(number)
        assert (control.stop, control.pause, control.asked) == (stop, pause, bool(stop or pause)), numbers
    assert before == {number: signal.getsignal(number) for number in before}
