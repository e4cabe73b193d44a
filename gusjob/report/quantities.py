"""Quantities for people: three or four significant digits, and a unit that suits the value."""

from __future__ import annotations

from gusjob.i18n.phrases import Phrase, figure
from gusjob.kinematics.units import MS_PER_S

HEADLINE_DIGITS = 3
TABLE_DIGITS = 4
_S_PER_MIN, _MIN_PER_H = 60, 60
_LONG_S = 600
"""A longer time is written in minutes or hours."""
_LENGTHS = ((1e3, "m"), (1.0, "mm"), (1e-3, "um"))
_ENERGIES = ((1e3, "kJ"), (1.0, "J"), (1e-3, "mJ"), (1e-6, "uJ"))


def short(value: float | None, digits: int = HEADLINE_DIGITS) -> str:
    """Format a number with so many significant digits; the digits before the point are always all there."""
    if value is not None and value == value and abs(value) >= 10**digits:
        return f"{value:.0f}"
    return figure(value, digits)


def duration(time_ms: float) -> str:
    """Format a time: 634 ms, 33.6 s, 12 min 34 s, 3 h 05 min."""
    seconds = time_ms / MS_PER_S
    if round(time_ms) < MS_PER_S:
        return f"{short(time_ms)} ms"
    if seconds < _LONG_S:
        return f"{short(seconds)} s"
    minutes, rest = divmod(round(seconds), _S_PER_MIN)
    if minutes < _MIN_PER_H:
        return f"{minutes} min {rest:02d} s"
    hours, minutes = divmod(round(seconds / _S_PER_MIN), _MIN_PER_H)
    return f"{hours} h {minutes:02d} min"


def length(value_mm: float) -> str:
    """Format a length: 198 mm, 10.2 m."""
    return _scaled(value_mm, _LENGTHS)


def energy(value_j: float) -> str:
    """Format an energy: 124 J, 12.3 mJ."""
    return _scaled(value_j, _ENERGIES)


def power_time(power_ms: float, unit: str) -> str:
    """Format an integral of power, given in the power's unit times ms: 263 %·s."""
    return f"{short(power_ms / MS_PER_S)} {unit}·s"


def percent(share: float) -> str:
    """Format a share: 97 %, 0.4 %."""
    return f"{short(100 * share, 2)} %"


def rated(value: float, unit: str, watts: float | None) -> str:
    """Format a power, with watts where they are known: 60 % (18 W)."""
    shown = f"{short(value)} {unit}"
    return shown if watts is None else Phrase("{power} ({watts} W)", power=shown, watts=short(watts))


def _scaled(value: float, units: tuple[tuple[float, str], ...]) -> str:
    """Format a value with the largest unit of which it is at least one; 0 with the base unit."""
    size = next((size for size, _ in units if abs(value) >= size * (1 - 1e-3 / 2)), units[-1][0] if value else 1.0)
    return f"{short(value / size)} {dict(units)[size]}"
