"""A short text takes little time and memory, whatever it asks for."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.heavy_jobs import FILES, TEXTS, random_text

from gusjob.config.machine import Machine
from gusjob.frontend import check_text, read_job

MOST_S = 3.0
MOST_MB = 300
BUSY = 2
"""Other tests run at the same time, and two threads of one core share its units: work takes up to twice as long."""
STARTS = 10
"""On a slow computer: so many times as long as a job of one line takes."""
TRIES = 3
"""Another process on the same core makes the same work take longer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    cpu_s: float
    peak_mb: float
    output: str


# A command is started by a small process: on Linux its peak never reads lower than that of the process that starts it.
RUN = """
import os, subprocess, sys
process = subprocess.Popen([sys.executable, "-m", "gusjob", "check", "f0.job"], stdout=sys.stderr, stderr=sys.stderr)
_, status, usage = os.wait4(process.pid, 0)
print(os.waitstatus_to_exitcode(status), usage.ru_utime + usage.ru_stime, usage.ru_maxrss)
"""


def check(folder: Path, files: dict[str, str]) -> Usage:
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    with (folder / "output").open("w+b") as output:
        command = [sys.executable, "-c", RUN]
        ran = subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, stderr=output, check=True)
        output.seek(0)
        printed = output.read().decode("utf-8", errors="replace")
    code, cpu_s, peak = ran.stdout.split()
    assert int(code) in (0, 1), printed
    assert "Traceback" not in printed
    per_mb = 1 << 20 if sys.platform == "darwin" else 1 << 10
    return Usage(cpu_s=float(cpu_s), peak_mb=int(peak) / per_mb, output=printed)


@pytest.fixture(scope="module")
def most_s(tmp_path_factory: pytest.TempPathFactory) -> float:
    folder = tmp_path_factory.mktemp("start")
    return max(BUSY * MOST_S, STARTS * min(check(folder, {"f0.job": "DWELL 1\n"}).cpu_s for _ in range(3)))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs the usage of a child process")
@pytest.mark.parametrize("name", FILES)
def test_a_short_text_takes_little_time_and_memory(name: str, tmp_path: Path, most_s: float) -> None:
    files = FILES[name]
    assert sum(map(len, files.values())) < 10_000
    for _ in range(TRIES):
        usage = check(tmp_path, files)
        if usage.cpu_s < most_s:
            break
    assert usage.cpu_s < most_s
    assert usage.peak_mb < MOST_MB


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(80))
def test_random_blocks_take_little_time(seed: int, most_s: float) -> None:
    source, _ = check_text(random_text(seed).encode(), "x")
    assert source is not None
    for _ in range(TRIES):
        began = time.process_time()
        read_job(source, Machine())
        cpu_s = time.process_time() - began
        if cpu_s < most_s:
            break
    assert cpu_s < most_s


@pytest.mark.parametrize(
    ("name", "codes"),
    [
        ("empty loops", ["GJ127"]),
        ("empty loops, too deep", ["GJ134", "GJ127"]),
        ("LET in loops", ["GJ142", "GJ127"]),
        ("carried LET in loops", ["GJ129"]),
        ("empty routines, twenty calls each", ["GJ129"]),
        ("many names around loops", ["GJ142", "GJ127"]),
    ],
)
def test_what_is_too_much_is_refused_at_once(name: str, codes: list[str]) -> None:
    source, _ = check_text(TEXTS[name].encode(), "x")
    assert source is not None
    _, found = read_job(source, Machine())
    assert list(dict.fromkeys(one.rule.code for one in found)) == codes


def test_calls_in_a_flat_text_are_not_limited() -> None:
    routines = "".join(f"DEF f{k}()\nDWELL {k}\nEND\n" for k in (1, 2))
    source, _ = check_text((routines + "CALL f1()\nCALL f2()\n" * 20_000).encode(), "x")
    assert source is not None
    job, found = read_job(source, Machine())
    assert found == []
    assert job.path.dwell_ms.tolist() == [1, 2] * 20_000
