"""Totals and tables of a report as text for people."""

from __future__ import annotations

from collections.abc import Iterable
from io import StringIO
from typing import Any

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.table import Table
from rich.text import Text

from gusjob.i18n.phrases import Phrase, all_of, localized, plural
from gusjob.i18n.width import width as columns_of
from gusjob.kinematics.arrays import median
from gusjob.kinematics.units import MS_PER_S
from gusjob.report.quantities import TABLE_DIGITS, duration, energy, length, power_time, short
from gusjob.report.rows import Report, kind_for_people, while_off
from gusjob.simulate.kinds import SegmentKind
from gusjob.simulate.quality.marks import MARKING_WORDS, marking_unit

MAX_ROWS = 40
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
    "clamped_ms": Phrase("limited ms"),
    "unit": Phrase("unit"),
}
_IN_SECONDS = {
    "start_ms": Phrase("start s"),
    "duration_ms": "s",
    "emission_ms": Phrase("on s"),
    "clamped_ms": Phrase("limited s"),
}
"""Heads of columns whose usual value is more than a second."""
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
_FIRST_LEFT_OUT = (
    *("vel_max_mm_s", "power_min", "clamped_ms", "start_ms", "power_max", "emission_ms", "joules", "y_mm", "x_mm"),
    *(
        "corner_miss_um",
        "power_per_mm_rms_pct",
        "on_error_um",
        "off_error_um",
        "outside_power_ms",
        "channel",
        "power_per_mm_mid",
    ),
    *("length_mm", "duration_ms"),
)
"""Columns of the tables that a narrow terminal does not show, the first one first."""


def tables_text(report: Report, *, width: int, color: bool) -> str:
    """Format the totals and the tables of segments and marks; of a long table the first and last rows."""
    out = StringIO()
    console = Console(
        file=out,
        width=width,
        height=1,  # Without it, TERM=dumb would set the width.
        force_terminal=color,
        color_system="standard" if color else None,
        no_color=not color,
        highlight=False,
        markup=False,
        emoji=False,
        legacy_windows=False,
    )
    console.print(_totals(report))
    _print_table(console, {n: report.columns[n] for n in _segment_columns(report)}, report, width)
    if report.marks and len(report.marks["line"]):
        console.print(Text("\n" + localized(Phrase("marks (+: late)"))))
        _print_table(console, {n: report.marks[n] for n in _MARK_HEADS}, report, width)
    return "".join(line.rstrip() + "\n" for line in out.getvalue().splitlines())


def _totals(report: Report) -> Text:
    totals = report.totals
    lines = [_overall(report), *map(_channel, totals["channels"])]
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
    return Text("\n".join(localized(line) for line in lines) + "\n")


def _overall(report: Report) -> Phrase:
    totals = report.totals
    segments, stages = totals["segments"], totals["stages"]
    in_segments = plural(
        segments, Phrase("{count} segment", count=segments), Phrase("{count} segments", count=segments)
    )
    in_stages = plural(stages, Phrase("{count} stage", count=stages), Phrase("{count} stages", count=stages))
    return Phrase(
        "{segments} in {stages}, {duration}; marks {mark}, jumps {jump}{runs}",
        segments=in_segments,
        stages=in_stages,
        duration=duration(totals["duration_ms"]),
        mark=length(totals["mark_mm"]),
        jump=length(totals["jump_mm"]),
        runs=_runs(totals),
    )


def _channel(entry: dict[str, Any]) -> Phrase:
    """Describe the emission of a channel in one power unit."""
    joules = Phrase(", {energy}", energy=energy(entry["joules"])) if entry["joules"] is not None else ""
    held = Phrase(", limited for {time}", time=duration(entry["clamped_ms"])) if entry["clamped_ms"] else ""
    off = while_off(entry["off_output"])
    if not (entry["emission_ms"] or entry["power_ms"]):
        never = Phrase("channel {channel}: laser never on", channel=entry["channel"])
        dark = Phrase("channel {channel}: laser never on; while off {output}", channel=entry["channel"], output=off)
        return dark if off else never
    return Phrase(
        "channel {channel}: on {time}, {power}, highest {highest} {unit}{joules}{held}{rest}",
        channel=entry["channel"],
        time=duration(entry["emission_ms"]),
        power=power_time(entry["power_ms"], entry["unit"]),
        unit=entry["unit"],
        highest=short(entry["power_max"]),
        joules=joules,
        held=held,
        rest=Phrase("; while off {output}", output=off) if off else "",
    )


