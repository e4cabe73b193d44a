"""The table of documented ranges, which all checks, calls, simulations and printed tables use.

Sources: "M" is the vendor's GUS laser manual (section numbers are M's own), "sister" the public headers of the
vendor's sister series (GTS), where M has no value. This module imports nothing from gusjob.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import TYPE_CHECKING, Any

from msgspec import Struct
from msgspec.structs import force_setattr

if TYPE_CHECKING:  # Help texts and profiles need the ranges, but no arrays: start-up time is part of the tool.
    import numpy as np
    import numpy.typing as npt


class PowerMode(IntEnum):
    """First argument of GT_LaserPowerMode (M 二.2).

    M 一 names three modes, M 三.1 four; the argument takes four.
    """

    DUTY = 0
    FREQUENCY = 1
    ANALOG = 2
    DUTY2 = 3

    @property
    def unit(self) -> str:
        """Unit of power in this mode: %, kHz or V."""
        return ("%", "kHz", "V", "%")[self]

    @property
    def is_pwm(self) -> bool:
        """Whether the energy output is a PWM signal (all modes but analog, M 二.2)."""
        return self is not PowerMode.ANALOG


class Membership(IntEnum):
    """Whether a value lies in a range."""

    INSIDE = 0
    ON_TOLERATED_END = 1
    OUTSIDE = 2


class Range(Struct, frozen=True, kw_only=True):
    """One documented range.

    `low_open`, `high_open`: the end itself is excluded. `ends_tolerated`: M excludes the ends in words but uses them
    in its own examples, so a value on an end is a warning. `whole`: the C type carries whole numbers only.
    """

    name: str
    unit: str
    low: float
    high: float
    low_open: bool = False
    high_open: bool = False
    ends_tolerated: bool = False
    whole: bool = False
    section: str
    note: str = ""

    def __post_init__(self) -> None:
        # The table reads better with 0 than with 0.0; what is computed with is a float.
        force_setattr(self, "low", float(self.low))
        force_setattr(self, "high", float(self.high))

    def classify(self, value: npt.ArrayLike) -> npt.NDArray[np.int8]:
        """Classify values: the Membership of each, in the shape of `value`; NaN is outside."""
        import numpy as np

        v = np.asarray(value, dtype=np.float64)
        inside = (v > self.low if self.low_open else v >= self.low) & (
            v < self.high if self.high_open else v <= self.high
        )
        membership = np.where(inside, np.int8(Membership.INSIDE), np.int8(Membership.OUTSIDE))
        if self.ends_tolerated:
            on_end = ~inside & ((v == self.low) | (v == self.high))
            membership[on_end] = Membership.ON_TOLERATED_END
        return membership

    def classify_one(self, value: float) -> Membership:
        """Classify one value."""
        above = value > self.low or (value == self.low and not self.low_open)
        below = value < self.high or (value == self.high and not self.high_open)
        if above and below:
            return Membership.INSIDE
        on_end = value in (self.low, self.high)
        return Membership.ON_TOLERATED_END if on_end and self.ends_tolerated else Membership.OUTSIDE

    def carries(self, value: npt.ArrayLike) -> Any:
        """Whether the argument's C type can carry the value: finite, and whole where the type is an integer."""
        import numpy as np

        v = np.asarray(value, dtype=np.float64)
        return np.isfinite(v) & (v == np.floor(v)) if self.whole else np.isfinite(v)

    def __str__(self) -> str:
        left, right = "(" if self.low_open else "[", ")" if self.high_open else "]"
        return f"{left}{_plain(self.low)}, {_plain(self.high)}{right}{' ' + self.unit if self.unit else ''}"


def _plain(value: float) -> str:
    return f"{value:.0f}" if math.isfinite(value) and value == int(value) else repr(value)


_MODES = "M names three modes in 一 and four in 三.1; the argument takes four"
_OPEN = (
    "M prints an open interval here and a closed one for GT_LaserPrfCmd, and its own example (五.3) uses "
    "an end: a value on an end is a warning, outside it an error"
)
_FOLLOW = _OPEN + "; the argument is a C long, so whole numbers only"

