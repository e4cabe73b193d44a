"""Export of tables as CSV and Parquet; npz.py writes npz.

A table comes in chunks of rows that follow each other, so that the export needs little memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import orjson

from gusjob.tables.columns import CategoryColumn, Column, Columns
from gusjob.tables.sink import Sink


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


def parquet_bytes(table: Iterable[Columns], about: dict[str, bytes]) -> Iterator[bytes]:
    """Write Parquet: NaN is null, categories are dictionary columns. `about`: key-value metadata of the file."""
    import pyarrow
    from pyarrow import parquet

    sink, writer = Sink(), None
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
