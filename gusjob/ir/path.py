"""The path of a job as columns: one row a motion, dwell, power or switch statement."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.kinematics.arrays import Bools, Floats, Indices, follow_each_other
from gusjob.kinematics.geometry import Ends


class Op(IntEnum):
    """Kind of a row of the path. Rows up to DWELL take time; the others act between them."""

    LINE = 0
    JUMP = 1
    ARC_CENTRE = 2
    ARC_RADIUS = 3
    DWELL = 4
    POWER = 5
    FOLLOW = 6
    ON = 7
    OFF = 8

    @property
    def word(self) -> str:
        """The statement as a user writes it."""
        return ("LINE", "JUMP", "ARC", "ARC", "DWELL", "LASER POWER", "LASER FOLLOW", "LASER ON", "LASER OFF")[self]


class Path(Struct, frozen=True, kw_only=True, eq=False):
    """The path, one row a statement: all columns (n,), NaN (0 for whole numbers) where a row does not use one.

    A column with one value for all rows is a broadcast array (stride 0) and takes no memory. The columns of dwells and
    powers are 0 (or NaN) in rows of other kinds.

    Geometry: `x`, `y`: end point, absolute, pulse. `cx`, `cy`: centre of an arc, absolute, pulse. `radius`: signed,
    in pulses of X. `ccw`: direction of an arc. `arc_in_mm`: the arc is a circle in mm, not in pulses (they differ
    where the axes have different pulses per mm).

    Speed: `vel`, `acc`: pulse/ms and pulse/ms2 along an axis with X's pulses per mm. `end`: forced end velocity,
    pulse/ms, NaN if there is none. `vel_in_mm`, `acc_in_mm`, `end_in_mm`: the value was written in mm, so it depends
    on the segment's own direction where the axes differ. `vel_line`, `acc_line`: line that set the value.
    `dwell_ms`: whole ms.

    Power: `power`: direct power. `low`, `high`, `ratio`: limits of follow, and power per pulse/ms. `follow_in_mm`: the
    ratio was written per mm. `power_unit`, `low_unit`, `high_unit`: PowerUnit as written.

    `provenance`: node of the statement in the job's Provenance. `unknown_before`, `unknown`: the state before and after
    the row, bits of ir.effects: what depends on statements that can't be read.
    """

    op: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    channel: npt.NDArray[np.int8]
    ccw: Bools
    arc_in_mm: Bools
    x: Floats
    y: Floats
    cx: Floats
    cy: Floats
    radius: Floats
    vel: Floats
    acc: Floats
    end: Floats
    vel_line: npt.NDArray[np.int32]
    acc_line: npt.NDArray[np.int32]
    vel_in_mm: Bools
    acc_in_mm: Bools
    end_in_mm: Bools
    dwell_ms: Floats
    power: Floats
    low: Floats
    high: Floats
    ratio: Floats
    follow_in_mm: Bools
    power_unit: npt.NDArray[np.int8]
    low_unit: npt.NDArray[np.int8]
    high_unit: npt.NDArray[np.int8]
    provenance: npt.NDArray[np.int32]
    unknown_before: npt.NDArray[np.int32]
    unknown: npt.NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.op)

    def without_rows(self) -> Path:
        """Return a path that has no rows."""
        return Path(**{name: getattr(self, name)[:0].copy() for name in Path.__struct_fields__})

    def without_numbers(self) -> Path:
        """Return a path that has only its operations, channels, lines and states: all its numbers are 0."""
        kept = ("op", "channel", "line", "unknown_before", "unknown")
        nothing = {name: getattr(self, name).dtype.type(0) for name in self.__struct_fields__ if name not in kept}
        return replace(self, **{name: np.broadcast_to(value, len(self)) for name, value in nothing.items()})

    @property
    def takes_time(self) -> Bools:
        """Rows that are a motion or a dwell, (n,)."""
        return self.op <= Op.DWELL

    @property
    def moves(self) -> Bools:
        """Rows that are a motion, (n,)."""
        return self.op < Op.DWELL

    @property
    def is_arc(self) -> Bools:
        """Rows that are an arc, (n,)."""
        return np.asarray((self.op == Op.ARC_CENTRE) | (self.op == Op.ARC_RADIUS))

    @property
    def sets_power(self) -> Bools:
        """Rows that set power or follow, (n,)."""
        return np.asarray((self.op == Op.POWER) | (self.op == Op.FOLLOW))

    def starts(self) -> tuple[Floats, Floats]:
        """Position before each row, unrounded: x and y, (n,) pulse."""
        return np.concatenate([[0.0], self.x])[:-1], np.concatenate([[0.0], self.y])[:-1]

    def ends(self, rows: Indices) -> Ends:
        """Position before and after some rows, unrounded: x0, y0, x1, y1, (k,) pulse each; not to be changed."""
        if len(rows) and follow_each_other(rows) and rows[0] > 0:
            before, after = slice(int(rows[0]) - 1, int(rows[-1])), slice(int(rows[0]), int(rows[-1]) + 1)
            return self.x[before], self.y[before], self.x[after], self.y[after]
        starts = np.maximum(rows - 1, 0)
        x0, y0 = np.where(rows > 0, self.x[starts], 0.0), np.where(rows > 0, self.y[starts], 0.0)
        return x0, y0, self.x[rows], self.y[rows]


OF_DWELLS_AND_POWERS = ("dwell_ms", "power", "low", "high", "ratio")
"""Columns that rows of other kinds do not use."""
SPEED_WORDS = ("VEL", "ACC", "JUMPVEL", "JUMPACC")


class Speeds(Struct, frozen=True, kw_only=True, eq=False):
    """Every velocity and acceleration that was written, used or not, (k,) each.

    `word`: index in SPEED_WORDS. `value`: pulse/ms or pulse/ms2 with X's pulses per mm. `in_mm`: it was written in mm.
    `inline`: a word of LINE or ARC, not a statement. `row`: row of the path from which on it holds, ascending for each
    word. `provenance`: as in Path.
    """

    line: npt.NDArray[np.int32]
    word: npt.NDArray[np.int8]
    value: Floats
    in_mm: Bools
    inline: Bools
    provenance: npt.NDArray[np.int32]
    row: Indices


def with_chords(path: Path, rows: Indices, counts: Indices, x: Floats, y: Floats) -> tuple[Path, Indices]:
    """Replace rows of a path by lines.

    Args:
        path: The path, n rows.
        rows: Rows to replace, (k,) ascending.
        counts: Number of lines for each, (k,).
        x, y: End points of all lines in order, (sum of counts,) pulse; the last line of each ends where its row did.

    Returns:
        The new path, and for each of its rows the row that it comes from.
    """
    repeats = np.ones(len(path), dtype=np.intp)
    repeats[rows] = counts
    origin = np.repeat(np.arange(len(path)), repeats)
    columns: dict[str, npt.NDArray[Any]] = {name: getattr(path, name)[origin] for name in Path.__struct_fields__}
    is_replaced = np.zeros(len(path), dtype=np.bool_)
    is_replaced[rows] = True
    new = np.flatnonzero(is_replaced[origin])
    last = np.zeros(len(new), dtype=np.bool_)
    last[np.cumsum(counts) - 1] = True
    columns["x"][new] = np.where(last, columns["x"][new], x)
    columns["y"][new] = np.where(last, columns["y"][new], y)
    columns["end"][new] = np.where(last, columns["end"][new], np.nan)
    columns["op"][new] = Op.LINE
    return Path(**columns), origin
