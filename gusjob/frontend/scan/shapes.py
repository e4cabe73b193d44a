"""Lines to columns. A file of a million lines has a handful of line shapes, each understood once.

The shape of a line is the line without its comment, with every run of digits made one digit: `LINE X 1.5 Y -20 ; a`
becomes `LINE X 0.0 Y -0`. What a shape means (a Template) is learnt from its first line by the real parser; then the
numbers of all its lines are read at once. Lines whose shape has no template (setup, diagnostics, exponents ...) go to
the parser one by one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
import orjson

from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints

MAX_LINE = 10_000
"""Characters in a statement; longer lines are diagnostics, not work."""
MAX_NUMBER = 1e15
"""Larger numbers are diagnostics: whole numbers are exact up to here, and no product of two of them overflows."""
MAX_DIAGNOSTICS = 1000
"""Lines with diagnostics that are read one by one; the rest is only counted."""

_CHUNK = 1 << 21
_COLLAPSE = bytes(48 if 48 <= c < 58 else c for c in range(256))
_NUMBERS_ONLY = bytes(c if c in b"0123456789.+-" else 32 for c in range(256))
_COMMENT = re.compile(rb"(?:;|//)[^\n]*")
_RUN = re.compile(rb"[0-9.+-]+")
_NUMBER = rb"(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_SIGNED = re.compile(rb"[+-]?" + _NUMBER)
_SUM = re.compile(rb"[+-]*" + _NUMBER + rb"(?:[+-]+" + _NUMBER + rb")*")
_SIGN_BEFORE_SIGN = re.compile(rb"[+-]+(?=[+-])")
_SIGN_BEHIND_DIGIT = re.compile(rb"(?<=[0-9.])(?=[+-])")


def chunks(data: bytes) -> Iterator[bytes]:
    """A text in pieces of whole lines, without the last one's end."""
    position = 0
    while position < len(data):
        end = data.rfind(b"\n", position, position + _CHUNK)
        if end < 0:
            end = data.find(b"\n", position)
        end = len(data) if end < 0 else end
        yield data[position:end]
        position = end + 1


def without_comments(text: bytes) -> bytes:
    """Lines of a job without their comments; the same object where there is none."""
    return _COMMENT.sub(b"", text) if b";" in text or b"//" in text else text


def shapes_of(code: bytes) -> list[bytes]:
    """Each line with its runs of digits made one digit."""
    code = code.translate(_COLLAPSE)
    while b"00" in code:
        code = code.replace(b"00", b"0")
    return code.split(b"\n")


@dataclass(frozen=True, slots=True, kw_only=True)
class Slot:
    """Number run `run` of a line goes to `column` as value * times / over."""

    column: int
    run: int
    times: float = 1.0
    over: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """What every line of a shape says: one row. `fixed`: runs that are part of a word (mm/s2) and their value."""

    op: int
    system: int = 0
    slots: tuple[Slot, ...] = ()
    constants: tuple[tuple[int, float], ...] = ()
    fixed: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One row that was read by the parser itself."""

    op: int
    system: int = 0
    values: dict[int, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Rows in file order.

    op (n,) uint8, line (n,) int32 from 1, system (n,) int32, columns {number: (n,) float64, NaN if absent}.
    """

    op: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    system: npt.NDArray[np.int32]
    columns: dict[int, Floats]

    def column(self, number: int) -> Floats:
        """A column; all NaN (and without memory) if no row has it."""
        found = self.columns.get(number)
        return np.broadcast_to(np.float64(np.nan), len(self.op)) if found is None else found

    def pick(self, where: npt.NDArray[Any] | slice) -> Rows:
        """The rows at a mask, at indices or in a slice."""
        columns = {k: v[where] for k, v in self.columns.items()}
        return Rows(op=self.op[where], line=self.line[where], system=self.system[where], columns=columns)


Learn = Callable[[str], Template | None]
"""A line (comment stripped) to its template; None if it is to be read alone."""
ReadLine = Callable[[int, str], Sequence[Row]]
"""Line number from 1 and the whole line -> its rows. Notes its own diagnostics."""


def number_runs(line: bytes) -> list[tuple[int, int]] | None:
    """(start, end) of every number in a line, with the sign that touches it; None if one is no plain decimal number.

    In a sum, 2-1 or x+-1, each number has the sign in front of it: 2 and -1, -1.
    """
    runs = []
    for match in _RUN.finditer(line):
        if not _SUM.fullmatch(match[0]):
            return None
        runs += [(match.start() + part.start(), match.start() + part.end()) for part in _SIGNED.finditer(match[0])]
    return runs


def scan(data: bytes, *, semicolon_comments: bool, learn: Learn, read_line: ReadLine) -> Rows:
    """All rows of a text (UTF-8 bytes, lines ended by LF; CR is white space)."""
    scanner = _Scanner(semicolon_comments=semicolon_comments, learn=learn, read_line=read_line)
    if data and not data.endswith(b"\n"):
        data += b"\n"
    position, line = 0, 1
    while position < len(data):
        end = data.rfind(b"\n", position, position + _CHUNK) + 1
        if not end:
            end = data.find(b"\n", position) + 1
        line += scanner.chunk(data[position:end], line)
        position = end
    return scanner.rows()


