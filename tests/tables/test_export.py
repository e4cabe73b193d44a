"""Tables as CSV, Parquet and npz: read back by readers that are not ours."""

from __future__ import annotations

import csv
import io
import json
import sys
import tracemalloc
import zipfile
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import polars
import pytest
from support.cli import gusjob, write
from support.tools import MARK, ROOT

from gusjob.tables.columns import CategoryColumn, Columns, chunks
from gusjob.tables.export import csv_bytes, parquet_bytes
from gusjob.tables.npz import npz_bytes

TABLE: Columns = {
    "line": np.array([3, 4, 7], dtype=np.int32),
    "kind": CategoryColumn(codes=np.array([1, 0, 1], dtype=np.int8), categories=("mark", "jump")),
    "power": np.array([np.nan, 0.1, 1e-7]),
}


@pytest.mark.parametrize("rows", [1, 2, 5])
def test_pieces_do_not_show(rows: int) -> None:
    text = b"".join(csv_bytes(chunks(TABLE, rows))).decode()
    assert list(csv.reader(io.StringIO(text))) == [
        ["line", "kind", "power"],
        ["3", "jump", ""],
        ["4", "mark", "0.1"],
        ["7", "jump", "1e-7"],
    ]
    frame = polars.read_parquet(io.BytesIO(b"".join(parquet_bytes(chunks(TABLE, rows), {}))))
    assert frame.to_dict(as_series=False) == {
        "line": [3, 4, 7],
        "kind": ["jump", "mark", "jump"],
        "power": [None, 0.1, 1e-7],
    }
    arrays = np.load(io.BytesIO(b"".join(npz_bytes(chunks(TABLE, rows)))))
    assert arrays["line"].tolist() == [3, 4, 7]
    assert arrays["kind"].tolist() == ["jump", "mark", "jump"]
    assert np.isnan(arrays["power"][0])


def test_no_rows() -> None:
    empty: Columns = {name: column[:0] for name, column in TABLE.items()}
    assert b"".join(csv_bytes(chunks(empty))) == b"line,kind,power\r\n"
    assert polars.read_parquet(io.BytesIO(b"".join(parquet_bytes(chunks(empty), {})))).shape == (0, 3)
    assert np.load(io.BytesIO(b"".join(npz_bytes(chunks(empty)))))["power"].shape == (0,)


def members(archive: bytes) -> dict[str, bytes]:
    """The files of an npz archive."""
    with zipfile.ZipFile(io.BytesIO(archive)) as held:
        return {name: held.read(name) for name in held.namelist()}


@pytest.mark.parametrize("count", [0, 1, 5, 70_001])
@pytest.mark.parametrize("rows", [1000, 40_000, 1_000_000])
def test_npz_in_pieces_is_that_of_the_whole(count: int, rows: int) -> None:
    """As numpy writes it at once; the categories may differ from part to part."""
    rng = np.random.default_rng(count)
    codes = rng.integers(2, size=count, dtype=np.int8)
    units = [CategoryColumn(codes=codes, categories=names) for names in (("V", "%"), ("kHz", "%"), ("", "V"))]
    numbers: dict[str, npt.NDArray[Any]] = {
        "x": rng.normal(size=count),
        "n": rng.integers(99, size=count, dtype=np.int32),
    }
    whole = {name: np.tile(column, 3) for name, column in numbers.items()}
    out = io.BytesIO()
    np.savez_compressed(out, allow_pickle=False, **whole, unit=np.concatenate([unit.texts for unit in units]))

    def written() -> bytes:
        parts = (chunks({**numbers, "unit": unit}, rows) for unit in units)
        return b"".join(npz_bytes(chain.from_iterable(parts)))

    assert members(written()) == members(out.getvalue())
    assert written() == written()


