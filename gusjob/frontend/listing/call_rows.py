"""Rows of calls, and the Stream that they make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import Struct

from gusjob.controllers.gus.calls import ArgumentConversion, Buffered, BufferedCalls, Call, Signature, Stream, Value
from gusjob.frontend.scan.rows import Row, Rows

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
    name: str, rows: Rows, calls: list[ImmediateCall], conversions: Sequence[ArgumentConversion] = ()
) -> Stream:
    """Make the stream of some rows. `calls`: those that are not buffered."""
    is_call = rows.op == CALL_OP
    keep = ~is_call
    before = np.cumsum(keep)
    index = rows.column(0)
    count = int(before[-1]) if len(before) else 0

    def cut(name: str, dtype: type) -> Any:
        column = rows.columns.get(COLUMNS.index(name))
        if column is None:
            return np.zeros(count, dtype=dtype)
        return np.nan_to_num(column[keep], copy=False).astype(dtype, copy=False)

    buffered = BufferedCalls(
        kind=rows.op[keep],
        line=rows.line[keep],
        **{column: cut(column, np.int16) for column in SHORT_COLUMNS},
        **{column: cut(column, np.float64) for column in COLUMNS[len(SHORT_COLUMNS) :]},
    )
    others = []
    for i in np.flatnonzero(is_call).tolist():
        made = calls[int(index[i])]
        others.append(
            Call(name=made.name, args=made.args, at=int(before[i]), line=int(rows.line[i]), time_ms=made.time_ms)
        )
    return Stream(name=name, buffered=buffered, calls=tuple(others), conversions=tuple(conversions))
