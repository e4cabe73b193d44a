"""Show the progress of a run (panel, plain lines or JSON lines), and handle the keys that pause and stop it."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, TextIO

from msgspec import Struct

from gusjob.cli.color import terminal_console
from gusjob.cli.keys import Keys
from gusjob.cli.progress_lines import json_line, plain_line
from gusjob.controllers.control import Control
from gusjob.hardware.progress import Progress, ProgressDisplay, ProgressMeter, ProgressTicker, Watch
from gusjob.i18n.phrases import Phrase

if TYPE_CHECKING:  # rich is imported only if a panel is shown.
    from rich.console import Console

_PANEL_S, _JSON_S, _LINES_S = 1 / 8, 1 / 5, 5.0
"""Intervals of each display."""
_PAUSE_KEYS = "p "
STOP_KEYS = {"q": Phrase("key q"), "s": Phrase("key s"), "\x1b": Phrase("key Escape")}


def run_display(mode: str, clock: Callable[[], float] = time.monotonic) -> Watch:
    """Return the display of a mode.

    Args:
        mode: "auto" (a panel if stderr is a terminal, else lines), "lines" (stderr), "json" (stdout), "none". Keys are
            read with a panel and with lines.
        clock: monotonic time in s.
    """

    @contextmanager
    def watch(meter: ProgressMeter) -> Iterator[ProgressDisplay]:
        if mode == "none":
            yield _NoDisplay()
            return
        with ExitStack() as stack:
            ticker = _ticker(mode, meter, clock, stack)
            stack.callback(ticker.end)
            yield ticker

    return watch


def _ticker(mode: str, meter: ProgressMeter, clock: Callable[[], float], stack: ExitStack) -> ProgressTicker:
    if mode == "json":
        return ProgressTicker(meter=meter, show=_show_json, every_s=_JSON_S, clock=clock)
    keys = stack.enter_context(Keys())
    handler = KeyHandler(keys, meter.control)
    console = _terminal() if mode == "auto" else None
    if console is None:
        return ProgressTicker(meter=meter, show=_show_line, every_s=_LINES_S, clock=clock, on_tick=handler.tick)
    from gusjob.cli.panel import LivePanel

    panel = LivePanel.on(console, keys)
    stack.callback(panel.close)
    return ProgressTicker(
        meter=meter, show=panel.show, every_s=_PANEL_S, clock=clock, on_tick=handler.tick, phases_at_once=False
    )


class _NoDisplay:
    """Shows nothing."""

    def tick(self) -> None:
        """Do nothing."""


class KeyHandler(Struct, frozen=True):
    """Turns keys into requests."""

    keys: Keys
    control: Control

    def tick(self) -> None:
        """Handle the keys that were typed since the last tick."""
        for key in self.keys.pressed().lower():
            if key in _PAUSE_KEYS:
                self.control.toggle_pause()
            elif key in STOP_KEYS:
                self.control.request_stop(STOP_KEYS[key])


def _terminal() -> Console | None:
    """Return the console on stderr if a panel can be drawn there."""
    console = terminal_console()
    return console if console is not None and not console.is_dumb_terminal else None


def _show_json(now: Progress) -> None:
    _write(sys.stdout, json_line(now))


def _show_line(now: Progress) -> None:
    _write(sys.stderr, plain_line(now))


def _write(file: TextIO | None, line: str) -> None:
    """Write a line in one piece, at once."""
    if file is not None:  # A closed stream is None.
        file.write(line + "\n")
        file.flush()
