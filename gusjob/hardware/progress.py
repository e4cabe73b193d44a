"""The progress of a run as figures, and when they are due. Other modules display them.

The run works in another thread, which sends calls one by one: a tick in which nothing is due must cost next to nothing.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import PurePath
from typing import Protocol

import numpy as np
from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase, RunStatus
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.hardware.forecast import Forecast
from gusjob.kinematics.arrays import Indices

MAY_EMIT = (Phase.FILLING, Phase.RUNNING)
"""Phases in which a laser can be on."""


class PlannedPower(Struct, frozen=True, kw_only=True):
    """The power of a laser that is planned for now. `power`: NaN without emission."""

    channel: int
    unit: str
    power: float


class Progress(Struct, frozen=True, kw_only=True):
    """The progress of a run.

    `location`: file:line, '' if there is none; `elapsed_s`: without pauses; `done_ms`, `total_ms`: planned time;
    `doubling_mm`: length of the marks that may be made twice when a paused run continues.
    """

    job: str
    phase: Phase
    row: int
    rows: int
    segment: int
    segments: int
    location: str
    x_mm: float
    y_mm: float
    queued: int
    slots: int
    elapsed_s: float
    done_ms: float
    total_ms: float
    lasers: tuple[PlannedPower, ...]
    doubling_mm: float = 0.0

    @property
    def share(self) -> float:
        """The done part of the planned time, 0 to 1."""
        if self.total_ms > 0:
            return min(self.done_ms / self.total_ms, 1.0)
        return float(self.row >= self.rows)

    @property
    def line(self) -> int | None:
        """The line in its file, None if there is none."""
        number = self.location.rpartition(":")[2]
        return int(number) if number.isdecimal() else None


class ProgressMeter(Struct, frozen=True, kw_only=True, eq=False):
    """Computes the progress from the status of a run. `timed_before` (n+1,): number of timed calls before each row."""

    control: Control
    forecast: Forecast
    stream: Stream
    machine: Machine
    locate_row: Callable[[int], str]
    timed_before: Indices

    @staticmethod
    def of(
        control: Control, forecast: Forecast, stream: Stream, machine: Machine, locate_row: Callable[[int], str]
    ) -> ProgressMeter:
        """Make the meter of a run. `locate_row`: returns file:line of a row."""
        before = np.concatenate([[0], np.cumsum(stream.buffered.kind <= Buffered.DELAY)])
        return ProgressMeter(
            control=control,
            forecast=forecast,
            stream=stream,
            machine=machine,
            locate_row=locate_row,
            timed_before=before,
        )

    def read(self, status: RunStatus, elapsed_s: float) -> Progress:
        """Compute the progress of a status."""
        rows, (per_x, per_y) = len(self.stream.buffered), self.machine.pulses_per_mm
        row = min(max(status.row, 0), rows)
        return Progress(
            job=PurePath(self.stream.name).name,
            phase=status.phase,
            row=row,
            rows=rows,
            segment=int(self.timed_before[row]),
            segments=int(self.timed_before[-1]),
            location=self.locate_row(min(row, rows - 1)) if rows else "",
            x_mm=status.x_pulse / per_x,
            y_mm=status.y_pulse / per_y,
            queued=status.queued,
            slots=status.slots,
            elapsed_s=elapsed_s,
            done_ms=self.forecast.done_ms(row),
            total_ms=self.forecast.duration_ms,
            doubling_mm=status.doubling_mm,
            lasers=self._lasers(row, may_emit=row < rows and status.phase in MAY_EMIT),
        )

    def _lasers(self, row: int, *, may_emit: bool) -> tuple[PlannedPower, ...]:
        """Return the planned powers at a row; none where no job is running."""
        return tuple(
            PlannedPower(channel=c.channel, unit=c.unit, power=self.forecast.power(c, row) if may_emit else math.nan)
            for c in self.forecast.channels
        )


class ProgressDisplay(Protocol):
    """Shows the progress of a run."""

    def tick(self) -> None:
        """Show the progress if that is due; called 50 times a second.

        Raises:
            OSError: the terminal or pipe is closed; the run is stopped then.
        """


Watch = Callable[[ProgressMeter], AbstractContextManager[ProgressDisplay]]
"""Opens the display of a run."""


class ProgressTicker(Struct, kw_only=True):
    """Shows the progress at intervals, and with `phases_at_once` at each change of phase.

    `on_tick` is called first in every tick, for keys.
    """

    meter: ProgressMeter
    show: Callable[[Progress], None]
    every_s: float
    clock: Callable[[], float] = time.monotonic
    on_tick: Callable[[], None] | None = None
    phases_at_once: bool = True
    _elapsed_s: float = 0.0
    _last_s: float | None = None
    _paused: bool = False
    _due_s: float = -math.inf
    _shown_phase: Phase | None = None
    _shown_status: RunStatus | None = None

    def tick(self) -> None:
        """Show the progress if that is due."""
        if self.on_tick is not None:
            self.on_tick()
        status = self.meter.control.status
        now_s = self._measure(status.phase)
        changed = self._is_change(status.phase)
        if now_s >= self._due_s or (changed and self.phases_at_once):
            self._due_s = now_s + self.every_s
            self._shown_phase = status.phase if changed else self._shown_phase
            self._shown_status = status
            self.show(self.meter.read(status, self._elapsed_s))

    def end(self) -> None:
        """Show how the run ended, if the terminal or pipe is still there."""
        status = self.meter.control.status
        if status is not self._shown_status:
            self._measure(status.phase)
            with suppress(OSError):
                self.show(self.meter.read(status, self._elapsed_s))

    def _is_change(self, phase: Phase) -> bool:
        """Return whether the phase changed. A job of many stages fills and runs in turn; that is no change."""
        return phase is not self._shown_phase and (phase, self._shown_phase) != (Phase.FILLING, Phase.RUNNING)

    def _measure(self, phase: Phase) -> float:
        """Measure the elapsed time without pauses; return the present time."""
        now_s = self.clock()
        if self._last_s is not None and not self._paused:
            self._elapsed_s += now_s - self._last_s
        self._last_s, self._paused = now_s, phase is Phase.PAUSED
        return now_s


def report_to(callback: Callable[[Progress], None], every_s: float = 0.2) -> Watch:
    """Return a display that calls a function with the progress, in the thread that started the run.

    Args:
        callback: takes the progress. An exception of it stops the run and is raised again after the shutdown.
        every_s: interval; changes of phase are reported at once.
    """

    @contextmanager
    def watch(meter: ProgressMeter) -> Iterator[ProgressDisplay]:
        ticker = ProgressTicker(meter=meter, show=callback, every_s=every_s)
        yield ticker
        ticker.end()

    return watch
