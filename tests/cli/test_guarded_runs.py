"""gusjob run --backend gts in processes that are killed or crash, and what their guards do then."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
from support.controller import GUS, Fault, build, needs_controller
from support.killed_commands import command
from support.tools import MARK

pytestmark = needs_controller

LINES = 400
JOB = MARK + f"VEL 10\nLASER POWER 40\nLASER ON\nREPEAT {LINES} AS i\nLINE X (i % 2 * 3) Y (i / 100)\nEND\nLASER OFF\n"
GONE = "the process that ran part.job ended without a shutdown (it was killed or crashed)"
CONFIRMED = "the guard switched the controller off: it confirmed that every laser is off and nothing moves"
TESTS = str(Path(__file__).parents[1])


@dataclass(frozen=True, slots=True, kw_only=True)
class GuardedRun:
    """A folder with a job, and a controller whose state outlives processes."""

    folder: Path
    library: Path

    @property
    def journal(self) -> Path:
        return self.folder / "part.journal"

    @property
    def environment(self) -> dict[str, str]:
        return os.environ | {"VC_STATE": str(self.folder / "state"), "VC_OPTIONS": "speed=10,log=0"}

    def started(self, *more: str, switches_off: bool = False) -> subprocess.Popen[str]:
        (self.folder / "part.job").write_text(JOB, encoding="utf-8")
        profile = f"[controller]\nguard_switches_off = {str(switches_off).lower()}\n"
        (self.folder / "gusjob.toml").write_text(profile, encoding="utf-8")
        argv = command(self.folder / "part.job", self.library, *(more or ("--journal", str(self.journal))))
        return subprocess.Popen(
            argv, env=self.environment, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip

    def wait_for_motion(self) -> None:
        until = time.monotonic() + 30
        while not (self.journal.exists() and b"GT_CrdStart" in self.journal.read_bytes()):
            assert time.monotonic() < until
            time.sleep(0.005)
        time.sleep(0.1)

    def controller(self, code: str, *values: str) -> str:
        """Run code on the controller in a process of its own, as `vc`; return what it prints."""
        head = (
            "import pathlib, sys; sys.path.insert(0, sys.argv[1]); from support.controller import VirtualController;"
            "vc = VirtualController(pathlib.Path(sys.argv[2]));"
        )
        argv = [sys.executable, "-c", head + code, TESTS, str(self.library), *values]
        return subprocess.run(argv, env=self.environment, capture_output=True, text=True, check=True).stdout.strip()

    def is_off(self) -> bool:
        """Whether the laser is off and nothing moves."""
        code = "s = vc.state(); print(not any((*s.emitting, *s.switched_on, s.moving)))"
        return self.controller(code) == "True"


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("controller"), GUS)


@pytest.fixture
def run(tmp_path: Path, library: Path) -> GuardedRun:
    return GuardedRun(folder=tmp_path, library=library)


def crashed(run: GuardedRun, call: str, nth: int, *, switches_off: bool) -> tuple[int, str]:
    """Crash in a call of the library; return exit status and messages."""
    run.controller(f"vc.fault({Fault.SIGNAL.value}, '{call}', {nth}, 1, {signal.SIGSEGV.value})")
    process = run.started(switches_off=switches_off)
    _, err = process.communicate(timeout=60)
    return process.returncode, err


def test_a_library_that_crashes_is_reported(run: GuardedRun) -> None:
    code, err = crashed(run, "GT_CrdStatus", 6, switches_off=False)
    assert code == -signal.SIGSEGV
    assert GONE in err
    assert f"continue with --resume {run.journal}" in err
    assert CONFIRMED not in err
    assert not run.is_off()
    assert "GT_Stop" not in run.journal.read_text(encoding="utf-8")


def test_after_a_crash_the_guard_switches_off(run: GuardedRun) -> None:
    code, err = crashed(run, "GT_CrdStatus", 6, switches_off=True)
    assert code == -signal.SIGSEGV
    assert GONE in err and CONFIRMED in err
    assert run.is_off()


def test_after_a_kill_the_guard_switches_off_and_the_run_is_resumed(run: GuardedRun) -> None:
    process = run.started(switches_off=True)
    run.wait_for_motion()
    assert not run.is_off()
    process.kill()
    _, err = process.communicate(timeout=60)
    assert err.count(GONE) == err.count(CONFIRMED) == 1
    assert run.is_off()
    lines = run.journal.read_text(encoding="utf-8").splitlines()
    assert "GT_Stop" in [json.loads(line).get("call") for line in lines]
    run.controller("vc.option('speed', 200)")
    again = run.started("--resume", str(run.journal))
    _, err = again.communicate(timeout=60)
    assert again.returncode == 0, err
    assert GONE not in err
    assert int(run.controller("print(len(vc.rows()))")) >= LINES
    assert run.is_off()


def test_a_killed_run_is_reported(run: GuardedRun) -> None:
    process = run.started()
    run.wait_for_motion()
    os.killpg(process.pid, signal.SIGKILL)
    out, err = process.communicate(timeout=60)
    assert GONE in err
    assert out == ""
    assert not run.is_off()


def test_a_crash_while_the_position_is_looked_for_is_reported(run: GuardedRun) -> None:
    process = run.started()
    run.wait_for_motion()
    process.kill()
    process.communicate()
    run.controller(f"vc.fault({Fault.SIGNAL.value}, 'GT_GetCrdPos', 1, 1, {signal.SIGSEGV.value})")
    again = run.started("--resume", str(run.journal))
    _, err = again.communicate(timeout=60)
    assert again.returncode == -signal.SIGSEGV
    assert GONE in err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_to_the_whole_group_ends_the_run_as_always(run: GuardedRun, number: signal.Signals) -> None:
    process = run.started()
    run.wait_for_motion()
    os.killpg(process.pid, number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "GJ911" in err
    assert GONE not in err
    assert run.is_off()
