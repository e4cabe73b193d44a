"""GT_ calls as data, and their signatures.

Buffered calls are columns, all others objects. The effect of a call is defined in executor.py and model.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import IntEnum, StrEnum
from typing import Any

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from gusjob.controllers.gus import ranges
from gusjob.controllers.gus.ranges import Range
from gusjob.i18n.phrases import Phrase
from gusjob.ir.intent import Intent
from gusjob.kinematics.arrays import Floats


class Buffered(IntEnum):
    """The buffered calls. Those up to DELAY take time."""

    LINE = 0
    LINE_TO_REST = 1
    ARC_CENTRE = 2
    ARC_RADIUS = 3
    DELAY = 4
    ON = 5
    OFF = 6
    POWER = 7
    FOLLOW = 8
    FOLLOW_REAL = 9
    """A follow whose limits need not be whole."""
    FOLLOW_OFF = 10
    FOLLOW_SOURCE = 11


POWER_KINDS = (Buffered.POWER, Buffered.FOLLOW, Buffered.FOLLOW_REAL, Buffered.FOLLOW_OFF)
"""The buffered calls after which another power is in force."""
FOLLOW_KINDS = (Buffered.FOLLOW, Buffered.FOLLOW_REAL)
"""The buffered calls that start to follow the velocity."""


class ArgKind(IntEnum):
    """Kind of an argument in C."""

    WHOLE = 0
    REAL = 1
    ARRAY = 2
    POINTER = 3
    STRUCT = 4


class CType(StrEnum):
    """C type of an argument, or of the elements of an array or pointer."""

    SHORT = "short"
    USHORT = "unsigned short"
    LONG = "long"
    ULONG = "unsigned long"
    DOUBLE = "double"
    TEXT = "char *"
    CRD_PARAMETERS = "TCrdPrm"


WHOLE_TYPES: dict[CType, tuple[float, float]] = {
    CType.SHORT: (-(2.0**15), 2.0**15 - 1),
    CType.USHORT: (0.0, 2.0**16 - 1),
    CType.LONG: (-(2.0**31), 2.0**31 - 1),
    CType.ULONG: (0.0, 2.0**32 - 1),
}
"""The lowest and the highest number of each whole type. A long has 4 bytes, as on Windows, for which M describes the
library; with the 8 bytes of other systems the numbers beyond arrive as they are, and the controller refuses them."""

C_TYPE_WORDS: dict[CType, str] = {
    CType.LONG: Phrase("long (4 bytes, as on Windows)"),
    CType.ULONG: Phrase("unsigned long (4 bytes, as on Windows)"),
}
"""Whole types as messages name them, if not by their name alone."""


class Arg(Struct, frozen=True, kw_only=True):
    """An argument: its kind, its range (None if that depends on the power mode), its column if buffered.

    `c`: its type; `count`: number of elements of an array or pointer.
    """

    name: str
    kind: ArgKind
    range: Range | None = None
    column: str = ""
    c: CType = CType.SHORT
    count: int = 1

    @property
    def declaration(self) -> str:
        """The argument in C."""
        star = "" if self.kind in (ArgKind.WHOLE, ArgKind.REAL) else "*"
        return f"{self.c}{'' if self.c.endswith('*') else ' '}{star}{self.name}"


class Signature(Struct, frozen=True, kw_only=True):
    """Signature of a GT_ call.

    `buffered`: its number among the buffered calls, None for the others. `section`: of M, or 'sister'.
    """

    name: str
    args: tuple[Arg, ...]
    buffered: Buffered | None = None
    section: str = "sister"

    @property
    def prototype(self) -> str:
        """The call's prototype in C, without its semicolon. Every call returns a short."""
        return f"short {self.name}({', '.join(a.declaration for a in self.args) or 'void'})"


def _whole(name: str, allowed: Range | None = None, column: str = "", c: CType = CType.SHORT) -> Arg:
    return Arg(name=name, kind=ArgKind.WHOLE, range=allowed, column=column, c=c)


def _real(name: str, allowed: Range | None = None, column: str = "") -> Arg:
    return Arg(name=name, kind=ArgKind.REAL, range=allowed, column=column, c=CType.DOUBLE)


def _array(name: str, allowed: Range, c: CType) -> Arg:
    return Arg(name=name, kind=ArgKind.ARRAY, range=allowed, c=c, count=4)


def _found(name: str, c: CType, count: int = 1) -> Arg:
    return Arg(name=name, kind=ArgKind.POINTER, c=c, count=count)


