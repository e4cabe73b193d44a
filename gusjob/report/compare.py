"""A report against an earlier one: which segments and totals moved by more than a tolerance."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import orjson
from rich.cells import cell_len

from gusjob.i18n.phrases import Phrase, figure, localized, number, plural
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.report.earlier import ANY_UNIT, CHANNELS, COUNTS, FIGURES, POWERS, Columns, EarlierReport, Key, flat_totals
from gusjob.report.match import matched_rows
from gusjob.report.rows import OFF_OUTPUT, Report, SegmentKind

MAX_ROWS = 40

_ROUNDING = 1e-9
"""Figures that differ by less, in parts of the larger one, differ by the order in which they were summed."""
_NOTHING = 1e-6
"""Less is no difference either: a nanosecond, a nanometre, a millionth of a unit of power, a nanojoule."""


_WORDS = {
    "segments": Phrase("segments"), "stages": Phrase("stages"), "duration_ms": Phrase("duration_ms"),
    "period_us": Phrase("period_us"), "mark_mm": Phrase("mark_mm"), "jump_mm": Phrase("jump_mm"),
    "emission_ms": Phrase("emission_ms"), "power": Phrase("power"), "power_min": Phrase("power_min"),
    "power_mean": Phrase("power_mean"), "power_max": Phrase("power_max"), "power_ms": Phrase("power_ms"),
    "joules": Phrase("joules"), "lit_at_end": Phrase("lit_at_end"), "clamped_ms": Phrase("clamped_ms"),
    "before_motion_power_ms": Phrase("before_motion_power_ms"), "unit": Phrase("unit"), **OFF_OUTPUT,
}  # fmt: skip
"""Names of figures as in the JSON, for people."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TotalChange:
    """A total that moved. A null is None; with it, and for words, the change has no percentage."""

    what: str
    channel: int | None
    unit: str | None
    old: float | str | None
    new: float | str | None
    change_pct: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnChange:
    """One figure where it moved: `pair` numbers the matched segments, ascending. A null is NaN."""

    pair: Indices
    old: npt.NDArray[Any]
    new: npt.NDArray[Any]
    change_pct: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentComparison:
    """Matched segments: row `old_row[i]` of the earlier columns `old` is row `new_row[i]` of this report's, `new`.

    `moved` is by column, `kind` among them. `appeared` are rows of this report, `vanished` of the earlier one.
    `shifted`: line numbers changed, and lines were matched in their order.
    """

    old: Columns
    new: Columns
    old_row: Indices
    new_row: Indices
    appeared: Indices
    vanished: Indices
    shifted: bool
    moved: dict[str, ColumnChange]

    @property
    def changed(self) -> Indices:
        """Matched segments of which something moved, in the order of this report."""
        changed = np.zeros(len(self.new_row), dtype=np.bool_)
        for what in self.moved.values():
            changed[what.pair] = True
        return np.flatnonzero(changed)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """What moved. `segments` is None where the earlier report has totals only."""

    path: str
    job: str
    tolerance_pct: float
    totals: tuple[TotalChange, ...]
    segments: SegmentComparison | None

    @property
    def same(self) -> bool:
        """Whether nothing moved."""
        rows = self.segments
        return not self.totals and (rows is None or not (rows.moved or len(rows.appeared) or len(rows.vanished)))


def compare(report: Report, earlier: EarlierReport, tolerance_pct: float) -> Comparison:
    """What moved since the earlier report, by more than the tolerance, in percent of the larger of two figures."""
    tolerance = tolerance_pct / 100 + _ROUNDING
    old = earlier.totals
    new = flat_totals(report.totals) | {("period_us", None, None): report.period_us}
    totals: list[TotalChange] = []
    left_out: set[str] = set()
    for channel in CHANNELS:
        units, now = _units(old, channel), _units(new, channel)
        if units != now:
            totals.append(TotalChange(what="unit", channel=channel, unit=None, old=units, new=now, change_pct=None))
            left_out |= {f"ch{channel}_{figure}" for figure in POWERS}
            old, new = _in_any_unit(old, channel), _in_any_unit(new, channel)
    segments = None
    if earlier.columns is not None:
        segments = _compare_segments(earlier.columns, report.columns, tolerance, left_out)
    return Comparison(
        path=earlier.path,
        job=earlier.job,
        tolerance_pct=tolerance_pct,
        totals=(*totals, *_changed_totals(old, new, tolerance)),
        segments=segments,
    )


