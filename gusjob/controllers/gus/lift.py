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
from gusjob.kinematics.arrays import Bools, Floats, Indices
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
    per_stage = [stage.rows[_IS_IN_JOB[kinds[stage.rows]]] for stage in execution.stages]
    counts = np.array([len(rows) for rows in per_stage], dtype=np.intp)
    rows = np.concatenate(per_stage) if per_stage else np.empty(0, dtype=np.intp)
    calls = execution.run.calls.pick(rows)
    # Positions of the machine: each GT_SetCrdPrm can move the origin.
    origins = np.array([stage.settings.origin_pulse for stage in execution.stages], dtype=np.float64).reshape(-1, 2)
    origin = np.repeat(origins, counts, axis=0)
    calls = replace(calls, x=calls.x + origin[:, 0], y=calls.y + origin[:, 1])
    vel_max = np.repeat([stage.settings.vel_max_pulse_per_ms for stage in execution.stages], counts)
    path = _path(calls, vel_max)
    setups = _Setups(firsts=np.concatenate([[0], np.cumsum(counts)]).tolist())
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
        speeds=_speeds(path),
        setups=setups.in_order(),
        locate=locate,
        text_of=lambda span: "",
        name_remarks=lambda line, word: (),
        in_pulses=True,
        complete=not any(d.rule in (rules.REFUSED, rules.ARGUMENT_UNDEFINED) for d in execution.diagnostics),
    )


def _path(calls: BufferedCalls, vel_max: Floats) -> Path:
    """The path of buffered calls; `vel_max`: the limit of each call's velocity, (n,)."""
    n = len(calls)
    op = _OP_OF_KIND[calls.kind]
    moves, dwell, power, follow = op < Op.DWELL, op == Op.DWELL, op == Op.POWER, op == Op.FOLLOW
    # A call that does not move stays where the motion before it ended.
    last = np.maximum.accumulate(np.where(moves, np.arange(n), -1))
    x, y = (np.where(last >= 0, column[last], 0.0) if n else column for column in (calls.x, calls.y))
    by_centre, by_radius = op == Op.ARC_CENTRE, op == Op.ARC_RADIUS
    vel = _where(moves, np.minimum(calls.vel, vel_max))
    acc = _where(moves, calls.acc)
    return Path(
        op=op,
        line=calls.line,
        channel=calls.channel.astype(np.int8),
        ccw=(by_centre | by_radius) & (calls.r == 1),
        arc_in_mm=_all(n, value=False),
        x=x,
        y=y,
        cx=_where(by_centre, np.concatenate([[0.0], x])[:-1] + calls.p),
        cy=_where(by_centre, np.concatenate([[0.0], y])[:-1] + calls.q),
        radius=_where(by_radius, calls.p),
        vel=vel,
        acc=acc,
        end=_all(n, value=np.nan),
        vel_line=_set_line(calls, moves, vel),
        acc_line=_set_line(calls, moves, acc),
        vel_in_mm=_all(n, value=False),
        acc_in_mm=_all(n, value=False),
        end_in_mm=_all(n, value=False),
        dwell_ms=_where(dwell, calls.p),
        power=_where(power, np.where(calls.kind == Buffered.FOLLOW_OFF, 0.0, calls.p)),
        low=_where(follow, calls.q),
        high=_where(follow, calls.r),
        ratio=_where(follow, calls.p),
        follow_in_mm=_all(n, value=False),
        power_unit=_all(n, value=np.int8(PowerUnit.NONE)),
        low_unit=_all(n, value=np.int8(PowerUnit.NONE)),
        high_unit=_all(n, value=np.int8(PowerUnit.NONE)),
        provenance=_all(n, value=np.int32(0)),
        unknown_before=_all(n, value=np.int32(0)),
        unknown=_all(n, value=np.int32(0)),
    )


def _all(n: int, *, value: object) -> Any:
    """A column with one value, which takes no memory."""
    return np.broadcast_to(np.asarray(value), n)


def _where(used: Bools, values: Floats) -> Floats:
    """A column with NaN in the rows that do not use it."""
    return np.where(used, values, np.nan) if used.any() else _all(len(used), value=np.nan)


def _changes(moves: Bools, values: Floats) -> Indices:
    """Rows of the motions whose value differs from that of the motion before, ascending."""
    rows: Indices = np.flatnonzero(moves)
    changed: Indices = rows[np.diff(values[rows], prepend=np.nan) != 0]
    return changed


def _set_line(calls: BufferedCalls, moves: Bools, values: Floats) -> npt.NDArray[np.int32]:
    """For each row the line of the first motion with its value, as where a modal word was set, (n,)."""
    begins = np.zeros(len(calls), dtype=np.intp)
    changes = _changes(moves, values)
    begins[changes] = changes
    lines: npt.NDArray[np.int32] = calls.line[np.maximum.accumulate(begins)]
    return lines


def _speeds(path: Path) -> Speeds:
    """The velocities and accelerations where they change."""
    moves = path.moves
    vel, acc = _changes(moves, path.vel), _changes(moves, path.acc)
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
