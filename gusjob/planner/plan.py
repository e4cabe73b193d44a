"""What the passes hand on: a job, split into stages, laid out in whole pulses, with velocities."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gusjob.diagnostics import Diagnostic
from gusjob.geometry import Segments
from gusjob.job import Job, Path, Setup
from gusjob.machine import Machine

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage:
    """Setup calls at rest, then path rows first..last-1."""

    first: int
    last: int
    setups: tuple[Setup, ...]


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
    origin: npt.NDArray[np.intp] | None = None
    timed: npt.NDArray[np.intp]
    segments: Segments | None = None
    vel: Floats
    acc: Floats
    vel_end: Floats
    diagnostics: tuple[Diagnostic, ...] = ()
