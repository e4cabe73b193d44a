"""Hovers: documentation of keywords, calls and functions, and the definitions of names."""

from __future__ import annotations

import numpy as np
from lsprotocol import types as lsp

from gusjob.frontend.parse.expressions import Expression, Mismatch
from gusjob.frontend.parse.operators import FUNCTIONS, NAMED_NUMBERS, NumberType
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.i18n.phrases import number
from gusjob.kinematics.units import UNITS, QuantityKind, spelling
from gusjob.lsp.definition import defines_number, definitions_of
from gusjob.lsp.query import LETTERS, Cursor, Query, cursor_at
from gusjob.lsp.reference import call_text, function_text, keyword_text
from gusjob.lsp.symbols import FileSymbols, Symbol


def hover(query: Query, position: lsp.Position) -> lsp.Hover | None:
    """Return the documentation of the word at a position."""
    cursor = cursor_at(query, position)
    match = cursor.word() if cursor else None
    if cursor is None or match is None:
        return None
    text = call_text(match[0]) if query.is_listing else _hover_text(query, cursor, match[0])
    letters = cursor.word(LETTERS)
    if not text and letters is not None and not query.is_listing:
        match, text = letters, keyword_text(cursor.line, letters[0])
    if not text:
        return None
    return lsp.Hover(contents=lsp.MarkupContent(kind=lsp.MarkupKind.Markdown, value=text))


def _hover_text(query: Query, cursor: Cursor, name: str) -> str:
    """Describe a name, a routine or a function; '' if it is none of them, or can't be one here."""
    if not cursor.in_expression or name.upper() == cursor.head:
        return ""
    files = query.files()
    own_file = query.own(files)
    found = definitions_of(files, own_file, cursor, name) if own_file else []
    if not found:
        return function_text(name) if name in FUNCTIONS or name in NAMED_NUMBERS else ""
    file, symbol = found[0]
    where = "" if file is own_file or file.path is None else f"\n\n{file.path.name}:{symbol.line}"
    value = _value(files, symbol, name)
    shown = f"\n\n{name} = {value}" if value else ""
    return f"```gusjob\n{_line(file, symbol)}\n```{shown}{where}"


def _line(file: FileSymbols, symbol: Symbol) -> str:
    return strip_comment(file.source.line(symbol.line)).strip() if file.source else ""


def _value(files: list[FileSymbols], symbol: Symbol, name: str) -> str:
    """Return the value of a name that is set exactly once, outside of blocks; else ''."""
    found = _constant_value(files, name, 0) if symbol.form == "let" else None
    if found is None:
        return ""
    value, (kind, system) = found
    if not isinstance(kind, QuantityKind):
        return ""
    canonical = (u for u, unit in UNITS.items() if (unit.kind, unit.times, unit.over) == (kind, 1, 1))
    unit = next((u for u in canonical if system in (0, UNITS[u].system) or UNITS[u].system == 0), "")
    return f"{number(value)} {spelling(unit)}".rstrip()


def _constant_value(files: list[FileSymbols], name: str, depth: int) -> tuple[float, NumberType] | None:
    if name in NAMED_NUMBERS:
        return None
    named = [e for file in files for e in file.symbols if defines_number(e, name)]
    if len(named) != 1 or named[0].form != "let" or named[0].enclosing or depth > 16 or named[0].statement is None:
        return None
    # Lines of one shape share a statement: the numbers are read from the line itself.
    file = next(file for file in files if named[0] in file.symbols)
    statement, _ = parse_statement(file.source.line(named[0].line), 1) if file.source else (None, [])
    expression: Expression | None = statement.arguments[0] if statement and statement.arguments else None
    if expression is None:
        return None
    inner = {one: _constant_value(files, one, depth + 1) for one in expression.names}
    if any(one is None for one in inner.values()):
        return None
    known = {one: found for one, found in inner.items() if found is not None}
    kind = expression.type(tuple(known[one][1] for one in expression.names))
    if isinstance(kind, Mismatch):
        return None
    with np.errstate(all="ignore"):
        value = expression.run(
            {one: np.float64(v) for one, (v, _) in known.items()},
            [np.float64(c.value) for c in expression.constants],
        )
    return (float(value), kind) if np.isfinite(value) else None
