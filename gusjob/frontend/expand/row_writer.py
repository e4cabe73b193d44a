"""Expanded statements as rows: of many lanes at once, or of one lane run by run and made into rows together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.frontend.expand.program import ComputedStatements, StatementRun
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.intent import effects_of
from gusjob.frontend.parse.statement import RowOp, Statement
from gusjob.frontend.scan.rows import Rows, groups_of, join_rows
from gusjob.kinematics.arrays import Floats, Ints, distinct


class LaneRows(Struct, frozen=True, eq=False):
    """Rows, each with its lane, (n,)."""

    rows: Rows
    lane: Ints


class ExpandedRun(Struct, frozen=True):
    """A run of statements with its numbers, expanded in one lane or in several.

    Attributes:
        run: The statements.
        numbers: For each slot of its computed statements the number, one for all lanes or one for each.
        systems: For each slot the unit system of its number.
        provenance: One for all lanes or one for each.
        frame: One for all lanes or one for each.
    """

    run: StatementRun
    numbers: Sequence[Any]
    systems: tuple[int, ...]
    provenance: Any
    frame: Any


Output = list[LaneRows | ExpandedRun]
"""Output of a block so far. An ExpandedRun in it is that of one lane."""


class RowWriter(Struct):
    """Makes rows. `setups`: statements that SETUP rows point to; those with expressions are added when they run."""

    setups: list[Statement]

    def rows_of(self, expanded: ExpandedRun, count: int, *, lane_is_place: bool = False) -> LaneRows:
        """The rows of a run in `count` lanes.

        Args:
            expanded: The run.
            count: Number of lanes.
            lane_is_place: Number the rows as lane * rows of the run + row, instead of by lane.
        """
        base, rows = expanded.run.rows, len(expanded.run.rows.op)

        def tiled(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return values if count == 1 else np.tile(values, count)

        made = Rows(
            op=tiled(base.op),
            line=tiled(base.line),
            system=tiled(base.system),
            columns={column: tiled(values) for column, values in base.columns.items()},
        )
        made, without_value = self._with_numbers(made, expanded, count)
        for column, numbers in ((Column.PROVENANCE, expanded.provenance), (Column.FRAME, expanded.frame)):
            if isinstance(numbers, np.ndarray):
                made.columns[column] = np.repeat(numbers, rows).astype(np.float64)
            elif numbers:
                made.columns[column] = np.broadcast_to(np.float64(numbers), len(made.op))
        lane = np.arange(len(made.op)) if lane_is_place else np.repeat(np.arange(count), rows)
        if not len(without_value):
            return LaneRows(made, lane)
        return LaneRows(self._without_values(made, distinct(without_value)), lane)

    def _without_values(self, rows: Rows, at: Ints) -> Rows:
        """The rows, those that lack a number as rows that can't be read."""
        op, columns = rows.op.copy(), {column: values.copy() for column, values in rows.columns.items()}
        value = columns.setdefault(Column.VALUE, np.full(len(op), np.nan))
        effects = np.zeros(len(at))
        for kind, where in groups_of(op[at]):
            if kind == RowOp.SETUP:
                statements = [self.setups[int(number)] for number in value[at[where]]]
                effects[where] = [float(effects_of(RowOp.SETUP, statement)) for statement in statements]
            else:
                effects[where] = float(effects_of(RowOp(kind), None))
        for column, values in columns.items():
            if column < Column.NODE and column != Column.CHANNEL:
                values[at] = np.nan
        op[at], value[at] = RowOp.UNREAD, effects
        return Rows(op=op, line=rows.line, system=rows.system, columns=columns)

    def _with_numbers(self, rows: Rows, expanded: ExpandedRun, count: int) -> tuple[Rows, Ints]:
        """The rows with the numbers that expressions gave, and which rows lack one."""
        columns, system = rows.columns, rows.system
        size = len(expanded.run.rows.op)
        without_value: list[Ints] = []
        slots = zip(expanded.numbers, expanded.systems, strict=True)
        for computed in expanded.run.computed:
            at = (np.arange(count)[:, None] * size + computed.at).ravel()
            is_setup = rows.op[computed.at[0]] == RowOp.SETUP
            found = {}
            for slot in computed.slots:
                value, written = next(slots)
                full = _by_row(value, computed, count)
                found[slot.word] = (full, written)
                without_value.append(at[np.isnan(full)])
                if not is_setup or slot.word == "CHANNEL":
                    columns[slot.column] = _with_values(columns.get(slot.column), len(rows.op), at, full)
                    system = system if not written else _with_bits(system, at, written << (2 * slot.column))
            if is_setup:
                indices = self._add_setups(computed.statement, found)
                columns[Column.VALUE] = _with_values(columns[Column.VALUE], len(rows.op), at, indices)
        found_rows = Rows(op=rows.op, line=rows.line, system=system, columns=columns)
        return found_rows, np.concatenate(without_value) if without_value else np.empty(0, dtype=np.int64)

    def _add_setups(self, statement: Statement, numbers: dict[str, tuple[Floats, int]]) -> Floats:
        """Add a setup statement once for each set of its numbers; returns the indices of the new ones."""
        first = len(self.setups)
        count = len(next(iter(numbers.values()))[0])
        for i in range(count):
            own = {word: (float(values[i]), system) for word, (values, system) in numbers.items()}
            self.setups.append(_with_computed_numbers(statement, own))
        return first + np.arange(count, dtype=np.float64)

    def collect(self, output: Output, count: int) -> LaneRows:
        """All that a block has made in `count` lanes, ordered by lane."""
        if count > 1:
            return merge_lanes([entry for entry in output if isinstance(entry, LaneRows)])
        parts: list[LaneRows] = []
        pending: list[ExpandedRun] = []
        for entry in output:
            if isinstance(entry, ExpandedRun):
                pending.append(entry)
            else:
                parts += [*self._rows_of_all(pending), entry]
                pending = []
        parts += self._rows_of_all(pending)
        joined = join_rows([part.rows for part in parts])
        return LaneRows(joined, np.zeros(len(joined.op), dtype=np.int64))

    def _rows_of_all(self, pending: list[ExpandedRun]) -> list[LaneRows]:
        """The rows of runs of one lane: those of the same run are made together."""
        if not pending:
            return []
        groups: dict[tuple[int, tuple[int, ...]], list[int]] = {}
        for position, expanded in enumerate(pending):
            groups.setdefault((id(expanded.run), expanded.systems), []).append(position)
        parts = []
        for positions in groups.values():
            count = len(positions)
            together = pending[positions[0]]
            if count > 1:
                members = [pending[i] for i in positions]
                together = replace(
                    together,
                    numbers=[
                        np.array([one.numbers[k] for one in members]).reshape(count, -1)
                        for k in range(len(together.numbers))
                    ],
                    provenance=np.array([one.provenance for one in members]),
                    frame=np.array([one.frame for one in members]),
                )
            made = self.rows_of(together, count)
            parts.append(LaneRows(made.rows, np.array(positions)[made.lane]))
        return [merge_lanes(parts)]


