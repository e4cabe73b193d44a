"""What an interrupted run and its resumes left out and marked twice, from a device's log of emission.

Both runs are logs of lit stretches (support.device_log.Lit). A timed call of the job is identified by its channel, its
kind and its target, so the targets of a job must be unique. A point on it is identified by its distance to the call's
end, since a resume that begins within a call keeps its end; for a dwell, by the time to its end. The distance on an arc
that begins anew about a rounded centre is scaled to the arc of the job.

Emission counts where its power is not 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from support.device_log import Kind, Lit, Row

Floats = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]
Counts = npt.NDArray[np.int64]

NEAR_PULSE = 3.0
"""A stretch this near to the job's path is on it: a resume begins at whole pulses, and rounds the centre of an arc."""
POWER_TOLERANCE = 1e-6
DWELL_TOLERANCE_MS = 0.25
"""A dwell that is run again from rest begins with an on delay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """A piece of a call, from one distance to its end to another: pulse, for a dwell ms."""

    channel: int
    kind: Kind
    target: tuple[float, float]
    low: float
    high: float

    @property
    def size(self) -> float:
        return self.high - self.low

    def __str__(self) -> str:
        unit = "ms" if self.kind is Kind.DELAY else "pulse"
        where = f"{self.kind.name} to {self.target[0]:.0f},{self.target[1]:.0f} on channel {self.channel}"
        return f"{self.size:.2f} {unit} of {where}, {self.low:.2f} to {self.high:.2f} before its end"


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """The result of a comparison.

    `left_out`: pieces of the job that no part lit; `outside`: lit pieces that are not on the job's lit path. `doubled`:
    by part, the length of path that it lit although an earlier part or itself had lit it before by the same channel,
    pulse; `doubled_dwell_ms`: the same of dwells. `burning_ms`: emission at rest, more than in the run that was not
    interrupted. `wrong_power`: stretches of calls of a constant power that had another one.
    """

    left_out: tuple[Gap, ...]
    outside: tuple[Gap, ...]
    doubled: Floats
    doubled_dwell_ms: Floats
    burning_ms: float
    wrong_power: tuple[Gap, ...]

    @property
    def left_out_pulse(self) -> float:
        return sum(gap.size for gap in self.left_out if gap.kind is not Kind.DELAY)

    @property
    def left_out_ms(self) -> float:
        """Of dwells."""
        return sum(gap.size for gap in self.left_out if gap.kind is Kind.DELAY)

    @property
    def outside_pulse(self) -> float:
        return sum(gap.size for gap in self.outside)


@dataclass(frozen=True, slots=True)
class _Calls:
    """The lit calls of the job, and their numbers. `paths`: a stretch of each, the longest; its columns are Lit."""

    keys: list[tuple[int, int, int, int]]
    paths: Floats


@dataclass(frozen=True, slots=True)
class _Intervals:
    """Intervals of distance to the end. `call`: number of the call of each; they may overlap."""

    call: Counts
    low: Floats
    high: Floats

    def where(self, chosen: Bools) -> _Intervals:
        return _Intervals(self.call[chosen], self.low[chosen], self.high[chosen])


def coverage(expected: Floats, lits: Floats, marks: Sequence[int] = (), tolerance_pulse: float = 1.0) -> Coverage:
    """Compare an interrupted run with one that was not.

    Args:
        expected: stretches of the run that was not interrupted.
        lits: stretches of the interrupted run and its resumes, one after the other.
        marks: numbers of stretches at which a new part begins: those of each resume.
        tolerance_pulse: pieces up to this size are neither left out nor outside, and have no wrong power: the tail of
            an off delay behind a corner is shorter than a tick.

    Raises:
        ValueError: two calls of the job have the same target.
    """
    expected, part = expected[expected[:, Lit.POWER_MS] > 0], _parts(len(lits), marks)
    powered = lits[:, Lit.POWER_MS] > 0
    lits, part = lits[powered], part[powered]
    burning_ms = _burning_ms(lits, expected) - _burning_ms(expected, expected)
    expected, moved = expected[expected[:, Lit.KIND] != Kind.REST], lits[:, Lit.KIND] != Kind.REST
    lits, part = lits[moved], part[moved]
    calls = _calls(expected)
    wanted, found, on_path = _intervals(expected, calls), _intervals(lits, calls), _is_on_path(lits, calls)
    dwells = lits[:, Lit.KIND] == Kind.DELAY
    # A dwell that emits although none of the job does, emits at rest.
    burning_ms += float(lits[dwells & ~on_path, Lit.MS].sum())
    slack = _Intervals(wanted.call, wanted.low - tolerance_pulse, wanted.high + tolerance_pulse)
    strayed = _gaps_of(lits[~dwells & ~on_path])
    beyond = [gap for gap in _gaps(found.where(on_path), slack, calls) if gap.kind is not Kind.DELAY]
    left_out = [
        gap for gap in _gaps(wanted, found.where(on_path), calls) if gap.size > _tolerance(gap, tolerance_pulse)
    ]
    return Coverage(
        left_out=tuple(left_out),
        outside=(*strayed, *(gap for gap in beyond if gap.size > 1e-6)),
        doubled=_doubled(_paths(lits, calls, found, on_path & ~dwells), part[on_path & ~dwells], len(marks) + 1),
        doubled_dwell_ms=_doubled(_paths(lits, calls, found, on_path & dwells), part[on_path & dwells], len(marks) + 1),
        burning_ms=burning_ms,
        wrong_power=tuple(
            gap
            for gap in _gaps_of(lits[on_path & _has_another_power(lits, calls)])
            if gap.size > _tolerance(gap, tolerance_pulse)
        ),
    )


def _tolerance(gap: Gap, tolerance_pulse: float) -> float:
    return DWELL_TOLERANCE_MS if gap.kind is Kind.DELAY else tolerance_pulse


def _parts(count: int, marks: Sequence[int]) -> Counts:
    """The part that each stretch belongs to."""
    return np.searchsorted(np.asarray(marks, dtype=np.int64), np.arange(count), side="right").astype(np.int64)


def _burning_ms(lits: Floats, expected: Floats) -> float:
    """Emission at rest with the switch on, and the tails of off delays as far as they are longer than the job's."""
    rests = lits[:, Lit.KIND] == Kind.REST
    tails = expected[(expected[:, Lit.KIND] == Kind.REST) & (expected[:, Lit.COMMAND] == 0), Lit.MS].max(initial=0.0)
    on = lits[:, Lit.COMMAND] != 0
    over = np.maximum(lits[rests & ~on, Lit.MS] - tails, 0.0)
    return float(lits[rests & on, Lit.MS].sum() + over[over > 1e-6].sum())


