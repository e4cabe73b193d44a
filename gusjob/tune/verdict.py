"""The objective of tuning, and the verdict: is a job with the statement found better than it was?

The measure is the distance of the beam from the intended start of each mark when its emission starts, and from its end
when its emission ends: RMS over all starts and ends of the marks that calls switch. If two runs differ by no
more than a tolerance, the cheaper one is better: for LASER DELAY the one with less emission, since a laser that is on
while the beam rests burns a point; for SKYWRITE the shorter run. So values are only replaced by better ones.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from enum import Enum
from itertools import product
from typing import Any

import orjson
from msgspec import Struct
from msgspec.structs import asdict

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import Severity
from gusjob.i18n.phrases import Phrase, both_of, figure
from gusjob.simulate.quality.marks import MARKING_WORDS
from gusjob.tune.skywriting import MIN_GAIN_PULSE, own_sky_writing
from gusjob.tune.trial import NO_ENDS, EndMeasure, TuneResult, TuneRun

_DIGITS = 4
_ROUNDING_UM, _ROUNDING_MS = 1e-6, 1e-6
_WORSE_UM = 1e-3
"""Smallest increase of an error of an end that is named."""
_UM_PER_MM = 1000.0
_WHICH = {"worst": Phrase("worst"), "typical": Phrase("typical")}
_SMALL = Phrase("which is within the tolerance")
_OUTWEIGHED = Phrase("but over all ends the distance is smaller")
_ENDS = ("on_error_um", "off_error_um", "on_miss_um", "off_miss_um")


class Objective(Struct, frozen=True, kw_only=True):
    """What is minimized, for the marks of some channels. SKYWRITE holds for all of them, LASER DELAY for one.

    `replaces`: the job has a value of its own that this one would replace. `tolerance_um`: difference of the distances
    up to which `cost` decides: "emission_ms" or "duration_ms".
    """

    statement: str
    channels: tuple[int, ...]
    cost: str
    tolerance_um: float
    replaces: bool

    def lines(self, marks: int) -> list[Phrase]:
        """Describe it, in lines."""
        shorter = Phrase("the shorter emission") if self.cost == "emission_ms" else Phrase("the shorter run")
        tolerance = figure(self.tolerance_um, _DIGITS)
        then = Phrase(
            "if distances differ by no more than {tolerance} um, {shorter} is better",
            tolerance=tolerance,
            shorter=shorter,
        )
        if not self.replaces:
            then = Phrase(
                "as the job has no SKYWRITE of this mode, a distance that grows by no more than {tolerance} um is good "
                "enough",
                tolerance=tolerance,
            )
        return [
            Phrase(
                "objective: the beam is at the intended start of a mark when the emission starts, and at the intended "
                "end when it ends"
            ),
            Phrase(
                "measured by: the RMS distance over all starts and ends of the marks of channel {channel} ({marks})",
                marks=marks,
                channel=both_of(str(channel) for channel in self.channels),
            ),
            then,
        ]


class Reason(Enum):
    """How a job with the statement found compares with the job as it is."""

    MORE_MARKS = "more marks"
    FEWER_MARKS = "fewer marks"
    NEARER = "nearer"
    FARTHER = "farther"
    CHEAPER = "cheaper"
    DEARER = "dearer"
    EQUAL = "equal"
    NEW = "new"


_GAINS = (Reason.MORE_MARKS, Reason.NEARER, Reason.CHEAPER, Reason.NEW)


class WorseEnd(Struct, frozen=True, kw_only=True):
    """An error or miss of an end that is larger than before. `which`: "worst" or "typical"; um.

    `unit`: of the power of these marks.
    """

    channel: int
    unit: str
    name: str
    which: str
    before: float
    after: float


class Verdict(Struct, frozen=True, kw_only=True):
    """The comparison of a job with the statement found with the job as it is.

    `worse`: where it makes an end worse. `new_warnings`: codes of the warnings that the job has only with it.
    """

    objective: Objective
    reason: Reason
    before: EndMeasure
    after: EndMeasure
    worse: tuple[WorseEnd, ...]
    new_warnings: tuple[str, ...]

    @property
    def is_gain(self) -> bool:
        """Whether the statement is worth writing."""
        return self.reason in _GAINS

    def worse_lines(self) -> Iterator[Phrase]:
        """Describe the ends that are worse, each with its largest increase, and why that is still better."""
        largest = dict[tuple[int, str, str], WorseEnd]()
        for end in sorted(self.worse, key=lambda end: end.after - end.before):
            largest[end.channel, end.name, end.which] = end
        limit_um = self.objective.tolerance_um
        for (channel, name, which), end in sorted(largest.items(), key=lambda item: item[0]):
            is_small = end.after - end.before <= limit_um
            yield Phrase(
                "worse: {what} of channel {channel} ({which}) rises from {old} to {new} um, {why}",
                what=MARKING_WORDS[name],
                channel=channel,
                which=_WHICH[which],
                old=figure(end.before, _DIGITS),
                new=figure(end.after, _DIGITS),
                why=_SMALL if is_small else _OUTWEIGHED,
            )

    @property
    def text(self) -> Phrase:
        """The reason as a sentence."""
        before, after = self.before, self.after
        old, new = figure(before.rms_um, _DIGITS), figure(after.rms_um, _DIGITS)
        tolerance = figure(self.objective.tolerance_um, _DIGITS)
        old_ms, new_ms = (figure(getattr(ends, self.objective.cost)) for ends in (before, after))
        is_emission = self.objective.cost == "emission_ms"
        match self.reason:
            case Reason.MORE_MARKS:
                return Phrase("the job then has {new} marks, not {old}", new=after.marks, old=before.marks)
            case Reason.FEWER_MARKS:
                return Phrase("the job would then have {new} marks, not {old}", new=after.marks, old=before.marks)
            case Reason.NEARER:
                return Phrase("the RMS distance falls from {old} to {new} um", old=old, new=new)
            case Reason.FARTHER:
                return Phrase("the RMS distance would rise from {old} to {new} um", old=old, new=new)
            case Reason.CHEAPER if is_emission:
                return Phrase(
                    "the RMS distance changes by no more than {tolerance} um ({old} to {new} um), and the laser emits "
                    "{new_ms} ms instead of {old_ms} ms: less while the beam rests",
                    tolerance=tolerance, old=old, new=new, old_ms=old_ms, new_ms=new_ms,
                )  # fmt: skip
            case Reason.CHEAPER:
                return Phrase(
                    "the RMS distance changes by no more than {tolerance} um ({old} to {new} um), and the run takes "
                    "{new_ms} ms instead of {old_ms} ms",
                    tolerance=tolerance, old=old, new=new, old_ms=old_ms, new_ms=new_ms,
                )  # fmt: skip
            case Reason.DEARER if is_emission:
                return Phrase(
                    "the RMS distance would change by no more than {tolerance} um ({old} to {new} um), and the laser "
                    "would emit {new_ms} ms instead of {old_ms} ms",
                    tolerance=tolerance, old=old, new=new, old_ms=old_ms, new_ms=new_ms,
                )  # fmt: skip
            case Reason.DEARER:
                return Phrase(
                    "the RMS distance would change by no more than {tolerance} um ({old} to {new} um), and the run "
                    "would take {new_ms} ms instead of {old_ms} ms",
                    tolerance=tolerance, old=old, new=new, old_ms=old_ms, new_ms=new_ms,
                )  # fmt: skip
            case Reason.NEW:
                return Phrase(
                    "the RMS distance changes by no more than {tolerance} um ({old} to {new} um), and the marks are at "
                    "their velocity from start to end",
                    tolerance=tolerance, old=old, new=new,
                )  # fmt: skip
            case Reason.EQUAL:
                return Phrase("the RMS distance is {new} um with the job's own values, too", new=new)


def judge(before: TuneRun, tuned: TuneResult, objective: Objective) -> Verdict:
    """Compare the job with the statement found with the job as it is; both were simulated."""
    old, new = (_pooled(run, objective.channels) for run in (before, tuned.run))
    reason = compare(old, new, objective)
    return Verdict(
        objective=objective,
        reason=reason,
        before=old,
        after=new,
        worse=tuple(_worse_ends(before, tuned.run, objective.channels)),
        new_warnings=tuple(dict.fromkeys((_warnings(tuned.run) - _warnings(before)).elements())),
    )


def _pooled(run: TuneRun, channels: tuple[int, ...]) -> EndMeasure:
    """Measure the ends of the marks of some channels together."""
    found = [run.ends[channel] for channel in channels if channel in run.ends]
    marks = sum(ends.marks for ends in found)
    if not marks:
        return NO_ENDS
    return EndMeasure(
        marks=marks,
        rms_um=math.sqrt(sum(ends.marks * ends.rms_um**2 for ends in found) / marks),
        emission_ms=sum(ends.emission_ms for ends in found),
        duration_ms=found[0].duration_ms,
    )


def compare(old: EndMeasure, new: EndMeasure, objective: Objective) -> Reason:
    """Compare two runs by the objective; equal ones are no gain."""
    if old.marks != new.marks:
        return Reason.MORE_MARKS if new.marks > old.marks else Reason.FEWER_MARKS
    gain_um = old.rms_um - new.rms_um
    if abs(gain_um) > objective.tolerance_um:
        return Reason.NEARER if gain_um > 0 else Reason.FARTHER
    if not objective.replaces:
        return Reason.NEW
    less_ms = getattr(old, objective.cost) - getattr(new, objective.cost)
    if abs(less_ms) > _ROUNDING_MS:
        return Reason.CHEAPER if less_ms > 0 else Reason.DEARER
    if gain_um < -_ROUNDING_UM:
        return Reason.FARTHER
    return Reason.NEARER if gain_um > _ROUNDING_UM else Reason.EQUAL


def delay_objective(machine: Machine, channel: int) -> Objective:
    """The objective of LASER DELAY: without one both delays are 0, so there is always a value to replace."""
    return Objective(
        statement="LASER DELAY",
        channels=(channel,),
        cost="emission_ms",
        tolerance_um=_pulse_um(machine),
        replaces=True,
    )


def sky_writing_objective(run: TuneRun, machine: Machine, mode: int | None) -> Objective:
    """The objective of SKYWRITE; another mode than the job's is another kind of marking, which the user asks for."""
    own = own_sky_writing(run)
    replaces = own is not None and mode in (None, int(own.mode))
    tolerance_pulse = MIN_GAIN_PULSE if replaces else 1.0  # A GUS switches at whole pulses.
    return Objective(
        statement="SKYWRITE",
        channels=tuple(run.ends),
        cost="duration_ms",
        tolerance_um=tolerance_pulse * _pulse_um(machine),
        replaces=replaces,
    )


