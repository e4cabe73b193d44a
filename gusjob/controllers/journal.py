"""What was really sent: a file of JSON lines, each written to the system before the next call is made.

The first line says what is run (gusjob-journal/1). Then a line a call: `t` in s since the start, what it returned,
for buffered calls the job's `row` (-1: a call that rebuilds the state when a run goes on), the job's line, the call and
its arguments (of what it points to, what was found there). Between them `part` lines, where a run begins or goes on,
and at the end an `end` line. A process that is killed loses at most the line of the call that it was making.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson

from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.i18n.phrases import Phrase, reason_of

JOURNAL_SCHEMA = "gusjob-journal/1"
JOURNAL_START = b'{"schema":"' + JOURNAL_SCHEMA.encode()
"""How a journal's file begins."""


class Journal:
    """Writes a journal. Not buffered: what was written is the system's, whatever becomes of this process."""

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        """Make the file, which must not exist (OSError), with its first line."""
        self.path = path
        self._file = path.open("xb", buffering=0)
        self.write: Callable[[bytes], int | None] = self._file.write
        """Raises OSError; give_up() then."""
        self.lost = ""
        """Why nothing can be written any more."""
        self.start_s = time.perf_counter()
        self.write(_text(schema=JOURNAL_SCHEMA, **head))

    def give_up(self, error: OSError) -> None:
        """Nothing can be written any more: a full disk must not keep the light from being switched off."""
        self.lost = reason_of(error)
        self.write = lambda _line: None

    def now_s(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.start_s

    def mark(self, **fields: Any) -> None:
        """One line with the time."""
        try:
            self.write(_text(t=round(self.now_s(), 6), **fields))
        except OSError as error:
            self.give_up(error)

    def call(self, code: int, line: int, call: str, args: list[Any]) -> None:
        """One call that was made."""
        self.mark(code=code, line=line, call=call, args=args)

    def close(self) -> None:
        """No more lines."""
        self._file.close()


def _text(**fields: Any) -> bytes:
    return orjson.dumps(fields, option=orjson.OPT_APPEND_NEWLINE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """What a journal says of where its run broke.

    `head`: its first line. The last part began at `begin` (row, pulse along it; of the whole job) behind `lead` rows of
    its own. `sent`: how many of the part's rows were taken (one more may have been, if the process was killed);
    `stage`: what is known of the stage that was cleared last. `broken`: where its light went off to pause or end, in
    the whole job. `end`: how it ended, None if it was killed.
    """

    head: dict[str, Any]
    begin: tuple[int, float]
    lead: int
    sent: int
    stage: RecordedStage
    broken: tuple[int, float] | None
    end: dict[str, Any] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedStage:
    """A stage: whether rows were sent to it, whether it was started, and what was seen of it last.

    `slots` of its FIFO; `segment`: calls done; `line` of the job; `queued`: calls that were in the FIFO then, with
    those that were sent since.
    """

    filled: bool
    started: bool
    slots: int
    segment: int
    line: int
    queued: int


_ROW, _CLEAR, _START = b'"code":0,"row":', b'"call":"GT_CrdClear"', b'"call":"GT_CrdStart"'
_SPACE, _STATUS = b'"call":"GT_CrdSpace"', b'"call":"GT_CrdStatus"'


def mark_resumed(path: Path, by: Path) -> None:
    """Say in a journal that another run goes on with it, so that what is left is not run twice. Raises OSError."""
    with path.open("ab") as file:
        file.write(_text(t=0, resumed=str(by.resolve())))


def read_journal(path: Path) -> Recorded | str:
    """A journal, or why it is none. Raises OSError if it can't be read."""
    text = path.read_bytes()
    text = text[: text.rfind(b"\n") + 1]  # A line that was cut says nothing.
    head = _line(text, 0)
    if head.get("schema") != JOURNAL_SCHEMA:
        return Phrase("{name} is not a journal of gusjob run ({schema})", name=path.name, schema=JOURNAL_SCHEMA)
    if (at := text.rfind(b',"resumed":')) >= 0:
        other = _line(text, at)["resumed"]
        return Phrase("{name}: this run was gone on with already: go on with {other}", name=path.name, other=other)
    if head.get("begin") is None and b',"part":' not in text:
        return Phrase(
            "{name}: this run never began; go on with the journal that it was to go on with: {other}",
            name=path.name,
            other=head["resumes"],
        )
    try:
        return _recorded(text, head)
    except (KeyError, IndexError, TypeError):
        return Phrase("{name} is damaged: it can't be read as {schema}", name=path.name, schema=JOURNAL_SCHEMA)


def _recorded(text: bytes, head: dict[str, Any]) -> Recorded:
    begin, lead, at = tuple(head["begin"] or (0, 0.0)), 0, text.rfind(b',"part":')
    since = text[max(at, 0) :]
    if at >= 0:
        part = _line(text, at)
        begin, lead = (part["part"], part["run"]), part["lead"]
    sent = 0
    if (row_at := since.rfind(_ROW)) >= 0:
        row = _line(since, row_at)["row"]
        sent = since.count(_ROW + b"-1,") if row < 0 else lead + row - begin[0] + 1
    end_at = since.rfind(b'"end":') if at >= 0 else -1
    broken_at = since.rfind(b',"broken":')
    broken = _line(since, broken_at) if broken_at >= 0 else None
    return Recorded(
        head=head,
        begin=(int(begin[0]), float(begin[1])),
        lead=lead,
        sent=sent,
        stage=_stage(since[max(since.rfind(_CLEAR), 0) :]),
        broken=None if broken is None else (broken["broken"], broken["run"]),
        end=_line(since, end_at) if end_at >= 0 else None,
    )


def _stage(text: bytes) -> RecordedStage:
    space_at, status = text.rfind(_SPACE), _last_look(text)
    slots = _line(text, text.find(_SPACE))["args"][1] if space_at >= 0 else FIFO_SLOTS
    space = _line(text, space_at)["args"][1] if space_at >= 0 else slots
    return RecordedStage(
        filled=_ROW in text,
        started=_START in text,
        slots=slots,
        segment=status["args"][2],
        line=status["line"],
        queued=slots - space + text.count(_ROW, max(space_at, 0)),
    )


def _last_look(text: bytes) -> dict[str, Any]:
    """The last GT_CrdStatus that asked for the job's motion; those of a way out, of any system, name no line."""
    at = len(text)
    while (at := text.rfind(_STATUS, 0, at)) >= 0:
        if (found := _line(text, at)).get("line"):
            return found
    return {"args": [0, 0, 0, 0], "line": 0}


def _line(text: bytes, at: int) -> dict[str, Any]:
    """The line round a place, as an object; an empty one if it is none."""
    start = text.rfind(b"\n", 0, at) + 1
    try:
        found = orjson.loads(text[start : text.find(b"\n", at)])
    except orjson.JSONDecodeError:
        return {}
    return found if isinstance(found, dict) else {}
