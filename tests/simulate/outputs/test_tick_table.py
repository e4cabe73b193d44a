"""`gusjob trace`: tables hold what closed forms say; options of the command."""

from __future__ import annotations

import csv
import io
import math
import os
import subprocess
import sys
from bisect import bisect_left, bisect_right
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import polars as pl
import pytest
from click.testing import CliRunner
from support.vcd import DUTY, HEAD, JOBS, LIT, NS, off, read, run, wave, whole

from gusjob.cli import cli


def test_lines_bound_a_piece(tmp_path: Path) -> None:
    """Wrong: lines of an included file taken for the job's own, or a bound at the wrong end of its line."""
    (tmp_path / "in.job").write_text("DWELL 7\nDWELL 1\n\n\nDWELL 1\n", encoding="utf-8")
    path = tmp_path / "x.job"
    path.write_text('LASER MODE DUTY CARRIER 10\nDWELL 2\nINCLUDE "in.job"\nDWELL 3\nDWELL 4\n', encoding="utf-8")
    for options, start, end in (
        (("--from", "line:2"), 0, 18), (("--from", "line:4"), 11, 18), (("--from", "line:1"), 0, 18),
        (("--to", "line:2"), 0, 2), (("--to", "line:4"), 0, 14), (("--from", "line:4", "--to", "line:4"), 11, 14),
        (("--from", "line:5", "--to", "17.5"), 14, 17.5),
    ):  # fmt: skip
        done = CliRunner().invoke(cli, ["trace", str(path), *options], catch_exceptions=False)
        piece = read(done.stdout_bytes)
        assert (piece.signals["PWM0+"][0][0], piece.end) == (start * NS, end * NS), options


@pytest.mark.parametrize(
    "options",
    [
        "--from 5 --to 1", "--from abc", "--from=-1", "--from line:99", "--to line:1", "--from 100s", "--from line:0",
        "--from 1e3", "--from nan", "--to inf", "--format xml", "--from 1ns", "--scanner foo", "--to line:x",
        "--from 99999999999999999999", "--nonsense", "--machine none.toml",
    ],
)  # fmt: skip
@pytest.mark.parametrize("ending", ["vcd", "csv"])
def test_wrong_usage(tmp_path: Path, options: str, ending: str) -> None:
    """Wrong: a traceback, another exit status, or a file that was begun."""
    path, made = tmp_path / "x.job", tmp_path / f"x.{ending}"
    path.write_text(JOBS["duty"], encoding="utf-8")
    done = CliRunner().invoke(cli, ["trace", str(path), *options.split(), "-o", str(made)])
    assert (done.exit_code, type(done.exception)) == (2, SystemExit)
    assert done.stdout == ""
    assert "rror" in done.stderr
    assert not made.exists()


@pytest.mark.parametrize("ending", ["vcd", "csv", "npz", "parquet"])
def test_a_job_with_an_error(tmp_path: Path, ending: str) -> None:
    """Wrong: a trace of a job that would not run."""
    path, made = tmp_path / "x.job", tmp_path / f"x.{ending}"
    path.write_text(JOBS["duty"] + "LINE X 1 VEL -3\n", encoding="utf-8")
    done = CliRunner().invoke(cli, ["trace", str(path), "-o", str(made)], catch_exceptions=False)
    assert done.exit_code == 1
    assert "error[GJ" in done.stderr
    assert not made.exists()


def test_jobs_without_emission_or_motion() -> None:
    """Wrong: a fault, or lines that do not rest."""
    rest: dict[str, list[tuple[int, object]]] = {
        "PWM0+": [(0, "1")], "PWM0-": [(0, "0")], "PWM1+": [(0, "1")], "PWM1-": [(0, "0")], "AO0": [(0, 0.0)],
    }  # fmt: skip
    dwell = wave(DUTY.format(10) + "DWELL 3\n")
    assert dwell.signals == {**rest, "line": [(0, 6)]}
    assert dwell.end == 3 * NS
    assert wave(DUTY.format(10)).signals == {**rest, "line": [(0, 0)]}
    moved = wave(HEAD + "LINE X 11\n")
    assert (moved.signals, moved.end) == ({"line": [(0, 5)]}, 2_100_000)
    for empty in (DUTY.format(10), HEAD):
        assert [len(row) for row in csv.reader(io.StringIO(whole(empty, "--format", "csv").decode()))][1:] == []


Table = dict[str, npt.NDArray[Any]]


def table(text: str, *options: str, name: str = "x.job") -> Table:
    """The ticks, from npz."""
    with np.load(io.BytesIO(whole(text, "--format", "npz", *options, name=name))) as held:
        return {key: held[key] for key in held.files}