_CRD = _whole("crd", ranges.CRD, "crd")
_FIFO = _whole("fifo", ranges.FIFO, "fifo")
_CH = _whole("channel", ranges.CHANNEL, "channel")
_TO = (
    _CRD,
    _whole("x", ranges.COORDINATE_PULSE, "x", CType.LONG),
    _whole("y", ranges.COORDINATE_PULSE, "y", CType.LONG),
)
_SPEED = (
    _real("vel", ranges.VELOCITY, "vel"),
    _real("acc", ranges.ACCELERATION, "acc"),
    _real("vel_end", ranges.END_VELOCITY, "vel_end"),
    _FIFO,
)
_DIR = _whole("dir", ranges.ARC_DIRECTION, "r")

_SIGNATURES = (
    Signature(name="GT_LnXY", args=(*_TO, *_SPEED), buffered=Buffered.LINE, section="四.3"),
    Signature(
        name="GT_LnXYG0",
        args=(
            *_TO,
            _real("synVel", ranges.VELOCITY, "vel"),
            _real("synAcc", ranges.ACCELERATION, "acc"),
            _FIFO,
        ),
        buffered=Buffered.LINE_TO_REST,
    ),
    Signature(
        name="GT_ArcXYC",
        args=(
            *_TO,
            _real("xc", ranges.ARC_CENTRE_PULSE, "p"),
            _real("yc", ranges.ARC_CENTRE_PULSE, "q"),
            _DIR,
            *_SPEED,
        ),
        buffered=Buffered.ARC_CENTRE,
    ),
    Signature(
        name="GT_ArcXYR",
        args=(*_TO, _real("r", ranges.RADIUS_PULSE, "p"), _DIR, *_SPEED),
        buffered=Buffered.ARC_RADIUS,
    ),
    Signature(
        name="GT_BufDelay",
        args=(_CRD, _whole("ms", ranges.DWELL_MS, "p", CType.USHORT), _FIFO),
        buffered=Buffered.DELAY,
    ),
    Signature(name="GT_BufLaserOn", args=(_CRD, _FIFO, _CH), buffered=Buffered.ON, section="四.2"),
    Signature(name="GT_BufLaserOff", args=(_CRD, _FIFO, _CH), buffered=Buffered.OFF, section="四.2"),
    Signature(
        name="GT_BufLaserPrfCmd",
        args=(_CRD, _real("laserPower", None, "p"), _FIFO, _CH),
        buffered=Buffered.POWER,
        section="四.2",
    ),
    Signature(
        name="GT_BufLaserPrfFollow",
        args=(
            _CRD,
            _real("ratio", ranges.FOLLOW_RATIO, "p"),
            _whole("minPower", None, "q", CType.LONG),
            _whole("maxPower", None, "r", CType.LONG),
            _FIFO,
            _CH,
        ),
        buffered=Buffered.FOLLOW,
        section="四.2",
    ),
    Signature(
        name="GT_BufLaserFollowRatio",
        args=(
            _CRD,
            _real("ratio", ranges.FOLLOW_RATIO, "p"),
            _real("minPower", None, "q"),
            _real("maxPower", None, "r"),
            _FIFO,
            _CH,
        ),
        buffered=Buffered.FOLLOW_REAL,
    ),
    Signature(name="GT_BufLaserFollowOff", args=(_CRD, _FIFO, _CH), buffered=Buffered.FOLLOW_OFF),
    Signature(
        name="GT_BufLaserFollowMode",
        args=(_CRD, _whole("source", ranges.FOLLOW_SOURCE, "p"), _FIFO, _CH, _real("startPower", None, "q")),
        buffered=Buffered.FOLLOW_SOURCE,
    ),
    Signature(
        name="GT_SetAxisMode",
        args=(_whole("axis", ranges.AXIS_MODE_AXIS), _whole("mode", ranges.AXIS_MODE)),
        section="二.2",
    ),
    Signature(name="GT_SetHSIOOpt", args=(_whole("value", ranges.SWITCH_VALUE, c=CType.USHORT), _CH), section="二.2"),
    Signature(name="GT_GetHSIOOpt", args=(_found("pValue", CType.USHORT), _CH), section="二.2"),
    Signature(
        name="GT_LaserPowerMode",
        args=(_whole("laserPowerMode", ranges.POWER_MODE), _real("maxValue"), _real("minValue"), _CH),
        section="二.2",
    ),
    Signature(name="GT_LaserPrfCmd", args=(_real("outputCmd"), _CH), section="二.2"),
    Signature(name="GT_LaserOutFrq", args=(_real("outFrq", ranges.CARRIER_KHZ), _CH), section="二.2"),
    Signature(
        name="GT_SetPulseWidth", args=(_whole("width", ranges.PULSE_WIDTH_US, c=CType.USHORT), _CH), section="二.2"
    ),
    Signature(
        name="GT_SetWaitPulse",
        args=(
            _whole("mode", ranges.SWITCH_VALUE, c=CType.USHORT),
            _real("waitPulseFrq", ranges.STANDBY_KHZ),
            _real("waitPulseDuty", ranges.STANDBY_PCT),
            _CH,
        ),
        section="二.2",
    ),
    Signature(
        name="GT_SetPreVltg",
        args=(_whole("mode", ranges.SWITCH_VALUE, c=CType.USHORT), _real("voltageValue", ranges.PREVOLTAGE_V), _CH),
        section="二.2",
    ),
    Signature(
        name="GT_SetLevelDelay",
        args=(
            _whole("highLevelDelay", ranges.SWITCH_DELAY_US, c=CType.USHORT),
            _whole("lowLevelDelay", ranges.SWITCH_DELAY_US, c=CType.USHORT),
            _CH,
        ),
        section="二.2",
    ),
    Signature(
        name="GT_EnaFPK",
        args=(
            _whole("time1", ranges.FPK_WIDTH_US, c=CType.USHORT),
            _whole("time2", ranges.FPK_GAP_US, c=CType.USHORT),
            _whole("laserOffDelay", ranges.FPK_OFF_DELAY_US, c=CType.USHORT),
            _CH,
        ),
        section="二.2",
    ),
    Signature(name="GT_DisFPK", args=(_CH,), section="二.2"),
    Signature(
        name="GT_SetLaserDisMode",
        args=(
            _whole("mode", ranges.DISTANCE_ENABLE),
            _whole("source", ranges.DISTANCE_SOURCE),
            _array("pPos", ranges.COORDINATE_PULSE, CType.LONG),
            _array("pScale", ranges.DISTANCE_SCALE, CType.DOUBLE),
            _CH,
        ),
        section="五.2",
    ),
    Signature(
        name="GT_SetLaserDisRatio",
        args=(
            _array("pRatio", ranges.DISTANCE_RATIO, CType.DOUBLE),
            _real("minPower"),
            _real("maxPower"),
            _CH,
        ),
        section="五.2",
    ),
    Signature(name="GT_SetCrdPrm", args=(_CRD, Arg(name="pCrdPrm", kind=ArgKind.STRUCT, c=CType.CRD_PARAMETERS))),
    Signature(
        name="GT_SetCrdStopDec",
        args=(
            _CRD,
            _real("decSmoothStop", ranges.ACCELERATION),
            _real("decAbruptStop", ranges.ACCELERATION),
        ),
    ),
    Signature(name="GT_CrdClear", args=(_CRD, _FIFO), section="四.3"),
    Signature(name="GT_CrdStart", args=(_whole("mask"), _whole("option")), section="四.3"),
    Signature(
        name="GT_CrdStatus",
        args=(_CRD, _found("pRun", CType.SHORT), _found("pSegment", CType.LONG), _FIFO),
    ),
    Signature(name="GT_Stop", args=(_whole("mask", c=CType.LONG), _whole("option", c=CType.LONG))),
    Signature(name="GT_Reset", args=()),
)

