"""Corrections of lines that differ only in their numbers: found for the first one, and used for all others.

A job with one slip may have it in each of its lines. What the check of the edited text proves holds for every line, so
that this search need not prove anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from msgspec import Struct, field

from gusjob.diagnostics.fixes.syntax import corrected
from gusjob.patterns import lazy_pattern

_DIGITS = lazy_pattern(r"[0-9]+", re.ASCII)
_NUMBERS = lazy_pattern(r"(?<!/s)(?<!/ms)(?<!duty)[0-9]+", re.IGNORECASE | re.ASCII)
"""Digits that are no part of a unit or keyword: mm/s2, DUTY2."""
_COMMENT = lazy_pattern(r"[;；]|[/／]{2}")
_MAX_KNOWN = 10_000


class _Correction(Struct, frozen=True):
    """A corrected line without its comment, its digits left out. None: a line of this form can't be corrected."""

    pattern: str | None


class SimilarLines(Struct):
    """Corrects lines. `known`: corrections by the form of the line."""

    known: dict[str, _Correction] = field(default_factory=dict)

    def corrected(self, text: str) -> str | None:
        """Return a line without its slips, or None if something else in it can't be read."""
        code, comment = _split(text)
        form = _form(code)
        found = self.known.get(form)
        if found is None:
            new = corrected(text)
            found = _learned(code, comment, new)
            if found is None or len(self.known) >= _MAX_KNOWN:
                return new
            self.known[form] = found
        return _filled(found, code, comment)

    def others(self, data: bytes, first: int) -> Iterator[tuple[int, str, str]]:
        """Find lines of known forms.

        Args:
            data: The text.
            first: The first line to look at, from 1.

        Returns:
            The number, the text and the corrected text of each line that can be corrected.
        """
        for number, line in enumerate(data.decode().split("\n")[first - 1 :], first):
            code, comment = _split(line)
            found = self.known.get(_form(code))
            new = None if found is None else _filled(found, code, comment)
            if new is not None and new != line:
                yield number, line, new


def _split(text: str) -> tuple[str, str]:
    """A line and its comment. Where a quote may hide the comment, the line is left whole."""
    found = None if '"' in text else _COMMENT.search(text)
    return (text, "") if found is None else (text[: found.start()], text[found.start() :])


def _form(code: str) -> str:
    return _NUMBERS.sub("0", code)


def _learned(code: str, comment: str, new: str | None) -> _Correction | None:
    """The correction of all lines of a form by that of one of them; None if the others may need another one."""
    if new is None:
        return _Correction(None)
    end = _corrected_comment(comment)
    kept = new.removesuffix(end)
    same = all(digits.findall(kept) == digits.findall(code) for digits in (_DIGITS, _NUMBERS))
    if kept + end != new or not same:
        return None  # A full-width digit became another one, or a full-width DUTY2 one whose digit is no number.
    return _Correction(_NUMBERS.sub("\0", kept))


def _filled(found: _Correction, code: str, comment: str) -> str | None:
    if found.pattern is None:
        return None
    numbers = iter(_NUMBERS.findall(code))
    return re.sub("\0", lambda _: next(numbers), found.pattern) + _corrected_comment(comment)


def _corrected_comment(comment: str) -> str:
    """A comment with the mark of the language."""
    return comment.replace("；", ";", 1) if comment[:1] in ("", ";", "；") else f"//{comment[2:]}"