def _units(totals: dict[Key, float], channel: int) -> str | None:
    return ", ".join(unit for name, at, unit in totals if at == channel and name == "emission_ms" and unit) or None


def _in_any_unit(totals: dict[Key, float], channel: int) -> dict[Key, float]:
    """Totals in which those of a channel are its sums over all units, of what has the same meaning in each."""
    mine = {key: value for key, value in totals.items() if key[1] == channel}
    sums: dict[Key, float] = {
        (name, channel, None): sum(value for key, value in mine.items() if key[0] == name) + 0.0 for name in ANY_UNIT
    }
    return {**{key: value for key, value in totals.items() if key not in mine}, **sums}


def _changed_totals(old: dict[Key, float], new: dict[Key, float], tolerance: float) -> Iterator[TotalChange]:
    keys = [key for key in new if key in old]
    before, now = (np.array([totals[key] for key in keys]) for totals in (old, new))
    tolerances = np.array([_ROUNDING if key[0] in COUNTS else tolerance for key in keys])
    where, change_pct = _changes_above(before, now, tolerances, np.array([_smallest_change(key[0]) for key in keys]))
    for i, pct in zip(where.tolist(), change_pct.tolist(), strict=True):
        what, channel, unit = keys[i]
        a, b, c = (None if value != value else float(value) for value in (before[i], now[i], pct))
        yield TotalChange(what=what, channel=channel, unit=unit, old=a, new=b, change_pct=c)


def _smallest_change(what: str) -> float:
    return _NOTHING / 1e3 if what.endswith("joules") else _NOTHING


def _changes_above(
    old: Floats, new: Floats, tolerance: Floats | float, nothing: Floats | float
) -> tuple[Indices, Floats]:
    """Where figures moved, and by how many percent of the larger magnitude; NaN where one of them is null."""
    with np.errstate(all="ignore"):
        larger = np.maximum(np.abs(old), np.abs(new))
        change = new / larger - old / larger  # The difference of huge figures would overflow.
        moved = (np.abs(change) > tolerance) & (np.abs(new - old) > nothing)
    where = np.flatnonzero(moved | (np.isnan(old) != np.isnan(new)))
    return where, change[where] * 100


def _compare_segments(old: Columns, new: Columns, tolerance: float, left_out: set[str]) -> SegmentComparison:
    old_row, new_row, shifted = matched_rows(old, new)
    moved: dict[str, ColumnChange] = {}
    kinds = np.flatnonzero(old["kind"][old_row] != new["kind"][new_row])
    if len(kinds):
        none = np.full(len(kinds), np.nan)
        before, now = old["kind"][old_row[kinds]], new["kind"][new_row[kinds]]
        moved["kind"] = ColumnChange(pair=kinds, old=before, new=now, change_pct=none)
    names = ["duration_ms", *(f"ch{channel}_{figure}" for channel in CHANNELS for figure in FIGURES)]
    for name in names:
        if name in left_out or not (name in old or name in new):
            continue
        a = old[name][old_row] if name in old else _without_emission(new[name][new_row])
        b = new[name][new_row] if name in new else _without_emission(a)
        where, change_pct = _changes_above(a, b, tolerance, _smallest_change(name))
        if len(where):
            moved[name] = ColumnChange(pair=where, old=a[where], new=b[where], change_pct=change_pct)
    return SegmentComparison(
        old=old,
        new=new,
        old_row=old_row,
        new_row=new_row,
        appeared=_unmatched_rows(new_row, len(new["line"])),
        vanished=_unmatched_rows(old_row, len(old["line"])),
        shifted=shifted,
        moved=moved,
    )


def _without_emission(other: Floats) -> Floats:
    """A figure of a channel that one report does not have, beside the other report's: no light, or unknown as there."""
    return np.where(np.isnan(other), np.nan, 0.0)


def _unmatched_rows(rows: Indices, count: int) -> Indices:
    left = np.ones(count, dtype=np.bool_)
    left[rows] = False
    return np.flatnonzero(left)


