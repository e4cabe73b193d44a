"""The machine that a job runs on, as frozen dataclasses; profile.py reads them from TOML."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import StrEnum

from gusjob.controllers.gus.ranges import POWER_NOW, PowerMode
from gusjob.diagnostics.select import RuleSelection
from gusjob.i18n.phrases import Phrase, printable
from gusjob.kinematics.units import US_PER_MS, acceleration_pulse_per_ms2, velocity_pulse_per_ms


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """One laser source. `rated_w`: watts at full power, None if unknown; `max_frequency_khz`: its highest response."""

    channel: int
    name: str = ""
    rated_w: float | None = None
    max_frequency_khz: float | None = None

    def watts_per_unit(self, mode: PowerMode, pulse_width_us: float) -> float | None:
        """Average watts for one unit of power (1 %, 1 kHz, 1 V), or None if the rated power is unknown.

        Duty: rated * duty. Analog: rated * V / 10 (the full scale of M 二.2). Frequency: rated * f * width, that is
        the share of time in which the PWM line is active.
        """
        if self.rated_w is None:
            return None
        match mode:
            case PowerMode.DUTY | PowerMode.DUTY2:
                return self.rated_w / POWER_NOW[mode].high
            case PowerMode.ANALOG:
                return self.rated_w / POWER_NOW[mode].high
            case PowerMode.FREQUENCY:
                return self.rated_w * pulse_width_us / 1000


class ScannerModel(StrEnum):
    """How mirrors follow the command: so much later, or as a low pass of first or (critically damped) second order."""

    DELAY = "delay"
    FIRST_ORDER = "first-order"
    SECOND_ORDER = "second-order"


@dataclass(frozen=True, slots=True, kw_only=True)
class Scanner:
    """How the beam lags behind the command. At constant speed every model lags by speed * tracking error."""

    model: ScannerModel
    tracking_error_us: float

    def __str__(self) -> str:
        """As it is written."""
        return f"{self.model.value}:{self.tracking_error_us:g}us"


SCANNER_FORM = Phrase(
    "delay:TIME, first-order:TIME or second-order:TIME, such as first-order:250us, with a TIME of 0 to 1 s"
)
"""How a scanner is written."""

_SCANNER_MAX_US = 1e6
_SCANNER_TEXT = re.compile(rf"({'|'.join(ScannerModel)}):((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?) ?(us|ms|s)?", re.ASCII)


def parse_scanner(text: str) -> Scanner | str:
    """A scanner from `first-order:250us`, or what is wrong with the text. Units: us (also without a unit), ms, s."""
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
    """Which of the vendor's libraries it is: the GUS laser manual's, or one of the sister series."""

    GUS = "gus"
    GTS = "gts"
    GTS_MULTI = "gts-multi"


@dataclass(frozen=True, slots=True, kw_only=True)
class Interlock:
    """A digital input that must read `value` (0 or 1) as long as a job runs: GT_GetDi(di_type), its bit `input`.

    Type 4 are the general inputs of the sister series.
    """

    di_type: int = 4
    input: int = 0
    value: int = 1


@dataclass(frozen=True, slots=True, kw_only=True)
class ControllerSettings:
    """How the controller is reached, through the vendor's library, and how it is left. Empty texts: not given."""

    library: str = ""
    abi: Abi | None = None
    configuration: str = ""
    """The file for GT_LoadConfig."""
    card: int = 0
    open_channel: int = 0
    open_param: int = 1
    axes_off_after: bool = False
    call_timeout_s: float = 2.0
    """After so long without an answer a call counts as hung."""
    link_patience_s: float = 5.0
    """For so long the light is tried to be switched off over a link that does not answer."""
    position_tolerance_pulse: float = 2.0
    """By how much the position at the end may be off."""
    interlock: Interlock | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What a process may come to at most; None: anything. Energy per mm is the peak of a mark (report/marks.py).

    Power and energy per mm count in the unit of the mode; watts and joules where the laser's rated power is known.
    """

    duration_s: float | None = None
    power_pct: float | None = None
    power_khz: float | None = None
    power_v: float | None = None
    power_w: float | None = None
    energy_pct_ms_per_mm: float | None = None
    energy_khz_ms_per_mm: float | None = None
    energy_v_ms_per_mm: float | None = None
    energy_j_per_mm: float | None = None
    clamped_ms: float | None = None
    """Of a segment."""
    on_error_um: float | None = None
    """How far the beam may be off when the light comes, to either side."""

    def power(self, unit: str) -> float | None:
        """Highest power in the unit of a mode."""
        return {"%": self.power_pct, "kHz": self.power_khz, "V": self.power_v}[unit]

    def energy_per_mm(self, unit: str) -> float | None:
        """Highest energy per mm, unit*ms/mm."""
        energies = {"%": self.energy_pct_ms_per_mm, "kHz": self.energy_khz_ms_per_mm, "V": self.energy_v_ms_per_mm}
        return energies[unit]

    @property
    def judges_marks(self) -> bool:
        """Whether marks have to be looked at, which takes its time."""
        energies = (self.energy_pct_ms_per_mm, self.energy_khz_ms_per_mm, self.energy_v_ms_per_mm)
        return any(limit is not None for limit in (*energies, self.energy_j_per_mm, self.on_error_um))


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """What a job runs on. The defaults are the documented ones of the job language."""

    name: str = "default"
    pulses_per_mm: tuple[float, float] = (1000.0, 1000.0)
    field_x_mm: tuple[float, float] = (-150.0, 150.0)
    field_y_mm: tuple[float, float] = (-150.0, 150.0)
    max_velocity_mm_s: float = 10_000.0
    max_acceleration_mm_s2: float = 1e6
    period_us: float = 250.0
    lookahead_time_ms: float = 5.0
    lookahead_acc_pulse_per_ms2: float = 1.0
    chord_tolerance_um: float = 1.0
    host_calls_per_s: float | None = None
    expansion_max_statements: int = 3_000_000
    expansion_max_depth: int = 64
    expansion_max_includes: int = 16
    scanner: Scanner | None = None
    """None: the beam is where the command is."""
    lasers: tuple[Laser, ...] = field(default=())
    controller: ControllerSettings = ControllerSettings()
    budget: Budget = Budget()
    selection: RuleSelection = field(default=RuleSelection())

    @property
    def equal_axes(self) -> bool:
        """Whether X and Y have the same pulses per mm."""
        return self.pulses_per_mm[0] == self.pulses_per_mm[1]

    @property
    def max_velocity_pulse_per_ms(self) -> float:
        """The velocity limit for the coordinate system, on the finer axis."""
        return velocity_pulse_per_ms(self.max_velocity_mm_s, max(self.pulses_per_mm))

    @property
    def max_acceleration_pulse_per_ms2(self) -> float:
        """The acceleration limit for the coordinate system, on the finer axis."""
        return acceleration_pulse_per_ms2(self.max_acceleration_mm_s2, max(self.pulses_per_mm))

    def laser(self, channel: int) -> Laser:
        """The laser of a channel; one of unknown power if the profile names none."""
        return next((x for x in self.lasers if x.channel == channel), Laser(channel=channel))
