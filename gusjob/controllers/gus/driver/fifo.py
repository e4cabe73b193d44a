"""Keeps the controller's FIFO full: buffered calls in order, none twice, none left out.

A full FIFO refuses a call; then GT_CrdSpace is polled and the SAME call is sent again (sister). The loop over calls is
a loop since each is a call into C; all that can be prepared is prepared as columns.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.controllers.control import Control
from gusjob.controllers.gus.calls import (
    BUFFERED,
    Arg,
    ArgKind,
    Buffered,
    BufferedCalls,
    Call,
    CType,
    Signature,
    crd_start,
)
from gusjob.controllers.gus.driver.abi import Prototype
from gusjob.controllers.gus.driver.link import FULL, BackendError, Link, TakenOver, failure, call_failure
from gusjob.controllers.gus.listing import number_texts
from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.gus.remainder import Remainder
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Indices
from gusjob.kinematics.units import MS_PER_S

POLL_S = 0.02
"""How often the controller is asked how far it is: 4096 slots of 10 us segments last twice as long."""
START_S = 1.0
"""So long after GT_CrdStart the motion may still rest."""
STILL_S = 3.0
"""So long, and the longest dwell, nothing may change while it moves."""
_CHUNK = 1024
_TRIES = 3
"""So often a call may be refused as if the FIFO were full though GT_CrdSpace found room."""
_A_CALL = Phrase("a buffered call")

PreparedCall = tuple[Callable[..., int], tuple[int | float, ...], bytes]
"""A buffered call: function, all arguments, the rest of its journal line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FifoStatus:
    """What the controller says of itself."""

    run: bool
    segment: int
    space: int
    x: float
    y: float


@dataclass(slots=True, kw_only=True)
class FifoStage:
    """A stage under way. `first`: its first row; `sent`: rows sent, as far as into the part; `size`: slots."""

    crd: int
    fifo: int
    first: int
    sent: int
    size: int
    room: int
    line: int
    started: bool = False
    """It may be before GT_CrdStart's turn, where the FIFO is full earlier."""
    ran: bool = False
    since_s: float = 0.0
    """When it was started, or changed last."""
    last: FifoStatus | None = None
    sent_at_look: int = 0

    @property
    def taken(self) -> int:
        """The first row that has not left the FIFO."""
        space = self.last.space if self.last else self.size
        return max(self.sent_at_look - (self.size - space), self.first)


