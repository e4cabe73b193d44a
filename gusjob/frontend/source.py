"""Files to checked text, and lines of a text by their number."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import IO

import numpy as np
from msgspec import Struct

from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.i18n.phrases import Phrase, reason_of
from gusjob.inputs import open_input
from gusjob.kinematics.arrays import Indices
from gusjob.patterns import lazy_pattern

MAX_FILE_MB = 1000
_JOB_SUFFIXES = {".job"}
_LISTING_SUFFIXES = {".gts", ".c", ".cc", ".cpp", ".cxx", ".h", ".hpp", ".cs"}
_LISTING_CALL = lazy_pattern(rb"\bGTN?_[A-Za-z]+\s*\(")
_LONE_RETURN = lazy_pattern(rb"\r(?!\n)")
"""A CR that ends a line by itself, as on old systems: editors and compilers show a line end there."""
_LINE = lazy_pattern(rb"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+\Z")
_LINE_END = ord("\n")
_BLOCK_BYTES = 1 << 14
"""Bytes of a text whose line ends are counted together."""
_JOINED_COMMENT = lazy_pattern(rb"//[^\r\n]*[\x80-\xff]\\[ \t]*[\r\n]")
_SEARCHED_BYTES = 200_000
_UTF16_MARKS = (b"\xff\xfe", b"\xfe\xff")
_OTHER_ENCODING = "GB18030"
"""Encoding of a listing that is not UTF-8: a superset of GB2312 and GBK, which Chinese Windows writes."""


class Source(Struct):
    """A text.

    Attributes:
        name: What messages call it.
        data: UTF-8 bytes without BOM, lines ended by LF or CR LF.
        path: The file it was read from, None for none.
        written: The same text before a CR alone was replaced by an LF, None if there was none.
        encoding: The encoding of a listing that is not UTF-8, else ''.
        joined_line: In such a listing the first line with a // comment whose last byte is that of a backslash, so that
            some compilers go on with the comment in the next line; 0 for none.
    """

    name: str
    data: bytes
    path: Path | None = None
    encoding: str = ""
    joined_line: int = 0
    written: bytes | None = None
    _line_ends: Indices | None = None
    """Number of line ends before each block of the text; counted when the first line is looked up."""

    def __post_init__(self) -> None:
        """End the lines that a CR alone ends by LF: everything that reads lines then sees the same ones."""
        if b"\r" in self.data and _LONE_RETURN.search(self.data):
            self.written, self.data = self.data, _LONE_RETURN.sub(b"\n", self.data)

    @property
    def as_written(self) -> bytes:
        """The text with the line ends of its file."""
        return self.data if self.written is None else self.written

    def lines_as_written(self) -> list[bytes]:
        """The lines of `as_written`, each with its end."""
        return [found[0] for found in _LINE.finditer(self.as_written)]

    def count_lines(self) -> int:
        """Count the lines."""
        return self.data.count(b"\n") + 1

    def line(self, number: int) -> str:
        """Line `number` (from 1), without its end; '' outside the text."""
        return next(iter(self.lines(number, number)), "")

    def lines(self, first: int, last: int) -> list[str]:
        """Lines `first` to `last` (from 1) of those that the text has, without their ends."""
        if self._line_ends is None:
            starts = range(0, len(self.data), _BLOCK_BYTES)
            counts = [self.data.count(b"\n", start, start + _BLOCK_BYTES) for start in starts]
            self._line_ends = np.cumsum([0, *counts])
        if first < 1 or first > self._line_ends[-1] + 1:
            return []
        found, start = [], self._end_of(first - 1) + 1 if first > 1 else 0
        for _ in range(first, min(last, int(self._line_ends[-1]) + 1) + 1):
            end = self.data.find(b"\n", start)
            end = end if end >= 0 else len(self.data)
            found.append(self.data[start:end].decode("utf-8", "replace").rstrip("\r"))
            start = end + 1
        return found

    def _end_of(self, number: int) -> int:
        """Position of the end of line `number`, which has one."""
        assert self._line_ends is not None
        block = int(np.searchsorted(self._line_ends, number)) - 1
        first = block * _BLOCK_BYTES
        text = np.frombuffer(self.data, dtype=np.uint8, count=min(_BLOCK_BYTES, len(self.data) - first), offset=first)
        return first + int(np.flatnonzero(text == _LINE_END)[number - 1 - int(self._line_ends[block])])


def read_source(path: Path, name: str = "") -> tuple[Source | None, list[Diagnostic]]:
    """Read the text of a file; None with a diagnostic if there is none. `name`: what messages call it."""
    name = name or shown_name(path)
    try:
        with open_input(path) as file:
            data = read_limited(file)
        if len(data) > _limit_bytes():
            return None, [_too_large(name, max(path.stat().st_size, len(data)))]
    except OSError as error:
        return None, [_diagnostic(rules.UNREADABLE, name, reason=reason_of(error))]
    except ValueError:  # A NUL in the name.
        return None, [_diagnostic(rules.UNREADABLE, name, reason=Phrase("the name is not valid"))]
    return check_text(data, name, path)


def read_limited(file: IO[bytes]) -> bytes:
    """Read a file up to its end, or to one byte more than gusjob reads: the size of a pipe is not known before."""
    return file.read(_limit_bytes() + 1)


def _limit_bytes() -> int:
    return int(MAX_FILE_MB * 1_000_000)


def _too_large(name: str, size: int) -> Diagnostic:
    return _diagnostic(rules.TOO_LARGE, name, size=str(size // 1_000_000), limit=str(MAX_FILE_MB))


def shown_name(path: Path) -> str:
    """A file's name as text: bytes that are not UTF-8 (POSIX allows any) are escaped."""
    return str(path).encode("utf-8", "backslashreplace").decode()


