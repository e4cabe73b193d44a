"""Pass: split the path where something is set at rest. A setup statement after motion begins a new stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gusjob.job import Crd, Job, LookAhead, Setup, Wait
from gusjob.planner.plan import Plan, Stage


def split(state: Plan) -> Plan:
    """Stages in job order; the path rows of all of them are contiguous."""
    path = state.path
    before = np.concatenate([[0], np.cumsum(path.takes_time)])
    stages: list[Stage] = []
    first, setups = 0, list[Setup]()
    for setup, at in zip(state.job.setups, _places(state), strict=True):
        if isinstance(setup.what, LookAhead | Crd):
            continue
        if before[at] > before[first]:
            stages.append(Stage(first=first, last=at, setups=tuple(setups)))
            first, setups = at, []
        if not isinstance(setup.what, Wait):
            setups.append(setup)
    if setups or first < len(path):
        stages.append(Stage(first=first, last=len(path), setups=tuple(setups)))
    return replace(state, stages=tuple(stages))


def new_stage_setups(job: Job) -> list[Setup]:
    """The setup statements (no WAIT) that make the motion stop."""
    before = np.concatenate([[0], np.cumsum(job.path.takes_time)])
    first, found = 0, []
    for setup in job.setups:
        if not isinstance(setup.what, LookAhead | Crd) and before[setup.at] > before[first]:
            first = setup.at
            if not isinstance(setup.what, Wait):
                found.append(setup)
    return found


def _places(state: Plan) -> list[int]:
    """Each setup's row in the plan's path, which may have more rows than the job's."""
    job_rows = np.array([s.at for s in state.job.setups], dtype=np.intp)
    rows = job_rows if state.origin is None else np.searchsorted(state.origin, job_rows, side="left")
    found: list[int] = rows.tolist()
    return found
