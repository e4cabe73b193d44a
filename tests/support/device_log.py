"""What a device of the tests logs: tables of executed parts of timed calls, and of stretches of emission."""

from __future__ import annotations

from enum import IntEnum


class Row(IntEnum):
    """Columns of executed parts of timed calls."""

    KIND = 0
    START_MS = 1
    DURATION_MS = 2
    X0 = 3
    Y0 = 4
    X1 = 5
    Y1 = 6
    LENGTH = 7
    V0 = 8
    V1 = 9
    EMISSION0_MS = 10
    EMISSION1_MS = 11
    POWER0_MS = 12
    POWER1_MS = 13
    POWER0_MIN = 14
    POWER0_MAX = 15
    COMPLETED = 16
    CRD = 17
    CLOCK_MS = 18
    ORDINAL = 19
    CX = 20
    CY = 21
    RADIUS = 22
    """Of an arc: its centre and radius; else 0."""


class Lit(IntEnum):
    """Columns of lit stretches. LEFT0, LEFT1: from its begin and from its end to the call's end, pulse; for a dwell ms.

    X, Y: the call's target, or the position of a dwell or of emission at rest. CX, CY, RADIUS: of an arc, else 0.
    COMMAND: whether the switch was on when it began; at rest 0 means the tail of an off delay.
    """

    CHANNEL = 0
    ORDINAL = 1
    KIND = 2
    X = 3
    Y = 4
    LEFT0 = 5
    LEFT1 = 6
    X0 = 7
    Y0 = 8
    X1 = 9
    Y1 = 10
    MS = 11
    CLOCK_MS = 12
    POWER_MS = 13
    COMMAND = 14
    CX = 15
    CY = 16
    RADIUS = 17
    POWER_MIN = 18
    POWER_MAX = 19


class Kind(IntEnum):
    """Values of Row.KIND and Lit.KIND."""

    LINE = 0
    ARC_CENTRE = 1
    ARC_RADIUS = 2
    DELAY = 3
    REST = 7
    """Emission while nothing moves."""
