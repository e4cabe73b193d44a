"""Collect the diagnostics of a listing's text, at the tokens of the statement that is read."""

from __future__ import annotations

from lark import Token
from msgspec import Struct, field

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule, Span
from gusjob.i18n.phrases import Phrase


class ListingDiagnostics(Struct):
    """Collects diagnostics.

    Attributes:
        name: Name of the text.
        found: What was found.
        first_line: Line of the text in which the statement that is read begins.
        refused_line: Line of the last control flow that was reported, 0 for none.
    """

    name: str
    found: list[Diagnostic] = field(default_factory=list)
    first_line: int = 0
    refused_line: int = 0

    def add(self, rule: Rule, line: int, column: int, end_column: int, **fields: object) -> None:
        """Add a diagnostic."""
        span = Span(line=line, column=column, end_line=line, end_column=end_column)
        self.found.append(Diagnostic(rule=rule, span=span, fields=fields, path=self.name))

    def add_at(self, rule: Rule, token: Token, **fields: object) -> None:
        """Add a diagnostic at a token of the statement."""
        start = token.column or 1
        self.add(rule, self.line_of(token), start, start + len(token), **fields)
        if rule is rules.CONTROL_FLOW:
            self.refused_line = self.line_of(token)

    def add_for_file(self, rule: Rule, **fields: object) -> None:
        """Add a diagnostic of the whole text."""
        self.add(rule, 1, 1, 2, **fields)

    def line_of(self, token: Token) -> int:
        """Return the line of a token in the text."""
        return self.first_line + (token.line or 1) - 1


def control_flow(word: str) -> str:
    """Return what is wrong with a word that decides which calls are made."""
    return Phrase("'{word}' is control flow", word=word)
