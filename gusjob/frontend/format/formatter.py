"""Format a job's text: statements, blocks, comments, blank lines.

A job of a million lines has a handful of line shapes: how a shape is formatted is found once, and the digits of its
other lines are put in. Numbers are not computed with, so they stay as they were written.
"""

from __future__ import annotations

import re
from itertools import groupby
from operator import itemgetter

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.expand.program import MAX_NESTING
from gusjob.frontend.format.statement import canonical
from gusjob.frontend.parse.job_reader import more_diagnostics, read_job_text
from gusjob.frontend.parse.statement import BLOCK_WORDS
from gusjob.frontend.scan.shapes import MAX_LINE, ShapeTable, chunks, shapes_of, strip_comments
from gusjob.frontend.source import Source, check_text
from gusjob.patterns import lazy_pattern

INDENT = 2
COMMENT_GAP = 2
"""Least number of spaces between a statement and its comment."""
MAX_BLANK_LINES = 2
TAB = 8
"""Distance of tab stops: they decide in which column a comment is."""

_BOM = "\ufeff"
_BLANKS = b" \t\r"
_DIGITS = lazy_pattern(rb"[0-9]+")
_DIGITS_ONLY = bytes(c if 48 <= c < 58 else 32 for c in range(256))
_BEFORE_WORD_DIGITS = lazy_pattern(rb"(?:/[ \t\r]*m?s|duty)$", re.IGNORECASE)
"""Before digits that may be part of a unit or keyword: 5mm/s2 is a number, 5mm/s3 is divided by a name."""
_LONG = 4000
"""Formatting at most doubles a line, so a shorter one does not exceed MAX_LINE."""


def format_text(text: str) -> tuple[str | None, list[Diagnostic]]:
    """Format a job's text; None with diagnostics if it can't be parsed."""
    source, diagnostics = check_text(text.encode("utf-8", "surrogatepass"), "")
    if source is None:
        return None, diagnostics
    data, diagnostics = format_source(source)
    return (None if data is None else _BOM * text.startswith(_BOM) + data.decode()), diagnostics


def format_source(source: Source) -> tuple[bytes | None, list[Diagnostic]]:
    """Format a job; None with diagnostics if it can't be parsed. The result has no BOM, as the source has none."""
    text = read_job_text(source)
    diagnostics = [*text.diagnostics, *([more_diagnostics(text)] if text.diagnostics_not_listed else [])]
    if diagnostics:
        return None, [replace(diagnostic, path=source.name) for diagnostic in diagnostics]
    first = source.data.find(b"\n")
    end = b"\r\n" if first > 0 and source.data[first - 1] == ord("\r") else b"\n"
    formatter = _JobFormatter()
    for chunk in chunks(source.data.replace(b"\r\n", b"\n")):
        formatter.add_chunk(chunk)
    lines = formatter.finish()
    return (end.join([*lines, b""]) if lines else b""), []


class _LineFormat(Struct, frozen=True, kw_only=True):
    """How the lines of a shape are written.

    Attributes:
        pattern: The statement, with a %b for each run of digits.
        runs: How many there are.
        same: The lines are canonical already, except for blanks at their ends.
        fixed: Runs that must be those of the line from which this was learned.
        closes: The statement ends a block.
        opens: The statement begins a block.
    """

    pattern: bytes
    runs: int = 0
    same: bool = False
    fixed: tuple[tuple[int, bytes], ...] = ()
    closes: bool = False
    opens: bool = False


_NO_STATEMENT = _LineFormat(pattern=b"")