def check_text(data: bytes, name: str, path: Path | None = None) -> tuple[Source | None, list[Diagnostic]]:
    """Check that bytes are text without NUL: UTF-8 with or without BOM; a listing may be UTF-16 or GB18030, too."""
    if len(data) > _limit_bytes():
        return None, [_too_large(name, len(data))]
    data, encoding = data.removeprefix(b"\xef\xbb\xbf"), ""
    if data[:2] in _UTF16_MARKS:
        decoded = _decoded(data, "utf-16", name)
        if decoded is None:
            return None, [_diagnostic(rules.NOT_TEXT, name, reason=Phrase("it looks like UTF-16; save it as UTF-8"))]
        data, encoding = decoded, "UTF-16"
    nul = data.find(b"\0")
    if nul >= 0:
        line = _line_at(data, nul)
        return None, [_diagnostic(rules.NOT_TEXT, name, line, reason=Phrase("it holds NUL bytes (a binary file?)"))]
    try:
        data.decode("utf-8") if not data.isascii() else None
    except UnicodeDecodeError as error:
        if (decoded := _decoded(data, _OTHER_ENCODING, name)) is not None:
            joined = _JOINED_COMMENT.search(data)
            line = 0 if joined is None else _line_at(data, joined.start())
            return Source(name=name, data=decoded, path=path, encoding=_OTHER_ENCODING, joined_line=line), []
        line = _line_at(data, error.start)
        reason = Phrase("byte {byte} in line {line}", byte=f"0x{data[error.start]:02x}", line=line)
        return None, [_diagnostic(rules.NOT_TEXT, name, line, reason=reason)]
    return Source(name=name, data=data, path=path, encoding=encoding), []


def is_listing_text(name: str, data: bytes) -> bool:
    """Whether a text is a listing of calls: by its file's suffix, else by its content."""
    suffix = PurePath(name).suffix.lower()
    if suffix in _JOB_SUFFIXES | _LISTING_SUFFIXES:
        return suffix in _LISTING_SUFFIXES
    return _LISTING_CALL.search(data[:_SEARCHED_BYTES]) is not None


def _line_at(data: bytes, offset: int) -> int:
    """Line of an offset in a text with any line ends, from 1."""
    return _LONE_RETURN.sub(b"\n", data[: offset + 1]).count(b"\n", 0, offset) + 1


def _decoded(data: bytes, encoding: str, name: str) -> bytes | None:
    """Decode a listing to UTF-8; None for another text, or another encoding."""
    try:
        decoded = data.decode(encoding).encode()
    except UnicodeDecodeError:
        return None
    return decoded if is_listing_text(name, decoded) else None


def _diagnostic(rule: d.Rule, name: str, line: int = 1, **fields: object) -> Diagnostic:
    return Diagnostic(rule=rule, span=Span(line=line), fields=fields, path=name)