SIGNATURES: dict[str, Signature] = {s.name: s for s in _SIGNATURES}
"""Every call that has an effect on laser or path."""

BUFFERED: dict[Buffered, Signature] = {s.buffered: s for s in _SIGNATURES if s.buffered is not None}

_AXIS = _whole("axis", ranges.AXIS)
_COUNT = _whole("count", ranges.AXIS)

HOST_CALLS: dict[str, Signature] = {
    s.name: s
    for s in (
        Signature(name="GT_Open", args=(_whole("channel"), _whole("param"))),
        Signature(name="GT_Close", args=()),
        SIGNATURES["GT_Reset"],
        Signature(name="GT_LoadConfig", args=(Arg(name="pFile", kind=ArgKind.WHOLE, c=CType.TEXT),)),
        Signature(name="GT_ClrSts", args=(_AXIS, _COUNT)),
        Signature(name="GT_AxisOn", args=(_AXIS,)),
        Signature(name="GT_AxisOff", args=(_AXIS,)),
        Signature(name="GT_GetDi", args=(_whole("diType"), _found("pValue", CType.LONG))),
        SIGNATURES["GT_Stop"],
        Signature(name="GT_CrdSpace", args=(_CRD, _found("pSpace", CType.LONG), _FIFO)),
        Signature(name="GT_GetCrdPos", args=(_CRD, _found("pPos", CType.DOUBLE, 8))),
    )
}
"""Calls of a host program, besides those that every job needs (sister)."""

