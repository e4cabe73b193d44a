"""The progress of a run as a panel on a terminal, drawn with rich."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from msgspec import Struct
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.panel import Panel
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from gusjob.cli.keys import Keys
from gusjob.cli.progress_lines import PHASES, doubling, duration, mm, percent
from gusjob.controllers.control import Phase
from gusjob.hardware.progress import MAY_EMIT, PlannedPower, Progress
from gusjob.i18n.phrases import Phrase, localized, printable

_WIDTH = 80
_STYLES = {Phase.RUNNING: "bold green", Phase.PAUSED: "bold yellow", Phase.STOPPING: "bold red"}


class LivePanel(Struct):
    """A panel that is drawn over itself. `closed`: its terminal is gone, and nothing can be restored there."""

    live: Live
    keys: Keys
    closed: bool = False

    @staticmethod
    def on(console: Console, keys: Keys) -> LivePanel:
        """Make a panel, which is drawn when it is first shown."""
        live = Live(console=console, auto_refresh=False, transient=False, redirect_stdout=False, redirect_stderr=False)
        return LivePanel(live, keys)

    def show(self, now: Progress) -> None:
        """Draw the panel. Raises OSError if the terminal is gone."""
        drawn = panel(now, listening=self.keys.listening)
        with self._terminal():
            self.live.start()
            self.live.update(drawn, refresh=True)

    def close(self) -> None:
        """Leave the last panel on the terminal, and restore the terminal below it."""
        if not self.closed:
            with suppress(OSError), self._terminal():
                self.live.stop()

    @contextmanager
    def _terminal(self) -> Iterator[None]:
        """Raise OSError if the terminal is gone."""
        try:
            yield
        except (OSError, SystemExit) as gone:
            self.closed = True
            if isinstance(gone, SystemExit):  # rich's for a broken pipe: it would end the process without a shutdown.
                raise BrokenPipeError from gone
            raise


def panel(now: Progress, *, listening: bool) -> RenderableType:
    """Draw the progress as a panel. The job's texts are Text, never markup.

    Args:
        now: the progress.
        listening: keys can be typed.
    """
    left_ms = max(now.total_ms - now.done_ms, 0.0)
    grid = Table.grid(padding=(0, 1), expand=True)
    grid.add_column(no_wrap=True, overflow="crop")
    grid.add_column(ratio=1, overflow="fold")
    segments = Phrase("{done} of {all}", done=f"{now.segment:,}", all=f"{now.segments:,}")
    time_left = Phrase("{past} elapsed, {left} left", past=duration(now.elapsed_s), left=duration(left_ms / 1000))
    phase = Text(localized(PHASES[now.phase]), _STYLES.get(now.phase, "bold"))
    grid.add_row(localized(Phrase("job")), Text(printable(now.job)))
    grid.add_row(phase, _bar(now.share, f"{percent(now.share)} %"))
    grid.add_row(localized(Phrase("segments")), localized(segments))
    grid.add_row(localized(Phrase("time")), localized(time_left))
    grid.add_row(localized(Phrase("line")), Text(printable(now.location) or "-"))
    grid.add_row(localized(Phrase("position")), f"X {mm(now.x_mm)}  Y {mm(now.y_mm)} mm")
    for laser in now.lasers:
        grid.add_row(localized(Phrase("laser {channel}", channel=laser.channel)), _laser_text(laser, now.phase))
    if now.doubling_mm:
        grid.add_row(localized(Phrase("doubling")), localized(doubling(now.doubling_mm)))
    filled = min(max(now.queued / now.slots, 0.0), 1.0) if now.slots > 0 else 0.0
    grid.add_row("FIFO", _bar(filled, f"{now.queued}/{now.slots}"))
    return Panel(Group(grid, Text(_keys_line(now.phase, listening=listening), "dim")), width=_WIDTH)


def _keys_line(phase: Phase, *, listening: bool) -> str:
    """Return the keys that can be typed."""
    if not listening:
        return localized(Phrase("Ctrl+C stop (twice: at once)"))
    pause = Phrase("p continue") if phase is Phase.PAUSED else Phrase("p pause")
    return "  ".join([localized(pause), localized(Phrase("q stop (twice: at once)"))])


def _laser_text(laser: PlannedPower, phase: Phase) -> Text:
    """Return switch and power of a laser as planned, '-' where no job is running."""
    if phase not in MAY_EMIT:
        return Text("-")
    if math.isnan(laser.power):
        return Text(localized(Phrase("off as planned")))
    on, power = Phrase("on"), f"{laser.power:.4g}"
    shown = Text(localized(Phrase("{on} as planned, {power} {unit}", on=on, power=power, unit=laser.unit)))
    at = shown.plain.index(localized(on))
    shown.stylize("bold red", at, at + len(localized(on)))
    return shown


def _bar(share: float, text: str) -> Table:
    """Draw a bar with its text."""
    line = Table.grid(padding=(0, 1), expand=True)
    line.add_column(ratio=1)
    line.add_column(justify="right", overflow="fold")
    line.add_row(ProgressBar(total=1.0, completed=share), text)
    return line
