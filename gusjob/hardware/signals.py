"""Turn signals into requests to stop or pause, during a run."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

from gusjob.controllers.control import Control
from gusjob.i18n.phrases import Phrase

_ENDING = (
    "SIGINT",
    "SIGTERM",
    "SIGHUP",
    "SIGBREAK",
    "SIGQUIT",
    "SIGUSR1",
    "SIGUSR2",
    "SIGALRM",
    "SIGVTALRM",
    "SIGPROF",
    "SIGXCPU",
    "SIGIO",
    "SIGPWR",
)
"""Signals that would end the process without a shutdown."""


@contextmanager
def stop_on_signals(control: Control) -> Iterator[None]:
    """Turn Ctrl+C, the end of the session and a closed terminal into requests while the context lasts.

    Python handles signals in the main thread only: in another thread this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def on_ending(number: int, _frame: FrameType | None) -> None:
        # SIGINT comes twice if the user insists; the others mean that time is short.
        name = signal.Signals(number).name
        control.request_stop("Ctrl+C" if number == signal.SIGINT else name, abrupt=number != signal.SIGINT)

    def on_suspend(_number: int, _frame: FrameType | None) -> None:
        # A suspended process could not watch its laser: Ctrl+Z pauses the run instead, and continues it.
        control.suspend()

    def on_continue(_number: int, _frame: FrameType | None) -> None:
        control.resume()

    handlers: dict[str, Any] = dict.fromkeys(_ENDING, on_ending)
    handlers |= {"SIGTSTP": on_suspend, "SIGCONT": on_continue, "SIGTTOU": signal.SIG_IGN, "SIGTTIN": signal.SIG_IGN}
    numbers = {getattr(signal, name): handler for name, handler in handlers.items() if hasattr(signal, name)}
    before = {number: signal.signal(number, handler) for number, handler in numbers.items()}
    try:
        with _stop_on_closed_console(control):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _stop_on_closed_console(control: Control) -> Iterator[None]:
    """On Windows a closed console ends the process as soon as the handler returns: it waits for the shutdown."""
    if sys.platform != "win32":
        yield
        return
    import ctypes

    over = threading.Event()

    @ctypes.WINFUNCTYPE(ctypes.c_int, ctypes.c_ulong)
    def handler(event: int) -> int:
        if event < 2:  # Ctrl+C and Ctrl+Break come as signals.
            return 0
        control.request_stop(Phrase("the closed console"), abrupt=True)
        over.wait(10)
        return 1

    ctypes.windll.kernel32.SetConsoleCtrlHandler(handler, 1)
    try:
        yield
    finally:
        over.set()
        ctypes.windll.kernel32.SetConsoleCtrlHandler(handler, 0)