# Laser: energy (M 二.2).
MODE_LIMIT_PCT = Range(name="mode limits, duty", unit="%", low=0, high=100, section="二.2", note=_MODES)
MODE_LIMIT_KHZ = Range(name="mode limits, frequency", unit="kHz", low=0, high=2000, section="二.2", note=_MODES)
MODE_LIMIT_V = Range(name="mode limits, analog", unit="V", low=0, high=10, section="二.2", note=_MODES)
POWER_NOW_PCT = Range(name="immediate power, duty", unit="%", low=0, high=100, section="二.2")
POWER_NOW_KHZ = Range(name="immediate power, frequency", unit="kHz", low=0, high=2000, section="二.2")
POWER_NOW_V = Range(name="immediate power, analog", unit="V", low=0, high=10, section="二.2")
CARRIER_KHZ = Range(
    name="carrier",
    unit="kHz",
    low=0,
    high=2000,
    low_open=True,
    section="二.2",
    note="M prints (0~2000KHz]; must be set in the duty modes, and not above the laser's highest response frequency",
)
PULSE_WIDTH_US = Range(
    name="laser pulse width",
    unit="us",
    low=0,
    high=65535,
    low_open=True,
    whole=True,
    section="二.2",
    note="sister headers take an unsigned long; the range is that of M's unsigned short",
)
PULSE_DUTY_PCT = Range(
    name="laser pulse width times frequency",
    unit="%",
    low=0.1,
    high=100,
    low_open=True,
    high_open=True,
    section="二.2",
    note="with the mode's MAX of M's own routine 三.1 (2) this would be 1000 %, so the range applies to powers, "
    "not to the mode's MAX",
)

# Laser: switch, standby, first pulse (M 二.2).
SWITCH_DELAY_US = Range(
    name="switch delay",
    unit="us",
    low=0,
    high=65535,
    whole=True,
    section="二.2",
    note="M names the delays by level (high to low = off, low to high = on), but in 一.2 the switch line is "
    "high when off; gusjob follows M's names off and on: the off delay comes first",
)
STANDBY_KHZ = Range(name="standby frequency", unit="kHz", low=0, high=2000, low_open=True, section="二.2")
STANDBY_PCT = Range(name="standby duty", unit="%", low=0, high=100, section="二.2")
PREVOLTAGE_V = Range(name="pre-voltage", unit="V", low=0, high=10, section="二.2")
FPK_WIDTH_US = Range(name="FPK width", unit="us", low=0, high=65535, low_open=True, whole=True, section="二.2")
FPK_GAP_US = Range(name="FPK gap", unit="us", low=0, high=65535, whole=True, section="二.2")
FPK_OFF_DELAY_US = Range(name="FPK off delay", unit="us", low=0, high=65535, whole=True, section="二.2")
SWITCH_VALUE = Range(name="switch value", unit="", low=0, high=1, whole=True, section="二.2")
CHANNEL = Range(
    name="laser channel",
    unit="",
    low=0,
    high=1,
    whole=True,
    section="二.2",
    note="M's examples say 'channel 1' for number 0",
)
CHANNELS = tuple(range(int(CHANNEL.low), int(CHANNEL.high) + 1))
"""Every laser channel."""
AXIS_MODE_AXIS = Range(
    name="axis of GT_SetAxisMode",
    unit="",
    low=7,
    high=8,
    whole=True,
    section="二.2",
    note="must not be called in analog mode: M's analog routine calls it, but a comment in it forbids it; "
    "gusjob follows the comment",
)
AXIS_MODE = Range(
    name="mode of GT_SetAxisMode", unit="", low=0, high=1, whole=True, section="二.2", note="axis 8 takes 1 only"
)
POWER_MODE = Range(name="power mode", unit="", low=0, high=3, whole=True, section="二.2", note=_MODES)

