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

from gusjob.checks.view import CHANNELS, view_of
from gusjob.geometry import TURN, Arcs, Segments
from gusjob.job import SPEED_WORDS, Op, SkyWriting
from gusjob.motion import trapezoids
from gusjob.planner.layout import layout
from gusjob.planner.plan import Plan, Sky, rearranged
from gusjob.planner.sky_field import outside_field
from gusjob.planner.velocity import corner_jump, path_velocity
from gusjob.stream import Run
from gusjob.units import US_PER_MS

Floats = npt.NDArray[np.float64]
Indices = npt.NDArray[np.intp]
Bools = npt.NDArray[np.bool_]

_HALF_PULSE = 0.7072
"""By how much a whole pulse may lie beside the point it stands for: half the diagonal."""
_LONGER_PULSE = (0.0, 0.75, 1.5, 2.25, 3.0, 4.0)
"""What is tried to make an arc long enough whose ends and centre are rounded."""
_SAME_CORNER = 1e-9

# Where added rows stand, from the row of their mark: all of it between the mark's neighbours.
_ON, _REVERSE, _REVERSE_FAR, _JUMP, _RUN_IN_FAR, _RUN_IN = -0.45, -0.40, -0.35, -0.30, -0.25, -0.20
_RUN_OUT, _RUN_OUT_FAR, _BACK_FAR, _BACK, _JUMP_BACK, _OFF = 0.20, 0.25, 0.30, 0.35, 0.40, 0.45


def sky_writing(state: Plan) -> Plan:
    """Nothing to do where SKYWRITE is never on."""
    number, settings = state.job.sky_of_rows()
    if not settings:
        return state
    marks = _marks_of(state, number, settings)
    if not marks.mark.any():
        return state
    assert state.segments is not None
    rows = _Rows(state=state, laid=state.segments, marks=marks)
    rows.runs()
    rows.switches()
    return outside_field(rows.built())


@dataclass(frozen=True, slots=True, kw_only=True)
class _Marks:
    """The timed rows of a plan as sky writing sees them, (m,) each.

    mark: is sky-written; joined: goes on from the mark before it without a break; lit: by channel. mode, timings (us)
    and corner limit of its SKYWRITE. vel, acc: pulse/ms (2), at which it is run.
    """

    mark: Bools
    joined: Bools
    lit: tuple[Bools, Bools]
    stage: Indices
    mode: Floats
    lag_us: Floats
    on_us: Floats
    run_in_us: Floats
    run_out_us: Floats
    vel: Floats
    acc: Floats

    @property
    def begins(self) -> Bools:
        """Marks that get a run-in."""
        return self.mark & ~self.joined

    @property
    def ends(self) -> Bools:
        """Marks that get a run-out."""
        return np.asarray(self.mark & ~np.append(self.joined[1:], False))


def _marks_of(state: Plan, number: Indices, settings: tuple[SkyWriting, ...]) -> _Marks:
    path, timed, laid = state.path, state.timed, state.segments
    assert laid is not None
    job_rows = timed if state.origin is None else state.origin[timed]
    view = view_of(state.job, state.machine)
    lit = (view.lit(0)[0][job_rows], view.lit(1)[0][job_rows])
    sky = number[job_rows]
    op = path.op[timed]
    mark = (sky >= 0) & (lit[0] | lit[1]) & (op != Op.JUMP) & (op != Op.DWELL)

    def of(name: str) -> Floats:
        # Rows without sky writing read the 0 at the end.
        return np.array([*(float(getattr(s, name)) for s in settings), 0.0])[sky]

    mode = of("mode")
    stage = np.searchsorted([s.first for s in state.stages], timed, side="right") - 1
    together = mark[1:] & mark[:-1] & (stage[1:] == stage[:-1]) & (sky[1:] == sky[:-1])
    # The pieces of an arc that became lines are one mark.
    pieces = (path.line[timed[1:]] == path.line[timed[:-1]]) & (path.trail[timed[1:]] == path.trail[timed[:-1]])
    pieces &= op[1:] == Op.LINE
    flat = np.zeros(len(together), dtype=np.bool_)
    asked = np.flatnonzero(together & (mode[1:] == 3))
    flat[asked] = _cosines(state, laid, asked) >= of("limit")[asked + 1] - _SAME_CORNER
    return _Marks(
        mark=mark,
        joined=np.concatenate([[False], together & (pieces | flat)])[: len(mark)],
        lit=lit,
        stage=stage,
        mode=mode,
        lag_us=of("lag_us"),
        on_us=of("on_us"),
        run_in_us=of("run_in_us"),
        run_out_us=of("run_out_us"),
        vel=path_velocity(state, corner_jump(state)),
        acc=state.acc,
    )


