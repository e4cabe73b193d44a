"""Tables as equally long columns, in pieces, to CSV, Parquet and npz.

Pieces of a table follow one behind the other, so that what is written stays small in memory.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import orjson


@dataclass(frozen=True, slots=True, kw_only=True)
class Words:
    """A column of words: for each entry, (n,), its place among `words`."""

    codes: npt.NDArray[np.integer[Any]]
    words: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.codes)

    def __getitem__(self, part: slice) -> Words:
        return Words(codes=self.codes[part], words=self.words)


Column = npt.NDArray[Any] | Words
Columns = dict[str, Column]

_PIECE_ROWS = 1 << 15


def pieces(columns: Columns, rows: int = _PIECE_ROWS) -> Iterator[Columns]:
    """A table in pieces; one without rows is one piece."""
    count = len(next(iter(columns.values()), ()))
    for first in range(0, max(count, 1), rows):
        yield {name: column[first : first + rows] for name, column in columns.items()}


def csv_bytes(table: Iterable[Columns]) -> Iterator[bytes]:
    """A header row and one row an entry; NaN is left empty. Words hold neither comma nor quote."""
    for number, columns in enumerate(table):
        if not number:
            yield (",".join(columns) + "\r\n").encode()
        rows = b"\r\n".join(map(b",".join, zip(*map(_texts, columns.values()), strict=True)))
        if rows:
            yield rows + b"\r\n"


def _texts(column: Column) -> list[bytes]:
    if not len(column):
        return []
    if isinstance(column, Words):
        words = [word.encode() for word in column.words]
        return [words[code] for code in column.codes.tolist()]
    text = orjson.dumps(np.ascontiguousarray(column), option=orjson.OPT_SERIALIZE_NUMPY)
    return text[1:-1].replace(b"null", b"").split(b",")


def npz_bytes(table: Iterable[Columns]) -> Iterator[bytes]:
    """One array a column (words as text), compressed. All of them are held in memory."""
    whole: dict[str, list[npt.NDArray[Any]]] = {}
    for columns in table:
        for name, column in columns.items():
            values = np.array(column.words)[column.codes] if isinstance(column, Words) else column
            whole.setdefault(name, []).append(values)
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, **{name: np.concatenate(parts) for name, parts in whole.items()})
    yield out.getvalue()


def parquet_bytes(table: Iterable[Columns], about: dict[str, bytes]) -> Iterator[bytes]:
    """A Parquet file; NaN is null, words are dictionary columns. `about`: key-value metadata of the file."""
    import pyarrow
    from pyarrow import parquet

    sink, writer = _Sink(), None
    for columns in table:
        part = pyarrow.table({name: _arrow(column) for name, column in columns.items()}, metadata=about)
        if writer is None:
            named = [name for name, column in columns.items() if isinstance(column, Words)]
            writer = parquet.ParquetWriter(sink, part.schema, compression="zstd", use_dictionary=named)
        writer.write_table(part)
        yield sink.drained()
    if writer is not None:
        writer.close()
    yield sink.drained()


def _arrow(column: Column) -> Any:
    import pyarrow

    if isinstance(column, Words):
        return pyarrow.DictionaryArray.from_arrays(column.codes.astype(np.int32), list(column.words))
    return pyarrow.array(column, from_pandas=True)


class _Sink(io.RawIOBase):
    """Holds what was written until it is taken away."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._written = 0

    def writable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._written

    def write(self, data: Any) -> int:
        """Bytes, or anything that holds bytes."""
        self._parts.append(bytes(data))
        self._written += len(self._parts[-1])
        return len(self._parts[-1])

    def drained(self) -> bytes:
        """What was written since the last time."""
        parts, self._parts = self._parts, []
        return b"".join(parts)
