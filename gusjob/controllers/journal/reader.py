"""Read from a journal where its run ended, to resume it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import orjson

from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.journal import JOURNAL_SCHEMA
from gusjob.i18n.phrases import Phrase


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """A run as its journal recorded it, up to where it ended.

    `head`: the journal's first line. The last part began at `begin` (row, pulse along it; of the whole job) behind
    `lead` rows of its own. `sent`: how many of the part's rows the controller took (one more may have been taken if the
    process was killed); `stage`: what is known of the stage that was cleared last. `broken`: where in the whole job the
    laser went off to pause or end. `end`: the journal's end line, None if the process was killed.
    """

    path: Path
    head: dict[str, Any]
    begin: tuple[int, float]
    lead: int
    sent: int
    stage: RecordedStage
    broken: tuple[int, float] | None
    end: dict[str, Any] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedStage:
    """A stage as its journal recorded it.

    `filled`: rows were sent to it; `started`: GT_CrdStart was called. As polled last: `slots` of its FIFO; `segment`:
    calls done; `line` of the job; `queued`: calls in the FIFO, with those that were sent since.
    """

    filled: bool
    started: bool
    slots: int
    segment: int
    line: int
    queued: int


_ROW, _CLEAR, _START = b'"code":0,"row":', b'"call":"GT_CrdClear"', b'"call":"GT_CrdStart"'
_SPACE, _STATUS = b'"call":"GT_CrdSpace"', b'"call":"GT_CrdStatus"'


def read_journal(path: Path) -> RecordedRun | str:
    """Read a journal.

    Returns:
        The recorded run, or a phrase that says why the file is not a journal or can't be resumed.

    Raises:
        OSError: the file can't be read.
    """
    text = path.read_bytes()
    text = text[: text.rfind(b"\n") + 1]  # The last line may be incomplete.
    head = _line_at(text, 0)
    if head.get("schema") != JOURNAL_SCHEMA:
        return Phrase("{name} is not a journal of gusjob run ({schema})", name=path.name, schema=JOURNAL_SCHEMA)
    if (at := text.rfind(b',"resumed":')) >= 0:
        other = _line_at(text, at)["resumed"]
        return Phrase("{name}: this run was resumed already: resume {other}", name=path.name, other=other)
    if head.get("begin") is None and b',"part":' not in text:
        return Phrase(
            "{name}: this run never began; resume {other} instead",
            name=path.name,
            other=head["resumes"],
        )
    try:
        return _recorded(path, text, head)
    except (KeyError, IndexError, TypeError):
        return Phrase("{name} is damaged: it can't be read as {schema}", name=path.name, schema=JOURNAL_SCHEMA)


def _recorded(path: Path, text: bytes, head: dict[str, Any]) -> RecordedRun:
    begin, lead, at = tuple(head["begin"] or (0, 0.0)), 0, text.rfind(b',"part":')
    since = text[max(at, 0) :]
    if at >= 0:
        part = _line_at(text, at)
        begin, lead = (part["part"], part["run"]), part["lead"]
    sent = 0
    if (row_at := since.rfind(_ROW)) >= 0:
        row = _line_at(since, row_at)["row"]
        sent = since.count(_ROW + b"-1,") if row < 0 else lead + row - begin[0] + 1
    end_at = since.rfind(b'"end":') if at >= 0 else -1
    broken_at = since.rfind(b',"broken":')
    broken = _line_at(since, broken_at) if broken_at >= 0 else None
    return RecordedRun(
        path=path,
        head=head,
        begin=(int(begin[0]), float(begin[1])),
        lead=lead,
        sent=sent,
        stage=_stage(since[max(since.rfind(_CLEAR), 0) :]),
        broken=None if broken is None else (broken["broken"], broken["run"]),
        end=_line_at(since, end_at) if end_at >= 0 else None,
    )


def _stage(text: bytes) -> RecordedStage:
    space_at, status = text.rfind(_SPACE), _last_status(text)
    slots = _line_at(text, text.find(_SPACE))["args"][1] if space_at >= 0 else FIFO_SLOTS
    space = _line_at(text, space_at)["args"][1] if space_at >= 0 else slots
    return RecordedStage(
        filled=_ROW in text,
        started=_START in text,
        slots=slots,
        segment=status["args"][2],
        line=status["line"],
        queued=slots - space + text.count(_ROW, max(space_at, 0)),
    )


def _last_status(text: bytes) -> dict[str, Any]:
    """Find the last GT_CrdStatus about the job's motion; a shutdown's, of either system, has no line."""
    at = len(text)
    while (at := text.rfind(_STATUS, 0, at)) >= 0:
        if (found := _line_at(text, at)).get("line"):
            return found
    return {"args": [0, 0, 0, 0], "line": 0}


def _line_at(text: bytes, at: int) -> dict[str, Any]:
    """Parse the line around an offset; an empty object if it is none."""
    start = text.rfind(b"\n", 0, at) + 1
    try:
        found = orjson.loads(text[start : text.find(b"\n", at)])
    except orjson.JSONDecodeError:
        return {}
    return found if isinstance(found, dict) else {}