def _key(stretch: Floats) -> tuple[int, int, int, int]:
    """Channel, kind, target. Every arc is one kind: a resume turns one by its radius into one about its centre."""
    kind = int(stretch[Lit.KIND])
    kind = int(Kind.ARC_CENTRE) if kind == Kind.ARC_RADIUS else kind
    return int(stretch[Lit.CHANNEL]), kind, round(float(stretch[Lit.X])), round(float(stretch[Lit.Y]))


def _calls(expected: Floats) -> _Calls:
    longest: dict[tuple[int, int, int, int], Floats] = {}
    ordinals: dict[tuple[int, int, int, int], float] = {}
    for stretch in expected:
        key = _key(stretch)
        if ordinals.setdefault(key, float(stretch[Lit.ORDINAL])) != stretch[Lit.ORDINAL]:
            raise ValueError(f"two calls of the job have the target {key}")
        if key not in longest or _length(stretch) > _length(longest[key]):
            longest[key] = stretch
    return _Calls(list(longest), np.array(list(longest.values())).reshape(-1, len(Lit)))


def _length(stretch: Floats) -> float:
    return float(stretch[Lit.LEFT0] - stretch[Lit.LEFT1])


def _numbers(lits: Floats, calls: _Calls) -> Counts:
    """The number of each stretch's call, -1 for none of the job."""
    numbers = {key: number for number, key in enumerate(calls.keys)}
    return np.array([numbers.get(_key(stretch), -1) for stretch in lits], dtype=np.int64)


def _intervals(lits: Floats, calls: _Calls) -> _Intervals:
    number = _numbers(lits, calls)
    scale = np.ones(len(lits))
    arcs = (number >= 0) & (lits[:, Lit.RADIUS] > 0)
    scale[arcs] = calls.paths[number[arcs], Lit.RADIUS] / lits[arcs, Lit.RADIUS]
    return _Intervals(number, lits[:, Lit.LEFT1] * scale, lits[:, Lit.LEFT0] * scale)


