"""Where a run begins: at the start, at a line, or where a recorded run was interrupted."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from gusjob.controllers.gus.calls import BufferedCalls, Stream
from gusjob.controllers.gus.driver.resume import recorded_position
from gusjob.controllers.gus.path_position import JOB_START, PathPosition
from gusjob.diagnostics.model import Span
from gusjob.hardware.request import Refusal, RunRequest
from gusjob.i18n.phrases import Phrase, printable


def begin_position(request: RunRequest) -> PathPosition | Refusal | None:
    """Find where a run begins; None if only the controller has the position."""
    options, stream = request.options, request.stream
    if options.from_line is not None:
        row = row_of_line(request, options.from_line)
        return row if isinstance(row, Refusal) else PathPosition(row=row)
    if options.resume is None:
        return JOB_START
    recorded, subject = options.resume, str(options.resume.path)
    if (recorded_options := str(recorded.head.get("options", ""))) != options.mode.option:
        again = Phrase("give {options} again", options=printable(recorded_options))
        how = again if recorded_options else Phrase("leave out --no-laser")
        return Refusal(reason=Phrase("this is the journal of another kind of run: {how}", how=how), subject=subject)
    if recorded.head.get("calls") != fingerprint(stream):
        reason = Phrase(
            "this is the journal of other calls: the job or its profile has changed; continue with --from-line N"
        )
        return Refusal(reason=reason, subject=subject)
    return recorded_position(recorded)


def row_of_line(request: RunRequest, line_text: str) -> int | Refusal:
    """Return the first row of a line, or of the first line after it that has one.

    Args:
        request: the job.
        line_text: N in the job's own file, FILE:N in one that it includes, as messages name them.
    """
    name, _, number = line_text.rpartition(":")
    line = int(number) if number.isascii() and number.isdigit() else 0
    lines, first = np.unique(request.stream.buffered.line, return_index=True)
    spans = [request.locate(int(found)) for found in lines.tolist()]
    is_own = not name or Path(name).name == request.path.name

    def matches(span: Span) -> bool:
        return span.line >= line and (not span.path if is_own else Path(span.path).name == Path(name).name)

    rows = [(span.line, int(row)) for span, row in zip(spans, first, strict=True) if matches(span)]
    if not rows or line < 1:
        reason = Phrase("the job has no motion or laser call at or after this line")
        return Refusal(reason=reason, subject=f"--from-line {line_text}")
    return min(rows)[1]


def fingerprint(stream: Stream) -> str:
    """Return a hash of all calls, which tells whether a journal belongs to a stream."""
    digest = hashlib.sha256()
    for name in BufferedCalls.__slots__:
        digest.update(np.ascontiguousarray(stream.buffered.column(name)).tobytes())
    digest.update(repr([(c.name, c.args, c.at) for c in stream.calls]).encode())
    return digest.hexdigest()
