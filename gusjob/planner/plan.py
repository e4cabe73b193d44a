"""What the passes hand on: a job, split into stages, laid out in whole pulses, with velocities."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import Diagnostic
from gusjob.ir.job import Job
from gusjob.ir.path import Op, Path
from gusjob.ir.setup import Setup
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import Segments


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Setup calls at rest, then path rows first..last-1."""

    first: int
    last: int
    setups: tuple[Setup, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sky:
    """What sky writing has to do with a plan's path.

    For each row, (n,): `run`, stream.Run of a motion that is dark; `smooth`, a motion that goes on into the next
    without a corner, whatever rounding to pulses makes of it.

    For each row that goes by a mark, (g,): its `row`; `ref`, the row of the mark whose start, or end where
    `at_end` is set, it goes by; `edge_us`, when its effect shall come, counted from there; `placed`, it stands where it
    belongs already, and a start's `ref` is the piece in front of it.
    """

    run: npt.NDArray[np.int8]
    smooth: Bools
    row: Indices
    ref: Indices
    at_end: Bools
    edge_us: Floats
    placed: Bools


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A job on its way to calls. Each pass fills in its own part and leaves the rest.

    `path`: rows, perhaps more than the job's (an arc become lines): then `origin` has each one's row in the job.
    `timed` (m,): rows that take time. Of those: `segments` in whole pulses (a dwell has no length); `vel`, `acc`,
    `vel_end` in pulse/ms (2).
    """

    job: Job
    machine: Machine
    path: Path
    stages: tuple[Stage, ...] = ()
    origin: Indices | None = None
    timed: Indices
    segments: Segments | None = None
    vel: Floats
    acc: Floats
    vel_end: Floats
    sky: Sky | None = None
    mark_end: Indices | None = None
    """As in stream.Intent, where there is sky writing."""
    diagnostics: tuple[Diagnostic, ...] = ()


def rearranged(state: Plan, source: Indices, columns: dict[str, npt.NDArray[Any]]) -> Plan:
    """A plan with other rows: row i is like row source[i], but for what `columns` gives anew. No row leaves its stage.

    What hangs on the rows (segments, velocities, sky) is for the caller to make anew.
    """
    path = state.path
    given = {f.name: columns.get(f.name, _taken(getattr(path, f.name), source)) for f in fields(Path)}
    moves = given["op"] < Op.DWELL
    if (given["op"] == Op.DWELL).any():
        # A dwell is where the motion before it ended.
        last = np.maximum.accumulate(np.where(moves, np.arange(len(source)), -1))
        for name in ("x", "y"):
            given[name] = np.where(moves | (last < 0), given[name], given[name][last])
    ends = [len(source)]
    if len(state.stages) > 1:
        stage = np.searchsorted([stage.first for stage in state.stages], source, side="right") - 1
        ends = np.cumsum(np.bincount(stage, minlength=len(state.stages))).tolist()
    longer = Path(**given)
    return replace(
        state,
        path=longer,
        segments=None,
        origin=source if state.origin is None else state.origin[source],
        timed=np.flatnonzero(longer.takes_time),
        stages=tuple(
            replace(stage, first=first, last=last)
            for stage, first, last in zip(state.stages, [0, *ends[:-1]], ends, strict=True)
        ),
    )


def _taken(column: npt.NDArray[Any], source: Indices) -> npt.NDArray[Any]:
    """A column's values at rows; one that is one value for all rows stays so and takes no memory."""
    if len(column) and column.strides == (0,):
        return np.broadcast_to(column[0], len(source))
    return column[source]
