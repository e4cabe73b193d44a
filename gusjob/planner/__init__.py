"""Job to Stream: stages, arcs the machine can't do, whole pulses, velocities, calls. One pass a file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gusjob.config.machine import Machine
from gusjob.ir.job import Job
from gusjob.planner.flatten import flatten
from gusjob.planner.layout import layout
from gusjob.planner.plan import Plan
from gusjob.planner.skywriting.field import stays_in_field
from gusjob.planner.skywriting.switch_points import switch_points
from gusjob.planner.skywriting.writing import sky_writing
from gusjob.planner.stages import split
from gusjob.planner.velocity import velocities

PASSES: tuple[Callable[[Plan], Plan], ...] = (
    flatten,
    split,
    layout,
    sky_writing,
    layout,
    stays_in_field,
    velocities,
    switch_points,
)
"""In this order; each takes a plan and gives a fuller one."""


def plan(job: Job, machine: Machine) -> Plan:
    """A checked job's plan: stages, segments in pulses, end velocities; diagnostics for ENDs that can't be met."""
    nothing = np.empty(0)
    state = Plan(
        job=job,
        machine=machine,
        path=job.path,
        timed=np.flatnonzero(job.path.takes_time),
        vel=nothing,
        acc=nothing,
        vel_end=nothing,
    )
    for step in PASSES:
        state = step(state)
    return state
