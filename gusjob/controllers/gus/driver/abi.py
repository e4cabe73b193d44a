"""The vendor's libraries as data: GUS as in the laser manual, GTS single-card and multi-card (sister).

Prototypes come from the signatures of stream.py; here stands only in what each library differs from the manual.
On Windows the calls are __stdcall, elsewhere cdecl; `long` is the platform's own, 4 bytes on Windows.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gusjob.config.machine import Abi
from gusjob.controllers.gus.calls import CRD_FIELDS, HOST_CALLS, SIGNATURES, Arg, ArgKind, CType, Signature
from gusjob.i18n.phrases import Phrase


@dataclass(frozen=True, slots=True, kw_only=True)
class Prototype:
    """A call of ours as one library has it: its symbol there, its arguments, and constants before and behind ours."""

    symbol: str
    args: tuple[Arg, ...]
    before: tuple[int, ...] = ()
    behind: tuple[int, ...] = ()

    @property
    def argtypes(self) -> tuple[Any, ...]:
        """The ctypes of all arguments, the constants (short, all of them) among them."""
        own = tuple(_argtype(arg) for arg in self.args)
        return (ctypes.c_short,) * len(self.before) + own + (ctypes.c_short,) * len(self.behind)


@dataclass(frozen=True, slots=True, kw_only=True)
class AbiProfile:
    """One library. `leading_card`: every call takes the card's number first.

    `changes`: the calls that differ, by the manual's name. `foreign`: a symbol that only a library of the other family
    has, and ours in its place; where that one stands and ours does not, it is the other family.
    """

    title: str
    leading_card: bool = False
    changes: Mapping[str, Prototype] = field(default_factory=dict)
    foreign: tuple[str, str]


_FOLLOW, _FOLLOW_RATIO = "GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio"


def _retyped(call: str, **types: CType) -> tuple[Arg, ...]:
    """The arguments of a call, some of them of another type."""
    return tuple(replace(arg, c=types.get(arg.name, arg.c)) for arg in SIGNATURES[call].args)


_GTS_CHANGES = {
    # A fifth argument, delaymode, that M does not have.
    "GT_LaserPowerMode": Prototype(symbol="GT_LaserPowerMode", args=SIGNATURES["GT_LaserPowerMode"].args, behind=(0,)),
    "GT_SetPulseWidth": Prototype(symbol="GT_SetPulseWidth", args=_retyped("GT_SetPulseWidth", width=CType.ULONG)),
    _FOLLOW: Prototype(symbol=_FOLLOW_RATIO, args=_retyped(_FOLLOW, minPower=CType.DOUBLE, maxPower=CType.DOUBLE)),
}

ABI_PROFILES = {
    Abi.GUS: AbiProfile(title=Phrase("GUS, as in the laser manual"), foreign=(_FOLLOW_RATIO, _FOLLOW)),
    Abi.GTS: AbiProfile(title=Phrase("GTS, one card"), changes=_GTS_CHANGES, foreign=(_FOLLOW, _FOLLOW_RATIO)),
    Abi.GTS_MULTI: AbiProfile(
        title=Phrase("GTS, several cards"), leading_card=True, changes=_GTS_CHANGES, foreign=(_FOLLOW, _FOLLOW_RATIO)
    ),
}

PROBE = "GT_ClrSts"
"""The call by which a library is tried: no pointers, no effect on light or motion."""
PROBE_ARGUMENTS = (1, 1)
PROBE_GUARD = (0, 0)
"""Further arguments, which the right library never looks at; one that takes more finds a count of 0, which it refuses
(axis 1..8, count 1.. in all of the sister series)."""


def prototypes(abi: Abi, card: int) -> dict[str, Prototype]:
    """Every call that gusjob can make, as a library of this ABI has it."""
    profile = ABI_PROFILES[abi]
    before = (card,) if profile.leading_card else ()

    def made(signature: Signature) -> Prototype:
        plain = Prototype(symbol=signature.name, args=signature.args)
        return replace(profile.changes.get(signature.name, plain), before=before)

    return {name: made(signature) for name, signature in (SIGNATURES | HOST_CALLS).items()}


_CTYPES: dict[CType, Any] = {
    CType.SHORT: ctypes.c_short,
    CType.USHORT: ctypes.c_ushort,
    CType.LONG: ctypes.c_long,
    CType.ULONG: ctypes.c_ulong,
    CType.DOUBLE: ctypes.c_double,
    CType.TEXT: ctypes.c_char_p,
}


class TCrdPrm(ctypes.Structure):
    """The coordinate system's parameters, laid out by the platform's C rules."""

    _fields_ = [(name, _CTYPES[c] * count if count > 1 else _CTYPES[c]) for name, c, count, _ in CRD_FIELDS]


_CTYPES[CType.CRD_PARAMETERS] = TCrdPrm


def _argtype(arg: Arg) -> Any:
    return _CTYPES[arg.c] if arg.kind in (ArgKind.WHOLE, ArgKind.REAL) else ctypes.POINTER(_CTYPES[arg.c])


def c_value(arg: Arg, value: Any) -> Any:
    """A value as ctypes takes it: a number, or memory for what the call points to."""
    kind = _CTYPES[arg.c]
    match arg.kind:
        case ArgKind.WHOLE:
            return value if arg.c is CType.TEXT else int(value)
        case ArgKind.REAL:
            return float(value)
        case ArgKind.ARRAY:
            return (kind * arg.count)(*map(int if arg.c is CType.LONG else float, value))
        case ArgKind.STRUCT:
            return _crd_parameters(value)
        case ArgKind.POINTER:
            return (kind * arg.count)()


def _crd_parameters(values: Any) -> TCrdPrm:
    made = TCrdPrm()
    for (name, c, count, _), value in zip(CRD_FIELDS, values, strict=True):
        convert = float if c is CType.DOUBLE else int
        setattr(made, name, convert(value) if count == 1 else (_CTYPES[c] * count)(*map(convert, value)))
    return made
