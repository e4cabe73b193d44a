"""How far the velocity vector may change at a corner: LOOKAHEAD."""

from __future__ import annotations

import math

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.job import Job
from gusjob.ir.setup import LookAhead
from gusjob.kinematics.arrays import Floats, Indices


def corner_jumps(job: Job, machine: Machine, rows: Indices) -> Floats:
    """Largest change of the velocity vector after some rows of the path, (k,) pulse/ms; NaN where LOOKAHEAD is OFF."""
    jump = np.broadcast_to(_jump(LookAhead(corner=(math.nan, math.nan)), machine), len(rows))
    written = [setup for setup in job.setups if isinstance(setup.statement, LookAhead)]
    if not written:
        return jump
    jump = jump.copy()
    for setup in written:
        assert isinstance(setup.statement, LookAhead)
        jump[rows >= setup.row] = _jump(setup.statement, machine)
    return jump


def _jump(statement: LookAhead, machine: Machine) -> float:
    if statement.corner is None:
        return math.nan
    time_ms, acc = statement.corner
    time_ms = machine.lookahead_time_ms if math.isnan(time_ms) else time_ms
    acc = machine.lookahead_acc_pulse_per_ms2 if math.isnan(acc) else acc
    return time_ms * acc
