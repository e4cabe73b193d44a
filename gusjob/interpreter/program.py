"""Runs the calls in order, as the controller takes them: what is refused, what each stage runs, how each laser stands.

Host calls take no time. A call made while a stage moves (no GT_CrdStatus since its GT_CrdStart) acts at that stage's
start, behind the buffered calls that stand before its first motion: when it really comes, nobody can tell from
a listing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from gusjob import diagnostics as d
from gusjob.diagnostics import Diagnostic, Rule, Span
from gusjob.limits import (
    DISTANCE_LIMIT,
    FOLLOW,
    MODE_LIMIT,
    POWER,
    POWER_NOW,
    PULSE_DUTY_PCT,
    PowerMode,
    Range,
    Verdict,
)
from gusjob.stream import BUFFERED, SIGNATURES, Arg, Buffered, Call, Kind, Stream, Value

Rows = npt.NDArray[np.intp]
MAX_PER_RULE = 1000

DONE, EXECUTION_ERROR, PARAMETER_ERROR = 0, 1, 7
"""Return codes (sister series)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserState:
    """How a channel stands, all but its switch and power. Mode None: never set, taken as duty 0..100 %."""

    mode: PowerMode | None = None
    low: float = MODE_LIMIT[PowerMode.DUTY].low
    high: float = MODE_LIMIT[PowerMode.DUTY].high
    carrier_khz: float | None = None
    pulse_width_us: float = 0.0
    on_delay_us: float = 0.0
    off_delay_us: float = 0.0
    standby: tuple[float, float] | None = None
    prevoltage_v: float | None = None
    fpk_us: tuple[float, float, float] | None = None
    distance: bool = False
    source_actual: bool = False
    reference_pulse: tuple[float, ...] = (0.0,) * 4
    scale_pulse_per_mm: tuple[float, ...] = (1.0,) * 4
    ratio_per_mm: tuple[float, ...] = (0.0,) * 4
    distance_low: float = 0.0
    distance_high: float = 0.0

    @property
    def power_mode(self) -> PowerMode:
        """The mode in force."""
        return PowerMode.DUTY if self.mode is None else self.mode

    @property
    def follows_distance(self) -> bool:
        """Whether a distance term is added."""
        return self.distance and any(self.ratio_per_mm)

    @property
    def output_when_off(self) -> str:
        """Standby pulse or pre-voltage as the output while off (M 二.2), '' if none."""
        if self.power_mode.is_pwm:
            return f"{d.number(self.standby[0])} kHz {d.number(self.standby[1])} %" if self.standby else ""
        return f"{d.number(self.prevoltage_v)} V" if self.prevoltage_v is not None else ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Action:
    """An immediate switch or power. `power` None: the switch."""

    channel: int
    on: bool = False
    power: float | None = None
    line: int = 0


@dataclass(slots=True, kw_only=True)
class StageRun:
    """One start of a coordinate system: buffered rows in order, lasers in force, immediate actions before and
    during.
    """

    crd: int
    fifo: int
    line: int
    parts: list[Rows]
    lasers: tuple[LaserState, LaserState]
    at_rest: list[Action]
    moving: list[Action] = field(default_factory=list)
    vel_max: float = float("inf")
    axes: tuple[int, int] = (0, 1)

    @property
    def rows(self) -> Rows:
        """Buffered rows in order."""
        return np.concatenate(self.parts) if self.parts else np.empty(0, dtype=np.intp)


@dataclass(frozen=True, slots=True, kw_only=True)
class Program:
    """What ran: stages, what was still done at rest behind the last one, switch readings (line, channel,
    value), channels named.
    """

    stages: tuple[StageRun, ...]
    at_end: tuple[Action, ...]
    lasers: tuple[LaserState, LaserState]
    readings: tuple[tuple[int, int, int], ...]
    channels: tuple[int, ...]
    diagnostics: tuple[Diagnostic, ...]


