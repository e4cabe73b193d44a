"""The guard switches a controller off, if the profile says so, and reports what the calls confirmed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import asdict, replace
from support.controller import Fault, needs_controller
from support.guarded import request_in
from support.hardware import EVERYTHING, Bench, fresh, journal_head
from support.tools import stream_of

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.gus.driver.library import Library, load_library
from gusjob.controllers.gus.driver.requirements import RUN_CALLS
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.path_position import JOB_START
from gusjob.controllers.journal.writer import Journal, mark_resumed
from gusjob.hardware import locks
from gusjob.hardware.guard import process, start, switch_off
from gusjob.hardware.guard.switch_off import SwitchOffOrders, switched_off
from gusjob.hardware.locks import RunLock
from gusjob.hardware.request import RunOptions, RunRequest
from gusjob.i18n.language import set_language

pytestmark = needs_controller
CONFIRMED = "gusjob: the guard switched the controller off: it confirmed that every laser is off and nothing moves"
NOT_DONE = "gusjob: the guard could not switch the controller off: "


@pytest.fixture(autouse=True)
def _own_locks(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    monkeypatch.setattr(locks, "LOCK_FOLDER", tmp_path / "locks")
    monkeypatch.setattr(switch_off, "_LOCK_S", 0.05)
    yield
    set_language("en")


@pytest.fixture
def orders(gus: Bench, tmp_path: Path) -> dict[str, Any]:
    """The orders of a run's guard."""
    fresh(gus)
    stream, machine = stream_of(EVERYTHING), gus.machine(Machine(), call_timeout_s=0.1)
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    options = RunOptions(library=str(gus.path), abi=Abi.GUS)
    request = RunRequest(path=tmp_path / "part.job", stream=stream, trace=trace, machine=machine, options=options)
    run = Journal(tmp_path / "part.journal", journal_head(JOB_START, stream))
    run.close()
    made = start._switch_off_orders(request, gus.library(stream, machine), run.path, run.start_s)
    found: dict[str, Any] = json.loads(json.dumps(asdict(made)))
    return found


def library_for(orders: dict[str, Any]) -> Library:
    library, _ = load_library(orders["library"], Abi(orders["abi"]), 0, RUN_CALLS)
    assert library is not None
    return library


def journal(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "part.journal").read_text(encoding="utf-8").splitlines()]


def test_the_calls_of_a_shutdown_are_made_and_recorded(gus: Bench, tmp_path: Path, orders: dict[str, Any]) -> None:
    assert switched_off(orders, "en") == [CONFIRMED]
    names = [
        "GT_Open", "GT_ClrSts", "GT_SetHSIOOpt", "GT_SetHSIOOpt", "GT_Stop", "GT_CrdStatus", "GT_CrdStatus",
        "GT_SetHSIOOpt", "GT_SetHSIOOpt", "GT_Close",
    ]  # fmt: skip
    assert gus.controller.names() == names
    _, *lines = journal(tmp_path)
    assert [line["call"] for line in lines if "call" in line] == names
    # What a resume needs: when the laser may have gone off first, and when the motion was at rest.
    (off_s,), (rest_s,) = ([line["t"] for line in lines if name in line] for name in ("off", "rest"))
    assert 0 < off_s < rest_s < off_s + 1
    assert list((tmp_path / "locks").iterdir()) == []


def test_paths_that_are_not_utf8_come_through_the_pipe(orders: dict[str, Any], tmp_path: Path) -> None:
    request = request_in(tmp_path / "\udcff")
    machine = replace(request.machine, controller=replace(request.machine.controller, guard_switches_off=True))
    library = library_for(orders)
    with start.guarded(replace(request, machine=machine), library, tmp_path / "\udcff.journal", 0.0) as guard:
        assert isinstance(guard, start.Guard)


def test_orders_come_through_a_pipe_unchanged(orders: dict[str, Any]) -> None:
    given = SwitchOffOrders(**orders)
    assert (given.outputs.channels, given.outputs.crds, given.outputs.axes) == ((0, 1), (1,), (1, 2))


def test_it_speaks_the_language_of_the_run(orders: dict[str, Any]) -> None:
    (message,) = switched_off(orders, "zh")
    assert "激光" in message


def test_the_controller_of_another_run_is_left_alone(gus: Bench, orders: dict[str, Any]) -> None:
    held = RunLock(name=orders["lock"], what="").acquire("other.job")
    assert held is not None
    assert switched_off(orders, "en") == [f"{NOT_DONE}it is in use by process {os.getpid()}, which runs other.job"]
    held.release()
    assert gus.controller.calls() == []


