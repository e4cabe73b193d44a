"""A job's text in the one layout: statements, blocks, comments, blank lines.

A job of a million lines has a handful of shapes (syntax/shapes.py): how a shape is laid out is found once, and the
digits of its other lines are put in. Nothing is computed with numbers, so they stay as they were written.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from itertools import groupby
from operator import itemgetter

from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend import Source, check_text
from gusjob.frontend.expand.program import MAX_NESTING
from gusjob.frontend.format.statement import canonical
from gusjob.frontend.parse.job_reader import BLOCK_WORDS, more_diagnostics, read_job_text
from gusjob.frontend.scan.shapes import MAX_LINE, chunks, shapes_of, without_comments

INDENT = 2
COMMENT_GAP = 2
"""Spaces between a statement and its comment, at least."""
MAX_BLANK_LINES = 2
TAB = 8
"""A tab stop every so many columns: where comments of a text with tabs stand."""

_BOM = "\ufeff"
_BLANKS = b" \t\r"
_DIGITS = re.compile(rb"[0-9]+")
_DIGITS_ONLY = bytes(c if 48 <= c < 58 else 32 for c in range(256))
_TELLING = re.compile(rb"(?:/[ \t\r]*m?s|duty)$", re.IGNORECASE)
"""In front of digits that may be part of a unit or a keyword: 5mm/s2 is a number, 5mm/s3 is divided by a name."""
_LONG = 4000
"""A shorter line does not become longer than MAX_LINE, since layout at most doubles it."""


def formatted(text: str) -> tuple[str | None, list[Diagnostic]]:
    """A job's text laid out; None with what can't be read in it."""
    source, diagnostics = check_text(text.encode("utf-8", "surrogatepass"), "")
    if source is None:
        return None, diagnostics
    data, diagnostics = laid_out(source)
    return (None if data is None else _BOM * text.startswith(_BOM) + data.decode()), diagnostics


def laid_out(source: Source) -> tuple[bytes | None, list[Diagnostic]]:
    """The same for a source: bytes as its own, without BOM."""
    read = read_job_text(source)
    diagnostics = [*read.diagnostics, *([more_diagnostics(read)] if read.diagnostics_not_listed else [])]
    if diagnostics:
        return None, [replace(diagnostic, path=source.name) for diagnostic in diagnostics]
    first = source.data.find(b"\n")
    end = b"\r\n" if first > 0 and source.data[first - 1] == ord("\r") else b"\n"
    writer = _Writer()
    for chunk in chunks(source.data.replace(b"\r\n", b"\n")):
        writer.chunk(chunk)
    lines = writer.finished()
    return (end.join([*lines, b""]) if lines else b""), []


@dataclass(frozen=True, slots=True, kw_only=True)
class _Form:
    """How the lines of a shape are written: `pattern` takes their runs of digits.

    `same`: but for blanks at their ends, they are that already. `fixed`: runs that must be as in the line that it was
    learnt from. `closes`, `opens`: a block.
    """

    pattern: bytes
    runs: int = 0
    same: bool = False
    fixed: tuple[tuple[int, bytes], ...] = ()
    closes: bool = False
    opens: bool = False


_NO_STATEMENT = _Form(pattern=b"")


@dataclass(slots=True)
class _Writer:
    lines: list[bytes] = field(default_factory=list)
    tails: list[tuple[int, int, bytes]] = field(default_factory=list)
    """Comments behind statements: index of the line, the column where it stood, the comment."""
    forms: dict[bytes, _Form] = field(default_factory=dict)
    """By shape."""
    alone: dict[bytes, _Form] = field(default_factory=dict)
    """By text, of lines that only look like their shape."""
    depth: int = 0
    blank: int = 0
    """Blank lines since the last line that was none."""

    def chunk(self, text: bytes) -> None:
        """Lay out some whole lines."""
        lines = text.split(b"\n")
        bare = without_comments(text)
        codes = lines if bare is text else bare.split(b"\n")
        runs = bare.translate(_DIGITS_ONLY).split()
        at = 0
        for shape, code, line in zip(shapes_of(bare), codes, lines, strict=True):
            form = self.forms.get(shape)
            if form is None:
                form = self.forms[shape] = _learnt(code)
            if form is _NO_STATEMENT:
                self.without_statement(line)
                continue
            start, at = at, at + form.runs
            if form.fixed and any(runs[start + i] != run for i, run in form.fixed):
                form = self.alone.get(code) or self.alone.setdefault(code, _learnt(code))
            if form.closes:
                self.depth = max(self.depth - 1, 0)
            statement = code.strip(_BLANKS) if form.same else form.pattern % tuple(runs[start:at])
            if len(line) == len(code):
                self.put(statement, line)
            else:
                comment = line[len(code) :].rstrip(_BLANKS)
                if self.put(statement, line, comment):
                    self.tails.append((len(self.lines) - 1, _width(code), comment))
            self.depth += form.opens

    def without_statement(self, line: bytes) -> None:
        """A blank line, or one with nothing but a comment."""
        comment = line.strip(_BLANKS)
        if comment:
            self.put(comment, line)
        else:
            self.blank += 1

    def put(self, text: bytes, line: bytes, comment: bytes = b"") -> bool:
        """One line at the block's indent; False if it stays as it was written, since else it would become too long."""
        if self.blank:
            self.lines += [b""] * (min(self.blank, MAX_BLANK_LINES) if self.lines else 0)
            self.blank = 0
        indent = INDENT * min(self.depth, MAX_NESTING)
        if len(line) > _LONG and indent + len(text) + COMMENT_GAP + len(comment) >= MAX_LINE:
            self.lines.append(line.rstrip(_BLANKS))
            return False
        self.lines.append(b" " * indent + text if indent else text)
        return True

    def finished(self) -> list[bytes]:
        """All lines, with the comments behind their statements.

        Comments that stood below each other, whatever stands between them, do so again: in the same column if there is
        room.
        """
        for column, group in groupby(self.tails, key=itemgetter(1)):
            tails = list(group)
            widths = [_width(self.lines[i]) for i, _, _ in tails]
            column = max(column, max(widths) + COMMENT_GAP)
            if len(tails) == 1 or column + max(len(comment) for _, _, comment in tails) >= MAX_LINE:
                column = 0
            for (i, _, comment), width in zip(tails, widths, strict=True):
                self.lines[i] += b" " * max(column - width, COMMENT_GAP) + comment
        return self.lines


def _width(text: bytes) -> int:
    """Columns that a text takes."""
    text = text.expandtabs(TAB) if b"\t" in text else text
    return len(text) if text.isascii() else len(text.decode())


def _learnt(code: bytes) -> _Form:
    """How a line without its comment, and all of its shape, are written."""
    code = code.strip(_BLANKS)
    if not code:
        return _NO_STATEMENT
    text, keyword = canonical(code.decode())
    runs = list(_DIGITS.finditer(code))
    return _Form(
        pattern=_DIGITS.sub(b"%b", text.encode().replace(b"%", b"%%")),
        runs=len(runs),
        same=text.encode() == code,
        fixed=tuple((i, run[0]) for i, run in enumerate(runs) if _TELLING.search(code[: run.start()])),
        closes=keyword in ("END", "ELSE"),
        opens=keyword in (*BLOCK_WORDS, "ELSE"),
    )
