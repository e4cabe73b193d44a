"""The fix for lines that can't be read because of a known slip.

The meaning of such a line is not known before the fix, so the proof is only that the line can be read.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from gusjob.diagnostics import rules
from gusjob.diagnostics.fixes.characters import normalized
from gusjob.diagnostics.fixes.edits import Edit, Edits, FixContext
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.foreign import comment_of
from gusjob.frontend.parse.grammar import words_of
from gusjob.frontend.parse.statement_parser import parse_statement, strip_comment
from gusjob.frontend.parse.syntax_errors import UNIT
from gusjob.patterns import lazy_pattern

MAX_SLIPS = 32
"""The number of slips that are corrected in a line: a statement has no more numbers."""

_NUMBER_AND_BLANKS = lazy_pattern(r"[0-9.][ \t]+$")
_IF = lazy_pattern(r"\s*IF\b", re.IGNORECASE | re.ASCII)


def fix_line(context: FixContext, diagnostic: Diagnostic) -> Edits:
    """Correct the slips of a line, if the line can be read then."""
    text = context.line(diagnostic.span.line)
    new = context.correct_line(text)
    if new is None:
        return ()
    start = context.start(diagnostic.span.line)
    return (Edit(start, start + len(text.encode()), new.encode()),)


def corrected(text: str) -> str | None:
    """Return a line without its slips, or None if something else in it can't be read."""
    text = normalized(text)
    for _ in range(MAX_SLIPS):
        _, diagnostics = parse_statement(text, 1)
        if not diagnostics:
            return text
        if diagnostics[0].rule.code not in (rules.UNEXPECTED.code, rules.UNKNOWN_STATEMENT.code):
            return None
        found = (correct(text, diagnostics[0].span.column - 1) for correct in CORRECTIONS)
        text, before = next((new for new in found if new != text), text), text
        if text == before:
            return None
    return None


def _join_unit(text: str, at: int) -> str:
    """`10 mm` -> `10mm`: a unit is glued to its number, and no word begins with a unit there."""
    unit = UNIT.match(text, at)
    if unit is None or not _NUMBER_AND_BLANKS.search(text[:at]):
        return text
    glued = text[:at].rstrip(" \t") + text[at:]
    end = len(text[:at].rstrip(" \t")) + len(unit[0])
    # `n1 mm` must not become a name n1mm.
    words = words_of(strip_comment(glued))
    return glued if any(kind == "QUANTITY" and last == end for kind, _, last in words) else text


def _double_equals(text: str, at: int) -> str:
    """`IF n = 1` -> `IF n == 1`: a condition does not set a name."""
    return text[:at] + "=" + text[at:] if _IF.match(text) and text[at : at + 1] == "=" else text


def _comment(text: str, at: int) -> str:
    """`# a`, `(a)` or `%`, alone on a line, and `# a` behind a statement: comments of other languages."""
    code = strip_comment(text)
    if text[at : at + 1] == "#":
        return f"{text[:at]};{text[at + 1 :]}"
    comment = comment_of(code) if not code[:at].strip() else None
    return text if comment is None else comment + text[len(code.rstrip()) :]


CORRECTIONS: tuple[Callable[[str, int], str], ...] = (_join_unit, _double_equals, _comment)
"""Each takes a line and the position that can't be read, and returns the line without one slip, or unchanged."""
