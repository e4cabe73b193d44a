"""The symbols of a text, for the editor's outline."""

from __future__ import annotations

from lsprotocol import types as lsp

from gusjob.frontend.parse.statement_parser import strip_comment
from gusjob.lsp.query import Query, position_key
from gusjob.lsp.symbols import MODES, job_files
from gusjob.lsp.workspace import Workspace

_KINDS = {"def": lsp.SymbolKind.Function, "let": lsp.SymbolKind.Variable, "frame": lsp.SymbolKind.Namespace}


def document_symbols(query: Query, nested: bool) -> list[lsp.DocumentSymbol] | list[lsp.SymbolInformation] | None:
    """Return the routines, names, frames and laser modes of a text; `nested`: as a tree."""
    text = query.task.text
    own = job_files(None, text, Workspace({}))[0] if not query.is_listing else None
    if own is None:
        return []
    roots: list[lsp.DocumentSymbol] = []
    by_symbol: dict[int, lsp.DocumentSymbol] = {}
    flat: list[lsp.SymbolInformation] = []
    for symbol in own.symbols:
        if symbol.form not in _KINDS and symbol.form not in MODES:
            continue
        line = strip_comment(own.source.line(symbol.line)).strip() if own.source else ""
        kind = _KINDS.get(symbol.form, lsp.SymbolKind.Property)
        named = text.range(symbol.span)
        last = text.range(type(symbol.span)(line=symbol.end_line)).end
        whole = lsp.Range(
            start=lsp.Position(line=named.start.line, character=0), end=max(named.end, last, key=position_key)
        )
        name = (symbol.name or line)[:80] or symbol.form
        document_symbol = lsp.DocumentSymbol(
            name=name, kind=kind, range=whole, selection_range=named, detail=line[:80], children=[]
        )
        by_symbol[id(symbol)] = document_symbol
        flat.append(lsp.SymbolInformation(name=name, kind=kind, location=lsp.Location(uri=query.task.uri, range=whole)))
        parent = next((by_symbol[id(block)] for block in reversed(symbol.enclosing) if id(block) in by_symbol), None)
        (roots if parent is None else children_of(parent)).append(document_symbol)
    return roots if nested else flat


def children_of(document_symbol: lsp.DocumentSymbol) -> list[lsp.DocumentSymbol]:
    """Return the list of children of a symbol."""
    children = document_symbol.children
    assert isinstance(children, list)
    return children
