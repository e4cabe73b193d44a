"""Runs of streams on the virtual controller, in this process, and what it saw."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from msgspec.structs import replace
from support.controller import GTS, GTS_MULTI, GUS, Edge, Floats, Row, VirtualController, build
from support.tools import MARK

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.doubling import before_laser_on
from gusjob.controllers.gus.driver.library import Library, load_library
from gusjob.controllers.gus.driver.link import Link
from gusjob.controllers.gus.driver.requirements import needed_calls, outputs_of
from gusjob.controllers.gus.driver.resume import find_range, recorded_range
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.path_position import PathPosition, PositionRange
from gusjob.controllers.gus.remainder import Remainder, remainder_from, whole_job
from gusjob.controllers.journal.reader import read_journal
from gusjob.controllers.journal.writer import Journal
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend import check_text, read_listing
from gusjob.hardware.supervisor import Supervisor

ABIS = {GUS: Abi.GUS, GTS: Abi.GTS, GTS_MULTI: Abi.GTS_MULTI}
EVERYTHING = (
    "LASER DELAY ON 50us OFF 60us\nLASER STANDBY FREQ 5 DUTY 2\n"
    + MARK
    + """LASER POWER 40
JUMP X -5 Y 0
LASER ON
LINE X 5
LINE X 5 Y 3
LASER OFF
LASER POWER 25 NOW
LASER FPK WIDTH 10us GAP 20us OFFDELAY 5us
LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 0 MIN 0 MAX 100
LASER ON
ARC CCW I 5 J 0
DWELL 3
LASER FOLLOW MIN 5 MAX 60 AT 100
ARC CW X 8 Y 3 R 4
LASER OFF
LASER FPK OFF
LASER MODE FREQUENCY WIDTH 5us CHANNEL 1
LASER POWER 20 CHANNEL 1
LASER ON CHANNEL 1
LINE X 1 Y 2
LASER OFF CHANNEL 1
"""
)
"""Every buffered call, nearly every other one, three stages, two channels."""

_numbers = itertools.count()


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchRun:
    """A run with its faults, session and journal."""

    faults: list[Diagnostic]
    session: Session
    journal: Path

    @property
    def codes(self) -> list[str]:
        return [fault.rule.code for fault in self.faults]


@dataclass(slots=True)
class Bench:
    """A virtual controller on the bench. The machine has short patience, so that tests are short."""

    path: Path
    folder: Path
    abi: int = GUS
    controller: VirtualController = field(init=False)

    def __post_init__(self) -> None:
        self.controller = VirtualController(self.path)

    def machine(self, machine: Machine, **changes: Any) -> Machine:
        quick: dict[str, Any] = {"abi": ABIS[self.abi], "call_timeout_s": 0.5, "link_patience_s": 0.1}
        return replace(machine, controller=replace(machine.controller, **(quick | changes)))

    def library(self, stream: Stream, machine: Machine) -> Library:
        abi = machine.controller.abi or ABIS[self.abi]
        library, faults = load_library(str(self.path), abi, machine.controller.card, needed_calls(stream, machine))
        assert library is not None, faults
        return library

    def run(
        self,
        stream: Stream,
        machine: Machine,
        part: Callable[[Session], Remainder | None] | None = None,
        *,
        begin: PathPosition | None = None,
        tick: Callable[[Control], None] | None = None,
        resumes: Path | None = None,
    ) -> BenchRun:
        """Run a stream as run_on does it."""
        first = begin or PathPosition(row=0)
        journal = Journal(self.folder / f"{next(_numbers)}.journal", journal_head(first, stream, resumes))
        control = Control()
        session = Session(
            link=Link(self.library(stream, machine), journal),
            machine=machine,
            control=control,
            stream=stream,
            outputs=outputs_of(stream),
        )
        supervisor = Supervisor(session, (lambda: tick(control)) if tick else (lambda: None))

        def default_part(session: Session) -> Remainder:
            head_pulse = session.position_or_none()
            return whole_job(stream, head_pulse) if begin is None else remainder_from(stream, begin, head_pulse)

        try:
            outcome = supervisor.run(part or default_part)
        finally:
            journal.close()
        return BenchRun(faults=outcome.faults, session=session, journal=journal.path)

    def resumed(self, stream: Stream, machine: Machine, journal: Path) -> tuple[BenchRun, PathPosition | None]:
        """Continue the run of a journal as run_on does it."""
        recorded = read_journal(journal)
        assert not isinstance(recorded, str), recorded
        where = recorded_range(recorded, stream)
        if where is None:
            found: list[PositionRange] = []
            ran = self.run(stream, machine, lambda session: found.append(find_range(session, recorded)))
            if not found or ran.faults:
                return ran, None
            where = found[0]
        return self.run(stream, machine, begin=before_laser_on(stream, where.earliest)), where.earliest


def journal_head(begin: PathPosition, stream: Stream, resumes: Path | None = None) -> dict[str, Any]:
    """Return the first line of a journal, as run_on writes it."""
    return {
        "job": "test.job",
        "calls": "",
        "rows": len(stream.buffered),
        "options": "",
        "begin": [*begin.key, *begin.key],
        "resumes": None if resumes is None else str(resumes),
    }


def bench(folder: Path, abi: int = GUS, *flags: str) -> Bench:
    """Build a virtual controller of an ABI into a folder."""
    return Bench(build(folder, abi, *flags), folder, abi)


@dataclass(frozen=True, slots=True, kw_only=True)
class Interruption:
    """Where the laser of an interrupted run went off: segment of the whole path, and the distance along it, pulse."""

    segment: int
    along: float


def laser_off_at(rows: Floats, edges: Floats) -> Interruption:
    """Return where the laser of a run from the job's start went off last, or where the motion ended if it was off.

    For an abrupt stop: after the laser went off the motion has the velocity of the end.
    """
    if not len(rows):
        return Interruption(segment=0, along=0.0)
    last = len(rows) - 1
    along = rows[last, Row.LENGTH]
    off_ms = edges[-1, Edge.RUNNING_MS] if len(edges) else -1.0
    end_ms = rows[last, Row.START_MS] + rows[last, Row.DURATION_MS]
    if off_ms >= rows[last, Row.START_MS]:
        along -= rows[last, Row.V1] * (end_ms - off_ms)
    if rows[last, Row.COMPLETED] and rows[last, Row.LENGTH] - along < 1:
        return Interruption(segment=last + 1, along=0.0)
    return Interruption(segment=last, along=float(along))


def continues(expected: Floats, rows: Floats, interruption: Interruption) -> tuple[int, float] | str:
    """Check that a run continues an interrupted one and runs the rest of the path.

    Args:
        expected: rows of a whole run.
        rows: rows of the run that continues, to the end. It may begin up to one segment earlier, never later.
        interruption: where the first run was interrupted.

    Returns:
        Its first segment and the distance along it, or what is wrong.
    """
    if not len(rows):
        return (len(expected), 0.0) if interruption.segment >= len(expected) else "nothing ran"
    reason = "its rows are not the rest of the path"
    for jump in (1, 0):  # With a jump to where it begins, or without.
        pieces = rows[jump:]
        segment = len(expected) - len(pieces)
        if segment < 0 or (jump and rows[0, [Row.EMISSION0_MS, Row.EMISSION1_MS]].any()):
            continue
        rest = expected[segment:]
        ends = np.abs(pieces[:, [Row.X1, Row.Y1]] - rest[:, [Row.X1, Row.Y1]]).max(initial=0)
        starts = np.abs(pieces[1:, [Row.X0, Row.Y0]] - rest[1:, [Row.X0, Row.Y0]]).max(initial=0)
        if max(ends, starts) > 1.5:
            continue
        along = float(rest[0, Row.LENGTH] - pieces[0, Row.LENGTH]) if len(pieces) else 0.0
        if (segment, along) > (interruption.segment, interruption.along + 2):
            reason = f"it leaves out from {interruption} to {segment}, {along}"
        elif segment < interruption.segment - 1 or (segment < interruption.segment and along + 1 < 0):
            reason = f"it repeats from {segment}, {along} to {interruption}"
        else:
            return segment, along
    return reason


# Shared by the tests of driver and run.


def fresh(made: Bench, **options: float) -> None:
    """Switch a controller off and on again, in virtual time."""
    made.controller.reset()
    made.controller.options(**({"poll_us": 40_000, "call_us": 5} | options))


def is_safe(made: Bench) -> bool:
    """Return whether the controller's lasers are off and nothing moves."""
    state = made.controller.state()
    return not any(state.emitting) and not any(state.switched_on) and state.moving == 0


