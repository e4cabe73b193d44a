"""Columns of tables. A table is a dictionary of equally long columns by name."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, slots=True, kw_only=True)
class CategoryColumn:
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


Column = npt.NDArray[Any] | CategoryColumn
Columns = dict[str, Column]

_CHUNK_ROWS = 1 << 15


def chunks(columns: Columns, rows: int = _CHUNK_ROWS) -> Iterator[Columns]:
    """Split a table into chunks of rows, so that an export needs little memory; one without rows is one chunk."""
    count = len(next(iter(columns.values()), ()))
    for first in range(0, max(count, 1), rows):
        yield {name: column[first : first + rows] for name, column in columns.items()}
