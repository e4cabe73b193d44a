"""Columns that a text takes on a terminal, where Chinese characters take two."""

from __future__ import annotations

import unicodedata

from gusjob.patterns import lazy_pattern

_WIDE = r"\u2e80-\ua4cf\uf900-\ufaff\uff00-\uff60"
_BREAKABLE = lazy_pattern(rf"\s*[（《]*(?:[{_WIDE}]|[^\s{_WIDE}]+)[，。；：、！？）》]*\s*")
"""What stays together on a line: a wide character or a word of others, with its punctuation."""


def width(text: str) -> int:
    """Return the number of columns that a text takes."""
    return sum(2 if unicodedata.east_asian_width(c) in "WF" else 1 for c in text)


def padded(text: str, columns: int) -> str:
    """Fill a text with blanks up to a number of columns."""
    return text + " " * (columns - width(text))


def wrapped(text: str, columns: int) -> str:
    """Break a text into lines of at most so many columns.

    A line may break after any wide character, but not before punctuation.
    """
    lines, used = [""], 0
    for part in _BREAKABLE.findall(text):
        size = width(part.rstrip())
        if used + size > columns and lines[-1]:
            lines.append("")
            used = 0
        lines[-1] += part
        used += width(part)
    return "\n".join(line.rstrip() for line in lines)
