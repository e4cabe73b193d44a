"""Rows of laser switches: the laser goes off and on again at a corner where a mark ends and the next one begins."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.ir.intent import RunKind
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.planner.plan import MarkEvents, QuantizedPath
from gusjob.planner.skywriting.added_rows import (
    PIECE_BEFORE,
    PLACED_OFF_BEHIND,
    PLACED_SWITCH,
    SWITCH_OFF,
    SWITCH_ON,
    AddedRows,
)
from gusjob.planner.skywriting.marks import Marks
from gusjob.planner.skywriting.simple_marks import SimpleMarkSwitches, SwitchLeg, simple_mark_switches

_LEG_OFFSETS = np.array([PLACED_SWITCH[leg] for leg in SwitchLeg])


def add_switch_rows(
    quantized: QuantizedPath, marks: Marks, rows: AddedRows, run_out_ends: tuple[Floats, Floats]
) -> None:
    """Add the switches of all marks, and find the rows that take effect at a mark's start or end."""
    writer = _SwitchWriter(quantized=quantized, marks=marks, rows=rows)
    for channel in CHANNELS:
        if marks.on[channel].any():
            writer.channel(channel, simple_mark_switches(quantized, marks, run_out_ends, channel))


class _SwitchWriter(Struct, frozen=True, kw_only=True):
    """Adds the rows of switches. Marks are given by their numbers `at` among the timed rows."""

    quantized: QuantizedPath
    marks: Marks
    rows: AddedRows

    def channel(self, channel: int, simple: SimpleMarkSwitches) -> None:
        """Add the switches of a channel."""
        path, timed, marks = self.quantized.path, self.quantized.timed, self.marks
        is_on = marks.on[channel]
        on_before, on_after = np.append(False, is_on[:-1]), np.append(is_on[1:], False)
        begin = np.flatnonzero(marks.is_mark & is_on & (marks.begins | ~on_before))
        end = np.flatnonzero(marks.is_mark & is_on & (marks.ends | ~on_after))
        own = path.channel == channel
        on, off = np.flatnonzero((path.op == Op.ON) & own), np.flatnonzero((path.op == Op.OFF) & own)
        first_motions = self.split(simple)
        # The last ON before a mark, the first OFF behind it; where there is none between the motions, one is added.
        found_on = np.append(on, -1)[np.searchsorted(on, timed[begin]) - 1]
        exists = found_on > np.append(timed, -1)[begin - 1]
        self.switch(Op.ON, channel, begin, found_on, exists, first_motions[begin], simple)
        found_off = np.append(off, len(path))[np.searchsorted(off, timed[end])]
        exists = found_off < np.append(timed, len(path))[end + 1]
        self.switch(Op.OFF, channel, end, found_off, exists, timed[end], simple)
        self.powers(np.flatnonzero(path.sets_power & own), off, is_on)

    def powers(self, rows: Indices, off: Indices, is_on: Bools) -> None:
        """Delay powers by the beam's lag: those set inside a mark, or after its end while the laser is still on.

        Args:
            rows: Rows that set a power, (k,).
            off: Rows that switch the laser off.
            is_on: The laser is commanded on, (m,).
        """
        timed, marks = self.quantized.timed, self.marks
        behind = np.searchsorted(timed, rows)
        inside = np.append(marks.joined, False)[behind]
        before = np.maximum(behind - 1, 0)
        still_on = np.searchsorted(off, rows) == np.searchsorted(off, timed[before])
        ended = (behind > 0) & (marks.ends & is_on)[before] & still_on & ~inside
        for where, at, at_end in ((inside, behind, False), (ended, before, True)):
            mark = at[where]
            self.rows.events.append(
                MarkEvents(
                    row=rows[where],
                    mark_row=timed[mark],
                    at_end=np.full(len(mark), at_end),
                    effect_us=marks.lag_us[mark],
                    placed=np.zeros(len(mark), dtype=np.bool_),
                )
            )

    def switch(
        self,
        op: Op,
        channel: int,
        at: Indices,
        found: Indices,
        exists: Bools,
        mark_rows: Indices,
        simple: SimpleMarkSwitches,
    ) -> None:
        """Take the switches of marks where they exist, and add the others; those of simple marks are placed.

        Args:
            op: Op.ON or Op.OFF.
            at: Marks that need the switch, (k,).
            found: Row of the switch of each, where it `exists`, (k,).
            mark_rows: Row of the motion whose start or end determines the switch, (k,).
        """
        off = op is Op.OFF
        effect_us = (self.marks.lag_us if off else self.marks.on_us)[at]
        rows, placed = self.quantized.timed[at], simple.known[at]
        leg = (simple.off if off else simple.on).leg[at]
        offset = np.where(
            placed, _LEG_OFFSETS[leg] + (PLACED_OFF_BEHIND if off else 0.0), SWITCH_OFF if off else SWITCH_ON
        )
        added = self.rows.count + np.cumsum(~exists) - 1
        self.rows.events.append(
            MarkEvents(
                row=np.where(exists, found, added),
                mark_row=mark_rows,
                at_end=np.full(len(at), off),
                effect_us=effect_us,
                placed=placed,
            )
        )
        self.rows.add(rows[~exists], offset[~exists], op=np.uint8(op), channel=np.int8(channel))
        moved = exists & placed
        self.rows.new_keys.append((found[moved], np.asarray(rows[moved] + offset[moved], dtype=np.float64)))

    def split(self, simple: SimpleMarkSwitches) -> Indices:
        """Add the pieces of motions before switches of simple marks.

        Returns:
            The row that starts where each timed row does, (m,).
        """
        first_motions = self.quantized.timed.copy()
        for positions, behind in ((simple.off, PLACED_OFF_BEHIND), (simple.on, 0.0)):
            for leg, run in ((SwitchLeg.MARK, RunKind.RUN_IN), (SwitchLeg.RUN_OUT, RunKind.RUN_OUT)):
                at = np.flatnonzero(simple.known & (positions.leg == leg))
                if leg is SwitchLeg.MARK:
                    first_motions[at] = self.rows.count + np.arange(len(at))
                self.rows.add(
                    self.quantized.timed[at],
                    PLACED_SWITCH[leg] + behind - PIECE_BEFORE,
                    op=np.uint8(Op.LINE),
                    end=np.nan,
                    x=positions.x[at],
                    y=positions.y[at],
                    **self.marks.speed_columns(at),
                    run=np.int8(run),
                    smooth=True,
                )
        return first_motions
