"""Pass: end velocities. Where LOOKAHEAD is on, a corner is as fast as the velocity vector may change there.

Corners are those of the path before rounding. Those that follow each other are also limited in sum, as an arc is: so
the velocity on a fine polyline is that on the curve which it approximates.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec.structs import replace

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule
from gusjob.ir.corner_jumps import corner_jumps
from gusjob.ir.display import display_units
from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Bools, Floats, blocks
from gusjob.kinematics.schedule import starts_at_rest
from gusjob.kinematics.trapezoids import corner_velocity, look_ahead
from gusjob.planner.plan import PlannedPath, QuantizedPath, StagedPath, next_phase
from gusjob.planner.row_diagnostics import report_rows


def velocities(quantized: QuantizedPath) -> PlannedPath:
    """Plan the end velocity of every segment; a forced END that can't be met is a diagnostic."""
    n = len(quantized.timed)
    if not n:
        return next_phase(PlannedPath, quantized, vel_end=np.empty(0), diagnostics=())
    segments, forced_end = quantized.segments, quantized.forced_end
    dwell, breaks = quantized.is_dwell, at_rest_before(quantized)
    jump = corner_jump(quantized)
    ahead, forced = np.isfinite(jump), np.isfinite(forced_end)
    smooth = _smooth(quantized)
    vel = path_velocity(quantized, jump)
    limit = _corner_limit(quantized, jump, vel, smooth)
    limit[:-1][breaks[1:] | dwell[:-1] | dwell[1:]] = 0.0
    if forced.any():
        limit = np.where(forced, np.minimum(forced_end, vel), limit)
    vel_end = limit
    if ahead.any() or forced.any() or smooth.any():
        acc = np.where(dwell, 1.0, quantized.acc) if dwell.any() else quantized.acc
        vel_end = look_ahead(segments.length, acc, limit, breaks)
        np.minimum(vel_end, limit, out=vel_end)
    diagnostics = _end_diagnostics(quantized, jump, vel, vel_end, np.append(breaks[1:], True)) if forced.any() else []
    return next_phase(
        PlannedPath,
        replace(quantized, vel=vel),
        vel_end=np.where(forced, forced_end, vel_end) if forced.any() else vel_end,
        diagnostics=tuple(diagnostics),
    )


def _smooth(quantized: QuantizedPath) -> Bools:
    """Whether timed rows continue into the next one without a corner, (m,): by sky writing, or on a curve."""
    smooth, chords = quantized.sky.smooth_of(quantized.timed), quantized.segments.chords
    if len(chords):
        smooth = smooth.copy()
        smooth[chords.at[chords.continues]] = True
    return smooth


def _corner_limit(quantized: QuantizedPath, jump: Floats, vel: Floats, smooth: Bools) -> Floats:
    """Compute the highest velocity at the end of each timed row by its corner and the velocities there, (m,) pulse/ms.

    Args:
        jump: Result of corner_jump, (m,).
        vel: Result of path_velocity, (m,) pulse/ms.
        smooth: Result of _smooth, (m,).
    """
    segments = quantized.segments
    limit = np.zeros(len(vel))
    turns, spacing = segments.turns, segments.corner_spacing
    for part in blocks(len(turns)):
        after = slice(part.start + 1, part.stop + 1)
        ahead = np.isfinite(jump[part])
        fastest = quantized.machine.max_acceleration_pulse_per_ms2
        corner = corner_velocity(turns[part], np.where(ahead, jump[part], 0.0), spacing[part], fastest)
        corner = np.where(smooth[part], np.inf, corner)
        limit[part] = np.where(ahead | smooth[part], np.minimum(np.minimum(vel[part], vel[after]), corner), 0.0)
    return limit


