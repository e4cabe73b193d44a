"""Lifting: executed calls to the job that they amount to, the opposite of lowering.

What calls say is in the job: motion, power, switches, modes, delays, stages. What they do not say is not: loops, jumps
(a motion with the laser off is a LINE, too), forced end velocities and sky writing. So the checks of a job hold for
calls that somebody else wrote.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Stream
from gusjob.controllers.gus.execution import AcceptedCall, Execution
from gusjob.controllers.gus.ranges import CHANNELS, PowerMode
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Span
from gusjob.ir.job import Job
from gusjob.ir.path import SPEED_WORDS, Op, Path, Speeds
from gusjob.ir.setup import (
    DistanceFollow,
    LaserDelay,
    LaserDistance,
    LaserFpk,
    LaserMode,
    LaserPrevolt,
    LaserStandby,
    PowerNow,
    Setup,
    SetupStatement,
    SwitchNow,
    Wait,
)
from gusjob.kinematics.arrays import Floats, Indices, carried, changes, fill_gaps, picked, rows_of, unrepeated
from gusjob.kinematics.schedule import stage_numbers
from gusjob.kinematics.units import PowerUnit
from gusjob.lint.reporter import UNIT_OF_MODE

_OPS = {
    Buffered.LINE: Op.LINE,
    Buffered.LINE_TO_REST: Op.LINE,
    Buffered.ARC_CENTRE: Op.ARC_CENTRE,
    Buffered.ARC_RADIUS: Op.ARC_RADIUS,
    Buffered.DELAY: Op.DWELL,
    Buffered.ON: Op.ON,
    Buffered.OFF: Op.OFF,
    Buffered.POWER: Op.POWER,
    Buffered.FOLLOW: Op.FOLLOW,
    Buffered.FOLLOW_REAL: Op.FOLLOW,
    Buffered.FOLLOW_OFF: Op.POWER,
}
"""The operation of each buffered call. After the end of a follow the power is 0. The others are in no job."""
_OP_OF_KIND = np.array([_OPS.get(kind, 0) for kind in Buffered], dtype=np.uint8)
_IS_IN_JOB = np.array([kind in _OPS for kind in Buffered])


def lift(stream: Stream, execution: Execution) -> Job:
    """Make the job that the executed calls of a stream amount to.

    Its rows are the buffered calls that run, in their order; its setup statements the accepted calls between them. A
    call made while a stage moves acts before the stage's first row, and so is written there, but for a switch whose
    time is known.
    """
    kinds = execution.run.calls.kind
    per_stage = [_rows_in_job(kinds, stage.rows) for stage in execution.stages]
    firsts = np.cumsum([0, *map(len, per_stage)])
    rows = per_stage[0] if len(per_stage) == 1 else np.concatenate([np.empty(0, dtype=np.intp), *per_stage])
    calls, of_stage = execution.run.calls.pick(rows_of(rows)), stage_numbers(firsts)
    # Positions of the machine: each GT_SetCrdPrm can move the origin.
    origins = np.array([stage.settings.origin_pulse for stage in execution.stages], dtype=np.float64).reshape(-1, 2)
    if origins.any():
        origin_x, origin_y = (picked(origin, of_stage) for origin in origins.T)
        calls = replace(calls, x=calls.x + origin_x, y=calls.y + origin_y)
    vel_max = picked(np.array([stage.settings.vel_max_pulse_per_ms for stage in execution.stages]), of_stage)
    path, speeds = _path(calls, vel_max)
    setups = _Setups(firsts=firsts.tolist())
    for accepted in execution.accepted:
        # A switch at a known time acts within the stage: here it is in force after the stage.
        timed = accepted.moving and math.isfinite(accepted.call.time_ms - execution.stages[accepted.stage].start_ms)
        later = timed and accepted.call.name == "GT_SetHSIOOpt"
        setups.add(replace(accepted, stage=accepted.stage + 1) if later else accepted)
    places = setups.places

    def locate(line: int, word: str) -> Span:
        return Span(line=places.get((line, word), line))

    return Job(
        name=stream.name,
        path=path,
        speeds=speeds,
        setups=setups.in_order(),
        locate=locate,
        text_of=lambda span: "",
        name_remarks=lambda line, word: (),
        in_pulses=True,
        complete=not any(d.rule in (rules.REFUSED, rules.ARGUMENT_UNDEFINED) for d in execution.diagnostics),
    )


def _rows_in_job(kinds: npt.NDArray[np.uint8], rows: Indices) -> Indices:
    """Find the rows of a stage that are in the job."""
    found = _IS_IN_JOB[kinds[rows]]
    return rows if found.all() else rows[found]


def _path(calls: BufferedCalls, vel_max: Floats) -> tuple[Path, Speeds]:
    """Make the path of buffered calls, and their speeds; `vel_max`: the limit of each call's velocity, (n,)."""
    n = len(calls)
    op = _OP_OF_KIND[calls.kind]
    still = np.flatnonzero(op >= Op.DWELL)
    # A call that does not move stays where the motion before it ended.
    x, y = (_kept(column, still, 0.0) for column in (calls.x, calls.y))
    is_fast = calls.vel > unrepeated(vel_max)
    vel, vel_set = _speed(np.where(is_fast, vel_max, calls.vel) if is_fast.any() else calls.vel, still)
    acc, acc_set = _speed(calls.acc, still)
    arcs, dwells = np.flatnonzero((op == Op.ARC_CENTRE) | (op == Op.ARC_RADIUS)), np.flatnonzero(op == Op.DWELL)
    by_centre, by_radius = arcs[op[arcs] == Op.ARC_CENTRE], arcs[op[arcs] == Op.ARC_RADIUS]
    powers = np.flatnonzero((op == Op.POWER) | (op == Op.FOLLOW))
    follows = op[powers] == Op.FOLLOW
    power = np.where(calls.kind[powers] == Buffered.FOLLOW_OFF, 0.0, calls.p[powers])
    path = Path(
        op=op,
        line=calls.line,
        channel=calls.channel.astype(np.int8) if calls.channel.any() else _all(n, value=np.int8(0)),
        ccw=_at_rows(n, arcs, calls.r[arcs] == 1) if len(arcs) else _all(n, value=False),
        arc_in_mm=_all(n, value=False),
        x=x,
        y=y,
        cx=_of_arcs(n, by_centre, _before(x, by_centre) + calls.p[by_centre]),
        cy=_of_arcs(n, by_centre, _before(y, by_centre) + calls.q[by_centre]),
        radius=_of_arcs(n, by_radius, calls.p[by_radius]),
        vel=vel,
        acc=acc,
        end=_all(n, value=np.nan),
        vel_line=_set_line(calls, vel_set),
        acc_line=_set_line(calls, acc_set),
        vel_in_mm=_all(n, value=False),
        acc_in_mm=_all(n, value=False),
        end_in_mm=_all(n, value=False),
        dwell_ms=_at_rows(n, dwells, calls.p[dwells]),
        power=_at_rows(n, powers, np.where(follows, np.nan, power)),
        low=_at_rows(n, powers, np.where(follows, calls.q[powers], np.nan)),
        high=_at_rows(n, powers, np.where(follows, calls.r[powers], np.nan)),
        ratio=_at_rows(n, powers, np.where(follows, calls.p[powers], np.nan)),
        follow_in_mm=_all(n, value=False),
        power_unit=_all(n, value=np.int8(PowerUnit.NONE)),
        low_unit=_all(n, value=np.int8(PowerUnit.NONE)),
        high_unit=_all(n, value=np.int8(PowerUnit.NONE)),
        provenance=_all(n, value=np.int32(0)),
        unknown_before=_all(n, value=np.int32(0)),
        unknown=_all(n, value=np.int32(0)),
    )
    return path, _speeds(path, vel_set, acc_set)


