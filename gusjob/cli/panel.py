"""What a run on a controller tells while it goes on (a panel, lines, or JSON lines), and the keys that steer it.

The run works in another thread, which sends calls one by one: a tick in which nothing is due must cost next to nothing.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Protocol, TextIO

import numpy as np
import orjson

from gusjob.cli.keys import Keys
from gusjob.config.machine import Machine
from gusjob.controllers.control import Control, Phase, RunStatus
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.i18n.phrases import Phrase, localized, printable
from gusjob.kinematics.arrays import Indices

if TYPE_CHECKING:  # The interpreter and rich are imported by who needs them.
    from rich.console import Console, RenderableType
    from rich.live import Live
    from rich.table import Table
    from rich.text import Text

    from gusjob.hardware.forecast import Forecast

SCHEMA = "gusjob-progress/1"
_PANEL_S, _JSON_S, _LINES_S = 1 / 8, 1 / 5, 5.0
"""How long each is left as it is at least."""
_PANEL_WIDTH = 80
_PAUSE_KEYS, _STOP_KEYS = "p ", {"q": Phrase("key q"), "s": Phrase("key s"), "\x1b": Phrase("key Escape")}
_MAY_BE_LIT = (Phase.FILLING, Phase.RUNNING)
_PHASES = {
    Phase.OPENING: Phrase("opening"),
    Phase.FILLING: Phrase("filling"),
    Phase.RUNNING: Phrase("running"),
    Phase.PAUSED: Phrase("paused"),
    Phase.STOPPING: Phrase("stopping"),
    Phase.STOPPED: Phrase("stopped"),
    Phase.DONE: Phrase("done"),
}
_STYLES = {Phase.RUNNING: "bold green", Phase.PAUSED: "bold yellow", Phase.STOPPING: "bold red"}


class ProgressDisplay(Protocol):
    """Shows a run, and hears the keys, whenever it is told that time goes by."""

    def tick(self) -> None:
        """Heed keys, and show how the run stands if that is due. OSError: the terminal or pipe is closed."""


@contextmanager
def watch(
    mode: str,
    control: Control,
    forecast: Forecast,
    stream: Stream,
    machine: Machine,
    line_of: Callable[[int], str],
    clock: Callable[[], float] = time.monotonic,
) -> Iterator[ProgressDisplay]:
    """Show a run while the context lasts.

    `mode`: "auto" (a panel if stderr is a terminal, else lines), "lines" (stderr), "json" (stdout), "none". `line_of`:
    path:line of a row. Keys are heard with a panel and with lines.
    """
    if mode == "none":
        yield _NoDisplay()
        return
    gauge = ProgressMeter.of(control, forecast, stream, machine, line_of)
    with ExitStack() as stack:
        if mode == "json":
            ticker = _Ticker(gauge=gauge, show=_show_json, every_s=_JSON_S, clock=clock)
        else:
            keys = stack.enter_context(Keys())
            console = _terminal() if mode == "auto" else None
            if console is None:
                ticker = _Ticker(gauge=gauge, show=_show_line, every_s=_LINES_S, clock=clock, keys=keys)
            else:
                panel = _Panel.on(console, keys)
                stack.callback(panel.close)
                ticker = _Ticker(
                    gauge=gauge, show=panel.show, every_s=_PANEL_S, clock=clock, keys=keys, phases_at_once=False
                )
        stack.callback(ticker.end)
        yield ticker


# How a run stands.


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedPower:
    """A laser as it is planned at the moment. `power`: NaN where it is dark."""

    channel: int
    unit: str
    power: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Progress:
    """How a run stands. `place`: path:line, '' if there is none; `elapsed_s`: without pauses; _ms: planned time."""

    job: str
    phase: Phase
    row: int
    rows: int
    segment: int
    segments: int
    place: str
    x_mm: float
    y_mm: float
    queued: int
    slots: int
    elapsed_s: float
    done_ms: float
    total_ms: float
    lights: tuple[PlannedPower, ...]

    @property
    def share(self) -> float:
        """How much of the planned time is done, 0 to 1."""
        if self.total_ms > 0:
            return min(self.done_ms / self.total_ms, 1.0)
        return float(self.row >= self.rows)

    @property
    def line(self) -> int | None:
        """The line in its file, None if there is none."""
        number = self.place.rpartition(":")[2]
        return int(number) if number.isdecimal() else None


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgressMeter:
    """Makes figures of a View. `timed_before` (n+1,): how many timed calls stand before a row."""

    control: Control
    forecast: Forecast
    stream: Stream
    machine: Machine
    line_of: Callable[[int], str]
    timed_before: Indices

    @staticmethod
    def of(
        control: Control, forecast: Forecast, stream: Stream, machine: Machine, line_of: Callable[[int], str]
    ) -> ProgressMeter:
        """A gauge of a run."""
        before = np.concatenate([[0], np.cumsum(stream.buffered.kind <= Buffered.DELAY)])
        return ProgressMeter(
            control=control, forecast=forecast, stream=stream, machine=machine, line_of=line_of, timed_before=before
        )

    def read(self, view: RunStatus, elapsed_s: float) -> Progress:
        """How the run stands."""
        rows, (per_x, per_y) = len(self.stream.buffered), self.machine.pulses_per_mm
        row = min(max(view.row, 0), rows)
        return Progress(
            job=PurePath(self.stream.name).name,
            phase=view.phase,
            row=row,
            rows=rows,
            segment=int(self.timed_before[row]),
            segments=int(self.timed_before[-1]),
            place=self.line_of(min(row, rows - 1)) if rows else "",
            x_mm=view.x_pulse / per_x,
            y_mm=view.y_pulse / per_y,
            queued=view.queued,
            slots=view.slots,
            elapsed_s=elapsed_s,
            done_ms=self.forecast.done_ms(row),
            total_ms=self.forecast.duration_ms,
            lights=self._lights(row, lit=row < rows and view.phase in _MAY_BE_LIT),
        )

    def _lights(self, row: int, *, lit: bool) -> tuple[PlannedPower, ...]:
        """The lasers at a row; all are dark where no job is under way."""
        return tuple(
            PlannedPower(channel=c.channel, unit=c.unit, power=self.forecast.power(c, row) if lit else math.nan)
            for c in self.forecast.channels
        )


# Ticks.


class _NoDisplay:
    """Shows nothing."""

    def tick(self) -> None:
        """Nothing."""


@dataclass(slots=True, kw_only=True)
class _Ticker:
    """Shows a run every so often, and if `phases_at_once` as soon as it does something else."""

    gauge: ProgressMeter
    show: Callable[[Progress], None]
    every_s: float
    clock: Callable[[], float]
    keys: Keys | None = None
    phases_at_once: bool = True
    _elapsed_s: float = 0.0
    _last_s: float | None = None
    _paused: bool = False
    _due_s: float = -math.inf
    _told: Phase | None = None
    _shown: RunStatus | None = None

    def tick(self) -> None:
        """See Watch."""
        if self.keys is not None:
            self._heed(self.keys.pressed())
        view = self.gauge.control.status
        now_s = self._passed(view.phase)
        news = self._news(view.phase)
        if now_s >= self._due_s or (news and self.phases_at_once):
            self._due_s = now_s + self.every_s
            self._told = view.phase if news else self._told
            self._shown = view
            self.show(self.gauge.read(view, self._elapsed_s))

    def end(self) -> None:
        """Show how the run ended, if there is anyone to see it."""
        view = self.gauge.control.status
        if view is not self._shown:
            self._passed(view.phase)
            with suppress(OSError):
                self.show(self.gauge.read(view, self._elapsed_s))

    def _news(self, phase: Phase) -> bool:
        """Whether it does something else. A job of many stages fills and runs by turns; that is no news."""
        return phase is not self._told and (phase, self._told) != (Phase.FILLING, Phase.RUNNING)

    def _passed(self, phase: Phase) -> float:
        """Take the time, pauses left out; what o'clock it is."""
        now_s = self.clock()
        if self._last_s is not None and not self._paused:
            self._elapsed_s += now_s - self._last_s
        self._last_s, self._paused = now_s, phase is Phase.PAUSED
        return now_s

    def _heed(self, typed: str) -> None:
        """What the keys mean."""
        for key in typed.lower():
            if key in _PAUSE_KEYS:
                self.gauge.control.toggle_pause()
            elif key in _STOP_KEYS:
                self.gauge.control.request_stop(_STOP_KEYS[key])