class _JobFormatter(Struct):
    lines: list[bytes] = field(default_factory=list)
    trailing_comments: list[tuple[int, int, bytes]] = field(default_factory=list)
    """Comments after statements: index of the line, the column where it was, the comment."""
    formats: ShapeTable[_LineFormat] = field(default_factory=lambda: ShapeTable(_line_format))
    exceptions: dict[bytes, _LineFormat] = field(default_factory=dict)
    """Formats of lines that differ from their shape in a fixed run, by their code."""
    depth: int = 0
    blank: int = 0
    """Blank lines since the last line that was not blank."""

    def add_chunk(self, text: bytes) -> None:
        """Format some whole lines."""
        lines = text.split(b"\n")
        bare = strip_comments(text)
        codes = lines if bare is text else bare.split(b"\n")
        runs = bare.translate(_DIGITS_ONLY).split()
        at = 0
        for found, code, line in zip(
            self.formats.look_up(shapes_of(bare), codes.__getitem__), codes, lines, strict=True
        ):
            if found is _NO_STATEMENT:
                self.add_without_statement(line)
                continue
            start, at = at, at + found.runs
            if found.fixed and any(runs[start + i] != run for i, run in found.fixed):
                found = self.exceptions.get(code) or self.exceptions.setdefault(code, _line_format(code))
            if found.closes:
                self.depth = max(self.depth - 1, 0)
            statement = code.strip(_BLANKS) if found.same else found.pattern % tuple(runs[start:at])
            if len(line) == len(code):
                self.add_line(statement, line)
            else:
                comment = line[len(code) :].rstrip(_BLANKS)
                if self.add_line(statement, line, comment):
                    self.trailing_comments.append((len(self.lines) - 1, _width(code), comment))
            self.depth += found.opens

    def add_without_statement(self, line: bytes) -> None:
        """Add a blank line, or one with nothing but a comment."""
        comment = line.strip(_BLANKS)
        if comment:
            self.add_line(comment, line)
        else:
            self.blank += 1

    def add_line(self, text: bytes, line: bytes, comment: bytes = b"") -> bool:
        """Add a line at the block's indent; False if it stays as it was, since it would become too long."""
        if self.blank:
            self.lines += [b""] * (min(self.blank, MAX_BLANK_LINES) if self.lines else 0)
            self.blank = 0
        indent = INDENT * min(self.depth, MAX_NESTING)
        if len(line) > _LONG and indent + len(text) + COMMENT_GAP + len(comment) >= MAX_LINE:
            self.lines.append(line.rstrip(_BLANKS))
            return False
        self.lines.append(b" " * indent + text if indent else text)
        return True

    def finish(self) -> list[bytes]:
        """All lines, with the comments after their statements.

        Consecutive comments that were in one column are put in one column again, whatever lines are between them: the
        same column if the statements leave it free.
        """
        for column, group in groupby(self.trailing_comments, key=itemgetter(1)):
            comments = list(group)
            widths = [_width(self.lines[i]) for i, _, _ in comments]
            column = max(column, max(widths) + COMMENT_GAP)
            if len(comments) == 1 or column + max(len(comment) for _, _, comment in comments) >= MAX_LINE:
                column = 0
            for (i, _, comment), width in zip(comments, widths, strict=True):
                self.lines[i] += b" " * max(column - width, COMMENT_GAP) + comment
        return self.lines


def _width(text: bytes) -> int:
    """Columns that a text takes."""
    text = text.expandtabs(TAB) if b"\t" in text else text
    return len(text) if text.isascii() else len(text.decode())


def _line_format(code: bytes) -> _LineFormat:
    """How a line without its comment, and all others of its shape, are written."""
    code = code.strip(_BLANKS)
    if not code:
        return _NO_STATEMENT
    text, keyword = canonical(code.decode())
    runs = list(_DIGITS.finditer(code))
    return _LineFormat(
        pattern=_DIGITS.sub(b"%b", text.encode().replace(b"%", b"%%")),
        runs=len(runs),
        same=text.encode() == code,
        fixed=tuple((i, run[0]) for i, run in enumerate(runs) if _BEFORE_WORD_DIGITS.search(code[: run.start()])),
        closes=keyword in ("END", "ELSE"),
        opens=keyword in (*BLOCK_WORDS, "ELSE"),
    )
