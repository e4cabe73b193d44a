"""The files of a recording: their names, the lock on them, what they replace, and how they end.

Card 0 and the first process are recorded in calls.gts, others beside it in calls.2.gts, calls.card1.gts and so on.
The first line of those says to which recording they belong: "of calls.gts".
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from msgspec import Struct

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

from gusjob.inputs import exists
from gusjob.patterns import lazy_pattern
from gusjob.record.build import cache_folder

HEADER = b"// recorded by gusjob record"
"""The first bytes of a recorded listing."""
_STOPPED = b"// stopped: "
_NOT_WRITTEN = b"\n// stopped: the listing could not be written, later calls are missing\n"
_UNSIGNED = lazy_pattern(
    rb"^\[.*\bGT_\w+\(.*[(,{](?:2147483[6-9]\d\d|21474[89]\d{5}|2[2-9]\d{8}|[34]\d{9})[,)}].* = 7\b", re.M
)
"""A refused call with a negative int that was read as a larger number: 2**31 and more."""
_HELD = (errno.EACCES, errno.EAGAIN, errno.EDEADLK)
"""Errors that say that another process has a lock."""
_LONGEST_MARK = 200
_HEADER_BYTES = 1000
_PIECE_BYTES = 1 << 20


class ListingEnd(Struct, frozen=True, kw_only=True):
    """What a listing has. `calls`: lines of calls and rests; `is_cut`: some are missing; `has_wide`: see _UNSIGNED."""

    calls: int
    is_cut: bool
    has_wide: bool


def mark_of(output: Path) -> str:
    """Return how other listings name the main one: in printable ASCII without blanks, by its hash if it is long."""
    mark = "".join(c if "!" <= c <= "~" else f"\\{ord(c):x}" for c in output.name)
    return mark if len(mark) <= _LONGEST_MARK else hashlib.sha256(mark.encode()).hexdigest()


def target_of(output: Path) -> Path:
    """Return the file that is written: a link's target is, not the link."""
    return Path(os.path.realpath(output)) if output.is_symlink() else output.absolute()


def is_recording(path: Path) -> bool:
    """Return whether a file is a recorded listing."""
    return _first_line(path).startswith(HEADER)


def listings_of(output: Path) -> list[Path]:
    """Return the listings of a recording, that of card 0 and of the first process first."""
    stem, ending = re.escape(output.stem), re.escape(output.suffix)
    name = re.compile(rf"{stem}(?:\.(\d+))?(?:\.card(\d+))?{ending}")
    try:
        found = [(match, path) for path in output.parent.iterdir() if (match := name.fullmatch(path.name))]
    except OSError:  # The folder is gone.
        return []
    mine = [(int(m[1] or 0), int(m[2] or 0), path) for m, path in found if _is_of(path, output)]
    return [path for _, _, path in sorted(mine)]


def _is_of(path: Path, output: Path) -> bool:
    line = _first_line(path)
    if path.name == output.name:
        return line.startswith(HEADER) or (path.is_file() and not path.stat().st_size)
    return line.startswith(HEADER) and line.rstrip().endswith(b", of " + mark_of(output).encode())


def _first_line(path: Path) -> bytes:
    try:
        if path.is_file():
            with path.open("rb") as file:
                return file.readline(_HEADER_BYTES)
    except OSError:
        pass
    return b""


@contextmanager
def locked(output: Path) -> Iterator[bool]:
    """Take the lock on a recording's name; it yields whether nobody else has it. It ends with this process at latest.

    Raises:
        BuildError: there is no safe place for it.
    """
    name = hashlib.sha256(os.fsencode(os.path.realpath(output))).hexdigest()[:32]
    lock = os.open(cache_folder() / f"{name}.lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        yield _try_lock(lock)
    finally:
        os.close(lock)


def _try_lock(file: int) -> bool:
    try:
        if sys.platform == "win32":
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in _HELD  # Another error: this file system has no locks.
    return True


def is_written(path: Path) -> bool:
    """Return whether a process still records into a listing: the stand-in has locked it."""
    try:
        with path.open("r+b") as file:
            _lock_listing(file.fileno())
    except OSError as error:
        return error.errno in _HELD and os.access(path, os.W_OK)
    return False


def _lock_listing(file: int) -> None:
    if sys.platform != "win32":
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def set_aside(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Rename listings; they are back at the end, unless the list that is yielded was emptied: then they are removed."""
    aside = list[Path]()
    names = {path.with_name(f".{path.name}.before"): path for path in paths}
    try:
        for other, path in names.items():
            path.replace(other)
            aside.append(other)
        yield aside
    finally:
        for other, path in names.items():
            with suppress(OSError):
                if other not in aside:
                    other.unlink()
                elif not exists(path):
                    other.replace(path)


def count_lines(path: Path, at: int = 0) -> tuple[int, int]:
    """Count the lines of a file that are no comments, from a position on; return their number and the new position."""
    count = 0
    try:
        with path.open("rb") as file:
            while True:
                file.seek(max(at - 1, 0))
                piece = file.read(_PIECE_BYTES)
                count += piece.count(b"\n[")
                if file.tell() == at:
                    return count, at
                at = file.tell()
    except OSError:  # It is made with the first call.
        return count, at


def end_listing(path: Path, exit_code: int) -> ListingEnd:
    """Write how the program ended behind its calls."""
    calls, size = count_lines(path)
    is_cut, has_wide = True, False
    try:
        has_wide = _has_wide(path)
        is_cut = _mark_end(path, size, exit_code)
    except OSError:  # The disk is full, or another process of the program still records.
        pass
    return ListingEnd(calls=calls, is_cut=is_cut, has_wide=has_wide)


def _has_wide(path: Path) -> bool:
    with path.open("rb") as file:
        return any(_UNSIGNED.search(piece) for piece in iter(lambda: file.read(_PIECE_BYTES), b"") if b") = 7" in piece)


def _mark_end(path: Path, size: int, exit_code: int) -> bool:
    """Write how the program ended; return whether the listing was cut before.

    Raises:
        OSError: it can't be written. A process that still records has locked it.
    """
    with path.open("r+b") as file:
        _lock_listing(file.fileno())
        file.seek(max(size - 200, 0))
        tail = file.read()
        is_cut = not tail.endswith(b"\n")
        file.write(_NOT_WRITTEN if is_cut else b"")
        file.write(b"// ended " + _ending(exit_code).encode() + b"\n")
    return is_cut or _STOPPED in tail


def _ending(exit_code: int) -> str:
    return f"by signal {-exit_code}" if exit_code < 0 else f"with exit code {exit_code}"
