"""How the beam lags behind the command: closed forms of the filters, and a fine integration where there are none."""

from __future__ import annotations

import math
import random
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from click.testing import CliRunner, Result
from oracles.power import Segment, make_segment
from support.tools import find_diagnostics, run_listing

from gusjob.cli import cli
from gusjob.config.machine import Machine, Scanner, ScannerModel, parse_scanner
from gusjob.config.profile import parse_profile
from gusjob.controllers.gus.calls import Stream
from gusjob.controllers.gus.model import simulate_stream
from gusjob.frontend import check_text, read_listing
from gusjob.simulate import Trace

Floats = npt.NDArray[np.float64]
Call = tuple[object, ...]

START = "GT_CrdStart(1,0)\n"
AT_ONCE = 32766
"""An acceleration (pulse/ms2) that takes 3 us up to 100 pulse/ms."""

MODELS = list(ScannerModel)
FILTERS = [ScannerModel.FIRST_ORDER, ScannerModel.SECOND_ORDER]


def lag(model: ScannerModel, us: float) -> Scanner:
    return Scanner(model=model, tracking_error_us=us)


def calls_in(text: str) -> Stream:
    source, _ = check_text(text.encode(), "test.gts")
    assert source is not None
    return read_listing(source)[0]


def trace_of(text: str, scanner: Scanner | None, period_us: float = 250.0) -> Trace:
    trace, _ = simulate_stream(calls_in(text), Machine(scanner=scanner, period_us=period_us))
    assert trace is not None
    return trace


def seen(trace: Trace, time: Floats | Sequence[float], stage: int = 0) -> tuple[Floats, Floats]:
    """The beam at moments of a stage, ms on the clock's axis."""
    at = np.asarray(time, dtype=np.float64)
    return trace.beam.position(np.full(len(at), stage, dtype=np.intp), at)


def ramp(model: ScannerModel, tau: float, t: Floats) -> Floats:
    """Way at unit speed from rest."""
    t = np.maximum(t, 0.0)
    if model is ScannerModel.DELAY:
        return np.maximum(t - tau, 0.0)
    if model is ScannerModel.FIRST_ORDER:
        return np.asarray(t - tau * (1 - np.exp(-t / tau)))
    half = tau / 2
    return np.asarray(t - tau + (tau + t) * np.exp(-t / half))


def bend(model: ScannerModel, tau: float, t: Floats) -> Floats:
    """Way at unit acceleration from rest: the integral of `ramp`."""
    t = np.maximum(t, 0.0)
    if model is ScannerModel.DELAY:
        return np.asarray(np.maximum(t - tau, 0.0) ** 2 / 2)
    if model is ScannerModel.FIRST_ORDER:
        return np.asarray(t * t / 2 - tau * t + tau**2 * (1 - np.exp(-t / tau)))
    half = tau / 2
    return np.asarray(t * t / 2 - tau * t + 3 * half**2 - (3 * half**2 + half * t) * np.exp(-t / half))


# Closed forms.


