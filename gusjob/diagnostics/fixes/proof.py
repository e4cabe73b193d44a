"""Whether mends keep their word: the diagnostics are gone, and nothing else is wrong that was not wrong before."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gusjob.diagnostics import rules
from gusjob.diagnostics.fixes.table import READS
from gusjob.diagnostics.fixes.text import Mend
from gusjob.diagnostics.model import Diagnostic, Severity
from gusjob.pipeline import Checked, FileResult

Key = tuple[str, str, int]
"""Rule, file and line: mends leave every line in its place."""


def key_of(diagnostic: Diagnostic) -> Key:
    """What stays the same of a diagnostic when its line is written otherwise."""
    return diagnostic.rule.code, diagnostic.span.path, diagnostic.span.line


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """`left`: mends whose diagnostic is still there. `worse`: lines of the text in which something is wrong now that
    was not before; with a line of 0 where no line can be named."""

    left: tuple[Mend, ...]
    worse: frozenset[int]

    @property
    def good(self) -> bool:
        """Whether the mends may stay."""
        return not self.left and not self.worse


def verdict(before: Checked, after: FileResult, mends: Iterable[Mend]) -> Verdict:
    """What the judge says of a text with its mends."""
    if not isinstance(after, Checked) or after.job is None:  # It is taken for something else now.
        return Verdict(left=tuple(mends), worse=frozenset({0}))
    mends = tuple(mends)
    keys = {key_of(diagnostic) for diagnostic in after.diagnostics}
    left = tuple(mend for mend in mends if key_of(mend.diagnostic) in keys)
    if any(mend.diagnostic.rule.code in READS for mend in mends):
        return Verdict(left=left, worse=frozenset())
    return Verdict(left=left, worse=frozenset(_worse(before.diagnostics, after.diagnostics)))


def _worse(before: Sequence[Diagnostic], after: Sequence[Diagnostic]) -> set[int]:
    """The lines of errors and warnings that are new or come more often; 0 for a line of another file.

    Of a rule with more diagnostics than are listed, the next ones are listed when some are gone: there their number
    counts.
    """
    uncounted = {str(f.fields["code"]) for f in (*before, *after) if f.rule.code == rules.MORE.code}
    old, new = _serious(before, uncounted), _serious(after, uncounted)
    found = {(0 if path else line) for (_, path, line), count in (new - old).items() if count}
    old_totals, new_totals = _totals(before, uncounted), _totals(after, uncounted)
    return found | {0 for _ in new_totals - old_totals}


def _serious(diagnostics: Sequence[Diagnostic], uncounted: set[str]) -> Counter[Key]:
    counts: Counter[Key] = Counter()
    for diagnostic in diagnostics:
        if diagnostic.severity is not Severity.NOTE and diagnostic.rule.code not in uncounted:
            counts[key_of(diagnostic)] += diagnostic.count
    return counts


def _totals(diagnostics: Sequence[Diagnostic], codes: set[str]) -> Counter[str]:
    """Of rules with diagnostics that are not listed: how many there are in all."""
    counts: Counter[str] = Counter()
    for diagnostic in diagnostics:
        if diagnostic.rule.code == rules.MORE.code:
            counts[str(diagnostic.fields["code"])] += int(diagnostic.fields["count"])
        elif diagnostic.rule.code in codes and diagnostic.severity is not Severity.NOTE:
            counts[diagnostic.rule.code] += 1
    return counts