def run_program(stream: Stream) -> Program:
    """Every call of a stream in order."""
    executor = _Executor(stream=stream)
    for first, last, call in stream.parts():
        executor.take(first, last)
        if call is not None:
            executor.call(call)
    return executor.finish()


@dataclass(slots=True)
class _Executor:
    stream: Stream
    lasers: list[LaserState] = field(default_factory=lambda: [LaserState(), LaserState()])
    switch: list[bool] = field(default_factory=lambda: [False, False])
    axis_called: list[bool] = field(default_factory=lambda: [False, False])
    named: set[int] = field(default_factory=set)
    queues: dict[tuple[int, int], list[Rows]] = field(default_factory=dict)
    running: StageRun | None = None
    stages: list[StageRun] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    readings: list[tuple[int, int, int]] = field(default_factory=list)
    crd_built: dict[int, Value] = field(default_factory=dict)
    faults: list[Diagnostic] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)

    # Reporting.

    def fault(self, rule: Rule, line: int, **fields: object) -> None:
        self.counts[rule.code] = self.counts.get(rule.code, 0) + 1
        if self.counts[rule.code] <= MAX_PER_RULE:
            self.faults.append(Diagnostic(rule=rule, span=Span(line=line), fields=fields, path=self.stream.name))

    def refuse(self, call: str, line: int, code: int, reason: str) -> None:
        self.fault(d.REFUSED, line, call=call, code=code, reason=reason)

    # Buffered calls.

    def take(self, first: int, last: int) -> None:
        """Queue buffered rows first..last-1; those with a bad argument are refused."""
        if first == last:
            return
        rows = self.judged(np.arange(first, last))
        calls = self.stream.buffered
        keys = calls.crd[rows].astype(np.int64) * 2 + calls.fifo[rows]
        lasers = calls.kind[rows] >= Buffered.ON
        self.named.update(np.unique(calls.channel[rows][lasers]).tolist())
        for key in np.unique(keys).tolist():
            crd, fifo = key // 2, key % 2
            part = rows[keys == key] if len(np.unique(keys)) > 1 else rows
            if self.running is not None and self.running.crd == crd:
                if self.running.fifo != fifo:
                    self.refuse(
                        BUFFERED[Buffered(int(calls.kind[part[0]]))].name, int(calls.line[part[0]]), EXECUTION_ERROR,
                        f"FIFO {fifo} can't be filled while FIFO {self.running.fifo} runs",
                    )  # fmt: skip
                else:
                    self.running.parts.append(part)
            else:
                self.queues.setdefault((crd, fifo), []).append(part)

    def judged(self, rows: Rows) -> Rows:
        """The rows whose arguments the controller takes."""
        calls = self.stream.buffered
        bad = np.zeros(len(rows), dtype=np.bool_)
        for kind, signature in BUFFERED.items():
            at = np.flatnonzero(calls.kind[rows] == kind)
            if not len(at):
                continue
            for arg in signature.args:
                if arg.range is not None:
                    self.judge(rows, at, calls.column(arg.column)[rows[at]], arg, arg.range, signature.name, bad)
            if kind is Buffered.POWER or kind is Buffered.FOLLOW:
                for channel in (0, 1):
                    mine = at[calls.channel[rows[at]] == channel]
                    self.judge_power(rows, mine, kind, self.lasers[channel].power_mode, bad)
        return rows[~bad]

    def judge_power(self, rows: Rows, at: Rows, kind: Buffered, mode: PowerMode, bad: npt.NDArray[np.bool_]) -> None:
        if not len(at):
            return
        signature, calls = BUFFERED[kind], self.stream.buffered
        table = POWER if kind is Buffered.POWER else FOLLOW
        for arg in signature.args:
            if arg.range is None:
                self.judge(rows, at, calls.column(arg.column)[rows[at]], arg, table[mode], signature.name, bad)
        if kind is Buffered.FOLLOW:
            upside_down = at[~(calls.r[rows[at]] > calls.q[rows[at]])]
            for i in upside_down[~bad[upside_down]][:MAX_PER_RULE].tolist():
                self.refuse(
                    signature.name, int(calls.line[rows[i]]), PARAMETER_ERROR, "maxPower must be above minPower"
                )
            bad[upside_down] = True

    def judge(
        self, rows: Rows, at: Rows, values: npt.NDArray[np.float64], arg: Arg, allowed: Range, name: str,
        bad: npt.NDArray[np.bool_],
    ) -> None:  # fmt: skip
        verdict = allowed.judge(values)
        whole = allowed.carries(values) if arg.kind is Kind.WHOLE or allowed.whole else np.isfinite(values)
        if not verdict.any() and whole.all():
            return
        line = self.stream.buffered.line
        wrong = (verdict == Verdict.OUTSIDE) | ~whole
        for i in np.flatnonzero(wrong & ~bad[at])[:MAX_PER_RULE].tolist():
            reason = f"{arg.name} {d.number(float(values[i]))} {allowed.unit}".rstrip()
            reason += f" is outside {allowed}" if verdict[i] == Verdict.OUTSIDE else " is not whole"
            self.refuse(name, int(line[rows[at[i]]]), PARAMETER_ERROR, reason)
        bad[at[wrong]] = True
        for i in np.flatnonzero((verdict == Verdict.ON_TOLERATED_END) & whole)[:MAX_PER_RULE].tolist():
            self.fault(
                d.ON_OPEN_END, int(line[rows[at[i]]]), what=f"{name} {arg.name}", value=float(values[i]),
                unit=allowed.unit, range=str(allowed),
            )  # fmt: skip

    # Calls that are not buffered.

    def call(self, call: Call) -> None:
        """One call; its effect, or why it has none."""
        reason = self.bad_argument(call)
        if reason:
            self.refuse(call.name, call.line, PARAMETER_ERROR, reason)
            return
        handler = _HANDLERS[call.name]
        handler(self, call)

    def bad_argument(self, call: Call) -> str:
        for arg, value in zip(SIGNATURES[call.name].args, call.args, strict=True):
            if arg.range is None or _unused(call, arg):
                continue
            for number in value if isinstance(value, tuple) else (value,):
                if not isinstance(number, float):
                    continue
                shown = f"{arg.name} {d.number(number)} {arg.range.unit}".rstrip()
                if arg.range.verdict(number) is Verdict.OUTSIDE:
                    return f"{shown} is outside {arg.range}"
                if not arg.range.carries(number):
                    return f"{shown} is not whole"
        return ""

    def number(self, call: Call, index: int) -> float:
        value = call.args[index]
        assert isinstance(value, float)
        return value

    def channel(self, call: Call) -> int:
        channel = int(self.number(call, len(call.args) - 1))
        self.named.add(channel)
        return channel

    def set(self, channel: int, **changes: object) -> None:
        self.lasers[channel] = replace(self.lasers[channel], **changes)  # type: ignore[arg-type]  # fields by name
        if self.running is not None:
            self.running.lasers = (self.lasers[0], self.lasers[1])

    def act(self, action: Action) -> None:
        (self.actions if self.running is None else self.running.moving).append(action)

    def axis_mode(self, call: Call) -> None:
        axis, mode = int(self.number(call, 0)), int(self.number(call, 1))
        if axis == 8 and mode == 0:
            self.refuse(call.name, call.line, PARAMETER_ERROR, "axis 8 takes mode 1 only")
            return
        self.axis_called[axis - 7] = mode == 1

    def power_mode(self, call: Call) -> None:
        if self.running is not None:
            self.refuse(
                call.name, call.line, EXECUTION_ERROR, "the coordinate system is moving; the mode stays as it was"
            )
            return
        channel, mode = self.channel(call), PowerMode(int(self.number(call, 0)))
        high, low = self.number(call, 1), self.number(call, 2)
        allowed = MODE_LIMIT[mode]
        for name, value in (("maxValue", high), ("minValue", low)):
            if allowed.verdict(value) is not Verdict.INSIDE:
                shown = f"{name} {d.number(value)} {allowed.unit} is outside {allowed}"
                self.refuse(call.name, call.line, PARAMETER_ERROR, shown)
                return
        if low > high:
            self.refuse(call.name, call.line, PARAMETER_ERROR, "minValue is above maxValue")
            return
        if mode is PowerMode.ANALOG and self.axis_called[channel]:
            self.fault(
                d.ACCEPTED_ODD, call.line, call=call.name,
                reason="GT_SetAxisMode is not to be called in analog mode (M 三.1 (3), in its comment)",
            )  # fmt: skip
        if self.lasers[channel].mode is not mode:
            self.act(Action(channel=channel, power=float("nan"), line=call.line))
        self.set(channel, mode=mode, low=low, high=high)

    def power_now(self, call: Call) -> None:
        channel, power = self.channel(call), self.number(call, 0)
        allowed = POWER_NOW[self.lasers[channel].power_mode]
        if allowed.verdict(power) is not Verdict.INSIDE:
            shown = f"outputCmd {d.number(power)} {allowed.unit} is outside {allowed}"
            self.refuse(call.name, call.line, PARAMETER_ERROR, shown)
            return
        self.act(Action(channel=channel, power=power, line=call.line))

    def switch_now(self, call: Call) -> None:
        channel, on = self.channel(call), self.number(call, 0) == 1
        self.act(Action(channel=channel, on=on, line=call.line))
        self.switch[channel] = on

    def read_switch(self, call: Call) -> None:
        channel = self.channel(call)
        self.readings.append((call.line, channel, int(self.switch[channel])))

    def needs_mode(self, call: Call, good: bool, where: str) -> None:
        if not good:
            self.fault(d.ACCEPTED_ODD, call.line, call=call.name, reason=f"it has an effect only in {where}")

    def carrier(self, call: Call) -> None:
        channel = self.channel(call)
        self.needs_mode(call, self.lasers[channel].power_mode in (PowerMode.DUTY, PowerMode.DUTY2), "the duty modes")
        self.set(channel, carrier_khz=self.number(call, 0))

    def pulse_width(self, call: Call) -> None:
        channel = self.channel(call)
        self.needs_mode(call, self.lasers[channel].power_mode is PowerMode.FREQUENCY, "frequency mode")
        self.set(channel, pulse_width_us=self.number(call, 0))

    def standby(self, call: Call) -> None:
        channel, on = self.channel(call), self.number(call, 0) == 1
        self.needs_mode(call, not on or self.lasers[channel].power_mode.is_pwm, "the PWM modes")
        self.set(channel, standby=(self.number(call, 1), self.number(call, 2)) if on else None)

    def prevoltage(self, call: Call) -> None:
        channel, on = self.channel(call), self.number(call, 0) == 1
        self.needs_mode(call, not on or not self.lasers[channel].power_mode.is_pwm, "analog mode")
        self.set(channel, prevoltage_v=self.number(call, 1) if on else None)

    def delays(self, call: Call) -> None:
        self.set(self.channel(call), off_delay_us=self.number(call, 0), on_delay_us=self.number(call, 1))

    def fpk(self, call: Call) -> None:
        channel = self.channel(call)
        self.needs_mode(call, self.lasers[channel].power_mode.is_pwm, "the PWM modes")
        self.set(channel, fpk_us=(self.number(call, 0), self.number(call, 1), self.number(call, 2)))

    def no_fpk(self, call: Call) -> None:
        self.set(self.channel(call), fpk_us=None)

    def distance_mode(self, call: Call) -> None:
        self.set(
            self.channel(call),
            distance=self.number(call, 0) == 1,
            source_actual=self.number(call, 1) == 1,
            reference_pulse=call.args[2],
            scale_pulse_per_mm=call.args[3],
        )

    def distance_ratio(self, call: Call) -> None:
        channel = self.channel(call)
        laser = self.lasers[channel]
        if not laser.distance:
            self.refuse(call.name, call.line, EXECUTION_ERROR, "GT_SetLaserDisMode has not enabled distance follow")
            return
        low, high = self.number(call, 1), self.number(call, 2)
        allowed = DISTANCE_LIMIT[laser.power_mode]
        for name, value in (("minPower", low), ("maxPower", high)):
            if allowed.verdict(value) is not Verdict.INSIDE:
                shown = f"{name} {d.number(value)} {allowed.unit} is outside {allowed}"
                self.refuse(call.name, call.line, PARAMETER_ERROR, shown)
                return
        if low > high:
            self.refuse(call.name, call.line, PARAMETER_ERROR, "minPower is above maxPower")
            return
        self.set(channel, ratio_per_mm=call.args[0], distance_low=low, distance_high=high)

    def build_crd(self, call: Call) -> None:
        crd = int(self.number(call, 0))
        if self.running is not None and self.running.crd == crd:
            self.refuse(call.name, call.line, EXECUTION_ERROR, "the coordinate system is moving")
            return
        self.crd_built[crd] = call.args[1]

    def clear(self, call: Call) -> None:
        crd, fifo = int(self.number(call, 0)), int(self.number(call, 1))
        if self.running is not None and self.running.crd == crd:
            self.refuse(call.name, call.line, EXECUTION_ERROR, "the coordinate system is moving")
            return
        dropped = sum(map(len, self.queues.pop((crd, fifo), [])))
        if dropped:
            self.fault(
                d.ACCEPTED_ODD, call.line, call=call.name, reason=f"{dropped} buffered calls are cleared, never run"
            )

    def start(self, call: Call) -> None:
        mask, option = int(self.number(call, 0)), int(self.number(call, 1))
        if mask not in (1, 2):
            rule, fields = (d.CRDS_AT_ONCE, {}) if mask == 3 else (d.REFUSED, {"call": call.name})
            self.fault(
                rule, call.line, **fields, code=PARAMETER_ERROR, reason=f"mask {mask} names no coordinate system"
            )
            return
        crd = mask
        fifo = (option >> (crd - 1)) & 1
        if self.running is not None:
            if self.running.crd == crd:
                self.refuse(call.name, call.line, EXECUTION_ERROR, "the coordinate system is moving already")
            else:
                self.fault(d.CRDS_AT_ONCE, call.line)
            return
        self.running = StageRun(
            crd=crd,
            fifo=fifo,
            line=call.line,
            parts=self.queues.pop((crd, fifo), []),
            lasers=(self.lasers[0], self.lasers[1]),
            at_rest=self.actions,
            vel_max=_vel_max(self.crd_built.get(crd)),
            axes=_axes(self.crd_built.get(crd)),
        )
        self.actions = []
        self.stages.append(self.running)
        self.follow_switch(self.running.parts)

    def follow_switch(self, parts: list[Rows]) -> None:
        """The switch as GT_GetHSIOOpt would find it: behind the buffered calls before the first motion."""
        calls = self.stream.buffered
        for row in (int(r) for part in parts for r in part[:64]):
            if calls.kind[row] <= Buffered.DELAY:
                return
            if calls.kind[row] in (Buffered.ON, Buffered.OFF):
                self.switch[int(calls.channel[row])] = calls.kind[row] == Buffered.ON

    def wait(self, call: Call) -> None:
        """GT_CrdStatus: the program waited for the end of the motion."""
        if self.running is None or self.running.crd != int(self.number(call, 0)):
            return
        rows, calls = self.running.rows, self.stream.buffered
        for channel in (0, 1):
            mine = rows[(calls.channel[rows] == channel) & np.isin(calls.kind[rows], (Buffered.ON, Buffered.OFF))]
            late = [a.on for a in self.running.moving if a.channel == channel and a.power is None]
            timed = np.flatnonzero(calls.kind[rows] <= Buffered.DELAY)
            behind = mine[mine > rows[timed[0]]] if len(timed) else mine
            if len(behind) or (len(mine) and not late):
                self.switch[channel] = bool(calls.kind[mine[-1]] == Buffered.ON)
        self.running = None

    def finish(self) -> Program:
        """The end of the program: the last stage runs out."""
        calls = self.stream.buffered
        for (crd, fifo), parts in self.queues.items():
            count = sum(map(len, parts))
            if count:
                self.fault(d.NEVER_STARTED, int(calls.line[parts[0][0]]), count=count, crd=crd, fifo=fifo)
        if len(calls) and not self.crd_built:
            self.fault(d.ASSUMED_CRD, int(calls.line[0]))
        for code, count in self.counts.items():
            if count > MAX_PER_RULE:
                self.faults.append(
                    Diagnostic(
                        rule=d.MORE,
                        span=d.NOWHERE,
                        fields={"count": count - MAX_PER_RULE, "code": code, "shown": MAX_PER_RULE},
                        path=self.stream.name,
                    )
                )
        return Program(
            stages=tuple(self.stages),
            at_end=tuple(self.actions),
            lasers=(self.lasers[0], self.lasers[1]),
            readings=tuple(self.readings),
            channels=tuple(sorted(self.named)),
            diagnostics=tuple(self.faults),
        )


