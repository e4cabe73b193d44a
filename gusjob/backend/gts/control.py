"""What the user wants of a run, and what a run tells of itself: the only things that its two threads share."""

from __future__ import annotations

import threading
from dataclasses import dataclass, field
from enum import StrEnum


class Phase(StrEnum):
    """What a run is doing."""

    OPENING = "opening"
    FILLING = "filling"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    DONE = "done"


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
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
    wake: threading.Event = field(default_factory=threading.Event)
    view: View = View()

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
        self.wake.set()

    def nap(self, seconds: float) -> None:
        """Wait, but not beyond a wish."""
        self.wake.wait(seconds)
        self.wake.clear()