def _all(n: int, *, value: object) -> npt.NDArray[Any]:
    """Make a column with one value, which takes no memory."""
    return np.broadcast_to(np.asarray(value), n)


def _at_rows(n: int, rows: Indices, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Make a column with values at some rows and 0 elsewhere; NaN if there are none, which takes no memory."""
    if not len(rows):
        return _all(n, value=np.nan)
    column = np.zeros(n, dtype=values.dtype)  # The system gives it memory only where it is written.
    column[rows] = values
    return column


def _of_arcs(n: int, rows: Indices, values: Floats) -> Floats:
    """Make a column with values at some rows and NaN elsewhere."""
    if not len(rows):
        return _all(n, value=np.nan)
    column = np.full(n, np.nan)
    column[rows] = values
    return column


def _kept(column: Floats, gaps: Indices, start: float) -> Floats:
    """Give each of some rows the value of the row before it; `start` where there is none."""
    if not len(gaps):
        return column
    found = column.copy()
    fill_gaps(found, gaps, start)
    return found


def _before(column: Floats, rows: Indices) -> Floats:
    """Return the values in the rows before some rows; 0 before the first."""
    return np.where(rows > 0, column[rows - 1], 0.0)


def _speed(values: Floats, still: Indices) -> tuple[Floats, Indices]:
    """Make a velocity or acceleration, NaN in the rows that do not move, and find the motions at which it changes."""
    kept = _kept(values, still, np.nan)
    changed = changes(kept)
    changed[still] = False
    if len(still):
        kept[still] = np.nan
    return kept, np.flatnonzero(changed)


def _set_line(calls: BufferedCalls, at: Indices) -> npt.NDArray[np.int32]:
    """For each row the line of the first motion with its value, as where a modal word was set, (n,)."""
    return carried(calls.line[at], at, len(calls), calls.line[0] if len(calls) else 0)


def _speeds(path: Path, vel: Indices, acc: Indices) -> Speeds:
    """Make the velocities and accelerations at the rows where they change."""
    rows = np.concatenate([vel, acc])
    words = np.repeat(
        np.array([SPEED_WORDS.index("VEL"), SPEED_WORDS.index("ACC")], dtype=np.int8), [len(vel), len(acc)]
    )
    return Speeds(
        line=path.line[rows],
        word=words,
        value=np.concatenate([path.vel[vel], path.acc[acc]]),
        in_mm=_all(len(rows), value=False),
        inline=_all(len(rows), value=True),
        provenance=_all(len(rows), value=np.int32(0)),
        row=rows,
    )


class _ModeInForce(Struct):
    """Mode of a channel: the statement, its number among the setup statements, and its stage."""

    statement: LaserMode
    number: int
    stage: int


class _Setups(Struct):
    """Setup statements under construction. `firsts`: the first row of each stage, and the number of rows.

    `places`: lines of words that another call sets than the one of their statement, by the statement's line and word.
    """

    firsts: list[int]
    found: list[Setup] = field(default_factory=list)
    places: dict[tuple[int, str], int] = field(default_factory=dict)
    modes: dict[int, _ModeInForce] = field(default_factory=dict)
    carrier_khz: dict[int, float] = field(default_factory=dict)
    width_us: dict[int, float] = field(default_factory=dict)
    distance: dict[int, tuple[Any, bool]] = field(default_factory=dict)
    """Reference and source of distance follow, by channel."""
    ratios: dict[int, Call] = field(default_factory=dict)
    """The last GT_SetLaserDisRatio, by channel."""
    stages: int = 0
    """Number of stages whose begin is known."""

    def add(self, accepted: AcceptedCall) -> None:
        """Add the statement that a call amounts to, if any."""
        call, stage = accepted.call, accepted.stage
        match call.name:
            case "GT_CrdStatus":
                if not accepted.moving and stage > self.stages:
                    self.stages = stage
                    self.append(call, stage, Wait())
            case "GT_Reset":
                self.modes, self.carrier_khz, self.width_us, self.distance, self.ratios = {}, {}, {}, {}, {}
                for channel in CHANNELS:
                    self.append(call, stage, SwitchNow(on=False), channel)
            case "GT_LaserPowerMode":
                self.set_mode(call, stage)
            case "GT_LaserOutFrq":
                self.carrier_khz[_channel(call)] = _number(call, 0)
                self.change_mode(call, stage, "CARRIER")
            case "GT_SetPulseWidth":
                self.width_us[_channel(call)] = _number(call, 0)
                self.change_mode(call, stage, "WIDTH")
            case "GT_SetLaserDisMode" if _number(call, 0) == 1:
                self.distance[_channel(call)] = call.args[2], _number(call, 1) == 1
                ratio = self.ratios.get(_channel(call))
                if ratio is not None:  # Enabled again, it follows with the ratio and the limits that it had.
                    self.append(ratio, stage, LaserDistance(settings=self.follow(ratio)))
            case "GT_SetLaserDisRatio":
                self.ratios[_channel(call)] = call
                self.append(call, stage, LaserDistance(settings=self.follow(call)))
            case _:
                statement = _statement(call)
                if statement is not None:
                    self.append(call, stage, statement)

    def in_order(self) -> tuple[Setup, ...]:
        """Return the statements in the order of their rows."""
        found = sorted(self.found, key=lambda setup: setup.row)
        return tuple(replace(setup, order=order) for order, setup in enumerate(found))

    def append(self, call: Call, stage: int, statement: SetupStatement, channel: int | None = None) -> None:
        """Add a statement; `channel` None: the one of the call."""
        if channel is None:
            channel = 0 if isinstance(statement, Wait) else _channel(call)
        order, row = len(self.found), self.firsts[stage]
        self.found.append(
            Setup(statement=statement, order=order, row=row, line=call.line, channel=channel, word=call.name)
        )

    def set_mode(self, call: Call, stage: int) -> None:
        """Set a mode; the carrier and the laser pulse width stay."""
        channel = _channel(call)
        mode = PowerMode(int(_number(call, 0)))
        statement = self.mode_statement(channel, mode, low=_number(call, 2), high=_number(call, 1))
        self.modes[channel] = _ModeInForce(statement=statement, number=len(self.found), stage=stage)
        self.append(call, stage, statement)

    def mode_statement(self, channel: int, mode: PowerMode, *, low: float, high: float) -> LaserMode:
        """Make the statement of a mode, with the carrier or the laser pulse width if the mode uses it."""
        is_duty, is_frequency = mode in (PowerMode.DUTY, PowerMode.DUTY2), mode is PowerMode.FREQUENCY
        return LaserMode(
            mode=mode,
            low=low,
            high=high,
            carrier_khz=self.carrier_khz.get(channel) if is_duty else None,
            pulse_width_us=self.width_us.get(channel) if is_frequency else None,
        )

    def change_mode(self, call: Call, stage: int, word: str) -> None:
        """Change the mode in force: its own statement if nothing has moved since, else by another one."""
        channel = _channel(call)
        mode = self.modes.get(channel)
        if mode is None:
            return
        before = mode.statement
        mode.statement = self.mode_statement(channel, before.mode, low=before.low, high=before.high)
        if mode.stage != stage:
            mode.number, mode.stage = len(self.found), stage
            self.append(call, stage, mode.statement)
            return
        setup = self.found[mode.number]
        self.found[mode.number] = replace(setup, statement=mode.statement)
        self.places[setup.line, word] = call.line

    def follow(self, call: Call) -> DistanceFollow:
        """Settings of GT_SetLaserDisRatio; its limits are in the unit of the mode in force."""
        channel = _channel(call)
        mode = self.modes.get(channel)
        unit = UNIT_OF_MODE[mode.statement.mode if mode else PowerMode.DUTY]
        reference, actual = self.distance[channel]
        ratio: Any = call.args[0]
        return DistanceFollow(
            reference_pulse=reference,
            ratio_per_mm=ratio,
            low=_number(call, 1),
            high=_number(call, 2),
            low_unit=unit,
            high_unit=unit,
            actual=actual,
        )


def _statement(call: Call) -> SetupStatement | None:
    """The statement of a call that alone makes one."""
    match call.name:
        case "GT_SetLevelDelay":
            return LaserDelay(off_delay_us=_number(call, 0), on_delay_us=_number(call, 1))
        case "GT_SetWaitPulse":
            return LaserStandby(pulse=(_number(call, 1), _number(call, 2)) if _number(call, 0) == 1 else None)
        case "GT_SetPreVltg":
            return LaserPrevolt(prevoltage_v=_number(call, 1) if _number(call, 0) == 1 else None)
        case "GT_EnaFPK":
            return LaserFpk(times_us=(_number(call, 0), _number(call, 1), _number(call, 2)))
        case "GT_DisFPK":
            return LaserFpk(times_us=None)
        case "GT_SetLaserDisMode":
            return LaserDistance(settings=None)
        case "GT_SetHSIOOpt":
            return SwitchNow(on=_number(call, 0) == 1)
        case "GT_LaserPrfCmd":
            return PowerNow(power=_number(call, 0), unit=PowerUnit.NONE)
        case _:
            return None


def _channel(call: Call) -> int:
    """Laser channel of a call: its last argument."""
    return int(_number(call, len(call.args) - 1))


def _number(call: Call, index: int) -> float:
    value = call.args[index]
    assert isinstance(value, float)
    return value
