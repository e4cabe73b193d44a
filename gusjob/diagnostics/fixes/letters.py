"""Words in capitals."""

from __future__ import annotations

from gusjob.diagnostics.fixes.text import Edit, Edits, Look
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.parse.keyword_case import in_upper_case


def capitals(look: Look, _fault: Diagnostic) -> Edits:
    """Every word of the language that stands in small letters, in the whole text; nothing else of its lines."""
    starts = look.start
    return tuple(Edit(starts(number), starts(number) + len(code), code) for number, code in in_upper_case(look.data))
