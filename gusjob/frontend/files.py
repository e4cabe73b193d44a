"""The files of a job: numbered lines across all of them, and which file an INCLUDE may read."""

from __future__ import annotations

import re
from bisect import bisect_right
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path, PureWindowsPath

from gusjob.diagnostics.model import SET_HERE, Remark, Span
from gusjob.frontend.parse.statements import Statement, read_statement
from gusjob.frontend.source import Source, read_source
from gusjob.i18n.phrases import Phrase


@dataclass(slots=True)
class SourceMap:
    """Texts one behind the other: a line's number counts through all of them, so that the first text keeps its own."""

    sources: list[Source] = field(default_factory=list)
    bases: list[int] = field(default_factory=list)

    def add(self, source: Source) -> int:
        """One more text; returns what is added to its line numbers."""
        base = self.bases[-1] + self.sources[-1].count_lines() if self.sources else 0
        self.sources.append(source)
        self.bases.append(base)
        return base

    def find(self, line: int) -> tuple[Source, int]:
        """The text of a line, and the line's number in it."""
        at = max(bisect_right(self.bases, line - 1) - 1, 0)
        return self.sources[at], line - self.bases[at]

    @property
    def files(self) -> tuple[tuple[str, int], ...]:
        """Name and base of every text, where there is more than one."""
        named = tuple((source.name, base) for source, base in zip(self.sources, self.bases, strict=True))
        return named if len(named) > 1 else ()

    def text_of(self, span: Span) -> str:
        """The text of a span's first line."""
        named = (source for source in self.sources[1:] if source.name == span.path)
        source = next(named, None) if span.path else self.sources[0]
        return source.line(span.line) if source else ""

    def statement(self, line: int) -> Statement | None:
        """The statement in a line, read again."""
        source, number = self.find(line)
        return read_statement(source.line(number), number)[0]

    def set_here(self, line: int, word: str, lets: dict[str, list[int]]) -> tuple[Remark, ...]:
        """Where the names in a word's expression were set: of several LETs the last one above it."""
        statement = self.statement(line)
        quantity = statement.words.get("" if word == "value" else word) if statement else None
        names = quantity.expression.names if quantity and quantity.expression else ()
        found = []
        for name in names:
            at = lets.get(name, [])
            above = [one for one in at if one < line] or at
            if above:
                found.append(Remark(text=SET_HERE, span=self.locate(above[-1], ""), fields={"name": name}))
        return tuple(found)

    def locate(self, line: int, word: str) -> Span:
        """Where a word of a line stands ('' for the statement)."""
        source, number = self.find(line)
        path = "" if source is self.sources[0] else source.name
        statement = read_statement(source.line(number), number)[0]
        return statement.span(number, word, path) if statement else Span(line=number, path=path)


_INCLUDES = re.compile(rb'include[ \t]*"([^"\n]*)"', re.IGNORECASE)
_MOST_JOBS, _MOST_BYTES = 5000, 10_000_000
"""So many jobs near by are looked at, and so much of each."""


def may_be_a_part(path: Path) -> bool:
    """Whether a job in a file's folder, or in one of the two above, includes it, or includes a file that does.

    Where there are too many to look at, one may.
    """
    here = Path(path).resolve()  # Of an editor's path, too: looking at other jobs makes them no part of this one.
    near = [job for folder in here.parents[:3] for job in folder.glob("*.job")]
    seen = set(near)
    while near:
        if len(seen) > _MOST_JOBS:
            return True
        found = _included_by(near.pop())
        if here in found:
            return True
        near += found - seen
        seen |= found
    return False


def _included_by(job: Path) -> set[Path]:
    """The files that a job names to be included, with loops and conditions not looked at."""
    try:
        if not job.is_file():  # A pipe would be waited for.
            return set()
        return {(job.parent / name).resolve() for name in _names_in(job, job.stat().st_mtime_ns)}
    except (OSError, RuntimeError):
        return set()


@lru_cache(maxsize=_MOST_JOBS)
def _names_in(job: Path, _changed_ns: int) -> frozenset[str]:
    """The names in the INCLUDE lines of a job, as long as it stays the same: an editor asks with every keystroke."""
    with job.open("rb") as file:
        data = file.read(_MOST_BYTES)
    names = (found[1].decode("utf-8", "replace").replace("\\", "/") for found in _INCLUDES.finditer(data))
    return frozenset(name for name in names if "\0" not in name)


def included(name: str, source: Source, top: Source) -> tuple[Source | None, str]:
    """The text that an INCLUDE in `source` names, or why it is refused. Nothing outside the job's folder is read."""
    if source.path is None or top.path is None:
        return None, Phrase("this text comes from no file, so there is no folder to look in")
    if not name or "\0" in name or not name.isprintable():
        return None, Phrase("this is no file name")
    relative = name.replace("\\", "/")
    if relative.startswith("/") or PureWindowsPath(name).drive or PureWindowsPath(name).is_absolute():
        return None, Phrase("write it relative to the file that includes it")
    try:
        folder = top.path.resolve().parent
        path = (source.path.resolve().parent / relative).resolve()
        if not path.is_relative_to(folder):
            return None, Phrase("it lies outside the job's folder")
        if not path.is_file():
            return None, Phrase("it is no file") if path.exists() else Phrase("there is no such file")
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: a loop of links.
        reason = getattr(error, "strerror", None)
        return None, reason.lower() if reason else Phrase("it can't be found")
    shown = top.name.replace("\\", "/").rpartition("/")[0]
    inside = path.relative_to(folder).as_posix()
    found, diagnostics = read_source(path, f"{shown}/{inside}" if shown else inside)
    return found, diagnostics[0].phrase if diagnostics else ""
