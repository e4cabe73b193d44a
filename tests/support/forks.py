"""Processes that are forked from one that has everything imported; each sends lines of JSON to it."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from support.tools import ROOT

Send = Callable[[dict[str, Any]], None]


@dataclass(slots=True)
class Fork:
    """A process that was forked, and the lines that it sends."""

    pid: int
    end: int
    text: bytes = b""

    def lines(self, until_s: float) -> Iterator[dict[str, Any]]:
        """Yield what it sends until a time (time.perf_counter) or until it ends."""
        while True:
            left_s = until_s - time.perf_counter()
            if left_s <= 0 or not select.select([self.end], [], [], min(left_s, 1e6))[0]:
                return
            if not (more := os.read(self.end, 65536)):
                return
            *whole, self.text = (self.text + more).split(b"\n")
            yield from (json.loads(line) for line in whole)

    def kill(self) -> None:
        """Kill it if it is alive."""
        os.kill(self.pid, signal.SIGKILL)  # It is not reaped yet, so the number is still its own.
        os.waitpid(self.pid, 0)


def fork(work: Callable[[Send], None], environment: dict[str, str]) -> Fork:
    """Do something in a fork. `work` takes a function that sends a line to this process."""
    read, write = os.pipe()
    sys.stdout.flush()
    pid = os.fork()
    if pid:
        os.close(write)
        return Fork(pid, read)
    try:
        os.close(read)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # Guards of runs that are killed say so.
        os.environ.update(environment)
        work(lambda line: _send(write, line))
    except BaseException:  # noqa: BLE001  (it is sent)
        _send(write, {"error": traceback.format_exc()})
    finally:
        os._exit(0)


def _send(end: int, line: dict[str, Any]) -> None:
    text = json.dumps(line).encode() + b"\n"
    while text:
        text = text[os.write(end, text) :]


def results(numbers: list[int], workers: int, run: Callable[[int], dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Run cases in several processes and yield their results as they come."""

    def work(mine: list[int]) -> Callable[[Send], None]:
        def loop(send: Send) -> None:
            for number in mine:
                send(run(number))

        return loop

    children = [fork(work(numbers[first::workers]), {}) for first in range(min(workers, len(numbers)))]
    by_end = {child.end: child for child in children}
    while by_end:
        for end in select.select(list(by_end), [], [])[0]:
            child = by_end[end]
            more = os.read(end, 65536)
            *whole, child.text = (child.text + more).split(b"\n")
            yield from (json.loads(line) for line in whole)
            if not more:
                os.waitpid(child.pid, 0)
                del by_end[end]


def cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def harness(module: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a module of tests/support as a command: it forks, which a process of pytest with its threads must not do."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "tests")])}
    command = [sys.executable, "-m", f"support.{module}", *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=1200)
