"""Quantities, units and conversions.

Canonical: mm, mm/s, mm/s2, us, ms, kHz, %, V, deg, and the controller's pulses.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TYPE_CHECKING, TypeVar

from msgspec import Struct

from gusjob.i18n.phrases import Phrase

if TYPE_CHECKING:  # The machine profile needs units, but no arrays: start-up time is part of the tool.
    from gusjob.kinematics.arrays import Floats


class QuantityKind(IntEnum):
    """Kind of quantity that a number has."""

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
        """The quantity in a message: 'a length', 'a velocity' ..."""
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
"""By QuantityKind."""


class UnitSystem(IntEnum):
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
        """The unit as printed."""
        return ("", "%", "kHz", "V")[self]


class Unit(Struct, frozen=True):
    """A unit: canonical value = value * times / over. Two exact factors, so 35mV is 35/1000 V to the last bit."""

    kind: QuantityKind
    times: float = 1.0
    over: float = 1.0
    system: int = UnitSystem.DEFAULT


UNITS: dict[str, Unit] = {
    "um": Unit(QuantityKind.LENGTH, over=1000, system=UnitSystem.MM),
    "mm": Unit(QuantityKind.LENGTH, system=UnitSystem.MM),
    "pulse": Unit(QuantityKind.LENGTH, system=UnitSystem.PULSE),
    "mm/s": Unit(QuantityKind.VELOCITY, system=UnitSystem.MM),
    "m/s": Unit(QuantityKind.VELOCITY, times=1000, system=UnitSystem.MM),
    "mm/min": Unit(QuantityKind.VELOCITY, over=60, system=UnitSystem.MM),
    "pulse/ms": Unit(QuantityKind.VELOCITY, system=UnitSystem.PULSE),
    "mm/s2": Unit(QuantityKind.ACCELERATION, system=UnitSystem.MM),
    "m/s2": Unit(QuantityKind.ACCELERATION, times=1000, system=UnitSystem.MM),
    "pulse/ms2": Unit(QuantityKind.ACCELERATION, system=UnitSystem.PULSE),
    "us": Unit(QuantityKind.TIME),
    "ms": Unit(QuantityKind.TIME, times=1000),
    "s": Unit(QuantityKind.TIME, times=1e6),
    "hz": Unit(QuantityKind.FREQUENCY, over=1000, system=PowerUnit.KHZ),
    "khz": Unit(QuantityKind.FREQUENCY, system=PowerUnit.KHZ),
    "mhz": Unit(QuantityKind.FREQUENCY, times=1000, system=PowerUnit.KHZ),
    "%": Unit(QuantityKind.SHARE, system=PowerUnit.PERCENT),
    "v": Unit(QuantityKind.VOLTAGE, system=PowerUnit.VOLT),
    "mv": Unit(QuantityKind.VOLTAGE, over=1000, system=PowerUnit.VOLT),
    "deg": Unit(QuantityKind.ANGLE),
}
"""Units by lower-case spelling. The canonical time is us; a dwell divides it by 1000."""

US_PER_MS = 1000.0
MS_PER_S = 1000.0


def spelling(unit: str) -> str:
    """Return the canonical spelling of a unit: khz -> kHz."""
    return {"khz": "kHz", "hz": "Hz", "mhz": "MHz", "v": "V", "mv": "mV"}.get(unit.lower(), unit.lower())


_N = TypeVar("_N", float, "Floats")


def velocity_pulse_per_ms(mm_s: _N, pulses_per_mm: float) -> _N:
    """Convert mm/s to the controller's pulse/ms."""
    return mm_s * pulses_per_mm / 1e3


def acceleration_pulse_per_ms2(mm_s2: _N, pulses_per_mm: float) -> _N:
    """Convert mm/s2 to the controller's pulse/ms2."""
    return mm_s2 * pulses_per_mm / 1e6
