"""Marks that are too short to reach their velocity, of a planned job and of calls alike."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.i18n.phrases import Phrase
from gusjob.ir.display import DisplayUnits
from gusjob.ir.modal import ModalState
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks, picked
from gusjob.kinematics.slow_parts import SlowParts, slow_parts

_DIGITS = 4
_MARK, _PART = Phrase("this mark"), Phrase("this part of the mark")
_EDGES = Phrase("between its corners this mark")


class PlannedSpeeds(Struct, frozen=True, kw_only=True, eq=False):
    """Motions and dwells with their velocities, (m,) each; lengths and velocities in pulses of X.

    `row`: row of the job's path that each comes from, ascending. `op`: Op of each. `asked`: velocity as it was set;
    `vel`: slower on an arc. `start`, `peak`, `end`: velocities at the start and the end, and the highest. `is_sky`: sky
    writing is on.
    """

    row: Indices
    op: npt.NDArray[np.uint8]
    length: Floats
    asked: Floats
    vel: Floats
    acc: Floats
    start: Floats
    peak: Floats
    end: Floats
    is_sky: Bools


class ShortMarks(Struct, frozen=True, kw_only=True, eq=False):
    """Parts of marks that are too short for their velocity, (q,).

    `at`, `last`: number of the first and the last motion of each. `is_part`: the mark has other velocities, too.
    """

    parts: SlowParts
    at: Indices
    last: Indices
    is_part: Bools

    def __len__(self) -> int:
        return len(self.at)

    def pick(self, which: Bools) -> ShortMarks:
        """Select some of the parts."""
        return ShortMarks(
            parts=self.parts.pick(which), at=self.at[which], last=self.last[which], is_part=self.is_part[which]
        )

    def without(self, motions: Bools) -> ShortMarks:
        """Leave out the parts that contain some of the motions, (m,)."""
        if not len(self) or not motions.any():
            return self
        before = np.concatenate([[0], np.cumsum(motions)])
        return self.pick(before[self.last + 1] == before[self.at])

    def fields(self, index: int, shown: DisplayUnits, machine: Machine) -> dict[str, Any]:
        """Make the fields of one diagnostic."""
        parts, limit = self.parts, machine.max_acceleration_pulse_per_ms2 * shown.per_pulse_per_ms2
        needed = _rounded(parts.needed_acc(index) * shown.per_pulse_per_ms2)
        remedy = Phrase("an acceleration of {value} {acceleration}", value=needed, acceleration=shown.acceleration)
        if needed > limit:
            remedy = Phrase("a lower velocity")
        return {
            "what": _EDGES if parts.has_corners[index] else _PART if self.is_part[index] else _MARK,
            "value": _rounded(parts.reached[index] * shown.per_pulse_per_ms),
            "velocity": _rounded(parts.aim[index] * shown.per_pulse_per_ms),
            "speed": shown.speed,
            "actual": _rounded(parts.length[index] * shown.per_pulse),
            "least": _rounded(parts.needed_length(index) * shown.per_pulse),
            "length": shown.length,
            "remedy": remedy,
        }


def short_marks(modal: ModalState, speeds: PlannedSpeeds) -> ShortMarks:
    """Find the parts of marks, each at one VEL, that are too short to reach it.

    Where the power follows the velocity, a mark gets the intended energy all the same. A sky-written mark is at its
    velocity at both ends, or has a diagnostic of its own (GJ811): only what lies between can be too slow.
    """
    moves = (speeds.op < Op.DWELL) & (speeds.op != Op.JUMP) & (speeds.length > 0)
    found = [_of_channel(modal, channel, speeds, moves) for channel in CHANNELS if len(modal.switches(channel))]
    if len(found) > 1:
        # Where both lasers are on, it is one motion.
        found[1] = found[1].pick(~_covers(found[0], len(moves))[found[1].at])
    return ShortMarks(
        parts=SlowParts.joined([part.parts for part in found]),
        at=np.concatenate([np.empty(0, dtype=np.intp), *(part.at for part in found)]),
        last=np.concatenate([np.empty(0, dtype=np.intp), *(part.last for part in found)]),
        is_part=np.concatenate([np.empty(0, dtype=np.bool_), *(part.is_part for part in found)]),
    )


def _of_channel(modal: ModalState, channel: int, speeds: PlannedSpeeds, moves: Bools) -> ShortMarks:
    """Find the short marks of one channel."""
    is_marked = modal.laser(channel).on & ~modal.follows_velocity(channel)
    rows = np.flatnonzero(moves & is_marked[speeds.row])
    begins, begins_part = part_begins(modal, channel, speeds.row[rows], picked(speeds.asked, rows))
    columns = {name: getattr(speeds, name) for name in ("length", "vel", "acc", "start", "peak", "end")}
    parts = slow_parts(rows, begins_part, **columns)
    first, last = parts.first, parts.last
    ends = np.append(begins[1:], True)[: len(rows)]
    found = ShortMarks(parts=parts, at=rows[first], last=rows[last], is_part=~(begins[first] & ends[last]))
    return found.pick(~(speeds.is_sky[rows[first]] & (begins[first] | ends[last])))


def part_begins(modal: ModalState, channel: int, rows: Indices, asked: Floats) -> tuple[Bools, Bools]:
    """Find where a mark begins, and where a part of one does: another velocity, or the power no longer follows it.

    Args:
        modal: State of the job.
        channel: Channel of the marks.
        rows: Rows of the path that are motions of marks without velocity follow, (k,) ascending.
        asked: Their velocities, (k,).

    Returns:
        Whether a mark begins, and whether a part does, (k,) each.
    """
    begins_mark, begins_part = np.ones(len(rows), dtype=np.bool_), np.ones(len(rows), dtype=np.bool_)
    follows = modal.job.path.takes_time & modal.follows_velocity(channel)
    followed = np.cumsum(follows, dtype=np.int32) if follows.any() else None
    begun = modal.switches(channel).begins
    for block in blocks(len(rows)):
        with_previous, later = slice(max(block.start - 1, 0), block.stop), slice(max(block.start, 1), block.stop)
        begins_mark[later] = np.diff(np.searchsorted(begun, rows[with_previous] * 2, side="right")) != 0
        begins_part[later] = begins_mark[later] | (np.diff(asked[with_previous]) != 0)
        if followed is not None:
            begins_part[later] |= np.diff(followed[rows[with_previous]]) != 0
    return begins_mark, begins_part


def _covers(found: ShortMarks, count: int) -> Bools:
    """Which of `count` motions are in one of the parts."""
    change = np.zeros(count + 1, dtype=np.intp)
    np.add.at(change, found.at, 1)
    np.add.at(change, found.last + 1, -1)
    return np.asarray(np.cumsum(change)[:-1] > 0)


def _rounded(value: float) -> float:
    """Round to few significant digits."""
    return float(f"{value:.{_DIGITS}g}")
