"""Where a run begins: at the start, at a line, or where a recorded run was interrupted."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from gusjob.controllers.gus.calls import BufferedCalls, Stream
from gusjob.controllers.gus.driver.resume import recorded_range
from gusjob.controllers.gus.dry_run import box_pulse
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.path_position import JOB_START, PathPosition, PositionRange
from gusjob.controllers.gus.remainder import remainder_from
from gusjob.diagnostics.model import Span, has_errors
from gusjob.hardware.request import Refusal, RunMode, RunRequest
from gusjob.i18n.phrases import Phrase, printable
from gusjob.ir.overrides import Overrides, overrides_text
from gusjob.simulate import Trace

_ROUNDED_PULSE = 2.0
"""How much longer than the simulated segment a position along it may be: its point is rounded."""
_POWER_FACTOR = 1.01
"""How much higher than in the job's simulation a power may be: both are sampled at ticks, but not at the same ones."""


def begin_range(request: RunRequest) -> PositionRange | Refusal | None:
    """Find where a run begins: where the laser went off, if it resumes one; None if only the controller has it."""
    options, stream = request.options, request.stream
    if options.from_line is not None:
        row = row_of_line(request, options.from_line)
        return row if isinstance(row, Refusal) else PositionRange.exactly(PathPosition(row=row))
    if options.resume is None:
        return PositionRange.exactly(JOB_START)
    recorded, subject = options.resume, str(options.resume.path)
    if (recorded_options := str(recorded.head.get("options", ""))) != options.mode.option:
        if recorded_options == RunMode.FRAME.option:
            return Refusal(reason=Phrase("this is the journal of a frame, which is not continued"), subject=subject)
        again = Phrase("give {options} again", options=printable(recorded_options))
        how = again if recorded_options else Phrase("leave out --no-laser")
        return Refusal(reason=Phrase("this is the journal of another kind of run: {how}", how=how), subject=subject)
    if recorded.overrides != request.overrides:
        return Refusal(reason=_other_overrides(recorded.overrides), subject=subject)
    if recorded.head["calls"] != fingerprint(stream) or recorded.head["rows"] != len(stream.buffered):
        reason = Phrase(
            "this is the journal of other calls: the job or its profile has changed; continue with --from-line N"
        )
        return Refusal(reason=reason, subject=subject)
    if recorded.part is not None:
        part = (recorded.part.begin, recorded.part.marked_to)
        if not all(is_in_job(request, PathPosition(row=row, along_pulse=along)) for row, along in part):
            return _outside(request)
    found = recorded_range(recorded, stream)
    return _outside(request) if found is not None and not range_is_in_job(request, found) else found


def _other_overrides(recorded: Overrides) -> Phrase:
    if not recorded:
        return Phrase("this is the journal of a run without -D: leave out -D")
    given = printable(overrides_text(recorded))
    return Phrase(
        "this is the journal of a run with -D {overrides}: leave out -D; the values are taken from the journal",
        overrides=given,
    )


def range_is_in_job(request: RunRequest, found: PositionRange) -> bool:
    """Return whether a range is on the job's path, its ends in order."""
    in_order = found.earliest.key <= found.latest.key
    return in_order and is_in_job(request, found.earliest) and is_in_job(request, found.latest)


def is_in_job(request: RunRequest, position: PathPosition) -> bool:
    """Return whether a position is on the simulated path of the job: within one of its segments, or its end."""
    trace, calls = request.trace, request.stream.buffered
    if position.row >= len(calls):
        return position == PathPosition(row=len(calls))
    if position.along_pulse == 0:
        return True
    number = int(np.searchsorted(trace.call, position.row))
    if number >= len(trace) or trace.call[number] != position.row:
        return False
    return position.along_pulse <= float(trace.segments.length[number]) + _ROUNDED_PULSE


def rest_is_in_job(request: RunRequest, begin: PathPosition) -> bool:
    """Return whether the rest of a job from a position marks only where the job does, with no more than its power.

    The calls of the rest are made from those of the job; this simulates them before the first one is made.
    """
    rest = remainder_from(request.stream, begin).stream
    trace, found = simulate_stream(rest, request.machine)
    if trace is None or has_errors(found):
        return False
    highest, allowed = _highest_powers(trace), _highest_powers(request.trace)
    if not all(power <= allowed.get(channel, 0.0) * _POWER_FACTOR for channel, power in highest.items()):
        return False
    box, whole = box_pulse(trace), box_pulse(request.trace)
    if not highest or box is None or whole is None:
        return not highest  # Nothing is marked.
    low, high = (0, 2), (1, 3)
    above = all(box[i] >= whole[i] - _ROUNDED_PULSE for i in low)
    return above and all(box[i] <= whole[i] + _ROUNDED_PULSE for i in high)


def _highest_powers(trace: Trace) -> dict[int, float]:
    """Return the highest power of each channel that emits."""
    emitted = {channel.channel: channel.emitted for channel in trace.channels if channel.first_emitting is not None}
    return {channel: float(found.power_max[found.emission_ms > 0].max()) for channel, found in emitted.items()}


def _outside(request: RunRequest) -> Refusal:
    reason = Phrase(
        "the journal names a position that is not on the path of the job: check the part, then continue "
        "with --from-line N"
    )
    return Refusal(reason=reason, subject=str(request.options.resume.path if request.options.resume else ""))


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
    """Return a hash of all calls, which shows whether a journal belongs to a stream."""
    digest = hashlib.sha256()
    for name in BufferedCalls.__struct_fields__:
        digest.update(np.ascontiguousarray(stream.buffered.column(name)).tobytes())
    digest.update(repr([(c.name, c.args, c.at) for c in stream.calls]).encode())
    return digest.hexdigest()