CRD_FIELDS: tuple[tuple[str, CType, int, Range | None], ...] = (
    ("dimension", CType.SHORT, 1, ranges.DIMENSION),
    ("profile", CType.SHORT, 8, ranges.SHORT),
    ("synVelMax", CType.DOUBLE, 1, None),
    ("synAccMax", CType.DOUBLE, 1, None),
    ("evenTime", CType.SHORT, 1, ranges.EVEN_TIME_MS),
    ("setOriginFlag", CType.SHORT, 1, ranges.SHORT),
    ("originPos", CType.LONG, 8, ranges.COORDINATE_PULSE),
)
"""Fields of TCrdPrm in order (sister): name, type, count, range (None for numbers that need not be whole)."""

Value = float | str | tuple["Value", ...]
"""An argument of a call that is not buffered: a number, a pointer's name, an array or a struct."""


class Call(Struct, frozen=True, kw_only=True):
    """One call that is not buffered. `at`: number of buffered calls before it; `line`: source line.

    `time_ms`: time of the call on the recorder's clock; NaN in a listing without times.
    """

    name: str
    args: tuple[Value, ...]
    at: int
    line: int
    time_ms: float = math.nan

    @property
    def waits(self) -> bool:
        """Whether it waits for the end of the motion: a GT_CrdStatus, unless it was recorded with what it read."""
        return self.name == "GT_CrdStatus" and isinstance(self.args[1], str)


def crd_start(crd: int, fifo: int, *, at: int, line: int) -> Call:
    """Make GT_CrdStart of one coordinate system with one FIFO: bit 0 is system 1, bit 1 the other (sister)."""
    return Call(name="GT_CrdStart", args=(float(1 << (crd - 1)), float(fifo << (crd - 1))), at=at, line=line)


class BufferedCalls(Struct, frozen=True, kw_only=True, eq=False):
    """Buffered calls, (n,) each; unused entries are 0. A column with one value for all calls may have stride 0.

    x, y in pulse, vel in pulse/ms, acc in pulse/ms2. p, q, r by call: an arc's centre offset x, y (or radius) and
    its direction; a delay's ms; a power; a follow's ratio, min, max; a follow's source and start power.
    """

    kind: npt.NDArray[np.uint8]
    line: npt.NDArray[np.int32]
    crd: npt.NDArray[np.int16]
    fifo: npt.NDArray[np.int16]
    channel: npt.NDArray[np.int16]
    x: Floats
    y: Floats
    p: Floats
    q: Floats
    r: Floats
    vel: Floats
    acc: Floats
    vel_end: Floats

    def __len__(self) -> int:
        return len(self.kind)

    def column(self, name: str) -> npt.NDArray[Any]:
        """Return a column by its name in a signature."""
        found: npt.NDArray[Any] = getattr(self, name)
        return found

    def pick(self, where: npt.NDArray[Any] | slice) -> BufferedCalls:
        """Pick the calls at a mask, at indices or in a slice."""
        return BufferedCalls(**{name: self.column(name)[where] for name in self.__struct_fields__})


class ArgumentConversion(Struct, frozen=True, kw_only=True, eq=False):
    """Numbers of one argument that do not arrive as they are written, (k,): source line, number, what arrives.

    `arrives`: NaN where C does not define it: the call is not in the stream. `c`: type of the argument.
    """

    call: str
    argument: str
    c: CType
    line: npt.NDArray[np.int32]
    written: Floats
    arrives: Floats


class Stream(Struct, frozen=True, kw_only=True):
    """A sequence of GT_ calls. `intent`: of a planned job with sky writing; a listing has none.

    `conversions`: arguments that a listing writes otherwise, since C converts them to the types of the calls.
    """

    name: str
    buffered: BufferedCalls
    calls: tuple[Call, ...] = ()
    intent: Intent | None = None
    conversions: tuple[ArgumentConversion, ...] = ()

    def parts(self) -> Iterator[tuple[int, int, Call | None]]:
        """Yield (first, last, call): buffered calls first..last-1, then the call after them (None at the end)."""
        done = 0
        for call in self.calls:
            yield done, call.at, call
            done = call.at
        yield done, len(self.buffered), None
