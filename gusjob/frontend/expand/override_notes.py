"""Notes at diagnostics whose values come from an override: the text that they point to has another value."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from msgspec import Struct
from msgspec.structs import replace

from gusjob.diagnostics.model import (
    CALLED,
    IN_ITERATION,
    ITERATION_NUMBER,
    OVERRIDDEN,
    SET_HERE,
    Diagnostic,
    Remark,
    Span,
)
from gusjob.frontend.expand.let_overrides import NameScope
from gusjob.frontend.parse.statement import Statement
from gusjob.frontend.source_map import SourceMap
from gusjob.ir.overrides import Overrides

_STEPS = (CALLED, IN_ITERATION, ITERATION_NUMBER)
"""Remarks at statements that give names their values."""


class NameSetter(Struct, frozen=True, kw_only=True):
    """A LET: its name, its line, and the names that its value reads."""

    name: str
    line: int
    reads: tuple[str, ...]


class OverrideNotes(Struct, frozen=True, kw_only=True):
    """Finds the overrides that a diagnostic depends on.

    Attributes:
        sources: The texts.
        overrides: The values.
        applied: By line of each overridden LET its name.
        setters: All LETs in the order in which they are read.
        scopes: Where names are hidden.
    """

    sources: SourceMap
    overrides: Overrides
    applied: Mapping[int, str]
    setters: tuple[NameSetter, ...]
    scopes: tuple[NameScope, ...]

    def add_to(self, diagnostic: Diagnostic) -> Diagnostic:
        """Return the diagnostic with a note for each override that it depends on.

        A note is added where the statement, a call or loop around it, or a LET that sets one of their names reads an
        overridden name. Which LET is in force is decided by the order of the lines.
        """
        lines: dict[int, None] = {}
        for span in (diagnostic.span, *(r.span for r in diagnostic.remarks if r.text in _STEPS)):
            lines.update(dict.fromkeys(self._overridden_lines(span)))
        if not lines:
            return diagnostic
        here = {line: self.sources.locate(line, "") for line in lines}
        notes = tuple(
            Remark(text=OVERRIDDEN, span=here[line], fields={"name": name, "value": self.overrides[name]})
            for line, name in ((line, self.applied[line]) for line in lines)
        )
        spans = list(here.values())
        kept = tuple(r for r in diagnostic.remarks if r.text != SET_HERE or r.span not in spans)
        return replace(diagnostic, remarks=(*kept, *notes))

    def _overridden_lines(self, span: Span) -> Iterator[int]:
        """The lines of the overridden LETs that a span depends on."""
        line = self._global_line(span)
        if not span.end_column:  # It is about the whole file.
            return
        if line in self.applied:  # The text of this LET is not what is run.
            yield line
            names = [name for setter in self.setters if setter.line == line for name in setter.reads]
        else:
            statement = self.sources.statement(line)
            names = [] if statement is None else list(_names_at(statement, span))
        work = [(name, line) for name in names]
        seen = set()
        while work:
            setter = self._setter(*work.pop())
            if setter is None or setter in seen:
                continue
            seen.add(setter)
            if setter.line in self.applied:
                yield setter.line
            work += [(name, setter.line) for name in setter.reads]

    def _global_line(self, span: Span) -> int:
        """The line of a span, counted through all texts."""
        named = zip(self.sources.sources[1:], self.sources.bases[1:], strict=True)
        return span.line + next((base for source, base in named if source.name == span.path), 0)

    def _setter(self, name: str, line: int) -> NameSetter | None:
        """The LET whose value a name has at a line; None where it is a parameter or a loop's variable."""
        around = [scope for scope in self.scopes if scope.first_line < line < scope.last_line]
        if any(name in scope.names for scope in around):
            return None
        routine = next((scope for scope in around if scope.is_routine), None)
        setters = [setter for setter in self.setters if setter.name == name]
        if routine is not None:
            own = [s for s in setters if routine.first_line < s.line < line]
            if own:
                return own[-1]
        routines = [scope for scope in self.scopes if scope.is_routine]
        outer = [s for s in setters if not any(r.first_line < s.line < r.last_line for r in routines)]
        above = [s for s in outer if self.sources.reading_order(s.line) < self.sources.reading_order(line)]
        return next(reversed(above or outer), None)


def _names_at(statement: Statement, span: Span) -> Iterator[str]:
    """The names in the expressions of a statement that a span touches."""
    numbers = [q for _, _, q in statement.numbers() if q.expression is not None]
    places = [(q.column, q.end_column, q.expression) for q in numbers]
    places += [(e.column, e.end_column, e) for e in statement.arguments]
    for column, end_column, expression in places:
        if expression is not None and column < span.end_column and span.column < end_column:
            yield from expression.names
