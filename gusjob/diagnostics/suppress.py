"""Comments that suppress a rule on their line: `LASER ON  ; allow GJ408: the lamp is dark, it only warms up`.

Only warnings and notes can be suppressed. A comment that suppresses nothing is reported, so that it is removed when it
is no longer needed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Severity, Span
from gusjob.diagnostics.rules import RULES
from gusjob.i18n.phrases import Phrase, printable
from gusjob.patterns import lazy_pattern

_COMMENT = lazy_pattern(
    r"(?:;|//)\s*allow(?P<gap>[\s:：,，]*)(?P<codes>GJ\w*(?:[\s,，]+GJ\w*)*)\s*(?:[:：]\s*(?P<reason>\S))?",
    re.IGNORECASE,
)
_CODE = lazy_pattern(r"GJ\w*", re.IGNORECASE | re.ASCII)

_UNKNOWN = Phrase("there is no such rule")
_ERROR = Phrase("an error can't be suppressed")
_ITSELF = Phrase("a diagnostic about a comment can't be suppressed")
_FORM = Phrase("its form is wrong: write for example: ; allow GJ304: the stop is intended")
_NO_REASON = Phrase("a reason is missing: write for example: ; allow GJ304: the stop is intended")
MAX_BYTES = 100_000
"""Longer lines are not searched: no statement is that long."""


class Suppression(Struct, frozen=True, kw_only=True):
    """A comment that suppresses one rule on its line.

    `span`: the code in the comment. `why_not`: why it has no effect, '' if it has. `used`: whether it suppressed
    something.
    """

    code: str
    file: str
    span: Span
    why_not: str = ""
    used: bool = False


_Key = tuple[str, int, str]
"""File, line and code of a rule."""


class Suppressions(Struct, frozen=True):
    """The suppressing comments of a job, by file, line and rule."""

    by_position: Mapping[_Key, Suppression] = field(default_factory=dict)

    def added(self, name: str, data: bytes, *, top: bool) -> Suppressions:
        """Return these and those of another text. `top`: it is the job's own, not one that it includes."""
        found = dict(self.by_position)
        for one in _in_text(name, data, path="" if top else name):
            found.setdefault((name, one.span.line, one.code), one)
        return Suppressions(found)

    def applied(self, diagnostics: list[Diagnostic]) -> tuple[list[Diagnostic], Suppressions]:
        """Return the diagnostics that no comment suppresses, and the comments with those marked that were used."""
        if not self.by_position:
            return diagnostics, self
        left, comments = [], dict(self.by_position)
        for diagnostic in diagnostics:
            key = (diagnostic.file, diagnostic.span.line, diagnostic.rule.code)
            found = comments.get(key)
            if found is not None:
                why_not = _ERROR if diagnostic.severity is Severity.ERROR else found.why_not
                found = comments[key] = replace(found, why_not=why_not, used=not why_not)
            if found is None or not found.used:
                left.append(diagnostic)
        return left, Suppressions(comments)

    def used_codes(self) -> set[str]:
        """Return the codes of the rules that were suppressed somewhere."""
        return {one.code for one in self.by_position.values() if one.used}

    def diagnostics(self, path: str, was_looked_for: Callable[[str], bool]) -> list[Diagnostic]:
        """Report comments that have no effect, and those that suppress what is not there.

        `was_looked_for`: whether a rule was looked for wherever it may apply. An included file's comments may be meant
        for another job.
        """
        collector = Collector(path)
        for one in self.by_position.values():
            if one.why_not:
                collector.add(rules.INVALID_SUPPRESSION, one.span, {"code": one.code, "why": one.why_not})
            elif not one.used and not one.span.path and was_looked_for(one.code):
                collector.add(rules.UNUSED_SUPPRESSION, one.span, {"code": one.code})
        return collector.finish(rules.NOT_LISTED)


NO_SUPPRESSIONS = Suppressions()


def _in_text(name: str, data: bytes, path: str) -> Iterator[Suppression]:
    """Find the comments of a text. `path`: the path of their spans."""
    # One byte is found faster than two.
    if b";" not in data and (b"/" not in data or b"//" not in data):
        return
    lower = data.lower()
    line, counted, at = 1, 0, lower.find(b"allow")
    while at >= 0:
        start, end = data.rfind(b"\n", 0, at) + 1, data.find(b"\n", at)
        end = end if end >= 0 else len(data)
        line, counted = line + data.count(b"\n", counted, start), start
        if end - start <= MAX_BYTES:
            yield from _in_line(data[start:end].decode("utf-8", "replace"), line, name, path)
        at = lower.find(b"allow", end)


def _in_line(text: str, line: int, name: str, path: str) -> Iterator[Suppression]:
    for comment in _COMMENT.finditer(text):
        for code in _CODE.finditer(text, comment.start("codes"), comment.end("codes")):
            column, known = code.start() + 1, printable(code[0].upper())
            span = Span(line=line, column=column, end_line=line, end_column=column + len(code[0]), path=path)
            yield Suppression(code=known, file=name, span=span, why_not=_why_not(known, comment))


def _why_not(code: str, comment: re.Match[str]) -> str:
    """Return why a comment does not suppress a rule, '' if it does."""
    if not comment["gap"].isspace():
        return _FORM
    if code not in RULES:
        return _UNKNOWN
    if RULES[code].severity is Severity.ERROR:
        return _ERROR
    if RULES[code] in (rules.INVALID_SUPPRESSION, rules.UNUSED_SUPPRESSION):
        return _ITSELF
    return "" if comment["reason"] else _NO_REASON
