"""Dry runs: the motion of a stream without laser, and the frame around its marks."""

from __future__ import annotations

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Stream, crd_start
from gusjob.controllers.gus.remainder import CRD_CALLS
from gusjob.simulate import Trace
from gusjob.simulate.kinds import SegmentKind


def without_laser(stream: Stream) -> Stream:
    """Remove every call of a laser from a stream."""
    calls = stream.buffered
    kept = calls.kind <= Buffered.DELAY
    kept_before = np.concatenate([[0], np.cumsum(kept)])
    immediate = tuple(
        Call(name=c.name, args=c.args, at=int(kept_before[c.at]), line=c.line)
        for c in stream.calls
        if c.name in CRD_CALLS
    )
    return Stream(name=stream.name, buffered=calls.pick(np.flatnonzero(kept)), calls=immediate)


def frame(stream: Stream, trace: Trace) -> Stream | None:
    """Make a stream that moves once around the bounding box of a job and back to its first corner, without laser.

    Velocity and acceleration are those of the first motion.

    Args:
        stream: the job.
        trace: its simulation, which has the box (see box_pulse).

    Returns:
        The stream, or None if nothing moves.
    """
    box = box_pulse(trace)
    motions = np.flatnonzero(stream.buffered.kind < Buffered.DELAY)
    if box is None or not len(motions):
        return None
    calls, first = stream.buffered, int(motions[0])
    x_low, x_high, y_low, y_high = box
    corners = np.rint([(x_low, y_low), (x_high, y_low), (x_high, y_high), (x_low, y_high), (x_low, y_low)])
    rows = calls.pick(np.full(len(corners), first))
    fields = {name: rows.column(name) for name in BufferedCalls.__struct_fields__}
    zeros = {name: np.zeros(len(corners)) for name in ("p", "q", "r", "vel_end")}
    kind = np.full(len(corners), Buffered.LINE, dtype=np.uint8)
    framed = BufferedCalls(**(fields | zeros | {"kind": kind, "x": corners[:, 0], "y": corners[:, 1]}))
    crd, fifo, line = int(rows.crd[0]), int(rows.fifo[0]), int(rows.line[0])
    built = [c for c in stream.calls if c.name == "GT_SetCrdPrm" and c.args[0] == crd][:1]
    at_rest = [Call(name=c.name, args=c.args, at=0, line=c.line) for c in built]
    clear = Call(name="GT_CrdClear", args=(float(crd), float(fifo)), at=0, line=line)
    start = crd_start(crd, fifo, at=len(corners), line=line)
    return Stream(name=stream.name, buffered=framed, calls=(*at_rest, clear, start))


def box_pulse(trace: Trace) -> tuple[float, float, float, float] | None:
    """Return the bounding box of all marks, or of all motion if there is no mark.

    Returns:
        (x low, x high, y low, y high) in pulse; None without motion.
    """
    marks = trace.kind == SegmentKind.MARK
    taken = np.flatnonzero(marks if marks.any() else ~trace.schedule.dwell)
    if not len(taken):
        return None
    x_low, x_high, y_low, y_high = trace.segments.extent(taken)
    return float(x_low.min()), float(x_high.max()), float(y_low.min()), float(y_high.max())
