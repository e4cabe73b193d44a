"""The virtual controller (vendor/controller.c): built, loaded and inspected by tests."""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from support.device_log import Kind as Kind
from support.device_log import Lit as Lit
from support.device_log import Row as Row

Floats = npt.NDArray[np.float64]

SOURCE = Path(__file__).parents[1] / "vendor" / "controller.c"
STAND_IN = Path(__file__).parents[2] / "gusjob" / "record" / "stand_in"
CC = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
needs_controller = pytest.mark.skipif(CC is None or os.name != "posix", reason="needs a C compiler on a POSIX system")

GUS, GTS, GTS_MULTI = 0, 1, 2
"""ABIs."""


def build(folder: Path, abi: int = GUS, *flags: str) -> Path:
    """Compile the controller into a folder; `flags` as -DVC_NO_FOLLOW are part of the library's name."""
    assert CC is not None
    name = "".join(c if c.isalnum() else "_" for c in "".join([f"controller{abi}", *flags]))
    path = folder / (name + (".dylib" if sys.platform == "darwin" else ".so"))
    strict = ("-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror", "-pedantic", "-shared", "-fPIC")
    command = [
        CC,
        *strict,
        f"-DVC_ABI={abi}",
        f"-I{STAND_IN}",
        *flags,
        "-o",
        str(path),
        str(SOURCE),
        "-lm",
        "-lpthread",
    ]
    subprocess.run(command, check=True)
    return path


FOR_EVER, ALL_CALLS = -1, -2
"""Counts of a fault."""


class Fault(IntEnum):
    """What a planted fault does to a call."""

    RETURN = 0
    """It returns the value and has no effect."""
    AFTER = 1
    """It has its effect, but returns the value."""
    HANG = 2
    """It blocks until release(), or for the value in s."""
    HALT = 3
    """All motion stops abruptly before it, from outside."""
    SIGNAL = 4
    """The process gets the value as a signal before it."""
    DRY = 5
    """All that runs is run to its end before it."""
    DI = 6
    """The input becomes the value before it."""
    KILL = 7
    """The process is killed before it."""
    HANG_RETURN = 8
    """It blocks as HANG does, then it returns -7 and has no effect."""
    HANG_AFTER = 9
    """It has its effect, and then blocks as HANG does."""
    KILL_AFTER = 10
    """The process is killed when it has had its effect."""


UNSUPPORTED = {
    "GT_SetLevelDelay": 1,
    "GT_DisFPK": 2,
    "GT_SetLaserDisMode": 4,
    "GT_SetWaitPulse": 8,
    "GT_SetPreVltg": 16,
}
"""Bits of the option `unsupported`: calls that return 8."""


class Edge(IntEnum):
    """Columns of edges()."""

    CHANNEL = 0
    ON = 1
    CLOCK_MS = 2
    RUNNING_MS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """The machine's present state. `moving`: a coordinate system, or 0; times in ms, position and velocity in pulse."""

    now: float
    open: bool
    moving: int
    x: float
    y: float
    emitting: tuple[bool, bool]
    switched_on: tuple[bool, bool]
    queued: int
    velocity: float
    axes: int
    emission: tuple[float, float]
    running: float
    accepted: int