# JSON and lines.


def _show_json(now: Progress) -> None:
    _write(sys.stdout, json_line(now))


def _show_line(now: Progress) -> None:
    _write(sys.stderr, plain_line(now))


def _write(file: TextIO | None, line: str) -> None:
    """In one piece, at once."""
    if file is not None:  # A closed stream is None.
        file.write(line + "\n")
        file.flush()


def json_line(now: Progress) -> str:
    """How a run stands, for programs. Power is null where the laser is dark, and where no job is under way."""
    fields = {
        "schema": SCHEMA,
        "phase": now.phase.value,
        "row": now.row,
        "rows": now.rows,
        "segment": now.segment,
        "segments": now.segments,
        "file": printable(now.place).rpartition(":")[0],
        "line": now.line,
        "x_mm": round(now.x_mm, 6),
        "y_mm": round(now.y_mm, 6),
        "queued": now.queued,
        "slots": now.slots,
        "elapsed_s": round(now.elapsed_s, 3),
        "done_ms": round(now.done_ms, 3),
        "total_ms": round(now.total_ms, 3),
        "channels": [
            {"channel": light.channel, "unit": light.unit, "power": None if math.isnan(light.power) else light.power}
            for light in now.lights
        ],
    }
    return orjson.dumps(fields).decode()


