"""Rows of run-ins and run-outs, and of the motions to and from them."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct

from gusjob.ir.intent import RunKind
from gusjob.ir.path import SPEED_WORDS, Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.trapezoids import trapezoids
from gusjob.kinematics.units import US_PER_MS
from gusjob.planner.plan import QuantizedPath
from gusjob.planner.skywriting.added_rows import (
    BACK,
    BACK_FAR,
    JUMP_BACK,
    JUMP_TO_RUN_IN,
    REVERSE,
    REVERSE_FAR,
    RUN_IN,
    RUN_IN_FAR,
    RUN_OUT,
    RUN_OUT_FAR,
    AddedRows,
)
from gusjob.planner.skywriting.marks import Marks
from gusjob.planner.skywriting.run_geometry import Runs, runs_of


def add_run_rows(quantized: QuantizedPath, marks: Marks, rows: AddedRows) -> tuple[Floats, Floats]:
    """Add the run-ins and run-outs of all marks.

    Returns:
        x and y of the end of each timed row's run-out, (m,) pulse; 0 where there is none.
    """
    writer = _RunWriter(quantized=quantized, marks=marks, rows=rows)
    begins, ends = np.flatnonzero(marks.begins), np.flatnonzero(marks.ends)
    segments = quantized.segments
    writer.run_in(runs_of(segments, begins, writer.length(begins, marks.run_in_us[begins]), ahead=False))
    run_out_us = writer.run_out_us(ends)
    run_outs = runs_of(segments, ends, writer.length(ends, run_out_us), ahead=True)
    writer.run_out(run_outs, run_out_us)
    x, y = np.zeros(len(quantized.timed)), np.zeros(len(quantized.timed))
    x[ends], y[ends] = run_outs.x, run_outs.y
    return x, y


class _RunWriter(Struct, frozen=True, kw_only=True):
    """Adds the rows of runs. Marks are given by their numbers `at` among the timed rows."""

    quantized: QuantizedPath
    marks: Marks
    rows: AddedRows

    def length(self, at: Indices, time_us: Floats) -> Floats:
        """Length of a run, pulse: a time at mark speed, and up to it or down from it."""
        vel = self.marks.vel[at]
        return vel * time_us / US_PER_MS + vel * vel / (2 * self.marks.acc[at])

    def run_out_us(self, at: Indices) -> Floats:
        """Time of a run-out at mark speed: longer where motion ends before the laser can go off."""
        marks = self.marks
        run_us, lag_us = marks.run_out_us[at], marks.lag_us[at]
        moves_us = run_us + marks.vel[at] / marks.acc[at] * US_PER_MS
        short = np.flatnonzero(self.stops_behind(at) & (marks.mode[at] != 1) & (moves_us < lag_us))
        if len(short):  # A jump back to E may take long enough.
            rows, zero = self.quantized.timed[at[short]], np.zeros(len(short))
            (vel, _), (acc, _) = self.jump_speed(rows, "VEL"), self.jump_speed(rows, "ACC")
            back = trapezoids(self.length(at[short], run_us[short]), zero, vel, zero, acc)
            longer = moves_us[short] + back.duration_ms * US_PER_MS < lag_us[short]
            run_us[short] = np.where(longer, lag_us[short], run_us[short])
        return run_us

    def stops_behind(self, at: Indices) -> Bools:
        """Whether motion stops after marks: at a dwell, or at the end of their stage."""
        dwell = np.append(self.quantized.is_dwell, True)
        return np.asarray(dwell[at + 1] | (np.append(self.marks.stage, -1)[at + 1] != self.marks.stage[at]))

    def run_in(self, runs: Runs) -> None:
        """Add the motion from P to S; before it the one to P, backwards from S (mode 1) or by a jump."""
        marks, at = self.marks, runs.at
        reverse = marks.mode[at] == 1
        kind = RunKind.RUN_IN
        self.piece(runs, reverse, REVERSE, kind, runs.x, runs.y, back=True, smooth=runs.leaves)
        self.piece(runs, reverse & runs.leaves, REVERSE_FAR, kind, runs.far_x, runs.far_y, straight=True)
        self.piece(runs, runs.leaves, RUN_IN_FAR, kind, runs.x, runs.y, straight=True, smooth=True)
        self.piece(runs, np.True_, RUN_IN, kind, *self.starts(at), smooth=True)
        before = self.straight_before(at)
        extends = ~reverse & (before >= 0)
        self.rows.new_ends.append((self.quantized.timed[before[extends]], runs.far_x[extends], runs.far_y[extends]))
        self.jump(runs, ~reverse & (before < 0), JUMP_TO_RUN_IN, runs.far_x, runs.far_y)

    def run_out(self, runs: Runs, run_out_us: Floats) -> None:
        """Add the motion from E to Q, and after it the motion back to E where it is needed."""
        at = runs.at
        reverse = self.marks.mode[at] == 1
        kind = RunKind.RUN_OUT
        self.piece(runs, np.True_, RUN_OUT, kind, runs.x, runs.y, smooth=runs.leaves)
        self.piece(runs, runs.leaves, RUN_OUT_FAR, kind, runs.far_x, runs.far_y, straight=True)
        self.piece(runs, reverse & runs.leaves, BACK_FAR, kind, runs.x, runs.y, straight=True, smooth=True)
        self.piece(runs, reverse, BACK, kind, *self.ends(at), back=True)
        self.jump(runs, ~reverse & self.must_return(at, run_out_us), JUMP_BACK, *self.ends(at))

    def starts(self, at: Indices) -> tuple[Floats, Floats]:
        """Start points of marks, not rounded: a full circle is one because it ends exactly where it starts."""
        rows, path = self.quantized.timed[at], self.quantized.path
        return np.append(path.x, 0.0)[rows - 1], np.append(path.y, 0.0)[rows - 1]

    def ends(self, at: Indices) -> tuple[Floats, Floats]:
        """End points of marks, not rounded."""
        rows, path = self.quantized.timed[at], self.quantized.path
        return path.x[rows], path.y[rows]

    def piece(
        self,
        runs: Runs,
        where: Bools | np.bool_,
        offset: float,
        kind: RunKind,
        x: Floats,
        y: Floats,
        *,
        straight: bool = False,
        back: bool = False,
        smooth: Bools | bool = False,
    ) -> None:
        """Add a motion at mark speed to each run in `where`: along the mark's shape, `straight`, or `back` along it."""
        pick = np.broadcast_to(where, len(runs.at))
        at = runs.at[pick]
        self.rows.add(
            self.quantized.timed[at],
            offset,
            x=x[pick],
            y=y[pick],
            end=np.nan,
            **({"op": np.uint8(Op.LINE)} if straight else self.shape(at, back=back)),
            **self.marks.speed_columns(at),
            run=np.int8(kind),
            smooth=np.broadcast_to(smooth, len(runs.at))[pick],
        )

    def shape(self, at: Indices, *, back: bool) -> dict[str, Any]:
        """Columns of the marks' own lines or circles; circles by centre: by radius it is lost near half a turn."""
        on_arc, arcs = self.quantized.segments.arcs_among(at)
        if not len(on_arc):
            return {"op": np.uint8(Op.LINE)}
        op, centre = np.full(len(at), Op.LINE, dtype=np.uint8), np.full((2, len(at)), np.nan)
        op[on_arc], centre[:, on_arc] = Op.ARC_CENTRE, (arcs.cx, arcs.cy)
        ccw = self.quantized.path.ccw[self.quantized.timed[at]] != back
        return {"op": op, "ccw": ccw, "cx": centre[0], "cy": centre[1]}

    def jump(self, runs: Runs, where: Bools, offset: float, x: Floats, y: Floats) -> None:
        """Add jumps that the job does not have, at the JUMPVEL and JUMPACC in force."""
        rows = self.quantized.timed[runs.at[where]]
        vel, vel_in_mm = self.jump_speed(rows, "VEL")
        acc, acc_in_mm = self.jump_speed(rows, "ACC")
        self.rows.add(
            rows,
            offset,
            op=np.uint8(Op.JUMP),
            x=x[where],
            y=y[where],
            end=np.nan,
            vel=vel,
            acc=acc,
            vel_in_mm=vel_in_mm,
            acc_in_mm=acc_in_mm,
        )

    def jump_speed(self, rows: Indices, word: str) -> tuple[Floats, Bools]:
        """JUMPVEL or JUMPACC in force at marks' rows, by default VEL or ACC; and whether it was written in mm."""
        path, written = self.quantized.path, self.quantized.job.speeds
        own, own_mm = (path.vel, path.vel_in_mm) if word == "VEL" else (path.acc, path.acc_in_mm)
        which = np.flatnonzero(written.word == SPEED_WORDS.index(f"JUMP{word}"))
        if not len(which):
            return own[rows], own_mm[rows]
        last = np.searchsorted(written.row[which], self.quantized.origin[rows], side="right") - 1
        at = which[last]
        return np.where(last >= 0, written.value[at], own[rows]), np.where(last >= 0, written.in_mm[at], own_mm[rows])

    @property
    def may_change(self) -> Bools:
        """Straight motions with the laser off, (m,): where they start or end is free."""
        op = self.quantized.path.op[self.quantized.timed]
        return np.asarray((op == Op.JUMP) | ((op == Op.LINE) & ~self.marks.any_on))

    def straight_before(self, at: Indices) -> Indices:
        """The straight motion with the laser off that leads to each mark, dwells apart, as timed row; -1 for none."""
        dwell = self.quantized.is_dwell
        moving = np.maximum.accumulate(np.where(dwell, -1, np.arange(len(dwell))))
        before = np.where(at > 0, moving[at - 1], -1)
        leads = (before >= 0) & self.may_change[before] & (self.marks.stage[before] == self.marks.stage[at])
        return np.where(leads, before, -1)

    def must_return(self, at: Indices, run_out_us: Floats) -> Bools:
        """Whether the head has to return to a mark's end: the next motion starts there, or laser-off needs the time."""
        marks, dwell = self.marks, self.quantized.is_dwell
        count = len(dwell)
        moving = np.minimum.accumulate(np.where(dwell, count, np.arange(count))[::-1])[::-1]
        after = np.append(moving, [count, count])[at + 1]
        free = np.append((marks.begins & (marks.mode != 1)) | self.may_change, True)
        moves_us = run_out_us + marks.vel[at] / marks.acc[at] * US_PER_MS
        return np.asarray(~free[after] | (self.stops_behind(at) & (moves_us < marks.lag_us[at])))
