"""Intermediate results of the planner; each pass turns one into the next.

StagedPath      rows of the path in stages; positions not yet rounded
QuantizedPath   + segments in whole pulses, velocities and accelerations along each segment
PlannedPath     + end velocities
Plan            + laser switches at their final positions
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import Diagnostic
from gusjob.ir.intent import Intent, RunKind
from gusjob.ir.job import Job
from gusjob.ir.path import OF_DWELLS_AND_POWERS, Op, Path
from gusjob.ir.setup import Setup
from gusjob.kinematics.arrays import Bools, Floats, Indices, picked, rows_of
from gusjob.kinematics.geometry import Segments


class Stage(Struct, frozen=True, kw_only=True):
    """Setup statements that run at rest, then the rows first..last-1 of the path."""

    first: int
    last: int
    setups: tuple[Setup, ...]


class StagedPath(Struct, frozen=True, kw_only=True, eq=False):
    """The path of a job, cut into stages.

    `path`: n rows, perhaps more than the job has. `origin` (n,): row of the job's path from which each comes.
    `timed` (m,): rows that take time.
    """

    job: Job
    machine: Machine
    path: Path
    origin: Indices
    stages: tuple[Stage, ...]
    timed: Indices

    @property
    def is_dwell(self) -> Bools:
        """Timed rows that are a dwell, (m,)."""
        return np.asarray(self.path.op[rows_of(self.timed)] == Op.DWELL)

    @property
    def stage_first(self) -> Indices:
        """Number of each stage's first timed row, and the number of timed rows, (s+1,)."""
        return np.append(np.searchsorted(self.timed, [stage.first for stage in self.stages]), len(self.timed))

    @property
    def stage_of_timed(self) -> Indices:
        """Number of the stage of each timed row, (m,)."""
        return np.searchsorted([stage.first for stage in self.stages], self.timed, side="right") - 1


class MarkEvents(Struct, frozen=True, kw_only=True, eq=False):
    """Rows of the path that take effect at the start or the end of a mark, (g,) each.

    `row`: the switch or power. `mark_row`: the mark's row; of a laser-on that is `placed`, the first motion of the
    mark. `at_end`: it belongs to the end of the mark, not to its start. `effect_us`: time of the effect from there.
    `placed`: the row is at its final position already.
    """

    row: Indices
    mark_row: Indices
    at_end: Bools
    effect_us: Floats
    placed: Bools

    def __len__(self) -> int:
        return len(self.row)


class SkyRows(Struct, frozen=True, kw_only=True, eq=False):
    """Sky-writing facts about the rows of a path.

    `run` (n,): RunKind of a motion while the laser is off. `smooth` (n,): motions that continue into the next one
    without a corner, even if rounding to pulses makes one. Both have one entry for all rows, (1,), without sky
    writing.
    """

    run: npt.NDArray[np.int8]
    smooth: Bools
    events: MarkEvents

    def run_of(self, rows: Indices) -> npt.NDArray[np.int8]:
        """RunKind of some rows."""
        return self.run[rows] if len(self.events) else np.broadcast_to(self.run, len(rows))

    def smooth_of(self, rows: Indices) -> Bools:
        """Whether some rows continue into the next one without a corner."""
        return self.smooth[rows] if len(self.events) else np.broadcast_to(self.smooth, len(rows))


NO_SKY_WRITING = SkyRows(
    run=np.full(1, RunKind.NONE, dtype=np.int8),
    smooth=np.zeros(1, dtype=np.bool_),
    events=MarkEvents(
        row=np.empty(0, dtype=np.intp),
        mark_row=np.empty(0, dtype=np.intp),
        at_end=np.empty(0, dtype=np.bool_),
        effect_us=np.empty(0),
        placed=np.empty(0, dtype=np.bool_),
    ),
)
"""Of a job without sky writing."""


class QuantizedPath(StagedPath, frozen=True, kw_only=True, eq=False):
    """A path in whole pulses; all (m,) for the timed rows.

    `segments`: a dwell has no length. `vel`, `acc`: pulse/ms and pulse/ms2 along the segment. `forced_end`: END,
    pulse/ms along the segment, NaN if there is none.
    """

    segments: Segments
    vel: Floats
    acc: Floats
    forced_end: Floats
    sky: SkyRows


class PlannedPath(QuantizedPath, frozen=True, kw_only=True, eq=False):
    """A path with end velocities: `vel_end` (m,) pulse/ms. `vel` is slower on arcs, and 0 in a dwell."""

    vel_end: Floats
    diagnostics: tuple[Diagnostic, ...]


class Plan(PlannedPath, frozen=True, kw_only=True):
    """A job that is ready for a controller. `intent`: None without sky writing."""

    intent: Intent | None


_P = TypeVar("_P", bound=StagedPath)


def next_phase(kind: type[_P], phase: StagedPath, **added: Any) -> _P:
    """Make the next phase from all fields of a phase and what a pass adds."""
    return kind(**{name: getattr(phase, name) for name in phase.__struct_fields__}, **added)


def _picked_few(column: Floats, source: Indices, few: Indices) -> Floats:
    """Pick values of a column that only some of the new rows (`few`) use; elsewhere it takes no memory."""
    if column.strides == (0,):
        return picked(column, source)
    found = np.zeros(len(source))
    found[few] = column[source[few]]
    return found


def rearranged(staged: StagedPath, source: Indices, columns: dict[str, npt.NDArray[Any]]) -> StagedPath:
    """Make a path with other rows. No row leaves its stage.

    Args:
        staged: The path, n rows. What belongs to its rows (segments, velocities, sky) is not kept.
        source: For each new row the row that it is like, (k,).
        columns: Columns with new values, (k,) each.
    """
    path = staged.path
    kept = [name for name in Path.__struct_fields__ if name not in columns]
    few = np.flatnonzero((path.op >= Op.DWELL)[source])
    given = columns | {
        name: _picked_few(getattr(path, name), source, few)
        if name in OF_DWELLS_AND_POWERS
        else picked(getattr(path, name), source)
        for name in kept
    }
    moves = given["op"] < Op.DWELL
    if (given["op"] == Op.DWELL).any():
        # A dwell is where the motion before it ended.
        last = np.maximum.accumulate(np.where(moves, np.arange(len(source)), -1))
        for name in ("x", "y"):
            given[name] = np.where(moves | (last < 0), given[name], given[name][last])
    ends = [len(source)]
    if len(staged.stages) > 1:
        stage = np.searchsorted([stage.first for stage in staged.stages], source, side="right") - 1
        ends = np.cumsum(np.bincount(stage, minlength=len(staged.stages))).tolist()
    longer = Path(**given)
    return StagedPath(
        job=staged.job,
        machine=staged.machine,
        path=longer,
        origin=staged.origin[source],
        timed=np.flatnonzero(longer.takes_time),
        stages=tuple(
            replace(stage, first=first, last=last)
            for stage, first, last in zip(staged.stages, [0, *ends[:-1]], ends, strict=True)
        ),
    )