def plain_line(now: Progress) -> str:
    """How a run stands, for people: phase, planned time that is done, place in the job, position, FIFO."""
    # The job's own name would be in every line; that of a file that it includes must be there.
    place = printable(now.place).removeprefix(f"{printable(now.job)}:")
    parts = (
        localized(_PHASES[now.phase]),
        f"{_percent(now.share)} %",
        localized(Phrase("{done} of {all}", done=_clock(now.done_ms / 1000), all=_clock(now.total_ms / 1000))),
        localized(Phrase("line {place}", place=place)) if place else "",
        f"X {_mm(now.x_mm)} Y {_mm(now.y_mm)} mm",
        f"FIFO {now.queued}/{now.slots}",
    )
    return "  ".join(part for part in parts if part)


def _percent(share: float) -> int:
    """100 only at the end."""
    return math.floor(share * 100 + 1e-9)


def _clock(seconds: float) -> str:
    """1:02:03 or 2:03."""
    minutes, second = divmod(math.floor(seconds), 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour}:{minute:02}:{second:02}" if hour else f"{minute}:{second:02}"


def _mm(value: float) -> str:
    """Three digits, and no -0.000."""
    return f"{round(value, 3) + 0.0:.3f}"


# The panel.


def _terminal() -> Console | None:
    """The console on stderr if a panel can be drawn there."""
    if sys.stderr is None or not sys.stderr.isatty():
        return None
    from rich.console import Console

    console = Console(stderr=True)
    return console if console.is_terminal and not console.is_dumb_terminal else None


