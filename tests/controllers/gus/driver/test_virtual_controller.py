"""The virtual controller itself: its clock, its log of emission, its faults, and its initial state."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.controller import (
    ALL_CALLS,
    FOR_EVER,
    UNSUPPORTED,
    Fault,
    Kind,
    Lit,
    Row,
    VirtualController,
    build,
    needs_controller,
)
from support.hardware import EVERYTHING, STATES, Bench, RequestAt, fresh
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine

pytestmark = needs_controller

PLACES = [Lit.X0, Lit.Y0, Lit.X1, Lit.Y1]


def opened(gus: Bench) -> Any:
    """The library, open, with coordinate system 1, the axes on and a mode in which power is in %."""
    call = gus.controller.library
    call.GT_SetHSIOOpt.restype = ctypes.c_short
    parameters = (ctypes.c_char * 256)()
    for at, value in ((0, 2), (2, 1), (4, 2)):
        ctypes.c_short.from_buffer(parameters, at).value = value
    for at, limit in ((24, 1000.0), (32, 1000.0)):
        ctypes.c_double.from_buffer(parameters, at).value = limit
    codes = [call.GT_Open(0, 1), call.GT_AxisOn(1), call.GT_AxisOn(2), call.GT_SetCrdPrm(1, parameters)]
    assert [*codes, call.GT_CrdClear(1, 0)] == [0] * 5
    return call


def line(call: Any, x: int, y: int = 0, vel: float = 50.0, acc: float = 10.0, end: float = 0.0) -> int:
    numbers = (ctypes.c_double(value) for value in (vel, acc, end))
    return int(call.GT_LnXY(1, ctypes.c_long(x), ctypes.c_long(y), *numbers, 0))


def power(call: Any, value: float, channel: int = 0) -> int:
    return int(call.GT_LaserPrfCmd(ctypes.c_double(value), channel))


# Lit stretches.


def test_a_stretch_is_one_piece_of_motion(gus: Bench) -> None:
    call = opened(gus)
    assert power(call, 40) == 0
    sent = [line(call, 1000), call.GT_BufLaserOn(1, 0, 0), line(call, 6000), call.GT_BufDelay(1, 3, 0)]
    sent += [line(call, 6000, 2000), call.GT_BufLaserOff(1, 0, 0), line(call, 0)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 8
    gus.controller.advance(1000)
    lits = gus.controller.lits()
    assert lits[:, Lit.KIND].tolist() == [Kind.LINE, Kind.DELAY, Kind.LINE]
    assert lits[:, Lit.ORDINAL].tolist() == [1, 2, 3]
    assert lits[:, [Lit.X, Lit.Y]].tolist() == [[6000, 0], [6000, 0], [6000, 2000]]
    assert lits[:, Lit.LEFT0] == pytest.approx([5000, 3, 2000])
    assert lits[:, Lit.LEFT1] == pytest.approx([0, 0, 0], abs=1e-6)
    assert lits[0, PLACES] == pytest.approx([1000, 0, 6000, 0])
    # 5000 pulse at 50 pulse/ms with 5 ms up and 5 ms down.
    assert lits[:, Lit.MS] == pytest.approx([105, 3, 45])
    assert lits[:, Lit.POWER_MS] == pytest.approx(40 * lits[:, Lit.MS])
    assert np.diff(lits[:, Lit.CLOCK_MS]) == pytest.approx(lits[:-1, Lit.MS])


def test_delays_shift_a_stretch_and_its_tail_is_at_rest(gus: Bench) -> None:
    call = opened(gus)
    assert power(call, 40) == 0
    assert call.GT_SetLevelDelay(4000, 2000, 0) == 0
    sent = [line(call, 1000, end=50), call.GT_BufLaserOn(1, 0, 0), line(call, 6000), call.GT_BufLaserOff(1, 0, 0)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 5
    gus.controller.advance(1000)
    first, tail = gus.controller.lits()
    # On 2 ms after the switch at 50 pulse/ms, off 4 ms after the end.
    assert first[Lit.LEFT0] == pytest.approx(5000 - 2 * 50)
    assert first[Lit.X0] == pytest.approx(1100)
    assert (tail[Lit.KIND], tail[Lit.COMMAND], tail[Lit.MS]) == (Kind.REST, 0, pytest.approx(4))


def test_emission_at_rest_is_a_stretch_of_its_own(gus: Bench) -> None:
    call = opened(gus)
    assert power(call, 30, 1) == 0
    assert [call.GT_BufLaserOn(1, 0, 1), line(call, 1000), call.GT_CrdStart(1, 0)] == [0] * 3
    gus.controller.advance(500)
    burning = gus.controller.lits()[-1]
    assert burning[[Lit.CHANNEL, Lit.KIND, Lit.X, Lit.COMMAND, Lit.ORDINAL]].tolist() == [1, Kind.REST, 1000, 1, -1]
    assert 400 < burning[Lit.MS] < 500
    gus.controller.advance(100)
    more = gus.controller.lits()
    assert more[-1, Lit.MS] == pytest.approx(burning[Lit.MS] + 100)
    assert more[-1, Lit.POWER_MS] == pytest.approx(30 * more[-1, Lit.MS])
    assert gus.controller.lit_count() == len(more) == 2


def test_an_interrupted_arc_continues_with_the_same_distance_to_its_end(gus: Bench) -> None:
    call = opened(gus)
    assert power(call, 40) == 0
    sent = [call.GT_BufLaserOn(1, 0, 0)]
    numbers = [ctypes.c_double(value) for value in (0.0, 5000.0)]
    speed = [ctypes.c_double(value) for value in (50.0, 10.0, 0.0)]
    sent += [call.GT_ArcXYC(1, ctypes.c_long(5000), ctypes.c_long(5000), *numbers, 1, *speed, 0)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 3
    gus.controller.advance(60)
    assert call.GT_Stop(0x100, 0x103) == 0
    gus.controller.advance(10)
    assert call.GT_CrdStart(1, 0) == 0
    gus.controller.advance(1000)
    first, rest, second, _ = gus.controller.lits()
    assert rest[Lit.KIND] == Kind.REST
    quarter = 5000 * np.pi / 2
    assert first[Lit.LEFT0] == pytest.approx(quarter)
    assert first[Lit.LEFT1] == pytest.approx(second[Lit.LEFT0])
    assert 1000 < first[Lit.LEFT1] < quarter - 1000
    assert first[[Lit.X, Lit.Y, Lit.CX, Lit.CY, Lit.RADIUS]].tolist() == [5000, 5000, 0, 5000, 5000]
    assert np.hypot(first[Lit.X1], first[Lit.Y1] - 5000) == pytest.approx(5000)


def test_power_0_parts_a_stretch(gus: Bench) -> None:
    call = opened(gus)
    assert power(call, 40) == 0
    sent = [call.GT_BufLaserOn(1, 0, 0), line(call, 5000)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 3
    gus.controller.advance(20)
    assert power(call, 0) == 0
    gus.controller.advance(500)
    lits = gus.controller.lits()
    assert (lits[:, Lit.POWER_MS] > 0).tolist() == [True, False, False]
    assert lits[0, Lit.LEFT1] == lits[1, Lit.LEFT0]
    assert 0 < lits[1, Lit.LEFT0] < 5000


@pytest.mark.parametrize("text", [EVERYTHING, STATES])
def test_the_stretches_add_up_to_all_emission(gus: Bench, text: str) -> None:
    fresh(gus, poll_us=3_000)
    ran = gus.run(stream_of(text), gus.machine(Machine()), tick=RequestAt(12, "smooth"))
    assert ran.faults == [] or ran.codes == ["GJ911"]
    lits, state = gus.controller.lits(), gus.controller.state()
    for channel in (0, 1):
        assert lits[lits[:, Lit.CHANNEL] == channel, Lit.MS].sum() == pytest.approx(state.emission[channel])
    moving = lits[lits[:, Lit.KIND] < Kind.DELAY]
    lines = moving[moving[:, Lit.KIND] == Kind.LINE]
    length = np.hypot(lines[:, Lit.X1] - lines[:, Lit.X0], lines[:, Lit.Y1] - lines[:, Lit.Y0])
    assert length == pytest.approx(lines[:, Lit.LEFT0] - lines[:, Lit.LEFT1], abs=1e-6)
    assert (lits[:, Lit.LEFT0] >= lits[:, Lit.LEFT1]).all()
    # Stretches of one channel do not overlap.
    for channel in (0, 1):
        of = lits[lits[:, Lit.CHANNEL] == channel]
        assert (np.diff(of[:, Lit.CLOCK_MS]) >= of[:-1, Lit.MS] - 1e-6).all()


def test_the_log_survives_its_process(gus: Bench, tmp_path: Path) -> None:
    code = """
