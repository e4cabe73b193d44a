"""The vendor's libraries as data: GUS as in the laser manual, GTS single-card and multi-card (sister).

Prototypes come from the signatures in calls.py; this module has only the differences of each library.
On Windows the calls are __stdcall, elsewhere cdecl; `long` is the platform's own, 4 bytes on Windows.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

from msgspec import Struct, field
from msgspec.structs import replace

from gusjob.config.machine import Abi
from gusjob.controllers.gus.calls import CRD_FIELDS, HOST_CALLS, SIGNATURES, Arg, ArgKind, CType, Signature
from gusjob.i18n.phrases import Phrase


class Prototype(Struct, frozen=True, kw_only=True):
    """A call of the manual as one library has it.

    `symbol`: its name there; `args`: the manual's arguments; `leading`, `trailing`: constants before and after them.
    """

    symbol: str
    args: tuple[Arg, ...]
    leading: tuple[int, ...] = ()
    trailing: tuple[int, ...] = ()

    @property
    def argtypes(self) -> tuple[Any, ...]:
        """The ctypes of all arguments, with the constants, which are short."""
        own = tuple(_argtype(arg) for arg in self.args)
        return (ctypes.c_short,) * len(self.leading) + own + (ctypes.c_short,) * len(self.trailing)


class AbiProfile(Struct, frozen=True, kw_only=True):
    """The ABI of one library.

    `leading_card`: every call takes the card's number first. `changes`: the calls that differ, by the manual's name.
    `own_symbol`: a symbol of this family (GUS or GTS), in whose place the other family has `other_symbol`.
    """

    title: str
    leading_card: bool = False
    changes: Mapping[str, Prototype] = field(default_factory=dict)
    own_symbol: str
    other_symbol: str


_FOLLOW, _FOLLOW_RATIO = "GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio"


def _retyped(call: str, **types: CType) -> tuple[Arg, ...]:
    """Return the arguments of a call, some of them with another type."""
    return tuple(replace(arg, c=types.get(arg.name, arg.c)) for arg in SIGNATURES[call].args)


_GTS_CHANGES = {
    # A fifth argument, delaymode, that the laser manual does not have.
    "GT_LaserPowerMode": Prototype(
        symbol="GT_LaserPowerMode", args=SIGNATURES["GT_LaserPowerMode"].args, trailing=(0,)
    ),
    "GT_SetPulseWidth": Prototype(symbol="GT_SetPulseWidth", args=_retyped("GT_SetPulseWidth", width=CType.ULONG)),
    _FOLLOW: Prototype(symbol=_FOLLOW_RATIO, args=_retyped(_FOLLOW, minPower=CType.DOUBLE, maxPower=CType.DOUBLE)),
}

ABI_PROFILES = {
    Abi.GUS: AbiProfile(title=Phrase("GUS, as in the laser manual"), own_symbol=_FOLLOW, other_symbol=_FOLLOW_RATIO),
    Abi.GTS: AbiProfile(
        title=Phrase("GTS, one card"), changes=_GTS_CHANGES, own_symbol=_FOLLOW_RATIO, other_symbol=_FOLLOW
    ),
    Abi.GTS_MULTI: AbiProfile(
        title=Phrase("GTS, several cards"),
        leading_card=True,
        changes=_GTS_CHANGES,
        own_symbol=_FOLLOW_RATIO,
        other_symbol=_FOLLOW,
    ),
}

PROBE = "GT_ClrSts"
"""The call that probes a library: it has no pointers and no effect on laser or motion."""
PROBE_ARGUMENTS = (1, 1)
PROBE_GUARD = (0, 0)
"""Further arguments, which the right library never reads; one that takes more arguments finds a count of 0, which it
refuses (axis 1..8, count 1.. in all of the sister series)."""


def prototypes(abi: Abi, card: int) -> dict[str, Prototype]:
    """Return every call that gusjob can make, by the manual's name.

    Args:
        abi: the library's ABI.
        card: number of the card, for libraries of several cards.
    """
    profile = ABI_PROFILES[abi]
    leading = (card,) if profile.leading_card else ()

    def made(signature: Signature) -> Prototype:
        plain = Prototype(symbol=signature.name, args=signature.args)
        return replace(profile.changes.get(signature.name, plain), leading=leading)

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
    """The coordinate system's parameters, in the layout of the platform's C compiler."""

    _fields_ = [(name, _CTYPES[c] * count if count > 1 else _CTYPES[c]) for name, c, count, _ in CRD_FIELDS]


_CTYPES[CType.CRD_PARAMETERS] = TCrdPrm


def _argtype(arg: Arg) -> Any:
    return _CTYPES[arg.c] if arg.kind in (ArgKind.WHOLE, ArgKind.REAL) else ctypes.POINTER(_CTYPES[arg.c])


def c_value(arg: Arg, value: Any) -> Any:
    """Convert a value to what ctypes takes: a number, or memory for what the call points to."""
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
