"""Pass: cut the path into stages. A setup statement after a motion begins a new stage."""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.job import Job
from gusjob.ir.path import Path
from gusjob.ir.setup import IN_PATH, Setup, Wait
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.arrays import Indices
from gusjob.planner.plan import Stage, StagedPath


def split(job: Job, machine: Machine, path: Path, origin: Indices) -> StagedPath:
    """Cut a path into stages in job order; the rows of all of them are contiguous.

    Args:
        path: The path, n rows; it may have more rows than the job's.
        origin: Row of the job's path from which each comes, (n,).
    """
    rows = np.searchsorted(origin, np.array([setup.row for setup in job.setups], dtype=np.intp), side="left")
    stages: list[Stage] = []
    first, setups = 0, list[Setup]()
    for setup, row, opens in zip(job.setups, rows.tolist(), opens_stage(job), strict=True):
        if opens:
            stages.append(Stage(first=first, last=row, setups=tuple(setups)))
            first, setups = row, []
        if not isinstance(setup.statement, (Wait, *IN_PATH)):
            setups.append(setup)
    if setups or first < len(path):
        stages.append(Stage(first=first, last=len(path), setups=tuple(setups)))
    return StagedPath(
        job=job,
        machine=machine,
        path=path,
        origin=origin,
        stages=tuple(stages),
        timed=np.flatnonzero(path.takes_time),
    )
