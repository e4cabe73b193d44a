"""The motions and dwells of buffered calls, with the limits of their coordinate systems."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.execution import CrdSettings, RunCalls
from gusjob.controllers.gus.geometry import call_segments
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.simulate.events import MotionEvents


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitedMotions:
    """Motions and dwells, (m,), and which of them ask for more than the limits of their coordinate system."""

    events: MotionEvents
    too_fast: Bools
    too_strong: Bools


def limited_motions(
    run: RunCalls,
    row: Indices,
    stage: Indices,
    settings: Sequence[CrdSettings],
    start: tuple[float, float] = (0.0, 0.0),
) -> LimitedMotions:
    """Make the motions and dwells of some rows.

    Args:
        run: The calls that run.
        row: Rows of the motions and dwells, (m,).
        stage: Number of the stage of each, (m,).
        settings: Of the coordinate system of each stage.
        start: Where the first one starts, pulse on the machine.
    """
    calls, free = run.calls, run.is_piece(row)
    dwell = calls.kind[row] == Buffered.DELAY
    settings = settings or [CrdSettings()]
    vel_max = np.array([s.vel_max_pulse_per_ms for s in settings])[stage]
    acc_max = np.array([s.acc_max_pulse_per_ms2 for s in settings])[stage]
    even_time = np.array([s.even_time_ms for s in settings])
    origin = np.array([s.origin_pulse for s in settings])
    acc = np.minimum(calls.acc[row], acc_max)
    events = MotionEvents(
        segments=call_segments(calls, row, dwell, start, tuple(origin[stage].T) if origin.any() else None),
        vel=np.where(dwell, 1.0, np.minimum(calls.vel[row], vel_max)),
        acc=np.where(free, calls.acc[row], acc),
        even_time_ms=np.where(free, 0.0, even_time[stage]) if even_time.any() else None,
        vel_end=np.where(dwell, 0.0, calls.vel_end[row]),
        dwell=dwell,
        dwell_ms=calls.p[row],
        line=calls.line[row],
        call=run.source(row),
    )
    return LimitedMotions(
        events=events,
        too_fast=~dwell & (calls.vel[row] > vel_max * (1 + 1e-9)),
        too_strong=~dwell & ~free & (calls.acc[row] > acc_max * (1 + 1e-9)),
    )
