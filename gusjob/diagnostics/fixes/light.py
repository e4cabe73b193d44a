"""Light that is left on."""

from __future__ import annotations

from gusjob.diagnostics.fixes.text import Edit, Edits, Look
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.frontend.files import may_be_a_part

_BLANKS = b" \t\r\n"


def left_on(look: Look, diagnostic: Diagnostic) -> Edits:
    """LASER OFF as the last statement.

    Where a line can't be read, a block has no END or a routine is unknown, the LASER OFF may be there already. A file
    that another job includes, or that can't run alone, may leave the light on for what comes behind it there.
    """
    job = look.loaded.job
    if job is None or not job.complete or may_be_a_part(look.loaded.path):
        return ()
    if any(other.severity is Severity.ERROR and other.rule is not diagnostic.rule for other in look.loaded.diagnostics):
        return ()
    channel = int(diagnostic.fields["channel"])
    # CHANNEL may be in force for another one.
    alone = channel == 0 and not job.files and b"CHANNEL" not in look.data.upper()
    return (_appended(look.data, b"LASER OFF" if alone else b"LASER OFF CHANNEL %d" % channel),)


def _appended(data: bytes, statement: bytes) -> Edit:
    """One more line behind the last that is not blank, with the end that this one has."""
    end = data.find(b"\n", len(data.rstrip(_BLANKS)))
    if end < 0:
        return Edit(len(data), len(data), (b"\r\n" if b"\r\n" in data else b"\n") + statement)
    return Edit(end + 1, end + 1, statement + (b"\r\n" if data[end - 1 : end] == b"\r" else b"\n"))