def _pulse_um(machine: Machine) -> float:
    return _UM_PER_MM / min(machine.pulses_per_mm)


def _warnings(run: TuneRun) -> Counter[str]:
    return Counter(d.rule.code for d in run.diagnostics if d.severity is Severity.WARNING)


def _worse_ends(before: TuneRun, after: TuneRun, channels: tuple[int, ...]) -> Iterator[WorseEnd]:
    """Find the errors and misses of ends that are larger than before."""
    for channel, (old, new) in (
        (c, pair) for c in channels for pair in paired_totals(before.marking, after.marking, c)
    ):
        if old is None or new is None:
            continue
        for name, which in product(_ENDS, ("worst", "typical")):
            was, now = abs(old[which][name] or 0.0), abs(new[which][name] or 0.0)
            if now > was + _WORSE_UM:
                yield WorseEnd(channel=channel, unit=new["unit"], name=name, which=which, before=was, after=now)


def paired_totals(
    before: list[dict[str, Any]], after: list[dict[str, Any]], channel: int
) -> list[tuple[dict[str, Any] | None, dict[str, Any] | None]]:
    """Pair the totals of a channel before and after, by the unit of power."""
    units = dict.fromkeys(e["unit"] for e in (*before, *after) if e["channel"] == channel)

    def of(entries: list[dict[str, Any]], unit: str) -> dict[str, Any] | None:
        return next((e for e in entries if e["channel"] == channel and e["unit"] == unit), None)

    return [(of(before, unit), of(after, unit)) for unit in units]


