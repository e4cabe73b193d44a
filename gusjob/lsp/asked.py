"""A question about a text: the job that the text is a part of, and the place in it."""

from __future__ import annotations

import re
from dataclasses import dataclass

from lsprotocol import types as lsp

from gusjob.frontend import check_text, is_listing
from gusjob.frontend.parse.statement_parser import strip_comment
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.lsp.desk import Desk, uri_of
from gusjob.lsp.judge import Judged
from gusjob.lsp.outline import FileOutline, job_files
from gusjob.lsp.worker import Task

WORD = re.compile(r"[A-Za-z_]\w*")
LETTERS = re.compile(r"[A-Za-z_]+2?")
NAMED_HERE = {"LET", "REPEAT", "FOR", "IF", "CALL", "DEF"}
"""Statements whose names stand without parentheses."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """A text that a question is about. `top`: the open job that includes it, else itself; `judged`: what is wrong with
    it, where that is known of this very text."""

    task: Task
    top: Task
    judged: Judged | None

    @property
    def is_listing(self) -> bool:
        """Whether it holds calls."""
        name = self.task.uri if self.task.path is None else str(self.task.path)
        source, _ = check_text(self.task.text.data, name)
        return source is not None and is_listing(source)

    def files(self) -> list[FileOutline]:
        """The files of the job that the text is a part of."""
        return job_files(self.top.path, self.top.text, Desk(self.top.open_texts))

    def own(self, files: list[FileOutline]) -> FileOutline | None:
        """Which of them it is."""
        if self.task is self.top or self.task.path == self.top.path:
            return files[0]
        key = None if self.task.path is None else self.task.path.resolve()
        return next((file for file in files if file.path is not None and file.path.resolve() == key), None)

    def uri(self, file: FileOutline) -> str:
        """The URI of one of its files, as the editor has it."""
        if file.path is None or file.path == self.top.path:
            return self.top.uri
        return self.top.uris.get(str(file.path.resolve())) or uri_of(file.path)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A place in a line: the line without its comment, the place in characters, gusjob's number of the line."""

    line: str
    column: int
    number: int

    @property
    def before(self) -> str:
        return self.line[: self.column]

    @property
    def head(self) -> str:
        found = LETTERS.match(self.line.strip())
        return found[0].upper() if found else ""

    @property
    def in_expression(self) -> bool:
        return self.head in NAMED_HERE or self.before.count("(") > self.before.count(")")

    def word(self, pattern: re.Pattern[str] = WORD) -> re.Match[str] | None:
        """The word that the place touches."""
        return next((m for m in pattern.finditer(self.line) if m.start() <= self.column <= m.end()), None)


def spot_at(asked: Asked, position: lsp.Position) -> Spot | None:
    """Where a question points; None behind a comment's start, and in a line that nobody could have written."""
    text = asked.task.text
    line = text.line(position.line)
    if len(line) > MAX_LINE:
        return None
    bare = line.split("//")[0] if asked.is_listing else strip_comment(line)
    column = text.column(position)
    return Spot(line=bare, column=column, number=text.own_line(position)) if column <= len(bare) else None


def key_of(position: lsp.Position) -> tuple[int, int]:
    return position.line, position.character
