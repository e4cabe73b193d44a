"""The machine that a job runs on, as records whose annotations have the entries of the profile.

profile.py reads them from gusjob.toml, which docs/profile.md describes.
"""

from __future__ import annotations

import math
import re
from enum import StrEnum
from typing import Annotated

from msgspec import Struct

from gusjob.config.entry import Entry
from gusjob.controllers.gus.ranges import (
    ACCELERATION,
    CARRIER_KHZ,
    CHANNEL,
    LOOKAHEAD_TIME_MS,
    POWER_NOW,
    SHORT,
    SWITCH_VALUE,
    PowerMode,
    Range,
)
from gusjob.i18n.phrases import Phrase, printable
from gusjob.kinematics.float_noise import settled_one
from gusjob.kinematics.units import US_PER_MS, acceleration_pulse_per_ms2, velocity_pulse_per_ms
from gusjob.patterns import lazy_pattern

DEFAULT_NAME = "default"
"""Name of a machine whose profile gives none."""


def _closed(name: str, unit: str, low: float, high: float) -> Range:
    return Range(name=name, unit=unit, low=low, high=high, section="profile")


def _whole(name: str, low: float, high: float) -> Range:
    return Range(name=name, unit="", low=low, high=high, whole=True, section="profile")


_POSITION_MM = _closed("field", "mm", -1e6, 1e6)
_ENDS_MM = (-150.0, 150.0)
"""Where the default field begins and ends, in X and in Y."""
_TIMEOUT_S = _closed("time-out", "s", 0.01, 600)


class Laser(Struct, frozen=True, kw_only=True):
    """A laser source. `rated_w`: watts at full power, None if unknown; `max_frequency_khz`: its highest response."""

    channel: Annotated[int, Entry(CHANNEL, "Laser channel", unique=True)] = 0
    name: Annotated[str, Entry(str, "Name in reports", example='"30 W CO2"')] = ""
    rated_w: Annotated[
        float | None,
        Entry(_closed("rated power", "W", 1e-6, 1e6), "Power at 100 %, for watts and joules", example="30"),
    ] = None
    max_frequency_khz: Annotated[float | None, Entry(CARRIER_KHZ, "Highest response frequency", example="25")] = None

    def watts_per_unit(self, mode: PowerMode, pulse_width_us: float) -> float | None:
        """Return the average power in W for one unit of power (1 %, 1 kHz, 1 V), None if it is unknown.

        Duty modes: rated * duty. Analog: rated * V / 10. Frequency: rated * f * width, the share of time in which the
        PWM line is active; unknown without a pulse width, since the controller keeps that of an earlier program.

        Source: M 二.2 for the full scale of 10 V.
        """
        if self.rated_w is None:
            return None
        match mode:
            case PowerMode.DUTY | PowerMode.DUTY2:
                return self.rated_w / POWER_NOW[mode].high
            case PowerMode.ANALOG:
                return self.rated_w / POWER_NOW[mode].high
            case PowerMode.FREQUENCY:
                return self.rated_w * pulse_width_us / 1000 if pulse_width_us else None


class ScannerModel(StrEnum):
    """Response of the mirrors to the command: a delay, or a low pass of first or second order (critically damped)."""

    DELAY = "delay"
    FIRST_ORDER = "first-order"
    SECOND_ORDER = "second-order"


class Scanner(Struct, frozen=True, kw_only=True):
    """Lag of the beam behind the command: at constant velocity, every model lags by velocity * tracking error."""

    model: ScannerModel
    tracking_error_us: float

    def __str__(self) -> str:
        """Return the text of the profile, such as first-order:250us."""
        return f"{self.model.value}:{self.tracking_error_us:g}us"


SCANNER_FORM = Phrase(
    "delay:TIME, first-order:TIME or second-order:TIME, such as first-order:250us, with a TIME of 0 to 1 s"
)
"""The form of a scanner's text."""

