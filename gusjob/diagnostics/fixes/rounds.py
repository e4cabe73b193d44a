"""A job mended in rounds: what is mended may reveal what can be mended next.

A round judges the text once with all its mends. Only if they don't keep their word (proof.py) it is judged again
without those that stand where something is wrong; and only if that does not help, the rest is tried by halves.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from gusjob.diagnostics.fixes.proof import Key, key_of, verdict
from gusjob.diagnostics.fixes.table import MENDS, READS
from gusjob.diagnostics.fixes.text import Look, Mend, apart, edited
from gusjob.diagnostics.model import Diagnostic, has_errors
from gusjob.pipeline import Checked, FileResult, examine

MAX_ROUNDS = 200
"""Of a rule 1000 diagnostics are listed, so a file of 100,000 is mended to its end."""
MAX_TRIES = 100
"""So often a file is judged to find mends that don't keep their word; what was not tried then stays as it is."""

Judge = Callable[[bytes], FileResult]
"""Reads and checks a text in the place of the file's own (loading.load; what looks closer comes behind it)."""


@dataclass(frozen=True, slots=True)
class Mended:
    """What became of a job: its text, how it is judged, and how many diagnostics are gone."""

    data: bytes
    loaded: Checked
    count: int = 0


def mended(loaded: Checked, judge: Judge, wanted: Callable[[Diagnostic], bool]) -> Mended:
    """A job that was judged, with all mends that keep their word; what is no job stays as it is."""
    state = Mended(loaded.source.data, loaded)
    run = _Run(judge=judge, wanted=wanted)
    for _ in range(MAX_ROUNDS):
        mends = run.found(state)
        if not mends:
            break
        kept = run.best(_Tried((), state), mends, state)
        state = kept.state
        run.refused |= {key_of(mend.diagnostic) for mend in mends} - {key_of(mend.diagnostic) for mend in kept.mends}
    return state


@dataclass(frozen=True, slots=True)
class _Tried:
    """Mends of a text that keep their word together, and what they make of it."""

    mends: tuple[Mend, ...]
    state: Mended


@dataclass(slots=True)
class _Run:
    judge: Judge
    wanted: Callable[[Diagnostic], bool]
    refused: set[Key] = field(default_factory=set)
    """Diagnostics of which the mend did not keep its word."""
    tries: int = 0

    def found(self, state: Mended) -> list[Mend]:
        """Mends that can be tried together; as long as lines can't be read that could be, only theirs."""
        if state.loaded.job is None:
            return []
        look = Look(state.loaded, state.data)
        diagnostics = [
            f for f in state.loaded.diagnostics if f.rule.code in MENDS and self.wanted(f) and self.own(state, f)
        ]
        reading = [
            mend for diagnostic in diagnostics if diagnostic.rule.code in READS for mend in _mends(look, diagnostic)
        ]
        return apart(reading or [mend for diagnostic in diagnostics for mend in _mends(look, diagnostic)])

    def own(self, state: Mended, diagnostic: Diagnostic) -> bool:
        """Whether a diagnostic stands in this text (one of an included file may be none elsewhere), and is not given
        up."""
        here = not diagnostic.span.path and diagnostic.path == state.loaded.source.name
        return here and key_of(diagnostic) not in self.refused

    def best(self, kept: _Tried, mends: list[Mend], before: Mended) -> _Tried:
        """As many of these mends as keep their word together with those that are kept already."""
        if not mends or self.tries >= MAX_TRIES:
            return kept
        self.tries += 1
        all_of_them = (*kept.mends, *mends)
        data = edited(before.data, [edit for mend in all_of_them for edit in mend.edits])
        after = self.judge(data)
        # A job with errors was not planned: what the planner says of it is heard for the first time, and not compared.
        said = verdict(before.loaded, after, all_of_them) if has_errors(before.loaded.diagnostics) else None
        if isinstance(after, Checked) and (said is None or said.good):
            after = examine(after)
        said = said or verdict(before.loaded, after, all_of_them)
        if said.good and isinstance(after, Checked):
            return _Tried(all_of_them, Mended(data, after, before.count + len(all_of_them)))
        left = {key_of(mend.diagnostic) for mend in said.left}
        first = [m for m in mends if key_of(m.diagnostic) not in left and m.diagnostic.span.line not in said.worse]
        then = [m for m in mends if key_of(m.diagnostic) not in left and m.diagnostic.span.line in said.worse]
        if not first or len(first) == len(mends):
            half = len(mends) // 2
            first, then = (mends[:half], mends[half:]) if half else ([], [])
        return self.best(self.best(kept, first, before), then, before)


def _mends(look: Look, diagnostic: Diagnostic) -> list[Mend]:
    """The mend of a diagnostic, if this one has a mend."""
    edits = MENDS[diagnostic.rule.code](look, diagnostic)
    return [Mend(diagnostic=diagnostic, edits=edits)] if edits else []
