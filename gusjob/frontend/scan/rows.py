"""Rows of a text as columns, and the templates by which they are read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field

from gusjob.frontend.scan.numerals import NumberForm
from gusjob.kinematics.arrays import Floats, Indices, joined, picked
from gusjob.patterns import lazy_pattern

_NUMERAL = lazy_pattern(r"[0-9.]+")
_NUMBER = lazy_pattern(r"([+-]?)\s*([0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE]([+-]?)([0-9]+))?")
_HEXADECIMAL = lazy_pattern(r"x[0-9a-f]", re.IGNORECASE | re.ASCII)
_MAX_FIXED_DIGITS = 15
"""Digits of a word that are compared as a number."""


class NumberSlot(Struct, frozen=True, kw_only=True):
    """The number at numeral `numeral` of a line goes to `column` as value * times / over."""

    column: int
    numeral: int
    form: NumberForm
    times: float = 1.0
    over: float = 1.0


class Template(Struct, frozen=True, kw_only=True):
    """The row that every line of a shape becomes.

    Attributes:
        constants: Columns that have the same value in every row.
        fixed: Numerals that are part of a word (mm/s2): the index of each, and its digits.
        pointed: Numerals that begin with a point: a point alone is no number.
        not_zero: Whole numbers that touch an X and a digit: 0x10 is no decimal number.
    """

    op: int
    system: int = 0
    slots: tuple[NumberSlot, ...] = ()
    constants: tuple[tuple[int, float], ...] = ()
    fixed: tuple[tuple[int, str], ...] = ()
    pointed: tuple[int, ...] = ()
    not_zero: tuple[int, ...] = ()


class TemplateBuilder(Struct, dict=True):
    """Matches the numbers that the parser found in a line with the line's numerals."""

    line: str
    slots: list[NumberSlot] = field(default_factory=list)
    pointed: list[int] = field(default_factory=list)

    @cached_property
    def unused(self) -> dict[int, tuple[int, str]]:
        """Numerals that are not part of a number, by their start: the index of each, and its text."""
        return {match.start(): (i, match[0]) for i, match in enumerate(_NUMERAL.finditer(self.line))}

    @classmethod
    def of_line(cls, line: str) -> TemplateBuilder | None:
        """The builder for a line; None if it has other characters than ASCII."""
        return cls(line=line) if line.isascii() else None

    def add(self, column: int, start: int, end: int | None = None, *, times: float = 1.0, over: float = 1.0) -> bool:
        """Send the number at `start`, with its sign, to a column; False if it is not a decimal number (up to `end`)."""
        match = _NUMBER.match(self.line, start)
        if match is None or (end is not None and match.end() != end):
            return False
        groups = [group for group in (2, 4) if match[group] is not None]
        numerals = [self.unused.pop(match.start(group), (0, "")) for group in groups]
        if any(text != match[group] for group, (_, text) in zip(groups, numerals, strict=True)):
            return False
        numeral, text = numerals[0]
        exponent = 0 if match[4] is None else (-1 if match[3] == "-" else 1)
        form = NumberForm(has_point="." in text, exponent=exponent, is_negative=match[1] == "-")
        self.slots.append(NumberSlot(column=column, numeral=numeral, form=form, times=times, over=over))
        self.pointed += [numeral] if text.startswith(".") else []
        return True

    def begins_hexadecimal(self, numeral: re.Match[str]) -> bool:
        """Whether a whole number touches X and a digit, so that 0 in its place would begin a hexadecimal number."""
        return "." not in numeral[0] and _HEXADECIMAL.match(self.line, numeral.end()) is not None

    def build(self, op: int, *, system: int = 0, constants: tuple[tuple[int, float], ...] = ()) -> Template | None:
        """The template. Numerals without a number must be the same in every line; None if one can't be compared."""
        fixed = tuple(self.unused.values())
        if any("." in text or len(text) > _MAX_FIXED_DIGITS for _, text in fixed):
            return None
        return Template(
            op=op,
            system=system,
            slots=tuple(self.slots),
            constants=constants,
            fixed=fixed,
            pointed=tuple(self.pointed),
            not_zero=tuple(i for i, match in enumerate(_NUMERAL.finditer(self.line)) if self.begins_hexadecimal(match)),
        )


