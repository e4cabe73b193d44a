"""Rows that sky writing adds to a path, and the path with all rows in order.

Every row has a key by which the rows are sorted: row r of the path has key r, an added row the key of its mark's row
plus an offset. All offsets lie between -0.5 and 0.5, so an added row stays between the neighbours of its mark.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field

from gusjob.ir.intent import RunKind
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.planner.plan import MarkEvents, QuantizedPath, SkyRows, StagedPath, rearranged
from gusjob.planner.skywriting.marks import Marks
from gusjob.planner.skywriting.simple_marks import SwitchLeg

SWITCH_ON = -0.45
REVERSE, REVERSE_FAR = -0.40, -0.35
JUMP_TO_RUN_IN = -0.30
RUN_IN_FAR, RUN_IN = -0.25, -0.20
PLACED_SWITCH = {SwitchLeg.START: -0.16, SwitchLeg.MARK: -0.10, SwitchLeg.END: 0.06, SwitchLeg.RUN_OUT: 0.12}
"""Laser-on of a simple mark."""
PLACED_OFF_BEHIND = 0.03
"""Laser-off of a simple mark, behind its laser-on on the same leg."""
PIECE_BEFORE = 0.01
"""A piece of a motion, in front of the switch at its end."""
RUN_OUT, RUN_OUT_FAR = 0.20, 0.25
BACK_FAR, BACK = 0.30, 0.35
JUMP_BACK = 0.40
SWITCH_OFF = 0.45


class AddedRows(Struct, kw_only=True):
    """Collects rows that are added to a path, and changes of its own rows.

    Added rows are numbered after the n rows of the path, in the order in which they are added.
    """

    quantized: QuantizedPath
    marks: Marks
    keys: list[Floats] = field(default_factory=list)
    sources: list[Indices] = field(default_factory=list)
    changes: list[dict[str, Any]] = field(default_factory=list)
    new_ends: list[tuple[Indices, Floats, Floats]] = field(default_factory=list)
    """Rows of the path that end somewhere else: jumps to a run-in."""
    new_keys: list[tuple[Indices, Floats]] = field(default_factory=list)
    """Rows of the path that are at another position in the order."""
    events: list[MarkEvents] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of rows so far."""
        return len(self.quantized.path) + sum(map(len, self.sources))

    def add(self, rows: Indices, offset: float | Floats, **changes: Any) -> None:
        """Add rows like some rows of the path, with some columns changed, at an offset from them."""
        if not len(rows):
            return
        self.keys.append(np.asarray(rows + offset, dtype=np.float64))
        self.sources.append(rows)
        self.changes.append(changes)

    def build(self) -> tuple[StagedPath, SkyRows]:
        """Make the path with all rows in order."""
        path, n = self.quantized.path, len(self.quantized.path)
        source = np.concatenate([np.arange(n), *self.sources])
        key = np.arange(n, dtype=np.float64)
        for rows, new in self.new_keys:
            key[rows] = new
        order = np.argsort(np.concatenate([key, *self.keys]), kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        own = self._own_columns()
        columns = {
            name: self._column(name, own[name] if name in own else getattr(path, name))[order]
            for name in {*own, *(name for change in self.changes for name in change)}
            if name in own or not self._is_constant(name)
        }
        run, smooth = columns.pop("run"), columns.pop("smooth")
        return rearranged(self.quantized, source[order], columns), self._sky_rows(run, smooth, rank)

    def _own_columns(self) -> dict[str, npt.NDArray[Any]]:
        """Columns of the path's own rows that sky writing changes."""
        path, timed, marks = self.quantized.path, self.quantized.timed, self.marks
        x, y = path.x.copy(), path.y.copy()
        for rows, new_x, new_y in self.new_ends:
            x[rows], y[rows] = new_x, new_y
        mark = timed[marks.is_mark]
        smooth = np.zeros(len(path), dtype=np.bool_)
        smooth[timed[marks.ends]] = True
        smooth[timed[:-1][marks.is_chord[1:]]] = True
        # A part of a mark in which the laser is off lies before laser-on.
        run = np.full(len(path), RunKind.NONE, dtype=np.int8)
        run[mark] = RunKind.RUN_IN
        own: dict[str, npt.NDArray[Any]] = {"x": x, "y": y, "run": run, "smooth": smooth}
        if not marks.as_written:
            own["vel"], own["vel_in_mm"] = path.vel.copy(), path.vel_in_mm.copy()
            own["vel"][mark], own["vel_in_mm"][mark] = marks.vel[marks.is_mark], False
        return own

    def _is_constant(self, name: str) -> bool:
        """Whether a column has one value in all rows, the added ones included."""
        own = getattr(self.quantized.path, name)
        changed = [change[name] for change in self.changes if name in change]
        return own.strides == (0,) and all(np.array_equal(np.unique(c), own[:1], equal_nan=True) for c in changed)

    def _column(self, name: str, own: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A column of the path's own rows, then of the added ones: changed, or as in their source."""
        parts = [own]
        for change, rows in zip(self.changes, self.sources, strict=True):
            value = change.get(name, 0 if name in ("run", "smooth") else own[rows])
            parts.append(np.broadcast_to(np.asarray(value, dtype=own.dtype), len(rows)))
        return np.concatenate(parts)

    def _sky_rows(self, run: npt.NDArray[np.int8], smooth: Bools, rank: Indices) -> SkyRows:
        """Facts for later passes, by the rows' new numbers `rank`."""
        return SkyRows(
            run=run,
            smooth=smooth,
            events=MarkEvents(
                row=rank[np.concatenate([part.row for part in self.events])],
                mark_row=rank[np.concatenate([part.mark_row for part in self.events])],
                at_end=np.concatenate([part.at_end for part in self.events]),
                effect_us=np.concatenate([part.effect_us for part in self.events]),
                placed=np.concatenate([part.placed for part in self.events]),
            ),
        )
