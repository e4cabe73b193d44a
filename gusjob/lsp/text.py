"""The text of a file as an editor sees it: bytes, its lines, and positions in the units that the editor counts in.

LSP 3.17 ends a line at LF, CR LF or CR and counts UTF-16 units unless something else is agreed; gusjob ends it at LF
(syntax/source.py) and counts characters. Between the two stands the offset in bytes.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from lsprotocol.types import Position, PositionEncodingKind, Range, TextDocumentContentChangeEvent

from gusjob.diagnostics.model import Span
from gusjob.kinematics.arrays import Ints

_BOM = b"\xef\xbb\xbf"
_LF, _CR = 10, 13
_UNITS = {PositionEncodingKind.Utf8: ("utf-8", 1), PositionEncodingKind.Utf16: ("utf-16-le", 2)}
"""How each kind of unit is written, and bytes a unit; UTF-32 counts characters."""


def utf8(text: str) -> bytes:
    """Text as bytes; half a surrogate pair, which JSON can hold and no file, becomes one character in its place."""
    return text.encode("utf-8", "replace")


@dataclass(frozen=True)
class Text:
    """One state of a text. `unit`: what its editor counts a line's columns in. It is never changed, so that one thread
    may read it while another makes the next."""

    data: bytes
    unit: PositionEncodingKind | str = PositionEncodingKind.Utf16
    known: Ints | None = field(default=None, repr=False)
    """Where the editor's lines begin, if that is known already."""

    @cached_property
    def starts(self) -> Ints:
        """Where the editor's lines begin."""
        return _line_starts(self.data) if self.known is None else self.known

    @cached_property
    def _own_starts(self) -> Ints:
        """Where gusjob's lines begin: a CR alone ends none of them."""
        if b"\r" not in self.data or self.data.count(b"\r") == self.data.count(b"\r\n"):
            return self.starts
        ends = np.flatnonzero(np.frombuffer(self.data, dtype=np.uint8) == _LF)
        return np.concatenate([[0], ends + 1])

    def line(self, number: int) -> str:
        """A line of the editor's, from 0, without its end; '' where there is none."""
        return self.data[slice(*self._bounds(number))].decode("utf-8", "replace")

    def _bounds(self, number: int) -> tuple[int, int]:
        """Where a line of the editor's begins, and where its text ends."""
        if not 0 <= number < len(self.starts):
            return len(self.data), len(self.data)
        start = int(self.starts[number])
        end = int(self.starts[number + 1]) if number + 1 < len(self.starts) else len(self.data)
        while end > start and self.data[end - 1] in (_LF, _CR):
            end -= 1
        return start, end

    def offset(self, position: Position) -> int:
        """The byte at a position; the line's end, or the text's, where the position is beyond it."""
        start, end = self._bounds(position.line)
        if position.character <= 0:
            return start
        line = self.data[start:end]
        if line.isascii():
            return start + min(position.character, len(line))
        return start + len(_head(line.decode("utf-8", "replace"), position.character, self.unit).encode())

    def position(self, offset: int) -> Position:
        """The position of a byte."""
        offset = min(max(offset, 0), len(self.data))
        number = bisect_right(self.starts, offset) - 1
        start, end = self._bounds(number)
        head = self.data[start : min(offset, end)]
        return Position(line=number, character=len(head) if head.isascii() else self._units(head))

    def _units(self, head: bytes) -> int:
        if self.unit not in _UNITS:
            return len(head.decode("utf-8", "replace"))
        encoding, width = _UNITS[PositionEncodingKind(self.unit)]
        return len(head.decode("utf-8", "replace").encode(encoding)) // width

    def column(self, position: Position) -> int:
        """How many characters stand before a position in its line of the editor's."""
        start = self._bounds(position.line)[0]
        return len(self.data[start : self.offset(position)].decode("utf-8", "replace"))

    def own_line(self, position: Position) -> int:
        """The number of the line in which a position stands as gusjob counts them, from 1."""
        return bisect_right(self._own_starts, self.offset(position))

    def _place(self, line: int, column: int) -> int:
        """The byte at a line and column of gusjob's, both from 1."""
        starts = self._own_starts
        if line > len(starts):
            return len(self.data)
        start = int(starts[line - 1])
        if line == 1 and self.data.startswith(_BOM):
            start += len(_BOM)
        end = int(starts[line]) - 1 if line < len(starts) else len(self.data)
        # A character takes four bytes at most.
        head = self.data[start : min(end, start + 4 * column)].rstrip(b"\r\n")
        if head.isascii():
            return start + min(column - 1, len(head))
        return start + len(head.decode("utf-8", "replace")[: column - 1].encode())

    def range(self, span: Span) -> Range:
        """A span of gusjob's for the editor; one without columns is the text of its line."""
        start = self.position(self._place(span.line, span.column))
        if span.end_column:
            return Range(start=start, end=self.position(self._place(span.end_line or span.line, span.end_column)))
        shown = self.line(start.line)
        blank = len(shown) - len(shown.lstrip())
        first = int(self.starts[start.line])
        return Range(
            start=self.position(first + len(shown[:blank].encode())), end=self.position(first + len(shown.encode()))
        )

    def edited(self, change: TextDocumentContentChangeEvent) -> Text:
        """The text behind a change. Lines that it does not touch are not looked at."""
        new = utf8(change.text)
        place = getattr(change, "range", None)
        if place is None:
            return Text(new, self.unit)
        first, last = self.offset(place.start), self.offset(place.end)
        first, last = min(first, last), max(first, last)
        data = b"".join((self.data[:first], new, self.data[last:]))
        if b"\r" in self.data[max(first - 1, 0) : last + 1] or b"\r" in new:
            return Text(data, self.unit)  # A CR LF may have been cut in two, or made of two halves.
        head = self.starts[: np.searchsorted(self.starts, first, side="right")]
        tail = self.starts[np.searchsorted(self.starts, last, side="right") :] + (len(new) - (last - first))
        inner = _line_starts(new)[1:] + first
        return Text(data, self.unit, np.concatenate([head, inner, tail]))


def _line_starts(data: bytes) -> Ints:
    raw = np.frombuffer(data, dtype=np.uint8)
    ends = raw == _LF
    if b"\r" in data:
        alone = raw == _CR
        alone[:-1] &= ~ends[1:]
        ends = ends | alone
    return np.concatenate([[0], np.flatnonzero(ends) + 1])


def _head(line: str, units: int, unit: PositionEncodingKind | str) -> str:
    """The first so many units of a line; a character of which the end is cut off is left out."""
    if unit not in _UNITS:
        return line[:units]
    encoding, width = _UNITS[PositionEncodingKind(unit)]
    return line.encode(encoding)[: units * width].decode(encoding, "ignore")