def _runs(totals: dict[str, Any]) -> str:
    """Describe run-ins and run-outs, if there are any."""
    run_ins, run_outs = totals.get("run_in_mm"), totals.get("run_out_mm")
    return Phrase(
        "{run_ins}{run_outs}",
        run_ins=Phrase(", run-ins {length}", length=length(run_ins)) if run_ins else "",
        run_outs=Phrase(", run-outs {length}", length=length(run_outs)) if run_outs else "",
    )


def _marking(entry: dict[str, Any]) -> Phrase:
    """Describe worst and typical value of each mark quality measure that is not 0."""
    figures = all_of(
        Phrase(
            "{word} {worst} ({typical}) {unit}",
            word=word,
            worst=short(entry["worst"][name]),
            typical=short(entry["typical"][name]),
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


def _segment_columns(report: Report) -> list[str]:
    """Names of the columns that have something to show."""
    names = [n for n in report.columns if n in _HEADS]
    channels = [n for n in report.columns if n.startswith("ch") and n[4:] in _CHANNEL_HEADS]
    channels = [n for n in channels if not (n.endswith("joules") and np.isnan(report.columns[n]).all())]
    channels = [n for n in channels if not (n.endswith("clamped_ms") and not report.columns[n].any())]
    return [*names, *channels]


def _print_table(console: Console, columns: dict[str, npt.NDArray[Any]], report: Report, width: int) -> None:
    """Print a table, or the first and last of many rows, with the columns that fit the width."""
    count = len(columns["line"])
    if not count:
        return
    rows = range(count) if count <= MAX_ROWS else [*range(MAX_ROWS // 2), *range(count - MAX_ROWS // 2, count)]
    words = report.words | {"kind": tuple(map(kind_for_people, SegmentKind))}
    texts = {name: _texts(name, column, rows, words) for name, column in columns.items()}
    more = localized(Phrase("{count} more", count=count - MAX_ROWS)) if count > MAX_ROWS else ""
    kept = _fitting(texts, width, more)
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for name in kept:
        table.add_column(texts[name][0], justify="left" if name == "kind" else "right", no_wrap=True)
    for number in range(len(rows)):
        if number == MAX_ROWS // 2 and more:
            table.add_row("...", more)
        table.add_row(*(texts[name][number + 1] for name in kept))
    console.print(table)
    if left_out := [texts[name][0] for name in texts if name not in kept]:
        note = Phrase("not shown at this width: {columns}", columns=all_of(left_out))
        console.print(Text(localized(note), style="dim"))


def _texts(name: str, column: npt.NDArray[Any], rows: Iterable[int], words: dict[str, tuple[str, ...]]) -> list[str]:
    """Head and cells of a column."""
    if name in words:
        return [_head(name), *(words[name][int(column[row])] for row in rows)]
    measure = name[4:] if name.startswith("ch") and name != "channel" else name
    long = measure in _IN_SECONDS and _usual(measure, column) >= MS_PER_S
    scale = MS_PER_S if long else 1.0
    return [_head(name, seconds=long), *(short(float(column[row]) / scale, TABLE_DIGITS) for row in rows)]


def _usual(measure: str, column: npt.NDArray[Any]) -> float:
    """The value that decides on the unit of a column."""
    return float(column[-1] if measure == "start_ms" else median(column))


def _head(name: str, *, seconds: bool = False) -> str:
    if name in _MARK_HEADS and name not in _HEADS:
        return localized(_MARK_HEADS[name])
    if name in _HEADS:
        return localized(_IN_SECONDS[name] if seconds else _HEADS[name])
    what = _IN_SECONDS[name[4:]] if seconds else _CHANNEL_HEADS[name[4:]]
    return localized(Phrase("ch{channel} {what}", channel=name[2], what=what))


def _fitting(texts: dict[str, list[str]], width: int, more: str) -> list[str]:
    """Choose the columns that fit a width: the least important ones are left out first.

    `more`: the count of the rows that are left out; it is written into the second column.
    """
    widths = {name: max(map(columns_of, cells)) + 2 for name, cells in texts.items()}
    kept = list(texts)
    for measure in _FIRST_LEFT_OUT:
        wider = max(0, columns_of(more) + 2 - widths[kept[1]])
        if sum(widths[name] for name in kept) + wider - 2 <= width:
            break
        kept = [name for name in kept if name != measure and not (name.startswith("ch") and name[4:] == measure)]
    return kept
