"""Lines to columns: the template of each line shape gives the row, the numbers of all lines are read at once.

What a shape means (a Template) is learned from its first line by the real parser. Lines whose shape has no template
(setup, errors, exponents ...) go to the parser one by one.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import orjson

from gusjob.frontend.scan.rows import Row, Rows, Template, groups_of, join_rows, rows_of
from gusjob.frontend.scan.shapes import (
    CHUNK,
    MAX_LINE,
    MAX_NUMBER,
    MIN_NUMBER,
    ShapeTable,
    collapse_digits,
    has_sums,
    number_runs,
)
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints

MAX_DIAGNOSTICS = 1000
"""Lines with diagnostics that are parsed one by one; the rest is only counted."""

_NUMBERS_ONLY = bytes(c if c in b"0123456789.+-" else 32 for c in range(256))
_SIGN_BEFORE_SIGN = re.compile(rb"[+-]+(?=[+-])")
_SIGN_AFTER_DIGIT = re.compile(rb"(?<=[0-9.])(?=[+-])")

Learn = Callable[[str], Template | None]
"""Gives the template of a line (without its comment); None if lines of its shape must be parsed one by one."""
ParseLine = Callable[[int, str], Sequence[Row]]
"""Gives the rows of a whole line by its number from 1. Collects its own diagnostics."""


def scan(data: bytes, *, semicolon_comments: bool, learn: Learn, parse_line: ParseLine) -> Rows:
    """Read all rows of a text.

    Args:
        data: UTF-8 bytes, lines ended by LF; CR is white space.
        semicolon_comments: Whether `;` begins a comment, as `//` does.
        learn: Called once for each line shape.
        parse_line: Called for each line whose shape has no template.
    """
    scanner = _ShapeScanner(semicolon_comments=semicolon_comments, learn=learn, parse_line=parse_line)
    if data and not data.endswith(b"\n"):
        data += b"\n"
    position, line = 0, 1
    while position < len(data):
        end = data.rfind(b"\n", position, position + CHUNK) + 1
        if not end:
            end = data.find(b"\n", position) + 1
        line += scanner.scan_chunk(data[position:end], line)
        position = end
    return scanner.rows()


_BLANK, _BY_PARSER = 0, 1
"""Ids of the shapes of blank lines, and of shapes without a template."""
_BLANK_OP = 255
_TOO_LONG = b"\0"
"""Stands for the shape of a line above MAX_LINE; no text has a NUL byte."""


@dataclass(slots=True)
class _ShapeScanner:
    semicolon_comments: bool
    learn: Learn
    parse_line: ParseLine
    shape_ids: ShapeTable[int] = field(init=False)
    templates: list[Template | None] = field(default_factory=lambda: [Template(op=_BLANK_OP), None])
    """By the id of a shape."""
    parts: list[Rows] = field(default_factory=list)
    has_sums: bool = False
    """Whether some shape has numbers that touch each other, with signs between them."""
    further: list[tuple[int, Row]] = field(default_factory=list)
    """Rows after the first one of their line."""

    def __post_init__(self) -> None:
        self.shape_ids = ShapeTable(self._learn, {_TOO_LONG: _BY_PARSER})

    def scan_chunk(self, text: bytes, first_line: int) -> int:
        """Read a chunk of whole lines; returns how many lines it has."""
        raw = np.frombuffer(text, dtype=np.uint8)
        ends = np.flatnonzero(raw == 10)
        starts = np.concatenate([[0], ends[:-1] + 1])
        comment, comment_starts = self._comments(raw, text, ends)
        shapes = _shapes(text, comment)
        if len(text) > MAX_LINE:
            for i in np.flatnonzero(ends - starts > MAX_LINE).tolist():
                shapes[i] = _TOO_LONG

        def code_of(i: int) -> bytes:
            end = ends[i] if comment_starts is None else min(int(ends[i]), int(comment_starts[i]))
            return text[starts[i] : end]

        ids = np.fromiter(self.shape_ids.look_up(shapes, code_of), dtype=np.int32, count=len(shapes))
        numbers, offsets, ids = self._numbers(raw, comment, ids, starts, ends)
        parsed: list[tuple[int, Row]] = []
        for i in np.flatnonzero(ids == _BY_PARSER).tolist():
            line = text[starts[i] : ends[i]].decode("utf-8", "replace")
            found = self.parse_line(first_line + i, line)
            parsed += [(i, row) for row in found[:1]]
            self.further += [(first_line + i, row) for row in found[1:]]
        self._collect(ids, numbers, offsets, first_line, parsed)
        return len(ends)

    def _comments(self, raw: npt.NDArray[np.uint8], text: bytes, ends: Indices) -> tuple[Bools | None, Indices | None]:
        """Mask of the bytes of comments, and where each line's comment begins (len(text) if it has none)."""
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
        comment_starts = np.full(len(ends), len(raw), dtype=np.intp)
        comment_starts[lines] = begins
        edges = np.zeros(len(raw), dtype=np.int8)
        edges[begins] = 1
        edges[ends[lines]] -= 1
        return np.cumsum(edges, dtype=np.int8).astype(np.bool_), comment_starts

    def _learn(self, code: bytes) -> int:
        """The id of a shape by the code of one of its lines."""
        if not code.strip():
            return _BLANK
        if number_runs(code) is None:
            return _BY_PARSER
        try:
            template = self.learn(code.decode("utf-8"))
        except UnicodeDecodeError:
            return _BY_PARSER
        if template is None:
            return _BY_PARSER
        self.has_sums |= has_sums(code)
        self.templates.append(template)
        return len(self.templates) - 1

    def _numbers(
        self,
        raw: npt.NDArray[np.uint8],
        comment: Bools | None,
        ids: npt.NDArray[np.int32],
        starts: Indices,
        ends: Indices,
    ) -> tuple[Floats, Ints, npt.NDArray[np.int32]]:
        """All numbers of the lines with a template, and each line's offset in them.

        The third array is the ids again: lines that turn out to need the parser are marked.
        """
        text = raw
        by_parser = np.flatnonzero(ids == _BY_PARSER)
        if comment is not None or len(by_parser):
            text = raw.copy()
            if comment is not None:
                text[comment] = 32
            for i in by_parser.tolist():
                text[starts[i] : ends[i]] = 32
        flat = text.tobytes()
        if self.has_sums:
            flat = _SIGN_AFTER_DIGIT.sub(b" ", _SIGN_BEFORE_SIGN.sub(b" ", flat))
        numbers = _decimal(flat)
        runs = [0 if t is None else len(t.slots) + len(t.fixed) for t in self.templates]
        counts = np.array(runs, dtype=np.int64)[ids]
        offsets = np.cumsum(counts) - counts
        if len(numbers) != int(counts.sum()):
            raise AssertionError("a shape's runs and its numbers differ")
        magnitudes = np.abs(numbers)
        if not (fits := (magnitudes <= MAX_NUMBER) & ((magnitudes >= MIN_NUMBER) | (magnitudes == 0))).all():
            ids = ids.copy()
            ids[np.unique(np.searchsorted(offsets + counts, np.flatnonzero(~fits), side="right"))] = _BY_PARSER
        return numbers, offsets, self._with_fixed_runs(numbers, offsets, ids)

    def _with_fixed_runs(self, numbers: Floats, offsets: Ints, ids: npt.NDArray[np.int32]) -> npt.NDArray[np.int32]:
        """The ids, with lines marked for the parser whose fixed runs are not those of their template, or zero."""
        for number in np.flatnonzero(np.bincount(ids)).tolist():
            template = self.templates[number]
            if template is None or not (template.fixed or template.not_zero):
                continue
            rows = np.flatnonzero(ids == number)
            differs = np.zeros(len(rows), dtype=np.bool_)
            for run, value in template.fixed:
                differs |= numbers[offsets[rows] + run] != value
            for run in template.not_zero:
                differs |= numbers[offsets[rows] + run] == 0
            if differs.any():
                ids = ids.copy()
                ids[rows[differs]] = _BY_PARSER
        return ids

    def _collect(
        self,
        ids: npt.NDArray[np.int32],
        numbers: Floats,
        offsets: Ints,
        first_line: int,
        parsed: list[tuple[int, Row]],
    ) -> None:
        """Add the rows of one chunk: those of templates by columns, those that were parsed one by one."""
        op = np.array([_BLANK_OP if t is None else t.op for t in self.templates], dtype=np.uint8)[ids]
        system = np.array([0 if t is None else t.system for t in self.templates], dtype=np.int32)[ids]
        columns: dict[int, Floats] = {}

        def target(column: int) -> Floats:
            if column not in columns:
                columns[column] = np.full(len(ids), np.nan)
            return columns[column]

        for number, rows in groups_of(ids):
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
        for i, row in parsed:
            op[i], system[i] = row.op, row.system
            for column, value in row.values.items():
                target(column)[i] = value
        is_row = op != _BLANK_OP
        line = np.arange(first_line, first_line + len(ids), dtype=np.int32)
        part = Rows(op=op, line=line, system=system, columns=columns)
        self.parts.append(part if is_row.all() else part.pick(is_row))

    def rows(self) -> Rows:
        """Everything read so far, in file order."""
        if not self.further:
            return join_rows(self.parts)
        joined = join_rows([*self.parts, rows_of(self.further)])
        return joined.pick(np.argsort(joined.line, kind="stable"))


def _shapes(text: bytes, comment: Bools | None) -> list[bytes]:
    """The shape of each line, as `shapes_of`, from arrays."""
    flat = np.frombuffer(collapse_digits(text), dtype=np.uint8)
    digit = flat == 48
    keep = np.ones(len(flat), dtype=np.bool_)
    np.logical_and(digit[1:], digit[:-1], out=keep[1:])
    np.logical_not(keep[1:], out=keep[1:])
    if comment is not None:
        keep &= ~comment
    shapes = flat[keep].tobytes().split(b"\n")
    shapes.pop()
    return shapes


def _decimal(text: bytes) -> Floats:
    """Every number in a text, correctly rounded; words are skipped."""
    words = text.translate(_NUMBERS_ONLY).split()
    try:
        return np.array(orjson.loads(b"[" + b",".join(words) + b"]"), dtype=np.float64) + 0.0  # -0 is 0.
    except (orjson.JSONDecodeError, OverflowError):  # +5, .5, 5. and 05 are not JSON; float takes them.
        return np.array([float(word) for word in words], dtype=np.float64) + 0.0