def _is_on_path(lits: Floats, calls: _Calls) -> Bools:
    """Whether a stretch is of a call of the job, and both of its ends are where that call has them."""
    number, found = _numbers(lits, calls), _intervals(lits, calls)
    near = number >= 0
    for i in np.flatnonzero(near):
        path = calls.paths[number[i]]
        ends = ((found.high[i], Lit.X0, Lit.Y0), (found.low[i], Lit.X1, Lit.Y1))
        near[i] = all(_distance(path, left, float(lits[i, x]), float(lits[i, y])) <= NEAR_PULSE for left, x, y in ends)
    return near


def _distance(path: Floats, left: float, x: float, y: float) -> float:
    """How far a point is from where a call is at a distance to its end."""
    target = path[[Lit.X, Lit.Y]]
    if path[Lit.KIND] == Kind.DELAY:
        return float(np.hypot(x - target[0], y - target[1]))
    radius = float(path[Lit.RADIUS])
    if radius > 0:
        centre = path[[Lit.CX, Lit.CY]]
        end = float(np.arctan2(*(target - centre)[::-1]))
        turned = left / radius
        return min(
            float(np.hypot(x - centre[0] - radius * np.cos(angle), y - centre[1] - radius * np.sin(angle)))
            for angle in (end - turned, end + turned)
        )
    back = (path[[Lit.X0, Lit.Y0]] - target) / path[Lit.LEFT0]
    return float(np.hypot(x - target[0] - left * back[0], y - target[1] - left * back[1]))


def _has_another_power(lits: Floats, calls: _Calls) -> Bools:
    """Whether a stretch had another power than its call, where that has one power throughout."""
    number = _numbers(lits, calls)
    wanted = calls.paths[number][:, [Lit.POWER_MIN, Lit.POWER_MAX]] if len(calls.keys) else np.zeros((len(lits), 2))
    is_constant = np.abs(wanted[:, 0] - wanted[:, 1]) < POWER_TOLERANCE
    off = np.abs(lits[:, [Lit.POWER_MIN, Lit.POWER_MAX]] - wanted).max(axis=1, initial=0.0) > POWER_TOLERANCE
    return np.asarray((number >= 0) & is_constant & off)


def _gaps_of(lits: Floats) -> tuple[Gap, ...]:
    """Return stretches as gaps."""
    return tuple(
        Gap(
            channel=int(stretch[Lit.CHANNEL]),
            kind=Kind(int(stretch[Lit.KIND])),
            target=(float(stretch[Lit.X]), float(stretch[Lit.Y])),
            low=float(stretch[Lit.LEFT1]),
            high=float(stretch[Lit.LEFT0]),
        )
        for stretch in lits
        if _length(stretch) > 1e-6
    )


@dataclass(frozen=True, slots=True)
class PathCells:
    """The path of a run, as cells of a grid that it passes, and their neighbours."""

    cells: Counts

    @staticmethod
    def of(rows: Floats) -> PathCells:
        """Make the cells of the rows of a run that was not interrupted; columns are support.device_log.Row."""
        passed = np.rint(np.concatenate([points_of(row) for row in rows]) / CELL_PULSE).astype(np.int64)
        around = np.array([(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)])
        return PathCells(np.unique(_codes((passed[:, None, :] + around[None, :, :]).reshape(-1, 2))))

    def off_path(self, rows: Floats) -> list[int]:
        """Return the numbers of rows that leave the path, but for jumps: they end on it, and are dark throughout."""
        found = []
        for number, row in enumerate(rows):
            near = np.isin(_codes(np.rint(points_of(row) / CELL_PULSE).astype(np.int64)), self.cells)
            is_dark = row[Row.POWER0_MS] == 0 and row[Row.POWER1_MS] == 0
            # A jump that is interrupted may end anywhere.
            if not (near.all() or (is_dark and (near[-1] or not row[Row.COMPLETED]))):
                found.append(number)
        return found


CELL_PULSE = 8.0


def points_of(row: Floats) -> Floats:
    """Return points along a row, its end last, at least one for each half cell."""
    length = float(row[Row.LENGTH])
    share = np.linspace(0.0, 1.0, int(length / CELL_PULSE * 2) + 2)
    begin, end, radius = row[[Row.X0, Row.Y0]], row[[Row.X1, Row.Y1]], float(row[Row.RADIUS])
    if radius > 0:
        centre, sweep = row[[Row.CX, Row.CY]], length / radius
        start = float(np.arctan2(*(begin - centre)[::-1]))
        several = [
            centre + radius * np.column_stack([np.cos(start + turned * share), np.sin(start + turned * share)])
            for turned in (sweep, -sweep)
        ]
        return min(several, key=lambda points: float(np.hypot(*(points[-1] - end))))
    return np.asarray(begin + share[:, None] * (end - begin))


