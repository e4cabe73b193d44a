"""Velocities and accelerations: those in force at each row, and every one that was written."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp
from gusjob.frontend.resolve.columns import ResolvedColumns
from gusjob.ir.path import Speeds
from gusjob.kinematics.arrays import Bools, Floats, Indices, carried


class ModalSpeed(Struct, frozen=True, eq=False):
    """A velocity or acceleration in force at each row, (n,) each.

    Attributes:
        value: pulse/ms or pulse/ms2 with X's pulses per mm; NaN where it is not set yet.
        in_mm: Whether it was written in mm.
        line: The line that set it.
    """

    value: Floats
    in_mm: Bools
    line: npt.NDArray[np.int32]

    def replaced(self, where: Bools, other: ModalSpeed) -> ModalSpeed:
        """This one, but `other` where it is set and `where` holds."""
        use = where & ~np.isnan(other.value)
        if not use.any():
            return self
        return ModalSpeed(
            np.where(use, other.value, self.value),
            np.where(use, other.in_mm, self.in_mm),
            np.where(use, other.line, self.line),
        )


def velocity_and_acceleration(columns: ResolvedColumns) -> tuple[ModalSpeed, ModalSpeed]:
    """Velocity and acceleration in force at each row: VEL and ACC, for jumps JUMPVEL and JUMPACC if they are set."""
    velocity = _modal_speed(columns, RowOp.VEL, Column.VEL, acceleration=False)
    acceleration = _modal_speed(columns, RowOp.ACC, Column.ACC, acceleration=True)
    jump = columns.op == RowOp.JUMP
    if jump.any():
        velocity = velocity.replaced(jump, _modal_speed(columns, RowOp.JUMPVEL, None, acceleration=False))
        acceleration = acceleration.replaced(jump, _modal_speed(columns, RowOp.JUMPACC, None, acceleration=True))
    return velocity, acceleration


def _modal_speed(columns: ResolvedColumns, statement: RowOp, word: Column | None, *, acceleration: bool) -> ModalSpeed:
    """A velocity or acceleration that is set by its statement or by a word of LINE and ARC."""
    op, count = columns.op, len(columns.op)
    at = np.flatnonzero(op == statement)
    value, in_mm = columns.rate_at(Column.VALUE, at, acceleration=acceleration)
    if word is not None and columns.has(word):
        own = np.flatnonzero(~np.isnan(columns.raw(word)) & columns.moves)
        own_value, own_in_mm = columns.rate_at(word, own, acceleration=acceleration)
        order = np.argsort(np.concatenate([at, own]), kind="stable")
        at, value = np.concatenate([at, own])[order], np.concatenate([value, own_value])[order]
        in_mm = np.concatenate([in_mm, own_in_mm])[order]
    line = columns.rows.line[at]
    if len(at) == 1 and not columns.in_path[: at[0]].any():
        # It holds in the whole path; the rows before it are not in the path.
        return ModalSpeed(*(np.broadcast_to(column[0], count) for column in (value, in_mm, line)))
    if not len(at):
        nothing = np.broadcast_to(np.nan, count), np.broadcast_to(np.False_, count), np.broadcast_to(np.int32(0), count)
        return ModalSpeed(*nothing)
    return ModalSpeed(carried(value, at, count, np.nan), carried(in_mm, at, count, 0), carried(line, at, count, 0))


def written_speeds(columns: ResolvedColumns, path_row: Callable[[Indices], Indices]) -> Speeds:
    """Every velocity and acceleration that was written.

    Args:
        columns: The rows.
        path_row: For rows, how many rows of the path there are up to each.
    """
    op, rows = columns.op, columns.rows
    parts: list[tuple[Any, ...]] = []
    for number, statement in enumerate((RowOp.VEL, RowOp.ACC, RowOp.JUMPVEL, RowOp.JUMPACC)):
        at = np.flatnonzero(op == statement)
        value, in_mm = columns.rate_at(Column.VALUE, at, acceleration=bool(number % 2))
        parts.append((at, number, value, in_mm, False))
    for number, word in enumerate((Column.VEL, Column.ACC)):
        if columns.has(word):
            at = np.flatnonzero(~np.isnan(columns.raw(word)) & columns.moves)
            value, in_mm = columns.rate_at(word, at, acceleration=bool(number))
            parts.append((at, number, value, in_mm, True))
    provenance = columns.provenance()
    return Speeds(
        line=np.concatenate([rows.line[at] for at, *_ in parts]),
        word=np.concatenate([np.full(len(at), number, dtype=np.int8) for at, number, *_ in parts]),
        value=np.concatenate([value for _, _, value, _, _ in parts]),
        in_mm=np.concatenate([in_mm for _, _, _, in_mm, _ in parts]),
        inline=np.concatenate([np.full(len(at), inline) for at, _, _, _, inline in parts]),
        provenance=np.concatenate([provenance[at] for at, *_ in parts]),
        row=np.concatenate([path_row(at) - inline for at, _, _, _, inline in parts]),
    )
