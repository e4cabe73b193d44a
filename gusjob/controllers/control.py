"""What the user wants of a run, and what a run tells of itself: the only things that its threads share.

Signal handlers set the wishes, perhaps within another call of the same function: nothing in here takes a lock.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum

_SLICE_S = 0.002
"""How soon a wish ends a nap."""


class Phase(StrEnum):
    """What a run is doing."""

    OPENING = "opening"
    FILLING = "filling"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    STOPPED = "stopped"
    DONE = "done"


@dataclass(frozen=True, slots=True, kw_only=True)
class RunStatus:
    """How a run stands. `row`: of the whole job, the first one not done; `sent`: the first one not sent."""

    phase: Phase = Phase.OPENING
    row: int = 0
    sent: int = 0
    x_pulse: float = 0.0
    y_pulse: float = 0.0
    queued: int = 0
    slots: int = 0


@dataclass(slots=True)
class Control:
    """Wishes, set by keys and signals; `asked` tells a run quickly that there is one."""

    asked: bool = False
    stop: int = 0
    """0 no, 1 smoothly, 2 abruptly."""
    who: str = ""
    pause: bool = False
    wishes: int = 0
    """How many there were: a nap ends with a new one."""
    view: RunStatus = RunStatus()

    def ask_stop(self, who: str, *, abrupt: bool = False) -> None:
        """Stop: smoothly at the first time, abruptly at the second."""
        self.who = self.who or who
        self.stop = 2 if abrupt or self.stop else 1
        self._ask()

    def ask_pause(self) -> None:
        """Pause, or go on."""
        self.pause = not self.pause
        self._ask()

    def _ask(self) -> None:
        self.asked = bool(self.stop or self.pause)
        self.wishes += 1

    def nap(self, seconds: float) -> None:
        """Wait, but not beyond a new wish."""
        until, wishes = time.perf_counter() + seconds, self.wishes
        while self.wishes == wishes and (left := until - time.perf_counter()) > 0:
            time.sleep(min(left, _SLICE_S))
