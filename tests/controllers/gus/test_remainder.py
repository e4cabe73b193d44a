"""What is left of a job from a place on, and what a run takes for granted: on the virtual controller."""

from __future__ import annotations

import random
from collections.abc import Iterator

import numpy as np
import pytest
from support.controller import Fault, Row, needs_controller
from support.hardware import EVERYTHING, Bench, bench
from support.tools import MARK, stream_of

from gusjob.config.machine import Interlock, Machine
from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.driver import fifo
from gusjob.controllers.gus.driver.resume import recorded_place
from gusjob.controllers.gus.driver.session import one_queue
from gusjob.controllers.gus.driver.shutdown import Outputs, WayOut
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.place import Place, Route
from gusjob.controllers.gus.remainder import rest, settled
from gusjob.controllers.journal import read_journal
from gusjob.frontend import check_text, read_listing
from gusjob.hardware.forecast import forecast

pytestmark = needs_controller

LIT_FIRST = MARK + "LASER POWER 40\nLASER ON\nLINE X 5\nLINE X 5 Y 5\nLASER OFF\n"
ENERGY = [Row.EMISSION0_MS, Row.EMISSION1_MS, Row.POWER0_MS, Row.POWER1_MS]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return bench(tmp_path_factory.mktemp("controller"))


@pytest.fixture
def gus(made: Bench, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    monkeypatch.setattr(fifo, "POLL_S", 0.0005)
    made.controller.reset()
    made.controller.options(poll_us=40_000, call_us=5)
    yield made
    made.controller.reset()


# What a run takes for granted is made so.


def test_light_that_another_program_left_on_goes_off(gus: Bench) -> None:
    call = gus.controller.library
    assert [call.GT_Open(0, 1), call.GT_SetHSIOOpt(1, 1)] == [0, 0]
    assert gus.controller.state().emitting[1] or gus.controller.state().switched_on[1]
    assert gus.run(stream_of(LIT_FIRST), gus.machine(Machine())).faults == []
    edges = gus.controller.edges()
    assert not any(gus.controller.state().switched_on)
    assert gus.controller.rows()[:, Row.EMISSION1_MS].sum() == 0, edges


def test_settings_that_another_job_left_do_not_change_this_one(gus: Bench) -> None:
    machine, plain = gus.machine(Machine()), stream_of(LIT_FIRST.replace("ON", "ON", 1))
    assert gus.run(plain, machine).faults == []
    wanted = gus.controller.rows()[:, ENERGY]
    other = MARK + "LASER DISTANCE REF X 0 Y 0 RATIO X 5 Y 5 MIN 0 MAX 100\nLASER DELAY ON 300us OFF 500us\n"
    other += "LASER FPK WIDTH 10us GAP 200us OFFDELAY 100us\nLASER POWER 9\nLASER ON\nLINE X 1\nLASER OFF\nJUMP X 0\n"
    assert gus.run(stream_of(other), machine).faults == []
    done = len(gus.controller.rows())
    assert gus.run(plain, machine).faults == []
    assert gus.controller.rows()[done:, ENERGY] == pytest.approx(wanted)


def test_a_job_that_begins_lit_begins_at_its_start(gus: Bench) -> None:
    stream, machine = stream_of(LIT_FIRST), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    first = gus.controller.rows()
    assert gus.run(stream, machine).faults == []
    way, *again = gus.controller.rows()[len(first) :]
    assert way[ENERGY].sum() == 0
    assert (way[Row.X1], way[Row.Y1]) == (0, 0)
    moved = [Row.X0, Row.Y0, Row.X1, Row.Y1, *ENERGY]
    assert np.array(again)[:, moved] == pytest.approx(first[:, moved])


def test_the_interlock_is_read_right_before_the_start(gus: Bench) -> None:
    gus.controller.option("di", 1)
    gus.controller.fault(Fault.DI, "GT_CrdClear", 1, 1, 0)
    ran = gus.run(stream_of(LIT_FIRST), gus.machine(Machine(), interlock=Interlock(input=0)))
    assert ran.codes == ["GJ910"]
    assert "GT_CrdStart" not in gus.controller.names()


def test_calls_of_two_queues_are_refused() -> None:
    text = "GT_LnXY(1,10,0,50,2,0,0)\nGT_LnXY(2,10,0,50,2,0,0)\n"
    source, _ = check_text(text.encode(), "two.gts")
    assert source is not None
    (diagnostic,) = one_queue(read_listing(source)[0])
    assert (diagnostic.rule.code, diagnostic.span.line) == ("GJ917", 2)
    assert one_queue(stream_of(EVERYTHING)) == []


# The way out.


def test_light_that_does_not_go_off_stops_the_motion_at_once(gus: Bench) -> None:
    """And takes its power, before it is tried again for as long as the link is given."""
    machine = gus.machine(Machine(), link_patience_s=1.0)

    def tick(control: Control) -> None:
        if control.view.x_pulse > 500 and not control.stop:
            gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 1, 6, -7)
            control.ask_stop("test")

    gus.controller.option("poll_us", 3_000)
    text = MARK + "VEL 10\nLASER POWER 9\nLASER ON\nLINE X 100\nLASER OFF\n"
    ran = gus.run(stream_of(text), machine, tick=tick)
    assert ran.codes == ["GJ911"]
    names = gus.controller.names()
    behind = names[len(names) - 1 - names[::-1].index("GT_CrdStart") :]
    first_off = behind.index("GT_SetHSIOOpt")
    assert "GT_LaserPrfCmd" in behind[first_off : first_off + 4]
    assert "GT_Stop" in behind[first_off : first_off + 6]


