"""Rows of a text as columns, and the templates by which they are read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.frontend.scan.shapes import begins_hexadecimal, number_runs
from gusjob.kinematics.arrays import Floats, Indices


@dataclass(frozen=True, slots=True, kw_only=True)
class NumberSlot:
    """Number run `run` of a line goes to `column` as value * times / over."""

    column: int
    run: int
    times: float = 1.0
    over: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """The row that every line of a shape becomes.

    Attributes:
        constants: Columns that have the same value in every row.
        fixed: Runs that are part of a word (mm/s2), each with its value.
        not_zero: Runs that touch an X: 0x10 is no decimal number.
    """

    op: int
    system: int = 0
    slots: tuple[NumberSlot, ...] = ()
    constants: tuple[tuple[int, float], ...] = ()
    fixed: tuple[tuple[int, float], ...] = ()
    not_zero: tuple[int, ...] = ()


@dataclass(slots=True)
class TemplateBuilder:
    """Matches the numbers that the parser found in a line with the line's runs of digits."""

    line: str
    runs: list[tuple[int, int]]
    unused: dict[int, int] = field(init=False)
    """Runs that no number has been matched with, by their start."""
    slots: list[NumberSlot] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.unused = {start: i for i, (start, _) in enumerate(self.runs)}

    @classmethod
    def of_line(cls, line: str) -> TemplateBuilder | None:
        """The builder for a line; None if not all of its numbers are plain decimal numbers."""
        runs = number_runs(line.encode()) if line.isascii() else None
        return None if runs is None else cls(line=line, runs=runs)

    def add(self, column: int, start: int, end: int | None = None, *, times: float = 1.0, over: float = 1.0) -> bool:
        """Send the number at `start` to a column; False if it is not a run of its own (that ends at `end`)."""
        run = self.unused.pop(start, None)
        if run is None or (end is not None and self.runs[run][1] != end):
            return False
        self.slots.append(NumberSlot(column=column, run=run, times=times, over=over))
        return True

    def build(self, op: int, *, system: int = 0, constants: tuple[tuple[int, float], ...] = ()) -> Template:
        """The template. Runs that no number was matched with must be the same in every line."""
        fixed = tuple((i, float(self.line[start : self.runs[i][1]])) for start, i in self.unused.items())
        not_zero = tuple(i for i, (start, end) in enumerate(self.runs) if begins_hexadecimal(self.line, start, end))
        return Template(
            op=op, system=system, slots=tuple(self.slots), constants=constants, fixed=fixed, not_zero=not_zero
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One row that the parser itself has read."""

    op: int
    system: int = 0
    values: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Rows in file order.

    Attributes:
        op: What each row is, (n,).
        line: Source line from 1, (n,).
        system: Two bits for each column: the unit system its number was written in, (n,).
        columns: Numbers by column, each (n,), NaN where absent. A column that no row uses is absent.
    """

    op: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    system: npt.NDArray[np.int32]
    columns: dict[int, Floats]

    def column(self, number: int) -> Floats:
        """A column; all NaN (and without memory) if no row has it."""
        found = self.columns.get(number)
        return np.broadcast_to(np.float64(np.nan), len(self.op)) if found is None else found

    def pick(self, where: npt.NDArray[Any] | slice) -> Rows:
        """The rows at a mask, at indices or in a slice."""
        columns = {k: v[where] for k, v in self.columns.items()}
        return Rows(op=self.op[where], line=self.line[where], system=self.system[where], columns=columns)


def rows_of(numbered: list[tuple[int, Row]]) -> Rows:
    """Rows with their line numbers, as columns."""
    used = sorted({column for _, row in numbered for column in row.values})
    return Rows(
        op=np.array([row.op for _, row in numbered], dtype=np.uint8),
        line=np.array([line for line, _ in numbered], dtype=np.int32),
        system=np.array([row.system for _, row in numbered], dtype=np.int32),
        columns={c: np.array([row.values.get(c, np.nan) for _, row in numbered]) for c in used},
    )


def join_rows(parts: list[Rows]) -> Rows:
    """Concatenate rows."""
    if len(parts) == 1:
        return parts[0]
    used = sorted({column for part in parts for column in part.columns})
    return Rows(
        op=np.concatenate([p.op for p in parts]) if parts else np.empty(0, dtype=np.uint8),
        line=np.concatenate([p.line for p in parts]) if parts else np.empty(0, dtype=np.int32),
        system=np.concatenate([p.system for p in parts]) if parts else np.empty(0, dtype=np.int32),
        columns={c: np.concatenate([p.column(c) for p in parts]) for c in used},
    )


def groups_of(values: npt.NDArray[Any]) -> Iterator[tuple[Any, Indices]]:
    """Each value that occurs, ascending, with the indices at which it occurs, ascending."""
    order = np.argsort(values, kind="stable")
    present, begins = np.unique(values[order], return_index=True)
    return zip(present.tolist(), np.split(order, begins[1:]), strict=False)  # No value still splits into one part.
