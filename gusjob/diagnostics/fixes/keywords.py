"""The fix for keywords in lower case."""

from __future__ import annotations

from gusjob.diagnostics.fixes.edits import Edit, Edits, FixContext
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.keyword_case import in_upper_case


def upper_case(context: FixContext, _diagnostic: Diagnostic) -> Edits:
    """Change all lower-case keywords of the text to upper case, and nothing else."""
    start = context.start
    return tuple(Edit(start(number), start(number) + len(code), code) for number, code in in_upper_case(context.data))
