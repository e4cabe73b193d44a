"""Pass: sky writing. Every mark gets a run-in and a run-out: it is at mark speed from its first to its last point.

        jump          run-in          mark               run-out         jump
    ............P-->-->-->-->-->S==================E-->-->-->-->-->Q............
                |  v^2/2a  | 10 us * NPREV |       | 10 us * NPOST |  v^2/2a |

RTC5 manual p. 115: run-in and run-out last 10 us * Nprev and Npost at mark speed. Its set path has no acceleration; a
GUS has, so the way to mark speed lies in front, and the way down behind. Mode 1 comes to P backwards from S, and from Q
back to E; modes 2 and 3 jump to P, and on from Q. What is straight goes on straight, an arc goes on along its circle.
The light is moved along the path in a later pass, when it is known how long everything takes.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gusjob.ir.intent import RunKind
from gusjob.ir.path import SPEED_WORDS, Op
from gusjob.kinematics.arrays import Bools, Floats, Indices
from gusjob.kinematics.geometry import Segments
from gusjob.kinematics.trapezoids import trapezoids
from gusjob.kinematics.units import US_PER_MS
from gusjob.lint.view import CHANNELS
from gusjob.planner.plan import Plan, Sky, rearranged
from gusjob.planner.skywriting.marks import Marks, marks_of
from gusjob.planner.skywriting.points import Leg, Places, places_of
from gusjob.planner.skywriting.runs import Beyond, beyond_of

# Where added rows stand, from the row of their mark: all of it between the mark's neighbours.
_ON, _REVERSE, _REVERSE_FAR, _JUMP, _RUN_IN_FAR, _RUN_IN = -0.45, -0.40, -0.35, -0.30, -0.25, -0.20
_LEG_SHIFTS, _OFF_BEHIND, _PIECE_BEFORE = (-0.16, -0.10, 0.06, 0.12), 0.03, 0.01
"""Of switches that are placed, by Leg; how far off stands behind on; and a piece before the switch at its end."""
_RUN_OUT, _RUN_OUT_FAR, _BACK_FAR, _BACK, _JUMP_BACK, _OFF = 0.20, 0.25, 0.30, 0.35, 0.40, 0.45


def sky_writing(state: Plan) -> Plan:
    """Nothing to do where SKYWRITE is never on."""
    number, settings = state.job.sky_writing_by_row()
    if not settings:
        return state
    marks = marks_of(state, number, settings)
    if not marks.mark.any():
        return state
    assert state.segments is not None
    rows = _Rows(state=state, laid=state.segments, marks=marks)
    rows.runs()
    rows.switches()
    return rows.built()


@dataclass(slots=True, kw_only=True)
class _Rows:
    """The rows of a plan and those that sky writing adds, each with a place among them: row r has place r."""

    state: Plan
    laid: Segments
    marks: Marks
    places: list[Floats] = field(default_factory=list)
    sources: list[Indices] = field(default_factory=list)
    changes: list[dict[str, Any]] = field(default_factory=list)
    moved: list[tuple[Indices, Floats, Floats]] = field(default_factory=list)
    """Rows that end somewhere else now: jumps that go to a run-in."""
    refs: list[tuple[Indices, Indices, Bools, Floats, Bools]] = field(default_factory=list)
    """Rows (the added ones counted behind the job's own) that go by a mark's row, by its start or its end; when their
    effect shall come, us; and whether they are placed already."""
    replaced: list[tuple[Indices, Floats]] = field(default_factory=list)
    """Rows of the job that stand at another place now."""
    outs: tuple[Floats, Floats] = (np.empty(0), np.empty(0))
    """Where the run-outs end, for each timed row."""
    first_pieces: Indices = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    """The row that starts where a mark does, for each timed row."""

    def add(self, rows: Indices, shift: float | Floats, **changes: Any) -> None:
        """Rows like `rows` of the path with some columns changed, `shift` places behind them."""
        if not len(rows):
            return
        self.places.append(np.asarray(rows + shift, dtype=np.float64))
        self.sources.append(rows)
        self.changes.append(changes)

    def runs(self) -> None:
        """The run-ins and run-outs of all marks, and the ways to and from them."""
        marks = self.marks
        begins, ends = np.flatnonzero(marks.begins), np.flatnonzero(marks.ends)
        self.run_in(beyond_of(self.laid, begins, self.way(begins, marks.run_in_us[begins]), ahead=False))
        out_us = self.run_out_us(ends)
        self.run_out(beyond_of(self.laid, ends, self.way(ends, out_us), ahead=True), out_us)

    def way(self, at: Indices, time_us: Floats) -> Floats:
        """How far marks' runs go, pulse: a time at mark speed, and up to it or down from it."""
        vel = self.marks.vel[at]
        return vel * time_us / US_PER_MS + vel * vel / (2 * self.marks.acc[at])

    def run_out_us(self, at: Indices) -> Floats:
        """How long marks' run-outs are at mark speed: longer where motion ends before the light can go off."""
        marks = self.marks
        run_us, lag_us = marks.run_out_us[at], marks.lag_us[at]
        moves_us = run_us + marks.vel[at] / marks.acc[at] * US_PER_MS
        short = np.flatnonzero(self.stands_behind(at) & (marks.mode[at] != 1) & (moves_us < lag_us))
        if len(short):  # A jump back to E may take long enough.
            rows, nothing = self.state.timed[at[short]], np.zeros(len(short))
            (vel, _), (acc, _) = self.jump_speed(rows, "VEL"), self.jump_speed(rows, "ACC")
            back = trapezoids(self.way(at[short], run_us[short]), nothing, vel, nothing, acc)
            longer = moves_us[short] + back.duration_ms * US_PER_MS < lag_us[short]
            run_us[short] = np.where(longer, lag_us[short], run_us[short])
        return run_us

    def stands_behind(self, at: Indices) -> Bools:
        """Whether motion ends behind marks: a dwell, or the end of their stage."""
        dwell = np.append(self.state.path.op[self.state.timed] == Op.DWELL, True)
        return np.asarray(dwell[at + 1] | (np.append(self.marks.stage, -1)[at + 1] != self.marks.stage[at]))

    def run_in(self, run: Beyond) -> None:
        """From P to S; before it to P backwards from S, or by a jump."""
        marks, at = self.marks, run.at
        first = marks.mode[at] == 1
        self.piece(run, first, _REVERSE, RunKind.RUN_IN, run.x, run.y, back=True, smooth=run.leaves)
        self.piece(run, first & run.leaves, _REVERSE_FAR, RunKind.RUN_IN, run.far_x, run.far_y, straight=True)
        self.piece(run, run.leaves, _RUN_IN_FAR, RunKind.RUN_IN, run.x, run.y, straight=True, smooth=True)
        self.piece(run, np.True_, _RUN_IN, RunKind.RUN_IN, *self.starts(at), smooth=True)
        before = self.straight_before(at)
        moves = ~first & (before >= 0)
        self.moved.append((self.state.timed[before[moves]], run.far_x[moves], run.far_y[moves]))
        self.jump(run, ~first & (before < 0), _JUMP, run.far_x, run.far_y)

    def run_out(self, run: Beyond, out_us: Floats) -> None:
        """From E to Q; behind it back to E, where it has to be so."""
        marks, at = self.marks, run.at
        first = marks.mode[at] == 1
        self.outs = (np.zeros(len(marks.mark)), np.zeros(len(marks.mark)))
        self.outs[0][at], self.outs[1][at] = run.x, run.y
        self.piece(run, np.True_, _RUN_OUT, RunKind.RUN_OUT, run.x, run.y, smooth=run.leaves)
        self.piece(run, run.leaves, _RUN_OUT_FAR, RunKind.RUN_OUT, run.far_x, run.far_y, straight=True)
        self.piece(run, first & run.leaves, _BACK_FAR, RunKind.RUN_OUT, run.x, run.y, straight=True, smooth=True)
        self.piece(run, first, _BACK, RunKind.RUN_OUT, *self.ends(at), back=True)
        self.jump(run, ~first & self.must_return(at, out_us), _JUMP_BACK, *self.ends(at))

    def starts(self, at: Indices) -> tuple[Floats, Floats]:
        """Where marks start, not yet rounded: a full circle is one by ending exactly where it starts."""
        rows, path = self.state.timed[at], self.state.path
        return np.append(path.x, 0.0)[rows - 1], np.append(path.y, 0.0)[rows - 1]

    def ends(self, at: Indices) -> tuple[Floats, Floats]:
        """Where marks end, not yet rounded."""
        rows, path = self.state.timed[at], self.state.path
        return path.x[rows], path.y[rows]

    def piece(
        self, run: Beyond, where: Bools | np.bool_, shift: float, kind: RunKind, x: Floats, y: Floats, *,
        straight: bool = False, back: bool = False, smooth: Bools | bool = False,
    ) -> None:  # fmt: skip
        """A piece of the run of the marks in `where`, at mark speed: as they are bent, or `straight`; or `back`."""
        pick = np.broadcast_to(where, len(run.at))
        at = run.at[pick]
        bent = {"op": np.uint8(Op.LINE)} if straight else self.bent(at, back=back)
        self.add(
            self.state.timed[at], shift, x=x[pick], y=y[pick], end=np.nan, **bent,
            **self.mark_speed(at), run=np.int8(kind), smooth=np.broadcast_to(smooth, len(run.at))[pick],
        )  # fmt: skip

    @property
    def as_written(self) -> bool:
        """Whether marks run at the velocity and acceleration of their rows, nothing slowed and nothing scaled."""
        return self.state.machine.equal_axes and not len(self.laid.arc_at)

    def mark_speed(self, at: Indices) -> dict[str, Any]:
        """Columns for rows at marks' speed, where these are not their rows' own."""
        if self.as_written:
            return {}
        return {"vel": self.marks.vel[at], "acc": self.marks.acc[at], "vel_in_mm": False, "acc_in_mm": False}

    def bent(self, at: Indices, *, back: bool) -> dict[str, Any]:
        """Marks' own lines or circles, these about their centre: by radius a centre is lost near half a turn."""
        round_, arcs = self.laid.arcs_among(at)
        if not len(round_):
            return {"op": np.uint8(Op.LINE)}
        op, centre = np.full(len(at), Op.LINE, dtype=np.uint8), np.full((2, len(at)), np.nan)
        op[round_], centre[:, round_] = Op.ARC_CENTRE, (arcs.cx, arcs.cy)
        ccw = self.state.path.ccw[self.state.timed[at]] != back
        return {"op": op, "ccw": ccw, "cx": centre[0], "cy": centre[1]}

    def jump(self, run: Beyond, where: Bools, shift: float, x: Floats, y: Floats) -> None:
        """Jumps that are not the job's own, at the JUMPVEL and JUMPACC in force."""
        rows = self.state.timed[run.at[where]]
        vel, vel_in_mm = self.jump_speed(rows, "VEL")
        acc, acc_in_mm = self.jump_speed(rows, "ACC")
        self.add(
            rows, shift, op=np.uint8(Op.JUMP), x=x[where], y=y[where], end=np.nan,
            vel=vel, acc=acc, vel_in_mm=vel_in_mm, acc_in_mm=acc_in_mm,
        )  # fmt: skip

    def jump_speed(self, rows: Indices, word: str) -> tuple[Floats, Bools]:
        """JUMPVEL or JUMPACC in force at marks' rows, by default VEL or ACC; and whether it was written in mm."""
        path, written = self.state.path, self.state.job.speeds
        own, own_mm = (path.vel, path.vel_in_mm) if word == "VEL" else (path.acc, path.acc_in_mm)
        which = np.flatnonzero(written.word == SPEED_WORDS.index(f"JUMP{word}"))
        if not len(which):
            return own[rows], own_mm[rows]
        job_rows = rows if self.state.origin is None else self.state.origin[rows]
        last = np.searchsorted(written.row[which], job_rows, side="right") - 1
        at = which[last]
        return np.where(last >= 0, written.value[at], own[rows]), np.where(last >= 0, written.in_mm[at], own_mm[rows])

    def straight_before(self, at: Indices) -> Indices:
        """The dark straight motion that leads to each mark, dwells apart, as timed row; -1 where there is none."""
        marks, op = self.marks, self.state.path.op[self.state.timed]
        moving = np.maximum.accumulate(np.where(op == Op.DWELL, -1, np.arange(len(op))))
        before = np.where(at > 0, moving[at - 1], -1)
        dark = (op == Op.JUMP) | ((op == Op.LINE) & ~marks.lit[0] & ~marks.lit[1])
        leads = (before >= 0) & dark[before] & (marks.stage[before] == marks.stage[at])
        return np.where(leads, before, -1)

    def must_return(self, at: Indices, out_us: Floats) -> Bools:
        """Whether the head has to be at a mark's end again: what follows starts there, or the light needs the time."""
        marks, op = self.marks, self.state.path.op[self.state.timed]
        count = len(op)
        moving = np.minimum.accumulate(np.where(op == Op.DWELL, count, np.arange(count))[::-1])[::-1]
        after = np.append(moving, [count, count])[at + 1]
        free = np.append(
            (marks.begins & (marks.mode != 1)) | (op == Op.JUMP) | ((op == Op.LINE) & ~marks.lit[0] & ~marks.lit[1]),
            True,
        )
        moves_us = out_us + marks.vel[at] / marks.acc[at] * US_PER_MS
        return np.asarray(~free[after] | (self.stands_behind(at) & (moves_us < marks.lag_us[at])))

    def switches(self) -> None:
        """Light goes off and on again at a corner where the path is broken; what acts in between goes by its mark."""
        path, timed, marks = self.state.path, self.state.timed, self.marks
        for channel in CHANNELS:
            lit = marks.lit[channel]
            if not lit.any():
                continue
            lit_before, lit_after = np.append(False, lit[:-1]), np.append(lit[1:], False)
            begin = np.flatnonzero(marks.mark & lit & (marks.begins | ~lit_before))
            end = np.flatnonzero(marks.mark & lit & (marks.ends | ~lit_after))
            mine = path.channel == channel
            on, off = np.flatnonzero((path.op == Op.ON) & mine), np.flatnonzero((path.op == Op.OFF) & mine)
            # The last ON before a mark, the first OFF behind it; where none stands right there, one is added.
            places = places_of(self.state, marks, self.laid, self.outs, channel)
            self.split(places)
            found_on = np.append(on, -1)[np.searchsorted(on, timed[begin]) - 1]
            self.switch(Op.ON, channel, begin, found_on, found_on > np.append(timed, -1)[begin - 1], places)
            found_off = np.append(off, len(path))[np.searchsorted(off, timed[end])]
            self.switch(Op.OFF, channel, end, found_off, found_off < np.append(timed, len(path))[end + 1], places)
            self.powers(np.flatnonzero(((path.op == Op.POWER) | (path.op == Op.FOLLOW)) & mine), off, lit)

    def powers(self, rows: Indices, off: Indices, lit: Bools) -> None:
        """Powers set inside a mark that goes on, or behind its end with the light still on, come with the beam."""
        timed, marks = self.state.timed, self.marks
        behind = np.searchsorted(timed, rows)
        inside = np.append(marks.joined, False)[behind]
        before = np.maximum(behind - 1, 0)
        still_on = np.searchsorted(off, rows) == np.searchsorted(off, timed[before])
        ended = (behind > 0) & (marks.ends & lit)[before] & still_on & ~inside
        for where, at, at_end in ((inside, behind, False), (ended, before, True)):
            ref = at[where]
            none = np.zeros(len(ref), dtype=np.bool_)
            self.refs.append((rows[where], timed[ref], np.full(len(ref), at_end), marks.lag_us[ref], none))

    def switch(self, op: Op, channel: int, at: Indices, found: Indices, has: Bools, places: Places) -> None:
        """The switch rows of a channel for marks: those found, and new ones; where it is known, in their place."""
        off = op is Op.OFF
        edge_us = (self.marks.lag_us if off else self.marks.on_us)[at]
        rows, known = self.state.timed[at], places.known[at]
        refs = rows.copy() if off else self.first_pieces[at]
        leg = (places.off if off else places.on).leg[at]
        shift = np.where(known, np.array(_LEG_SHIFTS)[leg] + (_OFF_BEHIND if off else 0.0), _OFF if off else _ON)
        added = self.count + np.cumsum(~has) - 1
        self.refs.append((np.where(has, found, added), refs, np.full(len(at), off), edge_us, known))
        self.add(rows[~has], shift[~has], op=np.uint8(op), channel=np.int8(channel))
        here = has & known
        self.replaced.append((found[here], np.asarray(rows[here] + shift[here], dtype=np.float64)))

    def split(self, places: Places) -> None:
        """The pieces in front of the switches that are placed, as rows of their own."""
        self.first_pieces = self.state.timed.copy()
        for side, behind in ((places.off, _OFF_BEHIND), (places.on, 0.0)):
            for leg, run in ((Leg.MARK, RunKind.RUN_IN), (Leg.RUN_OUT, RunKind.RUN_OUT)):
                at = np.flatnonzero(places.known & (side.leg == leg))
                if leg is Leg.MARK:
                    self.first_pieces[at] = self.count + np.arange(len(at))
                self.add(
                    self.state.timed[at], _LEG_SHIFTS[leg] + behind - _PIECE_BEFORE, op=np.uint8(Op.LINE), end=np.nan,
                    x=side.x[at], y=side.y[at], **self.mark_speed(at), run=np.int8(run), smooth=True,
                )  # fmt: skip

    @property
    def count(self) -> int:
        """How many rows there are so far."""
        return len(self.state.path) + sum(map(len, self.sources))

    def built(self) -> Plan:
        """The plan with all of its rows in order."""
        path, n = self.state.path, len(self.state.path)
        source = np.concatenate([np.arange(n), *self.sources])
        place = np.arange(n, dtype=np.float64)
        for rows, at in self.replaced:
            place[rows] = at
        order = np.argsort(np.concatenate([place, *self.places]), kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        own: dict[str, npt.NDArray[Any]] = {
            "x": path.x.copy(), "y": path.y.copy(),
            "run": np.full(n, RunKind.NONE, dtype=np.int8), "smooth": np.zeros(n, dtype=np.bool_),
        }  # fmt: skip
        for rows, x, y in self.moved:
            own["x"][rows], own["y"][rows] = x, y
        own["smooth"][self.state.timed[self.marks.ends]] = True
        own["smooth"][self.state.timed[:-1][self.marks.bent[1:]]] = True
        mark = self.state.timed[self.marks.mark]
        if not self.as_written:
            own["vel"], own["vel_in_mm"] = path.vel.copy(), path.vel_in_mm.copy()
            own["vel"][mark], own["vel_in_mm"][mark] = self.marks.vel[self.marks.mark], False
        # What of a mark is dark lies before its light.
        own["run"][mark] = RunKind.RUN_IN
        columns = {
            name: self.column(name, own[name] if name in own else getattr(path, name))[order]
            for name in {*own, *(name for change in self.changes for name in change)}
            if name in own or not self.is_constant(name)
        }
        run, smooth = columns.pop("run"), columns.pop("smooth")
        longer = rearranged(self.state, source[order], columns)
        return replace(longer, sky=self.sky(run, smooth, rank))

    def is_constant(self, name: str) -> bool:
        """Whether a column is one value in all rows, the added ones too."""
        own = getattr(self.state.path, name)
        changed = [change[name] for change in self.changes if name in change]
        return own.strides == (0,) and all(np.array_equal(np.unique(c), own[:1], equal_nan=True) for c in changed)

    def column(self, name: str, own: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """A column of the job's own rows, and behind it that of the added ones: changed, or their source's."""
        parts = [own]
        for change, rows in zip(self.changes, self.sources, strict=True):
            value = change.get(name, 0 if name in ("run", "smooth") else own[rows])
            parts.append(np.broadcast_to(np.asarray(value, dtype=own.dtype), len(rows)))
        return np.concatenate(parts)

    def sky(self, run: npt.NDArray[np.int8], smooth: Bools, rank: Indices) -> Sky:
        """What the later passes need, of the rows at their new ranks."""
        row, ref, at_end, edge_us, placed = (np.concatenate(parts) for parts in zip(*self.refs, strict=True))
        row, ref = rank[row], rank[ref]
        return Sky(run=run, smooth=smooth, row=row, ref=ref, at_end=at_end, edge_us=edge_us, placed=placed)
