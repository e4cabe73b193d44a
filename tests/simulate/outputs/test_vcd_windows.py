"""VCD files: a part is a part of the whole, windows leave no seam, viewers read the file."""

from __future__ import annotations

import re
import shutil
import subprocess
from functools import cache
from pathlib import Path

import pytest
from support.vcd import DUTY, GO, GTS, JOBS, NS, F, Wave, off, periods, read, run, same, vcdvcd, wave, whole

from gusjob.simulate.outputs import levels as outputs

UNKNOWN = GTS.format("0,100,0", "") + GO


@cache
def job(name: str) -> bytes:
    """The whole file of a job."""
    return whole(JOBS[name])


@cache
def job_wave(name: str) -> Wave:
    return read(job(name))


@pytest.mark.parametrize("name", JOBS)
@pytest.mark.parametrize(
    ("start", "end"),
    [("0", "1.4"), ("1013us", "1.9"), ("1.01us", "99s"), ("1.05", "1.0505"), ("2.25", "4.0002ms"), ("0.003s", "5.1")],
)
def test_a_part_equals_that_part_of_the_whole(name: str, start: str, end: str) -> None:
    """Wrong: a carrier that begins with the piece, a level at its start that is that of rest, an edge less or more."""
    everything = job_wave(name)
    piece = wave(JOBS[name], "--from", start, "--to", end)
    us = {"us": 1, "ms": 1000, "s": 1000_000, "": 1000}
    at = [F(re.sub("[a-z]+", "", t)) * us[re.sub("[0-9.]+", "", t)] * 1000 for t in (start, end)]
    first, last = int(at[0]), min(int(at[1]), everything.end)
    for line, changes in everything.between(first, last + 1).items():
        assert off(piece.signals[line], changes) == [], line
    assert piece.end == last


def test_a_part_with_unknown_levels() -> None:
    """Wrong: a piece that begins within an unknown level and gives one."""
    piece = wave(UNKNOWN, "--from", "2", name="x.gts", code=run(UNKNOWN, name="x.gts").exit_code)
    assert piece.signals["PWM0+"][0] == (2 * NS, "x")


def in_windows(monkeypatch: pytest.MonkeyPatch, text: str, pulses: float, window_ms: float) -> bytes:
    with monkeypatch.context() as small:
        small.setattr(outputs, "_WINDOW_PULSES", pulses)
        small.setattr(outputs, "_WINDOW_MS", window_ms)
        return whole(text)


@pytest.mark.parametrize("name", JOBS)
@pytest.mark.parametrize(("pulses", "window_ms"), [(10**6, 0.2371931), (1501, 3.00037), (307.31, 500.0)])
def test_windows_leave_no_seam(monkeypatch: pytest.MonkeyPatch, name: str, pulses: float, window_ms: float) -> None:
    """Wrong: a pulse cut, doubled or moved where one window meets the next in the middle of it."""
    assert off(in_windows(monkeypatch, JOBS[name], pulses, window_ms).splitlines(), job(name).splitlines()) == []


@pytest.mark.parametrize("name", JOBS)
@pytest.mark.parametrize("window_ms", [0.25, 1.0])
def test_windows_that_begin_with_an_edge(monkeypatch: pytest.MonkeyPatch, name: str, window_ms: float) -> None:
    """Wrong: an edge that is exactly on a window's end in neither window, or in both."""
    assert off(in_windows(monkeypatch, JOBS[name], 10**6, window_ms).splitlines(), job(name).splitlines()) == []


def test_emission_that_begins_with_a_window() -> None:
    """Wrong: a mark without its edges, since it begins half a second into the job."""
    found = wave(DUTY.format(1) + "LASER POWER 40\nDWELL 500\nLASER ON\nDWELL 1\nLASER OFF\nDWELL 1\n")
    assert found.spans("PWM1+") == [(500 * NS, 501 * NS)]
    same(found.spans("PWM0+"), periods(F(500), F(501), F(1), lambda _: F(40)))


def sigrok(tmp_path: Path, data: bytes) -> dict[str, list[tuple[int, str]]]:
    """The logic lines as sigrok has them, changes only."""
    command = shutil.which("sigrok-cli")
    if command is None:
        pytest.skip("sigrok-cli is not installed")
    (tmp_path / "x.vcd").write_bytes(data)
    done = subprocess.run(
        [command, "-I", "vcd", "-i", "x.vcd", "-O", "vcd"], cwd=tmp_path, capture_output=True, check=True, timeout=60
    )
    read_back = vcdvcd.VCDVCD(vcd_string=done.stdout.decode())
    return {name.removeprefix("libsigrok."): read_back[name].tv for name in read_back.signals}


@pytest.mark.parametrize("name", ["duty", "fpk", "both"])
def test_sigrok_reads_the_file(tmp_path: Path, name: str) -> None:
    """Wrong: a file that PulseView opens with other edges in it, or none (it knows no real variables)."""
    found = sigrok(tmp_path, job(name))
    assert len(found) in (4, 8)
    for line, changes in found.items():
        assert off(changes, job_wave(name).signals[line]) == [], line


def test_gtkwave_reads_the_file(tmp_path: Path) -> None:
    """Wrong: a file that GTKWave's own converter reads otherwise, volts and source line included."""
    to_fst, to_vcd = shutil.which("vcd2fst"), shutil.which("fst2vcd")
    if to_fst is None or to_vcd is None:
        pytest.skip("gtkwave is not installed")
    (tmp_path / "x.vcd").write_bytes(job("both"))
    subprocess.run([to_fst, "x.vcd", "x.fst"], cwd=tmp_path, check=True, capture_output=True, timeout=60)
    back = subprocess.run([to_vcd, "x.fst"], cwd=tmp_path, check=True, capture_output=True, timeout=60).stdout
    for line, changes in read(back).signals.items():
        assert off(changes, job_wave("both").signals[line]) == [], line
