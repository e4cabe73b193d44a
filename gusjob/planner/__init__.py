"""Job to Plan, one pass a file: arcs, stages, whole pulses, sky writing, velocities, switch points."""

from __future__ import annotations

from msgspec.structs import replace

from gusjob.config.machine import Machine
from gusjob.diagnostics.model import has_errors
from gusjob.ir.job import Job
from gusjob.planner.flatten import flatten
from gusjob.planner.plan import NO_SKY_WRITING, Plan, PlannedPath, QuantizedPath, next_phase
from gusjob.planner.quantize import quantize
from gusjob.planner.skywriting.add_runs import add_runs
from gusjob.planner.slow_marks import slow_mark_diagnostics
from gusjob.planner.split import split
from gusjob.planner.velocity import velocities


def plan(job: Job, machine: Machine) -> Plan:
    """Plan a checked job: stages, segments in whole pulses, end velocities, switch points.

    The passes are a function, not a tuple, since each phase has a type of its own: StagedPath, QuantizedPath,
    PlannedPath, Plan. So no pass can run before what it needs.

    Raises:
        ChordLimitError: Arcs would become more chords than the profile allows.
    """
    path, origin = flatten(job, machine)
    staged = split(job, machine, path, origin)
    quantized = add_runs(quantize(staged, NO_SKY_WRITING))
    planned = velocities(quantized)
    done = _with_switches(planned, quantized) if len(planned.sky.events) else next_phase(Plan, planned, intent=None)
    slow = () if has_errors(done.diagnostics) else slow_mark_diagnostics(done)
    return replace(done, diagnostics=(*done.diagnostics, *slow))


def _with_switches(planned: PlannedPath, quantized: QuantizedPath) -> Plan:
    """Place the switches of sky writing, and check the field."""
    from gusjob.planner.skywriting.place_switches import place_switches  # Start-up time is part of the tool.
    from gusjob.planner.skywriting.run_field import run_field_diagnostics

    done = place_switches(planned)
    return replace(done, diagnostics=(*run_field_diagnostics(quantized), *done.diagnostics))
