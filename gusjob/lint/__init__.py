"""Job to diagnostics: plain functions, one for each subject, in one tuple."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

from gusjob.config.machine import Machine
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Collector, Diagnostic
from gusjob.ir.job import Job
from gusjob.lint import delays, digits, frequency, laser, motion, power, repeated, setup, skywriting, unused
from gusjob.lint.context import LintContext, lint_context
from gusjob.lint.reporter import Reporter

Check = Callable[[LintContext, Reporter], None]

CHECKS: tuple[Check, ...] = (
    setup.laser_mode,
    setup.delays,
    setup.output_when_off,
    setup.first_pulse_killer,
    setup.distance,
    setup.coordinate_system,
    setup.new_stages,
    motion.speeds,
    motion.missing_speeds,
    motion.field,
    motion.dwells,
    power.before_a_mode,
    power.direct_power,
    power.power_now,
    power.follow,
    power.kept,
    frequency.distance,
    frequency.power_now,
    frequency.powers,
    unused.channels,
    unused.powers,
    laser.left_on,
    laser.jumps,
    laser.no_power,
    laser.dwells,
    laser.waits,
    laser.switching,
    skywriting.settings,
    skywriting.laser_changes,
    skywriting.forced_ends,
    power.saturation,
    repeated.marked_twice,
    delays.delays_against_path,
    motion.speeds_along,
    motion.arcs_close,
    motion.arcs_without_length,
    motion.arc_speed,
    motion.no_length,
    motion.starving,
    motion.forced_ends,
    digits.rounded_coordinates,
)
"""In the order in which they run: what looks at one value comes before what combines several."""

NEED_COMPLETE_JOB = (
    unused.channels,
    unused.powers,
    unused.powers_in_calls,
    laser.switching,
    delays.delays_against_path,
    motion.no_length,
)
"""Skipped where a line could not be read: what they miss may be in that line."""

DERIVED = (
    power.saturation,
    delays.delays_against_path,
    repeated.marked_twice,
    motion.speeds_along,
    motion.arcs_close,
    motion.arcs_without_length,
    motion.arc_speed,
    motion.no_length,
    motion.starving,
    motion.forced_ends,
    digits.rounded_coordinates,
)
"""Checks of values together: they pass over a statement in which an earlier check has found an error."""

RULES_OF_A_COMPLETE_TEXT = (
    rules.UNUSED_POWER,
    rules.UNUSED_LAST_POWER,
    rules.NOTHING_MARKED,
    rules.UNUSED_CHANNEL,
    rules.LASER_ON_WITHOUT_MOTION,
    rules.ALREADY_ON,
    rules.DELAY_LONGER_THAN_MARK,
    rules.DELAY_LONGER_THAN_JUMP,
    rules.GAP_LONGER_THAN_MARK,
    rules.FPK_LONGER_THAN_JUMP,
    rules.MARK_WITHOUT_LENGTH,
)
"""The rules of these checks."""

CHECKS_OF_CALLS: tuple[Check, ...] = (
    setup.laser_mode,
    setup.delays,
    setup.output_when_off,
    setup.first_pulse_killer,
    setup.distance,
    power.direct_power,
    power.power_now,
    power.follow,
    power.kept,
    frequency.distance,
    frequency.power_now,
    frequency.powers,
    power.saturation,
    unused.powers_in_calls,
    laser.dwells,
    laser.waits,
    laser.switching,
    repeated.marked_twice_outside_passes,
    delays.delays_against_path,
    motion.speeds,
    motion.speeds_along,
    motion.no_length,
    motion.starving,
)
"""The checks that hold for calls that somebody else wrote, too: what they look for is in the calls."""


def check(job: Job, machine: Machine) -> list[Diagnostic]:
    """Find everything that is wrong or odd in a job on a machine, in line order."""
    context = lint_context(job, machine)
    return run_checks(CHECKS, context, Reporter(context, Collector(job.name)))


class Need(IntEnum):
    """What it takes to find everything that is wrong with a job, beyond lint."""

    NOTHING = 0
    PLAN = 1
    SIMULATION = 2


def need(job: Job, machine: Machine) -> Need:
    """Find out whether only planning or simulating a job can tell everything that is wrong with it."""
    context = lint_context(job, machine)
    if delays.longest_run_ms(context) > machine.longest_run_ms:
        return Need.SIMULATION
    if not machine.equal_axes and bool((job.path.is_arc & job.path.arc_in_mm).any()):
        return Need.PLAN  # Its chords may be too many.
    return Need.PLAN if job.has_forced_ends or job.has_sky_writing or motion.may_be_slow(context) else Need.NOTHING


def run_checks(checks: tuple[Check, ...], context: LintContext, report: Reporter) -> list[Diagnostic]:
    """Run some checks; returns their diagnostics in line order."""
    for one in checks:
        if context.job.complete or one not in NEED_COMPLETE_JOB:
            report.begin(derived=one in DERIVED)
            one(context, report)
    return sorted(report.collector.finish(rules.NOT_LISTED), key=lambda f: (f.span.line, f.span.column))
