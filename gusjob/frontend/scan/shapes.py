"""Line shapes: the common form of lines that differ only in their digits, and facts about each shape.

The shape of a line is its code (the line without its comment) with every run of digits replaced by one 0:
`LINE X 1.5 Y -20 ; a` has the shape `LINE X 0.0 Y -0 `. A file of a million lines has a handful of shapes, so whatever
is expensive is done once for each shape.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Generic, TypeVar

from gusjob.patterns import lazy_pattern

MAX_LINE = 10_000
"""Characters in a statement; a longer line is a diagnostic and is not parsed."""
MAX_NUMBER = 1e15
"""A larger number is a diagnostic: whole numbers are exact up to here, and no product of two of them overflows."""
MIN_NUMBER = 1e-100
"""A smaller number other than 0 is a diagnostic: what it is divided by, or its square, would overflow or be 0."""
CHUNK = 1 << 21
"""Bytes that are read at once."""

_COLLAPSE = bytes(48 if 48 <= c < 58 else c for c in range(256))
_COMMENT = lazy_pattern(rb"(?:;|//)[^\n]*")

T = TypeVar("T")


def chunks(data: bytes) -> Iterator[bytes]:
    """Split a text into chunks of whole lines, each without its last line end."""
    position = 0
    while position < len(data):
        end = data.rfind(b"\n", position, position + CHUNK)
        if end < 0:
            end = data.find(b"\n", position)
        end = len(data) if end < 0 else end
        yield data[position:end]
        position = end + 1


def strip_comments(text: bytes) -> bytes:
    """Remove the comments of a job's lines; returns the same object if there are none."""
    return _COMMENT.sub(b"", text) if b";" in text or b"//" in text else text


def collapse_digits(text: bytes) -> bytes:
    """Replace each digit by 0. A shape has one 0 for each run of them."""
    return text.translate(_COLLAPSE)


def shapes_of(code: bytes) -> list[bytes]:
    """The shape of each line of a text without comments."""
    code = collapse_digits(code)
    while b"00" in code:
        code = code.replace(b"00", b"0")
    return code.split(b"\n")


class ShapeTable(Generic[T]):
    """The meaning of each line shape, learned once from the code of the first line of that shape.

    Args:
        learn: Called with the code of a line of a new shape.
        known: Entries that need no line.
    """

    __slots__ = ("_entries", "_learn")

    def __init__(self, learn: Callable[[bytes], T], known: dict[bytes, T] | None = None) -> None:
        self._learn = learn
        self._entries = dict(known or {})

    def look_up(self, shapes: Sequence[bytes], code_of: Callable[[int], bytes]) -> Iterator[T]:
        """The entry of each shape.

        Args:
            shapes: Shape of each line.
            code_of: Gives the code of a line by its index in `shapes`.
        """
        entries = self._entries
        if new := set(shapes) - entries.keys():
            for i, shape in enumerate(shapes):
                if shape in new:
                    entries[shape] = self._learn(code_of(i))
                    new.discard(shape)
                    if not new:
                        break
        return map(entries.__getitem__, shapes)

    def of_line(self, code: bytes) -> T:
        """The entry of one line."""
        return next(self.look_up(shapes_of(code), lambda _: code))
