"""Setup statements of a job: those that are not part of the path."""

from __future__ import annotations

import math

from msgspec import Struct

from gusjob.controllers.gus.ranges import AUTO_SHARE, RUN_STEP_US, TIMELAG_OFF_US, TIMELAG_ZERO_US, PowerMode
from gusjob.kinematics.float_noise import settled_one
from gusjob.kinematics.units import PowerUnit


class LaserMode(Struct, frozen=True, kw_only=True):
    """LASER MODE: power limits in the mode's unit, carrier in the duty modes, laser pulse width in frequency mode."""

    mode: PowerMode
    low: float
    high: float
    carrier_khz: float | None = None
    pulse_width_us: float | None = None


class LaserDelay(Struct, frozen=True, kw_only=True):
    """LASER DELAY: delay of laser-on and of laser-off, whatever the level of the switch line."""

    on_delay_us: float
    off_delay_us: float


class LaserStandby(Struct, frozen=True, kw_only=True):
    """LASER STANDBY: output while the laser is off in the PWM modes; None: OFF."""

    pulse: tuple[float, float] | None
    """(kHz, %)"""


class LaserPrevolt(Struct, frozen=True, kw_only=True):
    """LASER PREVOLT: output while the laser is off in analog mode; None: OFF."""

    prevoltage_v: float | None


class LaserFpk(Struct, frozen=True, kw_only=True):
    """LASER FPK, the first pulse killer: (width, gap, off delay) in us; None: OFF."""

    times_us: tuple[float, float, float] | None


class DistanceFollow(Struct, frozen=True, kw_only=True):
    """Settings of LASER DISTANCE: reference in pulse, ratio in power units per mm, both for the axes X, Y, Z, A."""

    reference_pulse: tuple[float, float, float, float]
    ratio_per_mm: tuple[float, float, float, float]
    low: float
    high: float
    low_unit: PowerUnit
    high_unit: PowerUnit
    actual: bool


class LaserDistance(Struct, frozen=True, kw_only=True):
    """LASER DISTANCE; None: OFF."""

    settings: DistanceFollow | None


class SwitchNow(Struct, frozen=True, kw_only=True):
    """LASER ON NOW, LASER OFF NOW."""

    on: bool


class PowerNow(Struct, frozen=True, kw_only=True):
    """LASER POWER p NOW."""

    power: float
    unit: PowerUnit


class Wait(Struct, frozen=True, kw_only=True):
    """WAIT: the motion ends before the next statement."""


class LookAhead(Struct, frozen=True, kw_only=True):
    """LOOKAHEAD: (ms, pulse/ms2), NaN where the machine profile's value is in force; None: OFF."""

    corner: tuple[float, float] | None


class SkyWriting(Struct, frozen=True, kw_only=True):
    """Settings of SKYWRITE: `nprev` and `npost` in 10 us, `limit` a cosine. AUTO is replaced by its value already."""

    mode: float
    timelag_us: float
    shift_us: float
    nprev: float
    npost: float
    limit: float
    limit_given: bool

    @property
    def is_on(self) -> bool:
        """Whether sky writing is on: below 1/8 us it is off (RTC5)."""
        return self.timelag_us >= TIMELAG_OFF_US

    @property
    def lag_us(self) -> float:
        """Effective time lag: below 1/4 us it is 0 (RTC5)."""
        return self.timelag_us if self.timelag_us >= TIMELAG_ZERO_US else 0.0

    @property
    def run_in_us(self) -> float:
        """Time of the run-in at mark speed."""
        return RUN_STEP_US * self.nprev

    @property
    def run_out_us(self) -> float:
        """Time of the run-out at mark speed."""
        return RUN_STEP_US * self.npost

    @property
    def on_us(self) -> float:
        """Time of laser-on, from the start of the mark: not before the run-in is at mark speed."""
        return max(self.lag_us + self.shift_us, -self.run_in_us)


def auto_steps(word: str, timelag_us: float) -> float:
    """Compute NPREV or NPOST where it is AUTO, in 10 us: its share of the time lag, rounded (RTC5)."""
    return math.floor(settled_one(AUTO_SHARE[word] * timelag_us) + 0.5)


class SkyWrite(Struct, frozen=True, kw_only=True):
    """SKYWRITE; None: OFF."""

    settings: SkyWriting | None

    @property
    def is_on(self) -> bool:
        """Whether it switches sky writing on."""
        return self.settings is not None and self.settings.is_on


class Crd(Struct, frozen=True, kw_only=True):
    """CRD: coordinate system and FIFO."""

    crd: float
    fifo: float


SetupStatement = (
    LaserMode
    | LaserDelay
    | LaserStandby
    | LaserPrevolt
    | LaserFpk
    | LaserDistance
    | SwitchNow
    | PowerNow
    | Wait
    | LookAhead
    | SkyWrite
    | Crd
)


class Setup(Struct, frozen=True, kw_only=True):
    """A setup statement in its job: it acts before row `row` of the path.

    `order`: its number among the setup statements. `word`: the statement as a user calls it. `provenance`: as in Path.
    `unknown`: the state before it, bits of ir.effects.
    """

    statement: SetupStatement
    order: int
    row: int
    line: int
    channel: int
    word: str
    provenance: int = 0
    unknown: int = 0


IN_PATH = (LookAhead, SkyWrite, Crd)
"""Setup statements that rule the path behind them: they make no call and stop no motion."""
