"""The grammars and their parsers: one line of text to a tree of lark."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from lark import Lark, Token, Tree, UnexpectedInput

from gusjob.frontend.parse.tables import parser_from_tables

JOB_GRAMMAR = "job.lark"
LISTING_GRAMMAR = "listing.lark"

_PACKAGE = Path(__file__).resolve().parents[2]


def grammar_path(name: str) -> Path:
    """A grammar file: inside the installed package, or at the top of a checkout."""
    inside = _PACKAGE / "grammar" / name
    return inside if inside.is_file() else _PACKAGE.parent / "grammar" / name


@cache
def parser(name: str) -> Lark:
    """The line parser of a grammar (LALR)."""
    return parser_from_tables(name, grammar_path(name).read_text(encoding="utf-8"))


@cache
def keywords(name: str) -> frozenset[str]:
    """The keywords of a grammar: terminals that spell their own name."""
    return frozenset(t.name for t in parser(name).terminals if t.pattern.value.startswith(t.name))


def words_of(code: str) -> list[tuple[str, int, int]]:
    """Each word of a line without its comment: its terminal in the grammar, its start and its end.

    Stops where the line can't be parsed.
    """
    found = []
    try:
        for token in parser(JOB_GRAMMAR).parse_interactive(code).iter_parse():
            start = token.start_pos or 0
            found.append((str(token.type), start, start + len(token)))
    except UnexpectedInput:
        pass
    return found


def tokens(tree: Tree[Token]) -> list[Token]:
    """The direct tokens of a tree."""
    return [child for child in tree.children if isinstance(child, Token)]


def subtrees(tree: Tree[Token]) -> list[Tree[Token]]:
    """The direct subtrees of a tree."""
    return [child for child in tree.children if isinstance(child, Tree)]