def tune_json(before: TuneRun, tuned: TuneResult, verdict: Verdict, machine: Machine, *, written: bool) -> bytes:
    """Make gusjob-tune/1, with all digits.

    `objective`: the measure, what decides between equal ones, method and range; `before`, `after`: the measure, and
    `totals` as in a report's `marking`; `verdict`: `gain`, its reason and text, the ends that are worse, and the codes
    of new warnings. `written`: the statement was written into the job.
    """
    objective = verdict.objective
    content = {
        "schema": "gusjob-tune/1",
        "job": before.source.name,
        "statement": tuned.statement,
        "written": written,
        "objective": {
            "statement": objective.statement,
            "channels": list(objective.channels),
            "measure": "rms_um",
            "ends": ["on_miss_um", "off_miss_um"],
            "weights": [1, 1],
            "tolerance_um": objective.tolerance_um,
            "then": objective.cost,
            "scanner": str(machine.scanner),
            "method": tuned.how,
            "range": tuned.searched,
        },
        "before": _json_of(before, verdict.before, objective.channels),
        "after": _json_of(tuned.run, verdict.after, objective.channels),
        "verdict": {
            "gain": verdict.is_gain,
            "reason": verdict.reason.value,
            "text": verdict.text,
            "worse": [asdict(end) for end in verdict.worse],
            "new_warnings": list(verdict.new_warnings),
        },
    }
    return orjson.dumps(content, option=orjson.OPT_PASSTHROUGH_SUBCLASS, default=str) + b"\n"


def _json_of(run: TuneRun, ends: EndMeasure, channels: tuple[int, ...]) -> dict[str, Any]:
    return {**asdict(ends), "totals": [entry for entry in run.marking if entry["channel"] in channels]}
