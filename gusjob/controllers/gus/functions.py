"""The functions of the sister series' library with their arguments, read from functions.txt.

They are facts of public headers (sister, GTS), and GT_BufLaserPrfFollow of the GUS laser manual (M 四.2). calls.py
holds the calls that gusjob models.
"""

from __future__ import annotations

from enum import StrEnum
from functools import cache
from pathlib import Path

from msgspec import Struct

from gusjob.patterns import lazy_pattern

_TABLE = Path(__file__).with_suffix(".txt")
_LINE = lazy_pattern(r"(?P<effect>\w+) +(?P<name>GT_\w+)\((?P<args>[^()]*)\)(?:  # M (?P<section>\S+))?")
_ARG = lazy_pattern(r"(?P<type>(?:unsigned )?\w+ \**)(?P<name>\w+)(?:=(?P<default>NULL|-?\d+))?")


class Effect(StrEnum):
    """What a function acts on; functions.txt describes each in its first lines."""

    LASER = "laser"
    PATH = "path"
    READ = "read"
    HOST = "host"
    OUTPUT = "output"
    OTHER = "other"


class FunctionArg(Struct, frozen=True, kw_only=True):
    """An argument; `c_type` as in C, with a pointer's stars. `default`: None if it must be given, 0 for NULL."""

    c_type: str
    name: str
    default: float | None = None


class LibraryFunction(Struct, frozen=True, kw_only=True):
    """A function of the library. `section`: of M, or 'sister'."""

    name: str
    effect: Effect
    args: tuple[FunctionArg, ...]
    section: str = "sister"

    @property
    def least(self) -> int:
        """Least number of arguments in C++."""
        return sum(arg.default is None for arg in self.args)

    @property
    def most(self) -> int:
        """Number of arguments in C, and the greatest in C++."""
        return len(self.args)


@cache
def functions() -> dict[str, LibraryFunction]:
    """Return every function by name."""
    lines = _TABLE.read_text(encoding="utf-8").splitlines()
    return {f.name: f for f in (_function(line) for line in lines if not line.startswith("#"))}


def _function(line: str) -> LibraryFunction:
    """Read one line of the table."""
    match = _LINE.fullmatch(line)
    if match is None:
        raise ValueError(line)
    effect, name, args, section = match.groups()
    return LibraryFunction(
        name=name,
        effect=Effect(effect),
        args=tuple(_arg(arg) for arg in args.split(", ") if arg),
        section=section or "sister",
    )


def _arg(text: str) -> FunctionArg:
    """Read one argument."""
    match = _ARG.fullmatch(text)
    if match is None:
        raise ValueError(text)
    c_type, name, default = match.groups()
    value = None if default is None else 0.0 if default == "NULL" else float(default)
    return FunctionArg(c_type=c_type.rstrip(), name=name, default=value)


GSN_PREFIX = "GTN_"
"""Prefix of the GSN library's functions (sister, GSN). It stands in place of GT_, and `short core` comes first.

GTN_Open and GTN_Close take no core.
"""

GSN_SAME_FORM = frozenset(
    {
        "GT_LnXY",
        "GT_LnXYG0",
        "GT_ArcXYC",
        "GT_ArcXYR",
        "GT_BufDelay",
        "GT_BufLaserOn",
        "GT_BufLaserOff",
        "GT_BufLaserPrfCmd",
        "GT_BufLaserFollowRatio",
        "GT_BufLaserFollowMode",
        "GT_BufLaserFollowOff",
        "GT_LaserPowerMode",
        "GT_LaserPrfCmd",
        "GT_LaserOutFrq",
        "GT_SetPulseWidth",
        "GT_SetLevelDelay",
        "GT_SetCrdPrm",
        "GT_SetCrdStopDec",
        "GT_CrdClear",
        "GT_CrdStart",
        "GT_CrdStatus",
        "GT_Stop",
        "GT_Reset",
    }
)
"""Calls of calls.SIGNATURES whose GTN_ function takes `core`, then M's arguments (sister, GSN).

Only the delays of GTN_SetLevelDelay differ in type: unsigned long. The public header has no function for the other
calls.
"""
