"""The controller's laser outputs as a VCD file (IEEE 1364, 18), for GTKWave, PulseView and other viewers."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from vcd import VCDWriter
from vcd.writer import Variable

from gusjob.interpreter import Trace
from gusjob.signals.outputs import NS_PER_MS, Edges, Level, Window, changes, line_names, windows_of
from gusjob.signals.timeline import timeline_of

_SCOPE = "outputs"
_PLUS = {Level.LOW: "0", Level.HIGH: "1", Level.UNKNOWN: "x"}
_MINUS = {Level.LOW: "1", Level.HIGH: "0", Level.UNKNOWN: "x"}


def vcd_pieces(
    trace: Trace, lines: npt.NDArray[np.int32], version: str, start_ms: float = 0.0, end_ms: float | None = None
) -> Iterator[bytes]:
    """A VCD file in pieces, 1 ns a unit: the outputs of each channel that is used, and the source line that runs.

    `lines` (m,): source line of each timed call, as it is to be shown. Times count from the first stage's start; off
    delays between stages take their time (see timeline).
    """
    out = io.StringIO()
    runs = _running_lines(trace, lines)
    writer = None
    for window in windows_of(trace, start_ms, end_ms):
        edges = {**window.lines, "line": changes(*runs, 0.0, *window.span_ns)}
        if writer is None:
            writer = _Writer(out, trace, edges, window, version)
        writer.write(edges)
        yield _drained(out)
        last_ns = window.span_ns[1]
    assert writer is not None
    writer.writer.close(last_ns)
    yield _drained(out)


def _running_lines(trace: Trace, lines: npt.NDArray[np.int32]) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """The source line from moments on, ns."""
    clock = trace.clock
    start_ms = clock.times[:-1] + timeline_of(trace).shift_ms[clock.stage]
    return np.rint(start_ms * NS_PER_MS).astype(np.int64), lines.astype(np.float64)


def _drained(out: io.StringIO) -> bytes:
    text = out.getvalue()
    out.seek(0)
    out.truncate()
    return text.encode()


class _Writer:
    """The file's variables, each with the words for its values."""

    def __init__(self, out: io.StringIO, trace: Trace, edges: dict[str, Edges], window: Window, version: str) -> None:
        self.writer = VCDWriter(
            out,
            timescale="1 ns",
            date="",
            version=f"gusjob {version}",
            comment="laser outputs by M 1.1 and 1.2: + lines rest high",
            init_timestamp=window.span_ns[0],
        )
        self.wires: dict[str, list[tuple[Variable[Any], dict[Level, str]]]] = {}
        self.numbers: dict[str, Variable[Any]] = {}
        for channel in trace.channels:
            *wires, analog = line_names(channel.channel)
            for name in wires:
                level = Level(int(edges[name].first))
                self.wires[name] = [
                    (self.writer.register_var(_SCOPE, name + sign, "wire", size=1, init=words[level]), words)
                    for sign, words in (("+", _PLUS), ("-", _MINUS))
                ]
            self.numbers[analog] = self.writer.register_var(_SCOPE, analog, "real", init=edges[analog].first)
        self.numbers["line"] = self.writer.register_var(
            _SCOPE, "line", "integer", size=32, init=int(edges["line"].first)
        )

    def write(self, edges: dict[str, Edges]) -> None:
        """What changes, in order of time."""
        names = list(edges)
        time = np.concatenate([edges[name].time_ns for name in names])
        order = np.argsort(time, kind="stable")
        which = np.repeat(np.arange(len(names)), [len(edges[name].time_ns) for name in names])[order]
        value = np.concatenate([edges[name].value for name in names])[order]
        change = self.writer.change
        for at_ns, number, new in zip(time[order].tolist(), which.tolist(), value.tolist(), strict=True):
            name = names[number]
            if name in self.wires:
                for wire, words in self.wires[name]:
                    change(wire, at_ns, words[new])
            else:
                change(self.numbers[name], at_ns, int(new) if name == "line" else new)