def test_where_the_light_went_off_is_told_by_the_channel_that_went_first(gus: Bench) -> None:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    ran = gus.run(stream, machine)
    gus.controller.library.GT_Open(0, 1)
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 2, 2, -7)
    ran.session.link.take_over()
    way = WayOut(ran.session.link, Outputs(channels=(0, 1), crds=(1,), axes=(1, 2)), 1.0)
    ran.session.link.journal.write = lambda _line: None
    began = ran.session.link.journal.now_s() + ran.session.link.journal.start_s
    assert way.light_off() == []
    assert way.off_s - began < 0.015  # Channel 1 took two naps of 20 ms more.


# Places.


def test_a_place_near_an_arcs_end_is_its_end() -> None:
    """What is left would round to nothing, and an arc that ends where it begins is a full circle."""
    stream = stream_of(MARK + "LASER POWER 9\nLASER ON\nARC CCW X 5 Y 5 I 0 J 5\nLINE X 0\nLASER OFF\n")
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.ARC_CENTRE)[0])
    length = 5000 * np.pi / 2
    for left in (0.0, 0.2, 0.4, 0.6, 0.69, 0.9):
        calls = rest(stream, Place(row=row, run_pulse=length - left)).stream.buffered
        arcs = np.flatnonzero(calls.kind == Buffered.ARC_CENTRE)
        route = Route.of(calls, (0, 0))
        lengths = [route.nearest(int(np.searchsorted(route.timed, at)), 0.0, 0.0)[2] for at in arcs]
        assert max(lengths, default=0.0) < 2, left
    for left in (2.0, 10.0, 5000.0):
        part = rest(stream, Place(row=row, run_pulse=length - left))
        assert (part.stream.buffered.kind == Buffered.ARC_CENTRE).sum() == 1, left


def test_a_full_circle_that_hardly_began_is_whole() -> None:
    stream = stream_of(MARK + "LASER POWER 9\nLASER ON\nARC CW I 3 J 0\nLASER OFF\n")
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.ARC_CENTRE)[0])
    assert settled(stream.buffered, Place(row=row, run_pulse=0.3)) == Place(row=row)
    done = settled(stream.buffered, Place(row=row, run_pulse=2 * np.pi * 3000 - 0.3))
    assert done.row == len(stream.buffered)


def test_a_place_goes_back_over_several_segments() -> None:
    text = MARK + "VEL 100\n" + "".join(f"LINE X {i / 10}\n" for i in range(1, 50))
    calls = stream_of(text).buffered  # 100 pulse each, at 100 pulse/ms.
    route = Route.of(calls, (0, 0))
    assert route.back(Place(row=20, run_pulse=30), 0.2) == Place(row=20, run_pulse=10)
    there = route.back(Place(row=20, run_pulse=30), 2.5)
    assert there.row == 17
    assert there.run_pulse == pytest.approx(80)
    assert route.back(Place(row=1, run_pulse=30), 9.0) == Place(row=0)
    # Ten rows left the FIFO between two looks: the position tells which it is.
    assert route.place(20, 30, 2450.0, 0.0) == Place(row=24, run_pulse=50)


