"""Requests to stop and pause, and whatever else ends a run."""

from __future__ import annotations

import json
import time

import pytest
from support.controller import Row, needs_controller
from support.hardware import (
    LONG,
    LONG_WITH_DWELL,
    Bench,
    RequestAt,
    continues,
    fresh,
    is_safe,
    laser_off_at,
    recorded,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Interlock, Machine
from gusjob.controllers.control import Control, Phase

pytestmark = needs_controller


class RequestAndContinue:
    """Asks for something once a run has come to a row."""

    def __init__(self, row: int, ask: str, again: float = 0.0) -> None:
        self.row, self.ask, self.again, self.asked_s, self.paused = row, ask, again, 0.0, 0

    def __call__(self, control: Control) -> None:
        if not self.asked_s and control.status.phase is Phase.RUNNING and control.status.row >= self.row:
            self.asked_s = time.perf_counter()
            control.toggle_pause() if self.ask == "pause" else control.request_stop("test", abrupt=self.ask == "abrupt")
        if self.ask == "pause" and control.status.phase is Phase.PAUSED and not self.paused:
            self.paused = control.status.row
            control.toggle_pause()


@pytest.mark.parametrize("ask", ["smooth", "abrupt"])
@pytest.mark.parametrize("row", [5, 25, 50, 62])
def test_a_stopped_run_is_resumed(gus: Bench, ask: str, row: int) -> None:
    stream, machine = stream_of(LONG_WITH_DWELL), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    fresh(gus)
    gus.controller.option("poll_us", 3_000)
    ran = gus.run(stream, machine, tick=RequestAndContinue(row, ask))
    assert ran.codes == ["GJ911"]
    assert "test" in ran.faults[0].message
    assert is_safe(gus)
    assert ran.session.broken is not None
    done = gus.controller.rows()
    again, place = gus.resumed(stream, machine, ran.journal)
    assert again.faults == []
    assert place is not None
    assert place.row >= row - 1
    rest_of = gus.controller.rows()[len(done) :]
    if ask == "abrupt":
        assert not isinstance(continues(whole, rest_of, laser_off_at(done, gus.controller.edges()[:0])), str)
    # All that was to be marked was marked, and next to nothing twice.
    lit = sum(float(r[r[:, Row.EMISSION0_MS] > 0, Row.POWER0_MS].sum()) for r in (done, rest_of))
    assert lit >= float(whole[:, Row.POWER0_MS].sum()) * 0.999


@pytest.mark.parametrize("row", [5, 25, 62])
def test_a_paused_run_continues(gus: Bench, row: int) -> None:
    stream, machine = stream_of(LONG_WITH_DWELL), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    fresh(gus)
    gus.controller.option("poll_us", 3_000)
    asking = RequestAndContinue(row, "pause")
    ran = gus.run(stream, machine, tick=asking)
    assert ran.faults == []
    assert asking.paused >= row - 1
    rows = gus.controller.rows()
    assert rows[-1, [Row.X1, Row.Y1]].tolist() == whole[-1, [Row.X1, Row.Y1]].tolist()
    assert len(rows) > len(whole)
    lit_ms, wanted_ms = rows[:, Row.EMISSION0_MS].sum(), whole[:, Row.EMISSION0_MS].sum()
    assert wanted_ms * 0.99 < lit_ms < wanted_ms * 1.2
    if row > 60:  # In the dwell, which is run again.
        assert (rows[:, Row.KIND] == 3).sum() == 2


def test_a_stop_during_a_pause(gus: Bench) -> None:
    """What goes on is what was left when the light went off, not where the smooth stop came to rest."""
    text = MARK + "VEL 50\nACC 500\nLASER POWER 40\nLASER ON\nLINE X 100\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)

    def tick(control: Control) -> None:
        if control.status.phase is Phase.PAUSED:
            control.request_stop("test")
        elif control.status.x_pulse > 40_000 and not control.pause:
            control.toggle_pause()

    ran = gus.run(stream, machine, tick=tick)
    assert ran.codes == ["GJ911"]
    done, place = gus.controller.rows(), ran.session.reached
    # v^2 / 2a = 50^2 / (2 * 0.5) pulse from where the light went off.
    assert done[0, Row.LENGTH] - place.along_pulse == pytest.approx(2500, abs=100)
    assert gus.resumed(stream, machine, ran.journal)[0].faults == []
    way, left = gus.controller.rows()[1:]
    assert way[Row.EMISSION0_MS] == 0
    assert left[Row.LENGTH] == pytest.approx(100_000 - place.along_pulse, abs=1)
    assert left[Row.EMISSION0_MS] > 0


def test_an_exception_of_tick_shuts_down_first(gus: Bench) -> None:
    def tick(control: Control) -> None:
        if control.status.row > 10:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        gus.run(stream_of(LONG_WITH_DWELL), gus.machine(Machine()), tick=tick)
    assert is_safe(gus)


def test_a_closed_terminal_ends_the_run(gus: Bench) -> None:
    def tick(control: Control) -> None:
        if control.status.row > 10:
            raise BrokenPipeError

    ran = gus.run(stream_of(LONG_WITH_DWELL), gus.machine(Machine()), tick=tick)
    assert ran.codes == ["GJ911"]
    assert is_safe(gus)


def test_the_interlock_is_checked_during_a_pause(gus: Bench) -> None:
    machine = gus.machine(Machine(), interlock=Interlock(di_type=4, input=0, value=1))
    fresh(gus, poll_us=3_000, di=1)
    asking, ticks = RequestAt(10, "pause"), [0]

    def tick(control: Control) -> None:
        asking(control)
        if control.status.phase is Phase.PAUSED:
            ticks[0] += 1
            gus.controller.option("di", 0)
            if ticks[0] == 10:  # It was not noticed.
                control.request_stop("the test", abrupt=True)

    assert gus.run(stream_of(LONG), machine, tick=tick).codes == ["GJ910"]


def test_the_laser_is_switched_off_again_during_a_pause(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)
    asking, lit = RequestAt(10, "pause"), list[bool]()

    def tick(control: Control) -> None:
        asking(control)
        if control.status.phase is Phase.PAUSED:
            if not lit:
                gus.controller.library.GT_SetHSIOOpt(1, 0)
            else:
                control.toggle_pause()
            lit.append(any(gus.controller.state().switched_on))

    assert gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick).faults == []
    assert len(lit) >= 2
    assert not lit[-1]


