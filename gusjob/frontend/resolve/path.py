"""The path of a job: all path statements as columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Rule
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp, Statement
from gusjob.frontend.resolve.columns import PATH_OP, ResolvedColumns
from gusjob.frontend.resolve.positions import positions
from gusjob.frontend.resolve.speeds import velocity_and_acceleration
from gusjob.frontend.resolve.unknown import States, unknown_states
from gusjob.ir.arcs import DrawnArcs, arc_faults
from gusjob.ir.effects import POSITION
from gusjob.ir.path import Path, with_chords
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends, first_beyond
from gusjob.kinematics.float_noise import settled

_TURNS = 1e-12
"""Least part of a frame's rotation: turns that cancel each other leave float noise."""

if TYPE_CHECKING:  # Start-up time: most jobs have no FRAME.
    from gusjob.frontend.resolve.frames import Frames


class BadArc(Struct, frozen=True):
    """An arc in a rotated frame that is none: its row, the rule that it breaks, the word, and the rule's fields."""

    row: int
    rule: Rule
    word: str
    fields: dict[str, Any]


class ResolvedPath(Struct, frozen=True, eq=False):
    """The path, and how it follows from the rows.

    Attributes:
        path: The path.
        in_path: Rows of the job that are statements of the path, (n,).
        first_row: Where arcs became lines: the path's row at which each of its statements begins.
        bad_arcs: Arcs that are none, of those that became lines.
        unknown_before: State before each row of the job, bits of ir.effects, (n,).
        unknown: The state after each row.
    """

    path: Path
    in_path: Bools
    first_row: Indices | None
    bad_arcs: tuple[BadArc, ...]
    unknown_before: States
    unknown: States

    def path_row(self, rows: Indices) -> Indices:
        """How many rows of the path there are up to rows of the job."""
        count = np.cumsum(self.in_path, dtype=np.int32)[rows].astype(np.intp)
        return count if self.first_row is None else self.first_row[count]


def resolve_path(columns: ResolvedColumns, frames: Frames | None, setups: tuple[Statement, ...]) -> ResolvedPath:
    """Resolve all path statements.

    Args:
        columns: The rows.
        frames: None if the job has none.
        setups: The statements that SETUP rows point to.
    """
    keep = columns.in_path
    x, y = positions(columns, frames)
    unknown = _without_unit(columns, unknown_states(columns, setups, x, y))
    path = _path(columns, frames, x, y, unknown)
    if frames is None or columns.machine.equal_axes:
        return ResolvedPath(path, keep, None, (), unknown[0], unknown[1])
    path, first_row, bad_arcs = _with_chords(columns, path, frames)
    return ResolvedPath(path, keep, first_row, bad_arcs, unknown[0], unknown[1])


def _without_unit(columns: ResolvedColumns, unknown: tuple[States, States]) -> tuple[States, States]:
    """The states with the start of arcs in two units as unknown: so only the units are reported."""
    if columns.machine.equal_axes or not columns.is_arc.any():
        return unknown
    in_mm, in_pulse = columns.arc_units()
    before = np.where(columns.is_arc & in_mm & in_pulse, unknown[0] | int(POSITION), unknown[0])
    return before.astype(unknown[0].dtype), unknown[1]


