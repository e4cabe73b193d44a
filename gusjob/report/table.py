"""A report as text tables."""

from __future__ import annotations

from io import StringIO
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gusjob.i18n.phrases import Phrase, all_of, figure, localized, plural, printable
from gusjob.report.rows import Report, kind_for_people, while_off
from gusjob.simulate.kinds import SegmentKind
from gusjob.simulate.quality.marks import MARKING_WORDS, marking_unit

MAX_ROWS = 40
_WIDTH = 400
"""Wide enough for two channels, so that no number is cut; a narrow terminal wraps the line."""
_HEADS = {
    "line": Phrase("line"),
    "kind": Phrase("kind"),
    "x_mm": "x mm",
    "y_mm": "y mm",
    "length_mm": "mm",
    "start_ms": Phrase("start ms"),
    "duration_ms": "ms",
    "vel_mean_mm_s": "mm/s",
    "vel_max_mm_s": Phrase("max mm/s"),
}
_CHANNEL_HEADS = {
    "emission_ms": Phrase("on ms"),
    "power_min": Phrase("min"),
    "power_mean": Phrase("mean"),
    "power_max": Phrase("max"),
    "joules": "J",
    "clamped_ms": Phrase("held ms"),
    "unit": Phrase("unit"),
}
_MARK_HEADS = {
    "line": Phrase("line"),
    "channel": Phrase("ch"),
    "start_ms": Phrase("start ms"),
    "length_mm": "mm",
    "on_error_um": Phrase("on err um"),
    "off_error_um": Phrase("off err um"),
    "on_miss_um": Phrase("on miss um"),
    "off_miss_um": Phrase("off miss um"),
    "outside_power_ms": Phrase("outside"),
    "power_per_mm_mid": Phrase("per mm"),
    "power_per_mm_peak": Phrase("peak"),
    "power_per_mm_rms_pct": Phrase("rms %"),
    "corner_miss_um": Phrase("corner um"),
}


def report_table(report: Report, *, summary: bool, color: bool = False) -> str:
    """Format the totals and, unless `summary`, segments and marks; of a long table the first and last rows."""
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
        console.print(Text("\n" + localized(Phrase("marks (+: late)"))))
        console.print(_marks(report.marks))
    return "".join(line.rstrip() + "\n" for line in out.getvalue().splitlines())


def _summary(report: Report) -> Text:
    totals = report.totals
    lines = [_overall(report)]
    for entry in totals["channels"]:
        lines.append(_channel(entry))
        if entry["lit_at_end"]:
            lines.append(Phrase("channel {channel} is left ON", channel=entry["channel"]))
    lines += [_marking(entry) for entry in totals["marking"] or ()]
    if report.marks is None:
        lines.append(Phrase("mark quality is not computed; use --marks"))
    lines += [
        Phrase(
            "line {line}: GT_GetHSIOOpt reads {value} on channel {channel}",
            line=reading["line"],
            value=reading["value"],
            channel=reading["channel"],
        )
        for reading in report.notes["readings"]
    ]
    return Text("\n".join([printable(report.job), *(f"  {localized(line)}" for line in lines)]) + "\n")


def _overall(report: Report) -> Phrase:
    totals = report.totals
    stages = (
        Phrase("{count} stage", count=totals["stages"])
        if totals["stages"] == 1
        else Phrase("{count} stages", count=totals["stages"])
    )
    return Phrase(
        "{segments} segments in {stages}, {duration} ms; marks {mark} mm, jumps {jump} mm{runs}; "
        "period {period} us{scanner}",
        segments=totals["segments"],
        stages=stages,
        duration=figure(totals["duration_ms"]),
        mark=figure(totals["mark_mm"]),
        jump=figure(totals["jump_mm"]),
        runs=_runs(totals),
        period=figure(report.period_us),
        scanner=_scanner(report),
    )


