"""Stages of a job: a stage is what runs between two stops of the coordinate system."""

from __future__ import annotations

import numpy as np

from gusjob.ir.job import Job
from gusjob.ir.setup import IN_PATH


def setup_stages(job: Job) -> list[tuple[bool, int]]:
    """For each setup statement whether it begins a new stage, and the first row of its stage.

    Setup statements run at the start of their stage, before all of its rows: also those that are written behind rows
    that take no time.
    """
    timed_before = np.zeros(len(job.path) + 1, dtype=np.int32)
    np.cumsum(job.path.takes_time, out=timed_before[1:])
    first, found = 0, []
    for setup in job.setups:
        opens = not isinstance(setup.statement, IN_PATH) and bool(timed_before[setup.row] > timed_before[first])
        first = setup.row if opens else first
        found.append((opens, first))
    return found


def opens_stage(job: Job) -> list[bool]:
    """For each setup statement whether it stops the motion before it and begins a new stage."""
    return [opens for opens, _ in setup_stages(job)]
