"""Answers to an editor that looks: what a word is, where it was set, what a text has in it."""

from __future__ import annotations

import re

import numpy as np
from lsprotocol import types as lsp

from gusjob.frontend.parse.expressions import Expression, Mismatch
from gusjob.frontend.parse.operators import FUNCTIONS, NAMED_NUMBERS, NumberType
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.i18n.phrases import number
from gusjob.kinematics.units import UNITS, QuantityKind, spelling
from gusjob.lsp.asked import LETTERS, Asked, Spot, key_of, spot_at
from gusjob.lsp.desk import Desk, uri_of
from gusjob.lsp.manual import call_text, function_text, keyword_text
from gusjob.lsp.outline import MODES, Entry, FileOutline, job_files, target

# Hover.


def hover(asked: Asked, position: lsp.Position) -> lsp.Hover | None:
    """What the word at a place is."""
    spot = spot_at(asked, position)
    match = spot.word() if spot else None
    if spot is None or match is None:
        return None
    told = call_text(match[0]) if asked.is_listing else _hover_text(asked, spot, match[0])
    letters = spot.word(LETTERS)
    if not told and letters is not None and not asked.is_listing:
        match, told = letters, keyword_text(spot.line, letters[0])
    if not told:
        return None
    return lsp.Hover(contents=lsp.MarkupContent(kind=lsp.MarkupKind.Markdown, value=told))


def _hover_text(asked: Asked, spot: Spot, name: str) -> str:
    """A name, a routine or a function; '' if it is none, or cannot be one here."""
    if not spot.in_expression or name.upper() == spot.head:
        return ""
    files = asked.files()
    own = asked.own(files)
    found = _meant(files, own, spot, name) if own else []
    if not found:
        return function_text(name) if name in FUNCTIONS or name in NAMED_NUMBERS else ""
    file, entry = found[0]
    where = "" if file is own or file.path is None else f"\n\n{file.path.name}:{entry.line}"
    value = _value(files, entry, name)
    shown = f"\n\n{name} = {value}" if value else ""
    return f"```gusjob\n{_line(file, entry)}\n```{shown}{where}"


def _line(file: FileOutline, entry: Entry) -> str:
    return strip_comment(file.source.line(entry.line)).strip() if file.source else ""


def _value(files: list[FileOutline], entry: Entry, name: str) -> str:
    """What a name is worth, where that does not hang on the place: it is set once, in the open."""
    found = _constant(files, name, 0) if entry.form == "let" else None
    if found is None:
        return ""
    value, (kind, system) = found
    if not isinstance(kind, QuantityKind):
        return ""
    canonical = (u for u, unit in UNITS.items() if (unit.kind, unit.times, unit.over) == (kind, 1, 1))
    unit = next((u for u in canonical if system in (0, UNITS[u].system) or UNITS[u].system == 0), "")
    return f"{number(value)} {spelling(unit)}".rstrip()


def _constant(files: list[FileOutline], name: str, depth: int) -> tuple[float, NumberType] | None:
    if name in NAMED_NUMBERS:
        return None
    named = [e for file in files for e in file.entries if _gives(e, name)]
    if len(named) != 1 or named[0].form != "let" or named[0].inside or depth > 16 or named[0].statement is None:
        return None
    # The statement of a shape stands for all its lines: the numbers are in the line itself.
    file = next(file for file in files if named[0] in file.entries)
    own, _ = parse_statement(file.source.line(named[0].line), 1) if file.source else (None, [])
    expression: Expression | None = own.arguments[0] if own and own.arguments else None
    if expression is None:
        return None
    inner = {one: _constant(files, one, depth + 1) for one in expression.names}
    if any(one is None for one in inner.values()):
        return None
    known = {one: found for one, found in inner.items() if found is not None}
    kind = expression.type(tuple(known[one][1] for one in expression.names))
    if isinstance(kind, Mismatch):
        return None
    with np.errstate(all="ignore"):
        value = expression.run({one: np.float64(v) for one, (v, _) in known.items()},
                               [np.float64(c.value) for c in expression.constants])  # fmt: skip
    return (float(value), kind) if np.isfinite(value) else None


# Names.


def _gives(entry: Entry, name: str) -> bool:
    """Whether a statement sets a number's name."""
    return (entry.form in ("let", "for", "repeat") and entry.name == name) or name in entry.parameters


