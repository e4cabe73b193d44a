"""The last step: a plan to calls.

In the order of the job language: setup, GT_SetCrdPrm, GT_CrdClear, path, GT_CrdStart.
"""

from __future__ import annotations

import numpy as np

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Stream, Value, crd_start
from gusjob.controllers.gus.ranges import STANDBY_KHZ, PowerMode
from gusjob.diagnostics.model import Diagnostic
from gusjob.ir.intent import Intent
from gusjob.ir.job import Job
from gusjob.ir.path import Op
from gusjob.ir.setup import (
    Crd,
    LaserDelay,
    LaserDistance,
    LaserFpk,
    LaserMode,
    LaserPrevolt,
    LaserStandby,
    PowerNow,
    Setup,
    SwitchNow,
)
from gusjob.kinematics.arrays import Floats
from gusjob.planner import plan
from gusjob.planner.plan import Plan

_KINDS = {
    Op.LINE: Buffered.LINE,
    Op.JUMP: Buffered.LINE,
    Op.ARC_CENTRE: Buffered.ARC_CENTRE,
    Op.ARC_RADIUS: Buffered.ARC_RADIUS,
    Op.DWELL: Buffered.DELAY,
    Op.POWER: Buffered.POWER,
    Op.FOLLOW: Buffered.FOLLOW,
    Op.ON: Buffered.ON,
    Op.OFF: Buffered.OFF,
}
_KIND_TABLE = np.array([_KINDS[op] for op in Op], dtype=np.uint8)


def compile_job(job: Job, machine: Machine) -> tuple[Stream, list[Diagnostic]]:
    """Compile a checked job to calls; with them the diagnostics that only the planner can make."""
    done = plan(job, machine)
    return lower(done), list(done.diagnostics)


def crd_of(job: Job) -> tuple[int, int]:
    """Coordinate system and FIFO of a job: its last CRD, or 1 and 0."""
    found = [s.statement for s in job.setups if isinstance(s.statement, Crd)]
    return (int(found[-1].crd), int(found[-1].fifo)) if found else (1, 0)


def lower(state: Plan) -> Stream:
    """The calls of a plan."""
    crd, fifo = crd_of(state.job)
    calls: list[Call] = []
    built = False
    for number, stage in enumerate(state.stages):
        first_line = stage.setups[0].line if stage.setups else int(state.path.line[stage.first])

        def add(name: str, *args: Value, at: int, line: int) -> None:
            calls.append(Call(name=name, args=args, at=at, line=line))

        if number:
            add("GT_CrdStatus", float(crd), "run", "segment", float(fifo), at=stage.first, line=first_line)
        for setup in stage.setups:
            for name, args in setup_calls(setup, state.machine):
                add(name, *args, at=stage.first, line=setup.line)
        if stage.first == stage.last:
            continue
        line = int(state.path.line[stage.first])
        if not built:
            add("GT_SetCrdPrm", float(crd), crd_parameters(state.machine), at=stage.first, line=line)
            built = True
        add("GT_CrdClear", float(crd), float(fifo), at=stage.first, line=line)
        calls.append(crd_start(crd, fifo, at=stage.last, line=int(state.path.line[stage.last - 1])))
    intent = None
    if state.sky is not None and state.mark_end is not None:
        intent = Intent(run=state.sky.run, mark_end=state.mark_end)
    return Stream(name=state.job.name, buffered=_buffered(state, crd, fifo), calls=tuple(calls), intent=intent)


