"""Words of the language in small letters: in how many lines, where first, and the same text in capitals.

The language takes them in any letters; people who read a job look for words in capitals and names in small ones. As
the reader does, this goes by the shapes of lines (shapes.py), so that a million lines are a handful to look at. `and`,
`or`, `not` and functions stand in small letters, units in their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from lark import UnexpectedInput

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Span
from gusjob.frontend.parse.lines import keywords, parser
from gusjob.frontend.parse.statements import GRAMMAR, read_statement
from gusjob.frontend.scan.shapes import MAX_LINE, chunks, shapes_of, without_comments
from gusjob.kinematics.units import UNITS

_SMALL_TOO = {"AND", "OR", "NOT"}
_LETTERS = re.compile(r"[A-Za-z_]+")
_RUN = re.compile(rb"([A-Za-z_]+)")


def may_hold_small_words(code: str) -> bool:
    """Whether a line without its comment is worth asking the grammar: a name such as `x` looks like a word, too."""
    if code.isupper():
        return False
    known = keywords(GRAMMAR)
    for run in _LETTERS.finditer(code):
        word = run[0]
        if not word.isupper() and word.upper() in known and word.upper() not in _SMALL_TOO:
            unit = word.lower() in UNITS and run.start() and code[run.start() - 1] in "0123456789."
            if not unit:
                return True
    return False


def small_words(code: str) -> list[tuple[int, int]]:
    """Where in a line that can be read, without its comment, words stand in other letters than capitals."""
    known = keywords(GRAMMAR) - _SMALL_TOO
    return [(start, end) for kind, start, end in words_of(code) if kind in known and code[start:end] != kind]


def words_of(code: str) -> list[tuple[str, int, int]]:
    """Each word of a line without its comment: its terminal in the grammar, where it begins, and the place behind it.
    As far as the line can be read."""
    found = []
    try:
        for token in parser(GRAMMAR).parse_interactive(code).iter_parse():
            start = token.start_pos or 0
            found.append((str(token.type), start, start + len(token)))
    except UnexpectedInput:
        pass
    return found


def small_note(data: bytes, name: str) -> Diagnostic | None:
    """The first of them in a text, with in how many lines there are some."""
    first, count = None, 0
    for number, code, form in _small_lines(data):
        first = first or (number, code, form)
        count += 1
    if first is None:
        return None
    line, code, form = first
    text = code.decode()
    start, end = small_words(text)[0]
    return Diagnostic(
        rule=rules.SMALL,
        span=Span(line=line, column=start + 1, end_line=line, end_column=end + 1),
        fields={"word": text[start:end], "meant": text[start:end].upper()},
        path=name,
        count=count,
    )


def in_capitals(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Each line (from 1) that has small words, up to its comment, with these words in capitals."""
    for number, code, form in _small_lines(data):
        yield number, form.capital(code)


@dataclass(frozen=True, slots=True)
class _Form:
    """Which runs of letters in the lines of a shape are words in small letters. `all`: no other run has any."""

    runs: tuple[int, ...]
    all: bool

    def capital(self, code: bytes) -> bytes:
        """A line of the shape with these runs in capitals."""
        if self.all:
            return code.upper()
        pieces = _RUN.split(code)
        for run in self.runs:
            pieces[2 * run + 1] = pieces[2 * run + 1].upper()
        return b"".join(pieces)


def _small_lines(data: bytes) -> Iterator[tuple[int, bytes, _Form]]:
    """Number, text up to the comment and form of each line with small words."""
    forms: dict[bytes, _Form | None] = {}
    number = 0
    for text in chunks(data):
        bare = without_comments(text)
        rows = shapes_of(bare)
        codes = bare.split(b"\n")
        lines = codes if bare is text else text.split(b"\n")
        if fresh := set(rows) - forms.keys():
            places = dict(zip(reversed(rows), reversed(codes), strict=True))
            forms |= {shape: _learnt(places[shape]) for shape in fresh}
        for i, shape in enumerate(rows):
            form = forms[shape]
            if form is not None and len(lines[i]) <= MAX_LINE:
                yield number + i + 1, codes[i], form
        number += len(rows)


def _learnt(code: bytes) -> _Form | None:
    text = code.decode("utf-8", "replace")
    if len(code) > MAX_LINE or not may_hold_small_words(text) or read_statement(text, 1)[0] is None:
        return None
    starts = {len(text[:start].encode()) for start, _ in small_words(text)}
    if not starts:
        return None
    runs = list(_RUN.finditer(code))
    small = tuple(i for i, run in enumerate(runs) if run.start() in starts)
    return _Form(small, all(i in small or run[0].isupper() or not run[0].strip(b"_") for i, run in enumerate(runs)))
