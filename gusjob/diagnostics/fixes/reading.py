"""Lines that can't be read, where one slip and one only stands in the way.

What such a line says is not known before, so nothing that can be judged changes: the proof is that the line reads.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from gusjob.diagnostics import rules
from gusjob.diagnostics.fixes.characters import as_meant
from gusjob.diagnostics.fixes.text import Edit, Edits, Look
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.keyword_case import words_of
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.kinematics.units import UNITS

MAX_SLIPS = 32
"""So many in a line are mended: a statement has no more numbers."""

_UNIT = re.compile("(?:" + "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True)) + ")(?![A-Za-z0-9_])", re.I)
_NUMBER_AND_BLANKS = re.compile(r"[0-9.][ \t]+$")
_IF = re.compile(r"\s*IF\b", re.IGNORECASE)


def line(look: Look, diagnostic: Diagnostic) -> Edits:
    """The line as it can be read."""
    text = look.line(diagnostic.span.line)
    meant = readable(text)
    if meant is None:
        return ()
    start = look.start(diagnostic.span.line)
    return (Edit(start, start + len(text.encode()), meant.encode()),)


def readable(text: str) -> str | None:
    """A line without its slips; None if something is left that can't be read."""
    text = as_meant(text)
    for _ in range(MAX_SLIPS):
        _, diagnostics = parse_statement(text, 1)
        if not diagnostics:
            return text
        if diagnostics[0].rule.code not in (rules.UNEXPECTED.code, rules.UNKNOWN_STATEMENT.code):
            return None
        found = (slip(text, diagnostics[0].span.column - 1) for slip in SLIPS)
        text, before = next((new for new in found if new != text), text), text
        if text == before:
            return None
    return None


def _unit_apart(text: str, at: int) -> str:
    """`10 mm`: a unit is glued to its number, and nothing else may begin with a unit there."""
    unit = _UNIT.match(text, at)
    if unit is None or not _NUMBER_AND_BLANKS.search(text[:at]):
        return text
    glued = text[:at].rstrip(" \t") + text[at:]
    end = len(text[:at].rstrip(" \t")) + len(unit[0])
    # Of `n1 mm` no name n1mm is made.
    words = words_of(strip_comment(glued))
    return glued if any(kind == "QUANTITY" and last == end for kind, _, last in words) else text


def _compared(text: str, at: int) -> str:
    """`IF n = 1`: nothing is set in a condition."""
    return text[:at] + "=" + text[at:] if _IF.match(text) and text[at : at + 1] == "=" else text


SLIPS: tuple[Callable[[str, int], str], ...] = (_unit_apart, _compared)
"""Each makes of a line, and of the place that can't be read, the line without one slip; or leaves it as it is."""
