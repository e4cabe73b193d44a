"""Commands that are killed by SIGKILL and resumed, as processes of their own; support.kill does it faster.

The virtual controller outlives the process, as hardware does: it continues with what is in its FIFO. Each journal must
resume to a complete job: the path whole, nothing twice beyond one segment, nothing left out.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
from support.controller import Floats, Row
from support.hardware import Interruption, continues
from support.tools import MARK

JOB = (
    MARK
    + "VEL 400\nLASER POWER 40\nREPEAT 3 AS k\nLASER ON\nREPEAT 60 AS i\nLINE X (i % 2 * 3) Y (k + i / 100)\nEND\n"
    + "ARC CCW I 1 J 0\nLASER OFF\nJUMP X 0 Y (k + 1)\nLASER DELAY ON 20us OFF 30us\nEND\n"
)
SPEED = 4.0


def command(job: Path, library: Path, *more: str) -> list[str]:
    """Return the command line of a run on the virtual controller."""
    options = ("--backend", "gts", "--library", str(library), "--abi", "gus", "--yes", "--progress", "none")
    return [sys.executable, "-m", "gusjob", "run", str(job), *options, *more]


def executed(library: Path, state: Path) -> Floats:
    """Return all rows that a machine of that state executed, in a process of its own: a library maps one state."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import pathlib, numpy as np;"
        "from support.controller import VirtualController;"
        "np.save(sys.argv[3], VirtualController(pathlib.Path(sys.argv[2])).rows())"
    )
    out = state.with_suffix(".npy")
    environment = os.environ | {"VC_STATE": str(state)}
    subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parents[1]), str(library), str(out)],
        env=environment,
        check=True,
    )
    rows: Floats = np.load(out)
    return rows


def killed(folder: Path, library: Path, after_s: float, number: int, slots: int = 4096) -> tuple[Path, Path, bool]:
    """Kill a run some time after its journal appears; return its machine, its journal, and whether it was alive."""
    job, state, journal = folder / "kill.job", folder / f"{number}.state", folder / f"{number}.journal"
    job.write_text(JOB, encoding="utf-8")
    environment = os.environ | {"VC_STATE": str(state), "VC_OPTIONS": f"speed={SPEED},log=0,slots={slots}"}
    process = subprocess.Popen(
        command(job, library, "--journal", str(journal)), env=environment, stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while not journal.exists() and process.poll() is None:
        time.sleep(0.001)
    time.sleep(after_s)
    alive = process.poll() is None
    process.kill()
    process.wait()
    return state, journal, alive


def resume(folder: Path, library: Path, state: Path, journal: Path, whole: Floats, wait_s: float) -> str:
    """Continue a killed run; return '' or what is wrong."""
    time.sleep(wait_s)
    before = len(executed(library, state))
    environment = os.environ | {"VC_STATE": str(state)}
    done = subprocess.run(
        command(folder / "kill.job", library, "--resume", str(journal)), env=environment, capture_output=True,
        text=True, timeout=60, check=False,
    )  # fmt: skip
    if done.returncode:
        return f"exit {done.returncode}: {done.stderr.strip()[-400:]}"
    rows = executed(library, state)
    if "nothing to resume" in done.stderr:
        return "" if len(rows) >= len(whole) else "not all was done"
    # What the killed process had sent continued by itself, until the run that continues stopped it.
    return "" if _continues_somewhere(rows, before, whole) else "the path is not whole"


def _continues_somewhere(rows: Floats, before: int, whole: Floats) -> bool:
    """Return whether at least `before` rows are the path's beginning and the others are the rest of it."""
    for first in range(before, min(len(rows), len(whole)) + 1):
        head = rows[:first]
        ends = np.abs(head[:-1, [Row.X1, Row.Y1]] - whole[: max(first - 1, 0), [Row.X1, Row.Y1]]).max(initial=0)
        if ends > 1.5:
            return False
        if not isinstance(continues(whole, rows[first:], _interruption_after(head)), str):
            return True
    return False


def _interruption_after(head: Floats) -> Interruption:
    if not len(head):
        return Interruption(segment=0, along=0.0)
    if head[-1, Row.COMPLETED]:
        return Interruption(segment=len(head), along=0.0)
    return Interruption(segment=len(head) - 1, along=float(head[-1, Row.LENGTH]))


def whole_run(folder: Path, library: Path) -> tuple[Floats, float]:
    """Return the rows of a run that is not killed, and its duration from the journal on, s."""
    job, state = folder / "kill.job", folder / "whole.state"
    job.write_text(JOB, encoding="utf-8")
    environment = os.environ | {"VC_STATE": str(state), "VC_OPTIONS": f"speed={SPEED},log=0"}
    journal = folder / "whole.journal"
    process = subprocess.Popen(command(job, library, "--journal", str(journal)), env=environment)
    while not journal.exists() and process.poll() is None:
        time.sleep(0.001)
    began = time.perf_counter()
    assert process.wait() == 0
    return executed(library, state), time.perf_counter() - began
