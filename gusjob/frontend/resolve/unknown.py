"""The state of what is not known at each row, because a statement can't be read or leaves the field.

Bits of ir.effects: an effect is unknown from a statement that may have it up to the next readable one that has it.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.frontend.parse.forms import Column
from gusjob.frontend.parse.statement import RowOp, Statement
from gusjob.frontend.resolve.columns import ResolvedColumns, last_set
from gusjob.ir.effects import CHANNEL_SHIFT, OF_LASER, StateEffect
from gusjob.kinematics.arrays import Bools, Floats, Ints

States = npt.NDArray[np.int32]
_MODAL: tuple[tuple[StateEffect, tuple[RowOp, ...]], ...] = (
    (StateEffect.UNITS, (RowOp.UNITS_MM, RowOp.UNITS_PULSE)),
    (StateEffect.COORDS, (RowOp.COORDS_ABS, RowOp.COORDS_REL)),
    (StateEffect.CHANNEL, (RowOp.CHANNEL,)),
    (StateEffect.JUMPVEL, (RowOp.JUMPVEL,)),
    (StateEffect.JUMPACC, (RowOp.JUMPACC,)),
)
_OF_CHANNEL: tuple[tuple[StateEffect, tuple[RowOp, ...]], ...] = (
    (StateEffect.MODE, ()),
    (StateEffect.MODE_KIND, ()),
    (StateEffect.SWITCH, (RowOp.ON, RowOp.OFF)),
    (StateEffect.POWER, (RowOp.POWER, RowOp.FOLLOW)),
    (StateEffect.DISTANCE, ()),
)


def unknown_states(
    columns: ResolvedColumns, setups: tuple[Statement, ...], x: Floats, y: Floats
) -> tuple[States, States]:
    """The states before and after each row, (n,) each.

    Args:
        columns: The rows.
        setups: The statements that SETUP rows point to.
        x: Position after each row, pulse, (n,).
        y: The same.
    """
    n, op = len(columns.op), columns.op
    outside = [_outside(columns, values, axis) for axis, values in enumerate((x, y))]
    unread, channel = op == RowOp.UNREAD, columns.channel()
    bad_channel = np.zeros(n, dtype=np.bool_) if channel.strides == (0,) else ~np.isin(channel, CHANNELS)
    if not unread.any() and not bad_channel.any() and not any(out.any() for out in outside):
        nothing = np.broadcast_to(np.int32(0), n)
        return nothing, nothing
    setup = _setup_effects(columns, setups)
    flags = np.where(unread, np.nan_to_num(columns.raw(Column.VALUE)), 0.0).astype(np.int64)
    if bad_channel.any():
        flags |= np.where(bad_channel & ~unread, _bad_channel_effects(columns, setup), 0)
    states = _States(flags)
    for effect, ops in _MODAL:
        states.add(effect, np.isin(op, ops))
    states.add(StateEffect.SKY, (setup & StateEffect.SKY) != 0)
    for effect, statement, word in ((StateEffect.VEL, RowOp.VEL, Column.VEL), (StateEffect.ACC, RowOp.ACC, Column.ACC)):
        states.add(effect, (op == statement) | (columns.moves & ~np.isnan(columns.raw(word))))
    # A channel of a statement's own is certain, whatever CHANNEL said before it.
    is_certain = states.is_clear(StateEffect.CHANNEL) | ~np.isnan(columns.raw(Column.CHANNEL))
    for number in CHANNELS:
        for effect, ops in _OF_CHANNEL:
            sets = np.isin(op, ops) | ((setup & effect) != 0)
            own = (channel == number) | bad_channel | ~is_certain
            is_set = sets & (channel == number) & is_certain
            states.add(effect, is_set, own=own, extra=sets & ~is_certain, shift=CHANNEL_SHIFT * number)
    relative = columns.relative()
    is_absolute = states.is_clear(StateEffect.UNITS | StateEffect.COORDS)
    if relative is not None:
        is_absolute &= ~relative
    for effect, column, out in ((StateEffect.X, Column.X, outside[0]), (StateEffect.Y, Column.Y, outside[1])):
        is_set = columns.moves & ~np.isnan(columns.raw(column)) & is_absolute
        states.add(effect, is_set, extra=(flags & (StateEffect.UNITS | StateEffect.COORDS)) != 0)
        states.add_outside(effect, is_set, out)
    # What has a channel that does not exist is of no channel.
    states.before |= np.where(bad_channel, np.int32(StateEffect.CHANNEL), np.int32(0))
    return states.before, states.after


def _bad_channel_effects(columns: ResolvedColumns, setup: Ints) -> Ints:
    """Effects of rows if their channel does not exist: those of a laser, on any channel."""
    found = setup & int(OF_LASER)
    for effect, ops in _OF_CHANNEL:
        found = found | np.where(np.isin(columns.op, ops), int(effect), 0)
    return np.where(columns.op == RowOp.CHANNEL, int(StateEffect.CHANNEL), found)


def _outside(columns: ResolvedColumns, values: Floats, axis: int) -> Bools:
    """Motions that end outside the field: what follows from such a position is not another error."""
    low, high = columns.machine.field_pulse[axis]
    pulses = np.rint(values)
    return np.asarray(columns.moves & ((pulses < low) | (pulses > high)))


def _setup_effects(columns: ResolvedColumns, setups: tuple[Statement, ...]) -> Ints:
    """Effects of each row that is a setup statement, (n,)."""
    from gusjob.frontend.parse.intent import setup_effects  # Start-up time is part of the tool.

    is_setup = columns.op == RowOp.SETUP
    found = np.zeros(len(is_setup), dtype=np.int64)
    if is_setup.any():
        of_statement = np.array([int(setup_effects(statement)) for statement in setups], dtype=np.int64)
        found[is_setup] = of_statement[columns.raw(Column.VALUE)[is_setup].astype(np.int64)]
    return found


class _States:
    """States as they are put together, one effect after the other."""

    def __init__(self, flags: Ints) -> None:
        n = len(flags)
        self.flags = flags
        """Effects of the rows that can't be read."""
        self.before = np.zeros(n, dtype=np.int32)
        self.after = np.zeros(n, dtype=np.int32)

    def is_clear(self, effects: StateEffect) -> Bools:
        """Whether effects are known after each row."""
        return np.asarray((self.after & int(effects)) == 0)

    def add(
        self,
        effect: StateEffect,
        is_set: Bools,
        *,
        own: Bools | None = None,
        extra: Bools | None = None,
        shift: int = 0,
    ) -> None:
        """Add an effect: unknown from a row that may have it to the next one with it."""
        unread = (self.flags & int(effect)) != 0
        if extra is not None:
            unread |= extra
        if own is not None:
            unread &= own
        if not unread.any():
            return
        unknown = _since(unread, is_set & ~unread)
        self.after |= unknown.astype(np.int32) << (effect.bit_length() - 1 + shift)
        self._before(effect, unknown, shift)

    def add_outside(self, effect: StateEffect, is_set: Bools, outside: Bools) -> None:
        """Add positions that follow from one outside the field: the one outside itself is known."""
        if not outside.any():
            return
        since = np.concatenate([[False], _since(outside, is_set & ~outside)[:-1]])
        self.before |= since.astype(np.int32) << (effect.bit_length() - 1)
        self.after |= (since & ~is_set).astype(np.int32) << (effect.bit_length() - 1)

    def _before(self, effect: StateEffect, unknown: Bools, shift: int) -> None:
        before = np.concatenate([[False], unknown[:-1]])
        self.before |= before.astype(np.int32) << (effect.bit_length() - 1 + shift)


def _since(begins: Bools, ends: Bools) -> Bools:
    """Rows at which the last of both kinds of row is one that begins."""
    at = last_set(begins | ends)
    return np.asarray((at >= 0) & begins[at])