def against_json(comparison: Comparison) -> orjson.Fragment:
    """The field `against` of the report's JSON.

    `path` and `job` of the earlier report; `tolerance_pct`; `same`; `totals`: a list of those that moved, objects of
    `what`, `channel`, `unit`, `old`, `new`, `change_pct`; `segments`: null if the earlier report has none, else

    - `matched`: "line", or "order" where line numbers changed;
    - `moved`: by figure (the name of a column of segments, `kind` among them) columns `row`, `old_row`, `line`, `old`,
      `new`, `change_pct`;
    - `new`: columns `row`, `line`; `vanished`: columns `old_row`, `line`.

    `row` and `old_row` count from 0 in the segments of this report and of the earlier one. `change_pct` is in percent
    of the larger magnitude; null where `old` or `new` is null or a word (`kind`, `unit`).
    """
    return orjson.Fragment(
        orjson.dumps(
            {
                "path": comparison.path,
                "job": comparison.job,
                "tolerance_pct": comparison.tolerance_pct,
                "same": comparison.same,
                "totals": comparison.totals,
                "segments": None if comparison.segments is None else _segments_object(comparison.segments),
            },
            option=orjson.OPT_SERIALIZE_NUMPY,
        )
    )


def _segments_object(segments: SegmentComparison) -> dict[str, Any]:
    old_line, new_line = segments.old["line"], segments.new["line"]
    moved = {
        name: {
            "row": segments.new_row[what.pair],
            "old_row": segments.old_row[what.pair],
            "line": new_line[segments.new_row[what.pair]],
            "old": [_word(kind) for kind in what.old] if name == "kind" else what.old,
            "new": [_word(kind) for kind in what.new] if name == "kind" else what.new,
            "change_pct": what.change_pct,
        }
        for name, what in segments.moved.items()
    }
    return {
        "matched": "order" if segments.shifted else "line",
        "moved": moved,
        "new": {"row": segments.appeared, "line": new_line[segments.appeared]},
        "vanished": {"old_row": segments.vanished, "line": old_line[segments.vanished]},
    }


def _word(kind: int) -> str:
    return SegmentKind(kind).word


def _count_totals(count: int) -> Phrase:
    return plural(count, Phrase("{count} total", count=count), Phrase("{count} totals", count=count))


def _count_segments(count: int) -> Phrase:
    return plural(count, Phrase("{count} segment", count=count), Phrase("{count} segments", count=count))


def verdict(comparison: Comparison) -> list[str]:
    """What came out, and how it was compared."""
    within, rows = f"{figure(comparison.tolerance_pct)} %", comparison.segments
    totals = _count_totals(len(comparison.totals))
    told: list[str] = []
    if comparison.same:
        told.append(Phrase("same within {within}", within=within))
    elif rows is None:
        told.append(Phrase("moved by more than {within}: {totals}", within=within, totals=totals))
    else:
        told.append(
            Phrase(
                "moved by more than {within}: {totals}, {segments}; {new} new, {vanished} vanished",
                within=within,
                totals=totals,
                segments=_count_segments(len(rows.changed)),
                new=len(rows.appeared),
                vanished=len(rows.vanished),
            )
        )
    if rows is None:
        told.append(Phrase("the earlier report has totals only: segments are not compared"))
    elif rows.shifted:
        told.append(Phrase("line numbers changed: lines are matched in their order"))
    told += [
        Phrase("the unit of channel {channel} changed: its powers are not compared", channel=total.channel)
        for total in comparison.totals
        if total.what == "unit"
    ]
    return told


def totals_rows(comparison: Comparison) -> list[list[str]]:
    """Each total that moved as its name, unit, old and new value, and change; for people, in their language."""
    return [
        [
            localized(_total_name(total)),
            f"{total.unit}{'*ms' * total.what.endswith('_ms')}" if total.unit and "power" in total.what else "",
            _total_figure(total.what, total.old),
            _total_figure(total.what, total.new),
            _percent(total.change_pct),
        ]
        for total in comparison.totals
    ]


def _total_name(total: TotalChange) -> Phrase:
    word = _WORDS[total.what]
    return word if total.channel is None else Phrase("channel {channel} {what}", channel=total.channel, what=word)


