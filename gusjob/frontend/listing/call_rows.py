"""Rows of calls, and the Stream that they make."""

from __future__ import annotations

from typing import Any

import numpy as np

from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Signature, Stream, Value
from gusjob.frontend.scan.rows import Row, Rows
from gusjob.kinematics.arrays import Bools

COLUMNS = ("crd", "fifo", "channel", "x", "y", "p", "q", "r", "vel", "acc", "vel_end")
SHORT_COLUMNS = COLUMNS[:3]
"""Columns of arguments that are shorts."""
_MAX_SHORT_ARGUMENT = 100
"""No coordinate system, FIFO or channel is above; larger numbers do not fit the columns of a Stream."""
CALL_OP = 100
"""Row op of a call that is not buffered; column 0 is its index."""


def buffered_row(kind: Buffered, signature: Signature, values: list[Value | None]) -> Row:
    """The row of a buffered call."""
    columns = (COLUMNS.index(arg.column) for arg in signature.args)
    numbers = (value if isinstance(value, float) else float("nan") for value in values)
    return Row(op=kind, values=dict(zip(columns, numbers, strict=True)))


def call_row(index: int) -> Row:
    """The row of a call that is not buffered."""
    return Row(op=CALL_OP, values={0: float(index)})


def not_short(rows: Rows, name: str) -> Bools:
    """Buffered calls whose coordinate system, FIFO or channel can't be a C short, (n,)."""
    values = rows.column(COLUMNS.index(name))
    odd = (np.abs(values) > _MAX_SHORT_ARGUMENT) | (values != np.floor(values))
    return np.asarray((rows.op != CALL_OP) & ~np.isnan(values) & odd)


def stream_of(name: str, rows: Rows, calls: list[tuple[str, tuple[Value, ...]]]) -> Stream:
    """The stream of some rows. `calls`: name and arguments of those that are not buffered."""
    is_call = rows.op == CALL_OP
    keep = ~is_call
    before = np.cumsum(keep)
    index = rows.column(0)

    def cut(column: str, dtype: type) -> Any:
        return np.nan_to_num(rows.column(COLUMNS.index(column))[keep]).astype(dtype)

    buffered = BufferedCalls(
        kind=rows.op[keep],
        line=rows.line[keep],
        **{column: cut(column, np.int8) for column in SHORT_COLUMNS},
        **{column: cut(column, np.float64) for column in COLUMNS[len(SHORT_COLUMNS) :]},
    )
    others = [
        Call(name=calls[int(index[i])][0], args=calls[int(index[i])][1], at=int(before[i]), line=int(rows.line[i]))
        for i in np.flatnonzero(is_call).tolist()
    ]
    return Stream(name=name, buffered=buffered, calls=tuple(others))
