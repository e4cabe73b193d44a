"""Comments that allow what is not there."""

from __future__ import annotations

import re

from gusjob.allowance import comment_in
from gusjob.diagnostics import Diagnostic
from gusjob.mend.text import Edits, Look

_SEPARATOR = re.compile(r"[\s,，]+")


def idle_allow(look: Look, fault: Diagnostic) -> Edits:
    """A line's idle rules taken out of the comment; of one that allows nothing else, all of it, the reason too."""
    number = fault.span.line
    text = look.line(number).rstrip("\r")
    comment = comment_in(text)
    if comment is None:
        return ()
    here = [f for f in look.loaded.faults if f.rule is fault.rule and (f.span.path, f.span.line) == ("", number)]
    idle = {f.fields["code"] for f in here}
    others = [code for code in _SEPARATOR.split(comment["codes"]) if code.upper() not in idle]
    if others:
        return (look.edit(number, comment.start("codes") + 1, comment.end("codes") + 1, ", ".join(others)),)
    return (look.edit(number, len(text[: comment.start()].rstrip()) + 1, len(text) + 1, ""),)
