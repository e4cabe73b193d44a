"""Diagnostics as values: spans, rules, diagnostics, and their collector. The rules themselves are in rules/."""

from __future__ import annotations

import re
from collections.abc import Iterable
from enum import Enum
from typing import Any

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.i18n.phrases import Phrase, localized


class Severity(Enum):
    """How serious a diagnostic is: an error fails, a warning fails with --strict, a note never fails."""

    ERROR = "error"
    WARNING = "warning"
    NOTE = "note"

    @property
    def localized(self) -> str:
        """The word in the user's language."""
        return localized(_SEVERITIES[self])


SEVERITY_ORDER = (Severity.NOTE, Severity.WARNING, Severity.ERROR)
"""Severities from the lowest to the highest."""
_SEVERITIES = {
    Severity.ERROR: Phrase("error"),
    Severity.WARNING: Phrase("warning"),
    Severity.NOTE: Phrase("note"),
}


class Span(Struct, frozen=True, kw_only=True):
    """A start and an end in a text: lines and columns from 1, in characters; `end_column` is exclusive.

    An `end_line` or `end_column` of 0 means that only the start is known. `path`: '' for the text that a diagnostic is
    about, otherwise the file that it includes.
    """

    line: int
    column: int = 1
    end_line: int = 0
    end_column: int = 0
    path: str = ""


NOWHERE = Span(line=1)
"""The span of a diagnostic about a whole file."""


class Rule(Struct, frozen=True, kw_only=True):
    """A kind of diagnostic.

    `code`: stable. `text`: the message, a template that a diagnostic's fields are filled into. `why`: why it matters.
    `bad`, `good`: a job (for GJ7, a listing) with the problem and one without. `section`: of the vendor's manual.
    """

    code: str
    severity: Severity
    title: str
    text: str
    why: str
    bad: str = ""
    good: str = ""
    section: str = ""

    @property
    def name(self) -> str:
        """The title as one word, such as jump-with-the-laser-on."""
        return name_of(self.title)


def name_of(title: str) -> str:
    """Make a rule's name of its title: lower case, hyphens between the words."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


class Remark(Struct, frozen=True, kw_only=True):
    """Another position that matters for a diagnostic. `text`: a template, one of REMARKS."""

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


class Diagnostic(Struct, frozen=True, kw_only=True):
    """A reported problem: a rule, a span, and the values in its message.

    `path`: the text that it is about; `span.path`, if set, is the file with the position. `count`: the number of
    iterations and calls of the same statement that have it. `remarks`: other positions, the nearest first.
    `severity_override`: the severity that the profile gives it instead of the rule's.
    """

    rule: Rule
    span: Span
    fields: dict[str, Any] = field(default_factory=dict)
    path: str = ""
    count: int = 1
    remarks: tuple[Remark, ...] = ()
    severity_override: Severity | None = None

    @property
    def message(self) -> str:
        """The rule's text with the fields filled in, in English."""
        return self.phrase

    @property
    def phrase(self) -> Phrase:
        """The message as a phrase, to be part of another one."""
        return Phrase(self.rule.text, **self.fields)

    @property
    def localized(self) -> str:
        """The message in the user's language."""
        return localized(self.phrase)

    @property
    def localized_with_count(self) -> str:
        """The message in the user's language, with its count if that is above 1."""
        return self.localized + (
            localized(Phrase(" ({count} times)", count=f"{self.count:,}")) if self.count > 1 else ""
        )

    @property
    def file(self) -> str:
        """The file with the position."""
        return self.span.path or self.path

    @property
    def severity(self) -> Severity:
        """The severity of the profile, otherwise the rule's."""
        return self.severity_override or self.rule.severity

    def at_least(self, severity: Severity) -> Diagnostic:
        """Return the diagnostic with at least this severity."""
        if SEVERITY_ORDER.index(self.severity) >= SEVERITY_ORDER.index(severity):
            return self
        return replace(self, severity_override=severity)


def has_errors(diagnostics: Iterable[Diagnostic]) -> bool:
    """Whether any of them is an error."""
    return any(d.severity is Severity.ERROR for d in diagnostics)


# The texts of remarks.
CALLED = "called here{values}"
IN_ITERATION = "in the iteration where {values}"
ITERATION_NUMBER = "in iteration {number}"
INCLUDED = "included here"
SET_HERE = "{name} is set here"
MODE_HERE = "the mode is set here: {mode}"
ON_HERE = "the laser is switched on here"
FIRST_HERE = "the first one is here"
OVERRIDDEN = "{name} is {value} by -D, not as written here"
REMARKS = (CALLED, IN_ITERATION, ITERATION_NUMBER, INCLUDED, SET_HERE, MODE_HERE, ON_HERE, FIRST_HERE, OVERRIDDEN)
"""Every text of a Remark."""


MAX_PER_RULE = 1000
"""The number of diagnostics of one rule that are listed; the others are only counted."""


class Collector(Struct):
    """Collects the diagnostics of one text: lists up to MAX_PER_RULE of each rule and counts the others.

    `counts`: all diagnostics by code; `listed`: the listed ones.
    """

    path: str
    found: list[Diagnostic] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    listed: dict[str, int] = field(default_factory=dict)

    def remaining(self, rule: Rule) -> int:
        """Return how many more diagnostics of a rule will be listed."""
        return MAX_PER_RULE - self.listed.get(rule.code, 0)

    def add(
        self, rule: Rule, span: Span, fields: dict[str, Any], count: int = 1, remarks: tuple[Remark, ...] = ()
    ) -> None:
        """Add a diagnostic. `count`: the number of iterations that have it."""
        if self.remaining(rule):
            self.found.append(
                Diagnostic(rule=rule, span=span, fields=fields, path=self.path, count=count, remarks=remarks)
            )
            self.listed[rule.code] = self.listed.get(rule.code, 0) + 1
        self.count_unlisted(rule, 1)

    def count_again(self, index: int, count: int) -> None:
        """Increase the count of the diagnostic at an index of `found`."""
        self.found[index] = replace(self.found[index], count=self.found[index].count + count)

    def count_unlisted(self, rule: Rule, more: int) -> None:
        """Count diagnostics that are not made, since they would not be listed."""
        self.counts[rule.code] = self.counts.get(rule.code, 0) + more

    def finish(self, more: Rule) -> list[Diagnostic]:
        """Return all listed diagnostics and, as diagnostics of the rule `more`, the number of the others."""
        not_listed = [
            Diagnostic(
                rule=more,
                span=NOWHERE,
                fields={"count": count - MAX_PER_RULE, "code": code, "shown": MAX_PER_RULE},
                path=self.path,
            )
            for code, count in self.counts.items()
            if count > MAX_PER_RULE
        ]
        return [*self.found, *not_listed]
