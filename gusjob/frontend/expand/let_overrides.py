"""Put overrides in the place of a job's LETs while its program is built, and find the names that can't be set."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from msgspec import Struct, field

from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic, Rule
from gusjob.frontend.overrides import override_statement
from gusjob.frontend.parse.statement import Statement
from gusjob.frontend.source_map import SourceMap
from gusjob.i18n.phrases import Phrase, all_of, did_you_mean
from gusjob.i18n.spelling import nearest
from gusjob.ir.overrides import NO_OVERRIDES, Overrides

_LISTED = 12
"""So many names that can be set are listed."""


class NameScope(Struct, frozen=True, kw_only=True):
    """Lines in which names hide others: a routine with its parameters, or a loop with its variable."""

    first_line: int
    last_line: int
    names: tuple[str, ...]
    is_routine: bool


class LetOverrides(Struct):
    """The overrides of a job, and which of its LETs they take the place of."""

    values: Overrides = field(default_factory=lambda: NO_OVERRIDES)
    applied: dict[int, str] = field(default_factory=dict)
    """By line of the LET: its name."""
    settable: dict[str, None] = field(default_factory=dict)
    """The names that can be set, in their order."""
    elsewhere: dict[str, tuple[Rule, int]] = field(default_factory=dict)
    """For names that are set only where they can't be overridden: the rule that says so, and the first line."""
    scopes: list[NameScope] = field(default_factory=list)

    def at_let(self, statement: Statement, line: int, *, is_own: bool, is_local: bool) -> Statement:
        """Return the statement of a LET, or of the override that takes its place.

        Args:
            statement: The LET.
            line: Its line.
            is_own: Whether it is in the job's own file.
            is_local: Whether it is inside a routine.
        """
        name = statement.names[0]
        if not self.values:
            return statement
        if not is_own or is_local:
            rule = rules.OVERRIDE_IN_ROUTINE if is_local else rules.OVERRIDE_IN_INCLUDE
            self.elsewhere.setdefault(name, (rule, line))
            return statement
        is_first = name not in self.settable
        self.settable[name] = None
        if not is_first or name not in self.values:
            return statement
        self.applied[line] = name
        return override_statement(name, self.values[name])

    def add_scope(self, statement: Statement, first_line: int, last_line: int) -> None:
        """Note the parameters of a routine, or the variable of a loop, at the end of the block."""
        is_routine = statement.form == "def"
        names = statement.names[1:] if is_routine else statement.names
        if not self.values or not (names or is_routine):
            return
        scope = NameScope(first_line=first_line, last_line=last_line, names=names, is_routine=is_routine)
        self.scopes.append(scope)
        rule = rules.OVERRIDE_OF_PARAMETER if is_routine else rules.OVERRIDE_OF_LOOP
        for name in names:
            self.elsewhere.setdefault(name, (rule, first_line))

    def diagnostics(self, sources: SourceMap, unread_names: Collection[str]) -> list[Diagnostic]:
        """Report the overrides that took no place. `unread_names`: of LETs that can't be parsed, which is reported."""
        found = []
        for name in self.values:
            if name in self.settable or name in unread_names:
                continue
            if name in self.elsewhere:
                rule, line = self.elsewhere[name]
                span = sources.locate(line, "")
                found.append(Diagnostic(rule=rule, span=span, fields={"name": name}))
            else:
                found.append(unknown_name(name, self.settable))
        return found


def unknown_name(name: str, settable: Iterable[str]) -> Diagnostic:
    """Report an override of a name that no LET of a job sets. `settable`: the names that can be set."""
    names = [*settable]
    listed = all_of(names[:_LISTED])
    more = len(names) - _LISTED
    if more > 0:
        listed = Phrase("{names} and {count} more", names=listed, count=more)
    settable_names = Phrase("; it sets {names}", names=listed) if names else Phrase("; it has no LET")
    fields = {"name": name, "hint": did_you_mean(nearest(name, names)), "names": settable_names}
    return Diagnostic(rule=rules.OVERRIDE_UNKNOWN, span=d.NOWHERE, fields=fields)
