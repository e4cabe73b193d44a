"""Find where a run was interrupted, from its journal and, if necessary, from the controller."""

from __future__ import annotations

from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.driver.link import BackendError, failure
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, TimedPath
from gusjob.controllers.gus.remainder import Remainder, point_pulse, remainder_from
from gusjob.controllers.journal.reader import RecordedRun
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase


def recorded_position(recorded: RecordedRun) -> PathPosition | None:
    """Return the position that the journal alone determines; None if the controller must be read."""
    end = recorded.end
    if end is not None and end["end"] == "done":
        return PathPosition(row=end["row"])
    if end is not None and end["sure"]:
        return PathPosition(row=end["row"], along_pulse=end["run"])
    if end is None and recorded.broken is not None:
        return PathPosition(row=recorded.broken[0], along_pulse=recorded.broken[1])
    if recorded.sent == 0:
        return PathPosition(row=recorded.begin[0], along_pulse=recorded.begin[1])
    return None


def find_position(session: Session, recorded: RecordedRun) -> PathPosition:
    """Find where a run was interrupted from the calls that the controller took and the position of the head.

    After a process was killed the controller continues with what is in its FIFO. One more row may have been taken than
    the journal has.

    Raises:
        BackendError: the controller does not know, as when it was restarted since. A guess would leave something out or
            mark it twice.
    """
    part, stage = recorded_remainder(session.stream, recorded), recorded.stage
    if not stage.filled:
        # What was sent before had ended before this stage was cleared.
        return part.job_position(PathPosition(row=recorded.sent))
    calls = part.stream.buffered
    crd, fifo = float(calls.crd[recorded.sent - 1]), float(calls.fifo[recorded.sent - 1])
    first = max((c.at for c in part.stream.calls if c.name == "GT_CrdClear" and c.at < recorded.sent), default=0)
    try:
        _, segment = session.link.checked("GT_CrdStatus", crd, 0.0, 0.0, fifo)
        (space,) = session.link.checked("GT_CrdSpace", crd, 0.0, fifo)
        x, y = session.position(int(crd))
    except BackendError as error:
        raise _unknown(recorded, error.faults[0].phrase) from error
    queued = stage.slots - int(space)
    if queued == 0 and (segment == 0 or segment < stage.segment):
        raise _unknown(recorded, Phrase("it was restarted since"))
    path = TimedPath.of(calls, part.start_pulse)
    taken = max(recorded.sent - queued, first)
    position = path.locate(taken, taken, x, y)
    if not position.sure:
        why = Phrase("the head is at X {x} Y {y} pulse, not on the path", x=f"{x:.0f}", y=f"{y:.0f}")
        raise _unknown(recorded, why)
    if position.row < first:
        return part.job_position(PathPosition(row=first))
    return part.job_position(path.rewind(position, session.overrun_ms))


def recorded_remainder(stream: Stream, recorded: RecordedRun) -> Remainder:
    """Rebuild the remainder that a journal recorded last."""
    begin = PathPosition(row=recorded.begin[0], along_pulse=recorded.begin[1])
    if begin == JOB_START and recorded.lead == 0:
        return Remainder(stream=stream)
    part = remainder_from(stream, begin)
    # If the head was there already, there was no jump to it.
    at_position = point_pulse(stream.buffered, begin)
    return part if part.lead_rows == recorded.lead else remainder_from(stream, begin, at_position)


def _unknown(recorded: RecordedRun, why: str) -> BackendError:
    stage = recorded.stage
    return failure(rules.POSITION_UNKNOWN, stage.line, why=why, calls=stage.queued)
