"""What may stand at a place, as the parser has it."""

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
from gusjob.lsp.asked import Asked, Spot, spot_at
from gusjob.lsp.outline import FileOutline

_TYPED = re.compile(r"[A-Za-z_]\w*$")
_NUMBER_TYPED = re.compile(
    r"(?:(?<![\w.)])|(?<=\b[A-Za-z]))(?P<number>[0-9]+\.?[0-9]*|\.[0-9]+)(?P<unit>[A-Za-z%/][A-Za-z0-9/]*)?$"
)
MAX_FILES = 500
"""So many files are offered for an INCLUDE."""


# Completion.


def complete(asked: Asked, position: lsp.Position) -> lsp.CompletionList | None:
    """What may stand at a place."""
    spot = spot_at(asked, position)
    if spot is None:
        return None
    items = [*_calls(spot)] if asked.is_listing else [*_choices(asked, spot)]
    return lsp.CompletionList(is_incomplete=False, items=items)


def _calls(spot: Spot) -> Iterator[lsp.CompletionItem]:
    if re.fullmatch(r"\s*\w*", spot.before):
        for name, signature in SIGNATURES.items():
            yield lsp.CompletionItem(label=name, kind=lsp.CompletionItemKind.Function, detail=signature.prototype)


def _choices(asked: Asked, spot: Spot) -> Iterator[lsp.CompletionItem]:
    if spot.before.count('"') % 2:
        head = spot.before[: spot.before.rfind('"')]
        if "STRING" in accepted(head):
            yield from _file_items(asked, spot.before[len(head) + 1 :])
        return
    typed = _NUMBER_TYPED.search(spot.before)
    if typed is not None:
        head = spot.before[: typed.start("number")] + typed["number"]
        for unit in UNITS:
            if unit_fits(head, unit):
                yield _item(spelling(unit), lsp.CompletionItemKind.Unit)
        return
    match = _TYPED.search(spot.before)
    head = spot.before[: match.start()] if match else spot.before
    if not match and re.search(r"[\w)]$", head):
        return  # Something must stand between.
    allowed = accepted(head)
    for word in allowed:
        if word in keywords(JOB_GRAMMAR) and (not head.strip() or word_fits(head, word)):
            yield _item(word, lsp.CompletionItemKind.Keyword)
    if "NAME" in allowed or "LPAR" in allowed:
        yield from _name_items(asked, spot, head, allowed)


def _item(label: str, kind: lsp.CompletionItemKind, insert: str | None = None) -> lsp.CompletionItem:
    return lsp.CompletionItem(label=label, kind=kind, insert_text=insert, filter_text=insert)


def accepted(head: str) -> list[str]:
    """Terminals that the grammar takes behind the beginning of a line."""
    return list(accepted_after(parser(JOB_GRAMMAR), head))


def word_fits(head: str, word: str) -> bool:
    """Whether a statement takes a word: the grammar leaves it to the reader which one takes which, and only once."""
    _, diagnostics = parse_statement(f"{head}{word} 1", 1)
    return not any(diagnostic.rule in (rules.FOREIGN, rules.TWICE) for diagnostic in diagnostics)


def unit_fits(head: str, unit: str) -> bool:
    """Whether a number at the end of the beginning of a line may have a unit."""
    _, diagnostics = parse_statement(head + unit, 1)
    return bool(accepted(head + unit)) and not any(diagnostic.rule is rules.WRONG_UNIT for diagnostic in diagnostics)


def _name_items(asked: Asked, spot: Spot, head: str, allowed: list[str]) -> Iterator[lsp.CompletionItem]:
    """Routines behind CALL; elsewhere names in sight and functions, in parentheses where an expression needs them."""
    files = asked.files()
    own = asked.own(files)
    if "QUANTITY" not in allowed:
        if re.fullmatch(r"\s*CALL\s+", head, re.IGNORECASE):
            routines = {e.name: e for file in files for e in file.entries if e.form == "def"}
            for name, entry in routines.items():
                item = _item(name, lsp.CompletionItemKind.Function)
                item.detail = f"{name}({', '.join(entry.parameters)})"
                yield item
        return
    bare = "NAME" in allowed
    for name in dict.fromkeys(chain(_in_sight(files, own, spot.number), NAMED_NUMBERS)):
        yield _item(name, lsp.CompletionItemKind.Variable, None if bare else f"({name})")
    if bare:
        for name in FUNCTIONS:
            yield _item(name, lsp.CompletionItemKind.Function)


def _in_sight(files: list[FileOutline], own: FileOutline | None, line: int) -> Iterator[str]:
    """Names that may have a value in a line, the nearest blocks' first."""
    here = [e for e in own.entries if e.holds(line)] if own else []
    for entry in reversed(here):
        if entry.form in ("for", "repeat") and entry.name:
            yield entry.name
        yield from entry.parameters
    routine = next((e for e in here if e.form == "def"), None)
    for file in files:
        for entry in file.entries:
            above = file is not own or entry.line < line or routine is not None
            if entry.form == "let" and above and entry.routine in (None, routine if file is own else None):
                yield entry.name


def _file_items(asked: Asked, typed: str) -> Iterator[lsp.CompletionItem]:
    """Jobs in the folder of the job, as an INCLUDE in this file names them."""
    if asked.task.path is None or asked.top.path is None:
        return
    folder = asked.top.path.resolve().parent
    mine = asked.task.path.resolve()
    begun = typed.replace("\\", "/").rpartition("/")[0]
    for path in _jobs_in(folder):
        if path not in (mine, asked.top.path.resolve()):
            name = Path(os.path.relpath(path, mine.parent)).as_posix()
            if name.isprintable() and '"' not in name and name.startswith(f"{begun}/" if begun else ""):
                insert = name.removeprefix(f"{begun}/") if begun else name
                yield _item(name, lsp.CompletionItemKind.File, insert)


def _jobs_in(folder: Path) -> list[Path]:
    """Jobs in a folder and those below it, hidden ones left out; links that lead out of it are."""
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
