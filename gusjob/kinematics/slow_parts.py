"""Parts of a path that never reach their velocity, since they are too short to accelerate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks

REACHES = 0.9
"""Share of its velocity that a part has to reach: below it every mm takes at least a ninth longer than intended."""
_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, repr=False)
class SlowParts:
    """Parts that stay below their velocity, (q,), each with its fastest run from one corner to the next.

    `first`, `last`: indices of the first and the last segment of the part. `aim`, `reached`: the intended and the
    highest velocity, pulse/ms.
    `length`, `acc`, `start`, `end`: length, least acceleration and end velocities of the run. `has_corners`: the part
    has several runs.
    """

    first: Indices
    last: Indices
    aim: Floats
    reached: Floats
    length: Floats
    acc: Floats
    start: Floats
    end: Floats
    has_corners: Bools

    def pick(self, which: Bools) -> SlowParts:
        """Select some of the parts."""
        return SlowParts(**{name: getattr(self, name)[which] for name in SlowParts.__slots__})

    @staticmethod
    def joined(several: Sequence[SlowParts]) -> SlowParts:
        """Put parts behind each other."""
        kinds = {"first": np.intp, "last": np.intp, "has_corners": np.bool_}
        return SlowParts(
            **{
                name: np.concatenate(
                    [np.empty(0, dtype=kinds.get(name, np.float64)), *(getattr(s, name) for s in several)]
                )
                for name in SlowParts.__slots__
            }
        )

    def needed_length(self, index: int) -> float:
        """Length over which the run of a part reaches its velocity, pulse: v^2/a from rest to rest."""
        return self._gained(index) / float(self.acc[index])

    def needed_acc(self, index: int) -> float:
        """Acceleration with which the run of a part reaches its velocity, pulse/ms2: v^2/L from rest to rest."""
        return self._gained(index) / float(self.length[index])

    def _gained(self, index: int) -> float:
        """What (v^2 - start^2)/2 on the way up and (v^2 - end^2)/2 on the way down add up to."""
        aim, start, end = float(self.aim[index]), float(self.start[index]), float(self.end[index])
        return aim * aim - (start * start + end * end) / 2


def slow_parts(
    at: Indices,
    opens: Bools,
    *,
    length: Floats,
    vel: Floats,
    acc: Floats,
    start: Floats,
    peak: Floats,
    end: Floats,
) -> SlowParts:
    """Find the parts that stay below REACHES of their velocity in all their segments.

    A part that moves evenly, as fast as its corners allow, is none: it is not too short.

    Args:
        at: Numbers of the segments of all parts, (k,) ascending; they have a length.
        opens: Which of them are the first of a part, (k,); the first one is.
        length, vel, acc: Length, velocity and acceleration of all segments, (m,) pulse, pulse/ms, pulse/ms2.
        start, peak, end: Velocities at the start and the end, and the highest, (m,) pulse/ms.

    Returns:
        The parts, with indices in `at`.
    """
    share = np.empty(len(at))
    for block in blocks(len(at)):
        rows = at[block]
        share[block] = np.maximum(peak[rows], start[rows]) / vel[rows]
    begins = np.flatnonzero(opens)
    slow = np.maximum.reduceat(share, begins) < REACHES if len(begins) else np.zeros(0, dtype=np.bool_)
    rows = np.flatnonzero(np.repeat(slow, np.diff(begins, append=len(at))))
    if not len(rows):
        return SlowParts.joined([])
    share, opens = share[rows], opens[rows]
    length, vel, acc, start, peak, end = (column[at[rows]] for column in (length, vel, acc, start, peak, end))
    part = np.cumsum(opens)
    # At a corner the velocity is lower than before and after it.
    valley = np.zeros(len(rows), dtype=np.bool_)
    valley[1:] = ~opens[1:] & (start[1:] < np.minimum(peak[:-1], peak[1:]) * (1 - _ROUNDING))
    runs = np.flatnonzero(opens | valley)
    last = np.append(runs[1:], len(rows)) - 1
    # The fastest run of each part comes first.
    order = np.lexsort((-np.maximum.reduceat(share, runs), part[runs]))
    firsts = np.flatnonzero(opens[runs])
    fastest = order[firsts]
    first = rows[opens]
    found = SlowParts(
        first=first,
        last=rows[np.append(np.flatnonzero(opens)[1:], len(rows)) - 1],
        aim=np.maximum.reduceat(vel, runs)[fastest],
        reached=np.maximum.reduceat(np.maximum(peak, start), runs)[fastest],
        length=np.add.reduceat(length, runs)[fastest],
        acc=np.minimum.reduceat(acc, runs)[fastest],
        start=start[runs][fastest],
        end=end[last][fastest],
        has_corners=np.diff(firsts, append=len(runs)) > 1,
    )
    after_corner, before_corner = valley[runs], np.append(valley[runs][1:], False)
    at_corner = np.maximum(np.where(after_corner, start[runs], 0.0), np.where(before_corner, end[last], 0.0))
    return found.pick(at_corner[fastest] < REACHES * found.reached)
