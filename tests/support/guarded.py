"""A process with a guard, which ends as ENDING says: python -m support.guarded ENDING FOLDER."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path
from typing import Any, cast

from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.driver.library import Library
from gusjob.controllers.gus.model import simulate_stream
from gusjob.hardware.guard.start import Guard, guarded
from gusjob.hardware.request import RunMode, RunOptions, RunRequest
from gusjob.i18n.language import set_language

NOT_USED = cast(Library, None)
"""A guard that only reports loads no library."""


def request_in(folder: Path, mode: RunMode = RunMode.JOB) -> RunRequest:
    """The request of a run that is only guarded."""
    stream, machine = stream_of(MARK + "LINE X 5\n"), Machine()
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    options = RunOptions(mode=mode)
    return RunRequest(path=folder / "part.job", stream=stream, trace=trace, machine=machine, options=options)


def end(ending: str, guard: Guard) -> None:
    """End this process, or return."""
    match ending:
        case "question":
            os._exit(5)
        case "closed":
            with guard.watching():
                pass
            os._exit(5)
        case "exception":
            with guard.watching():
                raise ZeroDivisionError
        case "normal":
            with guard.watching():
                return
    with guard.watching():
        match ending:
            case "exit":
                os._exit(5)
            case "segfault":
                os.kill(os.getpid(), signal.SIGSEGV)
            case "signalled":
                assert guard.process is not None
                for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
                    os.kill(guard.process.pid, number)
                time.sleep(0.1)
                os._exit(5)
            case "forked":
                if os.fork() == 0:
                    os.close(1)
                    os.close(2)
                    time.sleep(4)
                print(flush=True)
                os._exit(5)
            case "suspended":
                print(guard.process and guard.process.pid, flush=True)
                time.sleep(30)


def main() -> None:
    """Run with a guard, and end."""
    ending, folder = sys.argv[1], Path(sys.argv[2])
    set_language("zh" if ending == "chinese" else "en")
    modes = {"frame": RunMode.FRAME, "no-laser": RunMode.NO_LASER}
    request: Any = request_in(folder, modes.get(ending, RunMode.JOB))
    with guarded(request, NOT_USED, folder / "part.journal", 0.0) as guard:
        assert isinstance(guard, Guard), guard
        end("exit" if ending in (*modes, "chinese") else ending, guard)


if __name__ == "__main__":
    main()
