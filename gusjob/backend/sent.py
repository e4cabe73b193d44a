"""A journal as a stream: what a controller was really sent, as far as it was run."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import orjson

from gusjob.backend.place import Place
from gusjob.backend.rest import about_centre, point
from gusjob.diagnostics import Diagnostic
from gusjob.stream import HOST_CALLS, BufferedCalls, Stream
from gusjob.syntax import Source, read_listing

_LINE = re.compile(
    rb'^\{"t":[^,\n]*,(?:"code":0,(?:"row":(-?\d+),)?"line":(\d+),"call":"(\w+)","args":\[(.*)\]\}'
    rb'|("(?:part|paused|end)":.*\}))$',
    re.MULTILINE,
)
_BRACES = bytes.maketrans(b"[]", b"{}")
_WAITED = b"GT_CrdStatus(%d,run,segment,%d)"
_NOT_OF_THE_JOB = {*HOST_CALLS, "GT_CrdStatus", "GT_GetHSIOOpt"}


def sent_calls(source: Source) -> tuple[Stream, list[Diagnostic]]:
    """The calls of a journal that returned 0, with the job's lines.

    Polls are left out, and so is what was sent but not run since the run was stopped or paused before: what the last
    call did of it ends where the light went off. GT_CrdStatus stands where the motion was at rest.
    """
    collected = _Collected()
    for row, line, call, args, mark in _LINE.findall(source.data):
        if mark:
            collected.mark(orjson.loads(b"{" + mark))
        else:
            collected.call(int(row) if row else None, int(line), call.decode(), args.translate(_BRACES))
    text = b"\n".join(collected.texts)
    stream, faults = read_listing(Source(name=source.name, data=text + b"\n"))
    lines = np.array([0, *collected.lines], dtype=np.int32)
    calls = tuple(replace(call, line=int(lines[call.line])) for call in stream.calls)
    at = np.searchsorted(stream.buffered.line, np.array(list(collected.cut), dtype=np.int64) + 1)
    buffered = _cut(stream.buffered, dict(zip(at.tolist(), collected.cut.values(), strict=True)))
    own = replace(buffered, line=lines[buffered.line])
    placed = [replace(f, span=replace(f.span, line=int(lines[min(f.span.line, len(lines) - 1)]))) for f in faults]
    return replace(stream, buffered=own, calls=calls), placed


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

    def add(self, text: bytes, line: int, row: int = -1) -> None:
        self.texts.append(text)
        self.lines.append(line)
        self.rows.append(row)

    def call(self, row: int | None, line: int, name: str, args: bytes) -> None:
        """One call that was taken."""
        if row is not None:
            self.add(b"%s(%s)" % (name.encode(), args), line, row)
            return
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
        elif "paused" in found:
            self.broken(found["paused"], found["run"])
        elif found["end"] == "failed":
            self.broken(found["row"], found["run"])

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
    """The calls, some of which end earlier, at rest."""
    for index, run_pulse in at.items():
        x, y = point(calls, Place(row=index, run_pulse=run_pulse))
        about_centre(calls, index)
        calls.x[index], calls.y[index], calls.vel_end[index] = x, y, 0.0
    return calls
