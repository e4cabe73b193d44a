"""The program of the guard process: wait until the run ends, and report one that ended without a shutdown.

It is started as a file, isolated and without site-packages, and imports only the standard library, so that it is ready
in some ms and needs little memory. (`python -m` would search the current folder first, where a file of the user may
have the name of a module.) gusjob is imported only if the controller is to be switched off.

It reads lines from standard input: the orders as JSON, then OPENED and CLOSED as the controller is opened and closed,
and ENDED. If the pipe or the parent process ends without ENDED, the run has ended without a shutdown: the system closes
the pipes of a process that ends.
"""

from __future__ import annotations

import json
import os
import select
import signal
import sys
from contextlib import suppress
from typing import Any

OPENED, CLOSED, ENDED = b"opened\n", b"closed\n", b"ended\n"
READY = b"ready\n"
_IGNORED = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGBREAK")
"""Signals that end a run, but not its guard: they are often sent to all processes."""
_POLL_S = 0.5
_INPUT, _OUTPUT = 0, 1


def main() -> None:
    """Guard one run."""
    for name in _IGNORED:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    orders, _, events = _received(int(sys.argv[1])).partition(b"\n")
    if not events.endswith(OPENED):
        return
    found: dict[str, Any] = json.loads(orders)
    _say(found["message"])
    if found["switch_off"] is not None:
        _switch_off(found)


def _received(parent: int) -> bytes:
    """Return all lines of the run when it has ended.

    Args:
        parent: the process of the run.
    """
    text, is_ready = b"", False
    # A process that the run forked keeps the pipe open, so the parent is watched, too: if it is the run, not a wrapper.
    parent = parent if os.getppid() == parent else 0
    while not text.endswith(ENDED):
        if _has_input():
            text += (chunk := os.read(_INPUT, 65536))
            if not chunk:
                break
        elif parent and os.getppid() != parent:
            break
        if not is_ready and b"\n" in text:
            is_ready = True
            _answer()
    return text


def _answer() -> None:
    """Report to the run that its guard is ready, and close the pipe."""
    with suppress(OSError):  # The run has ended already.
        os.write(_OUTPUT, READY)
    # Redirected before it is closed: else the next file would get its number, and what a library prints.
    nothing = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nothing, _OUTPUT)
    os.close(nothing)


def _has_input() -> bool:
    """Wait until there is input, or the end of it, or some time has passed."""
    if sys.platform == "win32":  # There select takes only sockets, and there is no fork.
        return True
    return bool(select.select([_INPUT], [], [], _POLL_S)[0])


def _switch_off(found: dict[str, Any]) -> None:
    """Switch the controller off with the modules that the run had."""
    import site

    try:
        site.main()  # Packages may be found by hooks that it installs.
        sys.path[:] = found["path"]
        from gusjob.hardware.guard.switch_off import switched_off

        messages = switched_off(found["switch_off"], found["language"])
    except BaseException as error:  # noqa: BLE001  (whatever it is, the user must know that nothing is certain)
        messages = [f"gusjob: the guard failed: {error!r}"]
    for message in messages:
        _say(message)
    os._exit(0)  # A call that hangs, or what the library does at an exit, must not keep the process.


def _say(message: str) -> None:
    """Print a message. The display of the run may have left the cursor in a line."""
    with suppress(OSError, ValueError):  # The terminal or pipe is closed.
        print(f"\n{message}", file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
