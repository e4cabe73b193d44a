"""Corners that a smooth path has only because its coordinates are rounded in the text."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.ir.corner_jumps import corner_jumps
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices, median
from gusjob.kinematics.trapezoids import corner_velocity, look_ahead, trapezoids
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter

_STRETCH_ROWS, _STRETCHES = 512, 64
"""Stretches of a long path that are looked at: enough for what holds for much of it, and quickly done."""
_DECIMALS_OF_MM, _MOST_DECIMALS = 2, 5
"""Decimals of a coordinate that is a rounded one. With fewer in mm it may be drawn on a grid."""
_ON_GRID = 1e-4
"""Largest distance from a multiple of the step, in steps: float noise."""
_LEAST_STEPS = 4.0
"""Least length of a line, in steps, whose corners may be made by rounding. Shorter ones may be steps of a staircase."""
_ROUNDING_STEPS = 2**0.5
"""By how much rounding moves one end of a line against the other, across it, in steps: at most."""
_CORNERS = 16
"""Corners before and behind each one that tell how the path bends there."""
_LEAST_CORNERS = 64
_SAME, _NO_LENGTH = 1e-9, 1e-9
_USUAL_STEPS = 12**-0.5
"""Root mean square by which rounding moves a point in one direction, in steps."""
_MOST_BEND = 1.3
"""Root mean square of the corners, as a share of what rounding makes: above it the path itself is uneven."""
_GAIN, _SHARE = 1.25, 0.25
"""How much faster the path would be without these corners, and on which share of its length."""


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def rounded_coordinates(context: LintContext, report: Reporter) -> None:
    """Short lines with corners that are explained by the rounding of the coordinates in the text, and are slow there.

    One diagnostic a job, since it is the program that wrote the job which rounds.
    """
    if len(context.path) < _LEAST_CORNERS:
        return
    lines = _sampled_lines(context)
    decimals = _decimals(context, lines)
    px, py = context.machine.pulses_per_mm
    unit = max(1.0, px / py) if context.job.in_pulses else px
    corners = _corners(lines, unit * 10.0**-decimals, context.machine.max_acceleration_pulse_per_ms2)
    slow = corners.by_rounding & (corners.limit < np.minimum(lines.vel[1:], lines.vel[:-1]) * (1 - _SAME))
    if np.count_nonzero(slow) < _LEAST_CORNERS or corners.unevenness > _MOST_BEND:
        return
    part = np.append(slow, False) | np.append(False, slow)
    length = lines.length[part].sum()
    time_ms, smooth_ms = (_durations_ms(lines, limit)[part].sum() for limit in (corners.limit, corners.smooth_limit))
    if not (length >= _SHARE * lines.length[lines.is_line].sum() and time_ms >= _GAIN * smooth_ms):
        return
    shown, at, digits = context.shown, np.append(slow, False), int(median(decimals[part]))
    asked = length / (lines.length[part] / lines.vel[part]).sum()
    # With lines of this length the usual corner is as fast as asked.
    needed = _ROUNDING_STEPS * unit * 10.0**-digits * asked / median(lines.jump[at])
    finer = max(math.ceil(math.log10(needed / median(lines.length[part]))), 1)
    report.rows(
        rules.ROUNDED_COORDINATES,
        lines.row[part][:1],
        "",
        step=f"{10.0**-digits:.{digits}f}",
        finer=f"{10.0 ** -(digits + finer):.{digits + finer}f}",
        value=_rounded(length / time_ms * shown.per_pulse_per_ms),
        velocity=_rounded(asked * shown.per_pulse_per_ms),
        least=_rounded(needed * shown.per_pulse),
        speed=shown.speed,
        length=shown.length,
    )


def _rounded(value: float) -> float:
    """Round to few significant digits."""
    return float(f"{value:.3g}")


class _SampledLines(Struct, frozen=True, kw_only=True, eq=False):
    """Motions and dwells of stretches of a path, (k,); lengths in pulses of X.

    `row`: row of the path. `is_line`: it is a LINE. `rests`: it is a dwell.
    """

    row: Indices
    is_line: Bools
    rests: Bools
    dx: Floats
    dy: Floats
    length: Floats
    vel: Floats
    acc: Floats
    jump: Floats


def _sampled_lines(context: LintContext) -> _SampledLines:
    """Look at all motions and dwells of a path, or of stretches of a long one."""
    path, (px, py) = context.path, context.machine.pulses_per_mm
    first = np.arange(0, len(path), _STRETCH_ROWS)
    if len(first) > _STRETCHES:
        first = np.linspace(0, len(path) - _STRETCH_ROWS, _STRETCHES).astype(np.intp)
    row = (first[:, None] + np.arange(_STRETCH_ROWS)).ravel()
    row = row[row < len(path)]
    op = path.op[row]
    x0, y0, x1, y1 = path.ends(row)
    dx, dy = x1 - x0, (y1 - y0) * (px / py)
    length = np.hypot(dx, dy)
    kept = np.flatnonzero((op == Op.DWELL) | ((op < Op.DWELL) & (length > 0)))
    rests = op[kept] == Op.DWELL
    return _SampledLines(
        row=row[kept],
        is_line=op[kept] == Op.LINE,
        rests=rests,
        dx=dx[kept],
        dy=dy[kept],
        length=length[kept],
        vel=np.where(rests, 1.0, path.vel[row[kept]]),
        acc=np.where(rests, 1.0, path.acc[row[kept]]),
        jump=corner_jumps(context.job, context.machine, row[kept]),
    )


def _decimals(context: LintContext, lines: _SampledLines) -> Floats:
    """Decimals to which both ways of each line are rounded, (k,); inf where they are not."""
    px, py = context.machine.pulses_per_mm
    units = (1.0, px / py) if context.job.in_pulses else (px, px)
    least = 0 if context.job.in_pulses else _DECIMALS_OF_MM
    found = np.full(len(lines.row), np.inf)
    for decimals in range(_MOST_DECIMALS, least - 1, -1):
        steps = (way / unit * 10.0**decimals for way, unit in zip((lines.dx, lines.dy), units, strict=True))
        found[np.logical_and.reduce([np.abs(s - np.rint(s)) < _ON_GRID for s in steps])] = decimals
    return found


class _SmallCorners(Struct, frozen=True, kw_only=True, eq=False):
    """Corners between motions, (k-1,).

    `by_rounding`: rounding explains by how much the path turns there more than around. `unevenness`: root mean square
    of that, as a share of what rounding makes. `limit`, `smooth_limit`: the highest velocity through each corner, and
    without what rounding explains, pulse/ms.
    """

    by_rounding: Bools
    unevenness: float
    limit: Floats
    smooth_limit: Floats


def _corners(lines: _SampledLines, steps: Floats, fastest: float) -> _SmallCorners:
    """Compare each corner with those around it.

    Args:
        lines: The lines, k.
        steps: To what the ends of each are rounded, (k,) pulse; 0: they are not.
        fastest: The machine's acceleration, pulse/ms2.
    """
    step = np.minimum(steps[:-1], steps[1:])
    (x0, x1), (y0, y1) = ((way[:-1], way[1:]) for way in (lines.dx, lines.dy))
    length, jump = np.maximum(lines.length, _NO_LENGTH), lines.jump[:-1]
    before, after = length[:-1], length[1:]
    turn = np.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1)
    share_before, share_after = step / before, step / after
    explained = _ROUNDING_STEPS * (share_before + share_after)
    short = lines.is_line[:-1] & lines.is_line[1:] & (step > 0) & (np.minimum(before, after) >= _LEAST_STEPS * step)
    may_be = short & (np.abs(turn) <= 2 * explained)
    bend = turn - (around := _mean_around(turn, may_be))
    usual = _USUAL_STEPS * np.sqrt(share_before**2 + (share_before + share_after) ** 2 + share_after**2)
    unevenness = math.sqrt(np.mean((bend / usual)[may_be] ** 2)) if may_be.any() else 0.0
    by_rounding = short & (np.abs(bend) <= explained)
    limits = []
    stops = lines.rests[:-1] | lines.rests[1:] | ~np.isfinite(jump)
    for angle in (turn, np.where(by_rounding, np.minimum(np.abs(around), np.abs(turn)), turn)):
        corner = corner_velocity(2 * np.abs(np.sin(angle / 2)), np.nan_to_num(jump), (before + after) / 2, fastest)
        limits.append(np.where(stops, 0.0, np.minimum(corner, np.minimum(lines.vel[:-1], lines.vel[1:]))))
    return _SmallCorners(
        by_rounding=by_rounding & ~stops, unevenness=unevenness, limit=limits[0], smooth_limit=limits[1]
    )


def _mean_around(values: Floats, counts: Bools) -> Floats:
    """Mean of the values that count around each one."""
    sums, numbers = (np.concatenate([[0.0], np.cumsum(v)]) for v in (np.where(counts, values, 0.0), counts))
    at = np.arange(len(values))
    first, last = np.maximum(at - _CORNERS, 0), np.minimum(at + _CORNERS + 1, len(values))
    return np.asarray((sums[last] - sums[first]) / np.maximum(numbers[last] - numbers[first], 1))


def _durations_ms(lines: _SampledLines, limit: Floats) -> Floats:
    """Compute the duration of each motion, (k,). `limit`: highest velocity at each corner, (k-1,) pulse/ms."""
    breaks = np.append(True, lines.rests[:-1])
    end = look_ahead(lines.length, lines.acc, np.append(limit, 0.0), breaks)
    start = np.where(breaks, 0.0, np.append(0.0, end[:-1]))
    return trapezoids(lines.length, start, lines.vel, end, lines.acc).duration_ms
