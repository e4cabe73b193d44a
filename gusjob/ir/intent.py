"""Purposes of calls that only the planner knows: run-ins, run-outs, and the marks of laser calls."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.kinematics.arrays import Indices


class RunKind(IntEnum):
    """Purpose of a motion without emission: none in particular, run-in to a mark, run-out after a mark."""

    NONE = 0
    RUN_IN = 1
    RUN_OUT = 2


class Intent(Struct, frozen=True, kw_only=True, eq=False):
    """Purpose of each buffered call of a job with sky writing, (n,) each; it is not sent to a controller.

    `run`: RunKind of each motion. `mark_end`: for a laser-on call the buffered motion at whose start the mark begins,
    for a laser-off call the one at whose end it ends; -1 where the call itself is the end of the mark.
    """

    run: npt.NDArray[np.int8]
    mark_end: Indices
