"""Keywords in lower case: in how many lines, where the first one is, and the same text in upper case.

The language takes keywords in any case; people look for keywords in upper case and names in lower case. `and`, `or`,
`not` and functions are written in lower case, units in their own spelling.
"""

from __future__ import annotations

from collections.abc import Iterator

from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.frontend.parse.grammar import JOB_GRAMMAR, keywords, words_of
from gusjob.frontend.parse.statement_parser import parse_statement
from gusjob.frontend.scan.shapes import MAX_LINE, ShapeTable, chunks, shapes_of, strip_comments
from gusjob.kinematics.units import UNITS
from gusjob.patterns import lazy_pattern

_LOWER_CASE = {"AND", "OR", "NOT"}
_LETTERS = lazy_pattern(r"[A-Za-z_]+")
_LETTER_RUN = lazy_pattern(rb"([A-Za-z_]+)")


def has_lower_case_keywords(code: str) -> bool:
    """Whether a line that can be parsed, without its comment, has keywords that are not in upper case."""
    return _may_have_any(code) and bool(lower_case_keywords(code))


def _may_have_any(code: str) -> bool:
    """Whether a line must be tokenized to know: a name such as `x` is spelled as a keyword is."""
    if code.isupper():
        return False
    known = keywords(JOB_GRAMMAR)
    for run in _LETTERS.finditer(code):
        word = run[0]
        if not word.isupper() and word.upper() in known and word.upper() not in _LOWER_CASE:
            unit = word.lower() in UNITS and run.start() and code[run.start() - 1] in "0123456789."
            if not unit:
                return True
    return False


def lower_case_keywords(code: str) -> list[tuple[int, int]]:
    """Start and end of each keyword that is not in upper case."""
    known = keywords(JOB_GRAMMAR) - _LOWER_CASE
    return [(start, end) for kind, start, end in words_of(code) if kind in known and code[start:end] != kind]


def lower_case_note(data: bytes, name: str) -> Diagnostic | None:
    """The note on the first such keyword of a text, with the number of lines that have some."""
    first, count = None, 0
    for number, code, _ in _lines_to_change(data):
        first = first or (number, code)
        count += 1
    if first is None:
        return None
    line, text = first[0], first[1].decode()
    start, end = lower_case_keywords(text)[0]
    return Diagnostic(
        rule=rules.LOWERCASE_KEYWORD,
        span=Span(line=line, column=start + 1, end_line=line, end_column=end + 1),
        fields={"word": text[start:end], "meant": text[start:end].upper()},
        path=name,
        count=count,
    )


def in_upper_case(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Number (from 1) and code of each line that has such keywords, with these keywords in upper case."""
    for number, code, letters in _lines_to_change(data):
        yield number, letters.to_upper(code)


class _KeywordRuns(Struct, frozen=True):
    """Which runs of letters in the lines of a shape are keywords to change. `all`: no other run has lower case."""

    runs: tuple[int, ...]
    all: bool

    def to_upper(self, code: bytes) -> bytes:
        """A line of the shape with these runs in upper case."""
        if self.all:
            return code.upper()
        parts = _LETTER_RUN.split(code)
        for run in self.runs:
            parts[2 * run + 1] = parts[2 * run + 1].upper()
        return b"".join(parts)


def _lines_to_change(data: bytes) -> Iterator[tuple[int, bytes, _KeywordRuns]]:
    """Number, code and keyword runs of each line with keywords that are not in upper case."""
    table = ShapeTable(_keyword_runs)
    number = 0
    for text in chunks(data):
        bare = strip_comments(text)
        codes = bare.split(b"\n")
        lines = codes if bare is text else text.split(b"\n")
        for i, runs in enumerate(table.look_up(shapes_of(bare), codes.__getitem__)):
            if runs is not None and len(lines[i]) <= MAX_LINE:
                yield number + i + 1, codes[i], runs
        number += len(codes)


def _keyword_runs(code: bytes) -> _KeywordRuns | None:
    text = code.decode("utf-8", "replace")
    if len(code) > MAX_LINE or not _may_have_any(text) or parse_statement(text, 1)[0] is None:
        return None
    starts = {len(text[:start].encode()) for start, _ in lower_case_keywords(text)}
    if not starts:
        return None
    runs = list(_LETTER_RUN.finditer(code))
    keyword_runs = tuple(i for i, run in enumerate(runs) if run.start() in starts)
    is_all = all(i in keyword_runs or run[0].isupper() or not run[0].strip(b"_") for i, run in enumerate(runs))
    return _KeywordRuns(keyword_runs, is_all)
