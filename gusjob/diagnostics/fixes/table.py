"""Which rules have a fix: those with exactly one possible correction that is safe.

A function takes a diagnostic of its rule and returns the edits that remove it, or none if this case is not clear. The
edits are proved before they are kept (proof.py), so the function need not look at the rest of the job.

A correction that needs a guess is not listed here, though an editor may offer it: the intended spelling of a word, the
end of a block, which of two numbers is wrong, whether an unused power belongs to a missing mark, whether a comment with
a reason is outdated.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType

from gusjob.diagnostics.fixes import keywords, laser, setup, syntax
from gusjob.diagnostics.fixes.edits import Edits, FixContext
from gusjob.diagnostics.model import Diagnostic
from gusjob.diagnostics.rules.fixable import FIX_OF_RULE

_MODULES: dict[str, ModuleType] = {"keywords": keywords, "laser": laser, "setup": setup, "syntax": syntax}


def _function(name: str) -> Callable[[FixContext, Diagnostic], Edits]:
    module, _, function = name.partition(".")
    found: Callable[[FixContext, Diagnostic], Edits] = getattr(_MODULES[module], function)
    return found


FIXES = {code: _function(name) for code, name in FIX_OF_RULE.items()}
"""The function of each rule that has a fix."""

SYNTAX_RULES = {"GJ101", "GJ102"}
"""Rules of lines that can't be read: once such a line is fixed, the rest of the job is checked for the first time."""