def _channel(entry: dict[str, Any]) -> Phrase:
    """Describe the emission of a channel in one power unit."""
    joules = Phrase(", {joules} J", joules=figure(entry["joules"])) if entry["joules"] is not None else ""
    held = Phrase(", held by a limit {time} ms", time=figure(entry["clamped_ms"])) if entry["clamped_ms"] else ""
    off = while_off(entry["off_output"])
    return Phrase(
        "channel {channel}: on {time} ms, {power} {unit}*ms, highest {highest} {unit}{joules}{held}{rest}",
        channel=entry["channel"],
        time=figure(entry["emission_ms"]),
        power=figure(entry["power_ms"]),
        unit=entry["unit"],
        highest=figure(entry["power_max"]),
        joules=joules,
        held=held,
        rest=Phrase("; while off {output}", output=off) if off else "",
    )


def _scanner(report: Report) -> str:
    """Describe the scanner, if it is known."""
    scanner = report.notes["scanner"]
    if not scanner:
        return ""
    lag = figure(scanner["tracking_error_us"])
    return Phrase(", scanner {model} {lag} us", model=scanner["model"], lag=lag)


def _runs(totals: dict[str, Any]) -> str:
    """Describe run-ins and run-outs, if there are any."""
    run_ins, run_outs = totals.get("run_in_mm"), totals.get("run_out_mm")
    return Phrase(
        "{run_ins}{run_outs}",
        run_ins=Phrase(", run-ins {length} mm", length=figure(run_ins)) if run_ins else "",
        run_outs=Phrase(", run-outs {length} mm", length=figure(run_outs)) if run_outs else "",
    )


def _marking(entry: dict[str, Any]) -> Phrase:
    """Describe worst and typical value of each mark quality measure that is not 0."""
    figures = all_of(
        Phrase(
            "{word} {worst} ({typical}) {unit}",
            word=word,
            worst=figure(entry["worst"][name]),
            typical=figure(entry["typical"][name]),
            unit=marking_unit(name, entry["unit"]),
        )
        for name, word in MARKING_WORDS.items()
        if entry["worst"][name]
    )
    channel, count = entry["channel"], entry["marks"]
    marks = plural(count, Phrase("{count} mark", count=count), Phrase("{count} marks", count=count))
    if not figures:
        return Phrase("channel {channel}: {marks}", channel=channel, marks=marks)
    return Phrase(
        "channel {channel}: {marks}, worst (typical): {figures}", channel=channel, marks=marks, figures=figures
    )


def _segments(report: Report) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    names = [n for n in report.columns if n in _HEADS]
    channels = [n for n in report.columns if n.startswith("ch") and n.split("_", 1)[1] in _CHANNEL_HEADS]
    channels = [n for n in channels if not (n.endswith("joules") and np.isnan(report.columns[n]).all())]
    channels = [n for n in channels if not (n.endswith("clamped_ms") and not report.columns[n].any())]
    for name in names:
        table.add_column(localized(_HEADS[name]), justify="left" if name == "kind" else "right", no_wrap=True)
    for name in channels:
        head = Phrase("ch{channel} {what}", channel=name[2], what=_CHANNEL_HEADS[name[4:]])
        table.add_column(localized(head), justify="right", no_wrap=True)
    words = report.words | {"kind": tuple(map(kind_for_people, SegmentKind))}
    _fill(table, {name: report.columns[name] for name in (*names, *channels)}, words)
    return table


def _marks(marks: dict[str, npt.NDArray[Any]]) -> Table:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in _MARK_HEADS:
        table.add_column(localized(_MARK_HEADS[name]), justify="right", no_wrap=True)
    _fill(table, {name: marks[name] for name in _MARK_HEADS}, {})
    return table


def _fill(table: Table, columns: dict[str, npt.NDArray[Any]], words: dict[str, tuple[str, ...]]) -> None:
    """Add all rows, or the first and last of many."""
    rows = len(columns["line"])
    shown = range(rows) if rows <= MAX_ROWS else [*range(MAX_ROWS // 2), -1, *range(rows - MAX_ROWS // 2, rows)]
    for i in shown:
        if i < 0:
            table.add_row("...", localized(Phrase("{count} more", count=rows - MAX_ROWS)))
            continue
        cells = []
        for name, column in columns.items():
            value = column[i]
            cells.append(words[name][int(value)] if name in words else figure(float(value)))
        table.add_row(*cells)
