"""Modal state of a job: which mode, laser command and power are in force at every row of the path.

An instant is a point in the order of the path: 2*row just before a row acts, 2*row + 1 just after it. A row of the path
acts at 2*row + 1, a setup statement at 2*row of the first row of its stage.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.ir.effects import StateEffect, is_known
from gusjob.ir.job import Job
from gusjob.ir.path import Op
from gusjob.ir.setup import LaserMode, PowerNow, Setup, SwitchNow
from gusjob.ir.stages import setup_stages
from gusjob.kinematics.arrays import Bools, Indices

_T = TypeVar("_T")


class ModeSpan(Struct, frozen=True, kw_only=True):
    """A LASER MODE and the rows first..last-1 of the path in which it is in force on its channel."""

    setup: Setup
    mode: LaserMode
    channel: int
    first: int
    last: int


class Switches(Struct, frozen=True, kw_only=True, eq=False):
    """Everything that switches the laser of a channel, (k,) each, ascending: instant, on or off, line."""

    instant: Indices
    on: Bools
    line: Indices

    def __len__(self) -> int:
        return len(self.instant)

    @property
    def is_buffered(self) -> Bools:
        """Switches in the path; the others are LASER ON NOW and LASER OFF NOW."""
        return np.asarray(self.instant % 2 == 1)

    @property
    def rows(self) -> Indices:
        """Row of the path of each buffered switch, or the row before which the other ones act."""
        return self.instant // 2

    @property
    def begins(self) -> Indices:
        """Instants at which a mark begins: the laser is switched on while it is off, ascending."""
        found: Indices = self.instant[self.on & ~np.concatenate([[False], self.on[:-1]])[: len(self)]]
        return found

    def on_at(self, instants: Indices) -> Bools:
        """Whether the laser is commanded on just before some instants."""
        last = np.searchsorted(self.instant, instants, side="left") - 1
        return np.where(last >= 0, self.on[last], False) if len(self) else np.zeros(len(instants), dtype=np.bool_)


class LaserCommand(Struct, frozen=True, kw_only=True, eq=False):
    """Commanded state of a channel's laser along the path.

    `on` (n,): on in each row; not where a switch that can't be read may have changed it. `on_line` (n,): line of the ON
    in force, of the first where several follow each other; with one ON for all rows a broadcast array.
    `on_at_end`: on after the path; `last_on_line`: line of the ON in force there.
    """

    on: Bools
    on_line: Indices
    on_at_end: bool
    last_on_line: int


class ModalState(Struct, frozen=True, kw_only=True):
    """The modal state of a job, by channel. Switches and laser commands are computed when they are first needed."""

    job: Job
    mode_spans: tuple[tuple[ModeSpan, ...], ...]
    stage_first: tuple[int, ...]
    """For each setup statement the first row of its stage: it runs before that row."""
    switched: dict[int, Switches] = field(default_factory=dict)
    commands: dict[int, LaserCommand] = field(default_factory=dict)
    by_kind: dict[type, tuple[Any, ...]] = field(default_factory=dict)

    def statements(self, kind: type[_T]) -> tuple[tuple[Setup, _T], ...]:
        """List the setup statements of a kind, each with its statement."""
        if kind not in self.by_kind:
            self.by_kind[kind] = tuple(
                (setup, setup.statement) for setup in self.job.setups if isinstance(setup.statement, kind)
            )
        return self.by_kind[kind]

    def modes(self, channel: int) -> tuple[ModeSpan, ...]:
        """List the LASER MODEs of a channel in order."""
        return self.mode_spans[channel]

    def mode_of(self, setup: Setup) -> ModeSpan | None:
        """Find the mode in force for a setup statement.

        That is the last LASER MODE of its channel before it, else the first one after it; None if there is none, or
        if it may be one that can't be read.
        """
        spans = self.modes(setup.channel)
        if not is_known(setup.unknown, StateEffect.MODE_KIND, setup.channel):
            return None
        before = bisect_right(spans, setup.order, key=lambda span: span.setup.order)
        return spans[max(before - 1, 0)] if spans else None

    def modes_after(self, setup: Setup) -> Iterator[ModeSpan]:
        """Iterate over the LASER MODEs of a setup statement's channel that follow it."""
        spans = self.modes(setup.channel)
        for i in range(bisect_right(spans, setup.order, key=lambda span: span.setup.order), len(spans)):
            yield spans[i]

    def switches(self, channel: int) -> Switches:
        """Collect everything that switches the laser of a channel."""
        if channel not in self.switched:
            self.switched[channel] = self._switches(channel)
        return self.switched[channel]

    def _switches(self, channel: int) -> Switches:
        path = self.job.path
        rows = np.flatnonzero(((path.op == Op.ON) | (path.op == Op.OFF)) & (path.channel == channel))
        instants = rows * 2 + 1
        on, lines = path.op[rows] == Op.ON, path.line[rows].astype(np.intp)
        now = [(setup, switch.on) for setup, switch in self.statements(SwitchNow) if setup.channel == channel]
        if now:
            instants = np.concatenate([[self.stage_first[s.order] * 2 for s, _ in now], instants])
            on = np.concatenate([[is_on for _, is_on in now], on]).astype(np.bool_)
            lines = np.concatenate([[s.line for s, _ in now], lines]).astype(np.intp)
            order = np.argsort(instants, kind="stable")
            instants, on, lines = instants[order], on[order], lines[order]
        return Switches(instant=instants, on=on, line=lines)

    def laser(self, channel: int) -> LaserCommand:
        """Compute the commanded state of a channel's laser along the path."""
        if channel not in self.commands:
            found = _laser_command(self.switches(channel), len(self.job.path))
            known = is_known(self.job.path.unknown_before, StateEffect.SWITCH, channel)
            self.commands[channel] = replace(found, on=found.on & known)
        return self.commands[channel]

    def mark_numbers(self, channel: int, rows: Indices) -> Indices:
        """Number the marks of a channel: the number of the mark of some rows, 0 while the laser is off, (k,)."""
        # A mark that begins in a row begins behind it.
        number = np.searchsorted((self.switches(channel).begins + 1) // 2, rows, side="right")
        number *= self.laser(channel).on[rows]
        return number

    def follows_velocity(self, channel: int) -> Bools:
        """Rows in which the power of a channel follows the velocity, (n,)."""
        path, count = self.job.path, len(self.job.path)
        rows = np.flatnonzero(path.sets_power & (path.channel == channel))
        if not (path.op[rows] == Op.FOLLOW).any():
            return np.broadcast_to(np.False_, count)
        now = [self.stage_first[s.order] * 2 for s, _ in self.statements(PowerNow) if s.channel == channel]
        instants = np.concatenate([np.array(now, dtype=rows.dtype), rows * 2 + 1])
        follows = np.concatenate([np.zeros(len(now), dtype=np.bool_), path.op[rows] == Op.FOLLOW])
        order = np.argsort(instants, kind="stable")
        return np.repeat(np.append(False, follows[order]), _rows_between(instants[order], count))

    def any_on(self) -> Bools:
        """Rows in which the laser of some channel is commanded on, (n,)."""
        return np.asarray(np.logical_or.reduce([self.laser(channel).on for channel in CHANNELS]))

    def power_instants(self, channel: int) -> Indices:
        """List the instants at which power or follow of a channel is set, ascending."""
        path = self.job.path
        rows = np.flatnonzero(path.sets_power & (path.channel == channel)) * 2 + 1
        now = [self.stage_first[s.order] * 2 for s, _ in self.statements(PowerNow) if s.channel == channel]
        return np.sort(np.concatenate([rows, np.array(now, dtype=rows.dtype)])) if now else rows


def modal_state(job: Job) -> ModalState:
    """Compute the modal state of a job."""
    firsts = tuple(first for _, first in setup_stages(job))
    spans = tuple(tuple(_mode_spans(job, channel, firsts)) for channel in CHANNELS)
    return ModalState(job=job, mode_spans=spans, stage_first=firsts)


def _mode_spans(job: Job, channel: int, firsts: tuple[int, ...]) -> Iterator[ModeSpan]:
    found = [(s, s.statement) for s in job.setups if isinstance(s.statement, LaserMode) and s.channel == channel]
    ends = [*(firsts[s.order] for s, _ in found), len(job.path)][1:]
    for (setup, mode), last in zip(found, ends, strict=True):
        yield ModeSpan(setup=setup, mode=mode, channel=channel, first=firsts[setup.order], last=last)


def _rows_between(instants: Indices, count: int) -> Indices:
    """Count the rows of `count` before the first of some ascending instants acts, and from each on up to the next."""
    return np.diff(np.concatenate([[0], np.minimum((instants + 1) // 2, count), [count]]))


def _laser_command(switches: Switches, count: int) -> LaserCommand:
    """The commanded state in `count` rows."""
    on, lines = switches.on, switches.line
    if not len(switches):
        off: npt.NDArray[np.bool_] = np.zeros(count, dtype=np.bool_)
        line = np.broadcast_to(np.intp(0), count)
        return LaserCommand(on=off, on_line=line, on_at_end=False, last_on_line=0)
    counts = _rows_between(switches.instant, count)
    # The line of the ON that began it: later ONs while the laser is on change nothing.
    turns_on = on & ~np.concatenate([[False], on[:-1]])
    begun = np.maximum.accumulate(np.where(turns_on, np.arange(len(on)), 0))
    of_each = np.append(lines[begun[-1]], lines[begun])
    is_one = bool((of_each == of_each[0]).all())
    return LaserCommand(
        on=np.repeat(np.append(False, on), counts),
        on_line=np.broadcast_to(of_each[0], count) if is_one else np.repeat(of_each, counts),
        on_at_end=bool(on[-1]),
        last_on_line=int(lines[begun[-1]]),
    )
