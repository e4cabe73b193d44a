"""The machine that a job runs on, as frozen dataclasses with the profile's entries in their metadata.

profile.py reads them from gusjob.toml, which docs/profile.md describes.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from enum import StrEnum

from gusjob.config.entry import entry
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

DEFAULT_NAME = "default"
"""Name of a machine whose profile gives none."""


def _closed(name: str, unit: str, low: float, high: float) -> Range:
    return Range(name=name, unit=unit, low=low, high=high, section="profile")


def _whole(name: str, low: float, high: float) -> Range:
    return Range(name=name, unit="", low=low, high=high, whole=True, section="profile")


def _budget(unit: str) -> Range:
    return Range(name="budget", unit=unit, low=0, high=1e12, section="profile")


_COORDINATE_MM = _closed("field", "mm", -1e6, 1e6)
_TIMEOUT_S = _closed("time-out", "s", 0.01, 600)


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """A laser source. `rated_w`: watts at full power, None if unknown; `max_frequency_khz`: its highest response."""

    channel: int = field(default=0, metadata=entry(CHANNEL, "Laser channel", unique=True))
    name: str = field(default="", metadata=entry(str, "Name in reports", example='"30 W CO2"'))
    rated_w: float | None = field(
        default=None,
        metadata=entry(_closed("rated power", "W", 1e-6, 1e6), "Power at 100 %, for watts and joules", example="30"),
    )
    max_frequency_khz: float | None = field(
        default=None, metadata=entry(CARRIER_KHZ, "Highest response frequency", example="25")
    )

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanner:
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
_SCANNER_TEXT = re.compile(rf"({'|'.join(ScannerModel)}):((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) ?(us|ms|s)?", re.ASCII)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Interlock:
    """A digital input that must read `value` as long as a job runs: bit `input` of GT_GetDi(di_type)."""

    di_type: int = field(default=4, metadata=entry(SHORT, "Type of GT_GetDi; 4: general inputs"))
    input: int = field(default=0, metadata=entry(_whole("input", 0, 31), "Number of the input"))
    value: int = field(default=1, metadata=entry(SWITCH_VALUE, "Value while a job may run"))


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerSettings:
    """Access to the controller through the vendor's library, and its state after a run. An empty text is not set."""

    library: str = field(
        default="",
        metadata=entry(
            str, "Vendor's library: beside the profile, or where the system looks for it", example='"gts.dll"'
        ),
    )
    abi: Abi | None = field(default=None, metadata=entry(Abi, "Interface of the library", example='"gts"'))
    configuration: str = field(default="", metadata=entry(str, "File for GT_LoadConfig", example='"machine.cfg"'))
    card: int = field(default=0, metadata=entry(_whole("card", 0, 15), "Card number (gts-multi)"))
    open_channel: int = field(default=0, metadata=entry(SHORT, "First argument of GT_Open"))
    open_param: int = field(default=1, metadata=entry(SHORT, "Second argument of GT_Open"))
    axes_off_after: bool = field(default=False, metadata=entry(bool, "Switch the axes off after a run"))
    call_timeout_s: float = field(default=2.0, metadata=entry(_TIMEOUT_S, "Time after which a call counts as hung"))
    link_patience_s: float = field(
        default=5.0,
        metadata=entry(
            _closed("patience", "s", 0.01, 600), "Time for attempts to switch the laser off over a link without answer"
        ),
    )
    guard_switches_off: bool = field(
        default=False,
        metadata=entry(bool, "After a crash, let the guard process switch the controller off: see docs/hardware.md"),
    )
    position_tolerance_pulse: float = field(
        default=2.0,
        metadata=entry(_closed("tolerance", "pulse", 0, 1e6), "Allowed error of the position at the end of a run"),
    )
    interlock: Interlock | None = field(default=None, metadata=entry(Interlock))


