"""A chunk of text as a table of its lines: their shapes, and their numerals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.frontend.scan.numerals import PADDING, Numerals, Words
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.kinematics.arrays import Bools, Indices
from gusjob.patterns import lazy_pattern

Bytes = npt.NDArray[np.uint8]
_NEWLINE, _POINT, _SLASH, _ZERO, _SEMICOLON = b"\n./0;"
_NUMERAL = lazy_pattern(rb"[0-9.]+")
_WORD = 8
MAX_WORDS = 16
"""Words of a shape, more of which are looked up one by one."""
_MASKS = np.array([(1 << 8 * k) - 1 for k in range(_WORD + 1)], dtype=np.uint64)
"""The first k bytes of a word."""


class Lines(Struct):
    """The lines of a text, found when the first one is needed."""

    text: bytes
    _ends: Indices | None = None

    @property
    def ends(self) -> Indices:
        """Where the LF of each line is, (n,)."""
        if self._ends is None:
            self._ends = np.flatnonzero(np.frombuffer(self.text, dtype=np.uint8) == _NEWLINE)
        return self._ends

    def __getitem__(self, i: int) -> bytes:
        """A line without its end."""
        ends = self.ends
        return self.text[int(ends[i - 1]) + 1 if i else 0 : int(ends[i])]


class LineTable(Struct, frozen=True, kw_only=True, eq=False):
    """The lines of a chunk.

    Attributes:
        lines: The lines as they were written.
        code: The lines without their comments.
        is_long: Whether some line has more than MAX_LINE characters.
        numerals: The numerals of the code.
        shapes: The shapes of all lines one after the other, each ended by LF. Here a shape has every point.
        starts: Where the shape of each line begins in `shapes`, (n,).
        lengths: Its length, (n,).
        words: Its bytes as words, up to MAX_WORDS; a shape that ends earlier has zeros. (n,) each.
    """

    lines: Lines
    code: Lines
    is_long: bool
    numerals: Numerals
    shapes: Bytes
    starts: Indices
    lengths: Indices
    words: list[Words]

    def __len__(self) -> int:
        return len(self.starts)

    def shape(self, i: int) -> bytes:
        """The shape of a line."""
        start = self.starts[i]
        return self.shapes[start : start + self.lengths[i]].tobytes()

    def long_lines(self) -> Indices:
        """The lines with more than MAX_LINE characters."""
        if not self.is_long:
            return np.zeros(0, dtype=np.intp)
        ends = self.lines.ends
        return np.flatnonzero(np.diff(ends, prepend=-1) - 1 > MAX_LINE)


def count_numerals(code: bytes) -> int:
    """How many numerals a line has."""
    return len(_NUMERAL.findall(code))


def line_table(chunk: bytes, *, semicolon_comments: bool) -> LineTable:
    """Make the table of a chunk of whole lines, the last one with its end."""
    code = without_comments(chunk, semicolon_comments=semicolon_comments)
    text = b" " * PADDING + code
    raw = np.frombuffer(text, dtype=np.uint8)
    is_digit = raw - np.uint8(_ZERO) < 10
    in_numeral = is_digit | (raw == _POINT)
    edges = np.flatnonzero(in_numeral[1:] != in_numeral[:-1])
    edges += 1
    shapes = _shapes(raw, is_digit, in_numeral)
    ends = np.flatnonzero(shapes == _NEWLINE)
    starts = np.zeros(len(ends), dtype=np.intp)
    starts[1:] = ends[:-1] + 1
    lengths = ends - starts
    lines = Lines(chunk)
    return LineTable(
        lines=lines,
        code=lines if code is chunk else Lines(code),
        is_long=_has_long_line(chunk),
        numerals=Numerals(text=text, edges=edges),
        shapes=shapes,
        starts=starts,
        lengths=lengths,
        words=_words(shapes, starts, lengths),
    )


def _has_long_line(chunk: bytes) -> bool:
    """Whether some line has more than MAX_LINE characters."""
    start = 0
    while start < len(chunk):
        end = chunk.rfind(b"\n", start, start + MAX_LINE + 1)
        if end < 0:
            return True
        start = end + 1
    return False


def without_comments(chunk: bytes, *, semicolon_comments: bool) -> bytes:
    """Remove the comments; returns the same object if there are none."""
    slashes, semicolons = b"//" in chunk, semicolon_comments and b";" in chunk
    if not slashes and not semicolons:
        return chunk
    raw = np.frombuffer(chunk, dtype=np.uint8)
    marks = raw == _NEWLINE
    if semicolons:
        marks |= raw == _SEMICOLON
    if slashes:
        marks[:-1] |= (raw[:-1] == _SLASH) & (raw[1:] == _SLASH)
    # A comment goes from the first mark of a line to its end.
    at = np.flatnonzero(marks)
    is_end = raw[at] == _NEWLINE
    is_begin = ~is_end
    is_begin[1:] &= is_end[:-1]
    begins = np.flatnonzero(is_begin)
    ends = np.flatnonzero(is_end)
    after = np.cumsum(is_end)[begins]
    bounds = np.zeros(2 * len(begins) + 2, dtype=np.intp)
    bounds[1:-1:2], bounds[2:-1:2], bounds[-1] = at[begins], at[ends[after]], len(raw)
    is_code = np.ones(len(bounds) - 1, dtype=np.bool_)
    is_code[1::2] = False
    return raw.compress(np.repeat(is_code, np.diff(bounds))).tobytes()


def _shapes(raw: Bytes, is_digit: Bools, in_numeral: Bools) -> Bytes:
    """The text with 0 for the first digit of each numeral, and without its other digits and the padding."""
    keep = ~is_digit
    keep[1:] |= ~in_numeral[:-1]
    shapes = raw[PADDING:].compress(keep[PADDING:])
    digits = shapes - np.uint8(_ZERO)
    digits *= digits < 10
    shapes -= digits
    return shapes


def _words(shapes: Bytes, starts: Indices, lengths: Indices) -> list[Words]:
    """The bytes of shapes as words."""
    padded = np.concatenate([shapes, np.zeros(_WORD, dtype=np.uint8)])
    windows = np.ndarray(len(shapes) + 1, dtype="<u8", buffer=padded, strides=(1,))
    least, most = int(lengths.min()), min(int(lengths.max()), MAX_WORDS * _WORD)
    found = []
    for offset in range(0, most, _WORD):
        if least >= offset + _WORD:
            found.append(windows[starts + offset])
            continue
        longer = np.flatnonzero(lengths > offset)
        if len(longer) == len(lengths):
            words = windows[starts + offset] & _MASKS[np.minimum(lengths - offset, _WORD)]
        else:
            words = np.zeros(len(lengths), dtype=np.uint64)
            words[longer] = windows[starts[longer] + offset] & _MASKS[np.minimum(lengths[longer] - offset, _WORD)]
        found.append(words)
    return found