def _unused(call: Call, arg: Arg) -> bool:
    """Arguments that mean nothing while the first one switches off (GT_SetWaitPulse(0, ..))."""
    off = call.name in ("GT_SetWaitPulse", "GT_SetPreVltg", "GT_SetLaserDisMode") and call.args[0] == 0.0
    return off and arg.kind in (Kind.REAL, Kind.ARRAY)


def _vel_max(parameters: Value | None) -> float:
    """synVelMax of a TCrdPrm that is known: the controller takes no path velocity above it."""
    if isinstance(parameters, tuple) and isinstance(parameters[2], float) and parameters[2] > 0:
        return parameters[2]
    return float("inf")


def _axes(parameters: Value | None) -> tuple[int, int]:
    """Which axes (from 0) X and Y are: profile[k] names the dimension of axis k+1."""
    if isinstance(parameters, tuple) and isinstance(parameters[1], tuple):
        profile = list(parameters[1])
        if 1.0 in profile and 2.0 in profile:
            return profile.index(1.0), profile.index(2.0)
    return 0, 1


_HANDLERS: dict[str, Callable[[_Executor, Call], None]] = {
    "GT_SetAxisMode": _Executor.axis_mode,
    "GT_SetHSIOOpt": _Executor.switch_now,
    "GT_GetHSIOOpt": _Executor.read_switch,
    "GT_LaserPowerMode": _Executor.power_mode,
    "GT_LaserPrfCmd": _Executor.power_now,
    "GT_LaserOutFrq": _Executor.carrier,
    "GT_SetPulseWidth": _Executor.pulse_width,
    "GT_SetWaitPulse": _Executor.standby,
    "GT_SetPreVltg": _Executor.prevoltage,
    "GT_SetLevelDelay": _Executor.delays,
    "GT_EnaFPK": _Executor.fpk,
    "GT_DisFPK": _Executor.no_fpk,
    "GT_SetLaserDisMode": _Executor.distance_mode,
    "GT_SetLaserDisRatio": _Executor.distance_ratio,
    "GT_SetCrdPrm": _Executor.build_crd,
    "GT_CrdClear": _Executor.clear,
    "GT_CrdStart": _Executor.start,
    "GT_CrdStatus": _Executor.wait,
}

assert _HANDLERS.keys() == SIGNATURES.keys() - {s.name for s in BUFFERED.values()}


def pulse_duty_pct(frequency_khz: float, width_us: float) -> float:
    """Share of the period that a laser pulse takes, % (M 二.2: above 0.1, below 100)."""
    return frequency_khz * width_us / 10


__all__ = ["PULSE_DUTY_PCT", "Action", "LaserState", "Program", "StageRun", "pulse_duty_pct", "run_program"]
