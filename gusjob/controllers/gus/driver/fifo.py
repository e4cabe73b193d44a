"""Keep the controller's FIFO full: buffered calls in order, none twice, none left out.

A full FIFO refuses a call; then GT_CrdSpace is polled and the SAME call is sent again (sister). Sending is a loop in
Python since each call is a call into C; everything else is prepared by columns (prepared.py).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from msgspec import Struct

from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import BUFFERED, Buffered, Call, crd_start
from gusjob.controllers.gus.driver.link import FULL, BackendError, Link, TakenOver, call_failure, failure
from gusjob.controllers.gus.driver.prepared import PreparedCall, prepare
from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.gus.remainder import Remainder
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.units import MS_PER_S

POLL_S = 0.02
"""Interval between polls of the controller's state: 4096 slots of 10 us segments last twice as long."""
START_S = 1.0
"""Longest time after GT_CrdStart for which the axes may still be at rest."""
STILL_S = 3.0
"""Longest time, in addition to the longest dwell, without a change while the motion runs."""
_CHUNK = 1024
_TRIES = 3
"""Number of times that a call may be refused for a full FIFO although GT_CrdSpace found free slots."""
_A_CALL = Phrase("a buffered call")


class Interrupted(BaseException):
    """The user requests a pause or stop, as `control` states. It is not an error."""


class FifoStatus(Struct, frozen=True, kw_only=True):
    """The controller's state as polled: moving or not, calls done, free slots, position in pulse."""

    run: bool
    segment: int
    space: int
    x: float
    y: float


class GoodPoll(Struct, frozen=True, kw_only=True):
    """A poll that found no fault. `began_s`: time.perf_counter; `taken`: first row still in the FIFO; pulse."""

    began_s: float
    taken: int
    x: float
    y: float


class FifoStage(Struct, kw_only=True):
    """A stage in progress.

    `first`: its first row; `sent`: rows sent, counted from the stream's start; `size`: slots of the FIFO; `free`: slots
    that are certainly free.
    """

    crd: int
    fifo: int
    first: int
    sent: int
    size: int
    free: int
    line: int
    started: bool = False
    """It may be started before its GT_CrdStart, when the FIFO is full earlier."""
    may_run: bool = False
    """GT_CrdStart was called and not refused: one that was not answered may have had its effect."""
    start_s: float = 0.0
    """When GT_CrdStart was called (time.perf_counter)."""
    ran: bool = False
    since_s: float = 0.0
    """When it was started, or its status changed last."""
    last: FifoStatus | None = None
    sent_at_poll: int = 0
    good: GoodPoll | None = None
    """The last poll that found no fault."""

    @property
    def taken(self) -> int:
        """The first row that has not left the FIFO."""
        space = self.last.space if self.last else self.size
        return max(self.sent_at_poll - (self.size - space), self.first)


