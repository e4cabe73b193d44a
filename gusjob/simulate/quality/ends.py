"""Where marks are meant to begin and end: S and E.

Those that the planner names (sky writing); else the places where the switch stands in path order. Light that was on
before its stage, or goes on behind it, is meant from the stage's start, to its end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.corners import unit_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Points, (k,) pulse, and the unit direction of the path there, in mm (0, 0 in a stage without motion)."""

    x: Floats
    y: Floats
    along_x: Floats
    along_y: Floats

    def pick(self, at: Indices) -> Place:
        """The places at indices."""
        return Place(x=self.x[at], y=self.y[at], along_x=self.along_x[at], along_y=self.along_y[at])


@dataclass(frozen=True, slots=True, kw_only=True)
class Ends:
    """S and E of marks, (k,). `first`, `last`: the motion that starts at S, the one that ends at E; `on`, `off`:
    timed calls that run before S, and up to E."""

    on: Indices
    off: Indices
    first: Indices
    last: Indices
    begin: Place
    finish: Place


def ends_of(trace: Trace, machine: Machine, channel: ChannelTrace) -> Ends:
    """S and E of a channel's emission intervals."""
    clock, shine = trace.clock, channel.emission
    begins, behind = clock.stage_first[shine.stage], clock.stage_first[shine.stage + 1]
    on = np.where(shine.on_row >= 0, _timed_before(trace, shine.on_row, 0), begins)
    # An immediate switch of a running stage acts at its start; else the light ends with its stage.
    at_once = shine.end_ms != clock.stage_end()[shine.stage]
    rest = np.where(at_once, begins, behind)
    off = np.where(shine.off_row >= 0, _timed_before(trace, shine.off_row, 1), rest)
    count, number = len(clock.row), np.arange(len(clock.row))
    moves = clock.laid.length > 0
    ahead = np.append(np.minimum.accumulate(np.where(moves, number, count)[::-1])[::-1], count)
    before = np.concatenate([[-1], np.maximum.accumulate(np.where(moves, number, -1))])
    return Ends(
        on=on,
        off=off,
        first=ahead[on],
        last=before[off],
        begin=_place(trace, machine, on, ahead[on], np.where(ahead[on] < behind, -1, before[on]), begins),
        finish=_place(trace, machine, off, np.where(ahead[off] < behind, ahead[off], count), before[off], begins),
    )


def _place(trace: Trace, machine: Machine, at: Indices, ahead: Indices, before: Indices, begins: Indices) -> Place:
    """The commanded point in front of timed call `at`, with the direction of motion `before` if that is in the stage
    (from `begins`), else of motion `ahead`."""
    laid = trace.clock.laid
    x, y = np.append(laid.x0[:1], laid.x1), np.append(laid.y0[:1], laid.y1)
    if not len(laid.x0):
        x, y = np.zeros(1), np.zeros(1)
    along = np.zeros((2, len(at)))
    comes = before >= begins
    leaves = ~comes & (ahead < len(laid.start_x))
    along[:, comes] = unit_mm(laid.end_x[before[comes]], laid.end_y[before[comes]], machine)
    along[:, leaves] = unit_mm(laid.start_x[ahead[leaves]], laid.start_y[ahead[leaves]], machine)
    return Place(x=x[at], y=y[at], along_x=along[0], along_y=along[1])


def _timed_before(trace: Trace, rows: Indices, behind: int) -> Indices:
    """How many timed calls run before each row; of one for which the planner names a motion, before that (`behind` 1:
    with it)."""
    clock = trace.clock
    boundary = np.zeros(int(clock.rows.max(initial=0)) + 1, dtype=np.intp)
    boundary[clock.rows] = clock.boundary
    if trace.intent is None or not len(rows):
        return np.asarray(boundary[rows])
    named = np.where(rows >= 0, trace.intent.mark_end[rows], -1)
    return np.where(named >= 0, boundary[named] + behind, boundary[rows])


def mark_lines(trace: Trace, stage: Indices, on: Indices) -> npt.NDArray[np.int32]:
    """Source line of the timed call with which each mark begins, (k,); of its stage where that has none."""
    clock = trace.clock
    started = np.array([run.line for run in trace.motion.program.stages], dtype=np.int32)
    cell = np.minimum(on, clock.stage_first[stage + 1] - 1)
    inside = cell >= clock.stage_first[stage]
    return np.where(inside, np.append(trace.line, 0)[cell], started[stage]).astype(np.int32)