def path_velocity(quantized: QuantizedPath, jump: Floats) -> Floats:
    """Compute the velocity of each timed row: as written, slower on arcs where look-ahead is on, 0 in a dwell.

    Args:
        jump: Result of corner_jump, (m,).

    Returns:
        Velocities, (m,) pulse/ms.
    """
    dwell, segments = quantized.is_dwell, quantized.segments
    vel = np.where(dwell, 0.0, quantized.vel) if dwell.any() else quantized.vel
    if not len(segments.arc_at) and not len(segments.chords):
        return vel
    vel = vel.copy()
    # On an arc v^2/r stays within the machine's acceleration. Marks and runs of sky writing have their speed already.
    for at, radius in ((segments.arc_at, segments.arcs.radius), (segments.chords.at, segments.chords.radius)):
        fastest = np.minimum(vel[at], np.sqrt(quantized.machine.max_acceleration_pulse_per_ms2 * radius))
        slows = np.isfinite(jump[at]) & (quantized.sky.run_of(quantized.timed[at]) == RunKind.NONE)
        vel[at] = np.where(slows, fastest, vel[at])
    return vel


def at_rest_before(staged: StagedPath) -> Bools:
    """Timed rows before which motion stops, (m,): the first of a stage, dwells and what follows them."""
    dwell = staged.is_dwell
    return np.asarray(dwell | starts_at_rest(dwell, staged.stage_first))


def corner_jump(staged: StagedPath) -> Floats:
    """Largest change of the velocity vector after each segment, (m,) pulse/ms; NaN where LOOKAHEAD is OFF."""
    return corner_jumps(staged.job, staged.machine, staged.origin[staged.timed])


def _end_diagnostics(
    quantized: QuantizedPath, jump: Floats, vel: Floats, vel_end: Floats, stops: Bools
) -> list[Diagnostic]:
    """Find ENDs that length and acceleration can't meet, at a stop, or too fast for what follows or for their corner.

    An END is taken as written: at a corner it may be more than look-ahead allows, whether that is on or not.

    Args:
        jump: Result of corner_jump, (m,).
        vel: Result of path_velocity, (m,) pulse/ms.
        vel_end: End velocities that can be met, (m,) pulse/ms.
        stops: Timed rows after which motion stops, (m,).
    """
    segments, forced_end, machine = quantized.segments, quantized.forced_end, quantized.machine
    forced = np.isfinite(forced_end)
    collector = Collector(quantized.job.name)
    unreachable = forced & (vel_end < forced_end * (1 - 1e-9))
    _report(quantized, collector, rules.END_UNREACHABLE, unreachable, high=vel_end)
    following = np.append(vel[1:], np.inf)
    too_fast = forced & ~stops & ~unreachable & (forced_end > following * (1 + 1e-9))
    _report(quantized, collector, rules.END_ABOVE_NEXT_VEL, too_fast, velocity=following)
    _report(quantized, collector, rules.END_AT_STOP, forced & (forced_end > 0) & stops, high=vel_end)
    default = machine.lookahead_time_ms * machine.lookahead_acc_pulse_per_ms2
    allowed = np.append(np.where(np.isfinite(jump), jump, default)[:-1], np.inf)
    turns = np.append(np.where(forced, forced_end, 0.0)[:-1] * segments.turns, 0.0)
    sharp = forced & ~stops & (turns > allowed * (1 + 1e-9))
    _report(quantized, collector, rules.CORNER_TOO_FAST, sharp, high=vel_end, jump=turns, limit=allowed)
    return collector.finish(rules.NOT_LISTED)


def _report(quantized: QuantizedPath, collector: Collector, rule: Rule, where: Bools, **columns: Floats) -> None:
    """Report the END of every timed row in `where`; velocities in pulse/ms, shown in the job's units."""
    at = np.flatnonzero(where)
    path, timed = quantized.path, quantized.timed
    shown = display_units(quantized.job, quantized.machine)
    values = {"value": quantized.forced_end, **columns}

    def fields(index: int) -> dict[str, Any]:
        i = at[index]
        # As written: where the axes differ, a velocity in mm is another one in pulses for each direction.
        end = quantized.forced_end[i]
        written = float(path.end[timed[i]] / end) if end > 0 else 1.0
        shares = {name: float(column[i]) * written * shown.per_pulse_per_ms for name, column in values.items()}
        return {**shares, "speed": shown.speed}

    report_rows(quantized, collector, rule, timed[at], fields, "END")
