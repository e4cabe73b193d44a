"""Rows of calls, and the Stream that they make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.calls import ArgumentConversion, Buffered, BufferedCalls, Call, Signature, Stream, Value
from gusjob.frontend.scan.rows import Row, Rows
from gusjob.kinematics.arrays import unrepeated, with_constant

COLUMNS = ("crd", "fifo", "channel", "x", "y", "p", "q", "r", "vel", "acc", "vel_end")
SHORT_COLUMNS = COLUMNS[:3]
"""Columns of arguments that are shorts."""
LEADING_COLUMN, UNUSED_COLUMN, NAME_COLUMN, REALS_COLUMN = range(len(COLUMNS), len(COLUMNS) + 4)
"""Columns of the leading argument (a card or a core), of numbers that are not used (times, readings), of the number
of a call that is passed over, and of the columns that are written as floating numbers (bits)."""
CALL_OP, PASSED_OVER_OP = 100, 101
"""Row ops of a call that is not buffered (column 0 is its index), and of one that is passed over."""


class ImmediateCall(Struct, frozen=True, kw_only=True):
    """A call that is not buffered, before it has its place in a Stream."""

    name: str
    args: tuple[Value, ...]
    time_ms: float = float("nan")


def buffered_row(kind: Buffered, signature: Signature, values: list[Value], reals: float = 0.0) -> Row:
    """Make the row of a buffered call. `reals`: the columns that are written as floating numbers."""
    columns = [COLUMNS.index(arg.column) for arg in signature.args]
    numbers = [value if isinstance(value, float) else float("nan") for value in values]
    made = dict(zip(columns, numbers, strict=True))
    return Row(op=kind, values=made | ({REALS_COLUMN: reals} if reals else {}))


def call_row(index: int) -> Row:
    """Make the row of a call that is not buffered."""
    return Row(op=CALL_OP, values={0: float(index)})


def stream_of(
    name: str, parts: Sequence[Rows], calls: list[ImmediateCall], conversions: Sequence[ArgumentConversion] = ()
) -> Stream:
    """Make the stream of rows in order. `calls`: those that are not buffered."""
    buffered, others, count = [], [], 0
    for part in parts:
        is_call = part.op == CALL_OP
        for k, i in enumerate(np.flatnonzero(is_call).tolist()):
            made = calls[int(part.column(0)[i])]
            at, line = count + i - k, int(part.line[i])
            others.append(Call(name=made.name, args=made.args, at=at, line=line, time_ms=made.time_ms))
        buffered.append(part.pick(~is_call) if is_call.any() else part)
        count += len(buffered[-1].op)
    return Stream(name=name, buffered=_buffered(buffered), calls=tuple(others), conversions=tuple(conversions))


def _buffered(parts: list[Rows]) -> BufferedCalls:
    """Make the buffered calls of rows."""
    return BufferedCalls(
        kind=np.concatenate([np.empty(0, dtype=np.uint8), *(part.op for part in parts)]),
        line=np.concatenate([np.empty(0, dtype=np.int32), *(part.line for part in parts)]),
        **{name: _argument(parts, name, np.int16 if name in SHORT_COLUMNS else np.float64) for name in COLUMNS},
    )


def _argument(parts: list[Rows], name: str, dtype: type) -> npt.NDArray[Any]:
    """Make the column of an argument: 0 in the calls that do not have it."""
    number, first = COLUMNS.index(name), 0
    column: npt.NDArray[Any] = np.zeros(sum(len(part.op) for part in parts), dtype=dtype)
    for part in parts:
        given = np.nan_to_num(unrepeated(part.column(number)))
        if given.any():  # What is 0 everywhere takes no memory.
            column[first : first + len(part.op)] = given
        first += len(part.op)
    return with_constant(column)
