"""Fixes: corrections of diagnostics that have only one possible correction, as `gusjob check --fix` makes them.

A function for each rule gives edits (table.py). Every edit is proved by checking the edited text (proof.py) before it
is kept (apply.py).
"""

from gusjob.diagnostics.fixes.apply import Checker, FixResult, apply_fixes
from gusjob.diagnostics.fixes.proof import key_of
from gusjob.diagnostics.fixes.table import FIXES

__all__ = ["FIXES", "Checker", "FixResult", "apply_fixes", "key_of"]
