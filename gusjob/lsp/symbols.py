"""The files of a job and the symbols in them: names, blocks, includes and laser modes."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from msgspec import Struct, field

from gusjob.diagnostics.model import Span
from gusjob.frontend import Source, check_text, is_listing
from gusjob.frontend.includes import find_include
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.job_reader import read_job_text
from gusjob.frontend.parse.statement import BROKEN, RowOp, Statement
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.lsp.text import Text
from gusjob.lsp.workspace import Workspace

MODES = {"DUTY", "DUTY2", "FREQUENCY", "ANALOG"}
"""Forms of LASER MODE."""


class Symbol(Struct, eq=False):
    """A statement that defines a name, begins a block, includes a file or selects a laser mode.

    Attributes:
        form: Form of the statement, "frame" for a FRAME.
        line: Line of the statement.
        end_line: Last line of the block; `line` if the statement begins none.
        name: The defined name, or the included file.
        span: Span of the name, else of the statement.
        text: The statement; of an INCLUDE the file.
        parameters: Parameters of a DEF.
        enclosing: The blocks around the statement, the innermost last.
    """

    form: str
    line: int
    end_line: int
    name: str = ""
    span: Span = field(default_factory=lambda: Span(line=1))
    text: str = ""
    statement: Statement | None = None
    parameters: tuple[str, ...] = ()
    enclosing: tuple[Symbol, ...] = ()

    @property
    def routine(self) -> Symbol | None:
        """The DEF around the statement."""
        return next((block for block in self.enclosing if block.form == "def"), None)

    def contains(self, line: int) -> bool:
        """Return whether a line is in the block."""
        return self.line < line <= self.end_line


class FileSymbols(Struct, eq=False):
    """The symbols of one file of a job, in their order.

    `path`: None for a text that was never saved. `source`: None if the file can't be read as text.
    """

    path: Path | None
    text: Text
    source: Source | None
    symbols: list[Symbol]


def job_files(path: Path | None, text: Text, workspace: Workspace) -> list[FileSymbols]:
    """Return a job's file and all files that it includes, each once, in the order in which they are read."""
    name = "" if path is None else str(path)
    source, _ = check_text(text.data, name, None if path is None else workspace.path(path))
    files = [FileSymbols(path=path, text=text, source=source, symbols=_symbols(source))]
    if source is not None:
        _add_included_files(files, source, workspace, {None if path is None else path.resolve()})
    return files


def _add_included_files(files: list[FileSymbols], top: Source, workspace: Workspace, seen: set[Path | None]) -> None:
    """Add the files that the last of `files` includes, recursively."""
    file = files[-1]
    for symbol in file.symbols:
        path = include_target(symbol, file, top) if symbol.form == "include" else None
        if path is None or path in seen:
            continue
        seen.add(path)
        text = Text(workspace.bytes_of(path), file.text.unit)
        source, _ = check_text(text.data, str(path), workspace.path(path))
        files.append(FileSymbols(path=path, text=text, source=source, symbols=_symbols(source)))
        _add_included_files(files, top, workspace, seen)


def include_target(symbol: Symbol, file: FileSymbols, top: Source) -> Path | None:
    """Return the file of an INCLUDE; None if it may not be read."""
    if file.source is None:
        return None
    source = find_include(symbol.text, file.source, top).source
    return None if source is None or source.path is None else Path(source.path)  # A plain path, no WorkspacePath.


def _symbols(source: Source | None) -> list[Symbol]:
    """Return the symbols of a text, in its order."""
    if source is None or is_listing(source):
        return []
    read = read_job_text(source)
    op, line = read.rows.op, read.rows.line
    node, value = read.rows.column(Column.NODE), read.rows.column(Column.VALUE)
    relevant_rows = np.flatnonzero((op == RowOp.FRAME) | (op == RowOp.CONTROL) | (op == RowOp.SETUP))
    last = source.count_lines()
    found: list[Symbol] = []
    open_blocks: list[Symbol] = []
    for row in relevant_rows.tolist():
        number = int(line[row])
        if op[row] == RowOp.SETUP:
            statement: Statement | None = read.setups[int(value[row])]
        else:
            statement = None if op[row] == RowOp.FRAME else read.nodes[int(node[row])]
        form = "frame" if statement is None else statement.form
        if form == "end":
            if open_blocks:
                open_blocks.pop().end_line = number
        elif form != "else" and (op[row] != RowOp.SETUP or form in MODES):
            symbol = _symbol(form, number, statement, source)
            symbol.enclosing = tuple(open_blocks)
            found.append(symbol)
            if form in ("frame", "def", "if", "for", "repeat", BROKEN):
                symbol.end_line = last
                open_blocks.append(symbol)
    return found


def _symbol(form: str, line: int, statement: Statement | None, source: Source) -> Symbol:
    text = strip_comment(source.line(line))
    names = statement.names if statement else ()
    name = names[0] if names else ""
    start, end = len(text) - len(text.lstrip()), len(text.rstrip())
    whole = Span(line=line, column=start + 1, end_line=line, end_column=end + 1)
    parameters: tuple[str, ...] = ()
    if (
        form == "include"
    ):  # Read again: lines of one shape share a statement, and the names of two files may differ in digits only.
        own, _ = parse_statement(text, line)
        name = own.text if own else ""
    elif form == "def":
        parameters = names[1:]
    symbol = Symbol(
        form=form,
        line=line,
        end_line=line,
        name=name,
        span=whole,
        text=name if form == "include" else text.strip(),
        statement=statement,
        parameters=parameters,
    )
    if name and form != "include":
        symbol.span = named_span(symbol, text, name, last=form == "repeat") or whole
    return symbol


def named_span(symbol: Symbol, text: str, name: str, *, last: bool = False) -> Span | None:
    """Return the span of the first or last occurrence of a name in a line."""
    start, end = len(text) - len(text.lstrip()), len(text)
    keyword = re.match(r"\w+", text[start:])  # LET let = 1 is an error, but LET l = ... contains an l in LET.
    start += keyword.end() if keyword else 0
    matches = list(re.finditer(rf"(?<!\w){re.escape(name)}(?!\w)", text[start:end]))
    if not matches:
        return None
    match = matches[-1 if last else 0]
    first = start + match.start() + 1
    return Span(line=symbol.line, column=first, end_line=symbol.line, end_column=first + len(name))
