"""`gusjob trace`: the run as signals over time."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click
from msgspec import Struct

from gusjob.cli.common import (
    exit_code,
    file_argument,
    machine_option,
    need,
    output_option,
    refuse_terminal,
    scanner_option,
    show,
    write,
)
from gusjob.cli.define import define_option
from gusjob.cli.endings import output_format
from gusjob.cli.language import Command
from gusjob.cli.quiet import quiet_option
from gusjob.cli.standard_input import input_file, stdin_filename_option
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.ir.overrides import overrides_text
from gusjob.pipeline import Simulated, simulate_file
from gusjob.version import __version__

if TYPE_CHECKING:  # Start-up time is part of the tool.
    import numpy as np
    import numpy.typing as npt

    from gusjob.config.machine import Scanner
    from gusjob.ir.overrides import Overrides
    from gusjob.kinematics.arrays import Bools, Indices
    from gusjob.simulate import Trace

_FORMATS = ("vcd", "csv", "parquet", "npz")
_ENDINGS = {f".{form}": form for form in _FORMATS}
_EXTRA = {"vcd": ("trace", "vcd"), "parquet": ("parquet", "pyarrow")}
_UNITS_MS = {"us": 1e-3, "ms": 1.0, "s": 1e3, "": 1.0}


class _Bound(Struct, frozen=True, kw_only=True):
    """Begin or end of a trace: a time, or a source line."""

    time_ms: float = 0.0
    line: int = 0


def _bound(_context: click.Context, _parameter: click.Parameter, text: str | None) -> _Bound | None:
    """Parse a time (12.5, 12.5ms, 300us, 1.5s) or a line (line:40)."""
    if text is None:
        return None
    line = re.fullmatch(r"line:([1-9]\d{0,8})", text.strip(), re.ASCII)
    if line:
        return _Bound(line=int(line[1]))
    time = re.fullmatch(r"(\d{1,12}\.?\d{0,9}|\.\d{1,9}) ?(us|ms|s|)", text.strip(), re.ASCII)
    if not time:
        wrong = Phrase(
            "{text} is neither a time nor a line: write 12.5 (ms), 300us, 1.5s or line:40", text=printable(text)[:40]
        )
        raise click.BadParameter(localized(wrong))
    return _Bound(time_ms=float(time[1]) * _UNITS_MS[time[2]])


@click.command(name="trace", cls=Command)
@file_argument
@machine_option
@scanner_option
@define_option
@stdin_filename_option
@click.option(
    "--format", "form", type=click.Choice(_FORMATS), help="Default: by the output file's extension, else vcd."
)
@click.option(
    "--from", "first", callback=_bound, metavar="TIME|line:N", help="Begin at this time or line. Default: the start."
)
@click.option(
    "--to", "last", callback=_bound, metavar="TIME|line:N", help="End at this time or line. Default: the end."
)
@output_option
@quiet_option
def command(
    path: Path,
    machine_path: Path | None,
    scanner: Scanner | None,
    overrides: Overrides,
    stdin_filename: Path | None,
    form: str | None,
    first: _Bound | None,
    last: _Bound | None,
    output: Path | None,
) -> None:
    """Write the run as signals over time.

    vcd: the controller's laser outputs (PWM0+ to PWM3-, AO0, AO1) to 1 ns, for logic-analyser viewers such as GTKWave
    and PulseView. csv, parquet, npz: a table of the controller's ticks with position, velocity, and power and
    emission of each channel. Time counts from the first stage's start, off delays between stages included.
    """
    form = output_format(form, output, _ENDINGS)
    if form in _EXTRA:
        need(*_EXTRA[form], to=Phrase("write {form}", form=form))
    if form in ("parquet", "npz"):
        refuse_terminal(form, output)
    file = input_file(path, stdin_filename)
    result = simulate_file(file.path, machine_path, scanner=scanner, data=file.data, overrides=overrides)
    if isinstance(result, Simulated):
        write(_written(result, form, first, last), output, sources=result.inputs)
    show(result, notes=not isinstance(result, Simulated))
    sys.exit(exit_code(result))


def _written(result: Simulated, form: str, first: _Bound | None, last: _Bound | None) -> Iterable[bytes]:
    """Write the trace in a format."""
    from gusjob.report.rows import own_lines

    trace = result.trace
    lines, files = own_lines(trace.line, result.files)
    start_ms, end_ms = _span_ms(trace, lines * (files == 0), first, last)
    if form == "vcd":
        from gusjob.simulate.outputs.vcd import vcd_pieces

        return vcd_pieces(trace, lines, __version__, start_ms, end_ms, comment=_overridden(result.overrides))
    from gusjob.simulate.outputs.tick_table import tick_table
    from gusjob.tables.export import csv_bytes, parquet_bytes
    from gusjob.tables.npz import npz_bytes

    table = tick_table(trace, result.machine, lines, start_ms, end_ms)
    if form == "parquet":
        about = {"schema": b"gusjob-trace/1", "job": trace.name.encode(), "period_us": str(trace.period_us).encode()}
        if result.overrides:
            import orjson

            about["overrides"] = orjson.dumps(dict(result.overrides))
        return parquet_bytes(table, about)
    return csv_bytes(table) if form == "csv" else npz_bytes(table)


def _overridden(overrides: Overrides) -> str:
    return f"-D {overrides_text(overrides)}" if overrides else ""


def _span_ms(
    trace: Trace, lines: npt.NDArray[np.int32], first: _Bound | None, last: _Bound | None
) -> tuple[float, float]:
    """Return start and end of the selected part. `lines`: lines of the job's own file, 0 for other files."""
    from gusjob.simulate.outputs.output_time import output_time_of

    output_time = output_time_of(trace)
    later_ms = output_time.shift_ms[trace.schedule.stage]
    start_ms = 0.0 if first is None else first.time_ms
    end_ms = output_time.total_ms if last is None else min(last.time_ms, output_time.total_ms)
    if first is not None and first.line:
        start_ms = float(
            (trace.schedule.times_ms[:-1] + later_ms)[_selected_segments("--from", first.line, lines >= first.line)[0]]
        )
    if last is not None and last.line:
        upto = (lines > 0) & (lines <= last.line)
        end_ms = float((trace.schedule.times_ms[1:] + later_ms)[_selected_segments("--to", last.line, upto)[-1]])
    if start_ms > end_ms:
        wrong = Phrase(
            "--from {start} ms is after --to {end} ms; the run takes {total} ms",
            start=f"{start_ms:.6g}",
            end=f"{end_ms:.6g}",
            total=f"{output_time.total_ms:.6g}",
        )
        raise click.UsageError(localized(wrong))
    return start_ms, end_ms


def _selected_segments(option: str, line: int, is_selected: Bools) -> Indices:
    """Return the indices of the selected segments; exit if there are none."""
    at = is_selected.nonzero()[0]
    if not len(at):
        if option == "--from":
            wrong = Phrase("{option}: nothing moves at line {line} or after it", option=option, line=line)
        else:
            wrong = Phrase("{option}: nothing moves at line {line} or before it", option=option, line=line)
        raise click.UsageError(localized(wrong))
    return at
