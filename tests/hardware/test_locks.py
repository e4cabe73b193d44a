"""A controller has one run at a time, and one run continues a journal."""

from __future__ import annotations

import os
import shutil
import stat
import threading
import time
from pathlib import Path
from typing import Any

import orjson
import pytest
from msgspec.structs import replace
from support.controller import GTS, GTS_MULTI, Fault, needs_controller
from support.hardware import ABIS, EVERYTHING, LONG, Bench, fresh
from support.tools import MARK, stream_of

from gusjob.config.machine import ControllerSettings, Machine
from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.gus.model import simulate_stream
from gusjob.hardware import locks
from gusjob.hardware.locks import HeldLock, RunLock, controller_lock
from gusjob.hardware.outcome import Ending, RunOutcome
from gusjob.hardware.request import Refusal, RunOptions, RunRequest, read_recorded_run
from gusjob.hardware.run import RunPlan, run_on

pytestmark = needs_controller
SHORT = MARK + "LINE X 5\n"
IS_ROOT = os.name == "posix" and os.geteuid() == 0


@pytest.fixture(autouse=True)
def folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The folder of the locks, for this test alone."""
    path = tmp_path / "locks"
    monkeypatch.setattr(locks, "LOCK_FOLDER", path)
    return path


@pytest.fixture(autouse=True)
def _poll_often(gus: Bench) -> None:
    fresh(gus, poll_us=3_000)


def request_of(bench: Bench, folder: Path, text: str = SHORT, **options: Any) -> RunRequest:
    stream, machine = stream_of(text), bench.machine(Machine())
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    given = RunOptions(**({"library": str(bench.path), "abi": ABIS[bench.abi]} | options))
    return RunRequest(path=folder / "part.job", stream=stream, trace=trace, machine=machine, options=given)


class MeanwhileRun:
    """Confirms a run, and while that is asked tries another one."""

    def __init__(self, other: RunRequest) -> None:
        self.other, self.outcomes, self.calls = other, list[RunOutcome](), list[str]()

    def __call__(self, plan: RunPlan) -> bool:
        thread = threading.Thread(target=lambda: self.outcomes.append(run_on(self.other, confirm=True)))
        thread.start()
        thread.join()
        return True

    @property
    def outcome(self) -> RunOutcome:
        (outcome,) = self.outcomes
        return outcome


def is_held(lock: RunLock) -> bool:
    taken = lock.acquire("other.job")
    if taken is not None:
        taken.release()
    return taken is None


def took(lock: RunLock, job: str = "part.job") -> HeldLock:
    held = lock.acquire(job)
    assert held is not None
    return held


LOCK = RunLock(name="test", what="a test")


# Runs.


def test_a_second_run_on_a_controller_is_refused(gus: Bench, tmp_path: Path) -> None:
    meanwhile = MeanwhileRun(request_of(gus, tmp_path, EVERYTHING, journal=tmp_path / "second.journal"))
    first = run_on(request_of(gus, tmp_path), confirm=meanwhile)
    assert (first.ending, first.diagnostics, len(gus.controller.rows())) == (Ending.DONE, (), 1)
    second = meanwhile.outcome
    assert (second.ending, second.journal, second.is_safe) == (Ending.BUSY, None, True)
    (found,) = second.diagnostics
    assert (found.rule.code, found.path) == ("GJ918", str(tmp_path / "part.job"))
    assert f"process {os.getpid()}, which runs {tmp_path / 'part.job'}" in found.message
    assert str(gus.path) in found.message
    assert not (tmp_path / "second.journal").exists()


def test_the_lock_is_free_after_a_run_however_it_ended(gus: Bench, tmp_path: Path, folder: Path) -> None:
    def fail(_plan: RunPlan) -> bool:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_on(request_of(gus, tmp_path), confirm=fail)
    assert run_on(request_of(gus, tmp_path), confirm=lambda _plan: False).ending is Ending.DECLINED
    gus.controller.fault(Fault.RETURN, "GT_LnXY", 1, 1, 7)
    assert run_on(request_of(gus, tmp_path), confirm=True).ending is Ending.FAILED
    assert run_on(request_of(gus, tmp_path), confirm=True).ending is Ending.DONE
    assert [path.suffix for path in folder.iterdir()] == [".last"]


def test_two_runs_can_not_continue_one_journal(gus: Bench, tmp_path: Path) -> None:
    """Not even on two controllers."""
    first = run_on(request_of(gus, tmp_path), confirm=lambda _plan: False)
    assert first.journal is not None
    recorded = read_recorded_run(first.journal)
    other = Bench(Path(shutil.copy(gus.path, tmp_path / "other.so")), tmp_path)
    meanwhile = MeanwhileRun(request_of(other, tmp_path, resume=recorded))
    assert run_on(request_of(gus, tmp_path, resume=recorded), confirm=meanwhile).ending is Ending.DONE
    assert meanwhile.outcome.ending is Ending.BUSY
    message = meanwhile.outcome.diagnostics[0].message
    assert f"the journal {first.journal} is in use by process {os.getpid()}" in message
    assert other.controller.calls() == []


def test_a_journal_that_was_continued_before_it_was_locked_is_refused(gus: Bench, tmp_path: Path) -> None:
    """Both runs read it before either was started."""
    first = run_on(request_of(gus, tmp_path, LONG), confirm=lambda _plan: False)
    assert first.journal is not None
    recorded = read_recorded_run(first.journal)
    done = run_on(request_of(gus, tmp_path, LONG, resume=recorded), confirm=True)
    assert done.ending is Ending.DONE
    rows = len(gus.controller.rows())
    again = run_on(request_of(gus, tmp_path, LONG, resume=recorded), confirm=True)
    assert again.ending is Ending.REFUSED
    assert again.refusal is not None
    assert f"resume {done.journal}" in again.refusal.localized
    assert len(gus.controller.rows()) == rows


# What is the same controller.


def lock_of(library: Library, **controller: Any) -> RunLock:
    return controller_lock(library, ControllerSettings(**controller))


def library_of(bench: Bench, path: Path, card: int = 0) -> Library:
    machine = bench.machine(Machine(), card=card)
    return replace(bench.library(stream_of(SHORT), machine), path=str(path))


def test_links_are_the_same_library_and_copies_are_not(gus: Bench, tmp_path: Path) -> None:
    (tmp_path / "symbolic.so").symlink_to(gus.path)
    hard = gus.path.with_name("hard.so")
    hard.hardlink_to(gus.path)
    shutil.copy(gus.path, tmp_path / "copy.so")
    paths = (gus.path, tmp_path / "symbolic.so", hard, tmp_path / "copy.so")
    names = [lock_of(library_of(gus, path)).name for path in paths]
    hard.unlink()
    assert names[0] == names[1] == names[2] != names[3]


def test_a_library_that_the_system_searches_for_is_its_file(gus: Bench) -> None:
    assert lock_of(library_of(gus, Path("gts.dll"))).name == lock_of(library_of(gus, gus.path)).name


def test_a_library_whose_file_is_not_known_is_its_name(gus: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "file_of", lambda _library: None)
    names = [lock_of(library_of(gus, Path(name))).name for name in ("gts.dll", "gts.dll", "other.dll")]
    assert names[0] == names[1] != names[2]


def test_channels_and_cards_are_different_controllers(benches: dict[int, Bench]) -> None:
    single, several = benches[GTS], benches[GTS_MULTI]
    library = library_of(single, single.path)
    assert lock_of(library, open_channel=1).name != lock_of(library).name
    # A library of one card ignores the profile's number.
    assert lock_of(library_of(single, single.path, card=1), card=1).name == lock_of(library).name
    names = {lock_of(library_of(several, several.path, card=card), card=card).name for card in (0, 1)}
    assert len(names) == 2


# Where locking fails.


def refusal(gus: Bench, tmp_path: Path) -> str:
    outcome = run_on(request_of(gus, tmp_path, journal=tmp_path / "new.journal"), confirm=True)
    assert outcome.ending is Ending.REFUSED
    assert isinstance(outcome.refusal, Refusal)
    assert gus.controller.calls() == []
    assert not (tmp_path / "new.journal").exists()
    return outcome.refusal.localized


def test_a_folder_that_can_not_be_made_is_refused(gus: Bench, tmp_path: Path, folder: Path) -> None:
    folder.write_text("a file", encoding="utf-8")
    message = refusal(gus, tmp_path)
    assert message.startswith(f"{folder}: can't lock the controller of {gus.path}")
    assert "not a directory" in message
    assert "Let all users of this computer write to this folder" in message


@pytest.mark.skipif(IS_ROOT, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(gus: Bench, tmp_path: Path, folder: Path) -> None:
    folder.mkdir(mode=0o555)
    assert "permission denied" in refusal(gus, tmp_path)


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), OSError(30, "Read-only file system")])
def test_an_error_of_the_system_is_refused(
    gus: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: OSError
) -> None:
    def fail(*_args: object, **_options: object) -> bool:
        raise error

    monkeypatch.setattr("filelock.lock_descriptor", fail)
    assert str(error.strerror).lower() in refusal(gus, tmp_path)


@pytest.mark.parametrize("name", ["path", "folder"])
def test_links_in_the_shared_folder_are_not_followed(gus: Bench, tmp_path: Path, folder: Path, name: str) -> None:
    """Any user could have made one there."""
    victim = tmp_path / "victim"
    if name == "folder":
        victim.mkdir()
        folder.symlink_to(victim)
    else:
        folder.mkdir()
        victim.touch()
        lock_of(library_of(gus, gus.path)).path.symlink_to(victim)
    refusal(gus, tmp_path)
    assert name == "path" or list(victim.iterdir()) == []


# The lock itself.


def test_a_lock_is_held_once(folder: Path) -> None:
    held = took(LOCK)
    assert is_held(LOCK)
    assert not is_held(replace(LOCK, name="another"))
    held.release()
    assert not is_held(LOCK)
    assert list(folder.iterdir()) == []


def test_files_that_a_killed_process_left_do_not_block(folder: Path) -> None:
    folder.mkdir()
    LOCK.path.touch()
    LOCK.holder_path.write_bytes(orjson.dumps({"pid": 1, "job": 99 * "killed.job"}))
    held = took(LOCK)
    assert "part.job" in LOCK.holder()
    held.release()


def test_all_users_can_write_the_files_whatever_the_umask_is(folder: Path) -> None:
    before = os.umask(0o077)
    try:
        held = took(LOCK)
    finally:
        os.umask(before)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o1777
    assert {stat.S_IMODE(path.stat().st_mode) for path in folder.iterdir()} == {0o666}
    assert len(list(folder.iterdir())) == 2
    held.release()


def test_one_thread_at_a_time_has_a_lock_that_comes_and_goes() -> None:
    """The file is removed at each release: nobody may hold one that is removed."""
    inside, most, times = list[int](), list[int](), list[int]()

    def work(number: int) -> None:
        until = time.monotonic() + 20  # However busy the computer is.
        while len(times) <= 300 and time.monotonic() < until:
            if (held := LOCK.acquire("part.job")) is not None:
                inside.append(number)
                most.append(len(inside))
                time.sleep(0)
                inside.remove(number)
                times.append(number)
                held.release()

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(most) == 1
    assert len(times) > 20


@pytest.mark.parametrize(
    "text",
    [b"", b"{", b"[]", b"3", b'{"pid":1}', b'{"pid":"1","job":"x"}', b'{"pid":1,"job":null}', b"\xff\xfe", b"[" * 9000],
)
def test_a_damaged_holder_is_another_process(text: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(locks, "_SLEEP_S", 0.0)
    held = took(LOCK)
    LOCK.holder_path.write_bytes(text)
    assert LOCK.holder() == "another process"
    LOCK.holder_path.unlink()
    assert LOCK.holder() == "another process"
    held.release()


def test_the_name_of_a_job_can_not_control_the_terminal() -> None:
    held = took(LOCK, "part\x1b[2J\udcff.job")
    assert LOCK.holder().endswith("which runs part�[2J�.job")
    LOCK.holder_path.write_bytes(orjson.dumps({"pid": 7, "job": "\r\nerror"}))
    assert LOCK.holder().isprintable()
    held.release()


def test_a_long_name_is_cut() -> None:
    held = took(LOCK, "ä" * 5000)
    assert "ää" in LOCK.holder()
    held.release()


def test_a_holder_that_comes_late_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    held = took(LOCK)
    text = LOCK.holder_path.read_bytes()
    LOCK.holder_path.write_bytes(b"")
    monkeypatch.setattr(time, "sleep", lambda _s: LOCK.holder_path.write_bytes(text))
    assert f"process {os.getpid()}" in LOCK.holder()
    held.release()


def test_a_holder_file_of_another_name_is_not_overwritten(tmp_path: Path, folder: Path) -> None:
    """Otherwise a hard link that another user made could empty a file of this user."""
    folder.mkdir()
    own = tmp_path / "own"
    own.write_text("own text", encoding="utf-8")
    LOCK.holder_path.hardlink_to(own)
    held = took(LOCK)
    assert own.read_text(encoding="utf-8") == "own text"
    held.release()
