"""Fixes for setup statements."""

from __future__ import annotations

from gusjob.diagnostics.fixes.edits import Edits, FixContext
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.statement_parser import parse_statement


def off_delay(context: FixContext, diagnostic: Diagnostic) -> Edits:
    """Raise OFF to ON, in the spelling of ON: the emission starts as before, and the mark ends no earlier.

    Only plain numbers are changed: the value of an expression depends on other lines, which other statements use, too.
    """
    number = diagnostic.span.line
    statement, _ = parse_statement(context.line(number), number)
    if statement is None or statement.form != "laser_delay" or statement.has_expressions:
        return ()
    text, on, off = context.line(number), statement.words["ON"], statement.words["OFF"]
    as_on = text[on.column - 1 : on.end_column - 1]
    # OFF50ON60us: a word after a unit needs a blank.
    gap = " " if as_on[-1:].isalpha() and text[off.end_column - 1 : off.end_column].isalpha() else ""
    return (context.edit(number, off.column, off.end_column, as_on + gap),)


def sky_writing_off(context: FixContext, diagnostic: Diagnostic) -> Edits:
    """Replace SKYWRITE with TIMELAG 0 by SKYWRITE OFF. For other small values the intention is not known."""
    number = diagnostic.span.line
    statement, _ = parse_statement(context.line(number), number)
    if statement is None or statement.form != "skywrite" or statement.has_expressions:
        return ()
    if statement.words["TIMELAG"].value != 0:
        return ()
    return (context.edit(number, statement.column, statement.end_column, "SKYWRITE OFF"),)
