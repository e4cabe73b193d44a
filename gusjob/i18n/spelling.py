"""Words that resemble a misspelt one."""

from __future__ import annotations

from collections.abc import Iterable

_MAX_WORD = 60
_MIN_LIKENESS = 0.6


def nearest(word: str, known: Iterable[str]) -> str:
    """The known word whose spelling is closest to this one; '' if none resembles it."""
    near = nearest_ones(word, known, 1)
    return near[0] if near else ""


def nearest_ones(word: str, known: Iterable[str], count: int) -> list[str]:
    """The known words whose spelling is closest to this one, the closest first."""
    known = list(known)
    from difflib import get_close_matches  # Diagnostics only: start-up time is part of the tool.

    longer = [one for one in known if one.startswith(word) and len(one) <= len(word) + 2] if len(word) > 1 else []
    if len(longer) == 1:  # AC: ACC, although ARC resembles it as much.
        return longer
    return get_close_matches(word, known, count, cutoff=_MIN_LIKENESS) if len(word) < _MAX_WORD else []
