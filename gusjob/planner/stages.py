"""Pass: split the path where something is set at rest. A setup statement after motion begins a new stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gusjob.ir.setup import IN_PATH, Setup, Wait
from gusjob.ir.stages import opens_stage
from gusjob.planner.plan import Plan, Stage


def split(state: Plan) -> Plan:
    """Stages in job order; the path rows of all of them are contiguous."""
    stages: list[Stage] = []
    first, setups = 0, list[Setup]()
    for setup, at, opens in zip(state.job.setups, _places(state), opens_stage(state.job), strict=True):
        if opens:
            stages.append(Stage(first=first, last=at, setups=tuple(setups)))
            first, setups = at, []
        if not isinstance(setup.statement, (Wait, *IN_PATH)):
            setups.append(setup)
    if setups or first < len(state.path):
        stages.append(Stage(first=first, last=len(state.path), setups=tuple(setups)))
    return replace(state, stages=tuple(stages))


def _places(state: Plan) -> list[int]:
    """Each setup's row in the plan's path, which may have more rows than the job's."""
    job_rows = np.array([s.row for s in state.job.setups], dtype=np.intp)
    rows = job_rows if state.origin is None else np.searchsorted(state.origin, job_rows, side="left")
    found: list[int] = rows.tolist()
    return found
