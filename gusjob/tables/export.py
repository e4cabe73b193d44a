"""Export of tables as CSV, npz and Parquet.

A table comes in chunks of rows that follow each other, so that the export needs little memory.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import orjson

from gusjob.tables.columns import CategoryColumn, Column, Columns


def csv_bytes(table: Iterable[Columns]) -> Iterator[bytes]:
    """Write CSV: a header row, then one row an entry; NaN is left empty. Categories hold neither comma nor quote."""
    for number, columns in enumerate(table):
        if not number:
            yield (",".join(columns) + "\r\n").encode()
        rows = b"\r\n".join(map(b",".join, zip(*map(_texts, columns.values()), strict=True)))
        if rows:
            yield rows + b"\r\n"


def _texts(column: Column) -> list[bytes]:
    if not len(column):
        return []
    if isinstance(column, CategoryColumn):
        categories = [category.encode() for category in column.categories]
        return [categories[code] for code in column.codes.tolist()]
    text = orjson.dumps(np.ascontiguousarray(column), option=orjson.OPT_SERIALIZE_NUMPY)
    return text[1:-1].replace(b"null", b"").split(b",")


def npz_bytes(table: Iterable[Columns]) -> Iterator[bytes]:
    """Write npz: one array a column (categories as text), compressed. All of them are held in memory."""
    whole: dict[str, list[npt.NDArray[Any]]] = {}
    for columns in table:
        for name, column in columns.items():
            values = column.texts if isinstance(column, CategoryColumn) else column
            whole.setdefault(name, []).append(values)
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, **{name: np.concatenate(parts) for name, parts in whole.items()})
    yield out.getvalue()


def parquet_bytes(table: Iterable[Columns], about: dict[str, bytes]) -> Iterator[bytes]:
    """Write Parquet: NaN is null, categories are dictionary columns. `about`: key-value metadata of the file."""
    import pyarrow
    from pyarrow import parquet

    sink, writer = _Sink(), None
    for columns in table:
        part = pyarrow.table({name: _arrow(column) for name, column in columns.items()}, metadata=about)
        if writer is None:
            named = [name for name, column in columns.items() if isinstance(column, CategoryColumn)]
            writer = parquet.ParquetWriter(sink, part.schema, compression="zstd", use_dictionary=named)
        writer.write_table(part)
        yield sink.drained()
    if writer is not None:
        writer.close()
    yield sink.drained()


def _arrow(column: Column) -> Any:
    import pyarrow

    if isinstance(column, CategoryColumn):
        return pyarrow.DictionaryArray.from_arrays(column.codes.astype(np.int32), list(column.categories))
    return pyarrow.array(column, from_pandas=True)


class _Sink(io.RawIOBase):
    """A file that keeps what is written until it is drained."""

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._written = 0

    def writable(self) -> bool:
        return True

    def tell(self) -> int:
        return self._written

    def write(self, data: Any) -> int:
        """Write bytes, or anything that holds bytes."""
        self._parts.append(bytes(data))
        self._written += len(self._parts[-1])
        return len(self._parts[-1])

    def drained(self) -> bytes:
        """Return what was written since the last call."""
        parts, self._parts = self._parts, []
        return b"".join(parts)
