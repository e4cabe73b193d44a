"""Which rules have a fix: those with exactly one possible correction that is safe.

A function takes a diagnostic of its rule and returns the edits that remove it, or none if this case is not clear. The
edits are proved before they are kept (proof.py), so the function need not look at the rest of the job.

A correction that needs a guess is not listed here, though an editor may offer it: the intended spelling of a word, the
end of a block, which of two numbers is wrong, whether an unused power belongs to a missing mark, whether a comment with
a reason is outdated.
"""

from __future__ import annotations

from collections.abc import Callable

from gusjob.diagnostics.fixes import keywords, laser, setup, syntax
from gusjob.diagnostics.fixes.edits import Edits, FixContext
from gusjob.diagnostics.model import Diagnostic

FIXES: dict[str, Callable[[FixContext, Diagnostic], Edits]] = {
    "GJ101": syntax.fix_line,
    "GJ102": syntax.fix_line,
    "GJ143": keywords.upper_case,
    "GJ306": setup.off_delay,
    "GJ401": laser.left_on,
    "GJ805": setup.sky_writing_off,
}
"""The function of each rule that has a fix."""

SYNTAX_RULES = {"GJ101", "GJ102"}
"""Rules of lines that can't be read: once such a line is fixed, the rest of the job is checked for the first time."""
