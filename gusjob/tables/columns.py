"""Columns of tables. A table is a dictionary of equally long columns by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct


class CategoryColumn(Struct, frozen=True, kw_only=True, eq=False):
    """A column of categories: the index among `categories` of each entry, (n,)."""

    codes: npt.NDArray[np.integer[Any]]
    categories: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def __getitem__(self, rows: slice) -> CategoryColumn:
        return CategoryColumn(codes=self.codes[rows], categories=self.categories)

    @property
    def texts(self) -> npt.NDArray[np.str_]:
        """The entries as text, (n,)."""
        return np.asarray(np.array(self.categories)[self.codes])


class ComputedColumns(Mapping[str, npt.NDArray[Any]]):
    """A table whose columns are computed when they are first read: the others take no memory."""

    def __init__(self, computed: Mapping[str, Callable[[], npt.NDArray[Any]]]) -> None:
        """Make a table of columns by name, each as the function that computes it."""
        self._computed = dict(computed)
        self._columns: dict[str, npt.NDArray[Any]] = {}

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        if name not in self._columns:
            self._columns[name] = self._computed[name]()
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._computed)

    def __len__(self) -> int:
        return len(self._computed)


Column = npt.NDArray[Any] | CategoryColumn
Columns = dict[str, Column]

_CHUNK_ROWS = 1 << 15


def chunks(columns: Columns, rows: int = _CHUNK_ROWS) -> Iterator[Columns]:
    """Split a table into chunks of rows, so that an export needs little memory; one without rows is one chunk."""
    count = len(next(iter(columns.values()), ()))
    for first in range(0, max(count, 1), rows):
        yield {name: column[first : first + rows] for name, column in columns.items()}
