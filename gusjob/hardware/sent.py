"""A journal as a stream: what a controller was really sent, as far as it was run."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import orjson

from gusjob.controllers.gus.calls import HOST_CALLS, Buffered, BufferedCalls, Stream
from gusjob.controllers.gus.place import Place
from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.gus.remainder import about_centre, point
from gusjob.controllers.journal import JOURNAL_SCHEMA
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Span
from gusjob.frontend import Source, read_listing
from gusjob.i18n.phrases import Phrase

_LINE = re.compile(
    rb'^\{"t":[^,\n]*,(?:"code":0,(?:"row":(-?\d+),)?"line":(\d+),"call":"(\w+)","args":\[(.*)\]\}'
    rb'|("(?:part|broken|end)":.*\}))$',
    re.MULTILINE,
)
_BRACES = bytes.maketrans(b"[]", b"{}")
_WAITED = b"GT_CrdStatus(%d,run,segment,%d)"
_NOT_OF_THE_JOB = {*HOST_CALLS, "GT_CrdStatus", "GT_GetHSIOOpt"}


def sent_calls(source: Source) -> tuple[Stream | None, list[Diagnostic]]:
    """The calls of a journal that returned 0, with the job's lines; None if it is damaged.

    Polls are left out, and so is what was sent but not run since the run was stopped or paused before: what the last
    call did of it ends where the light went off. GT_CrdStatus stands where the motion was at rest.
    """
    collected = _Collected()
    try:
        name = _job(source)
        for row, line, call, args, mark in _LINE.findall(source.data):
            if mark:
                collected.mark(orjson.loads(b"{" + mark))
            else:
                collected.call(int(row) if row else None, int(line), call.decode(), args.translate(_BRACES))
    except (ValueError, KeyError, IndexError, TypeError):
        reason = Phrase("it begins as a journal, but can't be read as {schema}: it is damaged", schema=JOURNAL_SCHEMA)
        return None, [Diagnostic(rule=rules.NOT_TEXT, span=NOWHERE, fields={"reason": reason}, path=source.name)]
    text = b"\n".join(collected.texts)
    stream, faults = read_listing(Source(name=name, data=text + b"\n"))
    lines = np.array([0, *collected.lines], dtype=np.int32)
    calls = tuple(replace(call, line=int(lines[call.line])) for call in stream.calls)
    at = np.searchsorted(stream.buffered.line, np.array(list(collected.cut), dtype=np.int64) + 1)
    buffered = _cut(stream.buffered, dict(zip(at.tolist(), collected.cut.values(), strict=True)))
    own = replace(buffered, line=lines[buffered.line])
    placed = [replace(f, span=Span(line=int(lines[min(f.span.line, len(lines) - 1)]))) for f in faults]
    if collected.running is not None and len(own):
        # Nothing says how it ended: it was killed.
        left = min(collected.since_look, len(own))
        fields, last = {"calls": left}, Span(line=int(own.line[-1]))
        placed.append(Diagnostic(rule=rules.RAN_ON, span=last, fields=fields, path=name))
    return replace(stream, buffered=own, calls=calls), placed


def _job(source: Source) -> str:
    """The job's name: the lines are its own."""
    head = orjson.loads(source.data[: source.data.find(b"\n")])
    return str(head.get("job", source.name))


class _Collected:
    """Calls as the text of a listing, and which of them were not run to their end."""

    def __init__(self) -> None:
        self.texts: list[bytes] = []
        self.lines: list[int] = []
        self.rows: list[int] = []
        """The job's row of each text; -1 if it is none."""
        self.cut: dict[int, float] = {}
        """Texts that were run a part of the way: how far, pulse."""
        self.part_at, self.begin = 0, (0, 0.0)
        self.running: tuple[int, int] | None = None
        self.since_look = 0
        """Buffered calls that had not been run yet when the controller was asked last."""

    def add(self, text: bytes, line: int, row: int = -1) -> None:
        self.texts.append(text)
        self.lines.append(line)
        self.rows.append(row)

    def call(self, row: int | None, line: int, name: str, args: bytes) -> None:
        """One call that was taken."""
        if row is not None:
            self.since_look += 1
            self.add(b"%s(%s)" % (name.encode(), args), line, row)
            return
        if name == "GT_CrdSpace":
            self.since_look = FIFO_SLOTS - int(args.split(b",")[1])
        if name in _NOT_OF_THE_JOB:
            return
        self.rest(line)
        self.add(b"%s(%s)" % (name.encode(), args), line)
        if name == "GT_CrdStart":
            mask, option = (int(float(value)) for value in args.split(b","))
            self.running = (mask, option >> (mask - 1) & 1)

    def rest(self, line: int) -> None:
        """What comes now comes at rest."""
        if self.running is not None:
            self.add(_WAITED % self.running, line)
            self.running = None

    def mark(self, found: dict[str, Any]) -> None:
        """Where a part begins or a run ends."""
        if "part" in found:
            self.part_at, self.begin = len(self.texts), (found["part"], found["run"])
        elif "broken" in found:
            self.broken(found["broken"], found["run"])
        elif found["end"] == "failed":
            self.broken(found["row"], found["run"])
            self.running = None

    def broken(self, row: int, run_pulse: float) -> None:
        """The part was run up to a place: what was sent beyond was not run."""
        later = [i for i in range(self.part_at, len(self.texts)) if self.rows[i] >= row]
        for i in later:
            begun = self.begin[1] if row == self.begin[0] else 0.0
            if self.rows[i] == row and run_pulse > begun:
                self.cut[i] = run_pulse - begun
            else:
                self.texts[i] = b""


def _cut(calls: BufferedCalls, at: dict[int, float]) -> BufferedCalls:
    """The calls, some of which end earlier, where the light went off."""
    for index, run_pulse in at.items():
        (x, y), start = point(calls, Place(row=index, run_pulse=run_pulse)), point(calls, Place(row=index))
        about_centre(calls, index)
        # The light went off in full motion; an arc back to its start would be a full circle.
        calls.x[index], calls.y[index], calls.vel_end[index] = x, y, calls.vel[index]
        if (x, y) == start:
            calls.kind[index] = Buffered.LINE
    return calls
