"""Peak memory of whole commands by statement of a job: what twice as many statements take more."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import pytest

HEAD = "LASER MODE DUTY CARRIER 20\nVEL 500\nACC 20000\nLASER FOLLOW MIN 10 MAX 80 AT 500\nLASER ON\n"
COUNT = 200_000
# A command is started by a small process: on Linux its peak never reads lower than that of the process that starts it.
PEAK = (
    "import resource, subprocess, sys; "
    "subprocess.run([sys.executable, '-m', 'gusjob', *sys.argv[1:]], stdout=subprocess.DEVNULL, check=True); "
    "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024)"
)


def a_spiral(path: Path, count: int) -> Path:
    """Write a job of lines half a mm long under velocity follow."""
    lines = [HEAD]
    radius_mm, angle = 1.0, 0.0
    for _ in range(count):
        angle += 0.5 / radius_mm
        radius_mm = 1.0 + 0.02 * angle
        lines.append(f"LINE X {radius_mm * math.cos(angle):.3f} Y {radius_mm * math.sin(angle):.3f}\n")
    path.write_text("".join(lines) + "LASER OFF\n")
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
