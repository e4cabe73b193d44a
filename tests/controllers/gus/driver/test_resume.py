"""Resuming: from the journal alone, and from what the controller knows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.controller import Row, needs_controller
from support.hardware import (
    EVERYTHING,
    LONG,
    MARK_FIRST,
    SYSTEM_2,
    Bench,
    BenchRun,
    RequestAt,
    fresh,
    listed,
    recorded,
)
from support.journals import bare_lines, with_checksums
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.driver.resume import recorded_range
from gusjob.controllers.gus.path_position import PathPosition, PositionRange
from gusjob.controllers.journal.reader import read_journal

pytestmark = needs_controller


def test_a_run_is_resumed_twice(gus: Bench) -> None:
    """A run that goes on breaks again, within the row in which it began: the place is the whole job's."""
    text = MARK + "VEL 50\nLASER POWER 40\nLASER ON\nLINE X 40\nLINE X 40 Y 1\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, poll_us=2_000)

    def at(x: float) -> Callable[[Control], None]:
        def tick(control: Control) -> None:
            if control.status.phase is Phase.RUNNING and control.status.x_pulse >= x and not control.stop:
                control.request_stop("test", abrupt=True)

        return tick

    first = gus.run(stream, machine, tick=at(2000))
    assert first.codes == ["GJ911"]
    lit = gus.controller.rows()[:, Row.POWER0_MS].sum()
    reached = [first.session.reached]
    journal = first.journal
    for x in (12_000, 24_000):
        place = reached[-1]
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
    along = [place.along_pulse for place in reached]
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


def test_the_journal_of_a_run_that_was_done(gus: Bench) -> None:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    ran = gus.run(stream, machine)
    assert ran.faults == []
    end = recorded(ran)[-1]
    assert (end["end"], end["row"], end["faults"]) == ("done", len(stream.buffered), [])


def as_if_killed(ran: BenchRun) -> Path:
    """Its journal without the end, as a process leaves it that is killed."""
    lines = bare_lines(ran.journal.read_bytes())
    off = max(number for number, line in enumerate(lines) if b'"off":true' in line)
    path = ran.journal.with_suffix(".killed")
    path.write_bytes(with_checksums(lines[:off]) + b'{"t":1.0,"code":0,"row"')
    return path


@pytest.mark.parametrize(
    "before",
    [
        "LINE X 5\nLINE X 0\n",
        "LINE X 5\n",
    ],
)
@pytest.mark.parametrize("how", ["stopped", "killed"])
def test_a_remainder_without_a_jump_is_resumed(gus: Bench, before: str, how: str) -> None:
    """Stopped in a dwell, where the head rests; gone on with from there and broken; gone on with once more."""
    text = MARK + "VEL 50\nLASER POWER 40\n" + before + "DWELL 3000\nLASER ON\nLINE X 40\nLINE X 0\nLASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, poll_us=2_000)
    dwell = int(np.flatnonzero(stream.buffered.kind == Buffered.DELAY)[0])
    first = gus.run(stream, machine, tick=RequestAt(dwell, "abrupt"))
    assert first.session.reached == PathPosition(row=dwell)

    def tick(control: Control) -> None:
        if control.status.phase is Phase.RUNNING and control.status.x_pulse >= 15_000 and not control.stop:
            control.request_stop("test", abrupt=True)

    again = gus.run(stream, machine, begin=first.session.reached, tick=tick)
    assert again.codes == ["GJ911"]
    assert [line["lead"] for line in recorded(again) if "part" in line] == [1]  # Its power; no way.
    x, begun = gus.controller.state().x, 0.0 if "X 0" in before else 5000.0
    last, place = gus.resumed(stream, machine, again.journal if how == "stopped" else as_if_killed(again))
    assert last.faults == []
    assert place is not None
    assert place.row == dwell + 2
    assert x - begun - 2 - 50 * 25 < place.along_pulse < x - begun + 2


