"""The text of a file, with positions in the editor's units and in gusjob's.

LSP 3.17 ends a line at LF, CR LF or CR, as gusjob does (frontend/source.py). It counts UTF-16 units unless another unit
is agreed; gusjob counts characters. Both convert to an offset in bytes.
"""

from __future__ import annotations

from bisect import bisect_right
from functools import cached_property

import numpy as np
from lsprotocol.types import Position, PositionEncodingKind, Range, TextDocumentContentChangeEvent
from msgspec import Struct

from gusjob.diagnostics.model import Span
from gusjob.kinematics.arrays import Ints

_BOM = b"\xef\xbb\xbf"
_LF, _CR = 10, 13
_UNITS = {PositionEncodingKind.Utf8: ("utf-8", 1), PositionEncodingKind.Utf16: ("utf-16-le", 2)}
"""Encoding of each unit, and bytes per unit; UTF-32 counts characters."""


def utf8(text: str) -> bytes:
    """Encode a text. Half of a surrogate pair, which JSON can hold but no file, becomes one other character."""
    return text.encode("utf-8", "replace")


class Text(Struct, frozen=True, dict=True):
    """One version of a text, immutable, so that threads can share it.

    Attributes:
        unit: Unit of the editor's columns.
        known: Offsets of the lines, if they are known already.
    """

    data: bytes
    unit: PositionEncodingKind | str = PositionEncodingKind.Utf16
    known: Ints | None = None

    @cached_property
    def starts(self) -> Ints:
        """Offsets of the lines."""
        return _line_starts(self.data) if self.known is None else self.known

    def line(self, number: int) -> str:
        """Return a line, from 0, without its end; '' if there is none."""
        return self.data[slice(*self._bounds(number))].decode("utf-8", "replace")

    def _bounds(self, number: int) -> tuple[int, int]:
        """Return the offsets where a line begins and where its text ends."""
        if not 0 <= number < len(self.starts):
            return len(self.data), len(self.data)
        start = int(self.starts[number])
        end = int(self.starts[number + 1]) if number + 1 < len(self.starts) else len(self.data)
        while end > start and self.data[end - 1] in (_LF, _CR):
            end -= 1
        return start, end

    def offset(self, position: Position) -> int:
        """Return the offset of a position; of one beyond the end of its line or of the text that end."""
        start, end = self._bounds(position.line)
        if position.character <= 0:
            return start
        line = self.data[start:end]
        if line.isascii():
            return start + min(position.character, len(line))
        return start + len(_head(line.decode("utf-8", "replace"), position.character, self.unit).encode())

    def position(self, offset: int) -> Position:
        """Return the position of an offset."""
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
        """Return the number of characters before a position in its line."""
        start = self._bounds(position.line)[0]
        return len(self.data[start : self.offset(position)].decode("utf-8", "replace"))

    def own_line(self, position: Position) -> int:
        """Return the line number of a position, from 1."""
        return bisect_right(self.starts, self.offset(position))

    def _own_offset(self, line: int, column: int) -> int:
        """Return the offset of a line and column, both from 1."""
        starts = self.starts
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
        """Convert a span to the editor's range; a span without columns covers the text of its line."""
        start = self.position(self._own_offset(span.line, span.column))
        if span.end_column:
            return Range(start=start, end=self.position(self._own_offset(span.end_line or span.line, span.end_column)))
        shown = self.line(start.line)
        blank = len(shown) - len(shown.lstrip())
        first = int(self.starts[start.line])
        return Range(
            start=self.position(first + len(shown[:blank].encode())), end=self.position(first + len(shown.encode()))
        )

    def edited(self, change: TextDocumentContentChangeEvent) -> Text:
        """Return the text after a change. Only the changed lines are scanned for line ends."""
        new = utf8(change.text)
        replaced = getattr(change, "range", None)
        if replaced is None:
            return Text(new, self.unit)
        first, last = self.offset(replaced.start), self.offset(replaced.end)
        first, last = min(first, last), max(first, last)
        data = b"".join((self.data[:first], new, self.data[last:]))
        if b"\r" in self.data[max(first - 1, 0) : last + 1] or b"\r" in new:
            return Text(data, self.unit)  # A CR LF may have been split or joined.
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
    """Return the first `units` units of a line, without a character that is cut."""
    if unit not in _UNITS:
        return line[:units]
    encoding, width = _UNITS[PositionEncodingKind(unit)]
    return line.encode(encoding)[: units * width].decode(encoding, "ignore")
