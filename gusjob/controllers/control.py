"""The state that the threads of a run share: what the user requests, and the status that the run reports.

Signal handlers set the requests, perhaps while the same thread is inside one of these functions: nothing here takes a
lock.
"""

from __future__ import annotations

import time
from enum import IntEnum, StrEnum

from msgspec import Struct

_SLEEP_STEP_S = 0.002
"""Longest time until a new request ends a sleep."""


class Phase(StrEnum):
    """State of a run."""

    OPENING = "opening"
    FILLING = "filling"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    STOPPED = "stopped"
    DONE = "done"


class StopKind(IntEnum):
    """Requested kind of stop."""

    NONE = 0
    SMOOTH = 1
    """Decelerate along the path."""
    ABRUPT = 2
    """Stop at once."""


class PauseKind(IntEnum):
    """What paused a run."""

    NONE = 0
    USER = 1
    """A key, or toggle_pause(): only the user continues, since a laser must not come on by itself."""
    SUSPENDED = 2
    """SIGTSTP: SIGCONT continues, as without a terminal nobody could press a key."""


class RunStatus(Struct, frozen=True, kw_only=True):
    """The state of a run.

    `row`: the first row of the whole job that is not done; `sent`: the first one that is not sent; `queued`: calls in
    the FIFO; `slots`: calls that it can hold; `doubling_mm`: length of the marks that may be made twice when a paused
    run continues.
    """

    phase: Phase = Phase.OPENING
    row: int = 0
    sent: int = 0
    x_pulse: float = 0.0
    y_pulse: float = 0.0
    queued: int = 0
    slots: int = 0
    doubling_mm: float = 0.0


class Control(Struct):
    """Stops or pauses a run, from any thread or signal handler; `status` is what the run reports.

    Call request_stop() and toggle_pause(); suspend() and resume() are for signal handlers, the fields for the run.
    """

    requested: bool = False
    """Whether there is a request: all that the sending loop reads for each call."""
    stop: StopKind = StopKind.NONE
    stopped_by: str = ""
    pause: PauseKind = PauseKind.NONE
    request_count: int = 0
    """Number of requests so far: a sleep ends with a new one."""
    status: RunStatus = RunStatus()

    def request_stop(self, by: str, *, abrupt: bool = False) -> None:
        """Stop the run: smoothly at the first request, abruptly at the second.

        Args:
            by: who stops the run; the first one is named in the diagnostic.
            abrupt: stop abruptly at the first request.
        """
        self.stopped_by = self.stopped_by or by
        self.stop = StopKind.ABRUPT if abrupt or self.stop else StopKind.SMOOTH
        self._notify()

    def toggle_pause(self) -> None:
        """Pause the run, or continue it."""
        self._toggle_pause(PauseKind.USER)

    def suspend(self) -> None:
        """Pause the run until resume(), or continue it."""
        self._toggle_pause(PauseKind.SUSPENDED)

    def resume(self) -> None:
        """Continue a run that suspend() paused; any other pause remains."""
        if self.pause is PauseKind.SUSPENDED:
            self.pause = PauseKind.NONE
            self._notify()

    def _toggle_pause(self, kind: PauseKind) -> None:
        self.pause = PauseKind.NONE if self.pause else kind
        self._notify()

    def _notify(self) -> None:
        """Set `requested`, again if a signal handler or another thread made a request in the meantime."""
        self.request_count += 1
        count = 0
        while count != self.request_count:
            count = self.request_count
            self.requested = bool(self.stop or self.pause)

    def sleep(self, seconds: float) -> None:
        """Sleep until the time is over or a new request comes."""
        until, count = time.perf_counter() + seconds, self.request_count
        while self.request_count == count and (left := until - time.perf_counter()) > 0:
            time.sleep(min(left, _SLEEP_STEP_S))