# Laser: buffered power (M 四.2).
POWER_PCT = Range(
    name="buffered power, duty",
    unit="%",
    low=0,
    high=100,
    low_open=True,
    high_open=True,
    ends_tolerated=True,
    section="四.2",
    note=_OPEN,
)
POWER_KHZ = Range(
    name="buffered power, frequency",
    unit="kHz",
    low=0,
    high=2000,
    low_open=True,
    high_open=True,
    ends_tolerated=True,
    section="四.2",
    note=_OPEN,
)
POWER_V = Range(
    name="buffered power, analog",
    unit="V",
    low=0,
    high=10,
    low_open=True,
    high_open=True,
    ends_tolerated=True,
    section="四.2",
    note=_OPEN,
)
FOLLOW_PCT = Range(
    name="follow limits, duty",
    unit="%",
    low=0,
    high=100,
    low_open=True,
    high_open=True,
    ends_tolerated=True,
    whole=True,
    section="四.2",
    note=_FOLLOW,
)
FOLLOW_KHZ = Range(
    name="follow limits, frequency",
    unit="kHz",
    low=0,
    high=2000,
    low_open=True,
    high_open=True,
    ends_tolerated=True,
    whole=True,
    section="四.2",
    note=_FOLLOW,
)
FOLLOW_V = Range(
    name="follow limits, analog",
    unit="V",
    low=0,
    high=10,
    low_open=True,
    high_open=True,
    ends_tolerated=True,
    whole=True,
    section="四.2",
    note=_FOLLOW,
)
FOLLOW_RATIO = Range(
    name="follow ratio",
    unit="",
    low=0,
    high=math.inf,
    low_open=True,
    high_open=True,
    section="四.2",
    note="M: must be positive; power units per pulse/ms",
)
FOLLOW_SOURCE = Range(
    name="follow source",
    unit="",
    low=0,
    high=1,
    whole=True,
    section="sister",
    note="0 planned velocity, 1 measured velocity, which gusjob does not simulate",
)

# Laser: distance follow (M 五.2). M prints no ranges for the limits; a limit is a power.
DISTANCE_LIMIT_PCT = Range(name="distance follow limits, duty", unit="%", low=0, high=100, section="五.2")
DISTANCE_LIMIT_KHZ = Range(name="distance follow limits, frequency", unit="kHz", low=0, high=2000, section="五.2")
DISTANCE_LIMIT_V = Range(name="distance follow limits, analog", unit="V", low=0, high=10, section="五.2")
DISTANCE_SCALE = Range(
    name="distance follow scale",
    unit="pulse/mm",
    low=0,
    high=math.inf,
    low_open=True,
    high_open=True,
    section="五.2",
    note="M prints no range; a scale of 0 has no meaning",
)
DISTANCE_RATIO = Range(
    name="distance follow ratio",
    unit="",
    low=-math.inf,
    high=math.inf,
    low_open=True,
    high_open=True,
    section="五.2",
    note="M: 0, positive or negative; power units per mm",
)
DISTANCE_ENABLE = Range(name="distance follow enable", unit="", low=0, high=1, whole=True, section="五.2")
DISTANCE_SOURCE = Range(name="distance follow source", unit="", low=0, high=1, whole=True, section="五.2")

# Motion (M 四.2 for crd and fifo; the rest sister, since M refers to the basic manual).
CRD = Range(name="coordinate system", unit="", low=1, high=2, whole=True, section="四.2")
FIFO = Range(
    name="FIFO",
    unit="",
    low=0,
    high=1,
    whole=True,
    section="四.2",
    note="M gives a default to it but not to the next argument, which is illegal C: it is always written",
)
COORDINATE_PULSE = Range(
    name="coordinate", unit="pulse", low=-1073741823, high=1073741823, whole=True, section="sister"
)
VELOCITY = Range(name="velocity", unit="pulse/ms", low=0, high=32767, low_open=True, high_open=True, section="sister")
ACCELERATION = Range(
    name="acceleration", unit="pulse/ms2", low=0, high=32767, low_open=True, high_open=True, section="sister"
)
END_VELOCITY = Range(name="end velocity", unit="pulse/ms", low=0, high=32767, high_open=True, section="sister")
RADIUS_PULSE = Range(
    name="arc radius",
    unit="pulse",
    low=-1073741823,
    high=1073741823,
    section="sister",
    note="r > 0 up to 180 degrees, r < 0 more; no full circle",
)
ARC_CENTRE_PULSE = Range(
    name="arc centre",
    unit="pulse",
    low=-1073741823,
    high=1073741823,
    section="sister",
    note="offset from the start, a C double: need not be whole",
)
ARC_DIRECTION = Range(
    name="arc direction", unit="", low=0, high=1, whole=True, section="sister", note="0 clockwise, 1 counter-clockwise"
)
DWELL_MS = Range(name="dwell", unit="ms", low=0, high=16383, whole=True, section="sister")
LOOKAHEAD_TIME_MS = Range(name="look-ahead cornering time", unit="ms", low=0, high=100, section="sister")
SKYWRITE_MODE = Range(name="sky writing mode", unit="", low=1, high=3, whole=True, section="RTC5")
TIMELAG_US = Range(
    name="sky writing time lag",
    unit="us",
    low=0,
    high=65535,
    section="RTC5",
    note="below 1/8 us sky writing is off, 1/8 to 1/4 us counts as 0",
)
SHIFT_US = Range(
    name="sky writing laser-on shift",
    unit="us",
    low=-65535,
    high=65535,
    section="RTC5",
    note="in steps of 0.5 us; + is later: the formula printed in the RTC5 manual has a minus, but its own text a plus",
)
RUN_STEPS = Range(
    name="sky writing run-in, run-out",
    unit="",
    low=0,
    high=65535,
    whole=True,
    section="RTC5",
    note="in steps of 10 us; 65535 is AUTO: 0.15 and 0.10 times the time lag",
)
CORNER_LIMIT = Range(name="sky writing corner limit", unit="", low=-1, high=1, section="RTC5", note="a cosine")
DIMENSION = Range(name="dimension", unit="", low=1, high=4, whole=True, section="sister")
SHORT = Range(name="short", unit="", low=-(2**15), high=2**15 - 1, whole=True, section="sister")
AXIS = Range(name="axis", unit="", low=1, high=8, whole=True, section="sister")
EVEN_TIME_MS = Range(name="even time", unit="ms", low=0, high=32767, high_open=True, whole=True, section="sister")