_SCANNER_MAX_US = 1e6
_SCANNER_TEXT = lazy_pattern(
    rf"({'|'.join(ScannerModel)}):((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) ?(us|ms|s)?", re.ASCII
)


def parse_scanner(text: str) -> Scanner | str:
    """Parse a scanner such as `first-order:250us`, or say what is wrong. Units: us (the default), ms, s."""
    shown = f'"{printable(text)[:40]}"'
    found = _SCANNER_TEXT.fullmatch(text.strip())
    if not found:
        return Phrase("{text} is not a scanner: write {form}", text=shown, form=SCANNER_FORM)
    unit_us = {"ms": US_PER_MS, "s": US_PER_MS**2}.get(found[3], 1.0)
    lag_us = float(found[2]) * unit_us
    if lag_us > _SCANNER_MAX_US:
        return Phrase("the time in {text} is above 1 s: write {form}", text=shown, form=SCANNER_FORM)
    return Scanner(model=ScannerModel(found[1]), tracking_error_us=lag_us)


class Abi(StrEnum):
    """The vendor's library: that of the GUS laser manual, or one of the sister series."""

    GUS = "gus"
    GTS = "gts"
    GTS_MULTI = "gts-multi"


class Duty2Switch(StrEnum):
    """What the switch line carries in duty mode 2, where M says only that its signal is constantly high (二.2, 三.1).

    ON: "high" as in GT_SetLevelDelay (二.2), whose signal goes from high to low when the laser goes off: the + line is
    low, which is on (一.2). The mode sets the energy by its PWM alone, with the switch left open. OFF: the level of the
    + line itself, which by 一.2 is off.
    """

    ON = "on"
    OFF = "off"


class Interlock(Struct, frozen=True, kw_only=True):
    """A digital input that must read `value` as long as a job runs: bit `input` of GT_GetDi(di_type)."""

    di_type: Annotated[int, Entry(SHORT, "Type of GT_GetDi; 4: general inputs")] = 4
    input: Annotated[int, Entry(_whole("input", 0, 31), "Number of the input")] = 0
    value: Annotated[int, Entry(SWITCH_VALUE, "Value while a job may run")] = 1


class ControllerSettings(Struct, frozen=True, kw_only=True):
    """Access to the controller through the vendor's library, and its state after a run. An empty text is not set."""

    library: Annotated[
        str, Entry(str, "Vendor's library: beside the profile, or where the system looks for it", example='"gts.dll"')
    ] = ""
    abi: Annotated[Abi | None, Entry(Abi, "Interface of the library", example='"gts"')] = None
    configuration: Annotated[str, Entry(str, "File for GT_LoadConfig", example='"machine.cfg"')] = ""
    card: Annotated[int, Entry(_whole("card", 0, 15), "Card number (gts-multi)")] = 0
    open_channel: Annotated[int, Entry(SHORT, "First argument of GT_Open")] = 0
    open_param: Annotated[int, Entry(SHORT, "Second argument of GT_Open")] = 1
    axes_off_after: Annotated[bool, Entry(bool, "Switch the axes off after a run")] = False
    call_timeout_s: Annotated[float, Entry(_TIMEOUT_S, "Time after which a call counts as hung")] = 2.0
    link_patience_s: Annotated[
        float,
        Entry(
            _closed("patience", "s", 0.01, 600), "Time for attempts to switch the laser off over a link without answer"
        ),
    ] = 5.0
    guard_switches_off: Annotated[
        bool, Entry(bool, "After a crash, let the guard process switch the controller off: see docs/hardware.md")
    ] = False
    position_tolerance_pulse: Annotated[
        float, Entry(_closed("tolerance", "pulse", 0, 1e6), "Allowed error of the position at the end of a run")
    ] = 2.0
    interlock: Annotated[Interlock | None, Entry(Interlock)] = None


Limit = float | None
"""A limit of a budget; None: no limit."""


def _limit(unit: str, help_text: str, example: str) -> Entry:
    return Entry(Range(name="budget", unit=unit, low=0, high=1e12, section="profile"), help_text, example=example)