def _meant(files: list[FileOutline], own: FileOutline | None, spot: Spot, name: str) -> list[tuple[FileOutline, Entry]]:
    """The statements that a name at a place may come from, the likeliest first."""
    every = [(file, entry) for file in files for entry in file.entries]
    if re.search(rf"(?:CALL|DEF)\s+{re.escape(name)}(?!\w)", spot.line, re.IGNORECASE):
        return [(file, entry) for file, entry in every if entry.form == "def" and entry.name == name]
    here = [e for e in own.entries if e.holds(spot.number) or e.line == spot.number] if own else []
    blocks = [e for e in here if e.form in ("for", "repeat", "def") and _gives(e, name)]
    if own is not None and blocks:
        return [(own, blocks[-1])]
    routine = next((e for e in here if e.form == "def"), None)
    lets = [(f, e) for f, e in every if e.form == "let" and e.name == name]
    inside = [(f, e) for f, e in lets if f is own and routine is not None and e.routine is routine]
    open_road = [(f, e) for f, e in lets if e.routine is None]
    for some in (inside, open_road):
        # As a diagnostic's note has it (syntax/files.py, set_here): of several LETs the last one above.
        above = [(f, e) for f, e in some if f is not own or e.line <= spot.number]
        if above or some:
            return [*reversed(above), *[one for one in some if one not in above]]
    return []


def definition(asked: Asked, position: lsp.Position) -> list[lsp.Location] | None:
    """Where the name at a place was set, the routine defined; the file that is included."""
    spot = spot_at(asked, position)
    if spot is None or asked.is_listing:
        return None
    files = asked.files()
    own = asked.own(files)
    if own is None:
        return None
    if spot.head == "INCLUDE":
        entry = next((e for e in own.entries if e.line == spot.number and e.form == "include"), None)
        top = files[0].source
        path = target(entry, own, top) if entry and top else None
        if path is None:
            return None
        uri = asked.top.uris.get(str(path)) or uri_of(path)
        start = lsp.Position(line=0, character=0)
        return [lsp.Location(uri=uri, range=lsp.Range(start=start, end=start))]
    match = spot.word()
    if match is None or not spot.in_expression:
        return None
    found = _meant(files, own, spot, match[0])
    # Where the name is a routine's parameter, the DEF; of LETs the one that counts.
    return [lsp.Location(uri=asked.uri(f), range=f.text.range(e.span)) for f, e in found[:1]] or None


# Symbols.

_KINDS = {"def": lsp.SymbolKind.Function, "let": lsp.SymbolKind.Variable, "frame": lsp.SymbolKind.Namespace}


def symbols(asked: Asked, nested: bool) -> list[lsp.DocumentSymbol] | list[lsp.SymbolInformation] | None:
    """Routines, names, frames and lasers of a text; `nested`: as a tree."""
    text = asked.task.text
    own = job_files(None, text, Desk({}))[0] if not asked.is_listing else None
    if own is None:
        return []
    roots: list[lsp.DocumentSymbol] = []
    made: dict[int, lsp.DocumentSymbol] = {}
    flat: list[lsp.SymbolInformation] = []
    for entry in own.entries:
        if entry.form not in _KINDS and entry.form not in MODES:
            continue
        line = strip_comment(own.source.line(entry.line)).strip() if own.source else ""
        kind = _KINDS.get(entry.form, lsp.SymbolKind.Property)
        named = text.range(entry.span)
        last = text.range(type(entry.span)(line=entry.end_line)).end
        whole = lsp.Range(start=lsp.Position(line=named.start.line, character=0), end=max(named.end, last, key=key_of))
        name = (entry.name or line)[:80] or entry.form
        symbol = lsp.DocumentSymbol(
            name=name, kind=kind, range=whole, selection_range=named, detail=line[:80], children=[]
        )
        made[id(entry)] = symbol
        flat.append(lsp.SymbolInformation(name=name, kind=kind, location=lsp.Location(uri=asked.task.uri, range=whole)))
        around = next((made[id(block)] for block in reversed(entry.inside) if id(block) in made), None)
        (roots if around is None else list_of(around)).append(symbol)
    return roots if nested else flat


def list_of(symbol: lsp.DocumentSymbol) -> list[lsp.DocumentSymbol]:
    """The children of a symbol, to be added to."""
    children = symbol.children
    assert isinstance(children, list)
    return children
