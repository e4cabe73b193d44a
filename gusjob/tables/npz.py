"""Export of tables as npz: a zip file with one .npy array a column."""

from __future__ import annotations

import tempfile
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from gusjob.tables.columns import CategoryColumn, Columns, chunks
from gusjob.tables.sink import Sink


def npz_bytes(table: Iterable[Columns]) -> Iterator[bytes]:
    """Write npz: one array a column (categories as text), compressed.

    Arrays follow each other, and each begins with its number of rows: the columns wait in temporary files.
    """
    with ExitStack() as files:
        spools: dict[str, _Spool] = {}
        for columns in table:
            for part in chunks(columns):
                for name, column in part.items():
                    if name not in spools:
                        spools[name] = _Spool(files.enter_context(tempfile.TemporaryFile()))
                    spools[name].add(column.texts if isinstance(column, CategoryColumn) else column)
        sink = Sink()
        with zipfile.ZipFile(sink, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, spool in spools.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                    npy.write_array_header_1_0(member, spool.header())
                    for values in spool.parts():
                        member.write(values.tobytes())
                        yield sink.drained()
        yield sink.drained()


class _Spool:
    """A column in a temporary file: its parts as .npy arrays that follow each other."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._dtypes: set[np.dtype[Any]] = set()
        self._parts = self._rows = 0

    def add(self, part: npt.NDArray[Any]) -> None:
        """Append rows."""
        npy.write_array(self._file, part, allow_pickle=False)
        self._dtypes.add(part.dtype)
        self._parts += 1
        self._rows += len(part)

    def header(self) -> dict[str, Any]:
        """Describe the whole column as .npy does."""
        return {"descr": npy.dtype_to_descr(self._dtype), "fortran_order": False, "shape": (self._rows,)}

    def parts(self) -> Iterator[npt.NDArray[Any]]:
        """Read the rows back, all in the type of the whole column."""
        self._file.seek(0)
        for _ in range(self._parts):
            yield npy.read_array(self._file, allow_pickle=False).astype(self._dtype, copy=False)

    @property
    def _dtype(self) -> np.dtype[Any]:
        """The type of the column: of texts that of the widest one."""
        return np.result_type(*self._dtypes)
