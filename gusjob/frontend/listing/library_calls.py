"""Identify calls of the library: their series and ABI, and how they are read."""

from __future__ import annotations

from enum import Enum

from msgspec import Struct

from gusjob.config.machine import Abi
from gusjob.controllers.gus.calls import SIGNATURES, Signature
from gusjob.controllers.gus.functions import GSN_PREFIX, GSN_SAME_FORM, Effect, functions
from gusjob.i18n.phrases import Phrase

AT_REST = "AT_REST"
"""In a recorded listing: the coordinate system has ended its motion."""
_OTHER_AXES = Phrase("it moves axes that gusjob does not simulate")
_CARD_LOOK_AHEAD = Phrase("it makes the card plan the velocities")
_OUTPUT = Phrase("it may switch the laser")
_FROM_HEADERS = Phrase("its effect on laser and path is not known")
_REASONS = {
    "GT_InitLookAhead": _CARD_LOOK_AHEAD,
    "GT_CrdData": _CARD_LOOK_AHEAD,
    "GT_ZeroPos": Phrase("it moves the origin if it is called after a motion"),
}
_MOTION = ("GT_Ln", "GT_Arc", "GT_Helix", "GT_BufMove", "GT_BufGear", "GT_BufStopMotion", "GT_BufJump", "GT_CrdStart")
"""Beginnings of the names of calls that move X and Y, or decide what does."""
_PREFIX_REASONS = (
    ("GT_BufIO", _OUTPUT),
    ("GT_BufDA", _OUTPUT),
    ("GT_BufEnableDoBitPulse", _OUTPUT),
    ("GT_BufDisableDoBitPulse", _OUTPUT),
    ("GT_BufComparePulse", _OUTPUT),
    ("GT_LnX", Phrase("gusjob simulates X and Y only")),
    ("GT_Ln", _OTHER_AXES),
    ("GT_ArcXY", Phrase("this variant of the call is not simulated")),
    ("GT_Arc", _OTHER_AXES),
    ("GT_Helix", _OTHER_AXES),
)


class Reading(Enum):
    """How a call is read."""

    CALL = "call"
    """It is simulated."""
    PASSED_OVER = "passed over"
    """It affects neither laser nor path."""
    OUTPUT = "output"
    """It sets an output."""
    NO_MODEL = "no model"
    """It can't be simulated."""
    UNKNOWN = "unknown"
    """No library has it."""


class LibraryCall(Struct, frozen=True, kw_only=True):
    """A call by its name. `leading`: how many numbers precede the manual's arguments (a card, a core).

    `reason`: why there is no model; `is_essential`: without it the report would show another path or other emission.
    `least`, `most`: how many arguments it may have, the leading ones included.
    `trailing`: how many arguments follow the manual's own, each with 0 as the only value that is read.
    """

    name: str
    reading: Reading
    signature: Signature | None = None
    leading: int = 0
    least: int = 0
    most: int = 0
    trailing: int = 0
    reason: str = ""
    is_essential: bool = True

    def fits(self, count: int) -> bool:
        """Whether the call takes so many arguments."""
        return self.least <= count <= self.most


def library_call(text: str, abi: Abi | None, *, several_cards: bool, has_defaults: bool) -> LibraryCall:
    """Find a call by its name in the text.

    Args:
        text: GT_..., GTN_... or AT_REST.
        abi: ABI of the profile, None if it is not known: then the arguments of both series are accepted.
        several_cards: Read it as a call of a library for several cards, with a leading card number.
        has_defaults: Arguments may be left out, as in C++.
    """
    if text == AT_REST:
        return LibraryCall(name=AT_REST, reading=Reading.CALL, least=1, most=1)
    is_gsn = text.startswith(GSN_PREFIX)
    name = "GT_" + text[len(GSN_PREFIX) :] if is_gsn else text
    function, signature = functions().get(name), SIGNATURES.get(name)
    leading = 1 if is_gsn or several_cards else 0
    if signature is not None and (not is_gsn or name in GSN_SAME_FORM):
        own = len(signature.args)
        trailing = 0 if function is None or abi is Abi.GUS or is_gsn else len(function.args) - own
        least = own
        if has_defaults and function is not None and not (abi is Abi.GUS and signature.section != "sister"):
            least = min(own, function.least)  # M prints one default in the middle of a call: no compiler takes it.
        return LibraryCall(
            name=name,
            reading=Reading.CALL,
            signature=signature,
            leading=leading,
            least=leading + least,
            most=leading + own + trailing,
            trailing=trailing,
        )
    if function is None:
        return LibraryCall(name=text, reading=Reading.NO_MODEL if is_gsn else Reading.UNKNOWN, reason=_gsn(text))
    if is_gsn and signature is not None:
        return LibraryCall(name=text, reading=Reading.NO_MODEL, reason=_gsn(text))
    if function.effect in (Effect.READ, Effect.HOST):
        reading, reason = Reading.PASSED_OVER, ""
    elif function.effect is Effect.OUTPUT:
        reading, reason = Reading.OUTPUT, ""
    else:
        reading, reason = Reading.NO_MODEL, reason_without_model(name)
    return LibraryCall(
        name=text,
        reading=reading,
        leading=leading,
        least=leading + function.least,
        most=leading + function.most,
        reason=reason,
        is_essential=function.effect is Effect.LASER or name.startswith(_MOTION),
    )


def _gsn(text: str) -> str:
    return Phrase("{call} is of the GSN series, whose form gusjob does not know", call=text)


def reason_without_model(name: str) -> str:
    """Return why a call of the library can't be simulated."""
    for prefix, reason in _PREFIX_REASONS:
        if name.startswith(prefix):
            return reason
    return _REASONS.get(name, _FROM_HEADERS)
