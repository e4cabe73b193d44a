"""Delays of the switch and the first pulse killer against the path: emission that comes too late, or does not stop."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus.ranges import CHANNELS
from gusjob.diagnostics import rules
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import Op
from gusjob.ir.setup import LaserDelay, LaserFpk
from gusjob.kinematics.arrays import Bools, Floats, Indices, blocks
from gusjob.kinematics.units import US_PER_MS
from gusjob.lint.context import LintContext
from gusjob.lint.reporter import Reporter


def delays_against_path(context: LintContext, report: Reporter) -> None:
    """Delays that are longer than what they belong to.

    Emission that begins when the whole mark is over, or not at all; emission that does not stop before the next mark.
    Both against the longest time of the path.
    """
    path = context.path
    timed = np.flatnonzero(path.takes_time)
    sky = np.append(context.job.sky_writing_by_row()[0] >= 0, False)  # It compensates for delays.
    for channel in CHANNELS:
        switches, delays = context.modal.switches(channel), delays_in_force(context, channel)
        if len(delays.instant) == 1 or len(switches) < 2:
            continue
        on, rows = switches.on, switches.rows
        times_ms = np.concatenate([[0.0], np.cumsum(longest_ms(context, timed))])
        most_us = np.diff(times_ms[np.searchsorted(timed, (switches.instant + 1) // 2)]) * US_PER_MS
        force = delays.at(switches.instant[:-1])
        buffered = switches.is_buffered & np.concatenate([[True], switches.is_buffered[1:]])
        checked = buffered[:-1] & ~sky[rows[:-1]] & (most_us > 0) & np.all(report.is_sound(delays.lines)[force], axis=1)
        begin_us = (delays.on_us + delays.gap_us)[force]
        marks = np.flatnonzero(on[:-1] & ~on[1:] & (begin_us > most_us) & checked)
        _report_marks(report, delays, rows[marks], force[marks], most_us[marks])
        gaps = np.flatnonzero(~on[:-1] & on[1:] & delays.never_stops(force, most_us) & checked)
        _report_jumps(report, delays, rows[gaps], force[gaps], most_us[gaps])


def _report_marks(report: Reporter, delays: DelaysInForce, rows: Indices, force: Indices, most_us: Floats) -> None:
    """Report marks that are over when their emission begins."""
    none = delays.never_emits(force, most_us)
    for no_emission, lost in (
        (True, Phrase("there is no emission")),
        (False, Phrase("emission begins after the mark")),
    ):
        for with_gap, rule in ((False, rules.DELAY_LONGER_THAN_MARK), (True, rules.GAP_LONGER_THAN_MARK)):
            at = np.flatnonzero((none == no_emission) & ((delays.gap_us[force] > 0) == with_gap))
            fields: dict[str, Any] = {"on": delays.on_us[force[at]], "most": np.round(most_us[at], 3), "lost": lost}
            if with_gap:
                begin_us = (delays.on_us + delays.gap_us)[force[at]]
                fields |= {"gap": delays.gap_us[force[at]], "begin": begin_us}
            report.rows(rule, rows[at], "", **fields)


def _report_jumps(report: Reporter, delays: DelaysInForce, rows: Indices, force: Indices, most_us: Floats) -> None:
    """Report motions between two marks in which emission does not stop."""
    # Where the switch itself does not go off, its delay alone is the reason.
    by_killer = delays.fpk_off_us[force] > 0
    by_killer &= delays.off_us[force] < most_us + delays.on_us[force]
    for with_killer, rule in ((False, rules.DELAY_LONGER_THAN_JUMP), (True, rules.FPK_LONGER_THAN_JUMP)):
        at = np.flatnonzero(by_killer == with_killer)
        fields: dict[str, Any] = {"off": delays.off_us[force[at]], "most": np.round(most_us[at], 3), "word": "LASER ON"}
        if with_killer:
            end_us = (delays.off_us + delays.fpk_off_us)[force[at]]
            fields |= {"killer": delays.fpk_off_us[force[at]], "end": end_us}
        report.rows(rule, rows[at], "", **fields)


class DelaysInForce(Struct, frozen=True, kw_only=True, eq=False):
    """Delays of the switch, and with the first pulse killer of emission after it, (k,) each: from an instant on.

    `instant`: ascending. `lines`: (k, 2), those of LASER DELAY and LASER FPK in force, 0 without one.
    """

    instant: Indices
    on_us: Floats
    off_us: Floats
    gap_us: Floats
    fpk_off_us: Floats
    lines: npt.NDArray[np.intp]

    def at(self, instants: Indices) -> Indices:
        """Number of the delays in force at some instants."""
        return np.searchsorted(self.instant, instants, side="right") - 1

    def never_emits(self, at: Indices, mark_us: Floats) -> Bools:
        """Whether marks of these times have no emission, (k,): edges of the switch, or of emission, meet or cross."""
        on_us, off_us = self.on_us[at], mark_us + self.off_us[at]
        return np.asarray((on_us >= off_us) | (on_us + self.gap_us[at] >= off_us + self.fpk_off_us[at]))

    def never_stops(self, at: Indices, pause_us: Floats) -> Bools:
        """Whether emission goes on over pauses of these times, (k,): edges of switch or emission meet or cross."""
        off_us, on_us = self.off_us[at], pause_us + self.on_us[at]
        of_switch = (off_us >= on_us) & (off_us > 0)
        ends_us = off_us + self.fpk_off_us[at]
        return np.asarray(of_switch | ((ends_us >= on_us + self.gap_us[at]) & (ends_us > 0)))


def delays_in_force(context: LintContext, channel: int) -> DelaysInForce:
    """Find the delays of a channel along the path."""
    instants, lines = [-1], [(0, 0)]
    delay, killer = (0.0, 0.0), (0.0, 0.0)
    found = [(*delay, *killer)]
    for setup in context.job.setups:
        if setup.channel != channel:
            continue
        match setup.statement:
            case LaserDelay(on_delay_us=on, off_delay_us=off):
                delay = (on, off)
                lines.append((setup.line, lines[-1][1]))
            case LaserFpk(times_us=times):
                killer = (0.0, 0.0)
                lines.append((lines[-1][0], setup.line))
                if times is not None:
                    killer = (times[1], times[2])
            case _:
                continue
        instants.append(context.modal.stage_first[setup.order] * 2)
        found.append((*delay, *killer))
    on_us, off_us, gap_us, fpk_off_us = np.array(found).T
    return DelaysInForce(
        instant=np.array(instants, dtype=np.intp),
        on_us=on_us,
        off_us=off_us,
        gap_us=gap_us,
        fpk_off_us=fpk_off_us,
        lines=np.array(lines, dtype=np.intp),
    )


_SKY_MS = 3_000.0
"""Time that sky writing adds to a mark at most: run-in and run-out of 65535 steps of 10 us, and their ramps."""


def longest_run_ms(context: LintContext) -> float:
    """Return a time that the whole job does not exceed: every segment from rest to rest."""
    path = context.path
    timed = np.flatnonzero(path.takes_time)
    marks = np.count_nonzero(path.op == Op.ON) if context.job.has_sky_writing else 0
    total = math.fsum(float(longest_ms(context, timed[part]).sum()) for part in blocks(len(timed)))
    return total + _SKY_MS * marks


def longest_ms(context: LintContext, rows: Indices) -> Floats:
    """The longest time that rows can take: from rest to rest."""
    path = context.path
    length, vel, acc = context.lengths(rows), path.vel[rows], path.acc[rows]
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = length * acc >= vel * vel
        moving = np.where(reached, length / vel + vel / acc, 2 * np.sqrt(length / acc))
    return np.where(
        path.op[rows] == Op.DWELL,
        np.nan_to_num(path.dwell_ms[rows]),
        np.clip(np.nan_to_num(moving, posinf=1e12), 0, 1e12),
    )
