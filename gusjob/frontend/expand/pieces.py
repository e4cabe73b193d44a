"""Statements that were carried out, as rows: of many lanes at once, or noted lane by lane and made together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.frontend.expand.program import Run
from gusjob.frontend.parse.forms import Field
from gusjob.frontend.parse.job_reader import RowOp
from gusjob.frontend.parse.statements import Statement
from gusjob.frontend.scan.shapes import Rows, join
from gusjob.kinematics.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class Piece:
    """Rows of some lanes."""

    rows: Rows
    lane: Ints


@dataclass(frozen=True, slots=True)
class Noted:
    """A run that one lane has carried out, not yet made into rows."""

    run: Run
    systems: tuple[int, ...]
    numbers: tuple[Any, ...]
    trail: Any
    frame: Any


Sink = list[Piece | Noted]


@dataclass(slots=True)
class Writer:
    """Makes rows. `setups`: statements that SETUP rows point to; those with expressions are added as they come."""

    setups: list[Statement]

    def spread(
        self,
        run: Run,
        systems: tuple[int, ...],
        numbers: Sequence[Any],
        count: int,
        trail: Any,
        frame: Any,
        *,
        keep_place: bool = False,
    ) -> Piece:
        """The rows of a run in `count` lanes. `keep_place`: the lane tells the row's place in the run, too."""
        base, rows = run.rows, len(run.rows.op)

        def tiled(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return values if count == 1 else np.tile(values, count)

        op, line, system = tiled(base.op), tiled(base.line), tiled(base.system)
        columns = {k: tiled(v) for k, v in base.columns.items()}
        dropped: list[Ints] = []
        slots = zip(numbers, systems, strict=True)
        for one in run.computed:
            at = (np.arange(count)[:, None] * rows + one.at).ravel()
            found = {}
            for slot in one.slots:
                value, written = next(slots)
                if isinstance(value, np.ndarray) and value.ndim == 1 and len(one.at) == 1:
                    value = value[:, None]
                full = np.broadcast_to(value, (count, len(one.at))).ravel() + 0.0
                found[slot.word] = (full, written)
                dropped.append(at[np.isnan(full)])
                if base.op[one.at[0]] != RowOp.SETUP or slot.word == "CHANNEL":
                    columns[slot.column] = _with(columns.get(slot.column), len(op), at, full)
                    system = system if not written else _added(system, at, written << (2 * slot.column))
            if base.op[one.at[0]] == RowOp.SETUP:
                columns[Field.VALUE] = _with(columns[Field.VALUE], len(op), at, self.filled_in(one.statement, found))
        for column, numbers_ in ((Field.TRAIL, trail), (Field.FRAME, frame)):
            if isinstance(numbers_, np.ndarray):
                columns[column] = np.repeat(numbers_, rows).astype(np.float64)
            elif numbers_:
                columns[column] = np.broadcast_to(np.float64(numbers_), len(op))
        lane = np.arange(len(op)) if keep_place else np.repeat(np.arange(count), rows)
        made = Rows(op=op, line=line, system=system, columns=columns)
        gone = np.concatenate(dropped) if dropped else np.empty(0, dtype=np.int64)
        if not len(gone):
            return Piece(made, lane)
        kept = np.ones(len(op), dtype=np.bool_)
        kept[gone] = False
        return Piece(made.pick(kept), lane[kept])

    def filled_in(self, statement: Statement, found: dict[str, tuple[Floats, int]]) -> Floats:
        """A setup statement with each set of numbers that its expressions came to; the numbers of the new ones."""
        first = len(self.setups)
        count = len(next(iter(found.values()))[0])
        for i in range(count):
            self.setups.append(_filled_in(statement, {word: (float(v[i]), s) for word, (v, s) in found.items()}))
        return first + np.arange(count, dtype=np.float64)

    def collected(self, sink: Sink, count: int) -> Piece:
        """All that lanes have carried out, ordered by lane, in each lane in its order."""
        if count > 1:
            return merged([piece for piece in sink if isinstance(piece, Piece)])
        pieces: list[Piece] = []
        notes: list[Noted] = []
        for entry in sink:
            if isinstance(entry, Noted):
                notes.append(entry)
            else:
                pieces += [*self.written_out(notes), entry]
                notes = []
        pieces += self.written_out(notes)
        joined = join([piece.rows for piece in pieces])
        return Piece(joined, np.zeros(len(joined.op), dtype=np.int64))

    def written_out(self, notes: list[Noted]) -> list[Piece]:
        """The rows of runs that were carried out one by one."""
        if not notes:
            return []
        groups: dict[tuple[int, tuple[int, ...]], list[int]] = {}
        for place, note in enumerate(notes):
            groups.setdefault((id(note.run), note.systems), []).append(place)
        pieces = []
        for places in groups.values():
            which = [notes[i] for i in places]
            count = len(which)
            first = which[0]
            numbers: list[Any] = list(first.numbers)
            trail, frame = first.trail, first.frame
            if count > 1:
                numbers = [
                    np.array([note.numbers[k] for note in which]).reshape(count, -1) for k in range(len(numbers))
                ]
                trail = np.array([note.trail for note in which])
                frame = np.array([note.frame for note in which])
            piece = self.spread(first.run, first.systems, numbers, count, trail, frame)
            pieces.append(Piece(piece.rows, np.array(places)[piece.lane]))
        return [merged(pieces)]


def merged(pieces: list[Piece]) -> Piece:
    """Pieces in the order of their lanes; in one lane, in the order of the pieces."""
    if len(pieces) == 1:
        return pieces[0]
    rows = join([piece.rows for piece in pieces])
    lane = np.concatenate([piece.lane for piece in pieces]) if pieces else np.empty(0, dtype=np.int64)
    order = np.argsort(lane, kind="stable")
    return Piece(rows.pick(order), lane[order])


def _with(column: Floats | None, rows: int, at: Ints, values: Floats) -> Floats:
    """A column with other values in some rows; the column itself is shared and stays as it is."""
    fresh = np.full(rows, np.nan) if column is None else column.copy()
    fresh[at] = values
    return fresh


def _added(system: npt.NDArray[np.int32], at: Ints, bits: int) -> npt.NDArray[np.int32]:
    fresh = system.copy()
    fresh[at] |= bits
    return fresh


def _filled_in(statement: Statement, values: dict[str, tuple[float, int]]) -> Statement:
    """A setup statement with the numbers (and their systems) that its expressions came to."""

    def fill(quantity: Any, word: str) -> Any:
        if word not in values:
            return quantity
        value, system = values[word]
        return replace(quantity, value=value, system=system, expression=None)

    return replace(
        statement,
        words={name: fill(q, name or "value") for name, q in statement.words.items()},
        axes={
            head: {axis: fill(q, f"{head} {axis}") for axis, q in places.items()}
            for head, places in statement.axes.items()
        },
        channel=fill(statement.channel, "CHANNEL"),
    )