def test_light_that_goes_off_next_does_not_come_on() -> None:
    stream = stream_of(LIT_FIRST + "JUMP X 0 Y 0\nLASER POWER 20\nLASER ON\nLINE X 2\nLASER OFF\n")
    off = int(np.flatnonzero(stream.buffered.kind == Buffered.OFF)[0])
    kinds = rest(stream, Place(row=off)).stream.buffered.kind.tolist()
    assert kinds.index(Buffered.LINE) < kinds.index(Buffered.ON)
    assert kinds.count(Buffered.ON) == 1


def test_distance_follow_that_is_off_stays_off(gus: Bench) -> None:
    text = (
        MARK + "LASER DISTANCE REF X 0 Y 0 RATIO X 5 Y 5 MIN 0 MAX 100\nLASER POWER 9\nLASER ON\nLINE X 1\nLASER OFF\n"
    )
    text += "LASER DISTANCE OFF\nLASER ON\nLINE X 2\nLASER OFF\n"
    stream = stream_of(text)
    last = int(np.flatnonzero(stream.buffered.kind == Buffered.LINE)[-1])
    assert gus.run(stream, gus.machine(Machine()), begin=Place(row=last)).faults == []
    row = gus.controller.rows()[-1]
    assert (row[Row.POWER0_MIN], row[Row.POWER0_MAX]) == (9, 9)


def test_a_run_killed_while_it_was_paused_goes_on_where_the_light_went_off(gus: Bench) -> None:
    ran = gus.run(stream_of(LIT_FIRST), gus.machine(Machine()))
    lines = [line for line in ran.journal.read_bytes().splitlines(keepends=True) if b'"end"' not in line]
    ran.journal.write_bytes(b"".join([*lines, b'{"t":1.5,"broken":2,"run":1234.5,"line":9}\n']))
    recorded = read_journal(ran.journal)
    assert not isinstance(recorded, str)
    assert recorded_place(recorded) == Place(row=2, run_pulse=1234.5)


# Any job, from any row on.


def random_job(rng: random.Random) -> str:
    """Marks, jumps, dwells and arcs of two channels at direct powers, in stages."""
    lines = [MARK + "LASER MODE DUTY CARRIER 5 CHANNEL 1\nLASER POWER 5\nLASER POWER 6 CHANNEL 1"]
    for _ in range(rng.randint(3, 9)):
        channel = rng.choice(["", " CHANNEL 1"])
        if rng.random() < 0.3:
            lines.append(f"LASER DELAY ON {rng.randint(0, 90)}us OFF {rng.randint(90, 200)}us{channel}")
        if rng.random() < 0.3:
            lines.append(f"LASER POWER {rng.randint(1, 90)}{rng.choice(['', ' NOW'])}{channel}")
        lines.append(f"JUMP X {rng.randint(-9, 9)} Y {rng.randint(-9, 9)}")
        lines.append(f"LASER ON{channel}")
        for _ in range(rng.randint(1, 4)):
            x, y = rng.randint(10, 90), rng.randint(-90, -10)
            lines.append(
                rng.choice(
                    [f"LINE X {x / 10} Y {y / 10}", f"LASER POWER {rng.randint(1, 90)}{channel}", "DWELL 20",
                     f"ARC CCW I {x / 20} J {y / 20}", f"ARC CW X {x / 10} Y {y / 10} R 40"]
                )
            )  # fmt: skip
        lines.append(f"LINE X {rng.randint(100, 120) / 10} Y {rng.randint(91, 99) / 10}")
        lines.append(f"LASER OFF{channel}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("seed", range(25))
def test_any_job_from_any_row(gus: Bench, seed: int) -> None:
    """Each segment behind the place comes as in the whole run: where, lit or dark, at which power."""
    rng = random.Random(seed)
    stream, machine = stream_of(random_job(rng)), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    timed = np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)
    for number in rng.sample(range(len(timed)), min(len(timed), 4)):
        gus.controller.reset()
        gus.controller.options(poll_us=40_000, call_us=5)
        begin = Place(row=int(timed[number]), run_pulse=rng.choice([0.0, 0.0, 700.0]))
        if stream.buffered.kind[begin.row] == Buffered.DELAY or whole[number, Row.LENGTH] < 1500:
            begin = Place(row=begin.row)
        assert gus.run(stream, machine, begin=begin).faults == []
        rows = gus.controller.rows()[-(len(whole) - number) :]
        wanted = whole[number:]
        assert rows[:, [Row.X1, Row.Y1]] == pytest.approx(wanted[:, [Row.X1, Row.Y1]], abs=1e-6)
        assert rows[1:, Row.LENGTH] == pytest.approx(wanted[1:, Row.LENGTH], abs=1e-6)
        assert rows[0, Row.LENGTH] == pytest.approx(wanted[0, Row.LENGTH] - begin.run_pulse, abs=6)
        for lit, power in ((Row.EMISSION0_MS, Row.POWER0_MS), (Row.EMISSION1_MS, Row.POWER1_MS)):
            share = rows[:, lit] / rows[:, Row.DURATION_MS] > 0.5
            assert share.tolist() == (wanted[:, lit] / wanted[:, Row.DURATION_MS] > 0.5).tolist()
            mean = rows[share, power] / rows[share, lit]
            assert mean == pytest.approx(wanted[share, power] / wanted[share, lit], rel=1e-6)


