"""Find the marks that are sky-written: where they begin and end, and their settings."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.ir.modal import modal_state
from gusjob.ir.path import Op
from gusjob.ir.setup import SkyWriting
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.planner.plan import QuantizedPath
from gusjob.planner.velocity import corner_jump, path_velocity

_SAME_CORNER = 1e-9
"""Rounding of the cosine of a corner."""


class Marks(Struct, frozen=True, kw_only=True, eq=False):
    """The timed rows of a path as sky writing sees them, (m,) each.

    `is_mark`: the row is sky-written. `joined`: the mark before it continues without a break. `is_chord`: so it does,
    and both are chords of one arc. `on`: the laser is commanded on, by channel. `stage`: number of the stage. `mode`,
    `lag_us`, `on_us`, `run_in_us`, `run_out_us`: settings of SKYWRITE. `vel`, `acc`: pulse/ms and pulse/ms2 of the
    motion. `as_written`: velocities and accelerations of all marks are those of their rows, none slower or scaled.
    """

    is_mark: Bools
    joined: Bools
    is_chord: Bools
    on: tuple[Bools, ...]
    stage: Indices
    mode: Floats
    lag_us: Floats
    on_us: Floats
    run_in_us: Floats
    run_out_us: Floats
    vel: Floats
    acc: Floats
    as_written: bool

    @property
    def begins(self) -> Bools:
        """Marks that get a run-in."""
        return self.is_mark & ~self.joined

    @property
    def ends(self) -> Bools:
        """Marks that get a run-out."""
        return np.asarray(self.is_mark & ~np.append(self.joined[1:], False))

    @property
    def any_on(self) -> Bools:
        """The laser of some channel is commanded on."""
        return np.asarray(np.logical_or.reduce(self.on))

    def on_alone(self, channel: int) -> Bools:
        """The laser of this channel is commanded on, no other one is."""
        others = [on for number, on in enumerate(self.on) if number != channel]
        return np.asarray(self.on[channel] & ~np.logical_or.reduce(others))

    def speed_columns(self, at: Indices) -> dict[str, Any]:
        """Make the columns of rows that move at the velocity of marks, if these are not those of the marks' rows."""
        if self.as_written:
            return {}
        return {"vel": self.vel[at], "acc": self.acc[at], "vel_in_mm": False, "acc_in_mm": False}


def find_marks(quantized: QuantizedPath, number: Indices, settings: tuple[SkyWriting, ...]) -> Marks:
    """Find the marks that are sky-written.

    Args:
        number: For each row of the job's path the number of the settings in force, -1 for none.
        settings: The settings.
    """
    path, timed = quantized.path, quantized.timed
    job_rows = quantized.origin[timed]
    modal = modal_state(quantized.job)
    on = tuple(modal.laser(channel).on[job_rows] for channel in CHANNELS)
    sky = number[job_rows]
    op = path.op[timed]
    is_mark = (sky >= 0) & np.logical_or.reduce(on) & (op != Op.JUMP) & (op != Op.DWELL)

    def setting(name: str) -> Floats:
        # Rows without sky writing read the 0 at the end.
        return np.array([*(float(getattr(s, name)) for s in settings), 0.0])[sky]

    mode = setting("mode")
    stage = quantized.stage_of_timed
    together = is_mark[1:] & is_mark[:-1] & (stage[1:] == stage[:-1]) & (sky[1:] == sky[:-1])
    # The chords of an arc are one mark.
    line, provenance = path.line[timed], path.provenance[timed]
    chords = (line[1:] == line[:-1]) & (provenance[1:] == provenance[:-1]) & (op[1:] == Op.LINE)
    flat = np.zeros(len(together), dtype=np.bool_)
    corners = np.flatnonzero(together & (mode[1:] == 3))
    flat[corners] = _cosines(quantized, corners) >= setting("limit")[corners + 1] - _SAME_CORNER
    is_chord = np.concatenate([[False], together & chords])[: len(is_mark)]
    vel = path_velocity(quantized, corner_jump(quantized))
    return Marks(
        is_mark=is_mark,
        joined=np.concatenate([[False], together & (chords | flat)])[: len(is_mark)],
        is_chord=is_chord,
        on=on,
        stage=stage,
        mode=mode,
        lag_us=setting("lag_us"),
        on_us=setting("on_us"),
        run_in_us=setting("run_in_us"),
        run_out_us=setting("run_out_us"),
        vel=_slowed_on_chords(quantized, vel, is_chord) if is_chord.any() else vel,
        acc=quantized.acc,
        as_written=quantized.machine.equal_axes and not len(quantized.segments.arc_at),
    )


def _cosines(quantized: QuantizedPath, at: Indices) -> Floats:
    """Cosine of the angle, on the part, by which the path turns after timed rows."""
    px, py = quantized.machine.pulses_per_mm
    segments = quantized.segments
    (out_x, out_y), (in_x, in_y) = segments.end_direction(at), segments.start_direction(at + 1)
    out_x, out_y, in_x, in_y = out_x / px, out_y / py, in_x / px, in_y / py
    return np.asarray((out_x * in_x + out_y * in_y) / (np.hypot(out_x, out_y) * np.hypot(in_x, in_y)))


def _slowed_on_chords(quantized: QuantizedPath, vel: Floats, is_chord: Bools) -> Floats:
    """Slow the chords of arcs as arcs are: within the machine's acceleration, all chords of one arc alike."""
    chords, radius = quantized.segments.chords, np.full(len(vel), np.inf)
    radius[chords.at] = chords.radius
    fastest = np.minimum(np.sqrt(quantized.machine.max_acceleration_pulse_per_ms2 * radius), vel)
    begins = np.flatnonzero(~is_chord)
    share = np.minimum.reduceat(fastest / np.maximum(quantized.vel, 1e-12), begins)
    return np.asarray(quantized.vel * np.repeat(share, np.diff([*begins.tolist(), len(vel)])))
