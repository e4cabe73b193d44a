"""Write a journal: each line is given to the system before the next call is made.

A process that is killed loses at most the line of the call that it was making.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import orjson

from gusjob.controllers.journal import JOURNAL_SCHEMA
from gusjob.i18n.phrases import reason_of


class Journal:
    """A journal that is being written. Unbuffered: a line that was written survives this process."""

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        """Create the file with its first line.

        Raises:
            OSError: the file exists already or can't be written.
        """
        self.path = path
        self._file = path.open("xb", buffering=0)
        self.write: Callable[[bytes], int | None] = self._file.write
        """Raises OSError; call give_up() then."""
        self.lost = ""
        """The error that prevents further writing; '' if there is none."""
        self.start_s = time.perf_counter()
        self.write(_json_line(schema=JOURNAL_SCHEMA, **head))

    def give_up(self, error: OSError) -> None:
        """Write nothing from now on: a full disk must not keep the laser from being switched off."""
        self.lost = reason_of(error)
        self.write = lambda _line: None

    def now_s(self) -> float:
        """Return the seconds since the start."""
        return time.perf_counter() - self.start_s

    def mark(self, **fields: Any) -> None:
        """Write one line with the time."""
        try:
            self.write(_json_line(t=round(self.now_s(), 6), **fields))
        except OSError as error:
            self.give_up(error)

    def call(self, code: int, line: int, call: str, args: list[Any]) -> None:
        """Write one call that was made."""
        self.mark(code=code, line=line, call=call, args=args)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def mark_resumed(path: Path, by: Path) -> None:
    """Note in a journal that another run continues it, so that the rest is not run twice.

    Raises:
        OSError: the journal can't be written.
    """
    with path.open("ab") as file:
        file.write(_json_line(t=0, resumed=str(by.resolve())))


def _json_line(**fields: Any) -> bytes:
    return orjson.dumps(fields, option=orjson.OPT_APPEND_NEWLINE)
