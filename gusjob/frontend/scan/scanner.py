"""Lines to columns: the template of each line shape gives the row, the numbers of all lines are read at once.

What a shape means (a Template) is learned from its first line by the real parser. Lines whose shape has no template
(setup, errors ...) go to the parser one by one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field

from gusjob.frontend.scan.line_table import LineTable, line_table
from gusjob.frontend.scan.numerals import NumberForm, Numerals
from gusjob.frontend.scan.rows import Row, Rows, Template, join_rows, rows_of
from gusjob.frontend.scan.shape_ids import ShapeIds
from gusjob.frontend.scan.shapes import MAX_NUMBER, MIN_NUMBER
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints, with_constant

MAX_DIAGNOSTICS = 1000
"""Lines with diagnostics that are parsed one by one; the rest is only counted."""
CHUNK = 1 << 19
"""Bytes that are read at once: what is made of them fits into the cache of a core."""
_MANY_CHUNKS = 8
"""From so many chunks on, two are read at the same time."""

_MANY_LINES = 1000
"""From so many lines of a group on, it is worth to look whether they all have the same number."""
_LARGE = 1e9
"""Numbers up to here are not above MAX_NUMBER in any unit."""

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
    return join_rows(scan_parts(data, semicolon_comments=semicolon_comments, learn=learn, parse_line=parse_line))


def scan_parts(data: bytes, *, semicolon_comments: bool, learn: Learn, parse_line: ParseLine) -> list[Rows]:
    """Read all rows of a text, in parts that fit in the processor's cache. Arguments as of scan."""
    scanner = _ShapeScanner(learn=learn, parse_line=parse_line)
    line = 1
    for table in _tables(data, semicolon_comments=semicolon_comments):
        scanner.add(table, line)
        line += len(table)
    return scanner.in_order()


def _tables(data: bytes, *, semicolon_comments: bool) -> Iterator[LineTable]:
    """The tables of all chunks, in order; of a long text the next one is made while one is used."""

    def table_of(chunk: bytes) -> LineTable:
        return line_table(chunk, semicolon_comments=semicolon_comments)

    chunks = _chunks(data)
    if len(data) < _MANY_CHUNKS * CHUNK:
        yield from map(table_of, chunks)
        return
    from concurrent.futures import ThreadPoolExecutor  # Start-up time is part of the tool.

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(table_of, next(chunks))
        for chunk in chunks:
            table = coming.result()
            coming = pool.submit(table_of, chunk)
            yield table
        yield coming.result()


def _chunks(data: bytes) -> Iterator[bytes]:
    """Chunks of whole lines, each with its last line end."""
    position = 0
    while position < len(data):
        end = data.rfind(b"\n", position, position + CHUNK) + 1
        if not end:
            end = data.find(b"\n", position) + 1
        chunk = data[position : end or len(data)]
        yield chunk if chunk.endswith(b"\n") else chunk + b"\n"
        position += len(chunk)


_BLANK, _BY_PARSER = 0, 1
"""Numbers of the shapes of blank lines, and of shapes without a template."""
_BLANK_OP = 255


class _ShapeScanner(Struct, dict=True):
    """Puts the rows of all chunks together.

    Attributes:
        templates: By the number of a shape.
        parts: Rows of each chunk.
        further: Rows after the first one of their line.
    """

    learn: Learn
    parse_line: ParseLine
    shape_ids: ShapeIds = field(default_factory=ShapeIds)
    templates: list[Template | None] = field(default_factory=lambda: [Template(op=_BLANK_OP), None])
    parts: list[Rows] = field(default_factory=list)
    further: list[tuple[int, Row]] = field(default_factory=list)

    def _learn(self, code: bytes) -> int:
        """The number of a shape by the code of one of its lines."""
        if not code.strip():
            return _BLANK
        try:
            template = self.learn(code.decode("utf-8"))
        except UnicodeDecodeError:
            return _BY_PARSER
        if template is None:
            return _BY_PARSER
        self.templates.append(template)
        return len(self.templates) - 1

    def add(self, table: LineTable, first_line: int) -> None:
        """Read the lines of a chunk."""
        ids, first = self.shape_ids.look_up(table, self._learn, table.long_lines(), _BY_PARSER)
        groups: list[_LineGroup] = []
        for number, lines in _lines_by_id(ids):
            template = self.templates[number]
            if template is None or template.op == _BLANK_OP:
                continue
            if template.fixed or template.pointed or template.not_zero:
                fits = _fits(table.numerals, template, first[lines])
                ids[lines[~fits]] = _BY_PARSER
                lines = lines[fits]
            groups.append(_LineGroup(lines=lines, template=template))
        for group in _read_numbers(table.numerals, groups, first):
            ids[group.drop_odd()] = _BY_PARSER
        self._collect(ids, groups, first_line, self._parsed(table, ids, first_line))

    def _parsed(self, table: LineTable, ids: Ints, first_line: int) -> list[tuple[int, Row]]:
        """The first rows of lines that must be parsed one by one."""
        parsed: list[tuple[int, Row]] = []
        for i in np.flatnonzero(ids == _BY_PARSER).tolist():
            found = self.parse_line(first_line + i, table.lines[i].decode("utf-8", "replace"))
            parsed += [(i, row) for row in found[:1]]
            self.further += [(first_line + i, row) for row in found[1:]]
        return parsed

    def _collect(self, ids: Ints, groups: list[_LineGroup], first_line: int, parsed: list[tuple[int, Row]]) -> None:
        """Add the rows of one chunk: those of templates by columns, those that were parsed one by one."""
        op = np.array([_BLANK_OP if t is None else t.op for t in self.templates], dtype=np.uint8)[ids]
        system = np.array([0 if t is None else t.system for t in self.templates], dtype=np.int32)[ids]
        columns: dict[int, Floats] = {}

        def target(column: int) -> Floats:
            values = columns.get(column)
            if values is None:
                columns[column] = np.full(len(ids), np.nan)
            elif not values.flags.writeable:
                columns[column] = values.copy()
            return columns[column]

        for group in groups:
            for column, values in group.columns():
                if len(values) == len(ids):
                    columns[column] = values
                else:
                    target(column)[group.lines] = values
            for column, value in group.template.constants:
                target(column)[group.lines] = value
        for i, row in parsed:
            op[i], system[i] = row.op, row.system
            for column, value in row.values.items():
                target(column)[i] = value
        is_row = op != _BLANK_OP
        line = np.arange(first_line, first_line + len(ids), dtype=np.int32)
        columns = {column: with_constant(values) for column, values in columns.items()}
        part = Rows(op=op, line=line, system=with_constant(system), columns=columns)
        self.parts.append(part.unshared() if is_row.all() else part.pick(is_row))

    def in_order(self) -> list[Rows]:
        """Everything read so far, in file order."""
        if not self.further:
            return self.parts
        joined = join_rows([*self.parts, rows_of(self.further)])
        return [joined.pick(np.argsort(joined.line, kind="stable"))]


