"""The motions and dwells of buffered calls, with the limits of their coordinate systems."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.execution import CrdSettings, RunCalls
from gusjob.controllers.gus.geometry import call_segments
from gusjob.kinematics.arrays import Bools, Floats, Indices, picked, rows_of, unrepeated, with_constant
from gusjob.simulate.events import MotionEvents


class LimitedMotions(Struct, frozen=True, kw_only=True, eq=False):
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
    calls, at, free = run.calls, rows_of(row), run.is_piece(row)
    dwell = calls.kind[at] == Buffered.DELAY
    if not dwell.any():
        dwell = np.broadcast_to(np.False_, len(row))
    settings = settings or [CrdSettings()]
    # A limit that holds for all motions is one number.
    vel_max = unrepeated(picked(np.array([s.vel_max_pulse_per_ms for s in settings]), stage))
    acc_max = unrepeated(picked(np.array([s.acc_max_pulse_per_ms2 for s in settings]), stage))
    vel, acc = with_constant(calls.vel[at]), with_constant(calls.acc[at])
    even_time = np.array([s.even_time_ms for s in settings])
    origin = np.array([s.origin_pulse for s in settings])
    events = MotionEvents(
        segments=call_segments(calls, row, dwell, start, tuple(origin[stage].T) if origin.any() else None),
        vel=_replaced(_replaced(vel, vel > vel_max, vel_max), dwell, 1.0),
        acc=_replaced(acc, ~free & (acc > acc_max), acc_max),
        even_time_ms=np.where(free, 0.0, even_time[stage]) if even_time.any() else None,
        vel_end=_replaced(calls.vel_end[at], dwell, 0.0),
        dwell=dwell,
        dwell_ms=calls.p[at] if dwell.any() else np.broadcast_to(0.0, len(row)),
        line=calls.line[at],
        call=run.source(row).astype(np.int32),
    )
    return LimitedMotions(
        events=events,
        too_fast=~dwell & (vel > vel_max * (1 + 1e-9)),
        too_strong=~dwell & ~free & (acc > acc_max * (1 + 1e-9)),
    )


def _replaced(values: Floats, where: Bools, other: Floats | float) -> Floats:
    """Replace values; where there are none to be replaced, nothing is copied."""
    return np.where(where, other, values) if where.any() else values
