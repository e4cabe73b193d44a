"""The context of an editor's request: the text, the job that it is a part of, and the position in it."""

from __future__ import annotations

import re

from lsprotocol import types as lsp
from msgspec import Struct

from gusjob.frontend import check_text, is_listing
from gusjob.frontend.parse.statement_parser import strip_comment
from gusjob.frontend.scan.shapes import MAX_LINE
from gusjob.lsp.diagnostics import Diagnosis
from gusjob.lsp.symbols import FileSymbols, job_files
from gusjob.lsp.worker import Task
from gusjob.lsp.workspace import Workspace, uri_of
from gusjob.patterns import lazy_pattern

WORD = lazy_pattern(r"[A-Za-z_]\w*")
LETTERS = lazy_pattern(r"[A-Za-z_]+2?")
BARE_NAME_STATEMENTS = {"LET", "REPEAT", "FOR", "IF", "CALL", "DEF"}
"""Statements in which names need no parentheses."""


class Query(Struct, frozen=True, kw_only=True):
    """The text that a request is about.

    Attributes:
        task: The text, with all open texts.
        top: The open job that includes the text, else `task`.
        diagnosis: The diagnostics of exactly this text; None while they are not known.
    """

    task: Task
    top: Task
    diagnosis: Diagnosis | None

    @property
    def is_listing(self) -> bool:
        """Whether the text is a listing of calls."""
        name = self.task.uri if self.task.path is None else str(self.task.path)
        source, _ = check_text(self.task.text.data, name)
        return source is not None and is_listing(source)

    def files(self) -> list[FileSymbols]:
        """Return the files of the job that the text is a part of."""
        return job_files(self.top.path, self.top.text, Workspace(self.top.open_texts))

    def own(self, files: list[FileSymbols]) -> FileSymbols | None:
        """Return the file among `files` that is this text."""
        if self.task is self.top or self.task.path == self.top.path:
            return files[0]
        key = None if self.task.path is None else self.task.path.resolve()
        return next((file for file in files if file.path is not None and file.path.resolve() == key), None)

    def uri(self, file: FileSymbols) -> str:
        """Return the URI of a file of the job; the editor's own URI if the file is open."""
        if file.path is None or file.path == self.top.path:
            return self.top.uri
        return self.top.uris.get(str(file.path.resolve())) or uri_of(file.path)


class Cursor(Struct, frozen=True, kw_only=True):
    """A position in a line.

    Attributes:
        line: The line without its comment.
        column: Position in the line, in characters from 0.
        number: Line number, as gusjob counts lines, from 1.
    """

    line: str
    column: int
    number: int

    @property
    def before(self) -> str:
        """The line up to the position."""
        return self.line[: self.column]

    @property
    def head(self) -> str:
        """The first keyword of the line."""
        found = LETTERS.match(self.line.strip())
        return found[0].upper() if found else ""

    @property
    def in_expression(self) -> bool:
        """Whether the position may be inside an expression."""
        return self.head in BARE_NAME_STATEMENTS or self.before.count("(") > self.before.count(")")

    def word(self, pattern: re.Pattern[str] = WORD) -> re.Match[str] | None:
        """Return the word at the position."""
        return next((m for m in pattern.finditer(self.line) if m.start() <= self.column <= m.end()), None)


def cursor_at(query: Query, position: lsp.Position) -> Cursor | None:
    """Return the cursor at a position; None in a comment, and in a line longer than MAX_LINE."""
    text = query.task.text
    line = text.line(position.line)
    if len(line) > MAX_LINE:
        return None
    bare = line.split("//")[0] if query.is_listing else strip_comment(line)
    column = text.column(position)
    return Cursor(line=bare, column=column, number=text.own_line(position)) if column <= len(bare) else None


def position_key(position: lsp.Position) -> tuple[int, int]:
    """Return a key that sorts positions."""
    return position.line, position.character