def crd_parameters(machine: Machine) -> Value:
    """TCrdPrm: X and Y are axes 1 and 2, the machine's limits, origin 0."""
    profile = (1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    limits = (machine.max_velocity_pulse_per_ms, machine.max_acceleration_pulse_per_ms2)
    return (2.0, profile, *limits, 0.0, 1.0, (0.0,) * 8)


def setup_calls(setup: Setup, machine: Machine) -> list[tuple[str, tuple[Value, ...]]]:
    """The calls of one setup statement (M 二.2, 三, 五.2)."""
    ch = float(setup.channel)
    match setup.statement:
        case LaserMode() as mode:
            return _mode_calls(mode, ch)
        case LaserDelay(on_delay_us=on, off_delay_us=off):
            return [("GT_SetLevelDelay", (off, on, ch))]
        case LaserStandby(pulse=None):
            # Off still passes a frequency: the highest of the range, since 0 is outside it.
            return [("GT_SetWaitPulse", (0.0, STANDBY_KHZ.high, 0.0, ch))]
        case LaserStandby(pulse=(khz, pct)):
            return [("GT_SetWaitPulse", (1.0, khz, pct, ch))]
        case LaserPrevolt(prevoltage_v=volts):
            return [("GT_SetPreVltg", (0.0, 0.0, ch) if volts is None else (1.0, volts, ch))]
        case LaserFpk(times_us=None):
            return [("GT_DisFPK", (ch,))]
        case LaserFpk(times_us=(width, gap, off_delay)):
            return [("GT_EnaFPK", (width, gap, off_delay, ch))]
        case LaserDistance(settings=settings):
            px, py = machine.pulses_per_mm
            scale = (px, py, px, px)
            if settings is None:
                return [("GT_SetLaserDisMode", (0.0, 0.0, (0.0,) * 4, scale, ch))]
            return [
                ("GT_SetLaserDisMode", (1.0, float(settings.actual), settings.reference_pulse, scale, ch)),
                ("GT_SetLaserDisRatio", (settings.ratio_per_mm, settings.low, settings.high, ch)),
            ]
        case SwitchNow(on=on_now):
            return [("GT_SetHSIOOpt", (float(on_now), ch))]
        case PowerNow(power=power):
            return [("GT_LaserPrfCmd", (power, ch))]
        case _:
            return []


def _mode_calls(mode: LaserMode, channel: float) -> list[tuple[str, tuple[Value, ...]]]:
    """In analog mode GT_SetAxisMode is not called: M's comment in 三.1 (3)."""
    set_mode = ("GT_LaserPowerMode", (float(mode.mode), mode.high, mode.low, channel))
    axis = ("GT_SetAxisMode", (7 + channel, 1.0))
    match mode.mode:
        case PowerMode.ANALOG:
            return [set_mode]
        case PowerMode.FREQUENCY:
            return [axis, set_mode, ("GT_SetPulseWidth", (mode.pulse_width_us or 0.0, channel))]
        case PowerMode.DUTY | PowerMode.DUTY2:
            return [axis, set_mode, ("GT_LaserOutFrq", (mode.carrier_khz or 0.0, channel))]


def _buffered(state: Plan, crd: int, fifo: int) -> BufferedCalls:
    path, laid, timed = state.path, state.segments, state.timed
    assert laid is not None
    n = len(path)
    kind = _KIND_TABLE[path.op]

    def spread(values: Floats) -> Floats:
        if len(timed) == n:
            return values
        column = np.zeros(n)
        column[timed] = values
        return column

    p, q, r = np.zeros(n), np.zeros(n), np.zeros(n)
    arcs = timed[laid.arc_at]
    if np.any(path.op[timed] == Op.ARC_CENTRE) or np.any(path.op[timed] == Op.ARC_RADIUS):
        by_radius = path.op[arcs] == Op.ARC_RADIUS
        # The centre is an offset from the start point, in whole pulses like the ends.
        p[arcs] = np.where(
            by_radius, _radius(path.radius[arcs], laid.arcs.radius), np.rint(path.cx[arcs]) - laid.x0[laid.arc_at] + 0.0
        )
        q[arcs] = np.where(by_radius, 0.0, np.rint(path.cy[arcs]) - laid.y0[laid.arc_at] + 0.0)
        r[arcs] = path.ccw[arcs]
        # An arc that is none in whole pulses is a line.
        lost = (kind == Buffered.ARC_CENTRE) | (kind == Buffered.ARC_RADIUS)
        lost[arcs] = False
        kind[lost] = Buffered.LINE
    for op, columns in (
        (Op.POWER, ((p, path.power),)),
        (Op.DWELL, ((p, path.dwell_ms),)),
        (Op.FOLLOW, ((p, path.ratio), (q, path.low), (r, path.high))),
    ):
        at = np.flatnonzero(path.op == op)
        for target, values in columns:
            target[at] = values[at]
    moves = path.moves[timed]
    return BufferedCalls(
        kind=kind,
        line=path.line,
        crd=np.full(n, crd, dtype=np.int8),
        fifo=np.full(n, fifo, dtype=np.int8),
        channel=np.where(path.takes_time, np.int8(0), path.channel),
        x=spread(np.where(moves, laid.x1, 0.0)),
        y=spread(np.where(moves, laid.y1, 0.0)),
        p=p,
        q=q,
        r=r,
        vel=spread(np.where(moves, state.vel, 0.0)),
        acc=spread(np.where(moves, state.acc, 0.0)),
        vel_end=spread(np.where(moves, state.vel_end, 0.0)),
    )


def _radius(written: Floats, fitted: Floats) -> Floats:
    """The radius as written, or half the chord where rounding made the chord longer than twice that."""
    return np.where(np.abs(written) >= fitted, written, np.sign(written) * fitted)
