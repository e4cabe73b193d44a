"""Peak memory of whole commands by statement of a job, and by call of a listing: what twice as many take more."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

HEAD = "LASER MODE DUTY CARRIER 20\nVEL 500\nACC 20000\nLASER FOLLOW MIN 10 MAX 80 AT 500\nLASER ON\n"
CALLS = (
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(20,0)\n"
    "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\n"
    "GT_BufLaserOn(1,0,0)\nGT_BufLaserPrfFollow(1,0.5,10,80,0,0)\n"
)
COUNT = 200_000
# A command is started by a small process: on Linux its peak never reads lower than that of the process that starts it.
PEAK = (
    "import resource, subprocess, sys; "
    "subprocess.run([sys.executable, '-m', 'gusjob', *sys.argv[1:]], stdout=subprocess.DEVNULL, check=True); "
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)"
)


def spiral_mm(count: int) -> Iterator[tuple[float, float]]:
    """Points half a mm apart."""
    radius_mm, angle = 1.0, 0.0
    for _ in range(count):
        angle += 0.5 / radius_mm
        radius_mm = 1.0 + 0.02 * angle
        yield radius_mm * math.cos(angle), radius_mm * math.sin(angle)


def a_spiral(path: Path, count: int) -> Path:
    """Write a job of lines half a mm long under velocity follow."""
    lines = [f"LINE X {x:.3f} Y {y:.3f}\n" for x, y in spiral_mm(count)]
    path.write_text("".join([HEAD, *lines, "LASER OFF\n"]))
    return path


def a_spiral_of_calls(path: Path, count: int) -> Path:
    """Write a listing of such lines, which go on with different velocities."""
    lines = [
        f"GT_LnXY(1,{x * 1000:.0f},{y * 1000:.0f},500,20,{10 + i % 7 / 7!r},0)\n"
        for i, (x, y) in enumerate(spiral_mm(count))
    ]
    path.write_text("".join([CALLS, *lines, "GT_LnXY(1,0,0,500,20,0,0)\nGT_BufLaserOff(1,0,0)\nGT_CrdStart(1,0)\n"]))
    return path


def peak_bytes(*args: str) -> int:
    return int(subprocess.run([sys.executable, "-c", PEAK, *args], stdout=subprocess.PIPE, check=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the unit of ru_maxrss differs")
@pytest.mark.parametrize(("command", "most"), [("check", 200), ("report", 270)])
def test_memory_by_statement(tmp_path: Path, command: str, most: int) -> None:
    options = ["--summary", "--no-marks"] if command == "report" else []
    peaks = [peak_bytes(command, *options, str(a_spiral(tmp_path / f"{n}.job", n))) for n in (COUNT, 2 * COUNT)]
    per_statement = (peaks[1] - peaks[0]) / COUNT
    assert 0 < per_statement < most


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the unit of ru_maxrss differs")
@pytest.mark.parametrize("command", ["check", "report"])
def test_memory_by_call(tmp_path: Path, command: str) -> None:
    options = ["--summary", "--no-marks"] if command == "report" else []
    files = [a_spiral_of_calls(tmp_path / f"{n}.gts", n) for n in (COUNT, 2 * COUNT)]
    peaks = [peak_bytes(command, *options, str(file)) for file in files]
    per_call = (peaks[1] - peaks[0]) / COUNT
    assert 0 < per_call < 340
