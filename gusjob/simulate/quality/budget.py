"""Check a trace against the [budget] of the machine profile."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gusjob.config.machine import Budget, Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic, Rule, Span
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.float_noise import exceeds
from gusjob.kinematics.units import MS_PER_S
from gusjob.simulate import ChannelTrace, Trace
from gusjob.simulate.quality.marks import marks_of

_Lines = npt.NDArray[np.int32]


def over_budget(trace: Trace, machine: Machine) -> list[Diagnostic]:
    """Report everything above the machine's budget; lines count through all files of the job."""
    budget, found = machine.budget, Collector(trace.name)
    if budget == Budget():
        return []
    _duration(trace, budget, found)
    for channel in trace.channels:
        _power(trace, machine, channel, found)
        _clamped(trace, budget, channel, found)
    if budget.limits_marks:
        _marks(trace, machine, found)
    return found.finish(rules.NOT_LISTED)


def _add(found: Collector, rule: Rule, lines: _Lines, values: Floats, limit: float | Floats, **fields: object) -> None:
    """Report each value above its limit."""
    limits = np.broadcast_to(limit, values.shape)
    over = np.flatnonzero(exceeds(values, limits))
    listed = over[: found.remaining(rule)].tolist()
    for at in listed:
        figures = {"value": float(values[at]), "limit": float(limits[at])}
        found.add(rule, Span(line=int(lines[at])), {**figures, **fields})
    found.count_unlisted(rule, len(over) - len(listed))


def _duration(trace: Trace, budget: Budget, found: Collector) -> None:
    """Check the duration of the run; report the segment in which it exceeds the budget."""
    end_s = trace.schedule.times_ms[1:] / MS_PER_S
    if budget.duration_s is None or not len(end_s) or not exceeds(end_s[-1], budget.duration_s):
        return
    at = int(np.argmax(exceeds(end_s, budget.duration_s)))
    fields = {"value": float(end_s[-1]), "limit": budget.duration_s}
    found.add(rules.BUDGET_DURATION, Span(line=int(trace.line[at])), fields)


def _power(trace: Trace, machine: Machine, channel: ChannelTrace, found: Collector) -> None:
    """Check the highest power of each segment, in its unit and in watts."""
    budget, stage, power = machine.budget, trace.schedule.stage, channel.emitted.power_max
    unit_at = channel.unit_at(stage)
    for number, unit in enumerate(channel.units):
        limit = budget.power(unit)
        if limit is not None:
            mine = unit_at == number
            _add(found, rules.BUDGET_POWER, trace.line[mine], power[mine], limit, unit=unit, channel=channel.channel)
    if budget.power_w is not None:
        watts = power * channel.watts_per_unit(stage, machine)
        _add(found, rules.BUDGET_POWER, trace.line, watts, budget.power_w, unit="W", channel=channel.channel)


def _clamped(trace: Trace, budget: Budget, channel: ChannelTrace, found: Collector) -> None:
    """Check the time in which a limit clamped the power, segment by segment."""
    if budget.clamped_ms is not None:
        clamped = channel.emitted.clamped_ms
        _add(found, rules.BUDGET_CLAMPED, trace.line, clamped, budget.clamped_ms, channel=channel.channel)


def _marks(trace: Trace, machine: Machine, found: Collector) -> None:
    """Check energy per mm and on error of each mark."""
    budget, marks = machine.budget, marks_of(trace, machine)
    for channel in trace.channels:
        mine = marks["channel"] == channel.channel
        lines, peak = marks["line"][mine], marks["power_per_mm_peak"][mine]
        stage, name = channel.emission.stage, channel.channel
        unit_at = channel.unit_at(stage)
        for number, unit in enumerate(channel.units):
            limit = budget.energy_per_mm(unit)
            if limit is not None:
                at = unit_at == number
                _add(found, rules.BUDGET_ENERGY, lines[at], peak[at], limit, unit=f"{unit}*ms/mm", channel=name)
        if budget.energy_j_per_mm is not None:
            joules = peak * channel.watts_per_unit(stage, machine) / MS_PER_S
            _add(found, rules.BUDGET_ENERGY, lines, joules, budget.energy_j_per_mm, unit="J/mm", channel=name)
        if budget.on_error_um is not None:
            error = np.abs(marks["on_error_um"][mine])
            _add(found, rules.BUDGET_ON_ERROR, lines, error, budget.on_error_um, channel=name)
