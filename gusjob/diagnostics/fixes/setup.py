"""Setup statements whose numbers leave one thing to write."""

from __future__ import annotations

from gusjob.diagnostics.fixes.text import Edits, Look
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.statement_parser import parse_statement


def off_delay(look: Look, diagnostic: Diagnostic) -> Edits:
    """OFF raised to ON, as ON is written: the light comes when it came before, and the mark ends no earlier.

    Only where both are plain numbers: what a name comes to hangs on other lines, which need it, too.
    """
    number = diagnostic.span.line
    statement, _ = parse_statement(look.line(number), number)
    if statement is None or statement.form != "laser_delay" or statement.has_expressions:
        return ()
    text, on, off = look.line(number), statement.words["ON"], statement.words["OFF"]
    as_on = text[on.column - 1 : on.end_column - 1]
    # OFF50ON60us: behind a unit a word needs a blank.
    gap = " " if as_on[-1:].isalpha() and text[off.end_column - 1 : off.end_column].isalpha() else ""
    return (look.edit(number, off.column, off.end_column, as_on + gap),)


def sky_writing_off(look: Look, diagnostic: Diagnostic) -> Edits:
    """TIMELAG 0 is a way to say SKYWRITE OFF. Of any other number that small nobody knows what was meant."""
    number = diagnostic.span.line
    statement, _ = parse_statement(look.line(number), number)
    if statement is None or statement.form != "skywrite" or statement.has_expressions:
        return ()
    if statement.words["TIMELAG"].value != 0:
        return ()
    return (look.edit(number, statement.column, statement.end_column, "SKYWRITE OFF"),)
