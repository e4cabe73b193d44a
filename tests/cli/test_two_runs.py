"""Two processes that run jobs on one controller, as people start them by mistake."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support.controller import GUS, Floats, Row, VirtualController, build, needs_controller
from support.killed_commands import command, executed
from support.tools import MARK

pytestmark = needs_controller

LINES = 120
JOB = MARK + f"VEL 5\nLASER POWER 40\nLASER ON\nREPEAT {LINES} AS i\nLINE X (i % 2 * 3) Y (i / 100)\nEND\nLASER OFF\n"
OTHER = MARK + "LINE X 1\nLINE X 2\n"
GEOMETRY = [Row.KIND, Row.X0, Row.Y0, Row.X1, Row.Y1, Row.LENGTH, Row.V0, Row.V1, Row.COMPLETED]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("controller"), GUS)


def environment(state: Path, **more: str) -> dict[str, str]:
    return os.environ | {"VC_STATE": str(state), "VC_OPTIONS": "speed=20,log=0"} | more


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


HELD = """
import pathlib, sys, time, gusjob
job, library, journal, release = sys.argv[1:]
def wait(progress):
    while not pathlib.Path(release).exists():
        time.sleep(0.01)
outcome = gusjob.run_on(job, library=library, abi="gus", confirm=True, journal=journal, on_progress=wait)
sys.exit(outcome.ending != "done")
"""
"""A run that does not end before a file appears, however slow this computer is; its motion is not delayed."""


def started(job: Path, library: Path, state: Path) -> subprocess.Popen[str]:
    """Start a run that ends when a file beside its job is made; its journal is first.journal."""
    argv = [str(job), str(library), str(job.with_name("first.journal")), str(job.with_name("release"))]
    return subprocess.Popen(
        [sys.executable, "-c", HELD, *argv], env=environment(state), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip


def ran(job: Path, library: Path, state: Path, *more: str, **variables: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command(job, library, *more), env=environment(state, **variables), capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip


def wait_for_call(journal: Path, call: bytes) -> None:
    until = time.monotonic() + 30
    while not (journal.exists() and call in journal.read_bytes()):
        assert time.monotonic() < until, "it was never made"
        time.sleep(0.005)


def run_alone(folder: Path, library: Path) -> Floats:
    state = folder / "alone.state"
    done = ran(written(folder, "alone.job", JOB), library, state)
    assert done.returncode == 0, done.stderr
    return executed(library, state)


def test_the_second_run_is_refused_and_the_first_is_undisturbed(tmp_path: Path, library: Path) -> None:
    VirtualController(library)
    state, journal = tmp_path / "machine.state", tmp_path / "first.journal"
    job, other = written(tmp_path, "first.job", JOB), written(tmp_path, "other.job", OTHER)
    first = started(job, library, state)
    wait_for_call(journal, b"GT_CrdStart")
    link = tmp_path / "link.so"
    link.symlink_to(library)
    for name in (library, link):  # Also with another folder for temporary files.
        second = ran(other, name, state, "--journal", str(tmp_path / "second.journal"), TMPDIR=str(tmp_path))
        assert second.returncode == 1
        assert "other.job:1:1: error[GJ918]" in second.stderr
        assert f"process {first.pid}, which runs {job}" in second.stderr
        assert "not started" in second.stderr
    (tmp_path / "release").touch()
    _, err = first.communicate(timeout=60)
    assert first.returncode == 0, err
    assert not (tmp_path / "second.journal").exists()
    alone, rows = run_alone(tmp_path, library), executed(library, state)
    assert len(rows) == LINES
    assert rows[:, GEOMETRY].tolist() == alone[:, GEOMETRY].tolist()


def test_a_bare_name_is_the_library_that_the_system_finds(tmp_path: Path, library: Path) -> None:
    state, journal = tmp_path / "machine.state", tmp_path / "first.journal"
    first = started(written(tmp_path, "first.job", JOB), library, state)
    wait_for_call(journal, b"GT_CrdStart")
    found = {name: str(library.parent) for name in ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")}
    second = ran(written(tmp_path, "other.job", OTHER), Path(library.name), state, **found)
    first.kill()
    first.communicate()
    assert second.returncode == 1
    assert f"process {first.pid}" in second.stderr


def test_a_killed_process_has_no_lock(tmp_path: Path, library: Path) -> None:
    state, journal = tmp_path / "machine.state", tmp_path / "first.journal"
    job = written(tmp_path, "first.job", JOB)
    first = started(job, library, state)
    wait_for_call(journal, b"GT_CrdStart")
    first.kill()
    first.communicate()
    resumed = ran(job, library, state, "--resume", str(journal))
    assert resumed.returncode == 0, resumed.stderr
