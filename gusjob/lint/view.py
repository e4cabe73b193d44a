"""What all checks look at: a job on a machine, with the state of each channel at every row."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import Membership, Range
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Remark, Rule
from gusjob.i18n.phrases import Phrase
from gusjob.ir.display import DisplayUnits, display_units
from gusjob.ir.job import Job
from gusjob.ir.path import Op, arcs_mm
from gusjob.ir.setup import LaserMode, PowerNow, Setup, SwitchNow
from gusjob.ir.stages import setup_stages
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.units import PowerUnit, QuantityKind

CHANNELS = (0, 1)

Remarks = Callable[[int], tuple[Remark, ...]]
"""Other places that matter for the diagnostic at an index."""


def no_remarks(index: int) -> tuple[Remark, ...]:
    """Nothing more to say."""
    return ()


@dataclass(slots=True)
class Findings:
    """Diagnostics of one check run."""

    job: Job
    collector: Collector
    seen: dict[tuple[Any, ...], int] = field(default_factory=dict)
    """Diagnostics of a job with loops: a statement is said once of what it does wrong, however often it comes."""

    def add(
        self, rule: Rule, line: int, word: str = "", /, *, trail: int = 0, count: int = 1,
        remarks: tuple[Remark, ...] = (), **fields: Any,
    ) -> None:  # fmt: skip
        """One diagnostic at a word of a line ('' for the statement, 'value' for its number)."""
        key = (rule.code, line, word, fields.get("what"), fields.get("axis"), fields.get("channel"))
        if self.job.provenance is not None and key in self.seen:
            self.collector.again(self.seen[key], count)
            return
        if not self.collector.room(rule):
            self.collector.uncounted(rule, 1)
            return
        self.seen[key] = len(self.collector.found)
        span = self.job.locate(line, word)
        if self.job.provenance is not None:
            remarks = (*remarks, *self.job.name_remarks(line, word), *self.job.provenance_remarks(trail))
        self.collector.add(rule, span, fields, count, remarks)

    def at(
        self, rule: Rule, setup: Setup, word: str = "", /, *, remarks: tuple[Remark, ...] = (), **fields: Any
    ) -> None:
        """One diagnostic at a word of a setup statement."""
        self.add(rule, setup.line, word, trail=setup.provenance, remarks=remarks, **fields)

    def at_rows(
        self, rule: Rule, rows: Indices, word: str, /, *, remarks: Remarks = no_remarks, **columns: Any
    ) -> None:
        """One diagnostic a row; a field that is an array (one entry a row of `rows`) gives each its own."""
        path = self.job.path
        words = np.broadcast_to(word, len(rows))
        self.at_places(rule, path.line[rows], path.provenance[rows], words, remarks=remarks, **columns)

    def at_places(
        self, rule: Rule, lines: npt.NDArray[Any], trails: npt.NDArray[Any], words: npt.NDArray[Any], /, *,
        remarks: Remarks = no_remarks, **columns: Any,
    ) -> None:  # fmt: skip
        """One diagnostic a place; rounds of the same statement are one diagnostic with a count."""
        places, counts = np.arange(len(lines)), np.ones(len(lines), dtype=np.intp)
        if self.job.provenance is not None:
            _, places, counts = np.unique(lines, return_index=True, return_counts=True)
        listed = min(len(places), self.collector.room(rule))
        for i, count in zip(places[:listed].tolist(), counts[:listed].tolist(), strict=True):
            fields = {k: v[i].item() if isinstance(v, np.ndarray) else v for k, v in columns.items()}
            line, trail = int(lines[i]), int(trails[i])
            self.add(rule, line, str(words[i]), trail=trail, count=count, remarks=remarks(i), **fields)
        self.collector.uncounted(rule, len(places) - listed)

    def ranged(self, rows: Indices, values: Floats, allowed: Range, what: str, word: str, hint: str = "") -> Bools:
        """Judge values (one a row) against a range; returns which are good."""
        verdict = allowed.classify(values)
        whole = allowed.carries(values)
        if not verdict.any() and whole.all():
            return np.ones(len(values), dtype=np.bool_)
        outside = verdict == Membership.OUTSIDE
        fields: dict[str, Any] = {"what": what, "unit": allowed.unit, "range": str(allowed), "hint": hint}
        self.at_rows(rules.OUT_OF_RANGE, rows[outside], word, value=values[outside], **fields)
        ends = (verdict == Membership.ON_TOLERATED_END) & whole
        self.at_rows(rules.ON_OPEN_END, rows[ends], word, value=values[ends], **fields)
        broken = ~outside & ~whole
        self.at_rows(rules.NOT_WHOLE, rows[broken], word, value=values[broken], **fields)
        return np.asarray(~outside & whole)

    def one(self, setup: Setup, value: float, allowed: Range, what: str, word: str = "value") -> bool:
        """Judge a setup statement's number; returns whether it is good."""
        if allowed.classify_one(value) is Membership.OUTSIDE:
            rule = rules.OUT_OF_RANGE
        elif not allowed.carries(value):
            rule = rules.NOT_WHOLE
        elif allowed.classify_one(value) is Membership.ON_TOLERATED_END:
            rule = rules.ON_OPEN_END
        else:
            return True
        self.at(rule, setup, word, what=what, value=value, unit=allowed.unit, range=str(allowed), hint="")
        return rule is rules.ON_OPEN_END

    def unit(self, setup: Setup, word: str, what: str, written: int, wanted: PowerUnit, mode: Setup) -> bool:
        """Judge the unit that a power of a setup statement was written in; returns whether it is good."""
        if written in (PowerUnit.NONE, wanted):
            return True
        self.at(rules.WRONG_UNIT, setup, word, remarks=self.mode_remark(mode), **unit_fields(what, written, wanted))
        return False

    def set_remark(self, setup: Setup) -> tuple[Remark, ...]:
        """Where something was set."""
        return (Remark(text=d.SET_HERE, span=self.job.locate(setup.line, ""), fields={"name": setup.word}),)

    def mode_remark(self, mode: Setup) -> tuple[Remark, ...]:
        """Where the mode was set."""
        return (Remark(text=d.MODE_HERE, span=self.job.locate(mode.line, ""), fields={"mode": mode.word}),)


