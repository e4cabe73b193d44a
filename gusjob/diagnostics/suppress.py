"""Comments that allow a rule on their line: `LASER ON  ; allow GJ408: the lamp is dark, it only warms up`.

What may be allowed are warnings and notes; an error is a diagnostic whatever anybody says of it. A comment that allows
what is not there is told, so that it goes when its reason has gone.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Severity, Span
from gusjob.diagnostics.rules import RULES
from gusjob.i18n.phrases import Phrase, printable

_COMMENT = re.compile(
    r"(?:;|//)\s*allow(?P<gap>[\s:：,，]*)(?P<codes>GJ\w*(?:[\s,，]+GJ\w*)*)\s*(?:[:：]\s*(?P<reason>\S))?",
    re.IGNORECASE,
)
_CODE = re.compile(r"GJ\w*", re.IGNORECASE)

_UNKNOWN = Phrase("there is no such rule")
_ERROR = Phrase("an error can't be allowed")
_ITSELF = Phrase("what is wrong with a comment can't be allowed")
_FORM = Phrase("write it as in ; allow GJ304: why it is right here")
_NO_REASON = Phrase("a reason is missing: write it behind a colon, as in ; allow GJ304: why it is right here")
MAX_BYTES = 100_000
"""No statement is that long."""


@dataclass(slots=True, kw_only=True)
class Suppression:
    """One rule, allowed in one line. `span`: its code in the comment; `why_not`: why it is not followed."""

    code: str
    file: str
    span: Span
    why_not: str = ""
    used: bool = False


@dataclass(slots=True)
class Suppressions:
    """The allowances of a job, by file, line and rule."""

    by_place: dict[tuple[str, int, str], Suppression] = field(default_factory=dict)

    def add(self, name: str, data: bytes, *, top: bool) -> None:
        """Those of one more text. `top`: it is the job's own, not one that it includes."""
        for one in _allowances(name, data, path="" if top else name):
            self.by_place.setdefault((name, one.span.line, one.code), one)

    def without_allowed(self, diagnostics: list[Diagnostic]) -> list[Diagnostic]:
        """The diagnostics that no comment allows."""
        if not self.by_place:
            return diagnostics
        return [diagnostic for diagnostic in diagnostics if not self._allows(diagnostic)]

    def _allows(self, diagnostic: Diagnostic) -> bool:
        found = self.by_place.get((diagnostic.file, diagnostic.span.line, diagnostic.rule.code))
        if found is None:
            return False
        if diagnostic.severity is Severity.ERROR:
            found.why_not = _ERROR
        found.used = not found.why_not
        return found.used

    def allowed(self) -> set[str]:
        """Rules of which something was allowed."""
        return {one.code for one in self.by_place.values() if one.used}

    def diagnostics(self, path: str, judged: Callable[[str], bool]) -> list[Diagnostic]:
        """Comments that are not followed, and those that allow what is not there.

        `judged`: whether a rule was looked for wherever it may be. An included file's comments may be meant for another
        job.
        """
        told = Collector(path)
        for one in self.by_place.values():
            if one.why_not:
                told.add(rules.ALLOWED_IN_VAIN, one.span, {"code": one.code, "why": one.why_not})
            elif not one.used and not one.span.path and judged(one.code):
                told.add(rules.ALLOWS_NOTHING, one.span, {"code": one.code})
        return told.done(rules.MORE)


def _allowances(name: str, data: bytes, path: str) -> Iterator[Suppression]:
    small = data.lower()
    line, counted, at = 1, 0, small.find(b"allow")
    while at >= 0:
        start, end = data.rfind(b"\n", 0, at) + 1, data.find(b"\n", at)
        end = end if end >= 0 else len(data)
        line, counted = line + data.count(b"\n", counted, start), start
        if end - start <= MAX_BYTES:
            yield from _in_line(data[start:end].decode("utf-8", "replace"), line, name, path)
        at = small.find(b"allow", end)


def _in_line(text: str, line: int, name: str, path: str) -> Iterator[Suppression]:
    for comment in _COMMENT.finditer(text):
        for code in _CODE.finditer(text, comment.start("codes"), comment.end("codes")):
            column, known = code.start() + 1, printable(code[0].upper())
            span = Span(line=line, column=column, end_line=line, end_column=column + len(code[0]), path=path)
            yield Suppression(code=known, file=name, span=span, why_not=_why_not(known, comment))


def _why_not(code: str, comment: re.Match[str]) -> str:
    """Why a comment does not allow a rule; '' if it does."""
    if not comment["gap"].isspace():
        return _FORM
    if code not in RULES:
        return _UNKNOWN
    if RULES[code].severity is Severity.ERROR:
        return _ERROR
    if RULES[code] in (rules.ALLOWED_IN_VAIN, rules.ALLOWS_NOTHING):
        return _ITSELF
    return "" if comment["reason"] else _NO_REASON
