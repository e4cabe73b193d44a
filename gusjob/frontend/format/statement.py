"""Canonical spelling of one statement: its words and the spaces between them."""

from __future__ import annotations

import re

from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords, words_of
from gusjob.kinematics.units import spelling
from gusjob.patterns import lazy_pattern

SpelledWord = tuple[str, str]
"""A terminal of the grammar, and the text."""

_SIGNS = {"PLUS", "MINUS"}
_LOWER_CASE = {"AND", "OR", "NOT"}
_OPERANDS_END = {"QUANTITY", "NAME", "RPAR"}
"""Terminals that can end an operand: a + or - after them is an operator."""
_NUMBER = lazy_pattern(r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?", re.IGNORECASE | re.ASCII)


def canonical(text: str) -> tuple[str, str]:
    """Format a statement that can be parsed, without its comment.

    Returns:
        The canonical text, and the statement's first keyword.
    """
    words = _words(text)
    gaps = [_gap(words, i) for i in range(len(words))]
    result = "".join(gap + word for gap, (_, word) in zip(gaps, words, strict=True))
    if _words(result) != words:
        raise AssertionError(f"formatting changes the meaning of a statement: {text[:200]!r}")
    return result, words[0][0]


def _words(text: str) -> list[SpelledWord]:
    """The words of a statement in canonical spelling; the `=` of a LET is one, others are left out."""
    words = words_of(text)
    if not words or words[-1][2] != len(text.rstrip()):
        raise AssertionError(f"a statement that can't be parsed can't be formatted: {text[:200]!r}")
    found = [(kind, text[start:end]) for kind, start, end in words]
    return [(kind, _spelled(kind, word)) for kind, word in found if kind != "_EQ" or found[0][0] == "LET"]


def _spelled(kind: str, text: str) -> str:
    if kind in _LOWER_CASE:
        return text.lower()
    if kind == "QUANTITY":
        number = _NUMBER.match(text)
        assert number is not None
        unit = text[number.end() :]
        return number[0] + (spelling(unit) if unit else "")
    return kind if kind in keywords(JOB_GRAMMAR) else text


def _gap(words: list[SpelledWord], i: int) -> str:
    """The space before a word."""
    if not i:
        return ""
    kind, before = words[i][0], words[i - 1][0]
    touches = (
        kind in ("RPAR", "COMMA") or before == "LPAR" or (kind == "LPAR" and before == "NAME") or _is_sign(words, i - 1)
    )
    return "" if touches else " "


def _is_sign(words: list[SpelledWord], i: int) -> bool:
    """Whether a + or - is the sign of what follows."""
    return words[i][0] in _SIGNS and (not i or words[i - 1][0] not in _OPERANDS_END)
