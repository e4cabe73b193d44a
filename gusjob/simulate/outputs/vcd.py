"""The controller's laser outputs as a VCD file (IEEE 1364, 18), for GTKWave, PulseView and other viewers."""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt
from vcd import VCDWriter

from gusjob.kinematics.arrays import Floats, Ints
from gusjob.simulate import Trace
from gusjob.simulate.outputs.levels import Edges, Level, changes, line_names, to_ns, windows_of
from gusjob.simulate.outputs.timeline import timeline_of

_SCOPE, _LINE = "outputs", "line"
_PLUS = {Level.LOW: "0", Level.HIGH: "1", Level.UNKNOWN: "x"}
_MINUS = {Level.LOW: "1", Level.HIGH: "0", Level.UNKNOWN: "x"}


def vcd_pieces(
    trace: Trace, lines: npt.NDArray[np.int32], version: str, start_ms: float = 0.0, end_ms: float | None = None
) -> Iterator[bytes]:
    """A VCD file in pieces, 1 ns a unit: the outputs of each channel that is used, and the source line that runs.

    `lines` (m,): source line of each timed call, as it is to be shown. Times count from the first stage's start; off
    delays between stages take their time (see timeline).
    """
    runs = _running_lines(trace, lines)
    outputs: list[_Output] = []
    for window in windows_of(trace, start_ms, end_ms):
        edges = {**window.lines, _LINE: changes(*runs, 0.0, *window.span_ns)}
        if not outputs:
            head, outputs = _head(trace, edges, version, window.span_ns[0])
            yield head.encode()
        yield _changes_text(edges, outputs).encode()
        end_ns = window.span_ns[1]
        ended = end_ns == window.span_ns[0] or any(one.time_ns[-1:].tolist() == [end_ns] for one in edges.values())
    if not ended:
        yield f"#{end_ns}\n".encode()


def _running_lines(trace: Trace, lines: npt.NDArray[np.int32]) -> tuple[Ints, Floats]:
    """The source line from moments on, ns."""
    clock = trace.clock
    start_ms = clock.times_ms[:-1] + timeline_of(trace).shift_ms[clock.stage]
    return to_ns(start_ms), lines.astype(np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Output:
    """An output in the file, and what the file says of its values: of a pair of wires one of three texts."""

    name: str
    levels: tuple[str, ...]
    ident: str

    def texts(self, values: Floats) -> list[str]:
        """What is said of values."""
        if self.levels:
            return list(map(self.levels.__getitem__, values.astype(np.intp).tolist()))
        return [f"r{value:.16g} {self.ident}\n" for value in values.tolist()]


def _head(trace: Trace, edges: dict[str, Edges], version: str, start_ns: int) -> tuple[str, list[_Output]]:
    """Everything up to the values at the start, and the outputs that change from there on."""
    out = io.StringIO()
    writer = VCDWriter(
        out,
        timescale="1 ns",
        date="",
        version=f"gusjob {version}",
        comment="laser outputs by M 1.1 and 1.2: + lines rest high",
        init_timestamp=start_ns,
    )
    outputs = []
    for channel in trace.channels:
        *wires, analog = line_names(channel.channel)
        for name in wires:
            first = Level(int(edges[name].first))
            plus = writer.register_var(_SCOPE, f"{name}+", "wire", size=1, init=_PLUS[first]).ident
            minus = writer.register_var(_SCOPE, f"{name}-", "wire", size=1, init=_MINUS[first]).ident
            levels = tuple(f"{_PLUS[level]}{plus}\n{_MINUS[level]}{minus}\n" for level in Level)
            outputs.append(_Output(name=name, levels=levels, ident=plus))
        volts = writer.register_var(_SCOPE, analog, "real", init=edges[analog].first)
        outputs.append(_Output(name=analog, levels=(), ident=volts.ident))
    # A number as a vector would keep libsigrok 0.5.2 from reading on.
    line = writer.register_var(_SCOPE, _LINE, "real", init=edges[_LINE].first)
    outputs.append(_Output(name=_LINE, levels=(), ident=line.ident))
    writer.flush()
    return out.getvalue(), outputs


def _changes_text(edges: dict[str, Edges], outputs: list[_Output]) -> str:
    """What changes, in order of time. Written here, as the library takes a call for every change."""
    time = np.concatenate([edges[output.name].time_ns for output in outputs])
    order = np.argsort(time, kind="stable")
    said = [text for output in outputs for text in output.texts(edges[output.name].value)]
    time = time[order]
    fresh = np.ones(len(time), dtype=np.bool_)
    fresh[1:] = time[1:] != time[:-1]
    stamps = np.full(len(time), "", dtype=object)
    stamps[fresh] = list(map("#%d\n".__mod__, time[fresh].tolist()))
    return "".join(chain.from_iterable(zip(stamps.tolist(), map(said.__getitem__, order.tolist()), strict=True)))
