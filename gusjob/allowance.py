"""Comments that allow a rule on their line: `LASER ON  ; allow GJ408: the lamp is dark, it only warms up`.

What may be allowed are warnings and notes; an error is a fault whatever anybody says of it. A comment that allows what
is not there is told, so that it goes when its reason has gone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from gusjob import rules
from gusjob.diagnostics import Diagnostic, Severity, Span
from gusjob.phrases import Phrase, printable
from gusjob.rules import RULES

_COMMENT = re.compile(
    r"(?:;|//)\s*allow\s+(?P<codes>GJ\w*(?:[\s,，]+GJ\w*)*)\s*(?:[:：]\s*(?P<reason>\S))?", re.IGNORECASE
)
_MAYBE = re.compile(rb"(?:;|//)[ \t]*allow[ \t]+GJ", re.IGNORECASE)
MAX_ALLOWANCES = 100_000
"""A file with more of them is judged as if it had no others."""

_UNKNOWN = Phrase("there is no such rule")
_ERROR = Phrase("an error can't be allowed")
_NO_REASON = Phrase("a reason is missing: write it behind a colon, as in ; allow GJ304: why it is right here")


@dataclass(slots=True, kw_only=True)
class Allowance:
    """One rule, allowed in one line. `span`: its code in the comment; `why_not`: why it is not followed."""

    code: str
    file: str
    span: Span
    why_not: str = ""
    used: bool = False


@dataclass(slots=True)
class Allowances:
    """The allowances of a job, by file, line and rule."""

    by_place: dict[tuple[str, int, str], Allowance] = field(default_factory=dict)

    def add(self, name: str, data: bytes, *, top: bool) -> None:
        """Those of one more text. `top`: it is the job's own, not one that it includes."""
        for one in _allowances(name, data, path="" if top else name):
            self.by_place.setdefault((name, one.span.line, one.code), one)

    def without_allowed(self, faults: list[Diagnostic]) -> list[Diagnostic]:
        """The faults that no comment allows."""
        if not self.by_place:
            return faults
        return [fault for fault in faults if not self._allows(fault)]

    def _allows(self, fault: Diagnostic) -> bool:
        found = self.by_place.get((fault.file, fault.span.line, fault.rule.code))
        if found is None:
            return False
        if fault.severity is Severity.ERROR:
            found.why_not = _ERROR
        found.used = not found.why_not
        return found.used

    def faults(self, path: str, judged: Iterable[str]) -> Iterator[Diagnostic]:
        """Comments that are not followed, and those that allow what is not there. `judged`: beginnings of the codes
        that were looked for."""
        prefixes = tuple(judged)
        for one in self.by_place.values():
            fields = {"code": one.code, "why": one.why_not}
            if one.why_not:
                yield Diagnostic(rule=rules.ALLOWED_IN_VAIN, span=one.span, fields=fields, path=path)
            elif not one.used and one.code.startswith(prefixes):
                yield Diagnostic(rule=rules.ALLOWS_NOTHING, span=one.span, fields={"code": one.code}, path=path)


def _allowances(name: str, data: bytes, path: str) -> Iterator[Allowance]:
    if b"allow" not in data.lower():  # Five times as fast as the search, and most texts have none.
        return
    line, counted = 1, 0
    for number, found in enumerate(_MAYBE.finditer(data)):
        if number == MAX_ALLOWANCES:
            return
        start = data.rfind(b"\n", 0, found.start()) + 1
        end = data.find(b"\n", found.start())
        line, counted = line + data.count(b"\n", counted, start), start
        yield from _in_line(data[start : end if end >= 0 else len(data)].decode("utf-8", "replace"), line, name, path)


def comment_in(text: str) -> re.Match[str] | None:
    """The comment of a line that allows something, with its `codes` and the beginning of its `reason`."""
    return _COMMENT.search(text)


def _in_line(text: str, line: int, name: str, path: str) -> Iterator[Allowance]:
    found = comment_in(text)
    if found is None:
        return
    for code in re.finditer(r"GJ\w*", found["codes"], re.IGNORECASE):
        column = found.start("codes") + code.start() + 1
        span = Span(line=line, column=column, end_line=line, end_column=column + len(code[0]), path=path)
        known = printable(code[0].upper())
        yield Allowance(code=known, file=name, span=span, why_not=_why_not(known, found["reason"]))


def _why_not(code: str, reason: str | None) -> str:
    if code not in RULES:
        return _UNKNOWN
    if RULES[code].severity is Severity.ERROR:
        return _ERROR
    return "" if reason else _NO_REASON
