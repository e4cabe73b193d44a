"""A beam that is only delayed by TIMELAG: emission begins at S and ends at E, however the path is planned."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from random import Random

import pytest
from msgspec.structs import replace
from support.skywriting import HEAD_MM, SEEDS, compiled, path_at, ran
from support.tools import MACHINE

from gusjob.config.machine import Machine, Scanner, ScannerModel
from gusjob.report.rows import make_report

LAGS = (60.0, 250.0, 400.0, 700.0)
UNEQUAL = Machine(pulses_per_mm=(1000.0, 640.0))
HALF_DIAGONAL = 0.71
"""A point rounded to whole pulses is at most so far away."""


@dataclass
class Dashes:
    """Marks with jumps that go straight on, turn a little or turn back, at velocities that change in between."""

    rng: Random
    lines: list[str] = field(default_factory=list)
    x: float = 0.0
    y: float = 0.0
    heading: float = 0.0

    def go(self, word: str, length: float, turn: float = 0.0) -> None:
        self.heading += math.radians(turn)
        self.x += length * math.cos(self.heading)
        self.y += length * math.sin(self.heading)
        self.lines.append(f"{word} X {self.x:.6f} Y {self.y:.6f}")

    def arc(self) -> None:
        """An arc that begins in the heading."""
        radius, sweep = self.rng.choice((0.3, 1.0, 4.0)), self.rng.choice((-1.5, -0.6, 0.6, 1.5))
        side = math.copysign(math.pi / 2, sweep)
        cx, cy = self.x + radius * math.cos(self.heading + side), self.y + radius * math.sin(self.heading + side)
        i, j = cx - self.x, cy - self.y
        self.heading += sweep
        self.x, self.y = cx - radius * math.cos(self.heading + side), cy - radius * math.sin(self.heading + side)
        turn = "CCW" if sweep > 0 else "CW"
        self.lines.append(f"ARC {turn} X {self.x:.6f} Y {self.y:.6f} I {i:.6f} J {j:.6f}")

    def speeds(self) -> None:
        rng = self.rng
        self.lines.append(f"VEL {rng.choice((200, 600, 1000, 1500))}")
        self.lines.append(f"ACC {rng.choice((200000, 500000, 1000000))}")
        self.lines.append(f"JUMPVEL {rng.choice((150, 1000, 3000, 6000))}")
        self.lines.append(f"JUMPACC {rng.choice((100000, 1000000))}")

    def mark(self, mode: int) -> None:
        rng = self.rng
        self.lines.append("LASER ON")
        for number in range(rng.choice((1, 1, 1, 2, 4))):
            if rng.random() < 0.25:
                self.arc()
            else:
                turn = rng.choice((0.0, 0.05, 0.15, -0.1) if mode == 3 else (0.0, 20.0, -90.0)) if number else 0.0
                self.go("LINE", rng.choice((0.02, 0.05, 0.2, 1.0, 4.0)), turn)
        self.lines.append("LASER OFF")

    def job(self, mode: int, lag_us: float) -> str:
        rng = self.rng
        self.heading = rng.uniform(0, math.tau)
        self.lines = ["LASER MODE DUTY CARRIER 10", "LASER POWER 50"]
        self.speeds()
        npost = rng.choice(("AUTO", "0", "3", "5", "10", "60"))
        self.lines.append(f"SKYWRITE MODE {mode} TIMELAG {lag_us}us NPREV {rng.choice((0, 20, 80))} NPOST {npost}")
        for _ in range(rng.randint(1, 5)):
            self.go("JUMP", rng.choice((0.4, 2.0, 10.0)), rng.choice((0.0, 0.0, 0.0, 0.1, 2.0, 30.0, 180.0)))
            if rng.random() < 0.2:
                self.go("JUMP", rng.choice((0.1, 2.0)), rng.choice((0.0, 1.0)))
            if rng.random() < 0.1:
                self.lines.append(f"DWELL {rng.randint(1, 3)}")
            if rng.random() < 0.3:
                self.speeds()
            self.mark(mode)
        self.go("JUMP", rng.choice((0.5, 3.0, 20.0)), rng.choice((0.0, 0.0, 45.0)))
        return "\n".join(self.lines) + "\n"


def errors_of(text: str, machine: Machine, lag_us: float) -> list[tuple[float, float]] | None:
    """Of each laser-on and laser-off the error of the beam, and the error that whole pulses explain, both in pulses.

    The switch is up to half a diagonal of a pulse off, and so is the path. The command takes time for this, at its
    velocity; the beam moves at its own meanwhile. None if a switch has no motion or a mark no emission.
    """
    machine = replace(machine, scanner=Scanner(model=ScannerModel.DELAY, tracking_error_us=lag_us))
    stream, found = compiled(text, machine)
    if {f.rule.code for f in found} & {"GJ809", "GJ810"}:
        return None
    trace = ran(stream, machine)
    marks, emission = make_report(trace, machine).marks, trace.channels[0].emission
    assert marks is not None
    assert len(emission.start_ms) == len(marks["on_error_um"])
    errors = []
    for name, times in (("on_error_um", emission.start_ms), ("off_error_um", emission.end_ms)):
        for error_um, time in zip(marks[name].tolist(), times.tolist(), strict=True):
            beam = max(path_at(trace, time - lag_us / 1000 + shift)[1] for shift in (-0.005, 0.0, 0.005))
            command = min(path_at(trace, time + shift)[1] for shift in (-0.005, 0.0, 0.005))
            allowed = HALF_DIAGONAL * (1 + max(beam / max(command, 1.0), 1.0))
            errors.append((abs(error_um) / 1000 * min(machine.pulses_per_mm), allowed))
    return errors


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("machine", [MACHINE, UNEQUAL], ids=["equal", "unequal"])
def test_emission_begins_at_s_and_ends_at_e(machine: Machine, mode: int) -> None:
    """Within a pulse, at whatever velocities the path is planned."""
    compared = 0
    for seed in range(SEEDS // 5):
        rng = Random(f"{mode} {seed}")
        lag_us = rng.choice(LAGS)
        text = Dashes(rng).job(mode, lag_us)
        errors = errors_of(text, machine, lag_us)
        compared += errors is not None
        for error, allowed in errors or ():
            assert error <= allowed, f"seed {seed}\n{text}"
    assert compared > SEEDS // 7


@pytest.mark.parametrize("mode", [2, 3])
@pytest.mark.parametrize("npost", [0, 5, 20])
@pytest.mark.parametrize("length", [5.0, 0.2, 0.02])
def test_a_perforation(mode: int, npost: int, length: float) -> None:
    """The jumps go straight on: the run-outs do not brake to rest."""
    dashes = "".join(f"JUMP X {x}\nLASER ON\nLINE X {x + length}\nLASER OFF\n" for x in (5, 20, 35))
    text = HEAD_MM + f"JUMPVEL 3000\nSKYWRITE MODE {mode} TIMELAG 400us NPOST {npost}\n{dashes}JUMP X 60\n"
    errors = errors_of(text, MACHINE, 400.0)
    assert errors is not None
    assert max(error for error, _ in errors) <= 0.5