@dataclass(slots=True)
class _Panel:
    """A panel that is drawn over itself. `closed`: its terminal is gone, nothing can be put right there."""

    live: Live
    keys: Keys
    closed: bool = False

    @staticmethod
    def on(console: Console, keys: Keys) -> _Panel:
        """A panel that is drawn at its first show."""
        from rich.live import Live

        live = Live(console=console, auto_refresh=False, transient=False, redirect_stdout=False, redirect_stderr=False)
        return _Panel(live, keys)

    def show(self, now: Progress) -> None:
        """Draw it."""
        drawn = panel(now, listening=self.keys.listening)
        with self._terminal():
            self.live.start()
            self.live.update(drawn, refresh=True)

    def close(self) -> None:
        """The last one stays; below it the terminal is as it was."""
        if not self.closed:
            with suppress(OSError), self._terminal():
                self.live.stop()

    @contextmanager
    def _terminal(self) -> Iterator[None]:
        """A terminal that is gone is an OSError."""
        try:
            yield
        except (OSError, SystemExit) as gone:
            self.closed = True
            if isinstance(gone, SystemExit):  # rich's for a broken pipe: it would leave the run behind, with its light.
                raise BrokenPipeError from gone
            raise


def panel(now: Progress, *, listening: bool) -> RenderableType:
    """How a run stands, as a panel. Texts of the job are Text, never markup. `listening`: keys can be typed."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.table import Table
    from rich.text import Text

    left_ms = max(now.total_ms - now.done_ms, 0.0)
    grid = Table.grid(padding=(0, 1), expand=True)
    grid.add_column(no_wrap=True, overflow="crop")
    grid.add_column(ratio=1, overflow="fold")
    segments = Phrase("{done} of {all}", done=f"{now.segment:,}", all=f"{now.segments:,}")
    time_left = Phrase("{past} elapsed, {left} left", past=_clock(now.elapsed_s), left=_clock(left_ms / 1000))
    phase = Text(localized(_PHASES[now.phase]), _STYLES.get(now.phase, "bold"))
    grid.add_row(localized(Phrase("job")), Text(printable(now.job)))
    grid.add_row(phase, _bar(now.share, f"{_percent(now.share)} %"))
    grid.add_row(localized(Phrase("segments")), localized(segments))
    grid.add_row(localized(Phrase("time")), localized(time_left))
    grid.add_row(localized(Phrase("line")), Text(printable(now.place) or "-"))
    grid.add_row(localized(Phrase("position")), f"X {_mm(now.x_mm)}  Y {_mm(now.y_mm)} mm")
    for light in now.lights:
        grid.add_row(localized(Phrase("laser {channel}", channel=light.channel)), _light(light, now.phase))
    filled = min(max(now.queued / now.slots, 0.0), 1.0) if now.slots > 0 else 0.0
    grid.add_row("FIFO", _bar(filled, f"{now.queued}/{now.slots}"))
    return Panel(Group(grid, Text(_keys_line(now.phase, listening=listening), "dim")), width=_PANEL_WIDTH)


def _keys_line(phase: Phase, *, listening: bool) -> str:
    """What can be typed."""
    if not listening:
        return localized(Phrase("Ctrl+C stop (twice: at once)"))
    pause = Phrase("p go on") if phase is Phase.PAUSED else Phrase("p pause")
    return "  ".join([localized(pause), localized(Phrase("q stop (twice: at once)"))])


def _light(light: PlannedPower, phase: Phase) -> Text:
    """Switch and power of a laser, as planned: nothing is said of it where no job is under way."""
    from rich.text import Text

    if phase not in _MAY_BE_LIT:
        return Text("-")
    if math.isnan(light.power):
        return Text(localized(Phrase("off as planned")))
    on, power = Phrase("on"), f"{light.power:.4g}"
    shown = Text(localized(Phrase("{on} as planned, {power} {unit}", on=on, power=power, unit=light.unit)))
    at = shown.plain.index(localized(on))
    shown.stylize("bold red", at, at + len(localized(on)))
    return shown


def _bar(share: float, text: str) -> Table:
    """A bar and what it says."""
    from rich.progress_bar import ProgressBar
    from rich.table import Table

    line = Table.grid(padding=(0, 1), expand=True)
    line.add_column(ratio=1)
    line.add_column(justify="right", overflow="fold")
    line.add_row(ProgressBar(total=1.0, completed=share), text)
    return line