def _lines_by_id(ids: Ints) -> Iterator[tuple[int, Indices]]:
    """Each number of a shape that occurs, ascending, with its lines."""
    present = np.flatnonzero(np.bincount(ids)).tolist()
    if len(present) == 1:
        yield present[0], np.arange(len(ids))
        return
    small: npt.NDArray[np.integer] = ids.astype(np.uint16) if present[-1] < 1 << 16 else ids  # Sorted by radix.
    order = np.argsort(small, kind="stable")
    ends = np.cumsum(np.bincount(ids)[present]).tolist()
    for number, start, end in zip(present, [0, *ends], ends, strict=False):
        yield number, order[start:end]


def _fits(numerals: Numerals, template: Template, first: Indices) -> Bools:
    """Whether lines have the digits that are fixed in their template; `first`: the first numeral of each line."""
    fits = np.ones(len(first), dtype=np.bool_)
    for numeral, digits in template.fixed:
        values, lengths = numerals.digits(first + numeral)
        fits &= (lengths == len(digits)) & (values == np.uint64(int(digits)))
    for numeral in template.pointed:
        fits &= numerals.lengths(first + numeral) > 1
    for numeral in template.not_zero:
        fits &= numerals.digits(first + numeral)[0] != 0
    return fits


class _LineGroup(Struct, kw_only=True):
    """Lines of a chunk with one template, and their numbers, one column a slot."""

    lines: Indices
    template: Template
    numbers: list[Floats] = field(default_factory=list)

    def drop_odd(self) -> Indices:
        """Remove the lines with a number above MAX_NUMBER or below MIN_NUMBER, and return them."""
        odd = np.zeros(len(self.lines), dtype=np.bool_)
        for slot, numbers in zip(self.template.slots, self.numbers, strict=True):
            magnitudes = np.abs(numbers)
            odd |= magnitudes > MAX_NUMBER / max(1.0, slot.times / slot.over)
            odd |= (magnitudes < MIN_NUMBER) & (magnitudes != 0)
        dropped = self.lines[odd]
        self.lines, self.numbers = self.lines[~odd], [numbers[~odd] for numbers in self.numbers]
        return dropped

    def columns(self) -> Iterator[tuple[int, Floats]]:
        """Each column with the values of the lines."""
        for slot, numbers in zip(self.template.slots, self.numbers, strict=True):
            scaled = numbers if slot.times == 1 else numbers * slot.times
            yield slot.column, scaled if slot.over == 1 else scaled / slot.over


def _read_numbers(numerals: Numerals, groups: list[_LineGroup], first: Indices) -> list[_LineGroup]:
    """Read the numbers of all groups, those of one form at once; return the groups if there are odd numbers.

    Args:
        numerals: The numerals of the chunk.
        groups: The groups.
        first: First numeral of each line of the chunk, (n,).
    """
    wanted: dict[NumberForm, list[Indices]] = {}
    for group in groups:
        firsts = first[group.lines]
        for slot in group.template.slots:
            at = firsts + slot.numeral
            is_one = not slot.form.exponent and len(at) > _MANY_LINES and numerals.are_same(at)
            wanted.setdefault(slot.form, []).append(at[:1] if is_one else at)
    found: dict[NumberForm, Iterator[Floats]] = {}
    is_odd = False
    for form, parts in wanted.items():
        numbers = numerals.numbers(form, np.concatenate(parts))
        magnitudes = np.abs(numbers)
        is_odd |= bool(magnitudes.max(initial=0.0) > _LARGE)
        is_odd |= bool(np.count_nonzero(magnitudes < MIN_NUMBER) > np.count_nonzero(magnitudes == 0))
        ends = np.cumsum(list(map(len, parts))).tolist()
        found[form] = iter([numbers[start:end] for start, end in zip([0, *ends], ends, strict=False)])
    for group in groups:
        columns = [next(found[slot.form]) for slot in group.template.slots]
        count = len(group.lines)
        group.numbers = [c if len(c) == count else np.broadcast_to(c, count) for c in columns]
    return groups if is_odd else []
