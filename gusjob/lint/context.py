"""The input of all lint checks: a job on a machine, and its modal state."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.diagnostics import model as d
from gusjob.diagnostics.model import Remark
from gusjob.ir.arcs import drawn_arcs
from gusjob.ir.display import DisplayUnits, display_units
from gusjob.ir.effects import StateEffect, is_known
from gusjob.ir.job import Job
from gusjob.ir.modal import ModalState, ModeSpan, modal_state
from gusjob.ir.path import Op, Path
from gusjob.ir.setup import Setup
from gusjob.kinematics.arrays import Bools, Floats, Indices, picked

Remarks = Callable[[int], tuple[Remark, ...]]
"""Remarks of the diagnostic at an index."""


def no_remarks(index: int) -> tuple[Remark, ...]:
    """Return no remarks for any diagnostic."""
    return ()


def same_remarks(remarks: tuple[Remark, ...]) -> Remarks:
    """Return the same remarks for every diagnostic."""
    return lambda index: remarks


class LintContext(Struct, frozen=True, kw_only=True):
    """A job, the machine that it is checked for, its modal state, and the units of its messages."""

    job: Job
    machine: Machine
    modal: ModalState
    shown: DisplayUnits

    @property
    def path(self) -> Path:
        """Path of the job."""
        return self.job.path

    def without_numbers(self) -> LintContext:
        """Return the context of a path without its numbers, which the modal state does not need."""
        job = replace(self.job, path=self.path.without_numbers())
        return replace(self, job=job, modal=replace(self.modal, job=job))

    def known(self, rows: Indices, effects: StateEffect, channel: int = 0) -> Bools:
        """Whether effects are known before rows: no statement that can't be read may have changed them, (k,)."""
        return np.asarray(is_known(picked(self.path.unknown_before, rows), effects, channel))

    def known_after(self, rows: Indices, effects: StateEffect, channel: int = 0) -> Bools:
        """Whether effects are known with what the rows themselves set, (k,)."""
        return np.asarray(is_known(picked(self.path.unknown, rows), effects, channel))

    def known_at(self, setup: Setup, effects: StateEffect) -> bool:
        """Whether effects are known before a setup statement, on its channel."""
        return bool(is_known(setup.unknown, effects, setup.channel))

    def rows(self, *ops: Op) -> Indices:
        """Find the rows of some kinds, ascending."""
        op = self.path.op
        found = op == ops[0]
        for other in ops[1:]:
            found |= op == other
        return np.flatnonzero(found)

    def arc_rows(self) -> Indices:
        """Find the rows that are arcs."""
        return np.flatnonzero(self.path.is_arc)

    def rows_in(self, op: Op, span: ModeSpan) -> Indices:
        """Find the rows of a kind on the channel of a LASER MODE while it is in force."""
        part = slice(span.first, span.last)
        found = (self.path.op[part] == op) & (self.path.channel[part] == span.channel)
        rows = np.flatnonzero(found) + span.first
        return rows[self.known(rows, StateEffect.MODE_KIND, span.channel)]

    def lengths(self, rows: Indices) -> Floats:
        """Compute the lengths of rows, in the pulses of their velocities (X's, if written in mm); 0 of a dwell."""
        path, (px, py) = self.path, self.machine.pulses_per_mm
        x0, y0, x1, y1 = path.ends(rows)
        in_mm = path.vel_in_mm[rows] | self.machine.equal_axes
        lengths = np.hypot(x1 - x0, (y1 - y0) * np.where(in_mm, px / py, 1.0))
        arcs = np.flatnonzero(path.is_arc[rows])
        if len(arcs):
            drawn = drawn_arcs(path, rows[arcs], self.machine)
            lengths[arcs] = drawn.arcs.length * np.where(in_mm[arcs], drawn.mm, drawn.mm_x) * px
        return np.where(path.moves[rows], lengths, 0.0)

    def set_remark(self, setup: Setup) -> tuple[Remark, ...]:
        """Point at the statement that set something."""
        return (Remark(text=d.SET_HERE, span=self.job.locate(setup.line, ""), fields={"name": setup.word}),)

    def mode_remark(self, mode: ModeSpan) -> tuple[Remark, ...]:
        """Point at the LASER MODE in force."""
        setup = mode.setup
        return (Remark(text=d.MODE_HERE, span=self.job.locate(setup.line, ""), fields={"mode": setup.word}),)

    def line_remarks(self, text: str, lines: npt.NDArray[np.integer[Any]]) -> Remarks:
        """Make remarks with one text, the i-th diagnostic's at the i-th of some lines."""

        def remarks(index: int) -> tuple[Remark, ...]:
            return (Remark(text=text, span=self.job.locate(int(lines[index]), "")),)

        return remarks


def lint_context(job: Job, machine: Machine) -> LintContext:
    """Make the context of a job on a machine."""
    return LintContext(job=job, machine=machine, modal=modal_state(job), shown=display_units(job, machine))