class Fifo:
    """Sends the rows of one stream.

    `on_status` is called after every poll, `before_start` before GT_CrdStart.
    """

    def __init__(
        self,
        link: Link,
        control: Control,
        part: Remainder,
        *,
        on_status: Callable[[FifoStage], None],
        before_start: Callable[[], None],
    ) -> None:
        self.link, self.control, self.part = link, control, part
        self.on_status, self.before_start = on_status, before_start
        self.calls = part.stream.buffered
        self.stage: FifoStage | None = None
        self.polled_s = 0.0
        self.until = 0
        """Rows before this one are to be sent before anything else."""
        dwells = self.calls.p[self.calls.kind == Buffered.DELAY] / MS_PER_S
        self.still_s = STILL_S + float(dwells.max(initial=0.0))

    # Stages.

    def begin(self, crd: int, fifo: int, row: int, line: int) -> FifoStage:
        """Begin a stage: the free slots of the empty FIFO are its size."""
        (space,) = self.link.checked("GT_CrdSpace", float(crd), 0.0, float(fifo), line=line)
        size = int(space)
        if not 0 < size <= FIFO_SLOTS:
            raise failure(
                rules.WRONG_ABI,
                line,
                library=self.link.library.path,
                abi=self.link.library.abi,
                reason=Phrase(
                    "GT_CrdSpace finds {size} free slots after GT_CrdClear, not 1 to {most}", size=size, most=FIFO_SLOTS
                ),
                hint="",
            )
        self.stage = FifoStage(
            crd=crd, fifo=fifo, first=row, sent=row, sent_at_poll=row, size=size, free=size, line=line
        )
        return self.stage

    def start(self, call: Call) -> None:
        """Make GT_CrdStart of the stage in progress."""
        self.before_start()
        if self.stage is None:
            self.link.checked(call.name, *call.args, line=call.line)
            return
        # Before the call: a process that is killed in it leaves no other trace.
        self.link.journal.mark(starting=True)
        if self.link.journal.lost:
            raise self.link.journal_failure(call.line)
        self.stage.may_run, self.stage.start_s = True, time.perf_counter()
        code, _ = self.link.call(call.name, *call.args, line=call.line)
        if code:
            self.stage.may_run = code < 0
            raise call_failure(call.name, code, call.line)
        self.stage.started, self.stage.since_s = True, time.perf_counter()
        if self.link.journal.lost:
            raise self.link.journal_failure(call.line)

    def wait_for_end(self) -> FifoStatus | None:
        """Wait until the axes are at rest and the FIFO is empty.

        Returns:
            The last status; None if nothing was started.
        """
        stage = self.stage
        if stage is None or not stage.started:
            return None
        sleep_s = POLL_S / 16  # A short stage does not wait for a long sleep.
        while True:
            status = self.poll()
            if not status.run and status.space >= stage.size:
                break
            self.control.sleep(sleep_s)
            sleep_s = min(2 * sleep_s, POLL_S)
            self.check_requests()
        stage.started = stage.ran = stage.may_run = False
        stage.first, stage.good = stage.sent, None
        return status

    def _stage_of(self, row: int) -> FifoStage:
        """Return the stage of a row. A FIFO that a listing does not clear may hold calls of an earlier run."""
        crd, fifo = int(self.calls.crd[row]), int(self.calls.fifo[row])
        if self.stage is None or (self.stage.crd, self.stage.fifo) != (crd, fifo):
            line = int(self.calls.line[row])
            self.link.checked("GT_CrdClear", float(crd), float(fifo), line=line)
            return self.begin(crd, fifo, row, line)
        return self.stage

    # Sending.

    def send(self, first: int, last: int) -> None:
        """Send rows first..last-1, in order."""
        self.until = last
        for start in range(first, last, _CHUNK):
            end = min(start + _CHUNK, last)
            self._send(self._prepared(start, end), start)

    def _prepared(self, first: int, last: int) -> list[PreparedCall]:
        """Prepare rows first..last-1."""
        rows = np.arange(first, last)
        lead_rows = self.part.lead_rows
        job_rows = np.where(rows >= lead_rows, rows - lead_rows + self.part.begin.row, -1)
        return prepare(self.link.library, self.calls.pick(rows), job_rows)

    def _send(self, prepared: list[PreparedCall], first: int) -> None:
        stage, done, tries = self._stage_of(first), 0, 0
        while done < len(prepared):
            self.check_requests()
            if stage.free <= 0:
                self._wait_for_free_slots(first + done)
            sent, code = self._burst(prepared[done : done + stage.free])
            done, stage.sent, stage.free = done + sent, stage.sent + sent, stage.free - sent
            tries = tries + 1 if code and not sent else 0
            if code and (code != FULL or tries > _TRIES):
                row = first + done
                raise call_failure(BUFFERED[Buffered(int(self.calls.kind[row]))].name, code, int(self.calls.line[row]))
            if code:
                stage.free = 0
            if time.perf_counter() - self.polled_s > POLL_S:
                self.poll()

    def _burst(self, prepared: list[PreparedCall]) -> tuple[int, int]:
        """Send as many calls as the FIFO takes.

        Returns:
            How many, and the code that ended the burst (0: all were sent, or the time was over, or there is a request).
        """
        link, control, append = self.link, self.control, self.link.journal.append
        clock, start_s, sent, code, me = time.perf_counter, self.link.journal.start_s, 0, 0, threading.get_ident()
        until = clock() + POLL_S
        if me != link.owner:
            raise TakenOver
        link.calling = _A_CALL
        try:
            for function, args, text in prepared:
                if control.requested:
                    break
                link.since_s = clock()
                code = function(*args)
                now = clock()
                if link.owner != me:
                    raise TakenOver
                link.since_s = 0.0
                sent += code == 0
                append(b'{"t":%.6f,"code":%d,%b' % (now - start_s, code, text))
                if code or now > until:
                    break
        except OSError as error:
            raise self._send_failure(error, sent) from error
        link.call_count += sent
        return sent, code

    def _send_failure(self, error: OSError, sent: int) -> BackendError:
        """Make the error of a burst: the library failed if a call has not returned, else the journal."""
        stage, in_call = self.stage, self.link.since_s > 0
        self.link.since_s = 0.0
        if stage is not None:
            stage.sent += sent
        if in_call:
            return self.link.library_failure(self.link.calling, error)
        self.link.journal.give_up(error)
        return self.link.journal_failure()

    def _wait_for_free_slots(self, row: int) -> None:
        """Wait until the FIFO has free slots; start a stage that is longer than the FIFO."""
        stage = self._stage_of(row)
        self.poll()
        if stage.free > 0:
            return
        if not stage.started:
            self.start(crd_start(stage.crd, stage.fifo, at=row, line=int(self.calls.line[row])))
        while stage.free <= 0:
            self.control.sleep(POLL_S)
            self.check_requests()
            self.poll()

    def check_requests(self) -> None:
        """Raise Interrupted if the user requests a pause or stop."""
        if self.control.requested:
            raise Interrupted

    # Polling.

    def poll(self) -> FifoStatus:
        """Poll the controller's state and check that the motion continues.

        GT_CrdStatus is called first: at rest the controller takes no more calls, so the free slots stay valid.
        """
        stage = self.stage
        assert stage is not None
        line = int(self.calls.line[max(min(stage.taken, len(self.calls) - 1), 0)]) if len(self.calls) else stage.line
        began_s = time.perf_counter()
        run, segment = self.link.checked("GT_CrdStatus", float(stage.crd), 0.0, 0.0, float(stage.fifo), line=line)
        (space,) = self.link.checked("GT_CrdSpace", float(stage.crd), 0.0, float(stage.fifo), line=line)
        (position,) = self.link.checked("GT_GetCrdPos", float(stage.crd), 0.0, line=line)
        before, now = stage.last, time.perf_counter()
        self.polled_s = now
        status = FifoStatus(run=bool(run), segment=segment, space=space, x=position[0], y=position[1])
        sent_since = stage.sent - stage.sent_at_poll
        stage.last, stage.free, stage.sent_at_poll = status, space, stage.sent
        # It may have begun and run dry between two polls.
        gone = stage.size - space < stage.sent - stage.first
        stage.ran = stage.ran or (stage.started and (status.run or gone))
        if status != before:
            stage.since_s = now
        self.on_status(stage)
        self._check_motion(stage, status, sent_since, now)
        stage.good = GoodPoll(began_s=began_s, taken=stage.taken, x=status.x, y=status.y)
        return status

    def _check_motion(self, stage: FifoStage, status: FifoStatus, sent_since: int, now: float) -> None:
        """Raise a failure if the motion ended too early, did not start, or makes no progress."""
        queued = stage.size - status.space
        row = min(max(stage.taken, 0), len(self.calls) - 1)
        line = int(self.calls.line[row]) if row >= 0 else stage.line
        unsent = stage.sent < self.until
        if stage.ran and not status.run and (queued > 0 or unsent):
            if queued <= sent_since:
                rate = round(self.link.call_count / max(self.link.journal.now_s(), 1e-9))
                raise failure(rules.FIFO_EMPTY, line, rate=rate)
            raise failure(rules.STOPPED_FROM_OUTSIDE, line, queued=queued)
        if stage.started and not status.run and not stage.ran and queued > 0 and now - stage.since_s > START_S:
            raise failure(rules.NO_PROGRESS, line, what=Phrase("the motion did not start"), seconds=START_S)
        if status.run and now - stage.since_s > self.still_s:
            what = Phrase("the position does not change")
            raise failure(rules.NO_PROGRESS, line, what=what, seconds=self.still_s)
