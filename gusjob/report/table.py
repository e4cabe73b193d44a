"""Reports as text tables, for people."""

from __future__ import annotations

from io import StringIO

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gusjob.diagnostics import number, printable
from gusjob.report.rows import Report, SegmentKind

MAX_ROWS = 40
_WIDTH = 400
"""Wide enough for two channels: a figure is never cut off; a narrow terminal wraps the line."""
_HEADS = {"line": "line", "kind": "kind", "x_mm": "x mm", "y_mm": "y mm", "length_mm": "mm", "start_ms": "start ms",
          "duration_ms": "ms", "vel_mean_mm_s": "mm/s", "vel_max_mm_s": "max mm/s"}  # fmt: skip
_CHANNEL_HEADS = {"emission_ms": "on ms", "power_min": "min", "power_mean": "mean", "power_max": "max",
                  "joules": "J", "clamped_ms": "held ms"}  # fmt: skip


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
    return "".join(line.rstrip() + "\n" for line in out.getvalue().splitlines())


def _figure(value: float | None, digits: int = 6) -> str:
    """Six digits are what people compare; -0 and nothing are shown as they are meant."""
    if value is None or value != value:
        return "-"
    return number(float(f"{value:.{digits}g}") + 0.0)


def _summary(report: Report) -> Text:
    totals = report.totals
    lines = [
        printable(report.job),
        f"  {totals['segments']} segments in {totals['stages']} stage{'s' if totals['stages'] != 1 else ''}, "
        f"{_figure(totals['duration_ms'])} ms; marks {_figure(totals['mark_mm'])} mm, jumps "
        f"{_figure(totals['jump_mm'])} mm; "
        f"period {_figure(report.period_us)} us",
    ]
    for entry in totals["channels"]:
        unit = entry["unit"]
        joules = f", {_figure(entry['joules'])} J" if entry["joules"] is not None else ""
        held = f", held by a limit {_figure(entry['clamped_ms'])} ms" if entry["clamped_ms"] else ""
        off = entry["off_output"]
        rest = "; while off " + ", ".join(f"{k} {_figure(v)}" for k, v in off.items()) if off else ""
        lines.append(
            f"  channel {entry['channel']}: on {_figure(entry['emission_ms'])} ms, {_figure(entry['power_ms'])} "
            f"{unit}*ms, "
            f"highest {_figure(entry['power_max'])} {unit}{joules}{held}{rest}"
        )
        if entry["lit_at_end"]:
            lines.append(f"  channel {entry['channel']} is left ON")
    lines += [
        f"  line {r['line']}: GT_GetHSIOOpt reads {r['value']} on channel {r['channel']}"
        for r in report.notes["readings"]
    ]
    return Text("\n".join(lines) + "\n")


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
    rows = len(report)
    shown = range(rows) if rows <= MAX_ROWS else [*range(MAX_ROWS // 2), -1, *range(rows - MAX_ROWS // 2, rows)]
    for i in shown:
        if i < 0:
            table.add_row("...", f"{rows - MAX_ROWS} more")
            continue
        cells = []
        for name in (*names, *channels):
            value = report.columns[name][i]
            cells.append(SegmentKind(int(value)).word if name == "kind" else _figure(float(value)))
        table.add_row(*cells)
    return table
