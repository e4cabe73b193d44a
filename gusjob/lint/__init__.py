"""Job to diagnostics: plain functions, one a matter, in one tuple."""

from __future__ import annotations

from collections.abc import Callable

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic
from gusjob.ir.job import Job
from gusjob.lint import light, motion, power, setup, sky
from gusjob.lint.view import Findings, View, view_of

Check = Callable[[View, Findings], None]

CHECKS: tuple[Check, ...] = (
    setup.laser_mode,
    setup.delays,
    setup.output_when_off,
    setup.distance,
    setup.coordinate_system,
    setup.new_stages,
    power.before_a_mode,
    power.direct_power,
    power.follow,
    power.kept,
    power.saturation,
    power.unused,
    light.left_on,
    light.jumps,
    light.no_power,
    light.dwells,
    light.waits,
    light.switching,
    light.burnt_twice,
    light.delays_against_path,
    motion.speeds,
    motion.given_speeds,
    motion.speeds_along,
    motion.field,
    motion.arcs_close,
    motion.arc_speed,
    motion.no_length,
    motion.starving,
    motion.dwells,
    motion.forced_ends,
    sky.settings,
    sky.light,
    sky.forced_ends,
)


HANG_ON_ALL = (power.unused, light.switching, light.delays_against_path, motion.no_length)
"""Silent where a line could not be read: what they miss may stand there."""


def check(job: Job, machine: Machine) -> list[Diagnostic]:
    """Everything that is wrong or odd in a job on a machine, in line order."""
    findings, view = Findings(job=job, collector=Collector(job.name)), view_of(job, machine)
    for one in CHECKS:
        if job.complete or one not in HANG_ON_ALL:
            one(view, findings)
    return sorted(findings.collector.done(rules.MORE), key=lambda f: (f.span.line, f.span.column))
