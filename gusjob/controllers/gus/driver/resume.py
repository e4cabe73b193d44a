"""Where a run broke: from its journal, and from the controller if it still knows."""

from __future__ import annotations

from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.driver.link import BackendError, failure
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, TimedPath
from gusjob.controllers.gus.remainder import Remainder, point_pulse, remainder_from
from gusjob.controllers.journal import RecordedRun
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase


def recorded_position(recorded: RecordedRun) -> PathPosition | None:
    """The place that the journal itself is sure of, else None: then the controller has to be asked."""
    end = recorded.end
    if end is not None and end["end"] == "done":
        return PathPosition(row=end["row"])
    if end is not None and end["sure"]:
        return PathPosition(row=end["row"], run_pulse=end["run"])
    if end is None and recorded.broken is not None:
        return PathPosition(row=recorded.broken[0], run_pulse=recorded.broken[1])
    if recorded.sent == 0:
        return PathPosition(row=recorded.begin[0], run_pulse=recorded.begin[1])
    return None


def find_position(session: Session, recorded: RecordedRun) -> PathPosition:
    """Where the run broke, as the controller has it: how many calls it took, and where the head is.

    After a process was killed the controller goes on with what is in its FIFO. One more row may have been taken than
    the journal has. If the controller was started anew since, it knows nothing: an error, for guessing would leave
    something out or mark it twice.
    """
    part, stage = recorded_remainder(session.stream, recorded), recorded.stage
    if not stage.filled:
        # What was sent before was seen to its end, before this stage was cleared.
        return part.place(PathPosition(row=recorded.sent))
    calls = part.stream.buffered
    crd, fifo = float(calls.crd[recorded.sent - 1]), float(calls.fifo[recorded.sent - 1])
    first = max((c.at for c in part.stream.calls if c.name == "GT_CrdClear" and c.at < recorded.sent), default=0)
    try:
        _, segment = session.link.must("GT_CrdStatus", crd, 0.0, 0.0, fifo)
        (space,) = session.link.must("GT_CrdSpace", crd, 0.0, fifo)
        x, y = session.position(int(crd))
    except BackendError as error:
        raise _unknown(recorded, error.faults[0].phrase) from error
    queued = stage.slots - int(space)
    if queued == 0 and (segment == 0 or segment < stage.segment):
        raise _unknown(recorded, Phrase("it was started anew since"))
    route = TimedPath.of(calls, part.start)
    taken = max(recorded.sent - queued, first)
    place = route.place(taken, taken, x, y)
    if not place.sure:
        why = Phrase("the head is at X {x} Y {y} pulse, not on the path", x=f"{x:.0f}", y=f"{y:.0f}")
        raise _unknown(recorded, why)
    if place.row < first:
        return part.place(PathPosition(row=first))
    return part.place(route.back(place, session.ran_on_ms))


def recorded_remainder(stream: Stream, recorded: RecordedRun) -> Remainder:
    """The part that a journal recorded last."""
    begin = PathPosition(row=recorded.begin[0], run_pulse=recorded.begin[1])
    if begin == JOB_START and recorded.lead == 0:
        return Remainder(stream=stream)
    part = remainder_from(stream, begin)
    # Where the head was there already, there was no way to it.
    return part if part.lead == recorded.lead else remainder_from(stream, begin, point_pulse(stream.buffered, begin))


def _unknown(recorded: RecordedRun, why: str) -> BackendError:
    stage = recorded.stage
    return failure(rules.PLACE_UNKNOWN, stage.line, why=why, calls=stage.queued)
