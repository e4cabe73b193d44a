"""Timed stops, compared with the virtual controller, which is written on its own: random paths, stops and switches."""

from __future__ import annotations

import ctypes
import random
from dataclasses import dataclass, field
from typing import Any

import pytest
from support.controller import Row, needs_controller
from support.hardware import Bench
from support.tools import recorded_stream, run_stream

pytestmark = needs_controller

D, L = ctypes.c_double, ctypes.c_long


@dataclass
class Recorded:
    """Makes calls on the virtual controller, which take no time, and writes them down with their time."""

    gus: Bench
    clock: float = 0.0
    lines: list[str] = field(default_factory=list)

    def call(self, name: str, *args: Any) -> None:
        assert getattr(self.gus.controller.library, name)(*args) & 0xFFFF == 0, name
        numbers = (getattr(arg, "value", arg) for arg in args)
        self.lines.append(f"[{self.clock!r}] {name}({','.join(map(repr, numbers))})")

    def advance(self, ms: float) -> None:
        self.gus.controller.advance(ms)
        self.clock += ms


def opened(gus: Bench) -> Recorded:
    """The controller with coordinate system 1 and a duty mode."""
    gus.controller.options(call_us=0, poll_us=0)
    made, parameters = Recorded(gus), (ctypes.c_char * 256)()
    for at, value in ((0, 2), (2, 1), (4, 2)):
        ctypes.c_short.from_buffer(parameters, at).value = value
    for at in (24, 32):
        D.from_buffer(parameters, at).value = 1000.0
    for name, *args in (("GT_Open", 0, 1), ("GT_AxisOn", 1), ("GT_AxisOn", 2), ("GT_SetCrdPrm", 1, parameters)):
        assert getattr(gus.controller.library, name)(*args) & 0xFFFF == 0
    made.lines.append("GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},1000,1000,0,0,{0,0,0,0,0,0,0,0}})")
    made.call("GT_LaserPowerMode", 0, D(100), D(0), 0)
    made.call("GT_LaserOutFrq", D(10), 0)
    made.call("GT_CrdClear", 1, 0)
    made.call("GT_BufLaserPrfCmd", 1, D(40), 0, 0)
    return made


def send_path(made: Recorded, chance: random.Random) -> None:
    """Send lines, circles, dwells and switches."""
    x = y = 0
    count, on = chance.randrange(2, 25), False
    for number in range(count):
        if chance.random() < 0.4:
            on = not on
            made.call("GT_BufLaserOn" if on else "GT_BufLaserOff", 1, 0, 0)
        if chance.random() < 0.1:
            made.call("GT_BufDelay", 1, 40, 0)
        end = 0 if number == count - 1 else chance.choice([0, 5, 10, 20])
        speed = D(chance.choice([20, 50, 80])), D(chance.choice([1, 2, 5])), D(end), 0
        if chance.random() < 0.3:
            centre = D(chance.randrange(200, 3000)), D(chance.randrange(-500, 500))
            made.call("GT_ArcXYC", 1, L(x), L(y), *centre, chance.randrange(2), *speed)
        else:
            far = chance.choice([300, 20000])
            x, y = x + chance.randrange(-far, far), y + chance.randrange(-far, far)
            made.call("GT_LnXY", 1, L(x), L(y), *speed)
    made.call("GT_BufLaserOff", 1, 0, 0)


def act_at_once(made: Recorded, chance: random.Random) -> None:
    """Set switch and power while the motion goes on."""
    for _ in range(chance.randrange(4)):
        if chance.random() < 0.6:
            made.call("GT_SetHSIOOpt", chance.randrange(2), 0)
        else:
            made.call("GT_LaserPrfCmd", D(chance.randrange(1, 100)), 0)
        made.advance(chance.uniform(1, 300))


@pytest.mark.parametrize("seed", range(25))
def test_the_motion_rests_and_the_laser_emits_as_there(gus: Bench, seed: int) -> None:
    chance, made = random.Random(seed), opened(gus)
    send_path(made, chance)
    rests = list[list[float]]()
    while True:
        made.call("GT_CrdStart", 1, 0)
        made.advance(chance.uniform(1, 1000))
        act_at_once(made, chance)
        if gus.controller.state().moving and len(rests) < 4:
            made.call("GT_Stop", L(256), L(chance.choice([0, 0, 256])))
            if chance.random() < 0.5:  # Once more, on its way to rest.
                made.advance(chance.uniform(0, 20))
                made.call("GT_Stop", L(256), L(chance.choice([0, 256])))
        made.advance(1e6)
        state = gus.controller.state()
        assert not state.moving
        rests.append([state.x, state.y, state.running])
        if not state.queued:
            break
    ran = run_stream(recorded_stream("\n".join(made.lines)))
    stage, last = ran.column("stage"), dict[float, int]()
    last.update((number, i) for i, number in enumerate(stage))
    ends = [start + ms for start, ms in zip(ran.column("start_ms"), ran.column("duration_ms"), strict=True)]
    for i, rest in zip(last.values(), rests, strict=True):
        found = [ran.column("x_mm")[i] * 1000, ran.column("y_mm")[i] * 1000, ends[i]]
        assert found == pytest.approx(rest, rel=1e-6, abs=1e-3)
    rows = gus.controller.rows()
    for name, column in (("ch0_emission_ms", Row.EMISSION0_MS), ("ch0_power_ms", Row.POWER0_MS)):
        assert sum(ran.column(name)) == pytest.approx(rows[:, column].sum(), rel=1e-6, abs=1e-3), name