class Fifo:
    """Sends one part's rows. `on_look` is called after every look at it, `before_start` before GT_CrdStart."""

    def __init__(
        self,
        link: Link,
        control: Control,
        part: Remainder,
        *,
        on_look: Callable[[FifoStage], None],
        before_start: Callable[[], None],
    ) -> None:
        self.link, self.control, self.part = link, control, part
        self.on_look, self.before_start = on_look, before_start
        self.calls = part.stream.buffered
        self.stage: FifoStage | None = None
        self.looked_s = 0.0
        self.until = 0
        """Indices before this one are to be sent before anything else."""
        dwells = self.calls.p[self.calls.kind == Buffered.DELAY] / MS_PER_S
        self.still_s = STILL_S + float(dwells.max(initial=0.0))

    def begin(self, crd: int, fifo: int, row: int, line: int) -> FifoStage:
        """A stage begins: what the empty FIFO holds is the measure of what is in it later."""
        (space,) = self.link.must("GT_CrdSpace", float(crd), 0.0, float(fifo), line=line)
        size = int(space)
        if not 0 < size <= FIFO_SLOTS:
            raise failure(
                rules.WRONG_ABI, line, library=self.link.library.path, abi=self.link.library.abi,
                reason=Phrase(
                    "GT_CrdSpace finds {size} free slots behind GT_CrdClear, not 1 to {most}",
                    size=size, most=FIFO_SLOTS,
                ), hint="",
            )  # fmt: skip
        self.stage = FifoStage(crd=crd, fifo=fifo, first=row, sent=row, sent_at_look=row, size=size, room=size, line=line)
        return self.stage

    def send(self, first: int, last: int) -> None:
        """Indices first..last-1, in order."""
        self.until = last
        for start in range(first, last, _CHUNK):
            end = min(start + _CHUNK, last)
            self._send(self._prepared(start, end), start)

    def _send(self, prepared: list[PreparedCall], first: int) -> None:
        stage, done, tries = self._stage_of(first), 0, 0
        while done < len(prepared):
            self.heed()
            if stage.room <= 0:
                self._wait_for_room(first + done)
            sent, code = self._burst(prepared[done : done + stage.room])
            done, stage.sent, stage.room = done + sent, stage.sent + sent, stage.room - sent
            tries = tries + 1 if code and not sent else 0
            if code and (code != FULL or tries > _TRIES):
                row = first + done
                raise call_failure(BUFFERED[Buffered(int(self.calls.kind[row]))].name, code, int(self.calls.line[row]))
            if code:
                stage.room = 0
            if time.perf_counter() - self.looked_s > POLL_S:
                self.look()

    def _burst(self, prepared: list[PreparedCall]) -> tuple[int, int]:
        """As many of them as are taken; how many, and the code that ended it (0: all, or a wish was heard)."""
        link, control, write = self.link, self.control, self.link.journal.write
        clock, start_s, sent, code, me = time.perf_counter, self.link.journal.start_s, 0, 0, threading.get_ident()
        until = clock() + POLL_S
        if me != link.owner:
            raise TakenOver
        link.calling = _A_CALL
        try:
            for function, args, text in prepared:
                if control.asked:
                    break
                link.since_s = clock()
                code = function(*args)
                now = clock()
                if link.owner != me:
                    raise TakenOver
                link.since_s = 0.0
                sent += code == 0
                write(b'{"t":%.6f,"code":%d,%b' % (now - start_s, code, text))
                if code or now > until:
                    break
        except OSError as error:
            raise self._broken(error, sent) from error
        link.made += sent
        return sent, code

    def _broken(self, error: OSError, sent: int) -> BackendError:
        """The journal could not be written, or, if a call has not returned, the library failed."""
        stage, within = self.stage, self.link.since_s > 0
        self.link.since_s = 0.0
        if stage is not None:
            stage.sent += sent
        if within:
            return self.link.crashed(self.link.calling, error)
        self.link.journal.give_up(error)
        return self.link.no_journal()

    def _stage_of(self, row: int) -> FifoStage:
        """The stage that a row belongs to; a listing may fill a FIFO that it never cleared."""
        crd, fifo = int(self.calls.crd[row]), int(self.calls.fifo[row])
        if self.stage is None or (self.stage.crd, self.stage.fifo) != (crd, fifo):
            return self.begin(crd, fifo, row, int(self.calls.line[row]))
        return self.stage

    def _wait_for_room(self, row: int) -> None:
        """Until the FIFO has room; a stage longer than the FIFO is started now."""
        stage = self._stage_of(row)
        self.look()
        if stage.room > 0:
            return
        if not stage.started:
            self.start(crd_start(stage.crd, stage.fifo, at=row, line=int(self.calls.line[row])))
        while stage.room <= 0:
            self.control.nap(POLL_S)
            self.heed()
            self.look()

    def start(self, call: Call) -> None:
        """GT_CrdStart of the present stage."""
        self.before_start()
        self.link.must(call.name, *call.args, line=call.line)
        if self.stage is not None:
            self.stage.started, self.stage.since_s = True, time.perf_counter()

    def wait_for_end(self) -> FifoStatus | None:
        """Until the motion rests and the FIFO is empty; what was seen then. None if nothing was started."""
        stage = self.stage
        if stage is None or not stage.started:
            return None
        nap_s = POLL_S / 16  # Short stages are not to wait for a long nap.
        while True:
            look = self.look()
            if not look.run and look.space >= stage.size:
                break
            self.control.nap(nap_s)
            nap_s = min(2 * nap_s, POLL_S)
            self.heed()
        stage.started = stage.ran = False
        stage.first = stage.sent
        return look

    def look(self) -> FifoStatus:
        """Ask how far it is. GT_CrdStatus goes first: at rest no more calls are taken, so the space still holds."""
        stage = self.stage
        assert stage is not None
        line = int(self.calls.line[max(min(stage.taken, len(self.calls) - 1), 0)]) if len(self.calls) else stage.line
        run, segment = self.link.must("GT_CrdStatus", float(stage.crd), 0.0, 0.0, float(stage.fifo), line=line)
        (space,) = self.link.must("GT_CrdSpace", float(stage.crd), 0.0, float(stage.fifo), line=line)
        (position,) = self.link.must("GT_GetCrdPos", float(stage.crd), 0.0, line=line)
        before, now = stage.last, time.perf_counter()
        self.looked_s = now
        look = FifoStatus(run=bool(run), segment=segment, space=space, x=position[0], y=position[1])
        fresh = stage.sent - stage.sent_at_look
        stage.last, stage.room, stage.sent_at_look = look, space, stage.sent
        # It may have begun and run dry between two looks.
        gone = stage.size - space < stage.sent - stage.first
        stage.ran = stage.ran or (stage.started and (look.run or gone))
        if look != before:
            stage.since_s = now
        self.on_look(stage)
        self._judge(stage, look, fresh, now)
        return look

    def _judge(self, stage: FifoStage, look: FifoStatus, fresh: int, now: float) -> None:
        """Whether the motion goes on as it should."""
        queued = stage.size - look.space
        row = min(max(stage.taken, 0), len(self.calls) - 1)
        line = int(self.calls.line[row]) if row >= 0 else stage.line
        unsent = stage.sent < self.until
        if stage.ran and not look.run and (queued > 0 or unsent):
            if queued <= fresh:
                rate = round(self.link.made / max(self.link.journal.now_s(), 1e-9))
                raise failure(rules.STARVED, line, rate=rate)
            raise failure(rules.HALTED, line, queued=queued)
        if stage.started and not look.run and not stage.ran and queued > 0 and now - stage.since_s > START_S:
            raise failure(rules.NO_PROGRESS, line, what=Phrase("the motion did not start"), seconds=START_S)
        if look.run and now - stage.since_s > self.still_s:
            what = Phrase("the motion is at the same place")
            raise failure(rules.NO_PROGRESS, line, what=what, seconds=self.still_s)

    def heed(self) -> None:
        """Wishes of the user end the sending."""
        if self.control.asked:
            raise Interrupted

    def _prepared(self, first: int, last: int) -> list[PreparedCall]:
        """Indices first..last-1 as calls."""
        rows = np.arange(first, last)
        calls = self.calls.pick(rows)
        made: list[PreparedCall] = [_NOTHING] * len(rows)
        origin = np.where(rows >= self.part.lead, rows - self.part.lead + self.part.begin.row, -1)
        for kind, signature in BUFFERED.items():
            at = np.flatnonzero(calls.kind == kind)
            if len(at):
                library = self.link.library
                function, prototype = library.functions[signature.name], library.prototypes[signature.name]
                arguments = zip(*_columns(calls, at, prototype), strict=True)
                texts = _texts(calls, at, signature, origin)
                for i, args, text in zip(at.tolist(), arguments, texts, strict=True):
                    made[i] = (function, args, text)
        return made


