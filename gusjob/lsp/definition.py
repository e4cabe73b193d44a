"""Definitions of names, routines and included files."""

from __future__ import annotations

import re

from lsprotocol import types as lsp

from gusjob.lsp.query import Cursor, Query, cursor_at
from gusjob.lsp.symbols import FileSymbols, Symbol, include_target
from gusjob.lsp.workspace import uri_of


def defines_number(symbol: Symbol, name: str) -> bool:
    """Return whether a statement defines a name that has a number."""
    return (symbol.form in ("let", "for", "repeat") and symbol.name == name) or name in symbol.parameters


def definitions_of(
    files: list[FileSymbols], own_file: FileSymbols | None, cursor: Cursor, name: str
) -> list[tuple[FileSymbols, Symbol]]:
    """Return the statements that may define a name at a position, the most likely first."""
    all_symbols = [(file, symbol) for file in files for symbol in file.symbols]
    if re.search(rf"(?:CALL|DEF)\s+{re.escape(name)}(?!\w)", cursor.line, re.IGNORECASE | re.ASCII):
        return [(file, symbol) for file, symbol in all_symbols if symbol.form == "def" and symbol.name == name]
    at_line = [s for s in own_file.symbols if s.contains(cursor.number) or s.line == cursor.number] if own_file else []
    blocks = [s for s in at_line if s.form in ("for", "repeat", "def") and defines_number(s, name)]
    if own_file is not None and blocks:
        return [(own_file, blocks[-1])]
    routine = next((s for s in at_line if s.form == "def"), None)
    lets = [(f, s) for f, s in all_symbols if s.form == "let" and s.name == name]
    local_lets = [(f, s) for f, s in lets if f is own_file and routine is not None and s.routine is routine]
    global_lets = [(f, s) for f, s in lets if s.routine is None]
    for scope in (local_lets, global_lets):
        # As in the notes of diagnostics: of several LETs the last one above the position.
        above = [(f, s) for f, s in scope if f is not own_file or s.line <= cursor.number]
        if above or scope:
            return [*reversed(above), *[one for one in scope if one not in above]]
    return []


def definition(query: Query, position: lsp.Position) -> list[lsp.Location] | None:
    """Return the definition of the name or routine at a position, or the included file."""
    cursor = cursor_at(query, position)
    if cursor is None or query.is_listing:
        return None
    files = query.files()
    own_file = query.own(files)
    if own_file is None:
        return None
    if cursor.head == "INCLUDE":
        symbol = next((s for s in own_file.symbols if s.line == cursor.number and s.form == "include"), None)
        top = files[0].source
        path = include_target(symbol, own_file, top) if symbol and top else None
        if path is None:
            return None
        uri = query.top.uris.get(str(path)) or uri_of(path)
        start = lsp.Position(line=0, character=0)
        return [lsp.Location(uri=uri, range=lsp.Range(start=start, end=start))]
    match = cursor.word()
    if match is None or not cursor.in_expression:
        return None
    found = definitions_of(files, own_file, cursor, match[0])
    # Of a parameter the DEF; of several LETs the one that is in effect.
    return [lsp.Location(uri=query.uri(f), range=f.text.range(s.span)) for f, s in found[:1]] or None
