"""User diagnostics as values: spans, rules, diagnostics, and how they are gathered. The rules themselves: rules.py."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from gusjob.i18n.phrases import Phrase, localized


class Severity(Enum):
    """What a diagnostic means for the exit code: an error fails, a warning fails with --strict, a note never."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"

    @property
    def localized(self) -> str:
        """The word for people, in their language."""
        return localized(_SEVERITIES[self])


WEIGHTS = (Severity.NOTE, Severity.WARNING, Severity.ERROR)
"""Severities from the lightest to the heaviest."""
_SEVERITIES = {
    Severity.ERROR: Phrase("error"),
    Severity.WARNING: Phrase("warning"),
    Severity.NOTE: Phrase("note"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A place in a text: lines and columns from 1, in characters; `end_column` is the first column behind.

    `path` is '' in the text that a diagnostic is about, else the file that it includes.
    """

    line: int
    column: int = 1
    end_line: int = 0
    end_column: int = 0
    path: str = ""


NOWHERE = Span(line=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One thing that can be wrong. `code` is stable; `text` is a template whose fields a diagnostic fills in.

    `why` it hurts; `bad` and `good`: a job (of GJ7, a listing) that has the diagnostic, and one that has not;
    `section` of the vendor's manual. The registry is rules.py.
    """

    code: str
    severity: Severity
    title: str
    text: str
    why: str
    bad: str = ""
    good: str = ""
    section: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Remark:
    """Another place that matters for a diagnostic. `text` is a template of REMARKS."""

    text: str
    span: Span
    fields: dict[str, Any] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """The text with the fields filled in, in English."""
        return Phrase(self.text, **self.fields)

    @property
    def localized(self) -> str:
        """The message in the user's language."""
        return localized(Phrase(self.text, **self.fields))


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """One diagnostic found: a rule, the fields of its text, and where.

    `path`: the text that it is about; `span.path`, where it is set, the file in which the place is. `count`: in how
    many rounds and calls of the same statement. `remarks`: other places, the nearest first.
    """

    rule: Rule
    span: Span
    fields: dict[str, Any] = field(default_factory=dict)
    path: str = ""
    count: int = 1
    remarks: tuple[Remark, ...] = ()
    weight: Severity | None = None
    """The severity that a profile gives it, in place of the rule's."""

    @property
    def message(self) -> str:
        """The rule's text with the fields filled in, in English."""
        return self.phrase

    @property
    def phrase(self) -> Phrase:
        """The message, to be said as part of another one."""
        return Phrase(self.rule.text, **self.fields)

    @property
    def localized(self) -> str:
        """The message in the user's language."""
        return localized(self.phrase)

    @property
    def localized_with_count(self) -> str:
        """The message in the user's language, and how many times it was met."""
        return self.localized + (
            localized(Phrase(" ({count} times)", count=f"{self.count:,}")) if self.count > 1 else ""
        )

    @property
    def file(self) -> str:
        """The file in which the place is."""
        return self.span.path or self.path

    @property
    def severity(self) -> Severity:
        """The profile's where it says one, else the rule's."""
        return self.weight or self.rule.severity

    def at_least(self, weight: Severity) -> Diagnostic:
        """The same, and no lighter than that."""
        return self if WEIGHTS.index(self.severity) >= WEIGHTS.index(weight) else replace(self, weight=weight)


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Whether any of them is an error."""
    return any(d.severity is Severity.ERROR for d in diagnostics)


# What is said of other places.
CALLED = "called here{values}"
ROUND = "in the round where {values}"
NTH_ROUND = "in round {number}"
INCLUDED = "included here"
SET_HERE = "{name} is set here"
MODE_HERE = "the mode is set here: {mode}"
ON_HERE = "the laser is switched on here"
FIRST_HERE = "the first one is here"
REMARKS = (CALLED, ROUND, NTH_ROUND, INCLUDED, SET_HERE, MODE_HERE, ON_HERE, FIRST_HERE)
"""Every text of a Remark."""


MAX_PER_RULE = 1000
"""So many diagnostics of one rule are listed; the rest is counted."""


@dataclass(slots=True)
class Collector:
    """Gathers diagnostics of one text; of each rule it lists so many and counts the rest."""

    path: str
    found: list[Diagnostic] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    listed: dict[str, int] = field(default_factory=dict)

    def room(self, rule: Rule) -> int:
        """How many more diagnostics of a rule will be listed."""
        return MAX_PER_RULE - self.listed.get(rule.code, 0)

    def add(
        self, rule: Rule, span: Span, fields: dict[str, Any], count: int = 1, remarks: tuple[Remark, ...] = ()
    ) -> None:
        """One diagnostic, perhaps of many rounds."""
        if self.room(rule):
            self.found.append(
                Diagnostic(rule=rule, span=span, fields=fields, path=self.path, count=count, remarks=remarks)
            )
            self.listed[rule.code] = self.listed.get(rule.code, 0) + 1
        self.uncounted(rule, 1)

    def again(self, index: int, count: int) -> None:
        """The diagnostic at an index of `found` was met so many times more."""
        self.found[index] = replace(self.found[index], count=self.found[index].count + count)

    def uncounted(self, rule: Rule, more: int) -> None:
        """Diagnostics that were found and are not worth making, since they would not be listed."""
        self.counts[rule.code] = self.counts.get(rule.code, 0) + more

    def done(self, more: Rule) -> list[Diagnostic]:
        """All that are listed, and for each rule, by the rule `more`, how many more there are."""
        left = [
            Diagnostic(
                rule=more,
                span=NOWHERE,
                fields={"count": count - MAX_PER_RULE, "code": code, "shown": MAX_PER_RULE},
                path=self.path,
            )
            for code, count in self.counts.items()
            if count > MAX_PER_RULE
        ]
        return [*self.found, *left]
