"""Names of the language's elements in messages, and hints for lines that can't be parsed."""

from __future__ import annotations

import re

from lark import UnexpectedInput

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, words_of
from gusjob.frontend.parse.misread import END_OF_LINE, Misread, misread
from gusjob.frontend.parse.unread_numbers import not_decimal, out_of_place, unknown_unit
from gusjob.i18n.phrases import Phrase, any_of
from gusjob.kinematics.units import UNITS
from gusjob.patterns import lazy_pattern

UNIT = lazy_pattern(
    "(?:" + "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True)) + ")(?![A-Za-z0-9_])", re.I | re.A
)
"""A unit that no word begins with."""
_AROUND_SLASH = lazy_pattern(r"[ \t]*/[ \t]*")
COMPARISON_HINT = Phrase("; write a comparison with ==")
_TERMINALS = {
    **dict.fromkeys(("QUANTITY", "PLUS", "MINUS", "LPAR"), Phrase("a number")),
    **dict.fromkeys(("STAR", "SLASH", "MODULO", "POWER_OF"), Phrase("an operator")),
    **dict.fromkeys(("LT", "LE", "GT", "GE", "EQ", "NE"), Phrase("a comparison")),
    "RPAR": "')'",
    "COMMA": "','",
    "NAME": Phrase("a name"),
    "STRING": Phrase('a file in quotes, "setup.job"'),
}


def syntax_error(error: UnexpectedInput, text: str, line: int) -> Diagnostic:
    """The diagnostic of a line (without its comment) that can't be parsed."""
    words = words_of(text)
    found = misread(error, JOB_GRAMMAR, text, _TERMINALS, out_of_place(words))
    span = Span(line=line, column=found.column, end_line=line, end_column=found.end_column)
    if not text[: found.column - 1].strip():
        from gusjob.frontend.parse.foreign import foreign_of  # Start-up time: most jobs have no such line.

        foreign = foreign_of(text)
        hint = Phrase("; write {meant}", meant=foreign.meant) if foreign else found.hint
        fields: dict[str, object] = {"found": found.found, "hint": hint}
        return Diagnostic(rule=rules.UNKNOWN_STATEMENT, span=span, fields=fields)
    number = not_decimal(text, words, found.column - 1, line)
    if number is None and not found.near:
        number = unknown_unit(text, words, found.column - 1, line)
    if number is not None:
        return number
    if found.found is END_OF_LINE and found.expected:
        missing = {"words": any_of(found.expected), "word": text.split()[-1][-40:], "found": found.found}
        return Diagnostic(rule=rules.MISSING, span=span, fields=missing)
    fields = {"found": found.found, "expected": found.expectation, "hint": found.hint or _hint(text, found)}
    return Diagnostic(rule=rules.UNEXPECTED, span=span, fields=fields)


def _hint(text: str, misread: Misread) -> str:
    """Hint at the probable intention."""
    if misread.found is END_OF_LINE:
        return ""
    found = misread.word
    before = text[: misread.column - 1].split()
    if found == "=" and before and before[0].upper() == "IF":
        return COMPARISON_HINT
    unit = UNIT.match(_AROUND_SLASH.sub("/", text[misread.column - 1 :]))  # Also `mm / s`.
    if unit and before and before[-1][-1:].isdigit():
        return Phrase("; write the unit directly after its number: {glued}", glued=f"{before[-1]}{unit[0]}")
    if found == "#":
        return Phrase("; a comment begins with ;")
    if before and [word.upper() for word in before] == ["WAIT"] and found[:1].isdigit():
        return Phrase("; write {meant}", meant=f"DWELL {text.split(maxsplit=1)[1].strip()[:40]}")
    if before and before[0].upper() in ("ELSE", "END"):
        return Phrase("; {word} must be alone on its line", word=before[0].upper())
    if "a number" in misread.expected and (found[:1].isalpha() or found[:1] == "_"):
        return Phrase("; put a name or an expression in parentheses: ({found})", found=found)
    if found in ("*", "/", "%", "+", "-", "**") and before:
        return Phrase("; put an expression in parentheses")
    return ""
