"""What a job sets for a laser and never uses: powers without emission, channels that are never switched on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import rules
from gusjob.ir.effects import StateEffect, is_known
from gusjob.ir.path import Op
from gusjob.ir.setup import PowerNow
from gusjob.kinematics.arrays import Floats, Indices, hashed
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter


def channels(context: LintContext, report: Reporter) -> None:
    """A laser has a power, but is never switched on, where marks are made without it."""
    path, modal = context.path, context.modal
    lines = np.flatnonzero(path.moves & (path.op != Op.JUMP))
    off = [channel for channel in CHANNELS if _is_never_on(context, channel)]
    powered = [channel for channel in off if len(modal.power_instants(channel))]
    if len(off) == len(CHANNELS):
        # One cause: nothing is on. Without a power, or without a line, the job may only move.
        if powered and len(lines):
            report.rows(rules.NOTHING_MARKED, lines[:1], "", channel=powered[0])
        return
    for channel in off:
        _report_unused(context, report, channel)


def _is_never_on(context: LintContext, channel: int) -> bool:
    """Whether nothing switches a channel on, and no statement that can't be read may do so."""
    switch = StateEffect.SWITCH
    known = np.all(is_known(context.path.unknown, switch, channel)) and is_known(
        context.job.unknown_at_end, switch, channel
    )
    return bool(known) and not context.modal.switches(channel).on.any()


def _report_unused(context: LintContext, report: Reporter, channel: int) -> None:
    """Report the first power of a channel that is never on. A mode alone may be there to put it in a safe state.

    What an included file sets before the first motion may be defaults for several jobs.
    """
    path, job = context.path, context.job
    first_motion = int(np.argmax(path.moves)) if path.moves.any() else len(path)
    rows = np.flatnonzero(path.sets_power & (path.channel == channel))
    rows = rows[job.is_own(path.line[rows]) | (rows > first_motion)][:1]
    now = [setup for setup, _ in context.modal.statements(PowerNow) if setup.channel == channel]
    now = [setup for setup in now if job.is_own(setup.line) or setup.row > first_motion][:1]
    if len(rows):
        report.rows(rules.UNUSED_CHANNEL, rows, "", word=Op(int(path.op[rows[0]])).word, channel=channel)
    for setup in now[: not len(rows)]:
        report.setup(rules.UNUSED_CHANNEL, setup, word=setup.word, channel=channel)


def powers(context: LintContext, report: Reporter) -> None:
    """A power is set again before any emission. In a loop or routine the first or last iteration may go without."""
    _unused(context, report, lambda rows: context.path.line[rows])


def powers_in_calls(context: LintContext, report: Reporter) -> None:
    """A power is set again before any emission, and is not used elsewhere: calls do not show loops."""
    path = context.path
    powers = [path.power, *(v for v in (path.low, path.high, path.ratio) if v.strides != (0,))]
    _unused(context, report, lambda rows: hashed([np.nan_to_num(values[rows]) for values in powers]))


def _unused(context: LintContext, report: Reporter, statement: Callable[[Indices], npt.NDArray[Any]]) -> None:
    """Report powers that are never used. `statement`: gives which statement some rows are iterations of."""
    path, modal = context.path, context.modal
    for channel in CHANNELS:
        on = modal.laser(channel).on
        if not on.any():
            continue
        powers = modal.power_instants(channel)
        emitted = np.concatenate([[0], np.cumsum(on & path.takes_time)])
        begins = (powers + 1) // 2
        used = emitted[np.append(begins[1:], len(path))] > emitted[begins]
        is_last = np.arange(len(powers)) == len(powers) - 1
        used |= emitted[begins] == 0  # Before any emission powers may be a header's defaults.
        spans = modal.modes(channel)
        buffered = (powers % 2 == 1) & (powers >= (spans[0].first * 2 if spans else 0))
        rows, used, is_last = powers[buffered] // 2, used[buffered], is_last[buffered]
        # The lowest power is one to leave behind: an analog output has it while the laser is off.
        idle = ~used & ~(path.power[rows] <= _lowest(context, channel, rows))
        idle &= ~np.isin(statement(rows), statement(rows[used]))
        # The last one may leave a low power behind for the next program.
        low = np.append(np.fmin(path.power[rows[used]], path.low[rows[used]]), np.inf).min()
        idle &= ~(is_last & (path.power[rows] < low))
        for op in (Op.POWER, Op.FOLLOW):
            of_op = idle & (path.op[rows] == op)
            report.rows(rules.UNUSED_POWER, rows[of_op & ~is_last], "", word=op.word)
            report.rows(rules.UNUSED_LAST_POWER, rows[of_op & is_last], "", word=op.word)


def _lowest(context: LintContext, channel: int, rows: Indices) -> Floats:
    """The lowest power of the mode in force at some rows; NaN where there is none."""
    lowest = np.full(len(rows), np.nan)
    for span in context.modal.modes(channel):
        lowest[(rows >= span.first) & (rows < span.last)] = span.mode.low
    return lowest
