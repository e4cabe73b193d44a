"""What names a job gives and which files it is made of: for jumps, symbols, hovers and completion."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gusjob.diagnostics.model import Span
from gusjob.frontend import Source, check_text, is_listing
from gusjob.frontend.includes import find_include
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.frontend.parse.statement import BROKEN, RowOp, Statement
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.lsp.desk import Desk
from gusjob.lsp.text import Text

MODES = {"DUTY", "DUTY2", "FREQUENCY", "ANALOG"}
"""Forms of LASER MODE."""


@dataclass(slots=True, eq=False)
class Entry:
    """A statement that gives a name, begins a block, includes a file or chooses a laser's mode.

    `name` and `span` of what is named; `end_line` of the block; `inside`: the blocks around it, the innermost last.
    """

    form: str
    line: int
    end_line: int
    name: str = ""
    span: Span = field(default_factory=lambda: Span(line=1))
    text: str = ""
    statement: Statement | None = None
    parameters: tuple[str, ...] = ()
    inside: tuple[Entry, ...] = ()

    @property
    def routine(self) -> Entry | None:
        """The DEF that it stands in."""
        return next((block for block in self.inside if block.form == "def"), None)

    def holds(self, line: int) -> bool:
        """Whether a line stands in the block."""
        return self.line < line <= self.end_line


@dataclass(slots=True, eq=False)
class FileOutline:
    """One file of a job. `path` is None for a text that was never saved; `source` is None where it is no text."""

    path: Path | None
    text: Text
    source: Source | None
    entries: list[Entry]


def job_files(path: Path | None, text: Text, desk: Desk) -> list[FileOutline]:
    """A job's file and all that it includes, in the order in which they are read; each once."""
    name = "" if path is None else str(path)
    source, _ = check_text(text.data, name, None if path is None else desk.path(path))
    files = [FileOutline(path=path, text=text, source=source, entries=_entries(source))]
    if source is not None:
        _add_included(files, source, desk, {None if path is None else path.resolve()})
    return files


def _add_included(files: list[FileOutline], top: Source, desk: Desk, seen: set[Path | None]) -> None:
    """Add what the last of the files includes, and what that includes."""
    file = files[-1]
    for entry in file.entries:
        path = target(entry, file, top) if entry.form == "include" else None
        if path is None or path in seen:
            continue
        seen.add(path)
        text = Text(desk.bytes_of(path), file.text.unit)
        source, _ = check_text(text.data, str(path), desk.path(path))
        files.append(FileOutline(path=path, text=text, source=source, entries=_entries(source)))
        _add_included(files, top, desk, seen)


def target(entry: Entry, file: FileOutline, top: Source) -> Path | None:
    """The file that an INCLUDE names, where it may be read."""
    if file.source is None:
        return None
    source, _ = find_include(entry.text, file.source, top)
    return None if source is None or source.path is None else Path(source.path)  # No longer one of the desk's.


def _entries(source: Source | None) -> list[Entry]:
    """The entries of a text in its order."""
    if source is None or is_listing(source):
        return []
    read = read_job_text(source)
    op, line = read.rows.op, read.rows.line
    node, value = read.rows.column(Column.NODE), read.rows.column(Column.VALUE)
    wanted = np.flatnonzero((op == RowOp.FRAME) | (op == RowOp.CONTROL) | (op == RowOp.SETUP))
    last = source.count_lines()
    found: list[Entry] = []
    open_blocks: list[Entry] = []
    for at in wanted.tolist():
        number = int(line[at])
        if op[at] == RowOp.SETUP:
            statement: Statement | None = read.setups[int(value[at])]
        else:
            statement = None if op[at] == RowOp.FRAME else read.nodes[int(node[at])]
        form = "frame" if statement is None else statement.form
        if form == "end":
            if open_blocks:
                open_blocks.pop().end_line = number
        elif form != "else" and (op[at] != RowOp.SETUP or form in MODES):
            entry = _entry(form, number, statement, source)
            entry.inside = tuple(open_blocks)
            found.append(entry)
            if form in ("frame", "def", "if", "for", "repeat", BROKEN):
                entry.end_line = last
                open_blocks.append(entry)
    return found


def _entry(form: str, line: int, statement: Statement | None, source: Source) -> Entry:
    text = strip_comment(source.line(line))
    names = statement.names if statement else ()
    name = names[0] if names else ""
    start, end = len(text) - len(text.lstrip()), len(text.rstrip())
    whole = Span(line=line, column=start + 1, end_line=line, end_column=end + 1)
    parameters: tuple[str, ...] = ()
    if form == "include":  # Read again: what the names of two files differ in may be digits.
        own, _ = parse_statement(text, line)
        name = own.text if own else ""
    elif form == "def":
        parameters = names[1:]
    entry = Entry(
        form=form, line=line, end_line=line, name=name, span=whole, text=name if form == "include" else text.strip(),
        statement=statement, parameters=parameters,
    )  # fmt: skip
    if name and form != "include":
        entry.span = named_span(entry, text, name, last=form == "repeat") or whole
    return entry


def named_span(entry: Entry, text: str, name: str, *, last: bool = False) -> Span | None:
    """Where a name stands in a line, the first or the last time."""
    start, end = len(text) - len(text.lstrip()), len(text)
    keyword = re.match(r"\w+", text[start:])  # LET let = 1 is refused, but LET l = ... holds an l in LET.
    start += keyword.end() if keyword else 0
    matches = list(re.finditer(rf"(?<!\w){re.escape(name)}(?!\w)", text[start:end]))
    if not matches:
        return None
    match = matches[-1 if last else 0]
    first = start + match.start() + 1
    return Span(line=entry.line, column=first, end_line=entry.line, end_column=first + len(name))
