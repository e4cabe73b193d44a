"""The guard: what it reports when the process of a run has ended without a shutdown."""

from __future__ import annotations

import ast
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from support.controller import Fault, needs_controller
from support.guarded import NOT_USED, request_in
from support.hardware import EVERYTHING, Bench, fresh
from support.tools import ROOT, stream_of

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.hardware.guard import process, start
from gusjob.hardware.guard.start import Guard, guarded
from gusjob.hardware.outcome import Ending
from gusjob.hardware.request import Refusal, RunOptions, RunRequest
from gusjob.hardware.run import run_on

pytestmark = pytest.mark.skipif(os.name != "posix", reason="it ends processes as POSIX does")
GONE = "ended without a shutdown (it was killed or crashed): THE LASER MAY BE ON AND THE AXES MAY MOVE"


def environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}


def ended(ending: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a guarded process, until nobody has its standard error any more."""
    command = [sys.executable, "-m", "support.guarded", ending, str(folder)]
    return subprocess.run(command, env=environment(), capture_output=True, encoding="utf-8", timeout=30, check=False)


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize(("ending", "code"), [("exit", 5), ("segfault", -signal.SIGSEGV), ("signalled", 5)])
def test_a_process_that_ended_without_a_shutdown_is_reported(tmp_path: Path, ending: str, code: int) -> None:
    """Also if the guard got the signals that end a run."""
    done = ended(ending, tmp_path)
    assert done.returncode == code
    message = f"gusjob: the process that ran part.job {GONE}: use the emergency stop, then continue with --resume "
    assert done.stderr == f"\n{message}{tmp_path / 'part.journal'}\n"


@pytest.mark.parametrize("ending", ["question", "closed", "exception", "normal"])
def test_nothing_is_reported_if_the_controller_is_not_open(tmp_path: Path, ending: str) -> None:
    done = ended(ending, tmp_path)
    assert GONE not in done.stderr
    assert ("ZeroDivisionError" in done.stderr) == (ending == "exception")
    assert done.returncode == {"normal": 0, "exception": 1}.get(ending, 5)


def test_a_process_that_was_forked_does_not_hide_it(tmp_path: Path) -> None:
    """It has the pipe, too, so the pipe does not end."""
    assert GONE in ended("forked", tmp_path).stderr


@pytest.mark.parametrize(
    ("ending", "then"), [("no-laser", "--resume {} --no-laser\n"), ("frame", "then start again\n"), ("chinese", "{}")]
)
def test_the_message_says_how_to_go_on(tmp_path: Path, ending: str, then: str) -> None:
    done = ended(ending, tmp_path)
    assert then.format(tmp_path / "part.journal") in done.stderr
    assert ("ended without" in done.stderr) == (ending != "chinese")


def test_a_killed_process_is_reported_at_once_and_the_guard_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "support.guarded", "suspended", str(tmp_path)]
    run = subprocess.Popen(command, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert run.stdout is not None
    pid = int(run.stdout.readline())
    assert os.getsid(pid) == pid != os.getsid(run.pid)
    run.kill()
    began = time.monotonic()
    _, err = run.communicate(timeout=20)
    assert time.monotonic() - began < 2
    assert GONE in err
    until = time.monotonic() + 5
    while is_alive(pid) and time.monotonic() < until:  # Whoever adopted it reads its exit status.
        time.sleep(0.01)
    assert not is_alive(pid) or "Z" in Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2]


# In this process.


def guard_of(folder: Path) -> Guard:
    """Start a guard and end it."""
    with guarded(request_in(folder), NOT_USED, folder / "part.journal", 0.0) as guard:
        assert isinstance(guard, Guard)
        with guard.watching():
            assert guard.process is None or is_alive(guard.process.pid)
    return guard


def test_the_guard_ends_with_the_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    guard = guard_of(tmp_path)
    assert guard.process is not None
    assert guard.process.returncode == 0
    assert not is_alive(guard.process.pid)
    assert capfd.readouterr() == ("", "")


def test_a_guard_that_was_killed_is_no_harm(tmp_path: Path) -> None:
    with guarded(request_in(tmp_path), NOT_USED, tmp_path / "part.journal", 0.0) as guard:
        assert isinstance(guard, Guard) and guard.process is not None
        guard.process.kill()
        with guard.watching():
            guard.process.wait()
    assert guard.process.returncode == -signal.SIGKILL


def test_a_guard_that_does_not_end_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "_END_S", 0.05)
    with guarded(request_in(tmp_path), NOT_USED, tmp_path / "part.journal", 0.0) as guard:
        assert isinstance(guard, Guard) and guard.process is not None
        os.kill(guard.process.pid, signal.SIGSTOP)
    assert guard.process.returncode == -signal.SIGKILL


@pytest.mark.parametrize(
    ("name", "is_python"),
    [
        ("python", True), ("python3", True), ("python3.13t", True), ("Python", True), ("pythonw.exe", True),
        ("python_d.exe", True), ("pypy3.11", True), ("", False), ("qgis-bin.exe", False), ("pythonservice.exe", False),
    ],
)  # fmt: skip
def test_only_python_is_started(monkeypatch: pytest.MonkeyPatch, name: str, is_python: bool) -> None:
    """An application that embeds Python would be started a second time."""
    monkeypatch.setattr(sys, "executable", f"/usr/bin/{name}" if name else name)
    assert start._can_start() == is_python
    monkeypatch.setattr(sys, "frozen", True, raising=False)
    assert not start._can_start()


def test_without_a_guard_a_job_is_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "executable", "")
    assert guard_of(tmp_path).process is None


def test_the_process_imports_only_the_standard_library() -> None:
    """It is started without site-packages; gusjob is imported late."""
    tree = ast.parse(Path(process.__file__).read_text(encoding="utf-8"))
    names = {alias.name for node in tree.body if isinstance(node, ast.Import) for alias in node.names}
    names |= {str(node.module) for node in tree.body if isinstance(node, ast.ImportFrom)}
    assert names - sys.stdlib_module_names == set()


def test_modules_of_the_current_folder_are_not_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "signal.py").write_text("raise SystemExit", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert guard_of(tmp_path).process is not None


def test_standard_output_is_closed_when_the_guard_is_ready() -> None:
    """What a library prints must not get into another file, which would get the free number."""
    argv = [sys.executable, "-I", "-S", str(process.__file__), str(os.getpid())]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as guard:
        assert guard.stdin is not None and guard.stdout is not None
        guard.stdin.write(b"{}\n")
        guard.stdin.flush()
        found, output = list[bytes](), guard.stdout
        reader = threading.Thread(target=lambda: found.append(output.read()))
        reader.start()
        reader.join(5)
        is_closed = not reader.is_alive()
        is_running, link = guard.poll() is None, Path(f"/proc/{guard.pid}/fd/1")
        target = os.path.realpath(link) if Path("/proc/self/fd").exists() else os.devnull
        guard.kill()
        reader.join()
    assert is_closed
    assert (found, is_running, target) == ([process.READY], True, os.devnull)


# Runs.


def request_of(gus: Bench, folder: Path) -> RunRequest:
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine())
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    options = RunOptions(library=str(gus.path), abi=Abi.GUS)
    return RunRequest(path=folder / "part.job", stream=stream, trace=trace, machine=machine, options=options)


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[bytes]:
    """Lines that are sent to guards."""
    lines: list[bytes] = []
    send = Guard._send

    def recorded(self: Guard, line: bytes) -> None:
        lines.append(line)
        send(self, line)

    monkeypatch.setattr(Guard, "_send", recorded)
    return lines


@needs_controller
def test_a_run_reports_to_its_guard_when_the_controller_is_open(gus: Bench, tmp_path: Path, sent: list[bytes]) -> None:
    fresh(gus, poll_us=3_000)
    seen: list[list[bytes]] = []

    def confirm(_plan: Any) -> bool:
        seen.append(sent[1:])
        return True

    assert run_on(request_of(gus, tmp_path), confirm=confirm).ending is Ending.DONE
    assert seen == [[]]
    assert sent[1:] == [process.OPENED, process.CLOSED, process.ENDED]
    gus.controller.fault(Fault.RETURN, "GT_Open", 1, 1, -6)
    assert run_on(request_of(gus, tmp_path), confirm=True).ending is Ending.FAILED
    assert sent[-3:] == [process.OPENED, process.CLOSED, process.ENDED]


@needs_controller
@pytest.mark.parametrize("program", ["no-program", "exit 1", "exec sleep 60"])
def test_a_run_whose_guard_can_not_be_started_is_refused(
    gus: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, program: str
) -> None:
    monkeypatch.setattr(start, "_START_S", 0.5)
    python = tmp_path / "python"
    if program != "no-program":
        python.write_text(f"#!/bin/sh\n{program}\n", encoding="utf-8")
        python.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(python))
    began = time.monotonic()
    outcome = run_on(request_of(gus, tmp_path), confirm=True)
    assert time.monotonic() - began < 5
    assert outcome.ending is Ending.REFUSED
    assert isinstance(outcome.refusal, Refusal)
    reason = "no such file or directory" if program == "no-program" else "it does not answer"
    assert f"can't start the guard process of this run: {reason}" in outcome.refusal.localized
    assert gus.controller.calls() == []
