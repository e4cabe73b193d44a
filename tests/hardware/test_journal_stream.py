"""A journal as a stream: its report is what was run."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.controller import Fault, Row, needs_controller
from support.hardware import (
    EVERYTHING,
    Bench,
    BenchRun,
    RequestAt,
    fresh,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.model import simulate_stream
from gusjob.frontend import check_text
from gusjob.hardware.journal_stream import journal_stream

pytestmark = needs_controller


@pytest.mark.parametrize("how", ["stopped", "paused", "gone on"])
def test_the_report_of_a_journal_is_what_was_run(gus: Bench, how: str) -> None:
    """Radius arcs under way when it ends: the report's light and path are the controller's, up to where light ended."""
    text = MARK + "VEL 50\nLASER POWER 40\nLASER ON\n" + "ARC CW X 20 R 10\nARC CW X 0 R 10\n" * 4 + "LASER OFF\n"
    stream, machine = stream_of(text), gus.machine(Machine())
    fresh(gus, poll_us=3_000)
    asking = RequestAt(4, "pause" if how == "paused" else "abrupt")

    def tick(control: Control) -> None:
        asking(control)
        if control.status.phase is Phase.PAUSED:
            control.toggle_pause()

    ran = gus.run(stream, machine, tick=tick)
    if how == "gone on":
        fresh(gus, poll_us=3_000)
        ran = gus.run(stream, machine, begin=ran.session.reached, tick=RequestAt(7, "abrupt"))
    done = gus.controller.rows()
    source, _ = check_text(ran.journal.read_bytes(), "x.journal")
    assert source is not None
    sent, faults = journal_stream(source)
    assert faults == [] and sent is not None
    trace, found = simulate_stream(sent, machine, is_listing=True)
    assert trace is not None
    assert {fault.rule.severity.name for fault in found} <= {"WARNING", "NOTE"}
    light_ms = sum(float(channel.emitted.emission_ms.sum()) for channel in trace.channels)
    assert light_ms == pytest.approx(done[:, Row.EMISSION0_MS].sum(), rel=0.02)
    length = float(trace.segments.length.sum())
    assert length == pytest.approx(done[:, Row.LENGTH].sum(), rel=0.02)
    assert set(sent.buffered.line.tolist()) <= set(stream.buffered.line.tolist())


def reported(ran: BenchRun, machine: Machine) -> tuple[Stream, float]:
    """A journal as a stream, and the length of its path, pulse."""
    source, _ = check_text(ran.journal.read_bytes(), "x.journal")
    assert source is not None
    sent, faults = journal_stream(source)
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
                control.request_stop("test", abrupt=True)

        return tick

    first = gus.run(stream, machine, tick=after(250))
    assert first.session.reached.row == row
    done = gus.controller.rows()
    assert reported(first, machine)[1] == pytest.approx(done[:, Row.LENGTH].sum(), rel=0.05, abs=300)
    ran_ms = gus.controller.state().running
    again = gus.run(stream, machine, begin=first.session.reached, tick=after(ran_ms + 250))
    assert again.session.reached.row == row
    assert again.session.reached.along_pulse > first.session.reached.along_pulse
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