def test_a_channel_that_refuses_is_tried_three_times(gus: Bench) -> None:
    ran = gus.run(stream_of(LIT_FIRST), gus.machine(Machine()))
    gus.controller.library.GT_Open(0, 1)
    ran.session.link.take_over()
    ran.session.link.journal.write = lambda _line: None
    way = WayOut(ran.session.link, Outputs(channels=(0, 1), crds=(1,), axes=(1, 2)), 1.0)
    for refusals, channels in ((4, []), (5, [0]), (6, [0, 1])):
        gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 1, refusals, 7)
        assert [diagnostic.fields["channel"] for diagnostic in way.light_off()] == channels


def test_a_library_that_hangs_before_it_is_known_is_left_alone(gus: Bench) -> None:
    """Of another ABI it would take "off" for something else."""
    machine = gus.machine(Machine(), call_timeout_s=0.03)
    gus.controller.fault(Fault.HANG, "GT_ClrSts")
    ran = gus.run(stream_of(LIT_FIRST), machine)
    assert ran.codes == ["GJ905"]
    assert gus.controller.names()[:1] == ["GT_Open"]
    assert "GT_SetHSIOOpt" not in gus.controller.names()
    gus.controller.release()


def test_a_stage_that_was_started_early_is_started_again() -> None:
    """A listing that starts first and sends then: what is left of it has a start of its own, behind its rows."""
    text = (
        "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\n"
        "GT_LnXY(1,10,0,50,2,0,0)\nGT_CrdStart(1,0)\nGT_LnXY(1,20,0,50,2,0,0)\nGT_LnXY(1,30,0,50,2,0,0)\n"
        "GT_CrdStatus(1,run,segment,0)\n"
    )
    source, _ = check_text(text.encode(), "early.gts")
    assert source is not None
    part = rest(read_listing(source)[0], Place(row=2))
    behind = [(call.name, call.at) for call in part.stream.calls]
    assert behind[-2:] == [("GT_CrdStart", 2), ("GT_CrdStatus", 2)]
    assert len(part.stream.buffered) == 2  # The way, and the last line.


def test_a_controller_that_did_something_else_meanwhile_is_not_asked(gus: Bench) -> None:
    """Its head lies on the path, but it has done fewer calls than it had: they are not those of this run."""
    text = MARK + "LASER POWER 40\nLASER ON\n" + "LINE X 5\nLINE X 0\n" * 10 + "LASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)

    def tick(control: Control) -> None:
        if control.view.row > 12 and not control.stop:
            control.ask_stop("test", abrupt=True)

    ran = gus.run(stream, machine, tick=tick)
    lines = ran.journal.read_bytes().splitlines(keepends=True)
    killed = ran.journal.with_suffix(".killed")
    killed.write_bytes(b"".join(line for line in lines if b'"broken"' not in line and b'"end"' not in line))
    gus.controller.reset()
    gus.controller.options(poll_us=40_000, call_us=5)
    assert gus.run(stream_of(MARK + "LINE X 5\n"), machine).faults == []
    again, place = gus.resumed(stream, machine, killed)
    assert (place, again.codes) == (None, ["GJ914"])


def test_a_channel_that_changes_its_mode_is_forecast_in_each_unit() -> None:
    text = MARK + "LASER POWER 40\nLASER ON\nLINE X 5\nLASER OFF\nLASER MODE ANALOG MAX 8\nLASER POWER 3\n"
    stream = stream_of(text + "LASER ON\nLINE X 9\nLASER OFF\n")
    trace, _ = simulate_stream(stream, Machine())
    assert trace is not None
    found = {channel.unit: channel.left(0)[1] for channel in forecast(stream, trace, Machine()).channels}
    assert found == {"%": 40, "V": 3}