class Interrupted(BaseException):
    """No error: the user wants something else; control says what."""


def _nothing(*_args: object) -> int:
    raise AssertionError("every buffered call has a signature")


_NOTHING: PreparedCall = (_nothing, (), b"")


def _columns(calls: BufferedCalls, at: Indices, prototype: Prototype) -> list[list[int | float]]:
    """A list for each argument, in the library's order."""

    def column(arg: Arg) -> list[int | float]:
        values = calls.column(arg.column)[at]
        whole = arg.kind is ArgKind.WHOLE and arg.c is not CType.DOUBLE
        found: list[int | float] = (values.astype(np.int64) if whole else values.astype(np.float64)).tolist()
        return found

    def constants(values: tuple[int, ...]) -> list[list[int | float]]:
        return [[value] * len(at) for value in values]

    return [*constants(prototype.before), *map(column, prototype.args), *constants(prototype.behind)]


def _texts(calls: BufferedCalls, at: Indices, signature: Signature, origin: Indices) -> list[bytes]:
    """What stands in a journal line behind time and code."""
    args = signature.args
    form = f'"row":%s,"line":%s,"call":"{signature.name}","args":[{",".join(["%s"] * len(args))}]}}\n'
    columns: list[npt.NDArray[Any]] = [origin[at], calls.line[at], *(calls.column(a.column)[at] for a in args)]
    return [text.encode() for text in map(form.__mod__, zip(*map(number_texts, columns), strict=True))]