class Budget(Struct, frozen=True, kw_only=True):
    """The limits of a process. Energy per mm is the peak of a mark (simulate/quality/marks.py).

    Power and energy per mm are in the unit of the mode, and in watts and joules if the laser's rated power is known.
    """

    duration_s: Annotated[Limit, _limit("s", "Time of the run", "60")] = None
    power_pct: Annotated[Limit, _limit("%", "Power in a duty mode", "80")] = None
    power_khz: Annotated[Limit, _limit("kHz", "Power in frequency mode", "20")] = None
    power_v: Annotated[Limit, _limit("V", "Power in analog mode", "8")] = None
    power_w: Annotated[Limit, _limit("W", "Power, with rated_w", "25")] = None
    energy_pct_ms_per_mm: Annotated[Limit, _limit("%*ms/mm", "Energy per mm at the peak of a mark", "500")] = None
    energy_khz_ms_per_mm: Annotated[Limit, _limit("kHz*ms/mm", "The same in frequency mode", "100")] = None
    energy_v_ms_per_mm: Annotated[Limit, _limit("V*ms/mm", "The same in analog mode", "50")] = None
    energy_j_per_mm: Annotated[Limit, _limit("J/mm", "The same in joules, with rated_w", "0.1")] = None
    clamped_ms: Annotated[Limit, _limit("ms", "Time for which a limit may clamp the power in a segment", "1")] = None
    on_error_um: Annotated[
        Limit, _limit("um", "Distance of the beam from the start of a mark when emission starts", "20")
    ] = None

    def power(self, unit: str) -> float | None:
        """Return the power limit in the unit of a mode."""
        return {"%": self.power_pct, "kHz": self.power_khz, "V": self.power_v}[unit]

    def energy_per_mm(self, unit: str) -> float | None:
        """Return the limit of energy per mm in unit*ms/mm."""
        energies = {"%": self.energy_pct_ms_per_mm, "kHz": self.energy_khz_ms_per_mm, "V": self.energy_v_ms_per_mm}
        return energies[unit]

    @property
    def limits_marks(self) -> bool:
        """Whether a limit needs the analysis of marks, which takes time."""
        energies = (self.energy_pct_ms_per_mm, self.energy_khz_ms_per_mm, self.energy_v_ms_per_mm)
        return any(limit is not None for limit in (*energies, self.energy_j_per_mm, self.on_error_um))


MAX_TICKS = 10_000_000_000
"""A longer run is refused: its simulation would take too long."""
_USUAL_CHORDS = 1_000_000
"""Chords that the arcs of a job may become where the profile does not allow more statements than that."""


