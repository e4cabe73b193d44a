"""Lowering: a plan to the calls of a GUS.

The order of the calls: setup, GT_SetCrdPrm, GT_CrdClear, path, GT_CrdStart; between two stages the host waits for the
end of the motion (GT_CrdStatus).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec.structs import replace

from gusjob import planner
from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, BufferedCalls, Call, Stream, Value, crd_start
from gusjob.controllers.gus.ranges import STANDBY_KHZ, PowerMode
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
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
from gusjob.kinematics.arrays import Floats, rows_of
from gusjob.planner.flatten import ChordLimitError
from gusjob.planner.plan import Plan

_BUFFERED = {
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
_KIND_OF_OP = np.array([_BUFFERED[op] for op in Op], dtype=np.uint8)


def compile_job(job: Job, machine: Machine) -> tuple[Stream, list[Diagnostic]]:
    """Compile a checked job to calls; with them the diagnostics that only the planner can make."""
    try:
        done = planner.plan(job, machine)
    except ChordLimitError as found:
        row, fields = found.row, {"chords": found.count, "limit": found.limit}
        span, remarks = job.locate(int(job.path.line[row]), ""), job.provenance_remarks(int(job.path.provenance[row]))
        error = Diagnostic(rule=rules.TOO_MANY_CHORDS, span=span, fields=fields, path=job.name, remarks=remarks)
        nothing = replace(job.without_path(), setups=())
        return lower(planner.plan(nothing, machine)), [error]
    return lower(done), list(done.diagnostics)


def lower(plan: Plan) -> Stream:
    """Make the calls of a plan."""
    crd, fifo = _crd(plan.job)
    calls = tuple(_immediate_calls(plan, crd, fifo))
    return Stream(name=plan.job.name, buffered=_buffered(plan, crd, fifo), calls=calls, intent=plan.intent)


def _crd(job: Job) -> tuple[int, int]:
    """Coordinate system and FIFO of a job: its last CRD, or 1 and 0."""
    found = [setup.statement for setup in job.setups if isinstance(setup.statement, Crd)]
    return (int(found[-1].crd), int(found[-1].fifo)) if found else (1, 0)


def _immediate_calls(plan: Plan, crd: int, fifo: int) -> Iterator[Call]:
    """The calls around the buffered ones, stage by stage."""
    lines = plan.path.line
    has_parameters = False
    for number, stage in enumerate(plan.stages):
        if number:
            line = stage.setups[0].line if stage.setups else int(lines[stage.first])
            wait = (float(crd), "run", "segment", float(fifo))
            yield Call(name="GT_CrdStatus", args=wait, at=stage.first, line=line)
        for setup in stage.setups:
            for name, args in setup_calls(setup, plan.machine):
                yield Call(name=name, args=args, at=stage.first, line=setup.line)
        if stage.first == stage.last:
            continue
        line = int(lines[stage.first])
        if not has_parameters:
            parameters = (float(crd), crd_parameters(plan.machine))
            yield Call(name="GT_SetCrdPrm", args=parameters, at=stage.first, line=line)
            has_parameters = True
        yield Call(name="GT_CrdClear", args=(float(crd), float(fifo)), at=stage.first, line=line)
        yield crd_start(crd, fifo, at=stage.last, line=int(lines[stage.last - 1]))


def crd_parameters(machine: Machine) -> Value:
    """Make TCrdPrm: X and Y are axes 1 and 2, the machine's limits, origin 0."""
    profile = (1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    limits = (machine.max_velocity_pulse_per_ms, machine.max_acceleration_pulse_per_ms2)
    return (2.0, profile, *limits, 0.0, 1.0, (0.0,) * 8)


def setup_calls(setup: Setup, machine: Machine) -> list[tuple[str, tuple[Value, ...]]]:
    """Make the calls of one setup statement, name and arguments (M 二.2, 三, 五.2)."""
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
    """The calls of LASER MODE. In analog mode GT_SetAxisMode is not called: M's comment in 三.1 (3)."""
    set_mode = ("GT_LaserPowerMode", (float(mode.mode), mode.high, mode.low, channel))
    axis = ("GT_SetAxisMode", (7 + channel, 1.0))
    match mode.mode:
        case PowerMode.ANALOG:
            return [set_mode]
        case PowerMode.FREQUENCY:
            return [axis, set_mode, ("GT_SetPulseWidth", (mode.pulse_width_us or 0.0, channel))]
        case PowerMode.DUTY | PowerMode.DUTY2:
            return [axis, set_mode, ("GT_LaserOutFrq", (mode.carrier_khz or 0.0, channel))]


def _buffered(plan: Plan, crd: int, fifo: int) -> BufferedCalls:
    """The buffered calls, one a row of the path (M 四.2)."""
    path, segments, timed = plan.path, plan.segments, plan.timed
    n, rows = len(path), rows_of(timed)
    moves = path.op[rows] < Op.DWELL

    def spread(values: Floats) -> Floats:
        # From timed rows to all rows.
        if len(timed) == n:
            return values
        column = np.zeros(n)
        column[rows] = values
        return column

    def moving(values: Floats) -> Floats:
        # 0 in a dwell.
        return spread(values if moves.all() else np.where(moves, values, 0.0))

    kind = _KIND_OF_OP[path.op]
    p, q, r = np.zeros(n), np.zeros(n), np.zeros(n)
    if path.is_arc.any():
        arcs = timed[segments.arc_at]
        by_radius = path.op[arcs] == Op.ARC_RADIUS
        # The centre is an offset from the start point, in whole pulses like the ends.
        i_pulse = np.rint(path.cx[arcs]) - segments.x0[segments.arc_at] + 0.0
        j_pulse = np.rint(path.cy[arcs]) - segments.y0[segments.arc_at] + 0.0
        p[arcs] = np.where(by_radius, path.radius[arcs], i_pulse)
        q[arcs] = np.where(by_radius, 0.0, j_pulse)
        r[arcs] = path.ccw[arcs]
        # An arc that is none in whole pulses is a line.
        lost = path.is_arc
        lost[arcs] = False
        kind[lost] = Buffered.LINE
    no_channel = np.broadcast_to(np.int16(0), n)
    for op, columns in (
        (Op.POWER, ((p, path.power),)),
        (Op.DWELL, ((p, path.dwell_ms),)),
        (Op.FOLLOW, ((p, path.ratio), (q, path.low), (r, path.high))),
    ):
        at = np.flatnonzero(path.op == op)
        for target, values in columns:
            target[at] = values[at]
    return BufferedCalls(
        kind=kind,
        line=path.line,
        crd=np.broadcast_to(np.int16(crd), n),
        fifo=np.broadcast_to(np.int16(fifo), n),
        channel=np.where(path.takes_time, np.int16(0), path.channel) if path.channel.any() else no_channel,
        x=moving(segments.x1),
        y=moving(segments.y1),
        p=p,
        q=q,
        r=r,
        vel=moving(plan.vel),
        acc=moving(plan.acc),
        vel_end=moving(plan.vel_end),
    )
