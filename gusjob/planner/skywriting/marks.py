"""Which motions are sky-written, where marks begin and end, and what their SKYWRITE says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gusjob.ir.path import Op
from gusjob.ir.setup import SkyWriting
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import Segments
from gusjob.lint.view import view_of
from gusjob.planner.plan import Plan
from gusjob.planner.velocity import corner_jump, path_velocity

_SAME_CORNER = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Marks:
    """The timed rows of a plan as sky writing sees them, (m,) each.

    mark: is sky-written; joined: goes on from the mark before it without a break; bent: both are pieces of one arc
    that became lines; lit: by channel. mode, timings (us)
    and corner limit of its SKYWRITE. vel, acc: pulse/ms (2), at which it is run.
    """

    mark: Bools
    joined: Bools
    bent: Bools
    lit: tuple[Bools, Bools]
    stage: Indices
    mode: Floats
    lag_us: Floats
    on_us: Floats
    run_in_us: Floats
    run_out_us: Floats
    vel: Floats
    acc: Floats

    @property
    def begins(self) -> Bools:
        """Marks that get a run-in."""
        return self.mark & ~self.joined

    @property
    def ends(self) -> Bools:
        """Marks that get a run-out."""
        return np.asarray(self.mark & ~np.append(self.joined[1:], False))


def marks_of(state: Plan, number: Indices, settings: tuple[SkyWriting, ...]) -> Marks:
    path, timed, laid = state.path, state.timed, state.segments
    assert laid is not None
    job_rows = timed if state.origin is None else state.origin[timed]
    view = view_of(state.job, state.machine)
    lit = (view.lit(0)[0][job_rows], view.lit(1)[0][job_rows])
    sky = number[job_rows]
    op = path.op[timed]
    mark = (sky >= 0) & (lit[0] | lit[1]) & (op != Op.JUMP) & (op != Op.DWELL)

    def of(name: str) -> Floats:
        # Rows without sky writing read the 0 at the end.
        return np.array([*(float(getattr(s, name)) for s in settings), 0.0])[sky]

    mode = of("mode")
    stage = np.searchsorted([s.first for s in state.stages], timed, side="right") - 1
    together = mark[1:] & mark[:-1] & (stage[1:] == stage[:-1]) & (sky[1:] == sky[:-1])
    # The pieces of an arc that became lines are one mark.
    line, provenance = path.line[timed], path.provenance[timed]
    pieces = (line[1:] == line[:-1]) & (provenance[1:] == provenance[:-1])
    pieces &= op[1:] == Op.LINE
    flat = np.zeros(len(together), dtype=np.bool_)
    asked = np.flatnonzero(together & (mode[1:] == 3))
    flat[asked] = _cosines(state, laid, asked) >= of("limit")[asked + 1] - _SAME_CORNER
    bent = np.concatenate([[False], together & pieces])[: len(mark)]
    vel = path_velocity(state, corner_jump(state))
    return Marks(
        mark=mark,
        joined=np.concatenate([[False], together & (pieces | flat)])[: len(mark)],
        bent=bent,
        lit=lit,
        stage=stage,
        mode=mode,
        lag_us=of("lag_us"),
        on_us=of("on_us"),
        run_in_us=of("run_in_us"),
        run_out_us=of("run_out_us"),
        vel=_slowed_where_bent(state, vel, bent) if bent.any() else vel,
        acc=state.acc,
    )


def _cosines(state: Plan, laid: Segments, at: Indices) -> Floats:
    """Cosine of the angle, on the part, by which the path turns behind timed rows."""
    px, py = state.machine.pulses_per_mm
    out_x, out_y, in_x, in_y = (
        laid.end_x[at] / px,
        laid.end_y[at] / py,
        laid.start_x[at + 1] / px,
        laid.start_y[at + 1] / py,
    )
    return np.asarray((out_x * in_x + out_y * in_y) / (np.hypot(out_x, out_y) * np.hypot(in_x, in_y)))


def _slowed_where_bent(state: Plan, vel: Floats, bent: Bools) -> Floats:
    """Arcs that became lines stay within the machine's acceleration as arcs do: all of one are slowed alike.

    A chord of length L that turns by an angle phi is a piece of a circle of radius L/phi; v^2/r stays.
    """
    laid = state.segments
    assert laid is not None
    turn = np.hypot(laid.start_x[1:] - laid.end_x[:-1], laid.start_y[1:] - laid.end_y[:-1])
    radius = np.full(len(vel), np.inf)
    radius[1:][bent[1:]] = (laid.length[1:] / np.maximum(turn, 1e-12))[bent[1:]]
    most = np.sqrt(state.machine.max_acceleration_pulse_per_ms2 * radius)
    begins = np.flatnonzero(~bent)
    share = np.minimum.reduceat(np.minimum(most / np.maximum(vel, 1e-12), 1.0), begins)
    return np.asarray(vel * np.repeat(share, np.diff([*begins.tolist(), len(vel)])))
