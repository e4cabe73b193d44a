"""A run that does not move, with a clock that the test sets: what the panel and the progress lines show."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, redirect_stderr
from dataclasses import dataclass, field

from support.tools import MARK, stream_of

from gusjob.cli.run_display import run_display
from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase, RunStatus
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.model import simulate_stream
from gusjob.hardware.forecast import Forecast, forecast
from gusjob.hardware.progress import ProgressDisplay, ProgressMeter

MACHINE = Machine(pulses_per_mm=(1000.0, 500.0))
JOB = MARK + "LASER POWER 40\nJUMP X -10 Y 0\nLASER ON\nLINE X 10\nLASER OFF\nDWELL 60\nLASER ON\nLINE X 0\nLASER OFF\n"


class Terminal(io.StringIO):
    """Says that it is a terminal."""

    def isatty(self) -> bool:
        return True


@dataclass
class Bench:
    """A run that does not move, and its clock."""

    stream: Stream
    forecast: Forecast
    control: Control = field(default_factory=Control)
    now_s: float = 100.0
    path: str = "test.job"
    stderr: Terminal | None = None

    @contextmanager
    def watch(self, mode: str) -> Iterator[ProgressDisplay]:
        def line_of(row: int) -> str:
            return f"{self.path}:{self.stream.buffered.line[row]}"

        def clock() -> float:
            return self.now_s

        meter = ProgressMeter.of(self.control, self.forecast, self.stream, MACHINE, line_of)
        watching = run_display(mode, clock)(meter)
        with redirect_stderr(self.stderr) if self.stderr else nullcontext(), watching as watcher:
            yield watcher

    def be(self, phase: Phase, row: int = 0) -> None:
        self.control.status = RunStatus(
            phase=phase, row=row, sent=row, x_pulse=12340.0, y_pulse=-1500.0, queued=1024, slots=4096
        )

    def ticks(self, watcher: ProgressDisplay, seconds: float) -> None:
        """50 a second, as the runner does."""
        for _ in range(round(seconds * 50)):
            self.now_s += 0.02
            watcher.tick()


def bench_of_job(path: str = "test.job") -> Bench:
    """A bench for JOB."""
    stream = stream_of(JOB, MACHINE)
    trace, _ = simulate_stream(stream, MACHINE)
    assert trace is not None
    return Bench(stream, forecast(stream, trace, MACHINE), path=path)
