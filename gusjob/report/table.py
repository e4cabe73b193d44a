"""Reports as text tables, for people."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gusjob.diagnostics import figure, printable
from gusjob.report.marks import MARKING_WORDS, marking_unit
from gusjob.report.rows import Report

MAX_ROWS = 40
_WIDTH = 400
"""Wide enough for two channels: a figure is never cut off; a narrow terminal wraps the line."""
_HEADS = {"line": "line", "kind": "kind", "x_mm": "x mm", "y_mm": "y mm", "length_mm": "mm", "start_ms": "start ms",
          "duration_ms": "ms", "vel_mean_mm_s": "mm/s", "vel_max_mm_s": "max mm/s"}  # fmt: skip
_CHANNEL_HEADS = {"emission_ms": "on ms", "power_min": "min", "power_mean": "mean", "power_max": "max",
                  "joules": "J", "clamped_ms": "held ms", "unit": "unit"}  # fmt: skip
_MARK_HEADS = {"line": "line", "channel": "ch", "start_ms": "start ms", "length_mm": "mm", "on_error_um": "on err um",
               "off_error_um": "off err um", "on_miss_um": "on miss um", "off_miss_um": "off miss um",
               "outside_power_ms": "outside", "power_per_mm_mid": "per mm", "power_per_mm_peak": "peak",
               "power_per_mm_rms_pct": "rms %", "corner_miss_um": "corner um"}  # fmt: skip


def report_table(report: Report, *, summary: bool, color: bool = False) -> str:
    """Summary, and the segments' table: all rows of a short one, first and last of a long one."""
    out = StringIO()
    console = Console(
        file=out,
        width=_WIDTH,
        force_terminal=color,
        no_color=not color,
        highlight=False,
        legacy_windows=False,
    )
    console.print(_summary(report))
    if not summary and len(report):
        console.print(_segments(report))
    if not summary and report.marks and len(report.marks["line"]):
        console.print(Text("\nmarks (+: late)"))
        console.print(_marks(report.marks))
    return "".join(line.rstrip() + "\n" for line in out.getvalue().splitlines())


def _summary(report: Report) -> Text:
    totals = report.totals
    lines = [
        printable(report.job),
        f"  {totals['segments']} segments in {totals['stages']} stage{'s' if totals['stages'] != 1 else ''}, "
        f"{figure(totals['duration_ms'])} ms; marks {figure(totals['mark_mm'])} mm, jumps "
        f"{figure(totals['jump_mm'])} mm{_runs(totals)}; "
        f"period {figure(report.period_us)} us{_scanner(report)}",
    ]
    for entry in totals["channels"]:
        unit = entry["unit"]
        joules = f", {figure(entry['joules'])} J" if entry["joules"] is not None else ""
        held = f", held by a limit {figure(entry['clamped_ms'])} ms" if entry["clamped_ms"] else ""
        off = entry["off_output"]
        rest = "; while off " + ", ".join(f"{k} {figure(v)}" for k, v in off.items()) if off else ""
        lines.append(
            f"  channel {entry['channel']}: on {figure(entry['emission_ms'])} ms, {figure(entry['power_ms'])} "
            f"{unit}*ms, "
            f"highest {figure(entry['power_max'])} {unit}{joules}{held}{rest}"
        )
        if entry["lit_at_end"]:
            lines.append(f"  channel {entry['channel']} is left ON")
    lines += [_marking(entry) for entry in totals["marking"] or ()]
    if report.marks is None:
        lines.append("  marks are not judged: --marks judges them")
    lines += [
        f"  line {r['line']}: GT_GetHSIOOpt reads {r['value']} on channel {r['channel']}"
        for r in report.notes["readings"]
    ]
    return Text("\n".join(lines) + "\n")


def _scanner(report: Report) -> str:
    """How the beam follows, where that is known."""
    scanner = report.notes["scanner"]
    return f", scanner {scanner['model']} {figure(scanner['tracking_error_us'])} us" if scanner else ""


def _runs(totals: dict[str, Any]) -> str:
    """Run-ins and run-outs, where there are any."""
    words = {"run_in_mm": "run-ins", "run_out_mm": "run-outs"}
    return "".join(f", {word} {figure(totals[name])} mm" for name, word in words.items() if totals.get(name))


def _marking(entry: dict[str, Any]) -> str:
    """Worst and typical of each figure that is not 0."""
    said = [
        f"{word} {figure(value)} ({figure(entry['typical'][name])}) {marking_unit(name, entry['unit'])}"
        for name, word in MARKING_WORDS.items()
        if (value := entry["worst"][name])
    ]
    marks = f"{entry['marks']} mark{'s' if entry['marks'] != 1 else ''}"
    return f"  channel {entry['channel']}: {marks}" + ", worst (typical): " * bool(said) + ", ".join(said)


def _segments(report: Report) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    names = [n for n in report.columns if n in _HEADS]
    channels = [n for n in report.columns if n.startswith("ch") and n.split("_", 1)[1] in _CHANNEL_HEADS]
    channels = [n for n in channels if not (n.endswith("joules") and np.isnan(report.columns[n]).all())]
    channels = [n for n in channels if not (n.endswith("clamped_ms") and not report.columns[n].any())]
    for name in names:
        table.add_column(_HEADS[name], justify="left" if name == "kind" else "right", no_wrap=True)
    for name in channels:
        channel, _, what = name.partition("_")
        table.add_column(f"{channel} {_CHANNEL_HEADS[what]}", justify="right", no_wrap=True)
    _fill(table, {name: report.columns[name] for name in (*names, *channels)}, report.words)
    return table


def _marks(marks: dict[str, npt.NDArray[Any]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in _MARK_HEADS:
        table.add_column(_MARK_HEADS[name], justify="right", no_wrap=True)
    _fill(table, {name: marks[name] for name in _MARK_HEADS}, {})
    return table


def _fill(table: Table, columns: dict[str, npt.NDArray[Any]], words: dict[str, tuple[str, ...]]) -> None:
    """All rows of a few, first and last of many."""
    rows = len(columns["line"])
    shown = range(rows) if rows <= MAX_ROWS else [*range(MAX_ROWS // 2), -1, *range(rows - MAX_ROWS // 2, rows)]
    for i in shown:
        if i < 0:
            table.add_row("...", f"{rows - MAX_ROWS} more")
            continue
        cells = []
        for name, column in columns.items():
            value = column[i]
            cells.append(words[name][int(value)] if name in words else figure(float(value)))
        table.add_row(*cells)