def merge_lanes(parts: list[LaneRows]) -> LaneRows:
    """Rows in the order of their lanes; within a lane, in the order of the parts."""
    if len(parts) == 1:
        return parts[0]
    rows = join_rows([part.rows for part in parts])
    lane = np.concatenate([part.lane for part in parts]) if parts else np.empty(0, dtype=np.int64)
    order = np.argsort(lane, kind="stable")
    return LaneRows(rows.pick(order), lane[order])


def _by_row(value: Any, computed: ComputedStatements, count: int) -> Floats:
    """The numbers of a slot, one for each lane and row."""
    if isinstance(value, np.ndarray) and value.ndim == 1 and len(computed.at) == 1:
        value = value[:, None]
    return np.asarray(np.broadcast_to(value, (count, len(computed.at))).ravel() + 0.0)


def _with_values(column: Floats | None, rows: int, at: Ints, values: Floats) -> Floats:
    """A copy of a column with other values in some rows: the column itself is shared."""
    fresh = np.full(rows, np.nan) if column is None else column.copy()
    fresh[at] = values
    return fresh


def _with_bits(system: npt.NDArray[np.int32], at: Ints, bits: int) -> npt.NDArray[np.int32]:
    fresh = system.copy()
    fresh[at] |= bits
    return fresh


def _with_computed_numbers(statement: Statement, numbers: dict[str, tuple[float, int]]) -> Statement:
    """A setup statement with the numbers (and their systems) that its expressions gave."""

    def fill(quantity: Any, word: str) -> Any:
        if word not in numbers:
            return quantity
        value, system = numbers[word]
        return replace(quantity, value=value, system=system, expression=None)

    return replace(
        statement,
        words={name: fill(quantity, name or "value") for name, quantity in statement.words.items()},
        axes={
            head: {axis: fill(quantity, f"{head} {axis}") for axis, quantity in by_axis.items()}
            for head, by_axis in statement.axes.items()
        },
        channel=fill(statement.channel, "CHANNEL"),
    )
