"""Velocities and accelerations: those in force at each row, and every one that was written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp
from gusjob.frontend.resolve.columns import ResolvedColumns, last_set
from gusjob.ir.path import Speeds
from gusjob.kinematics.arrays import Bools, Floats, Indices


@dataclass(frozen=True, slots=True)
class ModalSpeed:
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
    op = columns.op
    value, in_mm = columns.rate(Column.VALUE, acceleration=acceleration)
    is_set = op == statement
    if word is not None and columns.has(word):
        own, own_in_mm = columns.rate(word, acceleration=acceleration)
        by_word = ~np.isnan(own) & columns.moves
        value, in_mm = np.where(by_word, own, value), np.where(by_word, own_in_mm, in_mm)
        is_set = is_set | by_word
    if not is_set.any():
        n = len(op)
        return ModalSpeed(np.broadcast_to(np.nan, n), np.broadcast_to(np.False_, n), np.broadcast_to(np.int32(0), n))
    at = last_set(is_set)
    return ModalSpeed(np.where(at >= 0, value[at], np.nan), in_mm[at], columns.rows.line[at])


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
        value, in_mm = columns.rate(Column.VALUE, acceleration=bool(number % 2))
        parts.append((at, number, value[at], in_mm[at], False))
    for number, word in enumerate((Column.VEL, Column.ACC)):
        if columns.has(word):
            value, in_mm = columns.rate(word, acceleration=bool(number))
            at = np.flatnonzero(~np.isnan(value) & columns.moves)
            parts.append((at, number, value[at], in_mm[at], True))
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
