"""The numbers of the rows in canonical units, and the modal settings in force at each row."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp
from gusjob.frontend.scan.rows import Rows
from gusjob.ir.path import Op
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints, fill_gaps
from gusjob.kinematics.float_noise import settled
from gusjob.kinematics.units import UnitSystem, acceleration_pulse_per_ms2, velocity_pulse_per_ms

NOT_IN_PATH = 255
_PATH_OPS = {
    RowOp.LINE: Op.LINE,
    RowOp.JUMP: Op.JUMP,
    RowOp.ARC_CENTRE_CW: Op.ARC_CENTRE,
    RowOp.ARC_CENTRE_CCW: Op.ARC_CENTRE,
    RowOp.ARC_RADIUS_CW: Op.ARC_RADIUS,
    RowOp.ARC_RADIUS_CCW: Op.ARC_RADIUS,
    RowOp.DWELL: Op.DWELL,
    RowOp.POWER: Op.POWER,
    RowOp.FOLLOW: Op.FOLLOW,
    RowOp.ON: Op.ON,
    RowOp.OFF: Op.OFF,
}
PATH_OP = np.array([_PATH_OPS.get(op, NOT_IN_PATH) for op in RowOp], dtype=np.uint8)
"""Op of the path for each RowOp; NOT_IN_PATH for setup and modal statements."""


_SETTLED = (
    Column.R,
    Column.VEL,
    Column.ACC,
    Column.END,
    Column.VALUE,
    Column.LOW,
    Column.HIGH,
    Column.RATIO,
    Column.AT,
    Column.CHANNEL,
)
"""Columns whose numbers are sent as they are. Positions are rounded to pulses."""


def settled_rows(rows: Rows) -> Rows:
    """Rows without float noise in their numbers."""
    columns = {column: settled(v) if column in _SETTLED else v for column, v in rows.columns.items()}
    few = {c: replace(v, values=settled(v.values)) if c in _SETTLED else v for c, v in rows.few.items()}
    return replace(rows, columns=columns, few=few)


def last_set(is_set: Bools) -> Ints:
    """For each row the last row up to it at which `is_set`; -1 where there is none."""
    at = np.where(is_set, np.arange(len(is_set)), -1)
    return np.maximum.accumulate(at) if len(at) else at


def filled(values: Floats, start: float) -> Floats:
    """Carry values forward over NaN; `start` before the first."""
    gaps = np.flatnonzero(np.isnan(values))
    if not len(gaps):
        return values
    found = values.copy()
    fill_gaps(found, gaps, start)
    return found


class ResolvedColumns(Struct, frozen=True):
    """Columns of the rows of a job in canonical units, all (n,)."""

    rows: Rows
    machine: Machine

    @property
    def op(self) -> npt.NDArray[np.uint8]:
        """RowOp of each row."""
        return self.rows.op

    @property
    def in_path(self) -> Bools:
        """Rows that become rows of the path."""
        return np.asarray(PATH_OP[self.op] != NOT_IN_PATH)

    @property
    def moves(self) -> Bools:
        """Rows that are a motion."""
        return self.op <= RowOp.ARC_RADIUS_CCW

    @property
    def is_arc(self) -> Bools:
        """Rows that are an arc."""
        return (self.op >= RowOp.ARC_CENTRE_CW) & (self.op <= RowOp.ARC_RADIUS_CCW)

    def has(self, column: Column) -> bool:
        """Whether some row has a column."""
        return self.rows.has(column)

    def raw(self, column: Column) -> Floats:
        """A column as it was written; NaN where absent."""
        found: Floats = self.rows.column(column)
        return found

    def raw_at(self, column: Column, rows: Indices) -> Floats:
        """A column as it was written at some rows, (k,); NaN where absent."""
        return self.rows.at(column, rows)

    def units_pulse(self) -> Bools | None:
        """Whether UNITS PULSE is in force; None if never."""
        if not (self.op == RowOp.UNITS_PULSE).any():
            return None
        at = last_set((self.op == RowOp.UNITS_PULSE) | (self.op == RowOp.UNITS_MM))
        return np.asarray((at >= 0) & (self.op[at] == RowOp.UNITS_PULSE))

    def in_pulse(self, column: Column) -> Bools | None:
        """Whether a column's number is in the controller's units; None if nowhere."""
        written = self.rows.system & (3 << (2 * column)) if self.rows.system.any() else None
        by_units = self.units_pulse()
        if written is None or not written.any():
            return by_units
        written >>= 2 * column
        explicit = written == UnitSystem.PULSE
        return np.asarray(explicit if by_units is None else explicit | (by_units & (written == UnitSystem.DEFAULT)))

    def length(self, column: Column, axis: int) -> Floats:
        """A length in pulse of an axis, NaN where absent."""
        if not self.has(column):
            return self.raw(column)
        values, pulses = self.raw(column), self.in_pulse(column)
        scaled = values * self.machine.pulses_per_mm[axis]
        return scaled if pulses is None else np.where(pulses, values, scaled)

    def rate(self, column: Column, *, acceleration: bool) -> tuple[Floats, Bools]:
        """A velocity or acceleration in pulse/ms or pulse/ms2, and whether it was written in mm."""
        if not self.has(column):
            return self.raw(column), np.broadcast_to(np.False_, len(self.op))
        values, pulses = self.raw(column), self.in_pulse(column)
        convert = acceleration_pulse_per_ms2 if acceleration else velocity_pulse_per_ms
        limit = self.machine.max_acceleration_mm_s2 if acceleration else self.machine.max_velocity_mm_s
        in_x = self.machine.pulses_per_mm[0]
        scaled = convert(values, in_x)
        if pulses is not None:
            scaled = np.where(pulses, values, scaled)
        in_mm = np.broadcast_to(np.True_, len(values)) if pulses is None else ~pulses
        return settled(scaled, convert(limit, in_x)), in_mm

    def rate_at(self, column: Column, rows: Indices, *, acceleration: bool) -> tuple[Floats, Bools]:
        """What `rate` is at some rows, (k,)."""
        values, pulses = self.raw_at(column, rows), self.in_pulse(column)
        in_mm = np.ones(len(rows), dtype=np.bool_) if pulses is None else ~pulses[rows]
        convert = acceleration_pulse_per_ms2 if acceleration else velocity_pulse_per_ms
        return np.where(in_mm, convert(values, self.machine.pulses_per_mm[0]), values), in_mm

    def power_unit(self, column: Column) -> npt.NDArray[np.int8]:
        """PowerUnit in which a power was written."""
        written = self.rows.system & (3 << (2 * column))
        if not written.any():
            return np.broadcast_to(np.int8(0), len(self.op))
        written >>= 2 * column
        return written.astype(np.int8)

    def arc_units(self) -> tuple[Bools, Bools]:
        """Whether an arc's centre or radius was written in mm, and whether it was in pulses; 0 has any unit."""
        in_mm, in_pulse = np.zeros(len(self.op), dtype=np.bool_), np.zeros(len(self.op), dtype=np.bool_)
        for column in (Column.I, Column.J, Column.R):
            values, pulses = self.raw(column), self.in_pulse(column)
            given = ~np.isnan(values) & (values != 0)
            in_mm |= given if pulses is None else given & ~pulses
            in_pulse |= np.False_ if pulses is None else given & pulses
        return in_mm, in_pulse

    def relative(self) -> Bools | None:
        """Whether COORDS REL is in force; None if never."""
        if not (self.op == RowOp.COORDS_REL).any():
            return None
        switch = last_set((self.op == RowOp.COORDS_REL) | (self.op == RowOp.COORDS_ABS))
        return np.asarray((switch >= 0) & (self.op[switch] == RowOp.COORDS_REL))

    def channel(self) -> Floats:
        """Channel as written; it may be out of range."""
        is_modal = self.op == RowOp.CHANNEL
        if not self.has(Column.CHANNEL) and not is_modal.any():
            return np.broadcast_to(np.float64(0.0), len(self.op))
        modal = np.where(is_modal, self.raw(Column.VALUE), np.nan)
        own = self.raw(Column.CHANNEL)
        in_force = filled(modal, 0.0) if is_modal.any() else np.zeros(len(self.op))
        return np.where(np.isnan(own), in_force, own) if self.has(Column.CHANNEL) else in_force

    def follow_ratio(self, rows: Indices) -> tuple[Floats, Bools]:
        """Follow ratio per pulse/ms at some rows, as written or the one that reaches MAX at AT; whether it is of mm."""
        given, pulses = self.raw_at(Column.RATIO, rows), self.units_pulse()
        in_mm = np.ones(len(rows), dtype=np.bool_) if pulses is None else ~pulses[rows]
        ratio = settled(np.where(in_mm, given * 1e3 / self.machine.pulses_per_mm[0], given))
        if not self.has(Column.AT):
            return ratio, in_mm
        at, at_in_mm = self.rate_at(Column.AT, rows, acceleration=False)
        in_x = velocity_pulse_per_ms(self.machine.max_velocity_mm_s, self.machine.pulses_per_mm[0])
        at = settled(at, in_x)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio_to_max = settled((self.raw_at(Column.HIGH, rows) - self.raw_at(Column.LOW, rows)) / at)
        by_velocity = ~np.isnan(at)
        return np.where(by_velocity, ratio_to_max, ratio), np.where(by_velocity, at_in_mm, in_mm)

    def frame(self) -> Ints:
        """Number of the frame around each row, 0 for none."""
        return np.nan_to_num(self.raw(Column.FRAME)).astype(np.int64)

    def provenance(self) -> npt.NDArray[np.int32]:
        """Node of Provenance of each row."""
        if not self.has(Column.PROVENANCE):
            return np.broadcast_to(np.int32(0), len(self.op))
        return np.nan_to_num(self.raw(Column.PROVENANCE)).astype(np.int32)

    def first_of_lines(self, rows: Indices) -> list[tuple[int, int]]:
        """Of rows that came from one line the first, and how many there are."""
        _, first, count = np.unique(self.rows.line[rows], return_index=True, return_counts=True)
        return list(zip(rows[first].tolist(), count.tolist(), strict=True))
