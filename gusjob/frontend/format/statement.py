"""One statement as it is to be written: its words spelled, and what stands between them."""

from __future__ import annotations

import re

from gusjob.frontend.parse.lines import keywords
from gusjob.frontend.parse.spelling import words_of
from gusjob.frontend.parse.statements import GRAMMAR
from gusjob.kinematics.units import spelling

Word = tuple[str, str]
"""A terminal of the grammar, and the text."""

_SIGNS = {"PLUS", "MINUS"}
_JOINS = {"AND", "OR", "NOT"}
_OPERANDS_END = {"QUANTITY", "NAME", "RPAR"}
_NUMBER = re.compile(r"(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:e[+-]?[0-9]+)?", re.IGNORECASE)


def canonical(text: str) -> tuple[str, str]:
    """A statement that can be read (without comment), laid out; and its first keyword."""
    words = _words(text)
    gaps = [_gap(words, i) for i in range(len(words))]
    result = "".join(gap + word for gap, (_, word) in zip(gaps, words, strict=True))
    if _words(result) != words:
        raise AssertionError(f"the layout of a statement reads otherwise: {text[:200]!r}")
    return result, words[0][0]


def _words(text: str) -> list[Word]:
    """The words of a statement in their canonical spelling; the `=` of a LET is one, others are none."""
    places = words_of(text)
    if not places or places[-1][2] != len(text.rstrip()):
        raise AssertionError(f"a statement that can't be read is to be laid out: {text[:200]!r}")
    found = [(kind, text[start:end]) for kind, start, end in places]
    return [(kind, _spelled(kind, word)) for kind, word in found if kind != "_EQ" or found[0][0] == "LET"]


def _spelled(kind: str, text: str) -> str:
    if kind in _JOINS:
        return text.lower()
    if kind == "QUANTITY":
        number = _NUMBER.match(text)
        assert number is not None
        unit = text[number.end() :]
        return number[0] + (spelling(unit) if unit else "")
    return kind if kind in keywords(GRAMMAR) else text


def _gap(words: list[Word], i: int) -> str:
    """What stands in front of a word."""
    if not i:
        return ""
    kind, before = words[i][0], words[i - 1][0]
    glued = (
        kind in ("RPAR", "COMMA") or before == "LPAR" or (kind == "LPAR" and before == "NAME") or _is_sign(words, i - 1)
    )
    return "" if glued else " "


def _is_sign(words: list[Word], i: int) -> bool:
    """Whether a + or - is the sign of what follows."""
    return words[i][0] in _SIGNS and (not i or words[i - 1][0] not in _OPERANDS_END)
