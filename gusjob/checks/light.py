"""What hurts: light left on, light during a jump, light without a power."""

from __future__ import annotations

import numpy as np

from gusjob import diagnostics as d
from gusjob.checks.view import CHANNELS, Findings, Indices, Remarks, View
from gusjob.diagnostics import Remark
from gusjob.job import Op


def left_on(view: View, findings: Findings) -> None:
    """The job ends with every channel off."""
    for channel in CHANNELS:
        _, _, on, line = view.lit(channel)
        if on:
            hint = f" CHANNEL {channel}" if channel else ""
            findings.add(d.LEFT_ON, line, channel=channel, hint=hint)


def jumps(view: View, findings: Findings) -> None:
    """JUMP is a move with the laser off."""
    rows = view.rows(Op.JUMP)
    for channel in CHANNELS:
        lit, on_line, _, _ = view.lit(channel)
        bad = rows[lit[rows]]
        findings.at_rows(d.JUMP_LIT, bad, "", channel=channel, remarks=switched_on(view, on_line[bad]))


def switched_on(view: View, lines: Indices) -> Remarks:
    """Where the laser was switched on, for each of several faults."""

    def remarks(index: int) -> tuple[Remark, ...]:
        return (Remark(text=d.ON_HERE, span=view.job.locate(int(lines[index]), "")),)

    return remarks


def no_power(view: View, findings: Findings) -> None:
    """Light in a motion or dwell while the channel has a mode but no power set since."""
    path = view.job.path
    timed = np.flatnonzero(path.takes_time)
    for channel in CHANNELS:
        lit, on_line, _, _ = view.lit(channel)
        keys = view.power_keys(channel)
        changed = None
        for span in view.modes(channel):
            # A LASER MODE that says the same mode again keeps the power.
            changed = span if changed is None or changed.mode.mode is not span.mode.mode else changed
            rows = timed[(timed >= span.first) & (timed < span.last)]
            rows = rows[lit[rows]]
            if not len(rows):
                continue
            behind = np.searchsorted(keys, rows * 2, side="right") - 1
            unset = (
                (behind < 0) | (keys[behind] < changed.first * 2) if len(keys) else np.ones(len(rows), dtype=np.bool_)
            )
            for line in sorted(set(on_line[rows[unset]].tolist())):
                findings.add(d.NO_POWER, line, channel=channel, remarks=findings.mode_remark(changed.setup))