def _cosines(state: Plan, laid: Segments, at: Indices) -> Floats:
    """Cosine of the angle, on the part, by which the path turns behind timed rows."""
    px, py = state.machine.pulses_per_mm
    out_x, out_y, in_x, in_y = (
        laid.end_x[at] / px,
        laid.end_y[at] / py,
        laid.start_x[at + 1] / px,
        laid.start_y[at + 1] / py,
    )
    return np.asarray((out_x * in_x + out_y * in_y) / (np.hypot(out_x, out_y) * np.hypot(in_x, in_y)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Run:
    """The way beyond one end of marks `at`, (k,) each: along the mark's own line or circle to (x, y), in whole pulses.

    Where it would go round more than half of its circle it leaves it there, straight on to (far_x, far_y): `leaves`.
    """

    at: Indices
    x: Floats
    y: Floats
    leaves: Bools
    far_x: Floats
    far_y: Floats


def _run(laid: Segments, at: Indices, length: Floats, *, ahead: bool) -> _Run:
    """The way beyond the ends of marks (`ahead`), or before their starts."""
    from_x, from_y = (laid.x1[at], laid.y1[at]) if ahead else (laid.x0[at], laid.y0[at])
    way = 1.0 if ahead else -1.0
    dx, dy = (laid.end_x[at], laid.end_y[at]) if ahead else (laid.start_x[at], laid.start_y[at])
    x, y = _beyond(from_x, from_y, way * dx, way * dy, length)
    far_x, far_y, leaves = x, y, np.zeros(len(at), dtype=np.bool_)
    if len(laid.arc_at):
        number = np.minimum(np.searchsorted(laid.arc_at, at), len(laid.arc_at) - 1)
        round_ = np.flatnonzero(laid.arc_at[number] == at)
        arcs = laid.arcs.pick(number[round_])
        sense = np.sign(arcs.sweep) * way
        begin = arcs.angle + (arcs.sweep if ahead else 0.0)
        half_turn = np.pi * arcs.radius
        along = np.minimum(length[round_], half_turn)
        x[round_], y[round_] = _along(arcs, begin, sense, along, from_x[round_], from_y[round_], ahead=ahead)
        rest = length[round_] - along
        leaves[round_] = rest > 0
        angle = begin + sense * along / arcs.radius
        far_x, far_y = x.copy(), y.copy()
        far_x[round_], far_y[round_] = _beyond(
            x[round_], y[round_], -np.sin(angle) * sense, np.cos(angle) * sense, rest
        )
    return _Run(at=at, x=x, y=y, leaves=leaves, far_x=far_x, far_y=far_y)


def _along(
    arcs: Arcs, begin: Floats, sense: Floats, length: Floats, from_x: Floats, from_y: Floats, *, ahead: bool
) -> tuple[Floats, Floats]:
    """Whole pulses at least a length away along circles, as arcs about their rounded centres measure it."""
    cx, cy = np.rint(arcs.cx), np.rint(arcs.cy)
    here = np.arctan2(from_y - cy, from_x - cx)
    x, y = from_x.copy(), from_y.copy()
    short = np.ones(len(x), dtype=np.bool_)
    for longer in _LONGER_PULSE:
        angle = begin + sense * (length + longer) / arcs.radius
        x[short] = (np.rint(arcs.cx + arcs.radius * np.cos(angle)) + 0.0)[short]
        y[short] = (np.rint(arcs.cy + arcs.radius * np.sin(angle)) + 0.0)[short]
        sweep = ((np.arctan2(y - cy, x - cx) - here) * sense) % TURN
        radius = np.hypot(from_x - cx, from_y - cy) if ahead else np.hypot(x - cx, y - cy)
        short &= sweep * radius < length
    return x, y


def _beyond(x: Floats, y: Floats, dx: Floats, dy: Floats, length: Floats) -> tuple[Floats, Floats]:
    """Whole pulses at least a length away in a direction: a run-in that rounding shortens would miss its speed."""
    to_x, to_y = np.rint(x + dx * length), np.rint(y + dy * length)
    short = np.hypot(to_x - x, to_y - y) < length - 1e-6
    more = length + _HALF_PULSE
    return (
        np.where(short, np.rint(x + dx * more), to_x) + 0.0,
        np.where(short, np.rint(y + dy * more), to_y) + 0.0,
    )


@dataclass(slots=True, kw_only=True)
class _Rows:
    """The rows of a plan and those that sky writing adds, each with a place among them: row r has place r."""

    state: Plan
    laid: Segments
    marks: _Marks
    places: list[Floats] = field(default_factory=list)
    sources: list[Indices] = field(default_factory=list)
    changes: list[dict[str, Any]] = field(default_factory=list)
    moved: list[tuple[Indices, Floats, Floats]] = field(default_factory=list)
    """Rows that end somewhere else now: jumps that go to a run-in."""
    refs: list[tuple[Indices, Indices, Bools, Floats]] = field(default_factory=list)
    """Rows (the added ones counted behind the job's own) that go by a mark's row, by its start or its end, and when
    their effect shall come, us."""

    def add(self, rows: Indices, shift: float, **changes: Any) -> None:
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
        self.run_in(_run(self.laid, begins, self.way(begins, marks.run_in_us[begins]), ahead=False))
        out_us = self.run_out_us(ends)
        self.run_out(_run(self.laid, ends, self.way(ends, out_us), ahead=True), out_us)

    def way(self, at: Indices, time_us: Floats) -> Floats:
        """How far marks' runs go, pulse: a time at mark speed, and up to it or down from it."""
        vel = self.marks.vel[at]
        return vel * time_us / US_PER_MS + vel * vel / (2 * self.marks.acc[at])

    def run_out_us(self, at: Indices) -> Floats:
        """How long marks' run-outs are at mark speed: longer where motion ends before the light can go off."""
        marks, rows = self.marks, self.state.timed[at]
        run_us, lag_us = marks.run_out_us[at], marks.lag_us[at]
        (vel, _), (acc, _) = self.jump_speed(rows, "VEL"), self.jump_speed(rows, "ACC")
        way, nothing = self.way(at, run_us), np.zeros(len(at))
        back_ms = trapezoids(way, nothing, vel, nothing, acc).duration_ms
        moves_us = run_us + (marks.vel[at] / marks.acc[at] + back_ms) * US_PER_MS
        return np.where(self.stands_behind(at) & (marks.mode[at] != 1) & (moves_us < lag_us), lag_us, run_us)

    def stands_behind(self, at: Indices) -> Bools:
        """Whether motion ends behind marks: a dwell, or the end of their stage."""
        dwell = np.append(self.state.path.op[self.state.timed] == Op.DWELL, True)
        return np.asarray(dwell[at + 1] | (np.append(self.marks.stage, -1)[at + 1] != self.marks.stage[at]))

    def run_in(self, run: _Run) -> None:
        """From P to S; before it to P backwards from S, or by a jump."""
        marks, at = self.marks, run.at
        first = marks.mode[at] == 1
        self.piece(run, first, _REVERSE, Run.RUN_IN, run.x, run.y, back=True, smooth=run.leaves)
        self.piece(run, first & run.leaves, _REVERSE_FAR, Run.RUN_IN, run.far_x, run.far_y, straight=True)
        self.piece(run, run.leaves, _RUN_IN_FAR, Run.RUN_IN, run.x, run.y, straight=True, smooth=True)
        self.piece(run, np.True_, _RUN_IN, Run.RUN_IN, *self.starts(at), smooth=True)
        before = self.straight_before(at)
        moves = ~first & (before >= 0)
        self.moved.append((self.state.timed[before[moves]], run.far_x[moves], run.far_y[moves]))
        self.jump(run, ~first & (before < 0), _JUMP, run.far_x, run.far_y)

    def run_out(self, run: _Run, out_us: Floats) -> None:
        """From E to Q; behind it back to E, where it has to be so."""
        marks, at = self.marks, run.at
        first = marks.mode[at] == 1
        self.piece(run, np.True_, _RUN_OUT, Run.RUN_OUT, run.x, run.y, smooth=run.leaves)
        self.piece(run, run.leaves, _RUN_OUT_FAR, Run.RUN_OUT, run.far_x, run.far_y, straight=True)
        self.piece(run, first & run.leaves, _BACK_FAR, Run.RUN_OUT, run.x, run.y, straight=True, smooth=True)
        self.piece(run, first, _BACK, Run.RUN_OUT, *self.ends(at), back=True)
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
        self, run: _Run, where: Bools | np.bool_, shift: float, kind: Run, x: Floats, y: Floats, *,
        straight: bool = False, back: bool = False, smooth: Bools | bool = False,
    ) -> None:  # fmt: skip
        """A piece of the run of the marks in `where`, at mark speed: as they are bent, or `straight`; or `back`."""
        pick = np.broadcast_to(where, len(run.at))
        at = run.at[pick]
        bent = {"op": np.uint8(Op.LINE)} if straight else self.bent(at, back=back)
        self.add(
            self.state.timed[at], shift, x=x[pick], y=y[pick], end=np.nan, **bent,
            vel=self.marks.vel[at], acc=self.marks.acc[at], vel_in_mm=False, acc_in_mm=False,
            run=np.int8(kind), smooth=np.broadcast_to(smooth, len(run.at))[pick],
        )  # fmt: skip

    def bent(self, at: Indices, *, back: bool) -> dict[str, Any]:
        """Marks' own lines or circles, these about their centre: by radius a centre is lost near half a turn."""
        arcs, arc_at, path = self.laid.arcs, self.laid.arc_at, self.state.path
        if not len(arc_at):
            return {"op": np.uint8(Op.LINE)}
        number = np.minimum(np.searchsorted(arc_at, at), len(arc_at) - 1)
        round_ = arc_at[number] == at
        return {
            "op": np.where(round_, Op.ARC_CENTRE, Op.LINE), "ccw": path.ccw[self.state.timed[at]] != back,
            "cx": arcs.cx[number], "cy": arcs.cy[number],
        }  # fmt: skip

    def jump(self, run: _Run, where: Bools, shift: float, x: Floats, y: Floats) -> None:
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
        last = np.searchsorted(written.at[which], job_rows, side="right") - 1
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
            lit_before, lit_after = np.append(False, lit[:-1]), np.append(lit[1:], False)
            begin = np.flatnonzero(marks.mark & lit & (marks.begins | ~lit_before))
            end = np.flatnonzero(marks.mark & lit & (marks.ends | ~lit_after))
            mine = path.channel == channel
            on, off = np.flatnonzero((path.op == Op.ON) & mine), np.flatnonzero((path.op == Op.OFF) & mine)
            # The last ON before a mark, the first OFF behind it; where none stands right there, one is added.
            found_on = np.append(on, -1)[np.searchsorted(on, timed[begin]) - 1]
            self.switch(Op.ON, channel, begin, found_on, found_on > np.append(timed, -1)[begin - 1])
            found_off = np.append(off, len(path))[np.searchsorted(off, timed[end])]
            self.switch(Op.OFF, channel, end, found_off, found_off < np.append(timed, len(path))[end + 1])
        powers = np.flatnonzero((path.op == Op.POWER) | (path.op == Op.FOLLOW))
        inside = np.searchsorted(timed, powers)
        in_mark = np.append(marks.joined, False)[inside]
        at = inside[in_mark]
        self.refs.append((powers[in_mark], timed[at], np.zeros(len(at), dtype=np.bool_), marks.lag_us[at]))

    def switch(self, op: Op, channel: int, at: Indices, found: Indices, has: Bools) -> None:
        """The switch rows of a channel for marks: those found, and new ones."""
        off, path = op is Op.OFF, self.state.path
        edge_us = (self.marks.lag_us if off else self.marks.on_us)[at]
        rows = self.state.timed[at]
        added = len(path) + sum(map(len, self.sources)) + np.cumsum(~has) - 1
        self.refs.append((np.where(has, found, added), rows, np.full(len(at), off), edge_us))
        self.add(rows[~has], _OFF if off else _ON, op=np.uint8(op), channel=np.int8(channel))

    def built(self) -> Plan:
        """The plan with all of its rows in order, laid out again."""
        path, n = self.state.path, len(self.state.path)
        source = np.concatenate([np.arange(n), *self.sources])
        order = np.argsort(np.concatenate([np.arange(n, dtype=np.float64), *self.places]), kind="stable")
        rank = np.empty_like(order)
        rank[order] = np.arange(len(order))
        own: dict[str, npt.NDArray[Any]] = {
            "x": path.x.copy(), "y": path.y.copy(),
            "run": np.full(n, Run.NONE, dtype=np.int8), "smooth": np.zeros(n, dtype=np.bool_),
        }  # fmt: skip
        for rows, x, y in self.moved:
            own["x"][rows], own["y"][rows] = x, y
        own["smooth"][self.state.timed[self.marks.ends]] = True
        mark = self.state.timed[self.marks.mark]
        own["vel"], own["vel_in_mm"] = path.vel.copy(), path.vel_in_mm.copy()
        own["vel"][mark], own["vel_in_mm"][mark] = self.marks.vel[self.marks.mark], False
        # What of a mark is dark lies before its light.
        own["run"][mark] = Run.RUN_IN
        columns = {
            name: self.column(name, own[name] if name in own else getattr(path, name))[order]
            for name in {*own, *(name for change in self.changes for name in change)}
            if name in own or not self.is_constant(name)
        }
        run, smooth = columns.pop("run"), columns.pop("smooth")
        longer = rearranged(self.state, source[order], columns)
        return layout(replace(longer, sky=self.sky(run, smooth, rank)))

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
        row, ref, at_end, edge_us = (np.concatenate(parts) for parts in zip(*self.refs, strict=True))
        row, ref = rank[row], rank[ref]
        order = np.argsort(row)
        return Sky(run=run, smooth=smooth, row=row[order], ref=ref[order], at_end=at_end[order], edge_us=edge_us[order])