class Machine(Struct, frozen=True, kw_only=True):
    """The machine that a job runs on. The defaults are those of the job language."""

    name: Annotated[str, Entry(str, "Name of the machine")] = DEFAULT_NAME
    pulses_per_mm: Annotated[
        tuple[float, float],
        Entry(_closed("pulses per mm", "pulse/mm", 0.001, 1e7), "Resolution, or [x, y]", pair=True, single=True),
    ] = (1000.0, 1000.0)
    field_x_mm: Annotated[tuple[float, float], Entry(_POSITION_MM, "Field in X", pair=True, ascending=True)] = _ENDS_MM
    field_y_mm: Annotated[tuple[float, float], Entry(_POSITION_MM, "Field in Y", pair=True, ascending=True)] = _ENDS_MM
    max_velocity_mm_s: Annotated[float, Entry(_closed("velocity", "mm/s", 0.001, 1e9), "Highest velocity")] = 10_000.0
    max_acceleration_mm_s2: Annotated[
        float, Entry(_closed("acceleration", "mm/s2", 0.001, 1e12), "Highest acceleration")
    ] = 1e6
    period_us: Annotated[float, Entry(_closed("period", "us", 1, 1e6), "Controller's tick")] = 250.0
    scanner: Annotated[
        Scanner | None,
        Entry(
            Scanner,
            "Lag of the beam: delay, first-order or second-order, and its tracking error. Without it the beam is at "
            "the commanded position",
            example='"first-order:250us"',
        ),
    ] = None
    chord_tolerance_um: Annotated[
        float,
        Entry(
            _closed("chord tolerance", "um", 0.01, 1000),
            "Tolerance for arcs that the axes can only run as lines; a tenth of a pulse if that is less",
        ),
    ] = 1.0
    host_calls_per_s: Annotated[
        float | None,
        Entry(
            _closed("calls per second", "1/s", 0.001, 1e9),
            "Calls per second that the host can send, for GJ515",
            example="20000",
        ),
    ] = None
    duty2_switch: Annotated[
        Duty2Switch,
        Entry(Duty2Switch, "Level of the switch line in DUTY2, in traces: on (PWM1+ low) or off (PWM1+ high)"),
    ] = Duty2Switch.ON
    expansion_max_statements: Annotated[
        int,
        Entry(
            _whole("statements", 1, 1e8),
            "Statements after expanding loops and routines",
            key="expansion.max_statements",
        ),
    ] = 300_000
    expansion_max_depth: Annotated[
        int, Entry(_whole("depth", 1, 150), "Depth of blocks, calls and includes", key="expansion.max_depth")
    ] = 64
    expansion_max_includes: Annotated[
        int, Entry(_whole("includes", 0, 32), "Depth of includes", key="expansion.max_includes")
    ] = 16
    lookahead_time_ms: Annotated[
        float,
        Entry(
            LOOKAHEAD_TIME_MS,
            "At a corner the velocity vector changes by at most time * acceleration",
            key="lookahead.time_ms",
        ),
    ] = 5.0
    lookahead_acc_pulse_per_ms2: Annotated[
        float, Entry(ACCELERATION, "See time_ms", key="lookahead.acc_pulse_per_ms2")
    ] = 1.0
    controller: Annotated[ControllerSettings, Entry(ControllerSettings)] = ControllerSettings()
    budget: Annotated[Budget, Entry(Budget)] = Budget()
    lasers: Annotated[tuple[Laser, ...], Entry(Laser, key="laser", repeated=True)] = ()

    @property
    def longest_run_ms(self) -> float:
        """Time of the longest run that can be simulated."""
        return MAX_TICKS * self.period_us / US_PER_MS

    @property
    def equal_axes(self) -> bool:
        """Whether X and Y have the same pulses per mm."""
        return self.pulses_per_mm[0] == self.pulses_per_mm[1]

    @property
    def most_chords(self) -> int:
        """Number of chords that the arcs of a job may become."""
        return max(_USUAL_CHORDS, self.expansion_max_statements)

    @property
    def field_pulse(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The lowest and highest whole pulse of X and of Y in the field: positions are sent in whole pulses."""
        (x_low, x_high), (y_low, y_high) = (
            (settled_one(low * scale), settled_one(high * scale))
            for (low, high), scale in zip((self.field_x_mm, self.field_y_mm), self.pulses_per_mm, strict=True)
        )
        return (math.ceil(x_low), math.floor(x_high)), (math.ceil(y_low), math.floor(y_high))

    @property
    def max_velocity_pulse_per_ms(self) -> float:
        """Velocity limit of the coordinate system, on the finer axis."""
        return velocity_pulse_per_ms(self.max_velocity_mm_s, max(self.pulses_per_mm))

    @property
    def max_acceleration_pulse_per_ms2(self) -> float:
        """Acceleration limit of the coordinate system, on the finer axis."""
        return acceleration_pulse_per_ms2(self.max_acceleration_mm_s2, max(self.pulses_per_mm))

    def laser(self, channel: int) -> Laser:
        """Return the laser of a channel; one of unknown power if the profile has none."""
        return next((x for x in self.lasers if x.channel == channel), Laser(channel=channel))