POWER_NOW = dict(zip(PowerMode, (POWER_NOW_PCT, POWER_NOW_KHZ, POWER_NOW_V, POWER_NOW_PCT), strict=True))
MODE_LIMIT = dict(zip(PowerMode, (MODE_LIMIT_PCT, MODE_LIMIT_KHZ, MODE_LIMIT_V, MODE_LIMIT_PCT), strict=True))
POWER = dict(zip(PowerMode, (POWER_PCT, POWER_KHZ, POWER_V, POWER_PCT), strict=True))
FOLLOW = dict(zip(PowerMode, (FOLLOW_PCT, FOLLOW_KHZ, FOLLOW_V, FOLLOW_PCT), strict=True))
DISTANCE_LIMIT = dict(
    zip(PowerMode, (DISTANCE_LIMIT_PCT, DISTANCE_LIMIT_KHZ, DISTANCE_LIMIT_V, DISTANCE_LIMIT_PCT), strict=True)
)

TABLE: tuple[Range, ...] = tuple(value for value in list(globals().values()) if isinstance(value, Range))
"""Every range, in the order above; grammar/README.md's table is generated from it."""

TIMELAG_OFF_US, TIMELAG_ZERO_US = 1 / 8, 1 / 4
"""Below the first, sky writing is off; below the second, its time lag counts as 0 (RTC5)."""
SHIFT_STEP_US = 0.5
RUN_STEP_US = 10.0
"""Of LaserOnShift, and of Nprev and Npost (RTC5)."""
AUTO_STEPS = 65535.0
AUTO_SHARE = {"NPREV": 0.15, "NPOST": 0.10}
"""Nprev and Npost that are AUTO: these times the time lag (RTC5)."""
DEFAULT_LIMIT = 0.9

FIFO_SLOTS = 4096
"""Buffered calls that a FIFO holds; when it is full a call returns 1 and is to be sent again (sister)."""

CONTRADICTIONS: tuple[tuple[str, str, str], ...] = (
    ("一, 三.1", "three power modes, then four", "four: 0 duty 1, 1 frequency, 2 analog, 3 duty 2"),
    ("二.2, 四.2", "[0,100] % immediate, (0,100) % buffered", "an end of the buffered range is a warning"),
    ("三.1 (3)", "the analog routine calls GT_SetAxisMode, its comment forbids it", "the comment applies: a warning"),
    ("四.2", "the text names GT_LaserOn, which is in no list", "GT_BufLaserOn is meant"),
    ("四.2", "fifo=0 before an argument without default", "illegal C: every argument is always written"),
    (
        "二.2, 一.2",
        "GT_SetLevelDelay names levels that differ from those of the switch line",
        "the first argument is the off delay, the second the on delay",
    ),
    (
        "二.2, 一.2",
        "in duty mode 2 the switch signal is constantly high, but high on the + line of the switch is off",
        "high is on, as in GT_SetLevelDelay; duty2_switch in the machine profile changes it in traces",
    ),
)
"""Contradictions in M: section, the two statements, and the decision of gusjob."""
