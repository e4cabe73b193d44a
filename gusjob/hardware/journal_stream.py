"""Read a journal as a stream: the calls that were really sent to a controller, as far as they were run."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import orjson
from msgspec.structs import replace

from gusjob.controllers.gus.calls import HOST_CALLS, Buffered, BufferedCalls, Stream
from gusjob.controllers.gus.path_position import PathPosition
from gusjob.controllers.gus.ranges import FIFO_SLOTS
from gusjob.controllers.gus.remainder import as_centre_arc, point_pulse
from gusjob.controllers.journal import JOURNAL_SCHEMA, is_current
from gusjob.controllers.journal.lines import path_of, sound_part
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import NOWHERE, Diagnostic, Span
from gusjob.frontend import Source, read_listing
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.geometry import CLOSE_ENDS_PULSE
from gusjob.patterns import lazy_pattern

_LINE = lazy_pattern(
    rb'^\{"t":[^,\n]*,(?:"code":0,(?:"row":(-?\d+),)?"line":(\d+),"call":"(\w+)","args":\[(.*)\]'
    rb'|("(?:part|broken|end)":.*)),"crc":\d+\}$',
    re.MULTILINE,
)
_BRACES = bytes.maketrans(b"[]", b"{}")
_WAIT = b"GT_CrdStatus(%d,run,segment,%d)"
_NOT_OF_THE_JOB = {*HOST_CALLS, "GT_CrdStatus", "GT_GetHSIOOpt"}


def journal_stream(source: Source) -> tuple[Stream | None, list[Diagnostic]]:
    """Read the calls of a journal that returned 0, with the job's lines.

    Polls are left out, and so are calls that were sent but not run because the run was paused or stopped before: the
    last call that was run in part ends where the laser went off. GT_CrdStatus marks where the axes were at rest.

    Returns:
        The stream, or None if the journal is damaged; and diagnostics.
    """
    collected, sound = _CallCollector(), sound_part(source.data)
    if not is_current(source.data):
        reason = Phrase("it is a journal that another version of gusjob wrote, not as {schema}", schema=JOURNAL_SCHEMA)
        return None, [Diagnostic(rule=rules.NOT_TEXT, span=NOWHERE, fields={"reason": reason}, path=source.name)]
    try:
        if not sound.count:
            raise ValueError
        name = _job_name(source)
        for row, line, call, args, mark in _LINE.findall(source.data[: sound.size]):
            if mark:
                collected.mark(orjson.loads(b"{" + mark + b"}"))
            else:
                collected.call(int(row) if row else None, int(line), call.decode(), args.translate(_BRACES))
    except (ValueError, KeyError, IndexError, TypeError):
        reason = Phrase("it begins as a journal, but can't be read as {schema}: it is damaged", schema=JOURNAL_SCHEMA)
        return None, [Diagnostic(rule=rules.NOT_TEXT, span=NOWHERE, fields={"reason": reason}, path=source.name)]
    text = b"\n".join(collected.texts)
    stream, found = read_listing(Source(name=name, data=text + b"\n"))
    lines = np.array([0, *collected.lines], dtype=np.int32)
    calls = tuple(replace(call, line=int(lines[call.line])) for call in stream.calls)
    at = np.searchsorted(stream.buffered.line, np.array(list(collected.shortened), dtype=np.int64) + 1)
    lengths = dict(zip(at.tolist(), collected.shortened.values(), strict=True))
    shortened = _with_lengths(stream.buffered, lengths)
    buffered = replace(shortened, line=lines[shortened.line])
    located = [replace(d, span=Span(line=int(lines[min(d.span.line, len(lines) - 1)]))) for d in found]
    if sound.size < len(source.data):
        fields = {"line": sound.count + 1}
        located.append(Diagnostic(rule=rules.JOURNAL_DAMAGED, span=NOWHERE, fields=fields, path=source.name))
    if collected.running is not None and len(buffered):
        # The journal does not say how it ended: the process was killed.
        left = min(collected.since_poll, len(buffered))
        killed, last = {"calls": left}, Span(line=int(buffered.line[-1]))
        located.append(Diagnostic(rule=rules.RUN_KILLED, span=last, fields=killed, path=name))
    return replace(stream, buffered=buffered, calls=calls), located


def _job_name(source: Source) -> str:
    """Return the job's name: the lines are the job's."""
    head = orjson.loads(source.data[: source.data.find(b"\n")])
    return str(path_of(head["job"])) if "job" in head else source.name


class _CallCollector:
    """Collects calls as the text of a listing, and which of them were not run to their end."""

    def __init__(self) -> None:
        self.texts: list[bytes] = []
        self.lines: list[int] = []
        self.rows: list[int] = []
        """The job's row of each text; -1 if it is none."""
        self.shortened: dict[int, float] = {}
        """Texts that were run in part: the length that was run, pulse."""
        self.part_at, self.begin = 0, (0, 0.0)
        self.running: tuple[int, int] | None = None
        self.since_poll = 0
        """Buffered calls that had not been run yet at the last poll, with those that were sent since."""

    def add(self, text: bytes, line: int, row: int = -1) -> None:
        self.texts.append(text)
        self.lines.append(line)
        self.rows.append(row)

    def call(self, row: int | None, line: int, name: str, args: bytes) -> None:
        """Add one call that returned 0."""
        if row is not None:
            self.since_poll += 1
            self.add(b"%s(%s)" % (name.encode(), args), line, row)
            return
        if name == "GT_CrdSpace":
            self.since_poll = FIFO_SLOTS - int(args.split(b",")[1])
        if name in _NOT_OF_THE_JOB:
            return
        self.wait(line)
        self.add(b"%s(%s)" % (name.encode(), args), line)
        if name == "GT_CrdStart":
            mask, option = (int(float(value)) for value in args.split(b","))
            self.running = (mask, option >> (mask - 1) & 1)

    def wait(self, line: int) -> None:
        """Wait for rest before the next call, if something was started."""
        if self.running is not None:
            self.add(_WAIT % self.running, line)
            self.running = None

    def mark(self, found: dict[str, Any]) -> None:
        """Evaluate a line about where a part begins, or where the run was interrupted or ended."""
        if "part" in found:
            self.part_at, self.begin = len(self.texts), (found["part"], found["run"])
        elif "broken" in found:
            self.interrupt(found["broken"], found["run"])
        elif found["end"] == "failed":
            self.interrupt(found["row"], found["run"])
            self.running = None

    def interrupt(self, row: int, along_pulse: float) -> None:
        """End the part at a position: what was sent beyond it was not run."""
        later = [i for i in range(self.part_at, len(self.texts)) if self.rows[i] >= row]
        for i in later:
            begun_pulse = self.begin[1] if row == self.begin[0] else 0.0
            if self.rows[i] == row and along_pulse > begun_pulse:
                self.shortened[i] = along_pulse - begun_pulse
            else:
                self.texts[i] = b""


def _with_lengths(calls: BufferedCalls, lengths: dict[int, float]) -> BufferedCalls:
    """Shorten calls to the lengths that were run before the laser went off, pulse by index."""
    if lengths:  # The stream's own columns are not changed; one with one value for all calls can't be.
        calls = calls.pick(np.arange(len(calls)))
    for index, length in lengths.items():
        end = point_pulse(calls, PathPosition(row=index, along_pulse=length))
        start = point_pulse(calls, PathPosition(row=index))
        as_centre_arc(calls, index)
        calls.x[index], calls.y[index] = end
        # The laser went off at full velocity.
        calls.vel_end[index] = calls.vel[index]
        is_arc = calls.kind[index] == Buffered.ARC_CENTRE
        # The first pulses of an arc are a line: about its centre they could be a full circle.
        if length <= CLOSE_ENDS_PULSE if is_arc else end == start:
            calls.kind[index] = Buffered.LINE
    return calls
