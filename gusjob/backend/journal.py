"""What was really sent: a file of JSON lines, each written to the system before the next call is made.

The first line says what is run (gusjob-journal/1). Then a line a call: `t` in s since the start, what it returned,
for buffered calls the job's `row` (-1: a call that rebuilds the state when a run goes on), the job's line, the call and
its arguments (of what it points to, what was found there). Between them `part` lines, where a run begins or goes on,
and at the end an `end` line. A process that is killed loses at most the line of the call that it was making.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import orjson

SCHEMA = "gusjob-journal/1"


class Journal:
    """Writes a journal. Not buffered: what was written is the system's, whatever becomes of this process."""

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        """Make the file, which must not exist (OSError), with its first line."""
        self.path = path
        self._file = path.open("xb", buffering=0)
        self.write: Callable[[bytes], int | None] = self._file.write
        self.start_s = time.perf_counter()
        self.record(schema=SCHEMA, **head)

    def now_s(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self.start_s

    def record(self, **fields: Any) -> None:
        """One line."""
        self.write(orjson.dumps(fields, option=orjson.OPT_APPEND_NEWLINE))

    def mark(self, **fields: Any) -> None:
        """One line with the time."""
        self.record(t=round(self.now_s(), 6), **fields)

    def call(self, code: int, line: int, call: str, args: list[Any]) -> None:
        """One call that was made."""
        self.mark(code=code, line=line, call=call, args=args)

    def close(self) -> None:
        """No more lines."""
        self._file.close()
