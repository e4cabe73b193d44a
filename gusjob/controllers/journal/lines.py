"""The lines of a journal: their checksums, and what they may contain."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote_to_bytes
from zlib import crc32

import orjson
from msgspec import Struct

from gusjob.patterns import lazy_pattern

_CHECKSUM = b',"crc":'


class SoundPart(Struct, frozen=True, kw_only=True):
    """The lines of a journal from its start whose checksums are right.

    `size`: their bytes; `crc`: the last checksum; `count`: number of lines; `torn`: only the last line is wrong or
    incomplete, as after a kill or a power failure; `damaged`: more follows than one such line.
    """

    size: int
    crc: int
    count: int
    torn: bool
    damaged: bool


def sound_part(data: bytes) -> SoundPart:
    """Check the checksums of a journal's lines, each of which continues that of the line before."""
    crc = size = count = 0
    while (end := data.find(b"\n", size)) >= 0:
        line = data[size:end]
        body, _, tail = line.rpartition(_CHECKSUM)
        found = crc32(body, crc)
        if tail != b"%d}" % found:
            break
        crc, size, count = found, end + 1, count + 1
    left = data[size:].rstrip(b"\0")  # A file system may fill up with zeros what was not written.
    torn = bool(left or size < len(data))
    return SoundPart(size=size, crc=crc, count=count, torn=torn, damaged=b"\n" in left[:-1])


def is_continued(path: Path) -> bool:
    """Return whether the last line of a journal says that another run continues it; False if it can't be read."""
    try:
        data = path.read_bytes()
    except OSError:
        return False
    last = data[: sound_part(data).size].rpartition(b"\n")[0].rpartition(b"\n")[2]
    return b',"resumed":' in last


def journal_lines(data: bytes) -> Iterator[dict[str, Any]]:
    """Yield the objects of sound lines, each checked.

    Of a buffered call, which most lines are, only code, row and line are read.

    Raises:
        ValueError: a line is not what a run writes.
    """
    for text in data.splitlines():
        if plain := _BUFFERED.fullmatch(text):
            code, row, line = map(int, plain.groups())
            yield {"t": 0.0, "code": code, "row": row, "line": line, "call": "", "args": []}
            continue
        found = orjson.loads(text)
        if not isinstance(found, dict) or not all(_is_valid(name, value) for name, value in found.items()):
            raise ValueError(text)
        if "call" in found and not {"t", "code", "line", "args"} <= found.keys():
            raise ValueError(text)
        yield found


def path_text(path: Path) -> str:
    """Return a path as text for a journal, which is UTF-8: a name that is not is escaped, marked by a leading NUL."""
    name = str(path)
    try:
        name.encode()
    except UnicodeEncodeError:
        return "\0" + quote(os.fsencode(path))
    return name


def path_of(text: str) -> Path:
    """Return the path that path_text made a text of.

    Raises:
        ValueError: it is none.
    """
    return Path(os.fsdecode(unquote_to_bytes(text[1:])) if text.startswith("\0") else text)


LARGEST = 2**53
"""Bound of every whole number in a journal."""
_BUFFERED = lazy_pattern(
    rb'\{"t":\d{1,12}(?:\.\d{1,12})?,"code":(-?\d{1,9}),"row":(-1|\d{1,15}),"line":(\d{1,15}),"call":"GT_\w{1,60}",'
    rb'"args":\[[-+.\w,]*\],"crc":\d{1,10}\}'
)
"""The line of a buffered call, whose arguments are numbers."""
_CALL = lazy_pattern(r"GT_[A-Za-z0-9]{1,60}")
_WHOLE = {"code": -LARGEST, "row": -1, "line": 0, "part": 0, "lead": 0, "broken": 0, "rows": 0, "crc": 0}
"""Fields with a whole number, and its lowest value."""
_TEXTS = ("schema", "job", "calls", "library", "abi", "started", "options", "resumed", "gusjob")
_FLAGS = ("starting", "off", "cut", "moving", "rest")


def _is_valid(name: str, value: Any) -> bool:
    """Return whether a field has the type and range that a run writes; any other field is valid."""
    if name in _WHOLE:
        return is_whole(value) and value >= _WHOLE[name]
    if name in _TEXTS:
        return isinstance(value, str)
    if name in _FLAGS:
        return isinstance(value, bool)
    match name:
        case "t" | "run":
            return is_number(value) and value >= 0
        case "to":
            return is_position(value)
        case "begin":
            return value is None or is_position(value)
        case "resumes":
            return value is None or isinstance(value, str)
        case "call":
            return isinstance(value, str) and _CALL.fullmatch(value) is not None
        case "end":
            return value in ("done", "failed")
        case "overrides":
            return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())
        case "args" | "faults":
            return isinstance(value, list)
        case _:
            return True


def is_whole(value: Any) -> bool:
    """Return whether a value is a whole number of at most LARGEST."""
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= LARGEST


def is_number(value: Any) -> bool:
    """Return whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def is_position(value: Any) -> bool:
    """Return whether a value is a row and the pulses along it, once or twice (the earliest and the latest)."""
    if not isinstance(value, list) or len(value) not in (2, 4):
        return False
    rows, along = value[::2], value[1::2]
    return all(is_whole(row) and row >= 0 for row in rows) and all(is_number(a) and a >= 0 for a in along)
