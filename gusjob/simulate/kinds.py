"""Kind of each segment: what is commanded, not what delays, FPK and power make of it."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Bools
from gusjob.simulate.emission import Emission


class SegmentKind(IntEnum):
    """Kind of a segment: laser commanded on, or off; run-in to a mark, run-out after a mark; standing still."""

    MARK = 0
    JUMP = 1
    RUN_IN = 2
    RUN_OUT = 3
    DWELL = 4

    @property
    def word(self) -> str:
        """The name in the JSON."""
        return self.name.lower()


_RUNS = ((RunKind.RUN_IN, SegmentKind.RUN_IN), (RunKind.RUN_OUT, SegmentKind.RUN_OUT))


def segment_kinds(
    dwell: Bools, run_kind: npt.NDArray[np.int8] | None, emissions: Iterable[Emission]
) -> npt.NDArray[np.int8]:
    """Find the SegmentKind of each segment, (m,).

    Args:
        dwell: Segments that stand still, (m,).
        run_kind: RunKind of each segment, (m,), of a planned job with sky writing.
        emissions: Of all channels.
    """
    kind = np.full(len(dwell), SegmentKind.JUMP, dtype=np.int8)
    if run_kind is not None:
        for run, of_run in _RUNS:
            kind[run_kind == run] = of_run
    for emission in emissions:
        kind[emission.commanded] = SegmentKind.MARK
    kind[dwell] = SegmentKind.DWELL
    return kind
