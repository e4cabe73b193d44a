"""Comparison of a report with an earlier one: segments and totals that changed by more than a tolerance."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.ir.overrides import Overrides
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.report.earlier import ANY_UNIT, CHANNELS, COUNTS, FIGURES, POWERS, Columns, EarlierReport, Key, flat_totals
from gusjob.report.match import matched_rows
from gusjob.report.rows import OFF_OUTPUT, Report

_ROUNDING = 1e-9
"""Smaller relative differences come from the order of summation."""
_OUTPUT = {"emission_ms", "power_ms", "before_motion_power_ms", "lit_at_end", *OFF_OUTPUT}
"""Totals of a channel that has any output."""
_SMALLEST_CHANGE = 1e-6
"""Smaller absolute differences are ignored: 1 ns, 1 nm, a millionth of a unit of power, 1 nJ."""


class TotalChange(Struct, frozen=True, kw_only=True):
    """A total that changed. Null values are None; they and texts have no percentage."""

    what: str
    channel: int | None
    unit: str | None
    old: float | str | None
    new: float | str | None
    change_pct: float | None


class OverrideChange(Struct, frozen=True, kw_only=True):
    """A value of -D that changed. `old`, `new`: None where the name was not set by -D."""

    name: str
    old: str | None
    new: str | None


class ColumnChange(Struct, frozen=True, kw_only=True, eq=False):
    """The changes of one column, (k,) each. `pair`: indices of the matched segments, ascending. Null values are NaN."""

    pair: Indices
    old: npt.NDArray[Any]
    new: npt.NDArray[Any]
    change_pct: Floats


class SegmentComparison(Struct, frozen=True, kw_only=True, eq=False):
    """The segments of two reports.

    Attributes:
        old: Columns of the earlier report.
        new: Columns of this report.
        old_row: Rows of the matched segments in `old`, (n,).
        new_row: Rows of the same segments in `new`, (n,).
        appeared: Rows of `new` without a match.
        vanished: Rows of `old` without a match.
        shifted: Whether line numbers changed, so that lines were matched in their order.
        changes: By name of the column; `kind` is one of them.
    """

    old: Columns
    new: Columns
    old_row: Indices
    new_row: Indices
    appeared: Indices
    vanished: Indices
    shifted: bool
    changes: dict[str, ColumnChange]

    @property
    def changed(self) -> Indices:
        """Indices of the matched segments with any change, in the order of this report."""
        changed = np.zeros(len(self.new_row), dtype=np.bool_)
        for what in self.changes.values():
            changed[what.pair] = True
        return np.flatnonzero(changed)


class Comparison(Struct, frozen=True, kw_only=True):
    """The changes since an earlier report.

    `segments`: None if the earlier report has totals only. `overrides`: the changed values of -D; they alone are no
    change of the run.
    """

    path: str
    job: str
    tolerance_pct: float
    totals: tuple[TotalChange, ...]
    segments: SegmentComparison | None
    overrides: tuple[OverrideChange, ...] = ()

    @property
    def same(self) -> bool:
        """Whether nothing changed."""
        rows = self.segments
        return not self.totals and (rows is None or not (rows.changes or len(rows.appeared) or len(rows.vanished)))


def compare(report: Report, earlier: EarlierReport, tolerance_pct: float) -> Comparison:
    """Compare a report with an earlier one.

    Args:
        report: The report.
        earlier: The earlier report.
        tolerance_pct: Largest change that is ignored, in percent of the larger of two values.
    """
    tolerance = tolerance_pct / 100 + _ROUNDING
    old = earlier.totals
    new = flat_totals(report.totals) | {("period_us", None, None): report.period_us}
    old, new = _without_dark(old, new), _without_dark(new, old)
    totals: list[TotalChange] = []
    skipped: set[str] = set()
    for channel in CHANNELS:
        units, now = _power_units(old, channel), _power_units(new, channel)
        if units != now:
            totals.append(TotalChange(what="unit", channel=channel, unit=None, old=units, new=now, change_pct=None))
            skipped |= {f"ch{channel}_{figure}" for figure in POWERS}
            old, new = _in_any_unit(old, channel), _in_any_unit(new, channel)
    segments = None
    if earlier.columns is not None:
        segments = _compare_segments(earlier.columns, report.columns, tolerance, skipped)
    return Comparison(
        path=earlier.path,
        job=earlier.job,
        tolerance_pct=tolerance_pct,
        totals=(*totals, *_changed_totals(old, new, tolerance)),
        segments=segments,
        overrides=_changed_overrides(earlier.overrides, report.overrides),
    )


def _changed_overrides(old: Overrides, new: Overrides) -> tuple[OverrideChange, ...]:
    names = [*new, *(name for name in old if name not in new)]
    changes = (OverrideChange(name=name, old=old.get(name), new=new.get(name)) for name in names)
    return tuple(change for change in changes if change.old != change.new)


def _without_dark(totals: dict[Key, float], others: dict[Key, float]) -> dict[Key, float]:
    """Leave out the channels that the other report lacks and that have no output here: a mode alone is no change."""
    lit = {channel for (name, channel, _), value in totals.items() if name in _OUTPUT and value > 0}
    known = {channel for _, channel, _ in others}
    return {key: value for key, value in totals.items() if key[1] in lit | known}


def _power_units(totals: dict[Key, float], channel: int) -> str | None:
    return ", ".join(unit for name, at, unit in totals if at == channel and name == "emission_ms" and unit) or None


def _in_any_unit(totals: dict[Key, float], channel: int) -> dict[Key, float]:
    """Replace the totals of a channel by their sums over all units, if they have the same meaning in each unit."""
    of_channel = {key: value for key, value in totals.items() if key[1] == channel}
    sums: dict[Key, float] = {
        (name, channel, None): sum(value for key, value in of_channel.items() if key[0] == name) + 0.0
        for name in ANY_UNIT
    }
    return {**{key: value for key, value in totals.items() if key not in of_channel}, **sums}


def _changed_totals(old: dict[Key, float], new: dict[Key, float], tolerance: float) -> Iterator[TotalChange]:
    keys = [key for key in new if key in old]
    before, now = (np.array([totals[key] for key in keys]) for totals in (old, new))
    tolerances = np.array([_ROUNDING if key[0] in COUNTS else tolerance for key in keys])
    at, change_pct = _changes_above(before, now, tolerances, np.array([_smallest_change(key[0]) for key in keys]))
    for i, pct in zip(at.tolist(), change_pct.tolist(), strict=True):
        what, channel, unit = keys[i]
        old_values, new_values, c = (None if value != value else float(value) for value in (before[i], now[i], pct))
        yield TotalChange(what=what, channel=channel, unit=unit, old=old_values, new=new_values, change_pct=c)


def _smallest_change(what: str) -> float:
    return _SMALLEST_CHANGE / 1e3 if what.endswith("joules") else _SMALLEST_CHANGE


def _changes_above(
    old: Floats, new: Floats, tolerance: Floats | float, smallest: Floats | float
) -> tuple[Indices, Floats]:
    """Return the indices of changed values, and the changes in percent of the larger magnitude; NaN beside a null."""
    with np.errstate(all="ignore"):
        larger = np.maximum(np.abs(old), np.abs(new))
        change = new / larger - old / larger  # The difference of huge values would overflow.
        changed = (np.abs(change) > tolerance) & (np.abs(new - old) > smallest)
    at = np.flatnonzero(changed | (np.isnan(old) != np.isnan(new)))
    return at, change[at] * 100


def _compare_segments(old: Columns, new: Columns, tolerance: float, skipped: set[str]) -> SegmentComparison:
    old_row, new_row, shifted = matched_rows(old, new)
    changes: dict[str, ColumnChange] = {}
    differing_kinds = np.flatnonzero(old["kind"][old_row] != new["kind"][new_row])
    if len(differing_kinds):
        none = np.full(len(differing_kinds), np.nan)
        before, now = old["kind"][old_row[differing_kinds]], new["kind"][new_row[differing_kinds]]
        changes["kind"] = ColumnChange(pair=differing_kinds, old=before, new=now, change_pct=none)
    names = ["duration_ms", *(f"ch{channel}_{figure}" for channel in CHANNELS for figure in FIGURES)]
    for name in names:
        if name in skipped or not (name in old or name in new):
            continue
        old_values = old[name][old_row] if name in old else _without_emission(new[name][new_row])
        new_values = new[name][new_row] if name in new else _without_emission(old_values)
        at, change_pct = _changes_above(old_values, new_values, tolerance, _smallest_change(name))
        if len(at):
            changes[name] = ColumnChange(pair=at, old=old_values[at], new=new_values[at], change_pct=change_pct)
    return SegmentComparison(
        old=old,
        new=new,
        old_row=old_row,
        new_row=new_row,
        appeared=_unmatched_rows(new_row, len(new["line"])),
        vanished=_unmatched_rows(old_row, len(old["line"])),
        shifted=shifted,
        changes=changes,
    )


def _without_emission(other: Floats) -> Floats:
    """Return the column of a channel that one report lacks: no emission, and unknown where the other report's is."""
    return np.where(np.isnan(other), np.nan, 0.0)


def _unmatched_rows(rows: Indices, count: int) -> Indices:
    left = np.ones(count, dtype=np.bool_)
    left[rows] = False
    return np.flatnonzero(left)
