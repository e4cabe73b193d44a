"""The answer that a report begins with: one line that says how the run is, then what stands out, each with its line."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, assert_never

import numpy as np
from msgspec import Struct

from gusjob.config.machine import DEFAULT_NAME
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.i18n.phrases import Phrase, all_of, plural, printable
from gusjob.kinematics.arrays import Bools, Floats, blocks, median
from gusjob.report.quantities import duration, energy, length, percent, power_time, rated, short
from gusjob.report.rows import Report
from gusjob.simulate.kinds import SegmentKind

LEFT_ON = Phrase("LEFT ON")
"""Name of the finding that a laser is still on at the end."""
_BINS, _SORTED_AT_ONCE = 1000, 10_000
"""Of the weighted median: the part of the values that has it is halved by bins before it is sorted."""
_SLOW = 0.9
"""Share of the usual velocity of marks below which the slowest mark is named."""
_HOT = 1.05
"""Multiple of the usual energy per mm above which the hottest mark is compared with it."""
_LEAST_MISS_UM = 0.1
"""An end that is nearer to its intended point is not named: controllers have whole units of about 1 um."""
_LEAST_SHARE = 0.005
"""A kind of segments that takes less of the time is not named."""


class Finding(Struct, frozen=True, kw_only=True):
    """Something that stands out.

    Attributes:
        name: What it is, in one or two words.
        text: Its value.
        line: Source line, counted in its file; 0: none.
        file: The file of the line, '' for the job itself.
        segment: Its row among the segments; None: it is not one segment.
        mark: Its row among the marks; None: it is not one mark.
    """

    name: str
    text: str
    line: int = 0
    file: str = ""
    segment: int | None = None
    mark: int | None = None

    @property
    def place(self) -> str:
        """Its line for people, '' if it has none."""
        if not self.line:
            return ""
        return f"{printable(self.file)}:{self.line}" if self.file else Phrase("line {line}", line=self.line)


class Answer(Struct, frozen=True, kw_only=True):
    """The answer to a run. `headline`: its parts, in order. `setting`: profile, scanner and period, in order.

    `worst`: the highest severity of its diagnostics; None without errors and warnings.
    """

    worst: Severity | None
    headline: tuple[str, ...]
    setting: tuple[str, ...]
    findings: tuple[Finding, ...]


def answer_of(report: Report, diagnostics: Iterable[Diagnostic]) -> Answer:
    """Make the answer of a report.

    Args:
        report: The report.
        diagnostics: Everything that was found about its job.
    """
    diagnostics = tuple(diagnostics)
    found = {diagnostic.severity for diagnostic in diagnostics}
    return Answer(
        worst=next((severity for severity in (Severity.ERROR, Severity.WARNING) if severity in found), None),
        headline=tuple(_headline(report, diagnostics)),
        setting=tuple(_setting(report)),
        findings=tuple(_findings(report)),
    )


def status(diagnostics: Iterable[Diagnostic]) -> str:
    """Describe the diagnostics of a run in some words: OK, no warnings."""
    counts = Counter(diagnostic.severity for diagnostic in diagnostics)
    errors, warnings = counts[Severity.ERROR], counts[Severity.WARNING]
    warned = plural(warnings, Phrase("{count} warning", count=warnings), Phrase("{count} warnings", count=warnings))
    if errors:
        wrong = plural(errors, Phrase("{count} error", count=errors), Phrase("{count} errors", count=errors))
        return all_of([wrong, warned] if warnings else [wrong])
    return Phrase("OK, {warnings}", warnings=warned) if warnings else Phrase("OK, no warnings")


def _headline(report: Report, diagnostics: Iterable[Diagnostic]) -> Iterator[str]:
    totals = report.totals
    yield status(diagnostics)
    yield duration(totals["duration_ms"])
    emitting = [entry for entry in totals["channels"] if entry["emission_ms"] > 0]
    if not emitting:
        yield Phrase("laser never on")
    if len(emitting) == 1:
        (entry,) = emitting
        yield Phrase("laser on {time}", time=duration(entry["emission_ms"]))
        yield _peak(entry)
    yield Phrase("{length} marked", length=length(totals["mark_mm"]))
    if len(emitting) == 1:
        yield _dose(emitting[0])


def _peak(entry: dict[str, Any]) -> Phrase:
    return Phrase("peak {power}", power=rated(entry["power_max"], entry["unit"], entry["power_max_w"]))


def _dose(entry: dict[str, Any]) -> str:
    """Energy of a channel where its watts are known, else the integral of its power."""
    joules = entry["joules"]
    return power_time(entry["power_ms"], entry["unit"]) if joules is None else energy(joules)


def _setting(report: Report) -> Iterator[str]:
    machine, scanner = report.notes["machine"], report.notes["scanner"]
    if machine["profile"] is None:
        yield Phrase("no profile: documented defaults")
    elif machine["name"] not in (None, DEFAULT_NAME):
        yield Phrase("profile {path} ({name})", path=machine["profile"], name=machine["name"])
    else:
        yield Phrase("profile {path}", path=machine["profile"])
    if scanner:
        yield Phrase("scanner {model} {lag} us", model=scanner["model"], lag=short(scanner["tracking_error_us"]))
    else:
        yield Phrase("no scanner model")
    yield Phrase("period {period} us", period=short(report.period_us))


def _findings(report: Report) -> Iterator[Finding]:
    yield from _channels(report)
    if len(report):
        yield from _time(report)
        yield from _hottest(report)
        yield from _slowest(report)
        yield from _limited(report)
        yield from _in_jumps(report)
        yield from _worst_ends(report)


def _numbers_of(entries: Iterable[dict[str, Any]]) -> list[int]:
    """The channels of some entries of the totals, each once: a channel has an entry for each unit of power."""
    return list(dict.fromkeys(entry["channel"] for entry in entries))


def _channels(report: Report) -> Iterator[Finding]:
    """Lasers that are left on; where there are several powers, each with its totals."""
    channels = report.totals["channels"]
    for number in _numbers_of(entry for entry in channels if entry["lit_at_end"]):
        yield Finding(
            name=LEFT_ON,
            text=Phrase("the laser of channel {channel} is still on at the end", channel=number),
        )
    emitting = [entry for entry in channels if entry["emission_ms"] > 0]
    for entry in emitting if len(emitting) > 1 else ():
        text = Phrase(
            "on {time}, {peak}, {dose}",
            time=duration(entry["emission_ms"]),
            peak=_peak(entry),
            dose=_dose(entry),
        )
        yield Finding(name=Phrase("channel {channel}", channel=entry["channel"]), text=text)


def _time_of(kind: SegmentKind, share: str) -> Phrase:
    """Describe the share of the time that a kind of segments takes."""
    match kind:
        case SegmentKind.MARK:
            return Phrase("marks {share}", share=share)
        case SegmentKind.JUMP:
            return Phrase("jumps {share}", share=share)
        case SegmentKind.RUN_IN:
            return Phrase("run-ins {share}", share=share)
        case SegmentKind.RUN_OUT:
            return Phrase("run-outs {share}", share=share)
        case SegmentKind.DWELL:
            return Phrase("dwells {share}", share=share)
        case _:
            assert_never(kind)


def _time(report: Report) -> Iterator[Finding]:
    """Shares of the time."""
    total = report.totals["duration_ms"]
    sums = np.bincount(report.columns["kind"], weights=report.columns["duration_ms"], minlength=len(SegmentKind))
    shares = {kind: float(sums[kind]) / total for kind in SegmentKind} if total else {}
    named = [_time_of(kind, percent(share)) for kind, share in shares.items() if share >= _LEAST_SHARE]
    if len(named) > 1:
        yield Finding(name=Phrase("time"), text=all_of(named))


def _hottest(report: Report) -> Iterator[Finding]:
    """The mark with the highest energy per mm, of each unit."""
    marks = report.marks
    if not marks:
        return
    for entry in report.totals["channels"]:
        mine = _marks_of(report, entry)
        peaks = np.where(mine, np.nan_to_num(marks["power_per_mm_peak"], nan=-1.0), -1.0)
        if not mine.any() or peaks.max() <= 0:
            continue
        at = int(np.argmax(peaks))
        usual = _known_median(marks["power_per_mm_mid"][mine])
        value = _per_mm(float(peaks[at]), entry)
        text = value
        if usual > 0 and peaks[at] > _HOT * usual:
            text = Phrase(
                "{value}, {times} times the typical {typical}",
                value=value,
                times=short(float(peaks[at]) / usual, 2),
                typical=_per_mm(usual, entry),
            )
        yield _of_mark(report, Phrase("hottest"), text, at)


def _known_median(values: Floats) -> float:
    known = values[~np.isnan(values)]
    return median(known) if len(known) else 0.0


def _marks_of(report: Report, entry: dict[str, Any]) -> Bools:
    """Find the marks of a channel whose power has the unit of an entry of the totals."""
    assert report.marks is not None
    mine = np.asarray(report.marks["channel"] == entry["channel"])
    units = report.words.get(f"ch{entry['channel']}_unit")
    if units is None:
        return mine
    row = np.searchsorted(report.columns["start_ms"], report.marks["start_ms"], side="right") - 1
    unit = report.columns[f"ch{entry['channel']}_unit"][np.maximum(row, 0)]
    return np.asarray(mine & (unit == units.index(entry["unit"])))


def _per_mm(value: float, entry: dict[str, Any]) -> str:
    """Format an energy per mm: in joules where the watts are known, else as power times ms."""
    if entry["joules"] is not None and entry["power_ms"]:
        return f"{energy(value * entry['joules'] / entry['power_ms'])}/mm"
    return f"{short(value)} {entry['unit']}·ms/mm"


def _slowest(report: Report) -> Iterator[Finding]:
    """The slowest segment of a mark, if it is slower than usual."""
    columns = report.columns
    is_mark = (columns["kind"] == SegmentKind.MARK) & (columns["length_mm"] > 0)
    if not is_mark.any():
        return
    marked_mm, velocity = columns["length_mm"] * is_mark, columns["vel_mean_mm_s"]
    usual, slowest = _weighted_median(velocity, marked_mm), float(velocity.min(where=is_mark, initial=np.inf))
    if slowest < _SLOW * usual:
        text = Phrase("{value} mm/s on average, typical {typical} mm/s", value=short(slowest), typical=short(usual))
        yield _of_segment(report, Phrase("slowest"), text, int(np.argmax((velocity == slowest) & is_mark)))


def _weighted_median(values: Floats, weights: Floats) -> float:
    """Return the least of some values whose weight, with that of all smaller ones, is at least half of the whole."""
    half, below = float(weights.sum()) / 2, 0.0
    while len(values) > _SORTED_AT_ONCE and (step := (float(values.max()) - (low := float(values.min()))) / _BINS) > 0:
        number, share = np.empty(len(values), dtype=np.int16), np.zeros(_BINS)
        for part in blocks(len(values)):
            number[part] = np.minimum((values[part] - low) / step, _BINS - 1)
            share += np.bincount(number[part], weights[part], _BINS)
        upto = below + np.cumsum(share)
        at = min(int(np.searchsorted(upto, half)), _BINS - 1)
        inside = number == at
        if inside.all():
            break
        below = float(upto[at - 1]) if at else below
        values, weights = values[inside], weights[inside]
    order = np.argsort(values, kind="stable")
    place = np.searchsorted(below + np.cumsum(weights[order]), half)
    return float(values[order[min(int(place), len(order) - 1)]])


def _limited(report: Report) -> Iterator[Finding]:
    """The segment in which a limit changes the power for the longest time."""
    for number in _numbers_of(report.totals["channels"]):
        clamped = report.columns[f"ch{number}_clamped_ms"]
        emission_ms, total = float(report.columns[f"ch{number}_emission_ms"].sum()), float(clamped.sum())
        if total > 0 and emission_ms > 0:
            text = Phrase(
                "a limit changes the power for {time}, {share} of the emission",
                time=duration(total),
                share=percent(total / emission_ms),
            )
            yield _of_segment(report, Phrase("limited"), text, int(np.argmax(clamped)))


def _in_jumps(report: Report) -> Iterator[Finding]:
    """Emission that a delay carries into jumps."""
    jumps = np.flatnonzero(report.columns["kind"] == SegmentKind.JUMP)
    if not len(jumps):
        return
    emission = np.zeros(len(jumps))
    for number in _numbers_of(report.totals["channels"]):
        emission += report.columns[f"ch{number}_emission_ms"][jumps]
    longest = int(np.argmax(emission))
    if emission[longest] > 0:
        text = Phrase(
            "emission for {time}, at most {longest} in one jump",
            time=duration(float(emission.sum())),
            longest=duration(float(emission[longest])),
        )
        yield _of_segment(report, Phrase("in jumps"), text, int(jumps[longest]))


def _worst_ends(report: Report) -> Iterator[Finding]:
    """The marks that start and end farthest from their intended points."""
    for side, name in (("on", Phrase("worst start")), ("off", Phrase("worst end"))):
        if not report.marks or not len(report.marks["line"]):
            return
        miss, error = report.marks[f"{side}_miss_um"], report.marks[f"{side}_error_um"]
        at = int(np.argmax(np.nan_to_num(miss, nan=0.0)))
        if miss[at] >= _LEAST_MISS_UM:
            late = Phrase("{value} um from the intended point, late", value=short(float(miss[at])))
            early = Phrase("{value} um from the intended point, early", value=short(float(miss[at])))
            yield _of_mark(report, name, late if error[at] >= 0 else early, at)


def _of_mark(report: Report, name: str, text: str, at: int) -> Finding:
    assert report.marks is not None
    return Finding(name=name, text=text, mark=at, **_place(report, report.marks, at))


def _of_segment(report: Report, name: str, text: str, at: int) -> Finding:
    return Finding(name=name, text=text, segment=at, **_place(report, report.columns, at))


def _place(report: Report, table: Mapping[str, Any], at: int) -> dict[str, Any]:
    """Line and file of a row."""
    number = int(table["file"][at]) if "file" in table else 0
    return {"line": int(table["line"][at]), "file": report.notes["files"][number] if number else ""}
