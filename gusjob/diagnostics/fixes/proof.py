"""The proof of fixes: their diagnostics are gone, and no problem is new."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence

from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.diagnostics.fixes.edits import Fix
from gusjob.diagnostics.fixes.table import SYNTAX_RULES
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.pipeline import Checked, FileResult

Key = tuple[str, str, int]
"""Rule, file and line of a diagnostic. Fixes do not move lines."""


def key_of(diagnostic: Diagnostic) -> Key:
    """Return what identifies a diagnostic before and after its line is edited."""
    return diagnostic.rule.code, diagnostic.span.path, diagnostic.span.line


class Proof(Struct, frozen=True, kw_only=True):
    """The result of checking a text with fixes.

    `remaining`: the fixes whose diagnostic is still there. `new_problems`: the lines with a new problem, 0 for a
    problem that belongs to no line of this text.
    """

    remaining: tuple[Fix, ...]
    new_problems: frozenset[int]

    @property
    def holds(self) -> bool:
        """Whether the fixes may be kept."""
        return not self.remaining and not self.new_problems


def prove(before: Checked, after: FileResult, fixes: Iterable[Fix]) -> Proof:
    """Compare the diagnostics of a text before and after fixes."""
    fixes = tuple(fixes)
    if not isinstance(after, Checked) or after.job is None:  # The text is no longer read as a job.
        return Proof(remaining=fixes, new_problems=frozenset({0}))
    keys = {key_of(diagnostic) for diagnostic in after.diagnostics}
    unread = {line for code, path, line in keys if code in SYNTAX_RULES and not path}
    remaining = tuple(
        fix
        for fix in fixes
        if key_of(fix.diagnostic) in keys
        or (fix.diagnostic.rule.code in SYNTAX_RULES and fix.diagnostic.span.line in unread)
    )
    if any(fix.diagnostic.rule.code in SYNTAX_RULES for fix in fixes):
        return Proof(remaining=remaining, new_problems=frozenset())
    return Proof(remaining=remaining, new_problems=frozenset(_new_problems(before.diagnostics, after.diagnostics)))


def _new_problems(before: Sequence[Diagnostic], after: Sequence[Diagnostic]) -> set[int]:
    """Return the lines of errors and warnings that are new or more frequent; 0 for a line of another file.

    If a rule has more diagnostics than are listed, others take the place of those that are gone. For such a rule only
    the total is compared.
    """
    unlisted = {str(f.fields["code"]) for f in (*before, *after) if f.rule.code == rules.NOT_LISTED.code}
    old, new = _serious(before, unlisted), _serious(after, unlisted)
    found = {(0 if path else line) for (_, path, line), count in (new - old).items() if count}
    return found | {0 for _ in _totals(after, unlisted) - _totals(before, unlisted)}


def _serious(diagnostics: Sequence[Diagnostic], unlisted: set[str]) -> Counter[Key]:
    """Count the errors and warnings of rules that are listed completely."""
    counts: Counter[Key] = Counter()
    for diagnostic in diagnostics:
        if diagnostic.severity is not Severity.NOTE and diagnostic.rule.code not in unlisted:
            counts[key_of(diagnostic)] += diagnostic.count
    return counts


def _totals(diagnostics: Sequence[Diagnostic], codes: set[str]) -> Counter[str]:
    """Count all diagnostics of rules that are not listed completely."""
    counts: Counter[str] = Counter()
    for diagnostic in diagnostics:
        if diagnostic.rule.code == rules.NOT_LISTED.code:
            counts[str(diagnostic.fields["code"])] += int(diagnostic.fields["count"])
        elif diagnostic.rule.code in codes and diagnostic.severity is not Severity.NOTE:
            counts[diagnostic.rule.code] += 1
    return counts
