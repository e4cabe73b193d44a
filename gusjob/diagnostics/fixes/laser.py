"""The fix for a laser that is left on."""

from __future__ import annotations

from gusjob.diagnostics.fixes.edits import Edit, Edits, FixContext
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.frontend.includes import may_be_included

_BLANKS = b" \t\r\n"


def left_on(context: FixContext, diagnostic: Diagnostic) -> Edits:
    """Append LASER OFF as the last statement.

    Nothing is appended if the job has other errors: a line that can't be read may be the missing LASER OFF. The same
    holds for a file that another job may include, since what follows there may switch the laser off.
    """
    loaded = context.loaded
    job = loaded.job
    if job is None or not job.complete or may_be_included(loaded.path):
        return ()
    if any(other.severity is Severity.ERROR and other.rule is not diagnostic.rule for other in loaded.diagnostics):
        return ()
    channel = int(diagnostic.fields["channel"])
    # A CHANNEL statement may have selected another channel.
    implicit = channel == 0 and not job.files and b"CHANNEL" not in context.data.upper()
    return (_appended(context.data, b"LASER OFF" if implicit else b"LASER OFF CHANNEL %d" % channel),)


def _appended(data: bytes, statement: bytes) -> Edit:
    """Return the edit that adds a line after the last line that is not blank, with the same line end."""
    end = data.find(b"\n", len(data.rstrip(_BLANKS)))
    if end < 0:
        return Edit(len(data), len(data), (b"\r\n" if b"\r\n" in data else b"\n") + statement)
    return Edit(end + 1, end + 1, statement + (b"\r\n" if data[end - 1 : end] == b"\r" else b"\n"))
