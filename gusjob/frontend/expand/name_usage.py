"""Which names each block reads and sets, and which loops must therefore run iteration by iteration."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from msgspec import Struct, field

from gusjob.frontend.expand.program import Block, Branch, Frame, IncludedFile, Item, Let, Loop, Routine, StatementRun


class _Usage(Struct):
    """How a block uses names.

    Attributes:
        exposed: Names that it reads before it sets them.
        surely_set: Names that it sets on every path.
        maybe_set: Names that it sets on some path.
        reads: How often it reads each name.
    """

    exposed: set[str] = field(default_factory=set)
    surely_set: set[str] = field(default_factory=set)
    maybe_set: set[str] = field(default_factory=set)
    reads: Counter[str] = field(default_factory=Counter)

    def read(self, names: Iterable[str]) -> None:
        """Add names that are read."""
        for name in names:
            self.reads[name] += 1
            if name not in self.surely_set:
                self.exposed.add(name)

    def then(self, other: _Usage) -> None:
        """Add the usage of what follows."""
        self.exposed |= other.exposed - self.surely_set
        self.surely_set |= other.surely_set
        self.maybe_set |= other.maybe_set
        self.reads += other.reads


class NameUsage(Struct):
    """Finds the loops in which an iteration reads what another one has set; they run iteration by iteration.

    All others run at once, with one value of each name for each iteration.
    """

    routines: dict[str, Routine]
    sequential: set[int] = field(default_factory=set)
    outer_names: dict[str, set[str]] = field(default_factory=dict)
    """Names that each routine, or one that it calls, may read from outside."""
    files: dict[int, _Usage] = field(default_factory=dict)
    """Included blocks by their `id`: a file may be included many times."""
    marked_files: set[int] = field(default_factory=set)
    reads: set[str] = field(default_factory=set)
    """Names that are read anywhere."""

    def sequential_loops(self, block: Block) -> frozenset[int]:
        """`id`s of the loops of a program that run iteration by iteration."""
        for name in self.routines:
            self._outer_names_of(name)
        for scope in (block, *(r.body for r in self.routines.values())):
            reads = self._of_block(scope).reads
            self.reads |= set(reads)
            self._mark(scope, reads)
        return frozenset(self.sequential)

    def _outer_names_of(self, name: str) -> set[str]:
        if name not in self.outer_names:
            self.outer_names[name] = set()
            usage = self._of_block(self.routines[name].body)
            self.outer_names[name] = set(usage.reads) - set(self.routines[name].parameters)
        return self.outer_names[name]

    def _of_block(self, block: Block) -> _Usage:
        total = _Usage()
        for item in block:
            total.then(self._of_item(item))
        return total

    def _of_item(self, item: Item) -> _Usage:
        usage = _Usage()
        match item:
            case StatementRun():
                self._read_by_run(item, usage)
            case Let():
                usage.read(item.expression.names)
                usage.surely_set.add(item.name)
                usage.maybe_set.add(item.name)
            case Loop():
                for bound in item.bounds:
                    usage.read(bound.names)
                inner = self._of_block(item.body)
                inner.exposed.discard(item.variable)
                inner.surely_set.clear()
                usage.then(inner)
            case Branch():
                usage.read(item.condition.names)
                then, otherwise = self._of_block(item.then), self._of_block(item.otherwise)
                both = _Usage(
                    exposed=then.exposed | otherwise.exposed,
                    surely_set=then.surely_set & otherwise.surely_set,
                    maybe_set=then.maybe_set | otherwise.maybe_set,
                    reads=then.reads + otherwise.reads,
                )
                usage.then(both)
            case Frame():
                self._read_by_run(item.head, usage)
                usage.then(self._of_block(item.body))
            case IncludedFile():
                if id(item.body) not in self.files:
                    self.files[id(item.body)] = self._of_block(item.body)
                usage.then(self.files[id(item.body)])
        return usage

    def _read_by_run(self, run: StatementRun, usage: _Usage) -> None:
        for computed in (*run.computed, *run.calls):
            for expression in (*(slot.expression for slot in computed.slots), *computed.statement.arguments):
                usage.read(expression.names)
        for call in run.calls:
            if call.statement.names[0] in self.routines:
                usage.read(self._outer_names_of(call.statement.names[0]))

    def _mark(self, block: Block, scope_reads: Counter[str]) -> None:
        """Find the sequential loops in a block. `scope_reads`: how often names are read in the job or routine."""
        for item in block:
            match item:
                case Loop():
                    usage = self._of_block(item.body)
                    maybe_only = usage.maybe_set - usage.surely_set
                    read_elsewhere = {name for name in maybe_only if scope_reads[name] > usage.reads[name]}
                    if (usage.exposed - {item.variable}) & usage.maybe_set or read_elsewhere:
                        self.sequential.add(id(item))
                    self._mark(item.body, scope_reads)
                case Branch():
                    self._mark(item.then, scope_reads)
                    self._mark(item.otherwise, scope_reads)
                case Frame():
                    self._mark(item.body, scope_reads)
                case IncludedFile():
                    if id(item.body) not in self.marked_files:
                        self.marked_files.add(id(item.body))
                        self._mark(item.body, scope_reads)
                case _:
                    pass
