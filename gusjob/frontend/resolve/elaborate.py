"""Rows to Job: modal words become columns, every position absolute, every number in pulse, ms, us, kHz, % or V."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import AUTO_SHARE, AUTO_STEPS, CHANNEL, DEFAULT_LIMIT, MODE_LIMIT, PowerMode
from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
from gusjob.frontend.files import SourceMap
from gusjob.frontend.parse.forms import Field
from gusjob.frontend.parse.job_reader import RowOp
from gusjob.frontend.parse.statements import Quantity, Statement, unit_of
from gusjob.frontend.resolve.frames import Frames, bent_arcs, frames_of, positions_in_frames
from gusjob.frontend.scan.shapes import Rows
from gusjob.ir.job import Job
from gusjob.ir.path import Op, Path, Speeds, with_chords
from gusjob.ir.provenance import Provenance
from gusjob.ir.setup import (
    Crd,
    DistanceFollow,
    LaserDelay,
    LaserDistance,
    LaserFpk,
    LaserMode,
    LaserPrevolt,
    LaserStandby,
    LookAhead,
    PowerNow,
    Setup,
    SetupStatement,
    SkyWrite,
    SkyWriting,
    SwitchNow,
    Wait,
    auto_steps,
)
from gusjob.kinematics.arrays import Bools, Floats, Indices, Ints, running_sum
from gusjob.kinematics.chords import chord_angles, chord_counts, chord_ends
from gusjob.kinematics.geometry import CLOSES_MM
from gusjob.kinematics.units import UnitSystem, acceleration_pulse_per_ms2, velocity_pulse_per_ms

_OPS = {
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
_NONE = 255
_STAYS_PULSE = 1e-6
_OP_TABLE = np.array([_OPS.get(op, _NONE) for op in RowOp], dtype=np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Told:
    """All that a job says, in the order in which it is carried out.

    `rows` point into `setups`. `frame_parent`: for each frame (from 1) the frame around it, 0 for none. `trails`:
    None where every statement stands in the open.
    """

    name: str
    rows: Rows
    setups: tuple[Statement, ...]
    sources: SourceMap
    frame_parent: Ints
    trails: Provenance | None = None
    lets: dict[str, list[int]] = field(default_factory=dict)
    """Lines that set each name."""
    whole: bool = True
    """Whether every line could be read and carried out."""


def elaborate(told: Told, machine: Machine) -> tuple[Job, list[Diagnostic]]:
    """The job that a text says on a machine."""
    reader = _Elaboration(told=told, machine=machine)
    path = reader.path()
    job = Job(
        name=told.name,
        path=path,
        speeds=reader.speeds(),
        setups=reader.setups(),
        locate=told.sources.locate,
        text_of=told.sources.text_of,
        name_remarks=lambda line, word: told.sources.set_here(line, word, told.lets),
        files=told.sources.files,
        included=tuple((source.name, source.data) for source in told.sources.sources[1:]),
        in_pulses=bool((told.rows.op == RowOp.UNITS_PULSE).any()),
        complete=told.whole,
        provenance=told.trails,
    )
    return job, reader.diagnostics(job)


def last_set(is_set: Bools) -> Ints:
    """For each row the last row up to it at which `is_set`; -1 where there is none."""
    at = np.where(is_set, np.arange(len(is_set)), -1)
    return np.maximum.accumulate(at) if len(at) else at


def filled(values: Floats, start: float) -> Floats:
    """Values carried forward over NaN; `start` before the first."""
    at = last_set(~np.isnan(values))
    return np.where(at >= 0, values[at], start) if len(values) else values


@dataclass(slots=True)
class _Modal:
    """A modal value in force per row.

    The value (NaN: never set), whether it was written in mm, and the line that set it.
    """

    value: Floats
    in_mm: Bools
    line: npt.NDArray[np.int32]

    def over(self, where: Bools, other: _Modal) -> _Modal:
        """This one, but `other` where it is set and `where` holds."""
        use = where & ~np.isnan(other.value)
        return _Modal(
            np.where(use, other.value, self.value),
            np.where(use, other.in_mm, self.in_mm),
            np.where(use, other.line, self.line),
        )


@dataclass(slots=True)
class _Elaboration:
    told: Told
    machine: Machine
    open_arcs: list[tuple[int, tuple[float, float]]] = field(default_factory=list)
    """Rows of arcs in turned frames that do not close, with the distances of their ends from the centre, mm."""
    known_frames: Frames | None = None
    """What `frames` has found."""
    first_piece: Indices | None = None
    """Where arcs became lines: the row that each row of the path became."""

    @property
    def rows(self) -> Rows:
        """The rows read."""
        return self.told.rows

    def col(self, column: Field) -> Floats:
        found: Floats = self.rows.column(column)
        return found

    def units_pulse(self) -> Bools | None:
        """Whether UNITS PULSE is in force, per row; None if never."""
        op = self.rows.op
        if not (op == RowOp.UNITS_PULSE).any():
            return None
        at = last_set((op == RowOp.UNITS_PULSE) | (op == RowOp.UNITS_MM))
        return np.asarray((at >= 0) & (op[at] == RowOp.UNITS_PULSE))

    def in_pulse(self, column: Field) -> Bools | None:
        """Whether a column's number is in the controller's units, per row; None if nowhere."""
        written = (self.rows.system >> (2 * column)) & 3 if self.rows.system.any() else None
        by_units = self.units_pulse()
        if written is None:
            return by_units
        explicit = written == UnitSystem.PULSE
        return np.asarray(explicit if by_units is None else explicit | (by_units & (written == UnitSystem.DEFAULT)))

    def length(self, column: Field, axis: int) -> Floats:
        """A length column in pulse, NaN where absent."""
        if column not in self.rows.columns:
            return self.col(column)
        values, pulses = self.col(column), self.in_pulse(column)
        scaled = values * self.machine.pulses_per_mm[axis]
        return scaled if pulses is None else np.where(pulses, values, scaled)

    def rate(self, column: Field, *, acceleration: bool) -> tuple[Floats, Bools]:
        """A velocity or acceleration column in pulse/ms (2), and whether it was written in mm."""
        if column not in self.rows.columns:
            return self.col(column), np.broadcast_to(np.False_, len(self.rows.op))
        values, pulses = self.col(column), self.in_pulse(column)
        convert = acceleration_pulse_per_ms2 if acceleration else velocity_pulse_per_ms
        scaled = convert(values, self.machine.pulses_per_mm[0])
        if pulses is None:
            return scaled, np.broadcast_to(np.True_, len(values))
        return np.where(pulses, values, scaled), ~pulses

    def modal(self, statement: RowOp, word: Field | None, *, acceleration: bool) -> _Modal:
        """A modal velocity or acceleration in force per row, set by its statement or by a word of LINE and ARC."""
        op = self.rows.op
        value, in_mm = self.rate(Field.VALUE, acceleration=acceleration)
        is_set = op == statement
        if word is not None and word in self.rows.columns:
            own, own_mm = self.rate(word, acceleration=acceleration)
            by_word = ~np.isnan(own) & (op <= RowOp.ARC_RADIUS_CCW)
            value, in_mm = np.where(by_word, own, value), np.where(by_word, own_mm, in_mm)
            is_set = is_set | by_word
        if not is_set.any():
            n = len(op)
            return _Modal(np.broadcast_to(np.nan, n), np.broadcast_to(np.False_, n), np.broadcast_to(np.int32(0), n))
        at = last_set(is_set)
        return _Modal(np.where(at >= 0, value[at], np.nan), in_mm[at], self.rows.line[at])

    def speeds(self) -> Speeds:
        """Every velocity and acceleration that was written."""
        op = self.rows.op
        parts: list[tuple[Any, ...]] = []
        for number, statement in enumerate((RowOp.VEL, RowOp.ACC, RowOp.JUMPVEL, RowOp.JUMPACC)):
            found = np.flatnonzero(op == statement)
            value, in_mm = self.rate(Field.VALUE, acceleration=bool(number % 2))
            parts.append((found, number, value[found], in_mm[found], False))
        for number, word in enumerate((Field.VEL, Field.ACC)):
            if word in self.rows.columns:
                value, in_mm = self.rate(word, acceleration=bool(number))
                found = np.flatnonzero(~np.isnan(value) & (op <= RowOp.ARC_RADIUS_CCW))
                parts.append((found, number, value[found], in_mm[found], True))
        return Speeds(
            line=np.concatenate([self.rows.line[p[0]] for p in parts]),
            word=np.concatenate([np.full(len(p[0]), p[1], dtype=np.int8) for p in parts]),
            value=np.concatenate([p[2] for p in parts]),
            in_mm=np.concatenate([p[3] for p in parts]),
            inline=np.concatenate([np.full(len(p[0]), p[4]) for p in parts]),
            provenance=np.concatenate([self.trail()[p[0]] for p in parts]),
            row=np.concatenate([self.places(p[0]) - p[4] for p in parts]),
        )

    def places(self, rows: Indices) -> Indices:
        """How many rows of the path stand up to some rows."""
        before = np.cumsum(_OP_TABLE[self.rows.op] != _NONE)[rows]
        return before if self.first_piece is None else self.first_piece[before]

    def trail(self) -> npt.NDArray[np.int32]:
        """The trail of each row."""
        if Field.TRAIL not in self.rows.columns:
            return np.broadcast_to(np.int32(0), len(self.rows.op))
        return np.nan_to_num(self.col(Field.TRAIL)).astype(np.int32)

    def positions(self) -> tuple[Floats, Floats]:
        """Absolute position behind each row, pulse."""
        rows, op = self.rows, self.rows.op
        x, y = (self.words(column, axis) for axis, column in enumerate((Field.X, Field.Y)))
        relative = self.relative()
        if Field.FRAME not in rows.columns:
            return self.position(x, relative), self.position(y, relative)
        moves = np.flatnonzero(op <= RowOp.ARC_RADIUS_CCW)
        frame = np.nan_to_num(self.col(Field.FRAME)[moves]).astype(np.int64)
        here = relative[moves] if relative is not None else np.zeros(len(moves), dtype=np.bool_)
        px, py = positions_in_frames(x[moves], y[moves], here, frame, self.frames())
        # Into a frame and out again costs the last bits; a head that stays, as for a full circle, stays exactly.
        before_x, before_y = np.concatenate([[0.0], px[:-1]]), np.concatenate([[0.0], py[:-1]])
        stays = np.hypot(px - before_x, py - before_y) < _STAYS_PULSE
        found = []
        for values in (np.where(stays, np.nan, px), np.where(stays, np.nan, py)):
            spread = np.full(len(op), np.nan)
            spread[moves] = values
            found.append(filled(spread, 0.0))
        return found[0], found[1]

    def words(self, column: Field, axis: int) -> Floats:
        """X or Y of moves, pulse; NaN where an axis is left out."""
        if column not in self.rows.columns:
            return np.broadcast_to(np.float64(np.nan), len(self.rows.op))
        return np.where(self.rows.op <= RowOp.ARC_RADIUS_CCW, self.length(column, axis), np.nan)

    def relative(self) -> Bools | None:
        """Whether COORDS REL is in force, per row; None if never."""
        op = self.rows.op
        if not (op == RowOp.COORDS_REL).any():
            return None
        switch = last_set((op == RowOp.COORDS_REL) | (op == RowOp.COORDS_ABS))
        return np.asarray((switch >= 0) & (op[switch] == RowOp.COORDS_REL))

    def position(self, words: Floats, relative: Bools | None) -> Floats:
        """Absolute position on an axis behind each row, pulse, where there is no frame."""
        if len(words) and words.strides == (0,):
            return np.broadcast_to(np.float64(0.0), len(words))
        if relative is None:
            return filled(words, 0.0)
        given = ~np.isnan(words)
        sums = running_sum(np.where(relative & given, words, 0.0))[1:]
        base = last_set(given & ~relative)
        return np.where(base >= 0, words[base] - sums[base], 0.0) + sums

    def frames(self) -> Frames:
        """Every frame as a map from its pulses to the machine's, those around it included."""
        if self.known_frames is None:
            self.known_frames = self._frames()
        return self.known_frames

    def _frames(self) -> Frames:
        at = np.flatnonzero(self.rows.op == RowOp.FRAME)
        number = self.col(Field.FRAME)[at].astype(np.int64)
        shift_x, shift_y = self.length(Field.X, 0)[at], self.length(Field.Y, 1)[at]
        angle, scale = self.col(Field.VALUE)[at], self.col(Field.RATIO)[at]
        return frames_of(
            number, np.nan_to_num(shift_x), np.nan_to_num(shift_y), np.nan_to_num(angle),
            np.where(np.isnan(scale) | ~(scale > 0), 1.0, scale), self.told.frame_parent, self.machine.pulses_per_mm,
        )  # fmt: skip

    def diagnostics(self, job: Job) -> list[Diagnostic]:
        """What only the whole job shows: channels that are none, frames without a size, arcs that a frame bends."""
        op, value = self.rows.op, self.channel()
        written = op == RowOp.CHANNEL
        if Field.CHANNEL in self.rows.columns:
            written = written | ~np.isnan(self.col(Field.CHANNEL))
        bad = np.flatnonzero(written & ((CHANNEL.classify(value) > 0) | ~CHANNEL.carries(value)))
        found = []
        for at, count in self.once(bad):
            word = "value" if op[at] == RowOp.CHANNEL else "CHANNEL"
            fields = {"what": "CHANNEL", "value": float(value[at]), "unit": "", "range": str(CHANNEL), "hint": ""}
            found.append(self.diagnostic(job, rules.OUT_OF_RANGE, at, word, count, fields))
        if not (op == RowOp.FRAME).any():
            return found
        scale = self.col(Field.RATIO)
        for at, count in self.once(np.flatnonzero((op == RowOp.FRAME) & ~(scale > 0) & ~np.isnan(scale))):
            found.append(self.diagnostic(job, rules.FRAME_SCALE, at, "SCALE", count, {"value": float(scale[at])}))
        for at, off_mm in self.open_arcs:
            fields = {"end": off_mm[1], "start": off_mm[0], "limit": CLOSES_MM}
            found.append(self.diagnostic(job, rules.ARC_OFF, at, "", 1, fields))
        return found

    def once(self, rows: Indices) -> list[tuple[int, int]]:
        """Of rows that came from one line the first, and how many there are."""
        _, first, count = np.unique(self.rows.line[rows], return_index=True, return_counts=True)
        return list(zip(rows[first].tolist(), count.tolist(), strict=True))

    def diagnostic(self, job: Job, rule: d.Rule, at: int, word: str, count: int, fields: dict[str, Any]) -> Diagnostic:
        """A diagnostic in a row."""
        span = job.locate(int(self.rows.line[at]), word)
        remarks = job.provenance_remarks(int(self.trail()[at]))
        return Diagnostic(rule=rule, span=span, fields=fields, count=count, remarks=remarks)

    def channel(self) -> Floats:
        """Channel of each row as written (checked later)."""
        op = self.rows.op
        if Field.CHANNEL not in self.rows.columns and not (op == RowOp.CHANNEL).any():
            return np.broadcast_to(np.float64(0.0), len(op))
        modal = np.where(op == RowOp.CHANNEL, self.col(Field.VALUE), np.nan)
        tail = self.col(Field.CHANNEL)
        carried = filled(modal, 0.0) if (op == RowOp.CHANNEL).any() else np.zeros(len(op))
        return np.where(np.isnan(tail), carried, tail) if Field.CHANNEL in self.rows.columns else carried

    def path(self) -> Path:
        """All path statements as columns."""
        rows, op = self.rows, self.rows.op
        path_op = _OP_TABLE[op]
        keep = path_op != _NONE
        x, y = self.positions()
        vel = self.modal(RowOp.VEL, Field.VEL, acceleration=False)
        acc = self.modal(RowOp.ACC, Field.ACC, acceleration=True)
        jump = op == RowOp.JUMP
        if jump.any():
            vel = vel.over(jump, self.modal(RowOp.JUMPVEL, None, acceleration=False))
            acc = acc.over(jump, self.modal(RowOp.JUMPACC, None, acceleration=True))
        end, end_mm = self.rate(Field.END, acceleration=False)
        arcs = (op >= RowOp.ARC_CENTRE_CW) & (op <= RowOp.ARC_RADIUS_CCW)
        nothing = np.broadcast_to(np.nan, len(op))
        cx, cy, radius = nothing, nothing, nothing
        if arcs.any():
            i, j = self.length(Field.I, 0), self.length(Field.J, 1)
            i, j, radius = np.where(np.isnan(i), 0.0, i), np.where(np.isnan(j), 0.0, j), self.length(Field.R, 0)
            if Field.FRAME in rows.columns:
                frames, inside = self.frames(), np.nan_to_num(self.col(Field.FRAME)).astype(np.int64)
                i, j = frames.a[inside] * i + frames.b[inside] * j, frames.c[inside] * i + frames.d[inside] * j
                radius = radius * frames.scale[inside]
            cx, cy = np.concatenate([[0.0], x[:-1]]) + i, np.concatenate([[0.0], y[:-1]]) + j
        ratio, follow_mm = self._ratio()
        value = self.col(Field.VALUE)

        def cut(column: npt.NDArray[Any]) -> npt.NDArray[Any]:
            # A column that is one value for all rows has stride 0 and takes no memory; it stays so.
            if len(column) and column.strides == (0,):
                return np.broadcast_to(column[0], count)
            return column if count == len(keep) else column[keep]

        count = int(np.count_nonzero(keep))
        false = np.broadcast_to(np.False_, len(op))
        unequal = not self.machine.equal_axes
        return self._straightened(
            Path(
                op=cut(path_op),
                line=cut(rows.line),
                channel=self._channel_column(cut),
                ccw=cut((op == RowOp.ARC_CENTRE_CCW) | (op == RowOp.ARC_RADIUS_CCW) if arcs.any() else false),
                arc_in_mm=cut(self._arc_in_mm() if unequal else false),
                x=cut(x),
                y=cut(y),
                cx=cut(cx),
                cy=cut(cy),
                radius=cut(radius),
                vel=cut(vel.value),
                acc=cut(acc.value),
                end=cut(end),
                vel_line=cut(vel.line),
                acc_line=cut(acc.line),
                vel_in_mm=cut(vel.in_mm if unequal else false),
                acc_in_mm=cut(acc.in_mm if unequal else false),
                end_in_mm=cut(end_mm if unequal else false),
                dwell_ms=cut(np.where(op == RowOp.DWELL, value, np.nan) if (op == RowOp.DWELL).any() else nothing),
                power=cut(np.where(op == RowOp.POWER, value, np.nan) if (op == RowOp.POWER).any() else nothing),
                low=cut(self.col(Field.LOW)),
                high=cut(self.col(Field.HIGH)),
                ratio=cut(ratio),
                follow_in_mm=cut(follow_mm if unequal else false),
                power_unit=cut(self._written(Field.VALUE)),
                low_unit=cut(self._written(Field.LOW)),
                high_unit=cut(self._written(Field.HIGH)),
                provenance=cut(self.trail()),
            ),
            keep,
        )

    def _straightened(self, path: Path, keep: Bools) -> Path:
        """Arcs in pulses in a turned frame, where the axes differ, are ellipses: they become lines.

        In the frame's own pulses they are circles; only the frame's turn and scale matter here, not its shift.
        """
        op = self.rows.op
        if self.machine.equal_axes or Field.FRAME not in self.rows.columns:
            return path
        frames, inside = self.frames(), np.nan_to_num(self.col(Field.FRAME)).astype(np.int64)
        turned = (frames.b[inside] != 0) | (frames.c[inside] != 0)
        arcs = (op >= RowOp.ARC_CENTRE_CW) & (op <= RowOp.ARC_RADIUS_CCW)
        rows = np.flatnonzero(arcs & turned & ~self._arc_in_mm())
        if not len(rows):
            return path
        at, own = (np.cumsum(keep) - 1)[rows], inside[rows]
        shapes, end = bent_arcs(path, at, frames, own)
        scale = frames.scale[own] / min(self.machine.pulses_per_mm)
        start, end = shapes.radius * scale, end * scale
        off = np.flatnonzero(np.abs(start - end) > CLOSES_MM)
        _, first = np.unique(self.rows.line[rows[off]], return_index=True)
        self.open_arcs = [(int(rows[i]), (float(start[i]), float(end[i]))) for i in off[first].tolist()]
        pieces = chord_counts(shapes.sweep, chord_angles(start, self.machine.chord_tolerance_um / 1000))
        x, y = chord_ends(shapes, pieces)
        which = np.repeat(own, pieces)
        longer, origin = with_chords(
            path, at, pieces, frames.a[which] * x + frames.b[which] * y, frames.c[which] * x + frames.d[which] * y
        )
        self.first_piece = np.searchsorted(origin, np.arange(len(path) + 1), side="left")
        return longer

    def _channel_column(self, cut: Callable[[npt.NDArray[Any]], npt.NDArray[Any]]) -> npt.NDArray[np.int8]:
        """Channels as they are used: a wrong one is a diagnostic already."""
        return np.asarray(np.clip(np.nan_to_num(cut(self.channel())), 0, 1), dtype=np.int8)

    def _arc_in_mm(self) -> Bools:
        """Whether an arc's centre or radius was given in mm."""
        found = np.zeros(len(self.rows.op), dtype=np.bool_)
        for column in (Field.I, Field.J, Field.R):
            given, pulses = ~np.isnan(self.col(column)), self.in_pulse(column)
            found |= given if pulses is None else given & ~pulses
        return found

    def _written(self, column: Field) -> npt.NDArray[np.int8]:
        if not self.rows.system.any():
            return np.broadcast_to(np.int8(0), len(self.rows.op))
        return np.asarray((self.rows.system >> (2 * column)) & 3, dtype=np.int8)

    def _ratio(self) -> tuple[Floats, Bools]:
        """Follow ratio per pulse/ms, as written or the one that reaches MAX at AT; and whether it hangs on mm."""
        if Field.RATIO not in self.rows.columns and Field.AT not in self.rows.columns:
            return self.col(Field.RATIO), np.broadcast_to(np.False_, len(self.rows.op))
        given, pulses = self.col(Field.RATIO), self.units_pulse()
        in_mm = np.broadcast_to(np.True_, len(given)) if pulses is None else ~pulses
        ratio = np.where(in_mm, given * 1e3 / self.machine.pulses_per_mm[0], given)
        if Field.AT not in self.rows.columns:
            return ratio, in_mm
        at, at_mm = self.rate(Field.AT, acceleration=False)
        with np.errstate(divide="ignore", invalid="ignore"):
            wanted = (self.col(Field.HIGH) - self.col(Field.LOW)) / at
        by_velocity = ~np.isnan(at)
        return np.where(by_velocity, wanted, ratio), np.where(by_velocity, at_mm, in_mm)

    def setups(self) -> tuple[Setup, ...]:
        """The setup statements, each with its place in the path."""
        op = self.rows.op
        at = np.flatnonzero(op == RowOp.SETUP)
        before = np.cumsum(_OP_TABLE[op] != _NONE)
        channel, pulses = self.channel(), self.units_pulse()
        index, trail = self.col(Field.VALUE), self.trail()
        found = []
        for order, i in enumerate(at.tolist()):
            statement = self.told.setups[int(index[i])]
            in_pulse = pulses is not None and bool(pulses[i])
            found.append(
                Setup(
                    statement=self.setup(statement, in_pulse),
                    order=order,
                    row=int(before[i] if self.first_piece is None else self.first_piece[before[i]]),
                    line=int(self.rows.line[i]),
                    channel=int(min(max(np.nan_to_num(channel[i]), 0), 1)),
                    word=_called(statement),
                    provenance=int(trail[i]),
                )
            )
        return tuple(found)

    def setup(self, statement: Statement, in_pulse: bool) -> SetupStatement:
        """One setup statement in canonical units."""
        words = {k: q.value for k, q in statement.words.items()}
        off = "OFF" in statement.options
        match statement.form:
            case "DUTY" | "DUTY2" | "FREQUENCY" | "ANALOG":
                return _mode(PowerMode[statement.form], words)
            case "laser_delay":
                return LaserDelay(on_delay_us=words["ON"], off_delay_us=words["OFF"])
            case "laser_standby":
                return LaserStandby(pulse=None if off else (words["FREQ"], words["DUTY"]))
            case "laser_prevolt":
                return LaserPrevolt(prevoltage_v=None if off else words[""])
            case "laser_fpk":
                return LaserFpk(times_us=None if off else (words["WIDTH"], words["GAP"], words["OFFDELAY"]))
            case "laser_distance":
                return LaserDistance(settings=None if off else self.distance(statement, in_pulse))
            case "laser_power":
                return PowerNow(power=words[""], unit=unit_of(statement.words[""]))
            case "laser_switch":
                return SwitchNow(on="ON" in statement.options)
            case "crd":
                return Crd(crd=words[""], fifo=words.get("FIFO", 0.0))
            case "lookahead":
                return LookAhead(corner=None if off else self.corner(statement, in_pulse))
            case "skywrite":
                return SkyWrite(settings=None if off else _sky_writing(words))
            case _:
                return Wait()

    def corner(self, statement: Statement, in_pulse: bool) -> tuple[float, float]:
        """TIME (ms) and ACC (pulse/ms2) of LOOKAHEAD."""
        time, acc = statement.words.get("TIME"), statement.words.get("ACC")
        value = math.nan
        if acc is not None:
            pulses = acc.system == UnitSystem.PULSE or (acc.system == UnitSystem.DEFAULT and in_pulse)
            value = acc.value if pulses else acceleration_pulse_per_ms2(acc.value, self.machine.pulses_per_mm[0])
        return (time.value if time else math.nan, value)

    def distance(self, statement: Statement, in_pulse: bool) -> DistanceFollow:
        """LASER DISTANCE with its reference in pulse."""

        def reference(quantity: Quantity | None, axis: int) -> float:
            if quantity is None:
                return 0.0
            pulses = quantity.system == UnitSystem.PULSE or (quantity.system == UnitSystem.DEFAULT and in_pulse)
            return quantity.value if pulses else float(np.rint(quantity.value * self.scale(axis))) + 0.0

        places, ratios = statement.axes["REF"], statement.axes["RATIO"]
        refs = [reference(places.get(axis), i) for i, axis in enumerate("XYZA")]
        rates = [ratios[axis].value if axis in ratios else 0.0 for axis in "XYZA"]
        return DistanceFollow(
            reference_pulse=(refs[0], refs[1], refs[2], refs[3]),
            ratio_per_mm=(rates[0], rates[1], rates[2], rates[3]),
            low=statement.words["MIN"].value,
            high=statement.words["MAX"].value,
            low_unit=unit_of(statement.words["MIN"]),
            high_unit=unit_of(statement.words["MAX"]),
            actual="SOURCE ACTUAL" in statement.options,
        )

    def scale(self, axis: int) -> float:
        """Pulses per mm of X, Y; of Z and A, which the profile does not know, as X."""
        return self.machine.pulses_per_mm[axis if axis < 2 else 0]