def _codes(cells: Counts) -> Counts:
    """One number for each cell."""
    return np.asarray(cells[:, 0] * 2**31 + cells[:, 1], dtype=np.int64)


# Sets of intervals. All calls lie on one axis, one behind the other.


def _spread(intervals: _Intervals, room: float) -> Floats:
    """The union, as rows of begin and end on the common axis."""
    low = intervals.low + intervals.call * room
    order = np.argsort(low)
    low, high = low[order], (intervals.high + intervals.call * room)[order]
    if not len(low):
        return np.empty((0, 2))
    reach = np.maximum.accumulate(high)
    begins = np.concatenate([[True], low[1:] > reach[:-1]])
    first = np.flatnonzero(begins)
    last = np.concatenate([first[1:], [len(low)]]) - 1
    return np.column_stack([low[first], reach[last]])


def _holds(union: Floats, points: Floats) -> Bools:
    at = np.searchsorted(union[:, 0], points, side="right") - 1
    return np.asarray((at >= 0) & (points < union[np.maximum(at, 0), 1]) if len(union) else np.zeros(len(points), bool))


def _gaps(of: _Intervals, less: _Intervals, calls: _Calls) -> list[Gap]:
    """What intervals have that others do not have."""
    room = _room(of, less)
    one, other = _spread(of, room), _spread(less, room)
    edges = np.unique(np.concatenate([one.ravel(), other.ravel()]))
    middles = (edges[1:] + edges[:-1]) / 2
    missing = _holds(one, middles) & ~_holds(other, middles)
    begins = np.flatnonzero(missing & ~np.concatenate([[False], missing[:-1]]))
    ends = np.flatnonzero(missing & ~np.concatenate([missing[1:], [False]]))
    return [_gap(float(edges[i]), float(edges[j + 1]), room, calls) for i, j in zip(begins, ends, strict=True)]


def _gap(begin: float, end: float, room: float, calls: _Calls) -> Gap:
    number = int(np.floor((begin + end) / 2 / room + 0.25))
    channel, kind, x, y = calls.keys[number]
    shift = number * room
    return Gap(channel=channel, kind=Kind(kind), target=(x, y), low=begin - shift, high=end - shift)


def _room(*several: _Intervals) -> float:
    """A length that is longer than every call, with room for what lies before its begin or beyond its end."""
    return 2 * max(float(max(np.abs(i.high).max(initial=0), np.abs(i.low).max(initial=0))) for i in several) + 10


@dataclass(frozen=True, slots=True)
class _Paths:
    """Intervals on the common axis, on which all channels of a call lie at the same coordinates."""

    channel: Counts
    low: Floats
    high: Floats


def _paths(lits: Floats, calls: _Calls, found: _Intervals, chosen: Bools) -> _Paths:
    """The chosen intervals without regard to channels."""
    ways = {key: number for number, key in enumerate(dict.fromkeys(key[1:] for key in calls.keys))}
    way = np.array([ways[calls.keys[call][1:]] for call in found.call[chosen]], dtype=np.int64)
    shift, channel = way * _room(found), lits[chosen, Lit.CHANNEL].astype(np.int64)
    return _Paths(channel, found.low[chosen] + shift, found.high[chosen] + shift)


def _doubled(paths: _Paths, part: Counts, parts: int) -> Floats:
    """For each part, the length that it lit beyond what it lit first. Two channels at one position count once."""
    edges = np.unique(np.concatenate([paths.low, paths.high]))
    middles, lengths = (edges[1:] + edges[:-1]) / 2, np.diff(edges)

    def times(chosen: Bools) -> Counts:
        """How often the pieces between edges were lit."""
        begun = np.searchsorted(np.sort(paths.low[chosen]), middles)
        return np.asarray(begun - np.searchsorted(np.sort(paths.high[chosen]), middles), dtype=np.int64)

    made = np.zeros(parts)
    for number in range(parts):
        again = np.zeros(len(middles), dtype=np.int64)
        for channel in (0, 1):
            mine = paths.channel == channel
            before, now = times(mine & (part < number)), times(mine & (part == number))
            again = np.maximum(again, np.where(before > 0, now, np.maximum(now - 1, 0)))
        made[number] = float((again * lengths).sum())
    return made