def test_a_controller_that_was_restarted_or_moved_is_an_error(gus: Bench) -> None:
    stream, machine = stream_of(LONG), gus.machine(Machine())
    fresh(gus, poll_us=3_000)
    killed = as_if_killed(gus.run(stream, machine, tick=RequestAt(20, "abrupt")))
    gus.controller.option("pos_error", 500)
    ran, place = gus.resumed(stream, machine, killed)
    assert (place, ran.codes) == (None, ["GJ914"])
    assert "not on the path" in ran.faults[0].message
    fresh(gus)
    ran, place = gus.resumed(stream, machine, killed)
    assert (place, ran.codes) == (None, ["GJ914"])


def test_a_run_killed_during_a_pause_is_resumed_where_the_laser_went_off(gus: Bench) -> None:
    ran = gus.run(stream_of(MARK_FIRST), gus.machine(Machine()))
    lines = [line for line in bare_lines(ran.journal.read_bytes()) if b'"end"' not in line]
    broken = b'{"t":1.5,"broken":2,"run":1234.5,"to":[2,1240.0],"line":9}'
    ran.journal.write_bytes(with_checksums([*lines, broken]))
    recorded = read_journal(ran.journal)
    assert not isinstance(recorded, str)
    earliest, latest = PathPosition(row=2, along_pulse=1234.5), PathPosition(row=2, along_pulse=1240.0)
    assert recorded_range(recorded, stream_of(MARK_FIRST)) == PositionRange(earliest=earliest, latest=latest)


def test_a_controller_that_did_something_else_in_the_meantime_is_an_error(gus: Bench) -> None:
    """Its head lies on the path, but it has done fewer calls than it had: they are not those of this run."""
    text = MARK + "LASER POWER 40\nLASER ON\n" + "LINE X 5\nLINE X 0\n" * 10 + "LASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    gus.controller.option("poll_us", 3_000)

    def tick(control: Control) -> None:
        if control.status.row > 12 and not control.stop:
            control.request_stop("test", abrupt=True)

    ran = gus.run(stream, machine, tick=tick)
    killed = as_if_killed(ran)
    gus.controller.reset()
    gus.controller.options(poll_us=40_000, call_us=5)
    assert gus.run(stream_of(MARK + "LINE X 5\n"), machine).faults == []
    again, place = gus.resumed(stream, machine, killed)
    assert (place, again.codes) == (None, ["GJ914"])


@pytest.mark.parametrize("freed", [0, 1])
@pytest.mark.parametrize("counts_all", [0, 1])
def test_a_stage_of_one_motion_is_resumed(gus: Bench, freed: int, counts_all: int) -> None:
    """In its motion no call of it may have ended, and none may be in the FIFO."""
    text = SYSTEM_2.replace("GT_BufLaserPrfCmd(2,40,1,0)\nGT_BufLaserOn(2,1,0)\n", "GT_LaserPrfCmd(40,0)\n")
    text = text.replace("GT_CrdClear", "GT_SetHSIOOpt(1,0)\nGT_CrdClear")
    stream = listed(text + "GT_LnXY(2,40000,0,50,10,0,1)\nGT_CrdStart(2,2)\nGT_CrdStatus(2,run,segment,1)\n")
    machine = gus.machine(Machine())
    fresh(gus, poll_us=3_000, slot_freed_at_start=freed, segment_counts_all=counts_all)

    def tick(control: Control) -> None:
        if control.status.phase is Phase.RUNNING and control.status.x_pulse >= 9000 and not control.stop:
            control.request_stop("test", abrupt=True)

    killed = as_if_killed(gus.run(stream, machine, tick=tick))
    stopped_x = gus.controller.state().x
    again, position = gus.resumed(stream, machine, killed)
    assert again.faults == []
    assert position is not None
    assert 0 <= position.along_pulse <= stopped_x
    assert gus.controller.rows()[-1, Row.X1] == 40_000
