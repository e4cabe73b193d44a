"""What hurts: light left on, light during a jump, light without a power."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gusjob.diagnostics import model as d
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Remark
from gusjob.i18n.phrases import Phrase
from gusjob.ir.path import Op
from gusjob.ir.setup import LaserDelay, LaserFpk
from gusjob.ir.stages import opens_stage
from gusjob.kinematics.arrays import Floats, Indices
from gusjob.lint.view import CHANNELS, Findings, Remarks, View


def left_on(view: View, findings: Findings) -> None:
    """The job ends with every channel off."""
    for channel in CHANNELS:
        _, _, on, line = view.lit(channel)
        if on:
            hint = f" CHANNEL {channel}" if channel else ""
            findings.add(rules.LEFT_ON, line, channel=channel, hint=hint)


def jumps(view: View, findings: Findings) -> None:
    """JUMP is a move with the laser off."""
    rows = view.rows(Op.JUMP)
    for channel in CHANNELS:
        lit, on_line, _, _ = view.lit(channel)
        bad = rows[lit[rows]]
        findings.at_rows(rules.JUMP_LIT, bad, "", channel=channel, remarks=switched_on(view, on_line[bad]))


def switched_on(view: View, lines: Indices) -> Remarks:
    """Where the laser was switched on, for each of several diagnostics."""

    def remarks(index: int) -> tuple[Remark, ...]:
        return (Remark(text=d.ON_HERE, span=view.job.locate(int(lines[index]), "")),)

    return remarks


def dwells(view: View, findings: Findings) -> None:
    """A dwell with light and motion on both sides burns a point; at the start of a mark it is a pierce."""
    path = view.job.path
    rows = view.rows(Op.DWELL)
    if not len(rows):
        return
    moved, sky = np.concatenate([[0], np.cumsum(path.moves)]), view.job.sky_writing_by_row()[0]
    for channel in CHANNELS:
        lit, on_line, _, _ = view.lit(channel)
        mine = rows[lit[rows]]
        begins = np.flatnonzero(lit & ~np.concatenate([[False], lit[:-1]]))
        ends = np.flatnonzero(lit & ~np.concatenate([lit[1:], [False]])) + 1
        number = np.searchsorted(begins, mine, side="right") - 1
        # Under sky writing light in any dwell is an error already.
        bad = mine[(moved[mine] > moved[begins[number]]) & (moved[ends[number]] > moved[mine]) & (sky[mine] < 0)]
        findings.at_rows(rules.DWELL_LIT, bad, "", channel=channel, remarks=switched_on(view, on_line[bad]))


def waits(view: View, findings: Findings) -> None:
    """Light at the end of a stage stays on until the next one moves."""
    sky = view.job.sky_writing_by_row()[0]  # Under it this is an error already.
    opening = zip(view.job.setups, opens_stage(view.job), strict=True)
    stops = [s for s, opens in opening if opens and sky[s.row - 1] < 0]
    places = np.array([s.row * 2 for s in stops], dtype=np.intp)
    for channel in CHANNELS:
        # LASER OFF NOW is a way to end light, too.
        lit = view.lit_at(channel, places) & view.lit_at(channel, places + 1)
        for i in np.flatnonzero(lit).tolist():
            findings.at(rules.WAIT_LIT, stops[i], word=stops[i].word, channel=channel)


def switching(view: View, findings: Findings) -> None:
    """LASER ON that changes nothing, and light that comes and goes with nothing between."""
    path = view.job.path
    timed = np.concatenate([[0], np.cumsum(path.takes_time)])
    for channel in CHANNELS:
        keys, on, lines = view.switches(channel)
        if not len(keys):
            continue
        before = np.concatenate([[False], on[:-1]])
        begin = lines[np.maximum.accumulate(np.where(on & ~before, np.arange(len(on)), 0))]
        buffered = keys % 2 == 1
        again = np.flatnonzero(on & before & buffered)
        findings.at_rows(
            rules.ALREADY_ON, keys[again] // 2, "", channel=channel, remarks=switched_on(view, begin[again])
        )
        came = timed[(keys + 1) // 2]
        empty = np.flatnonzero(on[:-1] & ~on[1:] & (came[:-1] == came[1:]) & buffered[:-1] & buffered[1:])
        findings.at_rows(rules.LIT_NOTHING, keys[empty] // 2, "", channel=channel)


def burnt_twice(view: View, findings: Findings) -> None:
    """The same segment with light and the same power, from two places in the job; passes of a loop are meant."""
    path = view.job.path
    x0, y0 = view.starts()
    for channel in CHANNELS:
        lit = view.lit(channel)[0]
        rows = np.flatnonzero(path.moves & lit)
        if len(rows) < 2:
            continue
        dose = _dose(view, channel)[rows]
        ax, ay, bx, by = (np.rint(v[rows]) for v in (x0, y0, path.x, path.y))
        turned = (ax > bx) | ((ax == bx) & (ay > by))
        low_x, high_x = np.where(turned, bx, ax), np.where(turned, ax, bx)
        low_y, high_y = np.where(turned, by, ay), np.where(turned, ay, by)
        round_ = path.op[rows] != Op.LINE
        marks = [low_x, low_y, high_x, high_y, dose]
        if round_.any():
            bend = np.where(path.ccw[rows] != turned, 1.0, -1.0)
            arc = [np.rint(np.nan_to_num(v[rows])) for v in (path.cx, path.cy, path.radius)]
            marks += [np.where(round_, v, 0.0) for v in (*arc, bend)]
        key = _mixed(marks)
        ascending = np.sort(key)
        if not (ascending[1:] == ascending[:-1]).any():
            continue
        order = np.argsort(key, kind="stable")
        same = key[order][1:] == key[order][:-1]
        first = order[np.maximum.accumulate(np.where(np.concatenate([[True], ~same]), np.arange(len(order)), 0))]
        again = np.flatnonzero((path.line[rows[order]] != path.line[rows[first]]) & (order != first))
        again = again[(low_x != high_x)[order[again]] | (low_y != high_y)[order[again]] | round_[order[again]]]
        again = again[np.argsort(order[again])]
        bad, earlier = rows[order[again]], path.line[rows[first[again]]]
        findings.at_rows(rules.BURNT_TWICE, bad, "", remarks=_first_here(view, earlier))


def _dose(view: View, channel: int) -> Floats:
    """A number for each row that is the same where mode, power and velocity are the same: another pass is meant."""
    path = view.job.path
    beam = np.zeros(len(path))
    for span in view.modes(channel):
        kept = (span.mode.mode, span.mode.carrier_khz, span.mode.pulse_width_us)
        beam[span.first : span.last] = hash(kept) % 1_000_003
    return _mixed([_power_in_force(view, channel), beam, np.nan_to_num(path.vel)]).astype(np.float64)


def _power_in_force(view: View, channel: int) -> Floats:
    """A number for each row that is the same where the same power is in force."""
    path = view.job.path
    sets = np.flatnonzero(((path.op == Op.POWER) | (path.op == Op.FOLLOW)) & (path.channel == channel))
    if not len(sets):
        return np.zeros(len(path))
    values = [np.nan_to_num(v[sets]) for v in (path.power, path.low, path.high, path.ratio)]
    at = np.searchsorted(sets, np.arange(len(path)), side="left") - 1
    return np.where(at >= 0, _mixed(values).astype(np.float64)[at], 0.0)


def _mixed(columns: list[Floats]) -> npt.NDArray[np.uint64]:
    """A number for each row that hangs on all columns; equal rows are equal, others hardly ever."""
    mixed = np.zeros(len(columns[0]), dtype=np.uint64)
    for column in columns:
        bits = np.ascontiguousarray(column + 0.0).view(np.uint64)
        mixed = (mixed ^ bits) * np.uint64(0x9E3779B97F4A7C15)
        mixed ^= mixed >> np.uint64(29)
    return mixed


def _first_here(view: View, lines: Indices) -> Remarks:
    def remarks(index: int) -> tuple[Remark, ...]:
        return (Remark(text=d.FIRST_HERE, span=view.job.locate(int(lines[index]), "")),)

    return remarks


def delays_against_path(view: View, findings: Findings) -> None:
    """Delays that outlast what they belong to.

    An on delay longer than the whole mark: the light comes when the mark is over, or not at all. An off delay longer
    than the way to the next mark: the light never goes off between. Both against the longest that the path can take.
    """
    path = view.job.path
    timed = np.flatnonzero(path.takes_time)
    sky = np.append(view.job.sky_writing_by_row()[0] >= 0, False)  # It makes up for delays.
    for channel in CHANNELS:
        keys, on, _ = view.switches(channel)
        places, on_us, off_us = _delays_in_force(view, channel)
        if len(places) == 1 or len(keys) < 2:
            continue
        at = np.concatenate([[0.0], np.cumsum(_longest_ms(view, timed))])
        reached = at[np.searchsorted(timed, (keys + 1) // 2)]
        most_us = np.diff(reached) * 1e3
        force = np.searchsorted(places, keys[:-1], side="right") - 1
        ons, offs = on_us[force], off_us[force]
        buffered = (keys % 2 == 1) & np.concatenate([[True], keys[1:] % 2 == 1])
        buffered[:-1] &= ~sky[keys[:-1] // 2]
        marks = np.flatnonzero(on[:-1] & ~on[1:] & (ons > most_us) & (most_us > 0) & buffered[:-1])
        for none, lost in (
            (True, Phrase("no light comes at all")),
            (False, Phrase("light comes when the mark is over")),
        ):
            which = marks[(ons[marks] >= most_us[marks] + offs[marks]) == none]
            findings.at_rows(
                rules.DELAY_TOO_LONG, keys[which] // 2, "", on=ons[which], most=np.round(most_us[which], 3), lost=lost
            )
        gaps = np.flatnonzero(~on[:-1] & on[1:] & (offs >= most_us + ons) & (offs > 0) & (most_us > 0) & buffered[:-1])
        findings.at_rows(
            rules.DELAY_BRIDGES, keys[gaps] // 2, "", off=offs[gaps], on=ons[gaps], most=np.round(most_us[gaps], 3)
        )


def _delays_in_force(view: View, channel: int) -> tuple[Indices, Floats, Floats]:
    """From which place on light begins and ends so much behind the switch: delays and first pulse killer together."""
    places, on_us, off_us = [-1], [0.0], [0.0]
    delay, killer = (0.0, 0.0), (0.0, 0.0)
    for setup in view.job.setups:
        if setup.channel != channel:
            continue
        match setup.statement:
            case LaserDelay(on_delay_us=on, off_delay_us=off):
                delay = (on, off)
            case LaserFpk(times_us=times):
                killer = (0.0, 0.0) if times is None else (times[1], times[2])
            case _:
                continue
        places.append(view.stage_first[setup.order] * 2)
        on_us.append(delay[0] + killer[0])
        off_us.append(delay[1] + killer[1])
    return np.array(places, dtype=np.intp), np.array(on_us), np.array(off_us)


def _longest_ms(view: View, rows: Indices) -> Floats:
    """The longest that rows can take: from rest to rest."""
    path = view.job.path
    length, vel, acc = view.lengths(rows), path.vel[rows], path.acc[rows]
    with np.errstate(divide="ignore", invalid="ignore"):
        reached = length * acc >= vel * vel
        moving = np.where(reached, length / vel + vel / acc, 2 * np.sqrt(length / acc))
    return np.where(
        path.op[rows] == Op.DWELL,
        np.nan_to_num(path.dwell_ms[rows]),
        np.clip(np.nan_to_num(moving, posinf=1e12), 0, 1e12),
    )


def no_power(view: View, findings: Findings) -> None:
    """Light in a motion or dwell, or of the delays alone, while the channel has a mode but no power set since."""
    path = view.job.path
    takes_time = path.takes_time
    for channel in CHANNELS:
        offs = np.flatnonzero((path.op == Op.OFF) & (path.channel == channel))
        places, on_us, off_us = _delays_in_force(view, channel)
        force = np.searchsorted(places, offs * 2, side="right") - 1
        shines = takes_time.copy()
        shines[offs[off_us[force] > on_us[force]]] = True
        timed = np.flatnonzero(shines)
        lit, on_line, _, _ = view.lit(channel)
        keys = view.power_keys(channel)
        changed = None
        for span in view.modes(channel):
            # A LASER MODE that says the same mode again keeps the power.
            changed = span if changed is None or changed.mode.mode is not span.mode.mode else changed
            rows = timed[slice(*np.searchsorted(timed, [span.first, span.last]))]
            rows = rows[lit[rows]]
            if not len(rows):
                continue
            behind = np.searchsorted(keys, rows * 2, side="right") - 1
            unset = (
                (behind < 0) | (keys[behind] < changed.first * 2) if len(keys) else np.ones(len(rows), dtype=np.bool_)
            )
            for line in sorted(set(on_line[rows[unset]].tolist())):
                findings.add(rules.NO_POWER, line, channel=channel, remarks=findings.mode_remark(changed.setup))