def unit_fields(what: str, written: int, wanted: PowerUnit) -> dict[str, Any]:
    """Fields of WRONG_UNIT for a power."""
    kinds = {
        PowerUnit.PERCENT: QuantityKind.SHARE,
        PowerUnit.KHZ: QuantityKind.FREQUENCY,
        PowerUnit.VOLT: QuantityKind.VOLTAGE,
    }
    unit = PowerUnit(written)
    return {
        "what": what,
        "wanted": Phrase("in {unit} in this mode", unit=wanted.text),
        "unit": unit.text,
        "kind": kinds[unit].words,
        "hint": "",
    }


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeSpan:
    """A LASER MODE and the path rows first..last-1 in which it is in force on its channel."""

    setup: Setup
    mode: LaserMode
    channel: int
    first: int
    last: int


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A job and a machine, and how channels stand."""

    job: Job
    machine: Machine
    mode_spans: tuple[tuple[ModeSpan, ...], ...]
    stage_first: tuple[int, ...]
    """For each setup statement the first row of its stage: before that row it is carried out."""
    known: dict[int, tuple[Bools, Indices, bool, int]] = field(default_factory=dict)
    """What `lit` has found, by channel."""
    by_kind: dict[type, tuple[Setup, ...]] = field(default_factory=dict)
    """Setup statements by kind, as `setups` has found them."""

    def rows(self, *ops: Op) -> Indices:
        """Rows of some kinds."""
        path = self.job.path
        found = path.op == ops[0]
        for op in ops[1:]:
            found |= path.op == op
        return np.flatnonzero(found)

    def setups(self, kind: type) -> tuple[Setup, ...]:
        """Setup statements of a kind."""
        if kind not in self.by_kind:
            self.by_kind[kind] = tuple(s for s in self.job.setups if isinstance(s.statement, kind))
        return self.by_kind[kind]

    def modes(self, channel: int) -> tuple[ModeSpan, ...]:
        """The LASER MODEs of a channel in order."""
        return self.mode_spans[channel]

    def mode_of(self, setup: Setup) -> ModeSpan | None:
        """The mode in force for a setup statement.

        That is the last LASER MODE of its channel before it, else the first behind.
        """
        spans = self.modes(setup.channel)
        above = bisect_right(spans, setup.order, key=lambda span: span.setup.order)
        return spans[max(above - 1, 0)] if spans else None

    def modes_behind(self, setup: Setup) -> Iterator[ModeSpan]:
        """The LASER MODEs of a setup statement's channel behind it."""
        spans = self.modes(setup.channel)
        for i in range(bisect_right(spans, setup.order, key=lambda span: span.setup.order), len(spans)):
            yield spans[i]

    def switches(self, channel: int) -> tuple[Indices, Bools, Indices]:
        """Everything that switches a channel: (place, on, line), ascending.

        A place is twice a row, plus one if it acts behind the row: a row acts behind itself (odd), a setup statement
        before the row it stands at (even).
        """
        path = self.job.path
        rows = np.flatnonzero(((path.op == Op.ON) | (path.op == Op.OFF)) & (path.channel == channel))
        keys = rows * 2 + 1
        on, lines = path.op[rows] == Op.ON, path.line[rows].astype(np.intp)
        now = [s for s in self.setups(SwitchNow) if s.channel == channel]
        begin = self.stage_first
        if now:
            keys = np.concatenate([[begin[s.order] * 2 for s in now], keys])
            on = np.concatenate([[_is_on(s) for s in now], on]).astype(np.bool_)
            lines = np.concatenate([[s.line for s in now], lines]).astype(np.intp)
            order = np.argsort(keys, kind="stable")
            keys, on, lines = keys[order], on[order], lines[order]
        return keys, on, lines

    def lit_at(self, channel: int, places: Indices) -> Bools:
        """Whether light is commanded on just before each place."""
        keys, on, _ = self.switches(channel)
        last = np.searchsorted(keys, places, side="left") - 1
        return np.where(last >= 0, on[last], False) if len(keys) else np.zeros(len(places), dtype=np.bool_)

    def lit(self, channel: int) -> tuple[Bools, Indices, bool, int]:
        """(light commanded on in each row, line of the ON in force per row, on at the end, line of the last ON)."""
        if channel not in self.known:
            self.known[channel] = self._lit(channel)
        return self.known[channel]

    def _lit(self, channel: int) -> tuple[Bools, Indices, bool, int]:
        path = self.job.path
        keys, on, lines = self.switches(channel)
        if not len(keys):
            none = np.zeros(len(path), dtype=np.bool_)
            return none, np.zeros(len(path), dtype=np.intp), False, 0
        # The last one that acts before each row: they are ascending, so each holds up to the next.
        begins = np.concatenate([[0], np.minimum((keys + 1) // 2, len(path)), [len(path)]])
        last = np.repeat(np.arange(-1, len(keys)), np.diff(begins))
        state = np.where(last >= 0, on[last], False)
        # The line of the ON that began it: later ONs while on change nothing.
        begins = on & ~np.concatenate([[False], on[:-1]])
        begun = np.maximum.accumulate(np.where(begins, np.arange(len(on)), 0))
        return state, lines[begun[last]], bool(on[-1]), int(lines[begun[-1]])

    @property
    def shown(self) -> DisplayUnits:
        """The units of messages."""
        return display_units(self.job, self.machine)

    def starts(self) -> tuple[Floats, Floats]:
        """Where the head is before each row, unrounded pulse."""
        path = self.job.path
        return np.concatenate([[0.0], path.x])[:-1], np.concatenate([[0.0], path.y])[:-1]

    def lengths(self, rows: Indices) -> Floats:
        """Lengths of moves, in pulses of X (in which velocities stand); a dwell has none."""
        path, (px, py) = self.job.path, self.machine.pulses_per_mm
        x0, y0 = self.starts()
        lengths = np.hypot(path.x[rows] - x0[rows], (path.y[rows] - y0[rows]) * (px / py))
        round_ = np.flatnonzero((path.op[rows] == Op.ARC_CENTRE) | (path.op[rows] == Op.ARC_RADIUS))
        if len(round_):
            lengths[round_] = arcs_mm(path, rows[round_], self.machine).length * px
        return np.where(path.moves[rows], lengths, 0.0)

    def power_keys(self, channel: int) -> Indices:
        """Places of everything that sets power on a channel, in the keys of `lit`, ascending."""
        path = self.job.path
        rows = np.flatnonzero(((path.op == Op.POWER) | (path.op == Op.FOLLOW)) & (path.channel == channel)) * 2 + 1
        now = [self.stage_first[s.order] * 2 for s in self.setups(PowerNow) if s.channel == channel]
        return np.sort(np.concatenate([rows, np.array(now, dtype=rows.dtype)]))


def view_of(job: Job, machine: Machine) -> View:
    """The view of a job."""
    firsts = tuple(first for _, first in setup_stages(job))
    spans = tuple(tuple(_modes(job, channel, firsts)) for channel in CHANNELS)
    return View(job=job, machine=machine, mode_spans=spans, stage_first=firsts)


def _modes(job: Job, channel: int, firsts: tuple[int, ...]) -> Iterator[ModeSpan]:
    found = [s for s in job.setups if isinstance(s.statement, LaserMode) and s.channel == channel]
    ends = [*(firsts[s.order] for s in found), len(job.path)][1:]
    for setup, last in zip(found, ends, strict=True):
        assert isinstance(setup.statement, LaserMode)
        yield ModeSpan(setup=setup, mode=setup.statement, channel=channel, first=firsts[setup.order], last=last)


def _is_on(setup: Setup) -> bool:
    return isinstance(setup.statement, SwitchNow) and setup.statement.on