TICKED = (
    HEAD + "LASER MODE DUTY CARRIER 10\nLASER MODE FREQUENCY WIDTH 5 CHANNEL 1\nACC 1\nLASER POWER 20 CHANNEL 1\n"
    "LASER FOLLOW RATIO 5 MIN 1 MAX 43\nLASER ON\nLINE X 211\nLASER OFF\nDWELL 2\nLASER ON CHANNEL 1\nLINE Y 100\n"
    "LASER OFF CHANNEL 1\nDWELL 1\n"
)  # fmt: skip


def test_trapezoid_in_the_table() -> None:
    """Wrong: any column of a trapezoid: ticks, position, velocity, held power, emission."""
    found = table(TICKED)
    t = np.arange(0, 31.1, 0.25)
    n = len(t)
    until = 10 + 21.1
    v = np.minimum(np.minimum(t, 10), until - t)
    x = np.where(t < 10, t * t / 2, np.where(t < 21.1, 50 + (t - 10) * 10, 211 - (until - t) ** 2 / 2))
    assert np.array_equal(found["time_ms"], np.arange(len(found["time_ms"])) * 0.25)
    np.testing.assert_allclose(found["x_mm"][:n], x / 1000, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["vel_mm_s"][:n], v, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["ch0_power"][:n], np.minimum(5 * v + 1, 43), rtol=0, atol=1e-9)
    assert not found["y_mm"][:n].any()
    assert set(found["stage"]) == {1}
    assert off(found["line"], [11] * 125 + [13] * 8 + [15] * 80 + [17] * 4) == []
    assert off(found["segment"], [0] * 125 + [1] * 8 + [2] * 80 + [3] * 4) == []
    assert (found["ch0_on"] == (found["time_ms"] < until)).all()
    assert (found["ch1_on"] == ((found["time_ms"] >= 33.1) & (found["time_ms"] < 53.1))).all()
    assert set(found["ch1_power"]) == {20.0}
    assert found["ch0_emission_us"].sum() == pytest.approx(31_100, abs=1e-6)
    assert found["ch1_emission_us"].sum() == pytest.approx(20_000, abs=1e-6)
    assert found["ch0_emission_us"][n - 1] == pytest.approx(100, abs=1e-6)
    assert found["time_ms"][-1] == 54.0, "the end is 54.1"


def test_arc_in_the_table() -> None:
    """Wrong: a circle of another centre, direction or pace."""
    found = table(HEAD + "LINE X 100\nARC CCW I -100 J 0\n")
    t = found["time_ms"] - 11
    on = (t >= 0) & (t < 1 + 20 * math.pi)
    t = t[on]
    left = np.maximum(1 + 20 * math.pi - t, 0)
    way = np.where(t < 1, 5 * t * t, np.where(left > 1, 5 + (t - 1) * 10, 200 * math.pi - 5 * left**2))
    np.testing.assert_allclose(found["x_mm"][on], 0.1 * np.cos(way / 100), rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["y_mm"][on], 0.1 * np.sin(way / 100), rtol=0, atol=1e-9)
    assert len(t) == 4 * 63 + 4


@pytest.mark.parametrize("lag_us", [250, 100, 0])
def test_delayed_beam(lag_us: int) -> None:
    """Wrong: a beam that is not where the command was so much earlier."""
    found = table(HEAD + "DWELL 1\nACC 1\nLINE X 200\nDWELL 2\n", "--scanner", f"delay:{lag_us}us")
    t = np.clip(found["time_ms"] - lag_us / 1000 - 1, 0, 30)
    x = np.where(t < 10, t * t / 2, np.where(t < 20, 50 + (t - 10) * 10, 200 - (30 - t) ** 2 / 2))
    np.testing.assert_allclose(found["beam_x_mm"], x / 1000, rtol=0, atol=1e-12)
    assert not found["beam_y_mm"].any()
    if lag_us == 250:
        assert np.array_equal(found["beam_x_mm"][1:], found["x_mm"][:-1])


def test_stages_in_the_table() -> None:
    """Wrong: ticks that do not count from their stage's start, or a stage that does not wait for the emission."""
    text = "LASER DELAY ON 0 OFF 130\nLASER POWER 40\nLASER ON\nLINE X 11\nLASER OFF\nWAIT\nDWELL 2\nLASER ON\n"
    found = table(DUTY.format(10) + text + "DWELL 1\nLASER OFF\n")
    first = found["stage"] == 1
    np.testing.assert_allclose(found["time_ms"][first], np.arange(9) * 0.25, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found["time_ms"][~first], 2.23 + np.arange(13) * 0.25, rtol=0, atol=1e-12)
    assert found["line"].tolist() == [9] * 9 + [12] * 8 + [14] * 5
    assert found["segment"].tolist() == [0] * 9 + [1] * 8 + [2] * 5
    assert found["ch0_emission_us"].sum() == pytest.approx(2230 + 1130, abs=1e-6)


def test_emission_at_its_edges() -> None:
    """Wrong: emission at the tick where it ends, or none at the one where it begins."""
    found = table(DUTY.format(10) + LIT.format(50, 2))
    lit = (found["time_ms"] >= 1) & (found["time_ms"] < 3)
    assert len(lit) == 17
    assert off(found["ch0_on"], lit) == []
    assert off(found["ch0_emission_us"], 250.0 * lit) == []


