"""Units in which messages show lengths and speeds."""

from __future__ import annotations

from msgspec import Struct

from gusjob.config.machine import Machine
from gusjob.ir.job import Job


class DisplayUnits(Struct, frozen=True, kw_only=True):
    """Units of a job's messages: those in which the job is written.

    `per_pulse`, `per_pulse_per_ms`, `per_pulse_per_ms2`: factors that convert a value in X's pulses.
    """

    length: str
    speed: str
    acceleration: str
    per_pulse: float
    per_pulse_per_ms: float
    per_pulse_per_ms2: float


PULSE_UNITS = DisplayUnits(
    length="pulse",
    speed="pulse/ms",
    acceleration="pulse/ms2",
    per_pulse=1.0,
    per_pulse_per_ms=1.0,
    per_pulse_per_ms2=1.0,
)


def display_units(job: Job, machine: Machine) -> DisplayUnits:
    """Choose the units of a job's messages."""
    if job.in_pulses:
        return PULSE_UNITS
    px = machine.pulses_per_mm[0]
    return DisplayUnits(
        length="mm",
        speed="mm/s",
        acceleration="mm/s2",
        per_pulse=1 / px,
        per_pulse_per_ms=1e3 / px,
        per_pulse_per_ms2=1e6 / px,
    )