@pytest.mark.parametrize("model", MODELS)
def test_a_step_is_answered_as_by_the_filter(model: ScannerModel) -> None:
    # 30 pulse in 0.06 ms, then 100 ms at rest: a step, seen by a scanner of 10 ms.
    tau, middle = 10.0, math.sqrt(30 / AT_ONCE)
    trace = trace_of(f"GT_LnXY(1,30,0,1000,{AT_ONCE},0,0)\nGT_BufDelay(1,100,0)\n" + START, lag(model, tau * 1000))
    time = np.array([2.0, 5.0, 9.9, 10.2, 20.0, 50.0, 100.0])
    u = time - middle
    share = {
        ScannerModel.DELAY: (u > tau).astype(np.float64),
        ScannerModel.FIRST_ORDER: 1 - np.exp(-u / tau),
        ScannerModel.SECOND_ORDER: 1 - (1 + 2 * u / tau) * np.exp(-2 * u / tau),
    }[model]
    x, y = seen(trace, time)
    assert x == pytest.approx(30 * share, abs=1e-3)
    assert (y == 0).all()


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("tau", [0.05, 0.25, 3.0])
def test_rise_cruise_and_fall_are_exact(model: ScannerModel, tau: float) -> None:
    """50 pulse/ms at 2 pulse/ms2: 25 ms up, 1975 ms at speed, 25 ms down; along (0.6, -0.8)."""
    trace = trace_of("GT_LnXY(1,60000,-80000,50,2,0,0)\n" + START, lag(model, tau * 1000))
    time = np.linspace(-1.0, 2060.0, 5001)
    way = 2 * sum(sign * bend(model, tau, time - at) for sign, at in ((1, 0.0), (-1, 25.0), (-1, 2000.0), (1, 2025.0)))
    x, y = seen(trace, time)
    assert x == pytest.approx(0.6 * way, abs=1e-6)
    assert y == pytest.approx(-0.8 * way, abs=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_at_constant_speed_every_model_lags_by_speed_times_tracking_error(model: ScannerModel) -> None:
    trace = trace_of("GT_LnXY(1,100000,0,50,2,0,0)\n" + START, lag(model, 400))
    x, _ = seen(trace, [1000.0])
    # Commanded: 25 ms of rise are half, 975 ms are whole.
    assert x[0] == pytest.approx(50 * (975 + 12.5) - 50 * 0.4, abs=1e-7)


@pytest.mark.parametrize(("model", "percent"), [(FILTERS[0], 8.2), (FILTERS[1], 4.0)])
def test_velocity_error_after_two_and_a_half_tracking_errors(model: ScannerModel, percent: float) -> None:
    tau, vel, step = 0.4, 100.0, 1e-4
    trace = trace_of(f"GT_LnXY(1,100000,0,{vel},{AT_ONCE},0,0)\n" + START, lag(model, tau * 1000))
    middle = vel / AT_ONCE / 2
    x, _ = seen(trace, [2.5 * tau + middle - step, 2.5 * tau + middle + step])
    assert 100 * (1 - (x[1] - x[0]) / (2 * step) / vel) == pytest.approx(percent, abs=0.05)


CORNER = "GT_LnXY(1,5000,0,100,32766,100,0)\nGT_LnXY(1,5000,5000,100,32766,0,0)\n" + START


@pytest.mark.parametrize("model", MODELS)
def test_a_corner_at_speed(model: ScannerModel) -> None:
    tau, vel = 0.3, 100.0
    trace = trace_of(CORNER, lag(model, tau * 1000))
    corner = 50.0 + vel / AT_ONCE / 2
    assert trace.schedule.times_ms[1] == pytest.approx(corner)
    u = np.linspace(-2.0, 5.0, 7001)
    x, y = seen(trace, corner + u)
    # In X a ramp goes on and its like is taken off; in Y one begins.
    assert x == pytest.approx(5000 + vel * (u - tau - ramp(model, tau, u)), abs=1e-6)
    assert y == pytest.approx(vel * ramp(model, tau, u), abs=1e-6)
    miss = float(np.hypot(x - 5000, y).min()) / (vel * tau)
    wanted = {ScannerModel.DELAY: 0.0, ScannerModel.FIRST_ORDER: 0.51}
    if model in wanted:
        assert miss == pytest.approx(wanted[model], abs=0.005)
    else:
        assert 0.2 < miss < 0.51


@pytest.mark.parametrize("model", MODELS)
def test_the_period_does_not_matter(model: ScannerModel) -> None:
    text = "GT_LnXY(1,1000,70,50,2,20,0)\nGT_ArcXYC(1,1000,2070,0,1000,1,50,2,0,0)\n" + START
    time = np.linspace(0, 200, 777)
    fine, coarse = (seen(trace_of(text, lag(model, 350), period), time) for period in (1, 1000))
    assert (np.stack(fine) == np.stack(coarse)).all()


def test_without_a_lag_the_beam_is_the_command() -> None:
    # 1000 pulse at 10 pulse/ms, 1 pulse/ms2: 10 ms up, 90 at speed, 10 down.
    text = "GT_LnXY(1,1000,0,10,1,0,0)\nGT_BufDelay(1,5,0)\n" + START
    for scanner in (None, *(lag(model, us) for model in MODELS for us in (0.0, 1e-9))):
        x, y = seen(trace_of(text, scanner), [-1, 0, 5, 10, 60, 110, 113, 500])
        assert x == pytest.approx([0, 0, 12.5, 50, 550, 1000, 1000, 1000])
        assert (y == 0).all()


# Dwells, stages, and where nothing moves.


@pytest.mark.parametrize("model", MODELS)
def test_in_a_dwell_the_beam_settles(model: ScannerModel) -> None:
    tau, vel = 2.0, 100.0
    text = f"GT_LnXY(1,10000,0,{vel},{AT_ONCE},100,0)\nGT_BufDelay(1,30,0)\nGT_LnXY(1,0,0,{vel},{AT_ONCE},0,0)\n"
    trace = trace_of(text + START, lag(model, tau * 1000))
    stop = 100 + vel / AT_ONCE / 2
    u = np.linspace(0, 30, 301)
    x, _ = seen(trace, stop + u)
    assert x == pytest.approx(10000 + vel * (u - tau - ramp(model, tau, u)), abs=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_every_stage_starts_at_rest_and_settles_after_its_end(model: ScannerModel) -> None:
    tau, vel = 5.0, 100.0
    one = f"GT_LnXY(1,10000,0,{vel},{AT_ONCE},100,0)\n{START}GT_CrdStatus(1,run,segment,0)\n"
    two = f"GT_LnXY(1,10000,7000,{vel},{AT_ONCE},0,0)\n{START}"
    trace = trace_of(one + two, lag(model, tau * 1000))
    u = np.linspace(0, 40, 401)
    end = 100 + vel / AT_ONCE / 2
    # The same moments, told apart by the stage: after the first, and within the second.
    x, y = seen(trace, end + u, 0)
    assert x == pytest.approx(10000 + vel * (u - tau - ramp(model, tau, u)), abs=1e-5)
    assert (y == 0).all()
    x, y = seen(trace, end + u, 1)
    assert (x == 10000).all()
    assert y == pytest.approx(vel * ramp(model, tau, u - vel / AT_ONCE / 2), abs=0.02)
    x, y = seen(trace, [0.0, end - 1], 1)
    assert [*x, *y] == [10000, 10000, 0, 0]
    x, y = seen(trace, [1e6], 1)
    assert (x[0], y[0]) == pytest.approx((10000, 7000), abs=1e-9)


@pytest.mark.parametrize("scanner", [None, *(lag(model, 300) for model in MODELS)])
def test_where_nothing_moves(scanner: Scanner | None) -> None:
    lit = "GT_BufLaserOn(1,0,0)\nGT_BufLaserOff(1,0,0)\n" + START + "GT_CrdStatus(1,run,segment,0)\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        none = trace_of("", scanner)
        assert [len(v) for v in none.beam.position(np.empty(0, dtype=np.intp), np.empty(0))] == [0, 0]
        assert [float(v[0]) for v in seen(trace_of(lit, scanner), [3.0])] == [0, 0]
        text = lit + "GT_LnXY(1,500,30,50,2,0,0)\n" + START + "GT_CrdStatus(1,run,segment,0)\n" + lit
        trace = trace_of(text, scanner)
        assert [float(v[0]) for v in seen(trace, [50.0], 0)] == [0, 0]
        assert [float(v[0]) for v in seen(trace, [0.0, 1e3], 2)] == pytest.approx([500, 30])
        dwell = "GT_BufDelay(1,0,0)\nGT_LnXY(1,0,0,50,2,0,0)\nGT_BufDelay(1,9,0)\n" + START
        assert [v.tolist() for v in seen(trace_of(dwell, scanner), [0.0, 4.0, 99.0])] == [[0, 0, 0], [0, 0, 0]]


# Against a fine integration of an independent command.


def command_at(segments: Sequence[Segment], time: Floats) -> Floats:
    """(2, k): where the segments are at moments; after the last one, its end."""
    starts = np.concatenate([[0.0], np.cumsum([s.duration for s in segments])])
    index = np.minimum(np.searchsorted(starts, time, side="right") - 1, len(segments) - 1)
    points = [segments[i].state(t - starts[i])[1:] for i, t in zip(index.tolist(), time.tolist(), strict=True)]
    return np.array(points).T


def low_pass(values: Floats, lag_ms: float, step: float) -> Floats:
    """A filter of first order, exact for straight lines between the samples."""
    left = math.exp(-step / lag_ms)
    new = 1 - lag_ms / step * (1 - left)
    old = 1 - left - new
    out = values.copy()
    for row in out:
        state, before = float(row[0]), float(row[0])
        for k, value in enumerate(row.tolist()):
            state = left * state + old * before + new * value
            row[k], before = state, value
    return out


def filtered(model: ScannerModel, tau: float, command: Floats, step: float) -> Floats:
    if model is ScannerModel.FIRST_ORDER:
        return low_pass(command, tau, step)
    return low_pass(low_pass(command, tau / 2, step), tau / 2, step)


def segments_of(calls: Sequence[Call]) -> list[Segment]:
    segments: list[Segment] = []
    x, y, velocity = 0.0, 0.0, 0.0
    for call in calls:
        segment = make_segment(call, x, y, velocity)
        segments.append(segment)
        x, y = segment.x1, segment.y1
        if segment.phases:
            duration, start, acc = segment.phases[-1]
            velocity = 0.0 if segment.dwell else start + acc * duration
    return segments


def text_of(calls: Sequence[Call]) -> str:
    return "".join(f"{name}({','.join(str(a) for a in args)})\n" for name, *args in calls)


def compare(calls: Sequence[Call], model: ScannerModel, tau: float, step: float, within: float) -> None:
    """The beam of a stage is what the fine integration gives, up to 8 tau after its end."""
    segments = segments_of(calls)
    time = np.arange(0.0, sum(s.duration for s in segments) + 8 * tau, step)
    wanted = filtered(model, tau, command_at(segments, time), step)
    got = np.stack(seen(trace_of(text_of(calls) + START, lag(model, tau * 1000)), time))
    assert np.abs(got - wanted).max() < within


@pytest.mark.parametrize("model", FILTERS)
@pytest.mark.parametrize("radius", [50, 2000, 40000])
def test_arcs(model: ScannerModel, radius: int) -> None:
    """Half a circle and a whole one the other way round; speeds at which they take some 60 ms."""
    vel, acc = radius / 5, radius / 50
    calls: list[Call] = [
        ("GT_ArcXYC", 1, 0, 2 * radius, 0, radius, 1, vel, acc, vel / 2, 0),
        ("GT_ArcXYR", 1, radius, 3 * radius, -radius, 1, vel, acc, vel / 2, 0),
        ("GT_ArcXYC", 1, radius, 3 * radius, radius, 0, 0, vel, acc, 0, 0),
    ]
    compare(calls, model, 0.7, 0.005, 0.011 + radius * 1e-6)


@pytest.mark.parametrize("model", FILTERS)
def test_a_start_above_the_velocity(model: ScannerModel) -> None:
    calls: list[Call] = [
        ("GT_LnXY", 1, 1000, 0, 50, 2, 50, 0),
        ("GT_LnXY", 1, 1000, 900, 20, 2, 10, 0),
        ("GT_ArcXYC", 1, 1000, 1100, 0, 100, 1, 5, 1, 0, 0),
    ]
    compare(calls, model, 1.5, 0.002, 0.01)


def random_calls(random_: random.Random) -> list[Call]:
    """Lines, arcs, dwells and calls that go nowhere, long and short beside tau; every end velocity is met."""
    calls: list[Call] = []
    x, y, velocity = 0, 0, 0.0
    for _ in range(40):
        size = random_.choice([3, 40, 800])
        x1, y1 = x + random_.randint(-size, size), y + random_.randint(-size, size)
        vel, acc = random_.choice([5.0, 40.0, 90.0]), random_.choice([1.0, 8.0])
        vel = max(vel, velocity)
        length = math.hypot(x1 - x, y1 - y)
        low, high = math.sqrt(max(velocity**2 - 2 * acc * length, 0)), math.sqrt(velocity**2 + 2 * acc * length)
        end = round(random_.uniform(min(low, vel), min(high, vel)), 9)
        kind = random_.random()
        if kind < 0.1:
            calls.append(("GT_BufDelay", 1, random_.randint(0, 3), 0))
            velocity = 0.0
            continue
        if kind < 0.15 or length == 0:
            if velocity == 0:
                calls.append(("GT_LnXY", 1, x, y, vel, acc, 0, 0))
            continue
        if kind < 0.4:
            calls.append(("GT_ArcXYR", 1, x1, y1, math.ceil(length), random_.randint(0, 1), vel, acc, end, 0))
        else:
            calls.append(("GT_LnXY", 1, x1, y1, vel, acc, end, 0))
        x, y, velocity = x1, y1, end
    return [*calls, ("GT_LnXY", 1, x + 9000, y, 90, 8, 0, 0)]


@pytest.mark.parametrize("model", FILTERS)
@pytest.mark.parametrize("seed", range(6))
def test_random_lists(model: ScannerModel, seed: int) -> None:
    random_ = random.Random(seed)
    compare(random_calls(random_), model, random_.choice([0.05, 0.4, 6.0]), 0.002, 0.015)


@pytest.mark.parametrize("model", FILTERS)
def test_many_short_segments_are_summed_up_as_one_line(model: ScannerModel) -> None:
    """100,000 segments of 1 pulse at one speed: more than a block, and 500 of them within tau."""
    count, tau, vel = 100_000, 5.0, 100.0
    lines = [f"GT_LnXY(1,{k + 1},0,{vel},{AT_ONCE},{vel},0)\n" for k in range(count)]
    trace = trace_of("".join(lines) + START, lag(model, tau * 1000))
    time = np.linspace(0, 1040, 9001)
    start, end = vel / AT_ONCE / 2, count / vel + vel / AT_ONCE / 2
    x, _ = seen(trace, time)
    assert x == pytest.approx(vel * (ramp(model, tau, time - start) - ramp(model, tau, time - end)), abs=2e-3)


@pytest.mark.parametrize("model", FILTERS)
def test_transients_continue_from_block_to_block(model: ScannerModel) -> None:
    """A circle of 40,000 chords at one speed, 318 of them within tau: the answer is a smaller, later circle.

    Ends are whole pulses, which makes the way longer by some 0.05 %: 3 of the 5000 pulse of lag.
    """
    count, tau, vel, radius = 40_000, 50.0, 100.0, 100_000
    angle = 2 * np.pi * np.arange(count + 1) / count
    x, y = (np.rint(radius * v).astype(int) for v in (np.cos(angle) - 1, np.sin(angle)))
    points = zip(x[1:].tolist(), y[1:].tolist(), strict=True)
    lines = [f"GT_LnXY(1,{a},{b},{vel},{AT_ONCE},{vel},0)\n" for a, b in points]
    trace = trace_of("".join(lines) + START, lag(model, tau * 1000))
    turn = vel / radius * tau
    gain = 1 / (1 + 1j * turn) if model is ScannerModel.FIRST_ORDER else 1 / (1 + 1j * turn / 2) ** 2
    wanted = radius * (np.exp(1j * angle) * gain - 1)
    got_x, got_y = seen(trace, trace.schedule.times_ms)
    settled = trace.schedule.times_ms > 20 * tau
    assert np.abs(got_x + 1j * got_y - wanted)[settled].max() < 5


# Distance follow by the actual position.

ACTUAL = (
    "GT_SetAxisMode(7,1)\nGT_LaserPowerMode(0,100,0,0)\nGT_LaserOutFrq(10,0)\nGT_SetLevelDelay(5000,0,0)\n"
    "{crd}GT_SetLaserDisMode(1,{source},{{0,0,0,0}},{{1000,1000,1000,1000}},0)\n"
    "GT_SetLaserDisRatio({ratio},0,100,0)\nGT_CrdClear(1,0)\n"
    "GT_BufLaserPrfCmd(1,20,0,0)\nGT_BufLaserOn(1,0,0)\nGT_LnXY(1,10000,0,100,32766,100,0)\nGT_BufLaserOff(1,0,0)\n"
    "GT_CrdStart(1,0)\n"
)


@pytest.mark.parametrize("model", MODELS)
def test_distance_follow_reads_the_actual_position(model: ScannerModel) -> None:
    """20 % and 3 % a mm; 10 mm in 100 ms, and 5 ms of emission after its end, at a period of 0.1 ms."""
    tau = 2.0
    machine = Machine(scanner=lag(model, tau * 1000), period_us=100)
    start, end = 100 / AT_ONCE / 2, 100 + 100 / AT_ONCE / 2
    time = np.arange(1050, dtype=np.float64) / 10
    way = 100 * (ramp(model, tau, time - start) - ramp(model, tau, time - end))
    actual = run_listing(ACTUAL.format(source=1, crd="", ratio="{3,0,0,0}"), machine)
    assert actual.column("ch0_power_ms") == pytest.approx([0.1 * (20 + 3 * way / 1000).sum()], abs=0.1)
    assert actual.column("ch0_power_max") == pytest.approx([20 + 3 * way[-1] / 1000], abs=0.02)
    planned = run_listing(ACTUAL.format(source=0, crd="", ratio="{3,0,0,0}"), machine)
    lost = planned.column("ch0_power_ms")[0] - actual.column("ch0_power_ms")[0]
    # All that is late is late by tau, but for what has not come when the laser goes.
    assert lost == pytest.approx(30 * tau, abs=2.5)
    assert planned.column("ch0_power_ms") == run_listing(
        ACTUAL.format(source=0, crd="", ratio="{3,0,0,0}"), Machine(period_us=100)
    ).column("ch0_power_ms")


def test_the_actual_position_is_that_of_the_axes_of_the_coordinate_system() -> None:
    crd = "GT_SetCrdPrm(1,{2,{0,1,2,0,0,0,0,0},1000,32766,0,1,{0,0,0,0,0,0,0,0}})\n"
    machine = Machine(scanner=lag(ScannerModel.FIRST_ORDER, 2000), period_us=100)
    plain = run_listing(ACTUAL.format(source=1, crd="", ratio="{3,0,0,0}"), machine).column("ch0_power_ms")
    turned = ACTUAL.format(source=1, crd=crd, ratio="{0,3,0,0}")
    assert run_listing(turned, machine).column("ch0_power_ms") == plain
    still = ACTUAL.format(source=1, crd=crd, ratio="{3,0,0,0}")
    assert run_listing(still, machine).column("ch0_power_max") == [20]


def test_without_a_scanner_the_planned_position_is_used() -> None:
    text = ACTUAL.format(source=1, crd="", ratio="{3,0,0,0}")
    known, unknown = Machine(scanner=lag(ScannerModel.DELAY, 0)), Machine()
    assert "GJ702" in [f.rule.code for f in find_diagnostics(calls_in(text), unknown)]
    assert "GJ702" not in [f.rule.code for f in find_diagnostics(calls_in(text), known)]
    planned = ACTUAL.format(source=0, crd="", ratio="{3,0,0,0}")
    assert run_listing(text, unknown).column("ch0_power_ms") == run_listing(planned, unknown).column("ch0_power_ms")
    assert "GJ702" not in run_listing(planned, unknown).codes()


def test_faults_alone_need_no_beam(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object) -> None:
        raise AssertionError("the beam is worked out")

    monkeypatch.setattr("gusjob.simulate.beam._polynomials", never)
    text = ACTUAL.format(source=1, crd="", ratio="{3,0,0,0}")
    machine = Machine(scanner=lag(ScannerModel.FIRST_ORDER, 100))
    find_diagnostics(calls_in(text), machine)
    simulate_stream(calls_in(ACTUAL.format(source=0, crd="", ratio="{3,0,0,0}")), machine)


# How a scanner is written.


@pytest.mark.parametrize(
    ("text", "model", "us"),
    [
        ("delay:250us", ScannerModel.DELAY, 250),
        ("first-order:250", ScannerModel.FIRST_ORDER, 250),
        ("second-order:0.25ms", ScannerModel.SECOND_ORDER, 250),
        ("second-order:.5 ms", ScannerModel.SECOND_ORDER, 500),
        ("delay:1s", ScannerModel.DELAY, 1e6),
        ("delay:1e6", ScannerModel.DELAY, 1e6),
        (" delay:0 ", ScannerModel.DELAY, 0),
    ],
)
def test_a_scanner_is_read(text: str, model: ScannerModel, us: float) -> None:
    assert parse_scanner(text) == Scanner(model=model, tracking_error_us=us)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "delay",
        "delay:",
        "delay:us",
        "third-order:1us",
        "Delay:1us",
        "delay:-1us",
        "delay:nan",
        "delay:inf",
        "delay:1e400",
        "delay:1000000.1",
        "delay:1.0001s",
        "delay:1m",
        "delay:1 2us",
        "delay:0x10",
        "delay:١us",
        "delay:1us;",
        "250us",
        "delay=250us",
        "delay:1us:2",
        "delay:1e",
        "delay:\x1b[31m",
    ],
)
def test_the_message_of_an_invalid_scanner_shows_the_format(text: str) -> None:
    reason = parse_scanner(text)
    assert isinstance(reason, str)
    assert "first-order:250us" in reason
    assert "\x1b" not in reason


