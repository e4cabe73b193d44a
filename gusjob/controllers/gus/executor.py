"""Execute calls in order, as the controller does: refused calls, the calls of each stage, the state of each laser.

Host calls take no time. A switch or power that is set while a stage moves (no GT_CrdStatus since its GT_CrdStart) acts
at its time if the listing has times, else at that stage's start, after the buffered calls before its first motion. A
setting is in force for the whole stage, with a warning.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.controllers.gus.arguments import (
    EXECUTION_ERROR,
    PARAMETER_ERROR,
    ArgumentChecker,
    argument_error,
    range_error,
    report_conversions,
)
from gusjob.controllers.gus.calls import BUFFERED, SIGNATURES, Buffered, Call, Stream, Value
from gusjob.controllers.gus.execution import AcceptedCall, CrdSettings, Execution, FirstStop, RunCalls, StageRun
from gusjob.controllers.gus.ranges import (
    DIMENSION,
    DISTANCE_LIMIT,
    EVEN_TIME_MS,
    MODE_LIMIT,
    POWER_NOW,
    PowerMode,
    Range,
)
from gusjob.controllers.gus.stops import stop_stage
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Rule, Span
from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Indices, distinct, picked
from gusjob.simulate.events import ImmediateAction, LaserState

_DUTY, _FREQUENCY, _ANALOG = Phrase("the duty modes"), Phrase("frequency mode"), Phrase("analog mode")
_PWM, _MOVING = Phrase("the PWM modes"), Phrase("the coordinate system is moving")


def execute(stream: Stream, *, has_scanner: bool = False) -> Execution:
    """Execute every call of a stream in order.

    Args:
        stream: The calls.
        has_scanner: The machine has a scanner model, so that the actual position differs from the planned one.
    """
    executor = _CallExecutor(
        stream=stream,
        run=RunCalls.of(stream.buffered),
        collector=Collector(stream.name),
        has_scanner=has_scanner,
    )
    report_conversions(stream.conversions, executor.collector)
    for first, last, call in stream.parts():
        executor.queue(first, last)
        if call is not None:
            executor.call(call)
    return executor.finish()


class _CallExecutor(Struct):
    """State of the controller between two calls. `queues`: buffered rows by coordinate system and FIFO."""

    stream: Stream
    run: RunCalls
    collector: Collector
    has_scanner: bool
    lasers: list[LaserState] = field(default_factory=lambda: [LaserState(), LaserState()])
    axis_called: list[bool] = field(default_factory=lambda: [False, False])
    """GT_SetAxisMode since the last GT_LaserPowerMode, per channel."""
    axis_ever: list[bool] = field(default_factory=lambda: [False, False])
    named: set[int] = field(default_factory=set)
    queues: dict[tuple[int, int], list[Indices]] = field(default_factory=dict)
    running: StageRun | None = None
    stages: list[StageRun] = field(default_factory=list)
    actions: list[ImmediateAction] = field(default_factory=list)
    is_known: bool = True
    """Whether the listing determines what runs."""
    systems: dict[int, CrdSettings] = field(default_factory=dict)
    """Settings of each coordinate system that GT_SetCrdPrm has set up."""
    accepted: list[AcceptedCall] = field(default_factory=list)
    refused: int = 0
    """Number of calls that were refused."""
    stop_dec: dict[int, tuple[float, float]] = field(default_factory=dict)
    """Deceleration of smooth and abrupt stops of each coordinate system that GT_SetCrdStopDec has set."""
    left: dict[tuple[int, int], Call] = field(default_factory=dict)
    """The GT_Stop that left buffered calls, by coordinate system and FIFO."""

    # Reporting.

    def diagnostic(self, rule: Rule, line: int, **fields: object) -> None:
        self.collector.add(rule, Span(line=line), fields)

    def refuse(self, call: str, line: int, code: int, reason: str) -> None:
        self.refused += 1
        self.diagnostic(rules.REFUSED, line, call=call, code=code, reason=reason)

    # Buffered calls.

    def queue(self, first: int, last: int) -> None:
        """Queue buffered rows first..last-1; refuse those with a bad argument."""
        if first == last:
            return
        calls = self.stream.buffered
        modes = (self.lasers[0].power_mode, self.lasers[1].power_mode)
        checker = ArgumentChecker(calls=calls, modes=modes, collector=self.collector)
        rows = checker.accepted(np.arange(first, last))
        self.check_sources(rows)
        keys = picked(calls.crd, rows) * 2 + picked(calls.fifo, rows)
        lasers = rows[calls.kind[rows] >= Buffered.ON]
        self.named.update(distinct(calls.channel[lasers]).tolist())
        is_one = bool((keys == keys[:1]).all())
        for key in distinct(keys[:1] if is_one else keys).tolist():
            crd, fifo = key // 2, key % 2
            part = rows if is_one else rows[keys == key]
            if self.running is not None and self.running.crd == crd and self.running.stop is None:
                if self.running.fifo != fifo:
                    runs = self.running.fifo
                    reason = Phrase("FIFO {fifo} can't be filled while FIFO {other} runs", fifo=fifo, other=runs)
                    name = BUFFERED[Buffered(int(calls.kind[part[0]]))].name
                    self.refuse(name, int(calls.line[part[0]]), EXECUTION_ERROR, reason)
                else:
                    self.running.parts.append(part)
            else:
                self.queues.setdefault((crd, fifo), []).append(part)

    def check_sources(self, rows: Indices) -> None:
        """Report what of GT_BufLaserFollowMode is not simulated (sister)."""
        calls = self.stream.buffered
        at = rows[calls.kind[rows] == Buffered.FOLLOW_SOURCE]
        for bad, reason in (
            (calls.p[at] == 1, Phrase("source 1 is the measured velocity; the simulation follows the planned one")),
            (calls.q[at] != 0, Phrase("startPower is not documented; it is not simulated")),
        ):
            for row in at[bad].tolist():
                name = BUFFERED[Buffered.FOLLOW_SOURCE].name
                self.diagnostic(rules.QUESTIONABLE_CALL, int(calls.line[row]), call=name, reason=reason)

    # Calls that are not buffered.

    def call(self, call: Call) -> None:
        """Execute one call, or refuse it."""
        if self.running is not None and self.running.stop is not None:
            since_ms = call.time_ms - self.running.start_ms
            if not since_ms < self.running.stop_ms:
                self.running = None
        reason = argument_error(call)
        if reason:
            self.refuse(call.name, call.line, PARAMETER_ERROR, reason)
            return
        refused = self.refused
        handler = _HANDLERS[call.name]
        handler(self, call)
        if self.refused == refused:
            moving = self.running is not None
            self.accepted.append(AcceptedCall(call=call, stage=len(self.stages) - moving, moving=moving))

    def number(self, call: Call, index: int) -> float:
        value = call.args[index]
        assert isinstance(value, float)
        return value

    def channel(self, call: Call) -> int:
        channel = int(self.number(call, len(call.args) - 1))
        self.named.add(channel)
        return channel

    def set(self, call: Call, channel: int, **changes: object) -> None:
        before = self.lasers[channel]
        self.lasers[channel] = replace(before, **changes)
        if self.running is not None and self.lasers[channel] != before:
            self.running.lasers = (self.lasers[0], self.lasers[1])
            reason = Phrase("the coordinate system is moving; the simulation uses the setting for the whole stage")
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=reason)

    def act(self, call: Call, channel: int, *, on: bool | None = None, power: float | None = None) -> None:
        """Add a switch, a power, or a reading: at the time of the call if the stage that moves has one, too."""
        actions, time_ms = self.actions, math.nan
        if self.running is not None:
            actions, time_ms = self.running.moving, call.time_ms - self.running.start_ms
        actions.append(
            ImmediateAction(channel=channel, on=on, power=power, line=call.line, time_ms=time_ms, clock_ms=call.time_ms)
        )

    def axis_mode(self, call: Call) -> None:
        axis, mode = int(self.number(call, 0)), int(self.number(call, 1))
        if axis == 8 and mode == 0:
            self.refuse(call.name, call.line, PARAMETER_ERROR, Phrase("axis 8 takes mode 1 only"))
            return
        self.axis_called[axis - 7] = self.axis_ever[axis - 7] = mode == 1

    def power_mode(self, call: Call) -> None:
        if self.running is not None:
            reason = Phrase("the coordinate system is moving; the mode does not change")
            self.refuse(call.name, call.line, EXECUTION_ERROR, reason)
            return
        channel, mode = self.channel(call), PowerMode(int(self.number(call, 0)))
        high, low = self.number(call, 1), self.number(call, 2)
        if not self.limits_fit(call, MODE_LIMIT[mode], ("minValue", low), ("maxValue", high)):
            return
        if mode.is_pwm and not self.axis_ever[channel]:
            first = f"GT_SetAxisMode({7 + channel},1)"
            reason = Phrase("{call} must be called first in the PWM modes (M 三.1)", call=first)
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=reason)
        if mode is PowerMode.ANALOG and self.axis_called[channel]:
            self.diagnostic(
                rules.QUESTIONABLE_CALL,
                call.line,
                call=call.name,
                reason=Phrase("GT_SetAxisMode must not be called in analog mode (M 三.1 (3), in a comment)"),
            )
        if self.lasers[channel].power_mode is not mode:
            self.act(call, channel, power=math.nan)
        self.axis_called[channel] = False
        self.set(call, channel, mode=mode, low=low, high=high)

    def limits_fit(self, call: Call, allowed: Range, low: tuple[str, float], high: tuple[str, float]) -> bool:
        """Whether two limits are in their range and in order; else the call is refused."""
        upside_down = Phrase("{low} is above {high}", low=low[0], high=high[0]) if low[1] > high[1] else ""
        reason = range_error(allowed, *high) or range_error(allowed, *low) or upside_down
        if reason:
            self.refuse(call.name, call.line, PARAMETER_ERROR, reason)
        return not reason

    def power_now(self, call: Call) -> None:
        channel, power = self.channel(call), self.number(call, 0)
        if reason := range_error(POWER_NOW[self.lasers[channel].power_mode], "outputCmd", power):
            self.refuse(call.name, call.line, PARAMETER_ERROR, reason)
            return
        self.act(call, channel, power=power)

    def switch_now(self, call: Call) -> None:
        self.act(call, self.channel(call), on=self.number(call, 0) == 1)

    def read_switch(self, call: Call) -> None:
        self.act(call, self.channel(call))

    def check_mode(self, call: Call, fits: bool, where: str) -> None:
        if not fits:
            reason = Phrase("it has an effect only in {modes}", modes=where)
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=reason)

    def carrier(self, call: Call) -> None:
        channel = self.channel(call)
        self.check_mode(call, self.lasers[channel].power_mode in (PowerMode.DUTY, PowerMode.DUTY2), _DUTY)
        self.set(call, channel, carrier_khz=self.number(call, 0))

    def pulse_width(self, call: Call) -> None:
        channel = self.channel(call)
        self.check_mode(call, self.lasers[channel].power_mode is PowerMode.FREQUENCY, _FREQUENCY)
        self.set(call, channel, pulse_width_us=self.number(call, 0))

    def standby(self, call: Call) -> None:
        channel, on = self.channel(call), self.number(call, 0) == 1
        self.check_mode(call, not on or self.lasers[channel].power_mode.is_pwm, _PWM)
        self.set(call, channel, standby=(self.number(call, 1), self.number(call, 2)) if on else None)

    def prevoltage(self, call: Call) -> None:
        channel, on = self.channel(call), self.number(call, 0) == 1
        self.check_mode(call, not on or not self.lasers[channel].power_mode.is_pwm, _ANALOG)
        self.set(call, channel, prevoltage_v=self.number(call, 1) if on else None)

    def delays(self, call: Call) -> None:
        self.set(call, self.channel(call), off_delay_us=self.number(call, 0), on_delay_us=self.number(call, 1))

    def fpk(self, call: Call) -> None:
        channel = self.channel(call)
        self.check_mode(call, self.lasers[channel].power_mode.is_pwm, _PWM)
        self.set(call, channel, fpk_us=(self.number(call, 0), self.number(call, 1), self.number(call, 2)))

    def no_fpk(self, call: Call) -> None:
        self.set(call, self.channel(call), fpk_us=None)

    def distance_mode(self, call: Call) -> None:
        actual = self.number(call, 1) == 1
        if self.number(call, 0) == 1 and actual and not self.has_scanner:
            reason = Phrase("the profile has no scanner: the planned position is used as the actual one")
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=reason)
        self.set(
            call,
            self.channel(call),
            distance=self.number(call, 0) == 1,
            distance_actual=actual,
            reference_pulse=call.args[2],
            scale_pulse_per_mm=call.args[3],
        )

    def distance_ratio(self, call: Call) -> None:
        channel = self.channel(call)
        laser = self.lasers[channel]
        if not laser.distance:
            reason = Phrase("GT_SetLaserDisMode has not enabled distance follow")
            self.refuse(call.name, call.line, EXECUTION_ERROR, reason)
            return
        low, high = self.number(call, 1), self.number(call, 2)
        if not self.limits_fit(call, DISTANCE_LIMIT[laser.power_mode], ("minPower", low), ("maxPower", high)):
            return
        self.set(call, channel, ratio_per_mm=call.args[0], distance_limits=(low, high))

    def set_crd(self, call: Call) -> None:
        crd = int(self.number(call, 0))
        if self.running is not None and self.running.crd == crd:
            self.refuse(call.name, call.line, EXECUTION_ERROR, _MOVING)
            return
        parameters = call.args[1]
        if isinstance(parameters, tuple):
            for name, allowed, value in (
                ("dimension", DIMENSION, parameters[0]),
                ("evenTime", EVEN_TIME_MS, parameters[4]),
            ):
                if isinstance(value, float) and (reason := range_error(allowed, name, value)):
                    self.refuse(call.name, call.line, PARAMETER_ERROR, reason)
                    return
            self.systems[crd] = _crd_settings(parameters, self.position())
        else:
            self.systems[crd] = CrdSettings()  # A struct whose fields the listing does not give.

    def position(self, stages: int | None = None) -> tuple[float, float]:
        """Return where the last motion so far, or of some first stages, ends: pulse on the machine, at first 0, 0."""
        calls = self.run.calls
        for stage in reversed(self.stages[:stages]):
            rows = stage.rows
            moves = rows[calls.kind[rows] < Buffered.DELAY]
            if len(moves):
                x, y = stage.settings.origin_pulse
                return float(calls.x[moves[-1]]) + x, float(calls.y[moves[-1]]) + y
        return 0.0, 0.0

    def clear(self, call: Call) -> None:
        crd, fifo = int(self.number(call, 0)), int(self.number(call, 1))
        if self.running is not None and self.running.crd == crd:
            self.refuse(call.name, call.line, EXECUTION_ERROR, _MOVING)
            return
        self.drop(call, self.queues.pop((crd, fifo), []))
        self.left.pop((crd, fifo), None)

    def drop(self, call: Call, parts: list[Indices]) -> None:
        """Report buffered calls that a call removes from their FIFO."""
        if dropped := sum(map(len, parts)):
            reason = Phrase("{count} buffered calls are cleared and never run", count=dropped)
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=reason)

    def start(self, call: Call) -> None:
        mask, option = int(self.number(call, 0)), int(self.number(call, 1))
        if mask not in (1, 2):
            rule, fields = (rules.TWO_SYSTEMS_AT_ONCE, {}) if mask == 3 else (rules.REFUSED, {"call": call.name})
            reason = Phrase("mask {mask} selects no coordinate system", mask=mask)
            self.diagnostic(rule, call.line, **fields, code=PARAMETER_ERROR, reason=reason)
            return
        crd = mask
        fifo = (option >> (crd - 1)) & 1
        if self.running is not None:
            if self.running.crd == crd:
                self.refuse(call.name, call.line, EXECUTION_ERROR, Phrase("the coordinate system is moving already"))
            else:
                self.diagnostic(rules.TWO_SYSTEMS_AT_ONCE, call.line)
            return
        parts = self.queues.pop((crd, fifo), [])
        self.left.pop((crd, fifo), None)
        self.running = StageRun(
            crd=crd,
            fifo=fifo,
            line=call.line,
            parts=parts,
            waiting=len(parts),
            lasers=(self.lasers[0], self.lasers[1]),
            at_rest=self.actions,
            settings=self.systems.get(crd, CrdSettings()),
            start_ms=call.time_ms,
        )
        self.actions = []
        self.stages.append(self.running)

    def wait(self, call: Call) -> None:
        """GT_CrdStatus: the host program has waited for the end of the motion. A mere reading has no effect.

        A recorder knows when a coordinate system is at rest, whatever FIFO ran.
        """
        if not call.waits or self.running is None:
            return
        running = self.running.crd, self.running.fifo
        asked = int(self.number(call, 0)), int(self.number(call, 3)) if math.isnan(call.time_ms) else self.running.fifo
        if asked != running:
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=_does_not_run(asked, running))
            return
        self.running.rest_ms = call.time_ms
        self.running = None

    def stop(self, call: Call) -> None:
        """GT_Stop: bits 8 and 9 are coordinate systems 1 and 2, bits 0 to 7 axes; option 1: abrupt (sister).

        At rest it has no effect.
        """
        stage, mask, option = self.running, int(self.number(call, 0)), int(self.number(call, 1))
        if stage is None:
            return
        own, axes = 1 << (7 + stage.crd), sum(1 << axis for axis in stage.settings.axes)
        smooth, abrupt = self.stop_dec.get(stage.crd, (0.0, math.inf))
        if mask & own:
            self.end_stage(call, stage, abrupt if option & own else smooth)
        elif mask & axes:
            self.give_up(call, stage, Phrase("it stops an axis, not the coordinate system"))

    def end_stage(self, call: Call, stage: StageRun, dec_pulse_per_ms2: float) -> bool:
        """Stop the stage that moves; return whether it is known what runs then."""
        time_ms = call.time_ms - stage.start_ms
        if math.isnan(time_ms):
            return self.give_up(call, stage, Phrase("this listing does not say when"))
        first, halt_ms = stage.first_stop, math.inf
        if first is None:
            first = FirstStop(
                time_ms=max(time_ms, 0.0), dec_pulse_per_ms2=dec_pulse_per_ms2, run=self.run, parts=stage.parts
            )
        elif dec_pulse_per_ms2 == first.dec_pulse_per_ms2:
            return True  # It slows down like this already.
        elif math.isinf(dec_pulse_per_ms2):
            halt_ms = time_ms
        else:
            return self.give_up(call, stage, Phrase("it is stopping already, with another deceleration"))
        stage.parts = first.parts
        stopped = stop_stage(
            first.run,
            stage,
            self.position(len(self.stages) - 1),
            first.time_ms,
            first.dec_pulse_per_ms2,
            halt_ms=halt_ms,
        )
        if stopped is None:
            return self.give_up(call, stage, Phrase("the deceleration of GT_SetCrdStopDec is below that of the path"))
        self.run, stage.parts, stage.first_stop = stopped.run, [stopped.rows], first
        stage.stop, stage.stop_ms = call, stopped.end_ms
        self.leave(call, stage, stopped.rest)
        return True

    def leave(self, call: Call, stage: StageRun, rest: Indices) -> None:
        """Put what a stop leaves of a stage into its FIFO, before what was buffered since an earlier stop."""
        fifo = stage.crd, stage.fifo
        since = self.queues.pop(fifo, [])
        if self.left.pop(fifo, None) is not None:
            since = since[1:]
        if len(rest):
            since, self.left[fifo] = [rest, *since], call
        if since:
            self.queues[fifo] = since

    def stop_dec_of(self, call: Call) -> None:
        """GT_SetCrdStopDec."""
        self.stop_dec[int(self.number(call, 0))] = (self.number(call, 1), self.number(call, 2))

    def reset(self, call: Call) -> None:
        """GT_Reset: the state at power-up (sister); a motion stops at once. Where the axes are does not change."""
        if self.running is not None and not self.end_stage(call, self.running, math.inf):
            return
        buffered = [part for parts in self.queues.values() for part in parts]
        self.drop(call, buffered)
        if self.systems or self.lasers != [LaserState(), LaserState()] or any(self.axis_ever) or self.actions:
            reason = Phrase("the switch goes off; modes, limits, delays and coordinate systems set before are lost")
            self.diagnostic(rules.QUESTIONABLE_CALL, call.line, call=call.name, reason=reason)
        for channel in (0, 1):
            self.act(call, channel, on=False)
            self.act(call, channel, power=math.nan)
        self.lasers = [LaserState(), LaserState()]
        self.axis_called, self.axis_ever = [False, False], [False, False]
        self.systems, self.queues, self.stop_dec, self.left = {}, {}, {}, {}
        self.running = None

    def give_up(self, call: Call, stage: StageRun, reason: str) -> bool:
        """Report a call after which it is not known what runs."""
        self.is_known = False
        self.diagnostic(rules.UNKNOWN_STOP, call.line, call=call.name, crd=stage.crd, reason=reason)
        return False

    def finish(self) -> Execution:
        """End the last stage; report calls that are never started."""
        calls = self.stream.buffered
        for (crd, fifo), parts in self.queues.items():
            count, stop = sum(map(len, parts)), self.left.get((crd, fifo))
            if count and stop is not None:
                reason = Phrase("{count} buffered calls are left in the FIFO and never run", count=count)
                self.diagnostic(rules.QUESTIONABLE_CALL, stop.line, call=stop.name, reason=reason)
            elif count:
                self.diagnostic(rules.NEVER_STARTED, int(calls.line[parts[0][0]]), count=count, crd=crd, fifo=fifo)
        if len(calls) and not self.systems:
            self.diagnostic(rules.ASSUMED_CRD, int(calls.line[0]))
        return Execution(
            run=self.run,
            stages=tuple(self.stages),
            at_end=tuple(self.actions),
            lasers=(self.lasers[0], self.lasers[1]),
            channels=tuple(sorted(self.named)),
            is_known=self.is_known,
            diagnostics=tuple(self.collector.finish(rules.NOT_LISTED)),
            accepted=tuple(self.accepted),
        )


def _crd_settings(parameters: tuple[Value, ...], position: tuple[float, float]) -> CrdSettings:
    """Read a TCrdPrm. `position`: of the machine now, which is the origin unless the program gives one (sister)."""
    _, profile, vel_max, acc_max, even_time, sets_origin, origin = parameters
    axes = _axes(profile)
    return CrdSettings(
        axes=axes,
        vel_max_pulse_per_ms=_limit(vel_max),
        acc_max_pulse_per_ms2=_limit(acc_max),
        even_time_ms=_number(even_time),
        origin_pulse=_origin(origin, axes) if _number(sets_origin) else position,
    )


def _does_not_run(asked: tuple[int, int], running: tuple[int, int]) -> Phrase:
    """Describe a coordinate system and FIFO whose status is read, and that do not run."""
    (crd, fifo), (runs, other) = asked, running
    return Phrase(
        "FIFO {fifo} of coordinate system {crd} does not run; FIFO {other} of coordinate system {runs} does, and is "
        "not waited for",
        fifo=fifo,
        crd=crd,
        other=other,
        runs=runs,
    )


def _number(value: Value) -> float:
    return value if isinstance(value, float) else 0.0


def _limit(value: Value) -> float:
    """Read synVelMax or synAccMax; without one there is no limit."""
    return _number(value) if _number(value) > 0 else float("inf")


def _axes(profile: Value) -> tuple[int, int]:
    """Read which axes (from 0) X and Y drive: profile[k] names the dimension of axis k+1."""
    found = list(profile) if isinstance(profile, tuple) else []
    return (found.index(1.0), found.index(2.0)) if 1.0 in found and 2.0 in found else (0, 1)


def _origin(origin: Value, axes: tuple[int, int]) -> tuple[float, float]:
    """Read originPos: like profile it has an element for each axis (its order is not documented)."""
    return (_number(origin[axes[0]]), _number(origin[axes[1]])) if isinstance(origin, tuple) else (0.0, 0.0)


_HANDLERS: dict[str, Callable[[_CallExecutor, Call], None]] = {
    "GT_SetAxisMode": _CallExecutor.axis_mode,
    "GT_SetHSIOOpt": _CallExecutor.switch_now,
    "GT_GetHSIOOpt": _CallExecutor.read_switch,
    "GT_LaserPowerMode": _CallExecutor.power_mode,
    "GT_LaserPrfCmd": _CallExecutor.power_now,
    "GT_LaserOutFrq": _CallExecutor.carrier,
    "GT_SetPulseWidth": _CallExecutor.pulse_width,
    "GT_SetWaitPulse": _CallExecutor.standby,
    "GT_SetPreVltg": _CallExecutor.prevoltage,
    "GT_SetLevelDelay": _CallExecutor.delays,
    "GT_EnaFPK": _CallExecutor.fpk,
    "GT_DisFPK": _CallExecutor.no_fpk,
    "GT_SetLaserDisMode": _CallExecutor.distance_mode,
    "GT_SetLaserDisRatio": _CallExecutor.distance_ratio,
    "GT_SetCrdPrm": _CallExecutor.set_crd,
    "GT_CrdClear": _CallExecutor.clear,
    "GT_CrdStart": _CallExecutor.start,
    "GT_CrdStatus": _CallExecutor.wait,
    "GT_SetCrdStopDec": _CallExecutor.stop_dec_of,
    "GT_Stop": _CallExecutor.stop,
    "GT_Reset": _CallExecutor.reset,
}

assert _HANDLERS.keys() == SIGNATURES.keys() - {s.name for s in BUFFERED.values()}
