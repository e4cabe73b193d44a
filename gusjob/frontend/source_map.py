"""The texts of a job: lines are numbered through all of its files."""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path

from msgspec import Struct, field

from gusjob.diagnostics.model import SET_HERE, Remark, Span
from gusjob.frontend.parse.statement import Statement
from gusjob.frontend.parse.statement_parser import parse_statement
from gusjob.frontend.source import Source


class SourceMap(Struct):
    """Texts whose line numbers continue from one to the next, so that the first text keeps its own.

    Attributes:
        sources: The texts.
        bases: The offset of each text's line numbers.
        included_paths: The files that INCLUDEs name, whether or not they could be read.
        included_at: For each text the line of its first INCLUDE, 0 for the job's own.
    """

    sources: list[Source] = field(default_factory=list)
    bases: list[int] = field(default_factory=list)
    included_paths: list[Path] = field(default_factory=list)
    included_at: list[int] = field(default_factory=list)

    def add(self, source: Source, included_at: int = 0) -> int:
        """Add a text; returns the offset of its line numbers. `included_at`: line of the INCLUDE."""
        base = self.bases[-1] + self.sources[-1].count_lines() if self.sources else 0
        self.sources.append(source)
        self.bases.append(base)
        self.included_at.append(included_at)
        return base

    def find(self, line: int) -> tuple[Source, int]:
        """The text of a line, and the line's number in it."""
        at = self._index(line)
        return self.sources[at], line - self.bases[at]

    def _index(self, line: int) -> int:
        return max(bisect_right(self.bases, line - 1) - 1, 0)

    def reading_order(self, line: int) -> tuple[int, ...]:
        """A key by which lines are in the order in which they are read: the INCLUDEs around a line, and the line."""
        around = [line]
        while at := self._index(around[0]):
            around.insert(0, self.included_at[at])
        return tuple(around)

    @property
    def files(self) -> tuple[tuple[str, int], ...]:
        """Name and offset of every text, where there is more than one."""
        named = tuple((source.name, base) for source, base in zip(self.sources, self.bases, strict=True))
        return named if len(named) > 1 else ()

    def text_of(self, span: Span) -> str:
        """The text of a span's first line."""
        named = (source for source in self.sources[1:] if source.name == span.path)
        source = next(named, None) if span.path else self.sources[0]
        return source.line(span.line) if source else ""

    def statement(self, line: int) -> Statement | None:
        """Parse the statement of a line again."""
        source, number = self.find(line)
        return parse_statement(source.line(number), number)[0]

    def locate(self, line: int, word: str) -> Span:
        """The span of a word of a line ('' for the statement)."""
        source, number = self.find(line)
        path = "" if source is self.sources[0] else source.name
        statement = parse_statement(source.line(number), number)[0]
        return statement.span(number, word, path) if statement else Span(line=number, path=path)

    def name_remarks(self, line: int, word: str, lets: dict[str, list[int]]) -> tuple[Remark, ...]:
        """Where the names in a word's expression are set: of several LETs the last one above the line.

        Args:
            line: Line of the statement.
            word: Its word ('value' for a positional number).
            lets: Lines that set each name.
        """
        statement = self.statement(line)
        quantity = statement.words.get("" if word == "value" else word) if statement else None
        names = quantity.expression.names if quantity and quantity.expression else ()
        remarks = []
        for name in names:
            setters = lets.get(name, [])
            candidates = [setter for setter in setters if setter < line] or setters
            if candidates:
                span = self.locate(candidates[-1], "")
                remarks.append(Remark(text=SET_HERE, span=span, fields={"name": name}))
        return tuple(remarks)
