"""Apply fixes to a job in iterations: a fix may reveal a diagnostic that can be fixed next.

An iteration checks the text once with all its fixes. If the proof fails (proof.py), the fixes on lines with new
problems are left out and the text is checked again. Only if that does not help either, the fixes are tried by halves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.diagnostics.fixes.edits import Edit, Fix, FixContext, apply_edits, without_overlaps
from gusjob.diagnostics.fixes.proof import Key, key_of, prove
from gusjob.diagnostics.fixes.similar_lines import SimilarLines
from gusjob.diagnostics.fixes.table import FIXES, SYNTAX_RULES
from gusjob.diagnostics.model import Diagnostic, Span, has_errors
from gusjob.diagnostics.rules import NOT_LISTED
from gusjob.pipeline import Checked, FileResult, examine

MAX_ITERATIONS = 200
"""1000 diagnostics of a rule are listed at once, so a file with 100,000 of them is fixed completely. Of lines
that can't be read, those that differ in numbers only are fixed together, also where they are not listed."""
MAX_CHECKS = 100
"""How often a file is checked in search of fixes whose proof fails; fixes that were not tried are not made."""

Checker = Callable[[bytes], FileResult]
"""Read and check a text in place of the file's content (pipeline.load, without examine)."""


class FixResult(Struct, frozen=True):
    """A job after fixes: its text, its diagnostics, and the number of fixes made."""

    data: bytes
    loaded: Checked
    count: int = 0


def apply_fixes(loaded: Checked, check: Checker, selected: Callable[[Diagnostic], bool]) -> FixResult:
    """Apply all fixes whose proof holds.

    Args:
        loaded: An examined file; a listing or journal stays as it is.
        check: Checks an edited text.
        selected: Whether a diagnostic is to be fixed.
    """
    state = FixResult(loaded.source.as_written, loaded)
    search = _FixSearch(check=check, selected=selected)
    for _ in range(MAX_ITERATIONS):
        fixes = search.find(state)
        if not fixes:
            break
        kept = search.largest_proved(_ProvedFixes((), state), fixes, state)
        state = kept.state
        search.rejected |= {key_of(fix.diagnostic) for fix in fixes} - {key_of(fix.diagnostic) for fix in kept.fixes}
    return state


class _ProvedFixes(Struct, frozen=True):
    """Fixes whose common proof holds, and the text with them."""

    fixes: tuple[Fix, ...]
    state: FixResult


class _FixSearch(Struct):
    check: Checker
    selected: Callable[[Diagnostic], bool]
    rejected: set[Key] = field(default_factory=set)
    """Diagnostics whose fix could not be proved."""
    checks: int = 0
    lines: SimilarLines = field(default_factory=SimilarLines)

    def find(self, state: FixResult) -> list[Fix]:
        """Return fixes that can be tried together; first those of lines that can't be read, if there are any."""
        if state.loaded.job is None:
            return []
        # Where the text was written with other line ends, the offsets are the same.
        context = FixContext(state.loaded, state.loaded.source.data, self.lines.corrected)
        fixable = [d for d in state.loaded.diagnostics if d.rule.code in FIXES and self.selected(d)]
        fixable = [d for d in fixable if self.is_own(state, d) and key_of(d) not in self.rejected]
        of_syntax = [fix for d in fixable if d.rule.code in SYNTAX_RULES for fix in _fixes(context, d)]
        of_syntax += self.find_unlisted(context, of_syntax)
        return without_overlaps(of_syntax or [fix for d in fixable for fix in _fixes(context, d)])

    def find_unlisted(self, context: FixContext, listed: list[Fix]) -> Iterator[Fix]:
        """Find the fixes of lines that are not listed, but differ from lines that are in numbers only."""
        if not listed or all(d.rule is not NOT_LISTED for d in context.loaded.diagnostics):
            return
        last = max(d.span.line for d in context.loaded.diagnostics if d.rule.code in SYNTAX_RULES)
        for number, old, new in self.lines.others(context.data, last + 1):
            start = context.start(number)
            diagnostic = replace(listed[0].diagnostic, span=Span(line=number))
            if self.selected(diagnostic) and key_of(diagnostic) not in self.rejected:
                edit = Edit(start, start + len(old.encode()), new.encode())
                yield Fix(diagnostic=diagnostic, edits=(edit,))

    def is_own(self, state: FixResult, diagnostic: Diagnostic) -> bool:
        """Whether a diagnostic is in this text: that of an included file may not exist in another job."""
        return not diagnostic.span.path and diagnostic.path == state.loaded.source.name

    def largest_proved(self, kept: _ProvedFixes, fixes: list[Fix], before: FixResult) -> _ProvedFixes:
        """Add as many fixes as possible to those that are kept, so that the common proof holds."""
        if not fixes or self.checks >= MAX_CHECKS:
            return kept
        self.checks += 1
        together = (*kept.fixes, *fixes)
        data = apply_edits(before.data, [edit for fix in together for edit in fix.edits])
        after = self.check(data)
        # A job with errors was not planned, so what the planner reports is not new: compare before it runs.
        proof = prove(before.loaded, after, together) if has_errors(before.loaded.diagnostics) else None
        if isinstance(after, Checked) and (proof is None or proof.holds):
            after = examine(after)
        proof = proof or prove(before.loaded, after, together)
        if proof.holds and isinstance(after, Checked):
            return _ProvedFixes(together, FixResult(data, after, before.count + len(together)))
        remaining = {key_of(fix.diagnostic) for fix in proof.remaining}
        candidates = [fix for fix in fixes if key_of(fix.diagnostic) not in remaining]
        first = [fix for fix in candidates if fix.diagnostic.span.line not in proof.new_problems]
        then = [fix for fix in candidates if fix.diagnostic.span.line in proof.new_problems]
        if not first or len(first) == len(fixes):
            half = len(fixes) // 2
            first, then = (fixes[:half], fixes[half:]) if half else ([], [])
        return self.largest_proved(self.largest_proved(kept, first, before), then, before)


def _fixes(context: FixContext, diagnostic: Diagnostic) -> list[Fix]:
    """Return the fix of a diagnostic, if this one has a fix."""
    edits = FIXES[diagnostic.rule.code](context, diagnostic)
    return [Fix(diagnostic=diagnostic, edits=edits)] if edits else []