def listed(text: str) -> Stream:
    """Read a listing."""
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    stream, faults = read_listing(source)
    assert faults == []
    return stream


def recorded(ran: BenchRun) -> list[dict[str, Any]]:
    """Return the lines of a run's journal."""
    return [json.loads(line) for line in ran.journal.read_text(encoding="utf-8").splitlines()]


def made_calls(gus: Bench) -> list[str]:
    """Return the calls that were made, with arguments."""
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
    """Return lines there and back, after SYSTEM_2."""
    return "".join(f"GT_LnXY(2,{1000 * (i % 2)},{i},{vel},10,0,1)\n" for i in range(count))


END_2 = "GT_BufLaserOff(2,1,0)\nGT_CrdStart(2,2)\nGT_CrdStatus(2,run,segment,1)\n"


class RequestAt:
    """Requests a pause or stop once when a run has come to a row. `kind`: "pause", "smooth", "abrupt"."""

    def __init__(self, row: int, kind: str) -> None:
        self.row, self.kind, self.is_done = row, kind, False

    def __call__(self, control: Control) -> None:
        if not self.is_done and control.status.phase is Phase.RUNNING and control.status.row >= self.row:
            self.is_done = True
            if self.kind == "pause":
                control.toggle_pause()
            else:
                control.request_stop("test", abrupt=self.kind == "abrupt")


LONG = (
    MARK + "VEL 50\nLASER POWER 40\nLASER ON\nREPEAT 60 AS i\nLINE X (i % 2 * 3) Y (i / 10)\nEND\nLASER OFF\n"
)  # fmt: skip


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

LONG_WITH_DWELL = (
    MARK
    + "VEL 50\nLASER POWER 40\nLASER ON\nREPEAT 60 AS i\nLINE X (i % 2 * 3) Y (i / 10)\nEND\n"
    + "DWELL 400\nLINE X 9\nLASER OFF\n"
)

MARK_FIRST = MARK + "LASER POWER 40\nLASER ON\nLINE X 5\nLINE X 5 Y 5\nLASER OFF\n"
