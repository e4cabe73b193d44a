"""What a statement changes for the statements after it, and what is not known because a statement can't be read.

A statement with an error still counts: `LASER OF` may have been the LASER OFF that a later check looks for. The job has
a state of bits at each row: an effect's bit is set where the last statement with this effect could not be read. A check
reports nothing that follows from an effect that is not known there.
"""

from __future__ import annotations

from enum import IntFlag
from typing import Any

CHANNEL_SHIFT = 16
"""Bits of channel 1 are those of channel 0, shifted by this."""


class StateEffect(IntFlag):
    """What a statement may change. Those of a laser have a bit for each channel."""

    NONE = 0
    UNITS = 1
    COORDS = 2
    CHANNEL = 4
    X = 8
    Y = 16
    VEL = 32
    ACC = 64
    JUMPVEL = 128
    JUMPACC = 256
    SKY = 512
    MODE = 1024
    SWITCH = 2048
    POWER = 4096
    DISTANCE = 8192
    MODE_KIND = 16384
    """Which mode is in force; MODE is whether there is one."""


POSITION = StateEffect.X | StateEffect.Y
OF_LASER = StateEffect.MODE | StateEffect.MODE_KIND | StateEffect.SWITCH | StateEffect.POWER | StateEffect.DISTANCE
EVERYTHING = StateEffect(sum(StateEffect))
"""Effects of a file that can't be read."""
UNCLEAR = EVERYTHING & ~(StateEffect.UNITS | StateEffect.COORDS | StateEffect.CHANNEL | StateEffect.MODE_KIND)
"""Effects of a line whose intention is not known, and of a block that does not run. It may be what a check misses, but
it rarely sets units or a mode: then nothing behind it could be checked."""
FRAME_EFFECTS = StateEffect.X | StateEffect.Y | StateEffect.UNITS
"""Effects of a FRAME: it moves and scales what is in it."""
_GEOMETRY = StateEffect.UNITS | StateEffect.COORDS


def mask_of(effects: StateEffect, channel: int = 0) -> int:
    """The bits that must be clear for some effects to be known, for a channel if they are a laser's."""
    needed = effects
    if effects & POSITION:
        needed |= _GEOMETRY
    if effects & OF_LASER:
        needed |= StateEffect.CHANNEL
    of_laser = int(needed & OF_LASER)
    return int(needed & ~OF_LASER) | (of_laser << CHANNEL_SHIFT if channel else of_laser)


def is_known(state: Any, effects: StateEffect, channel: int = 0) -> Any:
    """Whether some effects are known in a state, or in each of an array of states."""
    return (state & mask_of(effects, channel)) == 0
