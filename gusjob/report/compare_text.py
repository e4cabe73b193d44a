"""A comparison of reports as text, for people."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from rich.cells import cell_len

from gusjob.i18n.phrases import Phrase, figure, localized, number, plural
from gusjob.report.compare import ColumnChange, Comparison, OverrideChange, SegmentComparison, TotalChange
from gusjob.report.earlier import CHANNELS, COUNTS, POWERS
from gusjob.report.rows import OFF_OUTPUT, kind_for_people

MAX_ROWS = 40

_WORDS = {
    "segments": Phrase("segments"),
    "stages": Phrase("stages"),
    "duration_ms": Phrase("duration_ms"),
    "period_us": Phrase("period_us"),
    "mark_mm": Phrase("mark_mm"),
    "jump_mm": Phrase("jump_mm"),
    "emission_ms": Phrase("emission_ms"),
    "power": Phrase("power"),
    "power_min": Phrase("power_min"),
    "power_mean": Phrase("power_mean"),
    "power_max": Phrase("power_max"),
    "power_ms": Phrase("power_ms"),
    "joules": Phrase("joules"),
    "lit_at_end": Phrase("lit_at_end"),
    "clamped_ms": Phrase("clamped_ms"),
    "before_motion_power_ms": Phrase("before_motion_power_ms"),
    "unit": Phrase("unit"),
    **OFF_OUTPUT,
}
"""Names of columns and totals as in the JSON, for people."""


def _count_totals(count: int) -> Phrase:
    return plural(count, Phrase("{count} total", count=count), Phrase("{count} totals", count=count))


def _count_segments(count: int) -> Phrase:
    return plural(count, Phrase("{count} segment", count=count), Phrase("{count} segments", count=count))


def outcome_lines(comparison: Comparison) -> list[str]:
    """Describe the result in one line, then how the reports were compared, a line each."""
    within, rows = f"{figure(comparison.tolerance_pct)} %", comparison.segments
    totals = _count_totals(len(comparison.totals))
    lines: list[str] = []
    if comparison.same:
        lines.append(Phrase("SAME within {within}", within=within))
    elif rows is None:
        lines.append(Phrase("CHANGED by more than {within}: {totals}", within=within, totals=totals))
    else:
        lines.append(
            Phrase(
                "CHANGED by more than {within}: {totals}, {segments}; {new} new, {vanished} removed",
                within=within,
                totals=totals,
                segments=_count_segments(len(rows.changed)),
                new=len(rows.appeared),
                vanished=len(rows.vanished),
            )
        )
    lines += map(_override_change, comparison.overrides)
    if rows is None:
        lines.append(Phrase("the earlier report has totals only: segments are not compared"))
    elif rows.shifted:
        lines.append(Phrase("line numbers changed: lines are matched in their order"))
    lines += [
        Phrase("the unit of channel {channel} changed: its powers are not compared", channel=total.channel)
        for total in comparison.totals
        if total.what == "unit"
    ]
    return lines


def _override_change(change: OverrideChange) -> Phrase:
    name, old, new = change.name, change.old, change.new
    if old is None:
        return Phrase("-D {name}={new}, which the earlier report does not have", name=name, new=new)
    if new is None:
        return Phrase("the earlier report has -D {name}={old}", name=name, old=old)
    return Phrase("-D {name}: {old} -> {new}", name=name, old=old, new=new)


def totals_rows(comparison: Comparison) -> list[list[str]]:
    """Return a row for each changed total, localized: name, unit, old value, new value, change."""
    return [
        [
            localized(_total_name(total)),
            f"{total.unit}{'·ms' * total.what.endswith('_ms')}" if total.unit and "power" in total.what else "",
            _total_figure(total.what, total.old),
            _total_figure(total.what, total.new),
            _percent(total.change_pct),
        ]
        for total in comparison.totals
    ]


def _total_name(total: TotalChange) -> Phrase:
    word = _WORDS[total.what]
    return word if total.channel is None else Phrase("channel {channel} {what}", channel=total.channel, what=word)


def _total_figure(name: str, value: float | str | None) -> str:
    if isinstance(value, str):
        return value
    return number(value) if name in COUNTS and isinstance(value, float) else figure(value)


def segment_rows(segments: SegmentComparison, most: int = MAX_ROWS) -> Iterator[list[str]]:
    """Yield a head, then a row for each changed, new and removed segment, localized.

    At most `most` rows; then one more row counts the others.
    """
    shown = _shown_columns(segments.changes)
    yield [*map(localized, _SEGMENT_HEADS), *(localized(_head(name)) for name in shown)]
    changed = segments.changed
    for pair in changed[:most].tolist():
        yield _changed_row(segments, pair, shown.values())
    rest = most - min(len(changed), most)
    new, old = segments.new, segments.old
    blank = [""] * len(shown)
    for row in segments.appeared[:rest].tolist():
        kind = kind_for_people(new["kind"][row])
        yield [str(row + 1), str(new["line"][row]), localized(Phrase("new {kind}", kind=kind)), *blank]
    rest -= min(len(segments.appeared), rest)
    for row in segments.vanished[:rest].tolist():
        kind = kind_for_people(old["kind"][row])
        yield ["-", str(old["line"][row]), localized(Phrase("removed {kind}", kind=kind)), *blank]
    more = len(changed) + len(segments.appeared) + len(segments.vanished) - most
    if more > 0:
        yield ["...", "", localized(Phrase("{count} more", count=more)), *blank]


_SEGMENT_HEADS = (Phrase("segment"), Phrase("line"), Phrase("kind"))


def _head(name: str) -> str:
    """Return the head of a column: duration_ms, ch0_power ..."""
    if name in _WORDS:
        return _WORDS[name]
    return Phrase("ch{channel}_{what}", channel=name[2], what=_WORDS[name[4:]])


def _shown_columns(changes: dict[str, ColumnChange]) -> dict[str, ColumnChange]:
    """Return the columns to show: the three powers of a channel become one column if their changes are equal."""
    shown = {name: change for name, change in changes.items() if name != "kind"}
    for channel in CHANNELS:
        names = [f"ch{channel}_{power}" for power in POWERS[:3]]
        first, *others = (changes.get(name) for name in names)
        if first and all(other and _same_changes(first, other) for other in others):
            shown = {f"ch{channel}_power" if n == names[0] else n: w for n, w in shown.items() if n not in names[1:]}
    return shown


def _same_changes(one: ColumnChange, other: ColumnChange) -> bool:
    return (
        np.array_equal(one.pair, other.pair)
        and np.array_equal(one.old, other.old, equal_nan=True)
        and np.array_equal(one.new, other.new, equal_nan=True)
    )


def _changed_row(segments: SegmentComparison, pair: int, shown: Iterable[ColumnChange]) -> list[str]:
    row, old_row = segments.new_row[pair], segments.old_row[pair]
    cells = [
        str(row + 1),
        _from_to(str(segments.old["line"][old_row]), str(segments.new["line"][row])),
        _from_to(kind_for_people(segments.old["kind"][old_row]), kind_for_people(segments.new["kind"][row])),
    ]
    for change in shown:
        at = int(np.searchsorted(change.pair, pair))
        here = at < len(change.pair) and change.pair[at] == pair
        cells.append(
            f"{figure(change.old[at])} -> {figure(change.new[at])} {_percent(change.change_pct[at])}" if here else ""
        )
    return [cell.rstrip() for cell in cells]


def _from_to(old: str, new: str) -> str:
    return new if old == new else f"{old} -> {new}"


def _percent(change_pct: float | None) -> str:
    return "" if change_pct is None or change_pct != change_pct else f"{change_pct:+.3g} %"


def comparison_text(comparison: Comparison) -> str:
    """Format a comparison for a terminal."""
    first, *others = outcome_lines(comparison)
    against = Phrase("{outcome} (against {report})", report=comparison.path, outcome=first)
    lines = [localized(against), *(f"  {localized(line)}" for line in others)]
    totals = [[name, unit, f"{old} -> {new}", change] for name, unit, old, new, change in totals_rows(comparison)]
    for rows in (totals, [*segment_rows(comparison.segments)] if comparison.segments else []):
        if len(rows) > (rows is not totals):
            widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
            lines += ["", *("  ".join(map(_pad, row, widths)).rstrip() for row in rows)]
    return "\n".join(lines) + "\n"


def _pad(cell: str, width: int) -> str:
    return cell + " " * (width - cell_len(cell))  # A wide character takes two columns.