def test_a_run_continues_without_a_jump_where_it_was_paused(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)
    assert gus.run(stream_of(LONG), gus.machine(Machine())).faults == []
    whole = gus.controller.rows()
    fresh(gus, poll_us=3_000)
    asking = RequestAt(10, "pause")

    def tick(control: Control) -> None:
        asking(control)
        if control.status.phase is Phase.PAUSED:
            control.toggle_pause()

    ran = gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick)
    assert ran.faults == []
    (paused,) = [line for line in recorded(ran) if "broken" in line]
    parts = [line for line in recorded(ran) if "part" in line]
    assert [(line["part"], line["run"]) for line in parts] == [(0, 0), (paused["broken"], paused["run"])]
    lit_ms = gus.controller.rows()[:, Row.EMISSION0_MS].sum()
    assert lit_ms == pytest.approx(whole[:, Row.EMISSION0_MS].sum(), rel=0.05)


def test_the_journal_of_a_run_with_a_bug_ends_as_failed(gus: Bench) -> None:
    folder_before = set(gus.folder.glob("*.journal"))

    def tick(control: Control) -> None:
        if control.status.row > 10:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        gus.run(stream_of(LONG), gus.machine(Machine()), tick=tick)
    (journal,) = set(gus.folder.glob("*.journal")) - folder_before
    end = json.loads(journal.read_bytes().splitlines()[-1])
    assert end["end"] == "failed"