class Row(Struct, frozen=True, kw_only=True):
    """One row that the parser itself has read."""

    op: int
    system: int = 0
    values: dict[int, float] = field(default_factory=dict)


class FewValues(Struct, frozen=True, kw_only=True, eq=False):
    """A column that few rows have: these rows, ascending, and their values, (k,)."""

    rows: Indices
    values: Floats


_FEW = 8
"""A column that at most one of so many rows has is kept as FewValues."""


class Rows(Struct, frozen=True, kw_only=True, eq=False):
    """Rows in file order.

    Attributes:
        op: What each row is, (n,).
        line: Source line from 1, (n,).
        system: Two bits for each column: the unit system its number was written in, (n,).
        columns: Numbers by column, each (n,), NaN where absent. A column that no row uses is absent. One with one value
            for all rows may be a broadcast array (stride 0), which takes no memory.
        few: Further columns, which few rows have, by column.
    """

    op: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    system: npt.NDArray[np.int32]
    columns: dict[int, Floats]
    few: dict[int, FewValues] = field(default_factory=dict)

    def column(self, number: int) -> Floats:
        """A column; all NaN (and without memory) if no row has it."""
        if number in self.few:
            found = np.full(len(self.op), np.nan)
            found[self.few[number].rows] = self.few[number].values
            return found
        return self.columns.get(number, np.broadcast_to(np.float64(np.nan), len(self.op)))

    def at(self, number: int, rows: Indices) -> Floats:
        """The values of a column at some rows, (k,): of a column that few rows have, nothing else is made."""
        if number not in self.few:
            return self.column(number)[rows]
        few = self.few[number]
        place = np.minimum(np.searchsorted(few.rows, rows), len(few.rows) - 1)
        return np.where(few.rows[place] == rows, few.values[place], np.nan)

    def has(self, number: int) -> bool:
        """Whether some row has a column."""
        return number in self.columns or number in self.few

    def thinned(self) -> Rows:
        """The same rows with columns that few rows have as FewValues, which take less memory."""
        columns, few = dict[int, Floats](), dict[int, FewValues]()
        for number, column in self.columns.items():
            is_given = ~np.isnan(column)
            if np.count_nonzero(is_given) * _FEW <= len(column):
                rows = np.flatnonzero(is_given)
                few[number] = FewValues(rows=rows, values=column[rows])
            else:
                columns[number] = column
        system = self.system if self.system.any() else np.broadcast_to(np.int32(0), len(self.op))
        return Rows(op=self.op, line=self.line, system=system, columns=columns, few=few)

    def unshared(self) -> Rows:
        """The same rows without columns that are part of a larger array, which would stay in memory with them."""
        columns = {k: v if v.base is None or v.strides == (0,) else v.copy() for k, v in self.columns.items()}
        return Rows(op=self.op, line=self.line, system=self.system, columns=columns)

    def pick(self, where: npt.NDArray[Any] | slice) -> Rows:
        """The rows at a mask, at indices or in a slice."""
        if not isinstance(where, slice) and where.dtype == np.bool_:
            where = np.flatnonzero(where)
        columns = {k: picked(v, where) for k, v in self.columns.items()}
        return Rows(op=self.op[where], line=self.line[where], system=picked(self.system, where), columns=columns)


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
        system=joined([p.system for p in parts]) if parts else np.empty(0, dtype=np.int32),
        columns={c: joined([p.column(c) for p in parts]) for c in used},
    )


def groups_of(values: npt.NDArray[Any]) -> Iterator[tuple[Any, Indices]]:
    """Each value that occurs, ascending, with the indices at which it occurs, ascending."""
    order = np.argsort(values, kind="stable")
    present, begins = np.unique(values[order], return_index=True)
    return zip(present.tolist(), np.split(order, begins[1:]), strict=False)  # No value still splits into one part.