import sys; sys.path.insert(0, sys.argv[1])
import pathlib, ctypes
from support.controller import VirtualController
made = VirtualController(pathlib.Path(sys.argv[2]))
if sys.argv[3] == "run":
    made.options(leave_on=1, leave_moving=5000)
    made.advance(30)
    import os, signal
    os.kill(os.getpid(), signal.SIGKILL)
for row in made.lits().tolist():
    print(row[2], round(row[11], 6))
"""
    library, tests = build(tmp_path), Path(__file__).parents[3]
    environment = os.environ | {"VC_STATE": str(tmp_path / "machine.state")}

    def process(what: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", code, str(tests), str(library), what]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    assert process("run").returncode == -9
    again = process("look")
    assert again.stdout.splitlines() == ["0.0 30.0"], again.stderr


# Time and faults.


def test_each_call_takes_its_latency_of_real_time(gus: Bench) -> None:
    call = opened(gus)
    gus.controller.options(latency_us=4000)
    began = time.perf_counter()
    assert call.GT_ClrSts(1, 1) == 0
    assert time.perf_counter() - began < 0.004  # In virtual time it takes none.
    gus.controller.options(speed=1)
    began = time.perf_counter()
    for _ in range(5):
        assert call.GT_ClrSts(1, 1) == 0
    assert 0.02 <= time.perf_counter() - began < 0.2


def test_half_of_the_latency_comes_after_the_effect(gus: Bench) -> None:
    call = opened(gus)
    gus.controller.options(speed=1, latency_us=200_000)
    thread = threading.Thread(target=lambda: call.GT_SetHSIOOpt(1, 1))
    thread.start()
    seen = []
    until = time.perf_counter() + 0.15
    while time.perf_counter() < until:
        seen.append(gus.controller.state().switched_on[1])
        time.sleep(0.005)
    assert thread.is_alive()
    thread.join()
    assert seen[0] is False and seen[-1] is True


@pytest.mark.parametrize(
    ("what", "code", "is_on_meanwhile", "is_on"),
    [
        (Fault.HANG, 0, False, True),
        (Fault.HANG_RETURN, -7, False, False),
        (Fault.HANG_AFTER, 0, True, True),
    ],
)
def test_a_call_that_hangs(gus: Bench, what: Fault, code: int, is_on_meanwhile: bool, is_on: bool) -> None:
    call, codes = opened(gus), list[int]()
    gus.controller.fault(what, "GT_SetHSIOOpt", value=0.1)
    thread = threading.Thread(target=lambda: codes.append(call.GT_SetHSIOOpt(1, 0)))
    began = time.perf_counter()
    thread.start()
    time.sleep(0.03)
    assert gus.controller.state().switched_on[0] is is_on_meanwhile
    thread.join()
    assert time.perf_counter() - began >= 0.1
    assert codes == [code]
    assert gus.controller.state().switched_on[0] is is_on
    assert call.GT_SetHSIOOpt(1, 0) == 0


def test_a_call_that_hangs_and_then_returns_a_code(gus: Bench) -> None:
    call = opened(gus)
    gus.controller.fault(Fault.HANG, "GT_SetHSIOOpt", value=0.05)
    gus.controller.fault(Fault.RETURN, "GT_SetHSIOOpt", value=8)
    began = time.perf_counter()
    assert call.GT_SetHSIOOpt(1, 0) == 8
    assert time.perf_counter() - began >= 0.05
    assert not gus.controller.state().switched_on[0]


def test_a_fault_of_one_call_or_of_all_calls_from_then_on(gus: Bench) -> None:
    call = opened(gus)
    call.GT_ClrSts.restype = ctypes.c_short

    def codes() -> list[int]:
        return [call.GT_ClrSts(1, 1), call.GT_SetHSIOOpt(0, 0), call.GT_ClrSts(1, 1), call.GT_SetHSIOOpt(0, 0)]

    gus.controller.fault(Fault.RETURN, "GT_ClrSts", nth=2, count=FOR_EVER, value=-7)
    assert codes() == [0, 0, -7, 0]
    gus.controller.clear_faults()
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", nth=2, count=ALL_CALLS, value=-7)
    assert codes() == [0, 0, -7, -7]


def test_faults_are_removed(gus: Bench) -> None:
    call = opened(gus)
    gus.controller.fault(Fault.RETURN, count=-1, value=-7)
    assert call.GT_SetHSIOOpt(1, 0) == -7
    gus.controller.clear_faults()
    assert call.GT_SetHSIOOpt(1, 0) == 0


def test_a_machine_is_what_it_was(gus: Bench) -> None:
    """With its FIFO, its emission and a motion in progress; the logs have nothing of what came after."""

    def end() -> list[list[float]]:
        gus.controller.advance(1000)
        lits: list[list[float]] = gus.controller.lits().tolist()
        return lits

    call = opened(gus)
    assert power(call, 40) == 0
    sent = [call.GT_BufLaserOn(1, 0, 0), line(call, 5000), line(call, 5000, 3000), call.GT_BufLaserOff(1, 0, 0)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 5
    gus.controller.advance(30)
    gus.controller.keep()
    kept, first = gus.controller.state(), end()
    assert call.GT_SetHSIOOpt(1, 1) == 0
    gus.controller.advance(50)
    gus.controller.recall()
    assert gus.controller.state() == kept
    assert end() == first
    assert len(first) == 2


# Its initial state, and the calls that it lacks.


def test_emission_and_motion_that_an_earlier_program_left(gus: Bench) -> None:
    gus.controller.options(leave_on=2, leave_moving=10_000)
    state = gus.controller.state()
    assert (state.emitting, state.switched_on, state.moving) == ((False, True), (False, True), 1)
    gus.controller.advance(100)
    (lit,) = gus.controller.lits()
    assert lit[[Lit.CHANNEL, Lit.X, Lit.LEFT0]].tolist() == [1, 10_000, 10_000]
    assert lit[Lit.POWER_MS] == pytest.approx(40 * 100)
    # A run turns all of it off.
    assert gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine())).faults == []
    assert not any(gus.controller.state().emitting)


def test_delays_that_an_earlier_program_left(gus: Bench) -> None:
    gus.controller.options(leave_on_delay_us=2000, leave_off_delay_us=9000)
    call = opened(gus)
    assert power(call, 40) == 0
    sent = [call.GT_BufLaserOn(1, 0, 0), call.GT_BufDelay(1, 10, 0), call.GT_BufLaserOff(1, 0, 0)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 4
    gus.controller.advance(50)
    assert gus.controller.lits()[:, Lit.MS] == pytest.approx([10 - 2, 9])
    # The first pulse killer delays the emission once more.
    gus.controller.options(leave_on_delay_us=0, leave_off_delay_us=0, leave_fpk_us=1000)
    sent = [call.GT_BufLaserOn(1, 0, 0), call.GT_BufDelay(1, 10, 0), call.GT_BufLaserOff(1, 0, 0)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 4
    gus.controller.advance(50)
    assert gus.controller.lits()[2:, Lit.MS] == pytest.approx([9, 1])


def test_a_distance_mode_that_an_earlier_program_left(gus: Bench) -> None:
    gus.controller.options(leave_distance=70)
    call = opened(gus)
    assert power(call, 40) == 0
    sent = [call.GT_BufLaserOn(1, 0, 0), line(call, 1000)]
    assert [*sent, call.GT_CrdStart(1, 0)] == [0] * 3
    gus.controller.advance(10)
    lit = gus.controller.lits()[0]
    assert lit[Lit.POWER_MS] == pytest.approx(70 * lit[Lit.MS])


def test_what_the_environment_leaves(gus: Bench, tmp_path: Path) -> None:
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import pathlib;"
        "from support.controller import VirtualController;"
        "state = VirtualController(pathlib.Path(sys.argv[2])).state();"
        "print(state.moving, state.emitting)"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parents[3]), str(gus.path)]
    environment = os.environ | {"VC_OPTIONS": "leave_moving=5000,leave_on=1"}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1 (True, False)"


@pytest.mark.parametrize("name", UNSUPPORTED)
def test_calls_that_a_firmware_lacks(gus: Bench, name: str) -> None:
    arrays = ((ctypes.c_long * 4)(), (ctypes.c_double * 4)(1, 1, 1, 1))
    arguments: dict[str, tuple[Any, ...]] = {
        "GT_SetLevelDelay": (0, 0, 0),
        "GT_DisFPK": (0,),
        "GT_SetLaserDisMode": (0, 0, *arrays, 0),
        "GT_SetWaitPulse": (0, ctypes.c_double(5), ctypes.c_double(0), 0),
        "GT_SetPreVltg": (0, ctypes.c_double(0), 0),
    }
    call = opened(gus)
    for bits, code in ((0, 0), (UNSUPPORTED[name], 8), (31 - UNSUPPORTED[name], 0)):
        gus.controller.options(unsupported=bits)
        assert getattr(call, name)(*arguments[name]) == code


def test_a_row_and_its_stretches_have_the_same_emission(gus: Bench) -> None:
    fresh(gus)
    assert gus.run(stream_of(EVERYTHING), gus.machine(Machine())).faults == []
    rows, lits = gus.controller.rows(), gus.controller.lits()
    for row in rows:
        for channel, column in ((0, Row.EMISSION0_MS), (1, Row.EMISSION1_MS)):
            mine = lits[(lits[:, Lit.ORDINAL] == row[Row.ORDINAL]) & (lits[:, Lit.CHANNEL] == channel)]
            tail_ms = 0.1  # An off delay at rest is the row's, but a stretch of its own.
            assert mine[:, Lit.MS].sum() == pytest.approx(row[column], abs=tail_ms)


def test_a_library_of_its_own_is_a_machine_of_its_own(gus: Bench, tmp_path: Path) -> None:
    other = VirtualController(build(tmp_path))
    gus.controller.options(leave_on=1)
    assert other.state().emitting == (False, False)
