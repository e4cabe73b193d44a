"""The motion of a stream without light: all of it, or round the box of what it marks."""

from __future__ import annotations

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Stream, crd_start
from gusjob.controllers.gus.remainder import CRD_CALLS
from gusjob.simulate import Trace


def without_laser(stream: Stream) -> Stream:
    """The stream without any call to a laser."""
    calls = stream.buffered
    kept = calls.kind <= Buffered.DELAY
    before = np.concatenate([[0], np.cumsum(kept)])
    left = tuple(
        Call(name=c.name, args=c.args, at=int(before[c.at]), line=c.line) for c in stream.calls if c.name in CRD_CALLS
    )
    return Stream(name=stream.name, buffered=calls.pick(np.flatnonzero(kept)), calls=left)


def frame(stream: Stream, trace: Trace) -> Stream | None:
    """Once round the box of all marks (of all motion, if nothing is marked), and back to its first corner.

    None if nothing moves. Velocity and acceleration are those of the first motion.
    """
    box = box_pulse(trace)
    motions = np.flatnonzero(stream.buffered.kind < Buffered.DELAY)
    if box is None or not len(motions):
        return None
    dark, calls, first = without_laser(stream), stream.buffered, int(motions[0])
    x_low, x_high, y_low, y_high = box
    corners = np.rint([(x_low, y_low), (x_high, y_low), (x_high, y_high), (x_low, y_high), (x_low, y_low)])
    rows = calls.pick(np.full(len(corners), first))
    fields = {name: rows.column(name) for name in BufferedCalls.__slots__}
    zeros = {name: np.zeros(len(corners)) for name in ("p", "q", "r", "vel_end")}
    kind = np.full(len(corners), Buffered.LINE, dtype=np.uint8)
    framed = BufferedCalls(**(fields | zeros | {"kind": kind, "x": corners[:, 0], "y": corners[:, 1]}))
    crd, fifo, line = int(rows.crd[0]), int(rows.fifo[0]), int(rows.line[0])
    built = [c for c in dark.calls if c.name == "GT_SetCrdPrm" and c.args[0] == crd][:1]
    clear = Call(name="GT_CrdClear", args=(float(crd), float(fifo)), at=0, line=line)
    start = crd_start(crd, fifo, at=len(corners), line=line)
    at_rest = [Call(name=c.name, args=c.args, at=0, line=c.line) for c in built]
    return Stream(name=stream.name, buffered=framed, calls=(*at_rest, clear, start))


def box_pulse(trace: Trace) -> tuple[float, float, float, float] | None:
    """(x low, x high, y low, y high) of all marks, or of all motion if nothing is marked; None without motion."""
    lit = np.zeros(len(trace), dtype=np.bool_)
    for channel in trace.channels:
        lit |= channel.emitted.emission_ms > 0
    taken = np.flatnonzero(lit if lit.any() else ~trace.schedule.dwell)
    if not len(taken):
        return None
    x_low, x_high, y_low, y_high = trace.segments.extent(taken)
    return float(x_low.min()), float(x_high.max()), float(y_low.min()), float(y_high.max())