_BLANK, _ALONE = 0, 1
_BLANK_OP = 255


@dataclass(slots=True)
class _Scanner:
    semicolon_comments: bool
    learn: Learn
    read_line: ReadLine
    shape_ids: dict[bytes, int] = field(default_factory=dict)
    templates: list[Template | None] = field(default_factory=lambda: [Template(op=_BLANK_OP), None])
    parts: list[Rows] = field(default_factory=list)
    sums: bool = False
    """Whether some shape has numbers that touch each other, with signs between."""
    more: list[tuple[int, Row]] = field(default_factory=list)
    """Rows behind the first one of their line."""

    def chunk(self, text: bytes, first_line: int) -> int:
        """Read one chunk of whole lines; returns how many lines it has."""
        raw = np.frombuffer(text, dtype=np.uint8)
        ends = np.flatnonzero(raw == 10)
        starts = np.concatenate([[0], ends[:-1] + 1])
        comment, comment_at = self._comments(raw, text, ends)
        shapes = self._shapes(raw, text, comment)
        lengths = ends - starts
        if len(text) > MAX_LINE and (too_long := np.flatnonzero(lengths > MAX_LINE)).size:
            for i in too_long.tolist():
                shapes[i] = b"\0"
        if set(shapes) - self.shape_ids.keys():
            for i, shape in enumerate(shapes):
                if shape not in self.shape_ids:
                    end = ends[i] if comment_at is None else min(int(ends[i]), int(comment_at[i]))
                    self.shape_ids[shape] = self._learn(shape, text[starts[i] : end])
        ids = np.fromiter(map(self.shape_ids.__getitem__, shapes), dtype=np.int32, count=len(shapes))
        numbers, offsets, ids = self._numbers(raw, comment, ids, starts, ends)
        alone: list[tuple[int, Row]] = []
        for i in np.flatnonzero(ids == _ALONE).tolist():
            line = text[starts[i] : ends[i]].decode("utf-8", "replace")
            found = self.read_line(first_line + i, line)
            alone += [(i, row) for row in found[:1]]
            self.more += [(first_line + i, row) for row in found[1:]]
        self._collect(ids, numbers, offsets, first_line, alone)
        return len(ends)

    def _comments(self, raw: npt.NDArray[np.uint8], text: bytes, ends: Indices) -> tuple[Bools | None, Indices | None]:
        """Mask of the bytes of comments, and where each line's comment begins (len(text) if none)."""
        slashes = b"//" in text
        if not slashes and not (self.semicolon_comments and b";" in text):
            return None, None
        marks = np.zeros(len(raw), dtype=np.bool_)
        if slashes:
            marks[:-1] = (raw[:-1] == 47) & (raw[1:] == 47)
        if self.semicolon_comments:
            marks |= raw == 59
        at = np.flatnonzero(marks)
        lines, first = np.unique(np.searchsorted(ends, at), return_index=True)
        begins = at[first]
        comment_at = np.full(len(ends), len(raw), dtype=np.intp)
        comment_at[lines] = begins
        edges = np.zeros(len(raw), dtype=np.int8)
        edges[begins] = 1
        edges[ends[lines]] -= 1
        return np.cumsum(edges, dtype=np.int8).astype(np.bool_), comment_at

    def _shapes(self, raw: npt.NDArray[np.uint8], text: bytes, comment: Bools | None) -> list[bytes]:
        flat = np.frombuffer(text.translate(_COLLAPSE), dtype=np.uint8)
        digit = flat == 48
        keep = np.ones(len(flat), dtype=np.bool_)
        np.logical_and(digit[1:], digit[:-1], out=keep[1:])
        np.logical_not(keep[1:], out=keep[1:])
        if comment is not None:
            keep &= ~comment
        shapes = flat[keep].tobytes().split(b"\n")
        shapes.pop()
        return shapes

    def _learn(self, shape: bytes, line: bytes) -> int:
        if not shape.strip():
            return _BLANK
        if shape == b"\0" or number_runs(shape) is None:
            return _ALONE
        try:
            template = self.learn(line.decode("utf-8"))
        except UnicodeDecodeError:
            return _ALONE
        if template is None:
            return _ALONE
        self.sums |= any(not _SIGNED.fullmatch(match[0]) for match in _RUN.finditer(shape))
        self.templates.append(template)
        return len(self.templates) - 1

    def _runs_per_id(self) -> Ints:
        return np.array([0 if t is None else len(t.slots) + len(t.fixed) for t in self.templates], dtype=np.int64)

    def _numbers(
        self,
        raw: npt.NDArray[np.uint8],
        comment: Bools | None,
        ids: npt.NDArray[np.int32],
        starts: Indices,
        ends: Indices,
    ) -> tuple[Floats, Ints, npt.NDArray[np.int32]]:
        """All numbers of the lines with a template, and each line's offset in them.

        The third is the ids again: lines that turn out to need the parser are marked.
        """
        text = raw
        alone = np.flatnonzero(ids == _ALONE)
        if comment is not None or len(alone):
            text = raw.copy()
            if comment is not None:
                text[comment] = 32
            for i in alone.tolist():
                text[starts[i] : ends[i]] = 32
        flat = text.tobytes()
        if self.sums:
            flat = _SIGN_BEHIND_DIGIT.sub(b" ", _SIGN_BEFORE_SIGN.sub(b" ", flat))
        numbers = _decimal(flat)
        counts = self._runs_per_id()[ids]
        offsets = np.cumsum(counts) - counts
        if len(numbers) != int(counts.sum()):
            raise AssertionError("a shape's runs and its numbers differ")
        if len(numbers) and not (np.abs(numbers) <= MAX_NUMBER).all():
            huge = np.flatnonzero(~(np.abs(numbers) <= MAX_NUMBER))
            bad = np.unique(np.searchsorted(offsets + counts, huge, side="right"))
            ids = ids.copy()
            ids[bad] = _ALONE
        for number in np.flatnonzero(np.bincount(ids)).tolist():
            template = self.templates[number]
            if template is None or not template.fixed:
                continue
            rows = np.flatnonzero(ids == number)
            differs = np.zeros(len(rows), dtype=np.bool_)
            for run, value in template.fixed:
                differs |= numbers[offsets[rows] + run] != value
            if differs.any():
                ids = ids.copy()
                ids[rows[differs]] = _ALONE
        return numbers, offsets, ids

    def _collect(
        self,
        ids: npt.NDArray[np.int32],
        numbers: Floats,
        offsets: Ints,
        first_line: int,
        alone: list[tuple[int, Row]],
    ) -> None:
        """Rows of one chunk: those of templates by columns, those that were read alone one by one."""
        op = np.array([_BLANK_OP if t is None else t.op for t in self.templates], dtype=np.uint8)[ids]
        system = np.array([0 if t is None else t.system for t in self.templates], dtype=np.int32)[ids]
        columns: dict[int, Floats] = {}

        def target(column: int) -> Floats:
            if column not in columns:
                columns[column] = np.full(len(ids), np.nan)
            return columns[column]

        order = np.argsort(ids, kind="stable")
        present, begins = np.unique(ids[order], return_index=True)
        for number, rows in zip(present.tolist(), np.split(order, begins[1:]), strict=True):
            template = self.templates[number]
            if template is None:
                continue
            base = offsets[rows]
            for slot in template.slots:
                values = numbers[base + slot.run]
                if slot.times != 1:
                    values = values * slot.times
                target(slot.column)[rows] = values if slot.over == 1 else values / slot.over
            for column, value in template.constants:
                target(column)[rows] = value
        for i, row in alone:
            op[i], system[i] = row.op, row.system
            for column, value in row.values.items():
                target(column)[i] = value
        filled = op != _BLANK_OP
        line = np.arange(first_line, first_line + len(ids), dtype=np.int32)
        part = Rows(op=op, line=line, system=system, columns=columns)
        self.parts.append(part if filled.all() else part.pick(filled))

    def rows(self) -> Rows:
        """Everything read, in file order."""
        if not self.more:
            return join(self.parts)
        used = sorted({c for _, row in self.more for c in row.values})
        behind = Rows(
            op=np.array([row.op for _, row in self.more], dtype=np.uint8),
            line=np.array([line for line, _ in self.more], dtype=np.int32),
            system=np.array([row.system for _, row in self.more], dtype=np.int32),
            columns={c: np.array([row.values.get(c, np.nan) for _, row in self.more]) for c in used},
        )
        joined = join([*self.parts, behind])
        return joined.pick(np.argsort(joined.line, kind="stable"))


def _decimal(text: bytes) -> Floats:
    """Every number in a text whose words are to be passed over, correctly rounded."""
    words = text.translate(_NUMBERS_ONLY).split()
    try:
        return np.array(orjson.loads(b"[" + b",".join(words) + b"]"), dtype=np.float64) + 0.0  # -0 is 0.
    except (orjson.JSONDecodeError, OverflowError):  # +5, .5, 5. and 05 are not JSON; float takes them.
        return np.array([float(word) for word in words], dtype=np.float64) + 0.0


def join(parts: list[Rows]) -> Rows:
    """Rows one behind the other."""
    if len(parts) == 1:
        return parts[0]
    used = sorted({c for part in parts for c in part.columns})
    return Rows(
        op=np.concatenate([p.op for p in parts]) if parts else np.empty(0, dtype=np.uint8),
        line=np.concatenate([p.line for p in parts]) if parts else np.empty(0, dtype=np.int32),
        system=np.concatenate([p.system for p in parts]) if parts else np.empty(0, dtype=np.int32),
        columns={c: np.concatenate([p.column(c) for p in parts]) for c in used},
    )
