"""Find where a run was interrupted, from its journal and, if necessary, from the controller."""

from __future__ import annotations

import math

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Stream
from gusjob.controllers.gus.driver.link import BackendError, failure
from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.gus.path_position import JOB_START, NEAR_PULSE, PathPosition, PositionRange, TimedPath
from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.gus.remainder import Remainder, point_pulse, remainder_from
from gusjob.controllers.journal.reader import RecordedPart, RecordedRun
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase


def recorded_range(recorded: RecordedRun, stream: Stream) -> PositionRange | None:
    """Return where the laser went off if the journals alone determine it; None if the controller must be read."""
    if recorded.done:
        return PositionRange.exactly(PathPosition(row=len(stream.buffered)))
    if recorded.broken is not None:
        earliest, latest = (PathPosition(row=row, along_pulse=along) for row, along in recorded.broken)
        return PositionRange(earliest=earliest, latest=latest)
    part = recorded.part
    if part is None:
        return None
    remainder = recorded_remainder(stream, part)
    is_cut = recorded.off and recorded.off_ms is None
    if part.is_over and _is_at_end(remainder.stream.buffered, part):
        end = PathPosition(row=part.sent)
        path = TimedPath.of(remainder.stream.buffered, remainder.start_pulse)
        earliest = _polled(part, path) if is_cut else end
        return remainder.job_range(PositionRange(earliest=earliest, latest=end)).until(_marked_to(part))
    if part.started or recorded.torn:
        return None
    # What was sent before this stage had ended before the stage was cleared.
    position = remainder.job_position(PathPosition(row=part.first))
    return PositionRange.exactly(position).until(_marked_to(part))


def find_range(session: Session, recorded: RecordedRun) -> PositionRange:
    """Find where a run was interrupted from the calls that the controller took and the position of the head.

    After a process was killed the controller continues with what is in its FIFO. One more row may have been taken than
    the journal has. What was found is recorded before anything else happens.

    Raises:
        BackendError: the controller does not answer; or it does not know, as when it was restarted since. A guess would
            leave something out.
    """
    part = recorded.part
    assert part is not None
    remainder = recorded_remainder(session.stream, part)
    calls = remainder.stream.buffered
    last = min(max(part.sent, 1), len(calls)) - 1
    crd, fifo = float(calls.crd[last]), float(calls.fifo[last])
    _, segment = session.link.checked("GT_CrdStatus", crd, 0.0, 0.0, fifo)
    (space,) = session.link.checked("GT_CrdSpace", crd, 0.0, fifo)
    x, y = session.position(int(crd))
    queued = (part.slots or FIFO_SLOTS) - int(space)
    timed = np.flatnonzero(calls.kind[part.first : part.sent] <= Buffered.DELAY)
    # In its only motion no call may have ended yet.
    if queued == 0 and (segment < part.segment or (segment == 0 and len(timed) > 1)):
        raise _unknown(part, Phrase("it was restarted since then"))
    if part.segment <= part.sent - part.first < segment - 2:
        raise _unknown(
            part, Phrase("it executed more calls than the journal has: lines are missing at the end of the journal")
        )
    path = TimedPath.of(calls, remainder.start_pulse)
    taken = max(part.sent - queued, part.first)
    located = path.locate(taken, min(taken + 1, len(calls)), x, y, sent=part.sent + 1)
    if located is None:
        why = Phrase("the head is at X {x} Y {y} pulse, not on the path", x=f"{x:.0f}", y=f"{y:.0f}")
        raise _unknown(part, why)
    if queued == 0 and not session.was_moving and not recorded.off:
        located = _at_end_of_sent(path, part, located)
    # Something that is not recorded stopped the motion, and perhaps the laser before it.
    is_cut = queued > 0 and not session.was_moving and not recorded.off
    earliest = _earliest(session, recorded, path, located, is_cut=is_cut)
    if earliest.key > located.latest.key:
        raise _unknown(part, Phrase("the head moved back since then"))
    found = remainder.job_range(PositionRange(earliest=earliest, latest=located.latest)).until(_marked_to(part))
    session.note_broken(found)
    return found


def _at_end_of_sent(path: TimedPath, part: RecordedPart, located: PositionRange) -> PositionRange:
    """Narrow a range down to the end of what was sent, if it has that: a FIFO that is empty was run to its end.

    The end of a full circle is its begin as well. A call that was sent, but not recorded, may have been run after it.
    """
    ended = path.timed[(path.timed >= part.first) & (path.timed < part.sent)]
    after = path.timed[path.timed >= part.sent]
    next_row = int(after[0]) if len(after) else len(path.calls)
    is_end = len(ended) > 0 and int(ended[-1]) < located.latest.row <= next_row
    return PositionRange.exactly(located.latest) if is_end else located


def _is_at_end(calls: BufferedCalls, part: RecordedPart) -> bool:
    """Return whether the last poll found the head where the last motion ends that was sent."""
    moves = np.flatnonzero(calls.kind[: part.sent] < Buffered.DELAY)
    found = part.newest_poll
    if found is None or not len(moves):
        return False
    return math.hypot(calls.x[moves[-1]] - found.x, calls.y[moves[-1]] - found.y) <= NEAR_PULSE


def _marked_to(part: RecordedPart) -> PathPosition:
    return PathPosition(row=part.marked_to[0], along_pulse=part.marked_to[1])


def _earliest(
    session: Session, recorded: RecordedRun, path: TimedPath, located: PositionRange, *, is_cut: bool
) -> PathPosition:
    """Return the earliest position at which the laser may have been switched off.

    That is as far before the rest position as the head can have moved since, and not before the last poll that found
    the run undisturbed. If it is not known for how long the head moved, only the poll counts.
    """
    part = recorded.part
    assert part is not None
    begin = _polled(part, path)
    off_ms = recorded.off_ms if recorded.off else session.off_ms
    if is_cut or off_ms is None or (recorded.off and session.was_moving):
        return begin
    rewound = path.rewind(located.earliest, off_ms, part.first)
    return max(begin, rewound, key=lambda position: position.key)


def _polled(part: RecordedPart, path: TimedPath) -> PathPosition:
    """Return the earliest position that the last poll without a fault allows."""
    begin, poll = PathPosition(row=part.first), part.poll
    if poll is None:
        return begin
    polled = max(poll.sent - ((part.slots or FIFO_SLOTS) - poll.space), part.first)
    return max(begin, path.earliest_at(polled, poll.x, poll.y), key=lambda position: position.key)


def recorded_remainder(stream: Stream, part: RecordedPart) -> Remainder:
    """Rebuild the remainder that a journal recorded last."""
    begin = PathPosition(row=part.begin[0], along_pulse=part.begin[1])
    if begin == JOB_START and part.lead == 0:
        return Remainder(stream=stream)
    made = remainder_from(stream, begin)
    # If the head was there already, there was no jump to it.
    at_position = point_pulse(stream.buffered, begin)
    return made if made.lead_rows == part.lead else remainder_from(stream, begin, at_position)


def _unknown(part: RecordedPart, why: str) -> BackendError:
    return failure(rules.POSITION_UNKNOWN, part.line, why=why, calls=part.queued)