def test_off_delay_in_the_table() -> None:
    """Wrong: emission that no row holds: emission_us must sum up to the emission's time."""
    found = table(DUTY.format(10) + "LASER DELAY ON 0 OFF 900\nLASER POWER 40\nLASER ON\nDWELL 1\nLASER OFF\n")
    assert found["ch0_emission_us"].sum() == pytest.approx(1900, abs=1e-6)


def test_a_piece_of_the_table() -> None:
    """Wrong: bounds that leave a tick out, or rows that differ from those of the whole."""
    everything = table(TICKED)
    for options, first, last in (
        (("--from", "1", "--to", "2.25"), 1.0, 2.25), (("--from", "1001us"), 1.001, 99.0), (("--to", "7.2"), 0.0, 7.2),
        (("--from", "line:13", "--to", "line:13"), 31.1, 33.1), (("--from", "line:17"), 53.1, 99.0),
    ):  # fmt: skip
        begin, end = bisect_left(everything["time_ms"], first), bisect_right(everything["time_ms"], last)
        piece = table(TICKED, *options)
        for name, values in everything.items():
            assert np.array_equal(piece[name], values[begin:end]), (options, name)


def test_formats_hold_the_same(tmp_path: Path) -> None:
    """Wrong: a column less, another type, digits that a format drops."""
    found = table(TICKED, "--scanner", "first-order:100us")
    kinds = {name: values.dtype.kind for name, values in found.items()}
    assert {name for name, kind in kinds.items() if kind == "i"} == {"stage", "segment", "line", "ch0_on", "ch1_on"}
    rows = list(csv.reader(io.StringIO(whole(TICKED, "--format", "csv", "--scanner", "first-order:100us").decode())))
    assert rows[0] == list(found)
    for (name, values), column in zip(found.items(), zip(*rows[1:], strict=True), strict=True):
        assert off([float(text) for text in column], values.tolist()) == [], name
        assert kinds[name] != "i" or all(text.isdigit() for text in column), name
    path = tmp_path / "x.parquet"
    path.write_bytes(whole(TICKED, "--format", "parquet", "--scanner", "first-order:100us"))
    frame = pl.read_parquet(path)
    assert frame.columns == list(found)
    for name, values in found.items():
        assert off(frame[name].to_list(), values.tolist()) == [], name
        assert frame[name].to_numpy().dtype == values.dtype, name


@pytest.mark.parametrize(
    ("options", "name", "start"),
    [
        ("", "x.vcd", b"$comment"), ("", "x.CSV", b"time_ms,"), ("", "x.npz", b"PK"), ("", "x.parquet", b"PAR1"),
        ("", "x", b"$comment"), ("--format csv", "x.parquet", b"time_ms,"), ("--format vcd", "x.csv", b"$comment"),
    ],
)  # fmt: skip
def test_format_and_ending(tmp_path: Path, options: str, name: str, start: bytes) -> None:
    """Wrong: an ending that wins over --format, or one that is not seen."""
    (tmp_path / "x.job").write_text(TICKED, encoding="utf-8")
    done = CliRunner().invoke(cli, ["trace", str(tmp_path / "x.job"), *options.split(), "-o", str(tmp_path / name)])
    assert (done.exit_code, done.stdout) == (0, "")
    assert (tmp_path / name).read_bytes().startswith(start)


@pytest.mark.parametrize("form", ["parquet", "npz"])
def test_not_for_a_terminal(tmp_path: Path, form: str) -> None:
    """Wrong: a binary file poured out over a terminal."""
    pty = pytest.importorskip("pty", reason="no terminals here")
    (tmp_path / "x.job").write_text(TICKED, encoding="utf-8")
    main, other = pty.openpty()
    try:
        command = [sys.executable, "-m", "gusjob", "trace", str(tmp_path / "x.job"), "--format", form]
        done = subprocess.run(command, stdout=other, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    finally:
        os.close(other)
        os.close(main)
    assert done.returncode == 2
    assert f"{form} can't be shown on a terminal: name a file with -o" in done.stderr


@pytest.mark.parametrize(("form", "module", "extra"), [("vcd", "vcd", "trace"), ("parquet", "pyarrow", "parquet")])
def test_missing_extra(monkeypatch: pytest.MonkeyPatch, form: str, module: str, extra: str) -> None:
    """Wrong: a traceback where one line says what to install; a table that asks for what it does not need."""
    monkeypatch.setitem(sys.modules, module, None)
    done = run(TICKED, "--format", form)
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.splitlines() == [
        f'gusjob: to write {form}, install the extra "{extra}": python -m pip install "gusjob[{extra}]"'
    ]
    assert run(TICKED, "--format", "csv").exit_code == run(TICKED, "--format", "npz").exit_code == 0