def test_without_a_lock_no_call_is_made(gus: Bench, tmp_path: Path, orders: dict[str, Any]) -> None:
    (tmp_path / "locks").write_text("a file", encoding="utf-8")
    assert switched_off(orders, "en") == [f"{NOT_DONE}not a directory"]
    assert gus.controller.calls() == []


def test_a_library_of_another_abi_gets_no_further_call(gus: Bench, orders: dict[str, Any]) -> None:
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 1, -1, 7)
    (message,) = switched_off(orders, "en")
    assert message.startswith(f"{NOT_DONE}the library {gus.path} does not match --abi gus")
    assert gus.controller.names() == ["GT_Open", "GT_ClrSts"]


def test_a_controller_that_is_open_already_is_switched_off_all_the_same(gus: Bench, orders: dict[str, Any]) -> None:
    gus.controller.fault(Fault.AFTER, "GT_Open", 1, 1, 1)
    assert switched_off(orders, "en") == [CONFIRMED]


def test_a_library_that_can_not_be_loaded_is_reported(orders: dict[str, Any]) -> None:
    (message,) = switched_off(orders | {"library": "/no/gts.so"}, "en")
    assert message == f"{NOT_DONE}can't load the library /no/gts.so: there is no such file"


def test_what_was_not_confirmed_is_not_reported_as_off(gus: Bench, orders: dict[str, Any]) -> None:
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", 1, -1, 7)
    messages = switched_off(orders, "en")
    assert CONFIRMED not in messages
    assert any("THE LASER OF CHANNEL 0 MAY BE ON" in message for message in messages)
    assert "GT_Reset" in gus.controller.names()


@pytest.mark.parametrize("call", ["GT_Open", "GT_ClrSts", "GT_SetHSIOOpt", "GT_Stop", "GT_CrdStatus", "GT_Close"])
def test_a_call_that_hangs_does_not_keep_the_guard(gus: Bench, orders: dict[str, Any], call: str) -> None:
    gus.controller.fault(Fault.HANG, call, 1, -1)
    began = time.monotonic()
    messages = switched_off(orders, "en")
    assert time.monotonic() - began < 3
    count = len(gus.controller.calls())
    gus.controller.release()
    time.sleep(0.05)
    assert len(gus.controller.calls()) <= count + 1  # The one that hung; no other one follows it.
    if call == "GT_Close":
        assert messages == [CONFIRMED]
    else:
        assert CONFIRMED not in messages
        assert any("THE LASER OF CHANNEL 1 MAY BE ON" in message and call in message for message in messages)
        assert any("the motion may still continue" in message for message in messages)


def test_a_library_that_hangs_when_it_is_loaded(orders: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(switch_off, "load_library", lambda *_: time.sleep(2))
    began = time.monotonic()
    assert switched_off(orders, "en") == [f"{NOT_DONE}loading the library takes too long"]
    assert time.monotonic() - began < 1.5


def test_a_full_disk_does_not_keep_the_laser_on(gus: Bench, tmp_path: Path, orders: dict[str, Any]) -> None:
    assert switched_off(orders | {"journal": str(tmp_path / "no" / "part.journal")}, "en") == [
        CONFIRMED,
        "gusjob: the journal does not have these calls: continue with --from-line N, not with --resume",
    ]
    assert "GT_Stop" in gus.controller.names()


def test_a_run_that_was_continued_in_the_meantime_is_left_alone(
    gus: Bench, tmp_path: Path, orders: dict[str, Any]
) -> None:
    """Its journal ends with the one that continues it: no line may follow."""
    mark_resumed(tmp_path / "part.journal", tmp_path / "next.journal")
    before = (tmp_path / "part.journal").read_bytes()
    (message,) = switched_off(orders, "en")
    assert message == f"{NOT_DONE}another run has continued the journal"
    assert gus.controller.calls() == []
    assert (tmp_path / "part.journal").read_bytes() == before


def test_a_bug_is_reported(orders: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(switch_off, "load_library", fail)
    (message,) = switched_off(orders, "en")
    assert message == f"{NOT_DONE}ZeroDivisionError('a bug')"


def test_modules_that_are_not_found_are_reported(orders: dict[str, Any]) -> None:
    """As when gusjob is removed during a run."""
    found = {"message": "gone", "switch_off": orders, "path": [], "language": "en"}
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(process.__file__), str(os.getpid())], input=json.dumps(found) + "\nopened\n",
        capture_output=True, text=True, timeout=20, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, "ready\n")
    assert done.stderr.startswith("\ngone\n\ngusjob: the guard failed: ModuleNotFoundError(")