def _total_figure(what: str, value: float | str | None) -> str:
    if isinstance(value, str):
        return value
    return number(value) if what in COUNTS and isinstance(value, float) else figure(value)


def segment_rows(segments: SegmentComparison, most: int = MAX_ROWS) -> Iterator[list[str]]:
    """A head and a row for each of the first segments that moved, are new or vanished; a last row counts the others.

    In the user's language.
    """
    shown = _shown(segments.moved)
    yield [*map(localized, _SEGMENT_HEADS), *(localized(_head(name)) for name in shown)]
    changed = segments.changed
    for pair in changed[:most].tolist():
        yield _changed_row(segments, pair, shown.values())
    rest = most - min(len(changed), most)
    new, old = segments.new, segments.old
    blank = [""] * len(shown)
    for row in segments.appeared[:rest].tolist():
        kind = SegmentKind(new["kind"][row]).localized
        yield [str(row + 1), str(new["line"][row]), localized(Phrase("new {kind}", kind=kind)), *blank]
    rest -= min(len(segments.appeared), rest)
    for row in segments.vanished[:rest].tolist():
        kind = SegmentKind(old["kind"][row]).localized
        yield ["-", str(old["line"][row]), localized(Phrase("vanished {kind}", kind=kind)), *blank]
    more = len(changed) + len(segments.appeared) + len(segments.vanished) - most
    if more > 0:
        yield ["...", "", localized(Phrase("{count} more", count=more)), *blank]


_SEGMENT_HEADS = (Phrase("segment"), Phrase("line"), Phrase("kind"))


def _head(name: str) -> str:
    """Of a column of the segments: duration_ms, ch0_power ..."""
    if name in _WORDS:
        return _WORDS[name]
    return Phrase("ch{channel}_{what}", channel=name[2], what=_WORDS[name[4:]])


def _shown(moved: dict[str, ColumnChange]) -> dict[str, ColumnChange]:
    """What gets a column of its own: the three powers of a channel get one where they are one."""
    shown = {name: what for name, what in moved.items() if name != "kind"}
    for channel in CHANNELS:
        names = [f"ch{channel}_{power}" for power in POWERS[:3]]
        first, *others = (moved.get(name) for name in names)
        if first and all(other and _equal(first, other) for other in others):
            shown = {f"ch{channel}_power" if n == names[0] else n: w for n, w in shown.items() if n not in names[1:]}
    return shown


def _equal(one: ColumnChange, other: ColumnChange) -> bool:
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
        _from_to(
            SegmentKind(segments.old["kind"][old_row]).localized, SegmentKind(segments.new["kind"][row]).localized
        ),
    ]
    for what in shown:
        at = int(np.searchsorted(what.pair, pair))
        here = at < len(what.pair) and what.pair[at] == pair
        cells.append(
            f"{figure(what.old[at])} -> {figure(what.new[at])} {_percent(what.change_pct[at])}" if here else ""
        )
    return [cell.rstrip() for cell in cells]


def _from_to(old: str, new: str) -> str:
    return new if old == new else f"{old} -> {new}"


def _percent(change_pct: float | None) -> str:
    return "" if change_pct is None or change_pct != change_pct else f"{change_pct:+.3g} %"


def comparison_text(comparison: Comparison) -> str:
    """For a terminal."""
    first, *others = verdict(comparison)
    against = Phrase("against {report}: {outcome}", report=comparison.path, outcome=first)
    lines = [localized(against), *(f"  {localized(line)}" for line in others)]
    totals = [[what, unit, f"{old} -> {new}", change] for what, unit, old, new, change in totals_rows(comparison)]
    for rows in (totals, [*segment_rows(comparison.segments)] if comparison.segments else []):
        if len(rows) > (rows is not totals):
            widths = [max(map(cell_len, column)) for column in zip(*rows, strict=True)]
            lines += ["", *("  ".join(map(_padded, row, widths)).rstrip() for row in rows)]
    return "\n".join(lines) + "\n"


def _padded(cell: str, width: int) -> str:
    return cell + " " * (width - cell_len(cell))  # A wide character takes two columns.