def _path(
    columns: ResolvedColumns, frames: Frames | None, x: Floats, y: Floats, unknown: tuple[States, States]
) -> Path:
    """The path with every arc as it is. x, y: position after each row; `unknown`: states before and after it."""
    op = columns.op
    keep, count = _kept(columns.in_path)

    def cut(column: npt.NDArray[Any]) -> npt.NDArray[Any]:
        # A column with one value for all rows has stride 0 and takes no memory; it stays so.
        if len(column) and column.strides == (0,):
            return np.broadcast_to(column[0], count)
        return column[keep]

    def at_rows(rows: Indices, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        # A column that few rows use is 0 elsewhere: the system gives it memory only where it is written.
        column = np.zeros(count, dtype=values.dtype)
        column[rows - keep.start if isinstance(keep, slice) else (np.cumsum(keep) - 1)[rows]] = values
        return column if len(rows) else np.broadcast_to(np.asarray(np.nan, values.dtype), count)

    nothing = np.broadcast_to(np.nan, len(op))
    never = np.broadcast_to(np.False_, len(op))
    has_arcs = bool(columns.is_arc.any())
    unequal = not columns.machine.equal_axes
    cx, cy, radius = _centres(columns, frames, x, y) if has_arcs else (nothing, nothing, nothing)
    velocity, acceleration = velocity_and_acceleration(columns)
    end, end_in_mm = columns.rate(Column.END, acceleration=False)
    dwells, powers = np.flatnonzero(op == RowOp.DWELL), np.flatnonzero((op == RowOp.POWER) | (op == RowOp.FOLLOW))
    power = np.where(op[powers] == RowOp.POWER, columns.raw_at(Column.VALUE, powers), np.nan)
    # LASER POWER has no limits and no ratio: without a FOLLOW there are none.
    follows = powers if (op[powers] == RowOp.FOLLOW).any() else powers[:0]
    ratio, follow_in_mm = columns.follow_ratio(follows)
    is_ccw = (op == RowOp.ARC_CENTRE_CCW) | (op == RowOp.ARC_RADIUS_CCW) if has_arcs else never
    return Path(
        op=cut(PATH_OP[op]),
        line=cut(columns.rows.line),
        channel=cut(_existing_channel(columns)),
        ccw=cut(is_ccw),
        arc_in_mm=cut(columns.arc_units()[0] if unequal else never),
        x=cut(x),
        y=cut(y),
        cx=cut(cx),
        cy=cut(cy),
        radius=cut(radius),
        vel=cut(velocity.value),
        acc=cut(acceleration.value),
        end=cut(end),
        vel_line=cut(velocity.line),
        acc_line=cut(acceleration.line),
        vel_in_mm=cut(velocity.in_mm if unequal else never),
        acc_in_mm=cut(acceleration.in_mm if unequal else never),
        end_in_mm=cut(end_in_mm if unequal else never),
        dwell_ms=at_rows(dwells, columns.raw_at(Column.VALUE, dwells)),
        power=at_rows(powers, power),
        low=at_rows(follows, columns.raw_at(Column.LOW, follows)),
        high=at_rows(follows, columns.raw_at(Column.HIGH, follows)),
        ratio=at_rows(follows, ratio),
        follow_in_mm=at_rows(follows, follow_in_mm) if unequal else cut(never),
        power_unit=cut(columns.power_unit(Column.VALUE)),
        low_unit=cut(columns.power_unit(Column.LOW)),
        high_unit=cut(columns.power_unit(Column.HIGH)),
        provenance=cut(columns.provenance()),
        unknown_before=cut(unknown[0]),
        unknown=cut(unknown[1]),
    )


def _kept(in_path: Bools) -> tuple[Bools | slice, int]:
    """The rows of the path, as a slice if they follow each other, and how many they are."""
    count = int(np.count_nonzero(in_path))
    first = int(in_path.argmax()) if count else 0
    whole = slice(first, first + count)
    return (whole if in_path[whole].all() else in_path), count


def _existing_channel(columns: ResolvedColumns) -> npt.NDArray[np.int8]:
    """Channel of each row: one out of range is reported; here it is one that exists."""
    channel = columns.channel()
    if len(channel) and channel.strides == (0,):
        return np.broadcast_to(np.int8(min(max(channel[0], 0), 1)), len(channel))
    return np.asarray(np.clip(np.nan_to_num(channel), 0, 1), dtype=np.int8)


def _centres(columns: ResolvedColumns, frames: Frames | None, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Centre and radius of arcs, pulse. x, y: position after each row."""
    i, j, radius = columns.length(Column.I, 0), columns.length(Column.J, 1), settled(columns.length(Column.R, 0))
    i, j = np.where(np.isnan(i), 0.0, i), np.where(np.isnan(j), 0.0, j)
    if frames is not None:
        frame = columns.frame()
        i, j = frames.vectors_to_machine(frame, i, j)
        radius = settled(radius * frames.scale[frame])
    return np.concatenate([[0.0], x[:-1]]) + i, np.concatenate([[0.0], y[:-1]]) + j, radius


def _with_chords(
    columns: ResolvedColumns, path: Path, frames: Frames
) -> tuple[Path, Indices | None, tuple[BadArc, ...]]:
    """The path with arcs that a frame bends as chords.

    Where the axes differ, arcs in pulses in a rotated frame are ellipses. In the frame's own pulses they are circles;
    only the frame's rotation and scale matter here, not its shift.
    """
    machine, frame = columns.machine, columns.frame()
    turns = np.abs(frames.b) + np.abs(frames.c) > _TURNS * (np.abs(frames.a) + np.abs(frames.d))
    rotated = turns[frame]
    rows = np.flatnonzero(columns.is_arc & rotated & columns.arc_units()[1])
    if not len(rows):
        return path, None, ()
    at, own = (np.cumsum(columns.in_path) - 1)[rows], frame[rows]
    from gusjob.frontend.resolve.frames import bent_arcs

    drawn = bent_arcs(path, at, frames, own, machine.pulses_per_mm)
    angles = chord_angles(drawn.arcs.radius * drawn.mm, machine.chord_tolerance_um / 1000)
    counts = chord_counts(drawn.arcs.sweep, angles)
    over = first_beyond(counts, machine.most_chords)
    if over is not None:
        fields = {"chords": int(counts[: over + 1].sum()), "limit": machine.most_chords}
        return path, None, (BadArc(int(rows[over]), rules.TOO_MANY_CHORDS, "", fields),)
    x, y = chord_ends(drawn.arcs, counts)
    longer, origin = with_chords(path, at, counts, *frames.vectors_to_machine(np.repeat(own, counts), x, y))
    return longer, np.searchsorted(origin, np.arange(len(path) + 1), side="left"), _bad_arcs(columns, rows, drawn)


def _bad_arcs(columns: ResolvedColumns, rows: Indices, drawn: DrawnArcs) -> tuple[BadArc, ...]:
    """Find what is wrong with the arcs at some rows, once a line."""
    found = []
    for rule, bad, word, fields in arc_faults(drawn):
        at = np.flatnonzero(bad)
        _, first = np.unique(columns.rows.line[rows[at]], return_index=True)
        for i in at[first].tolist():
            own = {name: float(v[i]) if isinstance(v, np.ndarray) else v for name, v in fields.items()}
            found.append(BadArc(int(rows[i]), rule, word, own))
    return tuple(found)
