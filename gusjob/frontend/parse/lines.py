"""One line through lark: grammar files, tokens, and what to say when a line can't be read."""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import lark
from lark import Lark, Token, Tree, UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from gusjob.i18n.phrases import Phrase, any_of, did_you_mean

END_OF_LINE = Phrase("the end of the line")
_JOINS = {"AND", "OR", "NOT"}
_WORD = re.compile(r"[A-Za-z_]\w*|\S")
_PACKAGE = Path(__file__).resolve().parents[2]


def grammar_path(name: str) -> Path:
    """A grammar file: inside the installed package, or at the top of a checkout."""
    inside = _PACKAGE / "grammar" / name
    return inside if inside.is_file() else _PACKAGE.parent / "grammar" / name


@cache
def parser(name: str) -> Lark:
    """The line parser of a grammar (LALR)."""
    text = grammar_path(name).read_text(encoding="utf-8")
    return _ready_made(name, text) or fresh_parser(text)


def fresh_parser(text: str) -> Lark:
    """The parser of a grammar's text, its tables worked out anew."""
    return Lark(text, parser="lalr", lexer="contextual", maybe_placeholders=False)


def tables_path(name: str) -> Path:
    """Where the tables of a grammar's parser are kept: working them out takes longer than all else at start-up."""
    return Path(__file__).with_name(name).with_suffix(".tables.json")


def tables_key(text: str) -> list[str | int]:
    """What tables hang on: lark's version and the grammar."""
    return [lark.__version__, zlib.crc32(text.encode())]


def _ready_made(name: str, text: str) -> Lark | None:
    """The parser from kept tables; None if there are none for this grammar and this lark."""
    path = tables_path(name)
    if not path.is_file():
        return None
    import json

    kept = json.loads(path.read_bytes(), object_hook=_numbered)
    return Lark.load(kept["parser"]) if kept["key"] == tables_key(text) else None


def _numbered(table: dict[str, Any]) -> dict[str | int, Any]:
    """States are numbered; JSON makes texts of them."""
    return {int(key) if key.isdecimal() else key: value for key, value in table.items()}


@cache
def keywords(name: str) -> frozenset[str]:
    """The keywords of a grammar: terminals that spell their own name."""
    return frozenset(t.name for t in parser(name).terminals if t.pattern.value.startswith(t.name))


@dataclass(frozen=True, slots=True, kw_only=True)
class Misread:
    """Why a line can't be read: what was found where (columns from 1), and what would have fitted."""

    found: str
    column: int
    end_column: int
    expected: tuple[str, ...]
    near: str

    @property
    def expectation(self) -> str:
        """'expected X, Y or the end of the line'."""
        if not self.expected:
            return Phrase("nothing can stand here")
        return Phrase("expected {words}", words=any_of(self.expected))

    @property
    def hint(self) -> str:
        """'; did you mean LINE?' where a word is close to one that fits."""
        return did_you_mean(self.near)


def misread(error: UnexpectedInput, grammar: str, text: str, names: dict[str, str]) -> Misread:
    """A lark error in terms of the user's text. `names`: readable names of terminals that are no keywords."""
    accepted: Sequence[str] = ()
    if isinstance(error, UnexpectedToken):
        accepted = sorted(error.accepts or error.expected)
        if error.token.type == "$END":
            column = len(text.rstrip()) + 1
            return _misread(END_OF_LINE, column, column + 1, accepted, names)
        start = error.token.column or 1
        return _misread(str(error.token), start, start + len(error.token), accepted, names)
    column = error.column if isinstance(error, UnexpectedCharacters) else 1
    if isinstance(error, UnexpectedCharacters):
        accepted = _accepted_after(parser(grammar), text[: column - 1])
    match = _WORD.match(text, column - 1)
    word = match[0] if match else text[column - 1 : column]
    return _misread(word, column, column + max(len(word), 1), accepted, names)


def _accepted_after(lark: Lark, text: str) -> Sequence[str]:
    """What the parser would take behind `text`, where the scanner stopped."""
    try:
        interactive = lark.parse_interactive(text)
        for _ in interactive.iter_parse():
            pass
        accepted: set[str] = interactive.accepts()  # type: ignore[no-untyped-call]  # lark's
        return sorted(accepted)
    except UnexpectedInput:
        return ()


def _misread(found: str, start: int, end: int, accepted: Sequence[str], names: dict[str, str]) -> Misread:
    keywords = [a for a in accepted if a not in names and not a.startswith("_") and a != "$END"]
    readable = [*dict.fromkeys(names[a] for a in accepted if a in names), *keywords]
    if len(readable) > len(keywords) + 1:  # Inside an expression much may follow: say the likely.
        readable = [word for word in readable if word not in _JOINS]
    if "$END" in accepted:
        readable.append(END_OF_LINE)
    shown = f"'{found[:40]}'" if found is not END_OF_LINE else found
    near = nearest(found.upper(), keywords)
    return Misread(found=shown, column=start, end_column=end, expected=tuple(readable), near=near)


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word that is spelled most like this one; '' if none is like it."""
    from difflib import get_close_matches  # Diagnostics only: start-up time is part of the tool.

    near = get_close_matches(word, list(known), 1, cutoff=0.6) if len(word) < 40 else []
    return near[0] if near else ""


def tokens(tree: Tree[Token]) -> list[Token]:
    """The direct tokens of a tree."""
    return [child for child in tree.children if isinstance(child, Token)]


def subtrees(tree: Tree[Token]) -> list[Tree[Token]]:
    """The direct subtrees of a tree."""
    return [child for child in tree.children if isinstance(child, Tree)]
