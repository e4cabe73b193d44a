"""Start the guard of a run, and report to it when the controller is open."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from msgspec import Struct
from msgspec.structs import asdict

from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.gus.driver.requirements import outputs_of
from gusjob.hardware.guard.process import CLOSED, ENDED, OPENED, READY
from gusjob.hardware.guard.switch_off import SwitchOffOrders
from gusjob.hardware.locks import controller_lock
from gusjob.hardware.request import Refusal, RunMode, RunRequest
from gusjob.i18n.language import language
from gusjob.i18n.phrases import Phrase, localized, printable, reason_of
from gusjob.patterns import lazy_pattern

_PROGRAM = Path(__file__).with_name("process.py")
_INTERPRETER = lazy_pattern(r"(python|pypy)[\d.]*[a-z_]{0,2}(\.exe)?", re.IGNORECASE | re.ASCII)
"""Names of Python's program: in an application that embeds Python sys.executable may be the application."""
_START_S = 10.0
"""Longest time until the guard is ready."""
_END_S = 2.0
"""Longest time until it has ended."""


class Guard(Struct):
    """The guard of a run. `process` is None where none can be started."""

    process: subprocess.Popen[bytes] | None = None

    @contextmanager
    def watching(self) -> Iterator[None]:
        """Watch while the context lasts: the controller may be open."""
        self._send(OPENED)
        try:
            yield
        finally:
            self._send(CLOSED)

    def end(self) -> None:
        """End the process, which must not outlive the run."""
        if self.process is None:
            return
        self._send(ENDED)
        with suppress(OSError):
            _pipe(self.process.stdin).close()
        try:
            self.process.wait(_END_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()

    def _send(self, line: bytes) -> None:
        if self.process is not None:
            with suppress(OSError):  # The guard was killed.
                _pipe(self.process.stdin).write(line)
                _pipe(self.process.stdin).flush()

    def _has_started(self, orders: bytes) -> bool:
        """Send the guard its orders and wait until it is ready."""
        assert self.process is not None
        output, answer = _pipe(self.process.stdout), list[bytes]()
        self._send(orders)
        reader = threading.Thread(target=lambda: answer.append(output.read(len(READY))), daemon=True)
        reader.start()
        reader.join(_START_S)
        if reader.is_alive():
            self.process.kill()
            reader.join()
        output.close()
        return answer == [READY]


@contextmanager
def guarded(request: RunRequest, library: Library, journal: Path, start_s: float) -> Iterator[Guard | Refusal]:
    """Start a guard, and end it with the context.

    Args:
        request: the job.
        library: the library that the run calls.
        journal: the run's journal, for the message and for the guard's own calls.
        start_s: the start of the journal (time.perf_counter).

    Yields:
        The guard; a refusal if it can't be started. Such a computer lacks memory or processes, so that a run could end
        with the laser on, and without a report.
    """
    if not _can_start():
        yield Guard()
        return
    try:
        guard = Guard(_started())
    except OSError as error:
        yield _refusal(reason_of(error))
        return
    try:
        ready = guard._has_started(f"{json.dumps(_orders(request, library, journal, start_s))}\n".encode())
        yield guard if ready else _refusal(Phrase("it does not answer"))
    finally:
        guard.end()


def _can_start() -> bool:
    """Return whether sys.executable starts Python, so that it can start the guard."""
    is_python = _INTERPRETER.fullmatch(Path(sys.executable or "").name) is not None
    return is_python and not getattr(sys, "frozen", False) and _PROGRAM.is_file()


def _started() -> subprocess.Popen[bytes]:
    """Start the process, in a session of its own: Ctrl+C and a closed terminal end the run, not its guard."""
    utf8 = ("-X", "utf8") if sys.flags.utf8_mode else ()
    command = [sys.executable, "-I", "-S", *utf8, str(_PROGRAM), str(os.getpid())]
    apart: dict[str, Any] = {"start_new_session": True}
    if sys.platform == "win32":
        apart = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, **apart)


def _orders(request: RunRequest, library: Library, journal: Path, start_s: float) -> dict[str, Any]:
    """Return what the process needs. It has no texts of its own, since it does not import gusjob."""
    orders: dict[str, Any] = {"message": f"gusjob: {localized(_message(request, journal))}", "switch_off": None}
    if request.machine.controller.guard_switches_off:
        switch_off = asdict(_switch_off_orders(request, library, journal, start_s))
        orders |= {
            "switch_off": switch_off,
            "path": [str(Path(p).absolute()) for p in sys.path],
            "language": language(),
        }
    return orders


def _message(request: RunRequest, journal: Path) -> Phrase:
    """Return the message about a run that ended without a shutdown."""
    mode = request.options.mode
    resume = Phrase(
        "continue with --resume {journal}{options}",
        journal=printable(str(journal)),
        options=f" {mode.option}" if mode.option else "",
    )
    return Phrase(
        "the process that ran {job} ended without a shutdown (it was killed or crashed): THE LASER MAY BE ON AND THE "
        "AXES MAY MOVE: use the emergency stop, then {next}",
        job=printable(request.path.name),
        next=Phrase("start again") if mode is RunMode.FRAME else resume,
    )


def _switch_off_orders(request: RunRequest, library: Library, journal: Path, start_s: float) -> SwitchOffOrders:
    controller, outputs = request.machine.controller, outputs_of(request.stream)
    return SwitchOffOrders(
        library=library.path,
        abi=library.abi,
        card=controller.card,
        open_channel=controller.open_channel,
        open_param=controller.open_param,
        call_timeout_s=controller.call_timeout_s,
        link_patience_s=controller.link_patience_s,
        channels=outputs.channels,
        crds=outputs.crds,
        axes=outputs.axes,
        journal=str(journal.resolve()),
        start_s=start_s,
        job=str(request.path.resolve()),
        lock=controller_lock(library, controller).name,
    )


def _refusal(reason: str) -> Refusal:
    return Refusal(
        reason=Phrase(
            "can't start the guard process of this run: {reason}; check this computer's memory and its Python, then "
            "start again",
            reason=reason,
        )
    )


def _pipe(pipe: IO[bytes] | None) -> IO[bytes]:
    assert pipe is not None
    return pipe