class VirtualController:
    """A loaded library and its test controls. One library is one machine, however often it is loaded."""

    def __init__(self, path: Path) -> None:
        self.library = ctypes.CDLL(str(path))
        signatures: tuple[tuple[str, type | None, list[type]], ...] = (
            ("vc_reset", None, []),
            ("vc_option", ctypes.c_int, [ctypes.c_char_p, ctypes.c_double]),
            (
                "vc_fault",
                None,
                [ctypes.c_char_p, ctypes.c_long, ctypes.c_long, ctypes.c_int, ctypes.c_double],
            ),
            ("vc_clear_faults", None, []),
            ("vc_release", None, []),
            ("vc_keep", None, []),
            ("vc_recall", None, []),
            ("vc_advance", None, [ctypes.c_double]),
            ("vc_calls", ctypes.c_long, []),
            ("vc_call", ctypes.c_char_p, [ctypes.c_long]),
            ("vc_rows", ctypes.c_long, []),
            ("vc_row", None, [ctypes.c_long, ctypes.c_void_p]),
            ("vc_edges", ctypes.c_long, []),
            ("vc_edge", None, [ctypes.c_long, ctypes.c_void_p]),
            ("vc_lits", ctypes.c_long, []),
            ("vc_lit", None, [ctypes.c_long, ctypes.c_void_p]),
            ("vc_state", None, [ctypes.c_void_p]),
        )
        for name, result, arguments in signatures:
            function = getattr(self.library, name)
            function.restype, function.argtypes = result, arguments

    def reset(self) -> None:
        """Switch it off and on again: nothing is queued, logged, planted or set."""
        self.library.vc_reset()

    def option(self, name: str, value: float) -> None:
        """Set an option; see controller.c for their names."""
        if self.library.vc_option(name.encode(), float(value)) != 0:
            raise KeyError(name)

    def options(self, **values: float) -> None:
        """Set options by name."""
        for name, value in values.items():
            self.option(name, value)

    def fault(self, what: Fault, name: str = "", nth: int = 1, count: int = 1, value: float = 0.0) -> None:
        """Plant a fault in the nth call of that name from now on ("" any).

        `count`: how often, or FOR_EVER, or ALL_CALLS for every call from then on, whatever its name.
        """
        self.library.vc_fault(name.encode(), nth, count, int(what), float(value))

    def clear_faults(self) -> None:
        """Remove all faults that were planted."""
        self.library.vc_clear_faults()

    def release(self) -> None:
        """Release calls that hang; later ones don't hang."""
        self.library.vc_release()

    def keep(self) -> None:
        """Keep the machine as it is now, for recall()."""
        self.library.vc_keep()

    def recall(self) -> None:
        """Make the machine what it was at keep(); its logs end where they ended then. Not after reset()."""
        self.library.vc_recall()

    def advance(self, ms: float) -> None:
        """Advance the virtual time."""
        self.library.vc_advance(float(ms))

    def calls(self) -> list[tuple[int, str]]:
        """Return (code, call) of every call of this process."""
        lines = (self.library.vc_call(i).decode() for i in range(self.library.vc_calls()))
        return [(int(code), call) for code, _, call in (line.partition(" ") for line in lines)]

    def names(self) -> list[str]:
        """Return the names of these calls."""
        return [call.partition("(")[0] for _, call in self.calls()]

    def rows(self) -> Floats:
        """Return what was executed, a row for each part of a timed call that has ended; columns are Row."""
        return self._table(self.library.vc_rows(), len(Row), self.library.vc_row)

    def edges(self) -> Floats:
        """Return the edges of the emission; columns are Edge."""
        return self._table(self.library.vc_edges(), len(Edge), self.library.vc_edge)

    def lits(self) -> Floats:
        """Return the lit stretches, those that are lit now up to now; columns are Lit."""
        return self._table(self.library.vc_lits(), len(Lit), self.library.vc_lit)

    def lit_count(self) -> int:
        """Return the number of lit stretches so far."""
        return int(self.library.vc_lits())

    def state(self) -> State:
        """Return the machine's present state."""
        now = np.zeros(16)
        self.library.vc_state(now.ctypes.data)
        v = now.tolist()
        return State(
            now=v[0],
            open=bool(v[1]),
            moving=int(v[2]),
            x=v[3],
            y=v[4],
            emitting=(bool(v[5]), bool(v[6])),
            switched_on=(bool(v[7]), bool(v[8])),
            queued=int(v[9]),
            velocity=v[10],
            axes=int(v[11]),
            emission=(v[12], v[13]),
            running=v[14],
            accepted=int(v[15]),
        )

    @staticmethod
    def _table(rows: int, columns: int, read: Callable[[int, int], None]) -> Floats:
        table = np.zeros((rows, columns))
        for i in range(rows):
            read(i, table.ctypes.data + i * table.strides[0])
        return table