def test_the_scanner_of_a_profile() -> None:
    profile = parse_profile('scanner = "second-order:0.3ms"\n')
    assert profile.diagnostics == ()
    assert profile.machine.scanner == Scanner(model=ScannerModel.SECOND_ORDER, tracking_error_us=300)
    assert Machine().scanner is None


@pytest.mark.parametrize(
    ("text", "code", "line", "says"),
    [
        ("scanner = 250", "GJ603", 2, 'a text such as "first-order:250us"'),
        ('scanner = "first:250us"', "GJ604", 2, "first-order:TIME"),
        ('scanner = "delay:2s"', "GJ604", 2, "0 to 1 s"),
        ('scaner = "delay:2us"', "GJ602", 2, "did you mean scanner"),
        ('[[laser]]\nchannel = 0\nscanner = "delay:2us"', "GJ602", 4, "scanner"),
    ],
)
def test_a_wrong_scanner_in_a_profile(text: str, code: str, line: int, says: str) -> None:
    profile = parse_profile("period_us = 100\n" + text + "\n")
    (diagnostic,) = profile.diagnostics
    assert (diagnostic.rule.code, diagnostic.span.line) == (code, line)
    assert says in diagnostic.message
    assert profile.machine == Machine()


# The command line.


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., Result]:
    (tmp_path / "gusjob.toml").write_text('scanner = "delay:100us"\nperiod_us = 100\n', encoding="utf-8")
    (tmp_path / "x.gts").write_text(ACTUAL.format(source=1, crd="", ratio="{3,0,0,0}"), encoding="utf-8")
    return lambda command, *args: CliRunner().invoke(cli, [command, str(tmp_path / "x.gts"), *args])


def test_the_option_replaces_the_profiles_scanner(run: Callable[..., Result]) -> None:
    plain, same, slow = (
        run("report", "--format", "csv", *args).output
        for args in ((), ("--scanner", "delay:0.1ms"), ("--scanner", "first-order:2ms"))
    )
    assert plain == same != slow
    assert (
        run("run").output == run("run", "--scanner", "delay:100").output != run("run", "--scanner", "delay:9ms").output
    )


@pytest.mark.parametrize("command", ["run", "report"])
def test_a_wrong_option(run: Callable[..., Result], command: str) -> None:
    result = run(command, "--scanner", "fast")
    assert result.exit_code == 2
    assert '"fast" is not a scanner' in " ".join(result.output.split())
