"""Write a journal: the system has each line before the next call is made.

A process that is killed loses at most the line of the call that it was making.
"""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

import orjson

from gusjob.controllers.journal import JOURNAL_SCHEMA
from gusjob.controllers.journal.lines import path_text, sound_part
from gusjob.i18n.phrases import reason_of


class Journal:
    """A journal that is being written. Unbuffered: a line that was written survives this process."""

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        """Create the file with its first line.

        Raises:
            OSError: the file exists already or can't be written.
        """
        self._begin(path, path.open("xb", buffering=0), crc=0, head=head)
        self.append(_body(schema=JOURNAL_SCHEMA, **head))

    @classmethod
    def reopen(cls, path: Path) -> Journal:
        """Open the journal of another run to add lines after its last sound one.

        Raises:
            OSError: the file can't be written.
        """
        made = cls.__new__(cls)
        file = path.open("r+b", buffering=0)
        sound = sound_part(file.read())
        file.truncate(sound.size)
        file.seek(sound.size)
        made._begin(path, file, crc=sound.crc, head={})
        if sound.torn:  # What followed is not known: a resume must not rely on the end of the journal.
            made.append(_body(t=0, cut=True))
        return made

    @classmethod
    def unwritten(cls, error: OSError) -> Journal:
        """Return a journal that can't be written."""
        made = cls.__new__(cls)
        made._begin(Path(), None, crc=0, head={})
        made.give_up(error)
        return made

    def _begin(self, path: Path, file: BinaryIO | None, *, crc: int, head: dict[str, Any]) -> None:
        self.path, self._file, self._crc, self.head = path, file, crc, head
        self.write: Callable[[bytes], int] = len if file is None else file.write
        """Writes one line. Raises OSError; call give_up() then."""
        self.lost = ""
        """The error that prevents further writing; '' if there is none."""
        self.start_s = time.perf_counter()
        self._since_s = 0.0

    @property
    def _is_writing(self) -> bool:
        """Whether a thread is writing; it may hang."""
        return self._since_s > 0

    def append(self, body: bytes) -> None:
        """Write one line: a JSON object without its closing brace, with its checksum.

        Raises:
            OSError: it can't be written, or only in part.
        """
        self._crc = crc32(body, self._crc)
        line = b'%b,"crc":%d}\n' % (body, self._crc)
        self._since_s = time.perf_counter()
        try:
            if self.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        finally:
            self._since_s = 0.0

    def give_up(self, error: OSError) -> None:
        """Write nothing from now on: a full disk must not keep the laser from being switched off.

        The last line is made incomplete, which needs no disk space, so that a resume knows that something is missing.
        """
        self.lost, self.write = reason_of(error), len
        with suppress(OSError, ValueError):
            if self._file is not None and not self._is_writing:
                self._make_incomplete(self._file)

    @staticmethod
    def _make_incomplete(file: BinaryIO) -> None:
        """Add a byte that begins a line; if there is no room even for that, write it over the end of the last line."""
        try:
            is_written = file.write(b"\0") == 1
        except OSError:
            is_written = False
        if not is_written:
            file.seek(-1, os.SEEK_END)
            file.write(b"\0")

    def hung_s(self) -> float:
        """Return for how long the line in progress has not been written."""
        since = self._since_s
        return time.perf_counter() - since if since else 0.0

    def now_s(self) -> float:
        """Return the seconds since the start."""
        return time.perf_counter() - self.start_s

    def mark(self, **fields: Any) -> None:
        """Write one line with the time."""
        try:
            self.append(_body(t=round(self.now_s(), 6), **fields))
        except OSError as error:
            self.give_up(error)

    def call(self, code: int, line: int, call: str, args: list[Any]) -> None:
        """Write one call that was made."""
        self.mark(code=code, line=line, call=call, args=args)

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


def mark_resumed(path: Path, by: Path, started: str = "") -> None:
    """Record in a journal that another run continues it, so that the rest is not run twice.

    Args:
        path: the journal.
        by: the journal of the other run.
        started: when that run started, as its head says.

    Raises:
        OSError: the journal can't be written.
    """
    journal = Journal.reopen(path)
    try:
        journal.append(_body(t=0, resumed=path_text(by.resolve()), started=started))
    finally:
        journal.close()


def _body(**fields: Any) -> bytes:
    return orjson.dumps(fields).removesuffix(b"}")
