"""Quantities and their conversions, once.

Canonical: mm, mm/s, mm/s2, us, ms, kHz, %, V, deg, and the controller's pulses.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

from gusjob.i18n.phrases import Phrase
from gusjob.kinematics.arrays import Floats


class Kind(IntEnum):
    """What a number measures."""

    LENGTH = 0
    VELOCITY = 1
    ACCELERATION = 2
    TIME = 3
    FREQUENCY = 4
    SHARE = 5
    VOLTAGE = 6
    ANGLE = 7
    PLAIN = 8
    POWER = 9

    @property
    def words(self) -> str:
        """For messages: 'a length', 'a velocity' ..."""
        return _KINDS[self]


_KINDS = (
    Phrase("a length"),
    Phrase("a velocity"),
    Phrase("an acceleration"),
    Phrase("a time"),
    Phrase("a frequency"),
    Phrase("a share"),
    Phrase("a voltage"),
    Phrase("an angle"),
    Phrase("a plain number"),
    Phrase("a power"),
)
"""By Kind."""


class System(IntEnum):
    """Which units a length, velocity or acceleration was written in (DEFAULT: those of UNITS)."""

    DEFAULT = 0
    MM = 1
    PULSE = 2


class PowerUnit(IntEnum):
    """Which unit a power was written in (NONE: the mode's)."""

    NONE = 0
    PERCENT = 1
    KHZ = 2
    VOLT = 3

    @property
    def text(self) -> str:
        """As printed."""
        return ("", "%", "kHz", "V")[self]


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: canonical value = value * times / over (two exact factors, so that 35mV is 35/1000 V to the last bit)."""

    kind: Kind
    times: float = 1.0
    over: float = 1.0
    system: int = System.DEFAULT


UNITS: dict[str, Unit] = {
    "um": Unit(Kind.LENGTH, over=1000, system=System.MM),
    "mm": Unit(Kind.LENGTH, system=System.MM),
    "pulse": Unit(Kind.LENGTH, system=System.PULSE),
    "mm/s": Unit(Kind.VELOCITY, system=System.MM),
    "m/s": Unit(Kind.VELOCITY, times=1000, system=System.MM),
    "mm/min": Unit(Kind.VELOCITY, over=60, system=System.MM),
    "pulse/ms": Unit(Kind.VELOCITY, system=System.PULSE),
    "mm/s2": Unit(Kind.ACCELERATION, system=System.MM),
    "m/s2": Unit(Kind.ACCELERATION, times=1000, system=System.MM),
    "pulse/ms2": Unit(Kind.ACCELERATION, system=System.PULSE),
    "us": Unit(Kind.TIME),
    "ms": Unit(Kind.TIME, times=1000),
    "s": Unit(Kind.TIME, times=1e6),
    "hz": Unit(Kind.FREQUENCY, over=1000, system=PowerUnit.KHZ),
    "khz": Unit(Kind.FREQUENCY, system=PowerUnit.KHZ),
    "mhz": Unit(Kind.FREQUENCY, times=1000, system=PowerUnit.KHZ),
    "%": Unit(Kind.SHARE, system=PowerUnit.PERCENT),
    "v": Unit(Kind.VOLTAGE, system=PowerUnit.VOLT),
    "mv": Unit(Kind.VOLTAGE, over=1000, system=PowerUnit.VOLT),
    "deg": Unit(Kind.ANGLE),
}
"""By lower-case spelling; time is canonical in us here (a dwell divides by 1000)."""

US_PER_MS = 1000.0
MS_PER_S = 1000.0


def spelling(unit: str) -> str:
    """The canonical spelling of a unit: khz -> kHz."""
    return {"khz": "kHz", "hz": "Hz", "mhz": "MHz", "v": "V", "mv": "mV"}.get(unit.lower(), unit.lower())


_N = TypeVar("_N", float, Floats)


def velocity_pulse_per_ms(mm_s: _N, pulses_per_mm: float) -> _N:
    """mm/s to the controller's pulse/ms."""
    return mm_s * pulses_per_mm / 1e3


def acceleration_pulse_per_ms2(mm_s2: _N, pulses_per_mm: float) -> _N:
    """mm/s2 to the controller's pulse/ms2."""
    return mm_s2 * pulses_per_mm / 1e6