def _limit(unit: str, help_text: str, example: str) -> float | None:
    limit: float | None = field(default=None, metadata=entry(_budget(unit), help_text, example=example))
    return limit


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The limits of a process; None: no limit. Energy per mm is the peak of a mark (simulate/quality/marks.py).

    Power and energy per mm are in the unit of the mode, and in watts and joules if the laser's rated power is known.
    """

    duration_s: float | None = _limit("s", "Time of the run", "60")
    power_pct: float | None = _limit("%", "Power in a duty mode", "80")
    power_khz: float | None = _limit("kHz", "Power in frequency mode", "20")
    power_v: float | None = _limit("V", "Power in analog mode", "8")
    power_w: float | None = _limit("W", "Power, with rated_w", "25")
    energy_pct_ms_per_mm: float | None = _limit("%*ms/mm", "Energy per mm at the peak of a mark", "500")
    energy_khz_ms_per_mm: float | None = _limit("kHz*ms/mm", "The same in frequency mode", "100")
    energy_v_ms_per_mm: float | None = _limit("V*ms/mm", "The same in analog mode", "50")
    energy_j_per_mm: float | None = _limit("J/mm", "The same in joules, with rated_w", "0.1")
    clamped_ms: float | None = _limit("ms", "Time for which a limit may clamp the power in a segment", "1")
    on_error_um: float | None = _limit("um", "Distance of the beam from the start of a mark when emission starts", "20")

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """The machine that a job runs on. The defaults are those of the job language."""

    name: str = field(default=DEFAULT_NAME, metadata=entry(str, "Name of the machine"))
    pulses_per_mm: tuple[float, float] = field(
        default=(1000.0, 1000.0),
        metadata=entry(
            _closed("pulses per mm", "pulse/mm", 0.001, 1e7), "Resolution, or [x, y]", pair=True, single=True
        ),
    )
    field_x_mm: tuple[float, float] = field(
        default=(-150.0, 150.0), metadata=entry(_COORDINATE_MM, "Field in X", pair=True, ascending=True)
    )
    field_y_mm: tuple[float, float] = field(
        default=(-150.0, 150.0), metadata=entry(_COORDINATE_MM, "Field in Y", pair=True, ascending=True)
    )
    max_velocity_mm_s: float = field(
        default=10_000.0, metadata=entry(_closed("velocity", "mm/s", 0.001, 1e9), "Highest velocity")
    )
    max_acceleration_mm_s2: float = field(
        default=1e6, metadata=entry(_closed("acceleration", "mm/s2", 0.001, 1e12), "Highest acceleration")
    )
    period_us: float = field(default=250.0, metadata=entry(_closed("period", "us", 1, 1e6), "Controller's tick"))
    scanner: Scanner | None = field(
        default=None,
        metadata=entry(
            Scanner,
            "Lag of the beam: delay, first-order or second-order, and its tracking error. Without it the beam is at "
            "the commanded position",
            example='"first-order:250us"',
        ),
    )
    chord_tolerance_um: float = field(
        default=1.0,
        metadata=entry(
            _closed("chord tolerance", "um", 0.01, 1000),
            "Tolerance for arcs that the axes can only run as lines; a tenth of a pulse if that is less",
        ),
    )
    host_calls_per_s: float | None = field(
        default=None,
        metadata=entry(
            _closed("calls per second", "1/s", 0.001, 1e9),
            "Calls per second that the host can send, for GJ515",
            example="20000",
        ),
    )
    duty2_switch: Duty2Switch = field(
        default=Duty2Switch.ON,
        metadata=entry(Duty2Switch, "Level of the switch line in DUTY2, in traces: on (PWM1+ low) or off (PWM1+ high)"),
    )
    expansion_max_statements: int = field(
        default=1_000_000,
        metadata=entry(
            _whole("statements", 1, 1e8),
            "Statements after expanding loops and routines",
            key="expansion.max_statements",
        ),
    )
    expansion_max_depth: int = field(
        default=64,
        metadata=entry(_whole("depth", 1, 150), "Depth of blocks, calls and includes", key="expansion.max_depth"),
    )
    expansion_max_includes: int = field(
        default=16,
        metadata=entry(_whole("includes", 0, 32), "Depth of includes", key="expansion.max_includes"),
    )
    lookahead_time_ms: float = field(
        default=5.0,
        metadata=entry(
            LOOKAHEAD_TIME_MS,
            "At a corner the velocity vector changes by at most time * acceleration",
            key="lookahead.time_ms",
        ),
    )
    lookahead_acc_pulse_per_ms2: float = field(
        default=1.0,
        metadata=entry(ACCELERATION, "See time_ms", key="lookahead.acc_pulse_per_ms2"),
    )
    controller: ControllerSettings = field(default=ControllerSettings(), metadata=entry(ControllerSettings))
    budget: Budget = field(default=Budget(), metadata=entry(Budget))
    lasers: tuple[Laser, ...] = field(default=(), metadata=entry(Laser, key="laser", repeated=True))

    @property
    def longest_run_ms(self) -> float:
        """Time of the longest run that can be simulated."""
        return MAX_TICKS * self.period_us / US_PER_MS

    @property
    def equal_axes(self) -> bool:
        """Whether X and Y have the same pulses per mm."""
        return self.pulses_per_mm[0] == self.pulses_per_mm[1]

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