def _mode(mode: PowerMode, words: dict[str, float]) -> LaserMode:
    limits = MODE_LIMIT[mode]
    return LaserMode(
        mode=mode,
        low=words.get("MIN", limits.low),
        high=words.get("MAX", limits.high),
        carrier_khz=words.get("CARRIER"),
        pulse_width_us=words.get("WIDTH"),
    )


def _sky_writing(words: dict[str, float]) -> SkyWriting:
    """NPREV and NPOST by the rule of 0.15 and 0.10 where they are AUTO, or 65535, which says so to an RTC5."""
    timelag_us = words["TIMELAG"]
    steps = {word: words.get(word, AUTO_STEPS) for word in AUTO_SHARE}
    steps = {word: auto_steps(word, timelag_us) if n == AUTO_STEPS else n for word, n in steps.items()}
    return SkyWriting(
        mode=words["MODE"],
        timelag_us=timelag_us,
        shift_us=words.get("SHIFT", 0.0),
        nprev=steps["NPREV"],
        npost=steps["NPOST"],
        limit=words.get("LIMIT", DEFAULT_LIMIT),
        limit_given="LIMIT" in words,
    )


def _called(statement: Statement) -> str:
    if statement.form == "laser_switch":
        return f"LASER {' '.join(statement.options)}"
    return f"{statement.name} NOW" if "NOW" in statement.options else statement.name
