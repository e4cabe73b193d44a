"""Which diagnostics are mended, and by what: rules that leave exactly one thing to write, and that thing is safe.

A function takes a diagnostic of its rule and gives the edits that take it away, none where this one is not so clear.
What it gives is proved before it is kept (proof.py), so it need not look at the rest of the job.

A mend that needs a guess has no place here, though an editor may offer it: what a misspelt word was meant to be, where
a block was meant to end, which of two numbers is wrong, whether a power that nothing uses belongs to a mark that is
missing, whether a comment with somebody's reason has had its day.
"""

from __future__ import annotations

from collections.abc import Callable

from gusjob.diagnostics.fixes import letters, light, reading, setup
from gusjob.diagnostics.fixes.text import Edits, Look
from gusjob.diagnostics.model import Diagnostic

MENDS: dict[str, Callable[[Look, Diagnostic], Edits]] = {
    "GJ101": reading.line,
    "GJ102": reading.line,
    "GJ143": letters.capitals,
    "GJ306": setup.off_delay,
    "GJ401": light.left_on,
    "GJ805": setup.sky_writing_off,
}
"""By rule."""

READS = {"GJ101", "GJ102"}
"""Rules of lines that say nothing as they stand: with such a line the rest of the job is heard for the first time."""
