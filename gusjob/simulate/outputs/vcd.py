"""The controller's laser outputs as a VCD file (IEEE 1364, 18), for GTKWave, PulseView and other viewers."""

from __future__ import annotations

import io
from collections.abc import Iterator
from itertools import chain

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from vcd import VCDWriter

from gusjob.kinematics.arrays import Floats, Ints
from gusjob.simulate import Trace
from gusjob.simulate.outputs.levels import Edges, Level, changes, line_names, to_ns, windows_of
from gusjob.simulate.outputs.output_time import output_time_of

_SCOPE, _LINE = "outputs", "line"
_PLUS = {Level.LOW: "0", Level.HIGH: "1", Level.UNKNOWN: "x"}
_MINUS = {Level.LOW: "1", Level.HIGH: "0", Level.UNKNOWN: "x"}


def vcd_pieces(
    trace: Trace,
    lines: npt.NDArray[np.int32],
    version: str,
    start_ms: float = 0.0,
    end_ms: float | None = None,
    *,
    comment: str = "",
) -> Iterator[bytes]:
    """Write a VCD file in pieces, 1 ns a unit: the outputs of each channel that is used, and the source line that runs.

    Times count from the first stage's start; off delays between stages are included (see output_time.py).

    Args:
        trace: The simulation.
        lines: Source line of each segment to be shown, (m,).
        version: Version of the program.
        start_ms: Start of the file, ms.
        end_ms: End of the file, ms; None: the end of the run.
        comment: A further line of the comment at the head.
    """
    runs = _running_lines(trace, lines)
    outputs: list[_Output] = []
    for window in windows_of(trace, start_ms, end_ms):
        edges = {**window.lines, _LINE: changes(*runs, 0.0, *window.interval_ns)}
        if not outputs:
            head, outputs = _head(trace, edges, version, window.interval_ns[0], comment)
            yield head.encode()
        yield _changes_text(edges, outputs).encode()
        end_ns = window.interval_ns[1]
        ended = end_ns == window.interval_ns[0] or any(one.time_ns[-1:].tolist() == [end_ns] for one in edges.values())
    if not ended:
        yield f"#{end_ns}\n".encode()


def _running_lines(trace: Trace, lines: npt.NDArray[np.int32]) -> tuple[Ints, Floats]:
    """Source line from moments on, ns."""
    schedule = trace.schedule
    start_ms = schedule.times_ms[:-1] + output_time_of(trace).shift_ms[schedule.stage]
    return to_ns(start_ms), lines.astype(np.float64)


class _Output(Struct, frozen=True, kw_only=True):
    """An output in the file. `levels`: the text for each level of a pair of wires, empty for numbers."""

    name: str
    levels: tuple[str, ...]
    ident: str

    def texts(self, values: Floats) -> list[str]:
        """Texts of values."""
        if self.levels:
            return list(map(self.levels.__getitem__, values.astype(np.intp).tolist()))
        return [f"r{value:.16g} {self.ident}\n" for value in values.tolist()]


def _head(
    trace: Trace, edges: dict[str, Edges], version: str, start_ns: int, comment: str
) -> tuple[str, list[_Output]]:
    """Write the file up to the values at its start; return the outputs, too."""
    out = io.StringIO()
    writer = VCDWriter(
        out,
        timescale="1 ns",
        date="",
        version=f"gusjob {version}",
        comment="\n".join(filter(None, ["laser outputs by M 1.1 and 1.2: + lines rest high", comment])),
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
    """Write the changes in order of time, without a call of the library for every change."""
    time = np.concatenate([edges[output.name].time_ns for output in outputs])
    order = np.argsort(time, kind="stable")
    texts = [text for output in outputs for text in output.texts(edges[output.name].value)]
    time = time[order]
    fresh = np.ones(len(time), dtype=np.bool_)
    fresh[1:] = time[1:] != time[:-1]
    stamps = np.full(len(time), "", dtype=object)
    stamps[fresh] = list(map("#%d\n".__mod__, time[fresh].tolist()))
    return "".join(chain.from_iterable(zip(stamps.tolist(), map(texts.__getitem__, order.tolist()), strict=True)))