def test_memory_of_npz_does_not_grow_with_its_rows() -> None:
    """5 million rows of 40 bytes."""
    count, rows = 5_000_000, 1 << 17
    unit = CategoryColumn(codes=np.zeros(rows, dtype=np.int8), categories=("kHz", "V"))

    def table() -> Iterator[Columns]:
        for first in range(0, count, rows):
            number = np.arange(first, min(first + rows, count))
            yield {"n": number, "whole": number // 1000, "power": np.zeros(len(number)), "unit": unit[: len(number)]}

    tracemalloc.start()
    try:
        size = sum(map(len, npz_bytes(table())))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert size > 1_000_000
    assert peak < 20_000_000


def test_report_as_parquet(tmp_path: Path) -> None:
    """The rows by a reader of its own; the marks' power in closed form (40 % for as long as a mark takes)."""
    path = write(tmp_path, "LOOKAHEAD OFF\n" + MARK + "LASER POWER 40\nJUMP X 10\nLASER ON\nLINE X 20\nLASER OFF\n")
    out = tmp_path / "x.parquet"
    assert gusjob("report", path, "--format", "parquet", "-o", out).exit_code == 0
    frame = polars.read_parquet(out)
    assert frame["kind"].to_list() == ["jump", "mark"]
    assert frame["line"].to_list() == [6, 8]
    assert frame["x_mm"].to_list() == [10, 20]
    assert frame["duration_ms"].to_list() == pytest.approx([110, 110])
    assert frame["ch0_power_ms"].to_list() == pytest.approx([0, 4400])
    assert frame["ch0_power_max"].to_list() == [None, 40]
    assert frame["ch0_joules"].null_count() == 2
    assert frame.schema["line"] == polars.Int32
    about = polars.read_parquet_metadata(out)
    assert about["schema"] == "gusjob-report/1"
    assert json.loads(about["totals"])["duration_ms"] == pytest.approx(220)


def test_parquet_and_csv_hold_the_same(tmp_path: Path) -> None:
    job = ROOT / "jobs" / "two_channels.job"
    out = tmp_path / "x.parquet"
    assert gusjob("report", job, "--format", "parquet", "-o", out).exit_code == 0
    rows = list(csv.DictReader(io.StringIO(gusjob("report", job, "--format", "csv").stdout)))
    frame = polars.read_parquet(out)
    assert frame.columns == list(rows[0])
    for name in frame.columns:
        if name == "kind":
            assert frame[name].to_list() == [row[name] for row in rows]
        else:
            found = [None if row[name] == "" else float(row[name]) for row in rows]
            assert frame[name].to_list() == found, name


def test_rows_name_their_file(tmp_path: Path) -> None:
    write(tmp_path, "LINE X 3\n", "part.job")
    path = write(tmp_path, 'VEL 100\nACC 1000\nLINE X 1\nINCLUDE "part.job"\n')
    out = tmp_path / "x.parquet"
    assert gusjob("report", path, "--format", "parquet", "-o", out).exit_code == 0
    frame = polars.read_parquet(out)
    assert [Path(name).name for name in frame["file"]] == ["x.job", "part.job"]
    assert frame["line"].to_list() == [3, 1]


def test_units_of_a_channel_whose_mode_changes(tmp_path: Path) -> None:
    """Each row says what its power is in: 40 %, then 3 V."""
    path = write(
        tmp_path,
        MARK + "LASER POWER 40\nLASER ON\nLINE X 10\nLASER OFF\n"
        "LASER MODE ANALOG\nLASER POWER 3\nLASER ON\nLINE X 0\nLASER OFF\n",
    )
    rows = list(csv.DictReader(io.StringIO(gusjob("report", path, "--format", "csv").stdout)))
    assert [(row["ch0_power_max"], row["ch0_unit"]) for row in rows] == [("40.0", "%"), ("3.0", "V")]
    segments = json.loads(gusjob("report", path, "--format", "json").stdout)["segments"]
    assert (segments["ch0_unit"], segments["kind"]) == (["%", "V"], ["mark", "mark"])
    out = tmp_path / "x.parquet"
    assert gusjob("report", path, "-o", out).exit_code == 0
    assert polars.read_parquet(out)["ch0_unit"].to_list() == ["%", "V"]
    ticks = list(csv.DictReader(io.StringIO(gusjob("trace", path, "--format", "csv").stdout)))
    assert {(tick["ch0_power"], tick["ch0_unit"]) for tick in ticks} == {("40.0", "%"), ("3.0", "V")}
    assert "ch0 unit" in gusjob("report", path, "--table").stdout


def test_many_files_in_parquet(tmp_path: Path) -> None:
    """More than a byte counts."""
    for number in range(200):
        write(tmp_path, f"LINE X {number % 100 + 1}\n", f"p{number}.job")
    includes = "".join(f'INCLUDE "p{number}.job"\n' for number in range(200))
    path = write(tmp_path, "VEL 100\nACC 1000\n" + includes)
    out = tmp_path / "x.parquet"
    assert gusjob("report", path, "-o", out).exit_code == 0
    assert [Path(name).name for name in polars.read_parquet(out)["file"]] == [f"p{n}.job" for n in range(200)]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "parquet", "--marks"], "--marks can't be used with parquet"),
        (["--format", "parquet", "--summary"], "--summary needs --format"),
        (["--format", "html", "--summary"], "--summary needs --format"),
        (["--format", "csv", "--table"], "--table needs --format text"),
        (["--summary", "--table"], "--table and --summary exclude each other"),
    ],
)
def test_what_does_not_go_together(tmp_path: Path, arguments: list[str], message: str) -> None:
    found = gusjob("report", write(tmp_path, "LINE X 1\n"), *arguments)
    assert found.exit_code == 2
    assert message in found.output


@pytest.mark.parametrize(
    ("arguments", "module", "line"),
    [
        (["report", "--format", "parquet"], "pyarrow", 'python -m pip install "gusjob[parquet]"'),
        (["report", "--format", "html"], "jinja2", 'python -m pip install "gusjob[html]"'),
        (["watch", "--page"], "jinja2", 'python -m pip install "gusjob[html]"'),
    ],
)
def test_a_missing_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], module: str, line: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    path = write(tmp_path, "LINE X 1\n")
    found = gusjob(arguments[0], path, *arguments[1:])
    assert found.exit_code == 2
    assert line in found.output
