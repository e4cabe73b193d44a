"""Whether output has colours: one decision for click, for rich, and for diagnostics, tables and differences.

The decision is the color of click's root context: True, False, or None where it depends on the stream. click.echo
follows it, and all other output takes it from use_color.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, TextIO

import click

from gusjob.patterns import lazy_pattern

if TYPE_CHECKING:  # Start-up time is part of the tool.
    from rich.console import Console

COLORS = ("auto", "always", "never")
COLOR_HELP = "Use colours. auto: on a terminal, unless NO_COLOR, FORCE_COLOR or TERM=dumb is set."
_RESET = b"\x1b[0m"
_OF_LINES = {b"---": b"\x1b[1m", b"+++": b"\x1b[1m", b"@@": b"\x1b[36m", b"-": b"\x1b[31m", b"+": b"\x1b[32m"}
"""Codes of the lines of a difference by what they begin with; the first that fits counts."""
_LINE_START = lazy_pattern(rb"---|\+\+\+|@@|[-+]")


def color_decision(option: str | None, environment: Mapping[str, str]) -> bool | None:
    """Decide whether all output has colours or none has; None: output on a terminal has.

    An option other than auto comes first, then the variables of no-color.org and force-color.org, then TERM.
    """
    if option in ("always", "never"):
        return option == "always"
    if environment.get("NO_COLOR"):
        return False
    if environment.get("FORCE_COLOR"):
        return True
    return False if environment.get("TERM") == "dumb" else None


def use_color(stream: TextIO | None) -> bool:
    """Return whether the running command writes colours to a stream; a closed stream is None."""
    context = click.get_current_context(silent=True)
    decided = context.color if context is not None else color_decision(None, os.environ)
    if stream is None:
        return False
    color = stream.isatty() if decided is None else decided
    if color and sys.platform == "win32":  # Tables and differences are bytes, which click does not convert.
        import_module("colorama").just_fix_windows_console()
    return color


def terminal_console() -> Console | None:
    """Return a console of rich on standard error if that is a terminal, with the colours that were decided."""
    if sys.stderr is None or not sys.stderr.isatty():
        return None
    from rich.console import Console

    color = use_color(sys.stderr)
    return Console(stderr=True, force_terminal=True, color_system="auto" if color else None, no_color=not color)


def colored_difference(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Colour the lines of a unified difference on standard output, if that has colours."""
    if not use_color(sys.stdout):
        yield from pieces
        return
    for piece in pieces:
        for line in piece.splitlines(keepends=True):
            start = _LINE_START.match(line)
            text = line.rstrip(b"\r\n")
            yield line if start is None else _OF_LINES[start[0]] + text + _RESET + line[len(text) :]
