"""Random calls, carried out by the stand-in and by the simulation of its listing, which are written on their own.

Coordinate systems with limits and origins, stops, axes that are switched off: motion ends at the same time and place.
"""

from __future__ import annotations

import ctypes
import random
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from support.recorded import needs_compiler
from support.tools import MACHINE, Ran

from gusjob.config.machine import Abi
from gusjob.controllers.gus.model import simulate_stream
from gusjob.diagnostics.model import Severity
from gusjob.frontend import check_text, read_listing
from gusjob.record.build import built_library
from gusjob.report.rows import make_report

pytestmark = needs_compiler

D, L, H = ctypes.c_double, ctypes.c_long, ctypes.c_short


class CrdParameters(ctypes.Structure):
    """TCrdPrm."""

    _fields_ = [
        ("dimension", H),
        ("profile", H * 8),
        ("vel_max", D),
        ("acc_max", D),
        ("even_time", H),
        ("sets_origin", H),
        ("origin", L * 8),
    ]


@dataclass
class Program:
    """A program that calls the stand-in at random. `rests`: where the head rests after each stage, on the machine.

    `left`: an interrupted path is left. Under another origin the rest of an arc (`has_arcs`) would be no arc.
    """

    library: ctypes.CDLL
    chance: random.Random
    place: tuple[float, float] = (0.0, 0.0)
    origin: tuple[float, float] = (0.0, 0.0)
    left: bool = False
    has_arcs: bool = False
    rests: list[tuple[float, float]] = field(default_factory=list)

    def call(self, name: str, *args: Any) -> None:
        assert getattr(self.library, name)(*args) & 0xFFFF == 0, name

    def read_place(self) -> tuple[float, float]:
        found = (D * 2)()
        self.call("GT_GetCrdPos", 1, found)
        return found[0] + self.origin[0], found[1] + self.origin[1]

    def set_system(self) -> None:
        chance, prm = self.chance, CrdParameters(dimension=2)
        at = chance.choice([(0, 1), (0, 1), (1, 0), (2, 4)])
        prm.profile[at[0]], prm.profile[at[1]] = 1, 2
        prm.vel_max, prm.acc_max = chance.choice([15, 40, 500]), chance.choice([0.4, 1.5, 30])
        prm.even_time, prm.sets_origin = chance.choice([0, 0, 20, 150]), chance.randrange(2)
        for i in range(8):
            prm.origin[i] = chance.randrange(-4000, 4000) if prm.sets_origin else 0x7FFFFFFF
        self.call("GT_SetCrdPrm", 1, ctypes.byref(prm))
        self.origin = (float(prm.origin[at[0]]), float(prm.origin[at[1]])) if prm.sets_origin else self.place

    def send_path(self) -> None:
        chance, (x, y) = self.chance, (round(at - zero) for at, zero in zip(self.place, self.origin, strict=True))
        count = chance.randrange(1, 12)
        self.has_arcs = chance.random() < 0.7
        for number in range(count):
            end = 0 if number == count - 1 else chance.choice([0, 5, 10, 20, 45])
            speed = D(chance.choice([20, 50, 80])), D(chance.choice([1, 2, 5])), D(end), 0
            if chance.random() < 0.1:
                self.call("GT_BufDelay", 1, 40, 0)
            elif number and self.has_arcs and chance.random() < 0.4:
                centre = D(chance.randrange(200, 3000)), D(chance.randrange(-500, 500))
                self.call("GT_ArcXYC", 1, L(x), L(y), *centre, chance.randrange(2), *speed)
            else:
                far = chance.choice([300, 20000])
                x, y = x + chance.randrange(-far, far), y + chance.randrange(-far, far)
                self.call("GT_LnXY", 1, L(x), L(y), *speed)

    def disturb(self) -> None:
        """Stop the motion, perhaps."""
        for _ in range(self.chance.choice([1, 30, 200])):
            self.read_place()
        what = self.chance.randrange(5)
        if what == 0:
            self.call("GT_Stop", L(256), L(0))
        elif what == 1:
            self.call("GT_Stop", L(256), L(256))
        elif what == 2:
            for axis in range(1, 9):
                self.call("GT_AxisOff", axis)

    def run(self) -> None:
        self.call("GT_CrdStart", 1, 0)
        self.disturb()
        run, segment = H(1), L(0)
        while run.value:
            self.call("GT_CrdStatus", 1, ctypes.byref(run), ctypes.byref(segment), 0)
        for axis in range(1, 9):
            self.call("GT_AxisOn", axis)
        self.place = self.read_place()
        self.rests.append(self.place)
        free = L(0)
        self.call("GT_CrdSpace", 1, ctypes.byref(free), 0)
        self.left = free.value < 4096

    def stages(self) -> None:
        chance = self.chance
        self.call("GT_Open", 0, 1)
        for number in range(7):
            if number == 0 or (chance.random() < 0.6 and not (self.left and self.has_arcs)):
                self.set_system()
            if chance.random() < 0.3:
                self.call("GT_SetCrdStopDec", 1, D(chance.choice([5, 12])), D(chance.choice([6, 40])))
            if self.left and chance.random() < 0.3:
                self.call("GT_CrdClear", 1, 0)
                self.left = False
            if not self.left or chance.random() < 0.3:
                self.send_path()
            self.run()
            if chance.random() < 0.1:
                self.call("GT_Reset")
                self.set_system()
                self.left = False


@pytest.mark.parametrize("seed", range(40))
def test_motion_ends_as_in_the_simulation(tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    listing, own = tmp_path / "calls.gts", tmp_path / "libgts.so"
    shutil.copy(built_library(Abi.GUS), own)  # A library of its own is a controller of its own.
    monkeypatch.setenv("GUSJOB_RECORD", str(listing))
    program = Program(ctypes.CDLL(str(own)), random.Random(seed))
    program.stages()
    text = listing.read_text(encoding="ascii")
    ends = [line for line in text.splitlines() if "AT_REST" in line or "GT_CrdStart" in line]
    clock = [float(line[1 : line.index("]")]) for line in ends]
    source, _ = check_text(text.encode(), "calls.gts")
    assert source is not None
    stream, diagnostics = read_listing(source)
    assert [d for d in diagnostics if d.severity is Severity.ERROR] == []
    trace, diagnostics = simulate_stream(stream, MACHINE, is_listing=True)
    assert trace is not None, [d.message for d in diagnostics if d.severity is Severity.ERROR]
    ran = Ran(make_report(trace, MACHINE), diagnostics)
    stage, last, first = ran.column("stage"), dict[float, int](), dict[float, int]()
    for i, number in enumerate(stage):
        last[number] = i
        first.setdefault(number, i)
    start, duration = ran.column("start_ms"), ran.column("duration_ms")
    x, y = ran.column("x_mm"), ran.column("y_mm")
    assert len(program.rests) == len(clock) / 2 == len(last)
    for k, (number, i) in enumerate(last.items()):
        took = start[i] + duration[i] - start[first[number]]
        found = (took, x[i] * 1000, y[i] * 1000)
        rests = (clock[2 * k + 1] - clock[2 * k], *program.rests[k])
        assert found == pytest.approx(rests, rel=1e-6, abs=2e-3), f"stage {k}"
