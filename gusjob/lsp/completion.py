"""Completion: the words, units, names and files that the grammar allows at a position."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from lsprotocol import types as lsp

from gusjob.controllers.gus.calls import SIGNATURES
from gusjob.diagnostics import rules
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords, parser
from gusjob.frontend.parse.misread import accepted_after
from gusjob.frontend.parse.operators import FUNCTIONS, NAMED_NUMBERS
from gusjob.frontend.parse.statement_parser import parse_statement
from gusjob.kinematics.units import UNITS, spelling
from gusjob.lsp.query import Cursor, Query, cursor_at
from gusjob.lsp.symbols import FileSymbols
from gusjob.patterns import lazy_pattern

_TYPED = lazy_pattern(r"[A-Za-z_]\w*$")
_NUMBER_TYPED = lazy_pattern(
    r"(?:(?<![\w.)])|(?<=\b[A-Za-z]))(?P<number>[0-9]+\.?[0-9]*|\.[0-9]+)(?P<unit>[A-Za-z%/][A-Za-z0-9/]*)?$"
)
MAX_FILES = 500
"""Maximum number of files that are offered for an INCLUDE."""


def completions(query: Query, position: lsp.Position) -> lsp.CompletionList | None:
    """Return the completions at a position."""
    cursor = cursor_at(query, position)
    if cursor is None:
        return None
    items = [*_call_items(cursor)] if query.is_listing else [*_job_items(query, cursor)]
    return lsp.CompletionList(is_incomplete=False, items=items)


def _call_items(cursor: Cursor) -> Iterator[lsp.CompletionItem]:
    if re.fullmatch(r"\s*\w*", cursor.before):
        for name, signature in SIGNATURES.items():
            yield lsp.CompletionItem(label=name, kind=lsp.CompletionItemKind.Function, detail=signature.prototype)


def _job_items(query: Query, cursor: Cursor) -> Iterator[lsp.CompletionItem]:
    if cursor.before.count('"') % 2:
        head = cursor.before[: cursor.before.rfind('"')]
        if "STRING" in accepted(head):
            yield from _file_items(query, cursor.before[len(head) + 1 :])
        return
    typed = _NUMBER_TYPED.search(cursor.before)
    if typed is not None:
        head = cursor.before[: typed.start("number")] + typed["number"]
        for unit in UNITS:
            if unit_fits(head, unit):
                yield _item(spelling(unit), lsp.CompletionItemKind.Unit)
        return
    match = _TYPED.search(cursor.before)
    head = cursor.before[: match.start()] if match else cursor.before
    if not match and re.search(r"[\w)]$", head):
        return  # A separator is missing.
    allowed = accepted(head)
    for word in allowed:
        if word in keywords(JOB_GRAMMAR) and (not head.strip() or word_fits(head, word)):
            yield _item(word, lsp.CompletionItemKind.Keyword)
    if "NAME" in allowed or "LPAR" in allowed:
        yield from _name_items(query, cursor, head, allowed)


def _item(label: str, kind: lsp.CompletionItemKind, insert: str | None = None) -> lsp.CompletionItem:
    return lsp.CompletionItem(label=label, kind=kind, insert_text=insert, filter_text=insert)


def accepted(head: str) -> list[str]:
    """Return the terminals that the grammar accepts after the beginning of a line."""
    return list(accepted_after(parser(JOB_GRAMMAR), head))


def word_fits(head: str, word: str) -> bool:
    """Return whether a statement accepts a word here.

    The grammar accepts any word in any statement; the reader checks which words a statement has, and that each occurs
    once.
    """
    _, diagnostics = parse_statement(f"{head}{word} 1", 1)
    return not any(diagnostic.rule in (rules.WORD_NOT_ALLOWED, rules.DUPLICATE_WORD) for diagnostic in diagnostics)


def unit_fits(head: str, unit: str) -> bool:
    """Return whether the number at the end of `head`, the beginning of a line, may have a unit."""
    _, diagnostics = parse_statement(head + unit, 1)
    return bool(accepted(head + unit)) and not any(diagnostic.rule is rules.WRONG_UNIT for diagnostic in diagnostics)


def _name_items(query: Query, cursor: Cursor, head: str, allowed: list[str]) -> Iterator[lsp.CompletionItem]:
    """Offer routines after CALL, elsewhere visible names and functions, in parentheses where they are needed."""
    files = query.files()
    own = query.own(files)
    if "QUANTITY" not in allowed:
        if re.fullmatch(r"\s*CALL\s+", head, re.IGNORECASE | re.ASCII):
            routines = {e.name: e for file in files for e in file.symbols if e.form == "def"}
            for name, symbol in routines.items():
                item = _item(name, lsp.CompletionItemKind.Function)
                item.detail = f"{name}({', '.join(symbol.parameters)})"
                yield item
        return
    bare = "NAME" in allowed
    for name in dict.fromkeys(chain(_visible_names(files, own, cursor.number), NAMED_NUMBERS)):
        yield _item(name, lsp.CompletionItemKind.Variable, None if bare else f"({name})")
    if bare:
        for name in FUNCTIONS:
            yield _item(name, lsp.CompletionItemKind.Function)


def _visible_names(files: list[FileSymbols], own: FileSymbols | None, line: int) -> Iterator[str]:
    """Yield names that may have a value in a line; names of the innermost blocks come first."""
    blocks = [e for e in own.symbols if e.contains(line)] if own else []
    for symbol in reversed(blocks):
        if symbol.form in ("for", "repeat") and symbol.name:
            yield symbol.name
        yield from symbol.parameters
    routine = next((e for e in blocks if e.form == "def"), None)
    for file in files:
        for symbol in file.symbols:
            above = file is not own or symbol.line < line or routine is not None
            if symbol.form == "let" and above and symbol.routine in (None, routine if file is own else None):
                yield symbol.name


def _file_items(query: Query, typed: str) -> Iterator[lsp.CompletionItem]:
    """Offer the jobs in the folder of the job, with the names that an INCLUDE in this file uses."""
    if query.task.path is None or query.top.path is None:
        return
    folder = query.top.path.resolve().parent
    own_path = query.task.path.resolve()
    typed_folder = typed.replace("\\", "/").rpartition("/")[0]
    for path in _job_paths(folder):
        if path not in (own_path, query.top.path.resolve()):
            name = Path(os.path.relpath(path, own_path.parent)).as_posix()
            if name.isprintable() and '"' not in name and name.startswith(f"{typed_folder}/" if typed_folder else ""):
                insert = name.removeprefix(f"{typed_folder}/") if typed_folder else name
                yield _item(name, lsp.CompletionItemKind.File, insert)


def _job_paths(folder: Path) -> list[Path]:
    """Find the jobs in a folder and its subfolders, without hidden ones and links that lead out of the folder."""
    found: list[Path] = []
    for here, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(names):
            path = Path(here, name)
            if path.suffix.lower() == ".job" and not name.startswith(".") and path.resolve().is_relative_to(folder):
                found.append(path)
        if len(found) >= MAX_FILES:
            break
    return found[:MAX_FILES]
