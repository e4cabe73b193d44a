"""Corners are those of the path before rounding to pulses: a smooth path keeps its velocity, a real corner does not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from random import Random

import numpy as np
import pytest
from msgspec.structs import replace
from support.skywriting import compiled, diagnostics_of, ran
from support.tools import MACHINE, calls_of, run_listing

from gusjob.config.machine import Machine
from gusjob.kinematics.arrays import Floats
from gusjob.simulate import Trace

RADIUS_MM, SPEED = 3.0, 300.0
JUMP = 5.0
"""Look-ahead TIME * ACC of the default machine, pulse/ms."""
CHORDS_UM = [1, 2, 3, 5, 10, 20, 30, 50, 100, 200, 500, 1000]


def circle(chord_um: float, *, acc: float = 1e6, radius_mm: float = RADIUS_MM, speed: float = SPEED, sky: str = "",
           end: str = "") -> str:  # fmt: skip
    """A circle of chords, with all digits."""
    count = round(math.tau * radius_mm * 1000 / chord_um)
    angles = math.tau * np.arange(1, count + 1) / count
    points = zip((radius_mm * np.cos(angles)).tolist(), (radius_mm * np.sin(angles)).tolist(), strict=True)
    lines = [f"LINE X {x:.9f} Y {y:.9f}{end}" for x, y in points]
    head = ["LASER MODE DUTY CARRIER 10", "LASER POWER 50", f"VEL {speed}", f"ACC {acc}"]
    return "\n".join([*head, sky, f"JUMP X {radius_mm} Y 0", "LASER ON", *lines, "LASER OFF", ""])


def trace_of(text: str, machine: Machine = MACHINE) -> Trace:
    return ran(compiled(text, machine)[0], machine)


def middle(trace: Trace) -> tuple[Floats, Floats]:
    """Lengths and durations of the motions between the first and the last tenth of the path."""
    count = len(trace.segments.length)
    part = slice(count // 10, count - count // 10)
    return trace.segments.length[part], trace.schedule.duration_ms[part]


def corner_speed(chord: float, radius: float, speed: float, max_acc: float = 1000.0) -> float:
    """By hand: the jump at one corner, v^2/r over all of them; pulses and pulse/ms."""
    turn = 2 * math.sin(math.pi / round(math.tau * radius / chord))
    return min(speed, JUMP / turn, math.sqrt(max_acc * radius))


@pytest.mark.parametrize("chord_um", CHORDS_UM)
@pytest.mark.parametrize("acc", [1e6, 30e3])
def test_the_velocity_on_chords_of_a_circle(chord_um: float, acc: float) -> None:
    """Every chord begins and ends at the velocity of its corners, and is as fast between as its length allows."""
    length, duration = middle(trace_of(circle(chord_um, acc=acc)))
    slow, a = corner_speed(chord_um, RADIUS_MM * 1000, SPEED), acc / 1000
    gain = (SPEED * SPEED - slow * slow) / a
    # Up and down again; without a cruise where the chord is too short for it.
    peak = np.where(length >= gain, SPEED, np.sqrt(slow * slow + a * length))
    expected = 2 * (peak - slow) / a + np.maximum(length - (peak * peak - slow * slow) / a, 0.0) / peak
    assert duration.sum() == pytest.approx(expected.sum(), rel=2e-3)


def test_finer_chords_are_not_slower() -> None:
    """The velocity along the calls grows from the chords at which corners count to those at which they do not."""
    means = []
    for chord_um in (100, 70, 50, 30, 10, 3, 1):
        length, duration = middle(trace_of(circle(chord_um, acc=30e3)))
        means.append(length.sum() / duration.sum())
    assert all(finer >= coarser * (1 - 1e-3) for coarser, finer in pairwise(means))
    assert means[-1] == pytest.approx(SPEED, rel=1e-3)


@pytest.mark.parametrize("chord_um", [2, 8, 20])
def test_fine_chords_are_as_fast_as_the_arc(chord_um: float) -> None:
    """v^2/r within the machine's acceleration: 1000 pulse/ms2 on 50 mm is 7071 mm/s, on chords as on an arc."""
    text = circle(chord_um, radius_mm=50.0, speed=10000.0)
    trace = trace_of(text)
    arc = trace_of("\n".join([*text.split("LINE")[0].splitlines(), "ARC CCW I -50 J 0", "LASER OFF", ""]))
    count = len(trace.segments.length)
    assert trace.schedule.profile.peak[count // 3 : count // 2].mean() == pytest.approx(
        math.sqrt(1000.0 * 50e3), rel=5e-3
    )
    assert arc.schedule.profile.peak[1:].max() == pytest.approx(math.sqrt(1000.0 * 50e3), rel=1e-9)


@pytest.mark.parametrize("chord_um", [0.4, 1, 2, 3, 30])
def test_mode_3_marks_a_smooth_path_in_one_piece(chord_um: float) -> None:
    radius_mm = 0.3 if chord_um < 1 else RADIUS_MM
    trace = trace_of(circle(chord_um, radius_mm=radius_mm, sky="SKYWRITE MODE 3 TIMELAG 250us"))
    assert len(trace.channels[0].emission.start_ms) == 1


def test_real_corners_of_short_segments_count() -> None:
    """Stairs of 3.3 pulses: at every step the velocity vector turns by a right angle."""
    steps = "".join(f"LINE X {0.0033 * (k + 1):.6f}\nLINE Y {0.0033 * (k + 1):.6f}\n" for k in range(40))
    head = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 300\nACC 1000000\n"
    ends = trace_of(f"{head}LASER ON\n{steps}LASER OFF\n").schedule.profile.end[:-1]
    assert ends == pytest.approx(np.full(len(ends), JUMP / math.sqrt(2)), rel=1e-6)
    sky = f"{head}SKYWRITE MODE 3 TIMELAG 20us\nJUMP X 1 Y 1\nLASER ON\n"
    sky += "LINE X 1.0052\nLINE Y 1.0051\nLINE X 1.0117\nLASER OFF\n"
    assert len(trace_of(sky).channels[0].emission.start_ms) == 3


@pytest.mark.parametrize("shift", [0.0, 0.2, 0.35])
def test_a_corner_across_points_within_one_pulse(shift: float) -> None:
    """A right angle in steps that round to nothing: the calls turn at once, so it is one corner."""
    half = math.radians(45)
    x, y = 10 + (shift + 0.2 * math.cos(half)) / 1000, 10 + (shift + 0.2 * math.sin(half)) / 1000
    head = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 300\nACC 1000000\nLASER ON\n"
    shifted = f"{10 + shift / 1000:.6f}"
    lines = f"LINE X 0 Y {shifted}\nLINE X {shifted}\nLINE X {x:.7f} Y {y:.7f}\nLINE X {x:.7f} Y 20\n"
    trace = trace_of(f"{head}{lines}LASER OFF\n")
    assert trace.schedule.profile.end[1] == pytest.approx(JUMP / math.sqrt(2), rel=1e-3)


def test_tangents_of_small_arcs() -> None:
    """A line, a quarter of a circle of 4.3 pulses, a line: no corner, wherever the points are within a pulse."""
    for k in range(40):
        x, y, r = 1.0 + 0.00037 * k, 0.5 + 0.00051 * k, 0.0043
        lines = f"JUMP Y {y:.6f}\nLASER ON\nLINE X {x:.6f}\n"
        lines += f"ARC CCW X {x + r:.6f} Y {y + r:.6f} I 0 J {r}\nLINE Y 2\nLASER OFF\n"
        trace = trace_of("LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 60\nACC 1000000\n" + lines)
        assert trace.schedule.profile.end[1:3] == pytest.approx([60, 60], rel=1e-6)


@pytest.mark.parametrize("pulses_per_mm", [(1000.0, 640.0), (400.0, 1000.0)])
@pytest.mark.parametrize("chord_um", [3, 10])
def test_unequal_axes(pulses_per_mm: tuple[float, float], chord_um: float) -> None:
    """The velocity in mm/s along the circle is VEL, but for the detours of whole pulses."""
    machine = Machine(pulses_per_mm=pulses_per_mm)
    trace = trace_of(circle(chord_um), machine)
    segments = trace.segments
    count = len(segments.length)
    part = slice(count // 10, count - count // 10)
    px, py = pulses_per_mm
    mm = np.hypot((segments.x1 - segments.x0)[part] / px, (segments.y1 - segments.y0)[part] / py).sum()
    assert mm / trace.schedule.duration_ms[part].sum() * 1000 == pytest.approx(SPEED, rel=0.02)


def test_an_end_at_a_corner_that_rounding_makes_is_no_corner_too_fast() -> None:
    """A chord of 30 um turns by 0.01: 3 mm/s of the 5 that look-ahead allows."""
    assert "GJ514" not in {f.rule.code for f in diagnostics_of(circle(30, end=" END 280"))}


@pytest.mark.parametrize("chord_um", [1, 3, 10])
def test_the_calls_of_a_smooth_path_have_no_corner_too_fast(chord_um: float) -> None:
    """What the planner takes for smooth, rounding explains in the listing."""
    found = run_listing("\n".join(calls_of(circle(chord_um))))
    assert "GJ707" not in found.codes()


WIDE = Machine(field_x_mm=(-300.0, 300.0), field_y_mm=(-300.0, 300.0), max_velocity_mm_s=10000.0)


def bent_path(rng: Random, kinks: Sequence[float]) -> str:
    """A line, an arc by radius of nearly half a turn, a line; `kinks`: corners before and behind the arc, rad."""
    x, y, course = rng.uniform(-5, 5), rng.uniform(-5, 5), rng.uniform(0, math.tau)
    lines = [f"JUMP X {x:.9f} Y {y:.9f}", "LASER ON"]

    def line() -> None:
        nonlocal x, y
        length = 10 ** rng.uniform(0.5, 1.3)
        x, y = x + length * math.cos(course), y + length * math.sin(course)
        lines.append(f"LINE X {x:.9f} Y {y:.9f}")

    line()
    course += kinks[0]
    radius, sweep, sense = 10 ** rng.uniform(0, 2), math.radians(rng.uniform(170, 190)), rng.choice([-1, 1])
    x, y = x - sense * radius * math.sin(course), y + sense * radius * math.cos(course)
    course += sense * sweep
    x, y = x + sense * radius * math.sin(course), y - sense * radius * math.cos(course)
    turn, written = ("CCW" if sense > 0 else "CW"), math.copysign(radius, math.pi - sweep)
    lines.append(f"ARC {turn} X {x:.9f} Y {y:.9f} R {written:.9f}")
    course += kinks[1]
    line()
    head = f"LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL {10 ** rng.uniform(2, 4):.3f}\nACC 1000000\n"
    return "\n".join([head, *lines, "LASER OFF\n"])


def arc_corners(trace: Trace) -> Floats:
    """Velocities before and behind the arc of a bent path."""
    return trace.schedule.profile.end[1:3]


@pytest.mark.parametrize("bend", [0.0, 0.1])
@pytest.mark.parametrize("block", range(4))
def test_corners_of_arcs_near_half_a_turn(block: int, bend: float) -> None:
    """Rounding changes their chord, and the radius that is sent with it: neither makes a corner, nor takes one."""
    for seed in range(block, 120, 4):
        rng = Random(seed)
        kinks = [rng.uniform(-bend, bend) for _ in range(2)]
        text = bent_path(rng, kinks)
        trace, turns = trace_of(text, WIDE), 2 * np.abs(np.sin(np.array(kinks) / 2))
        speeds = trace.schedule.profile.peak[1:4]
        fastest = np.minimum(np.minimum(speeds[:-1], speeds[1:]), JUMP / np.maximum(turns, 1e-9))
        assert arc_corners(trace) == pytest.approx(fastest, rel=2e-3), (seed, text)
        assert "GJ707" not in run_listing("\n".join(calls_of(text, WIDE)), WIDE).codes(), (seed, text)


def test_corners_of_arcs_that_rounding_does_not_explain() -> None:
    """As fast as twice the machine's look-ahead allows."""
    reckless = replace(WIDE, lookahead_time_ms=2 * WIDE.lookahead_time_ms)
    for seed in range(60):
        rng = Random(seed)
        kinks = [rng.choice([-1, 1]) * rng.uniform(0.02, 0.3) for _ in range(2)]
        text = bent_path(rng, kinks)
        turns = 2 * np.abs(np.sin(np.array(kinks) / 2))
        jumps = arc_corners(trace_of(text, reckless)) * turns
        found = [d.rule.code for d in run_listing("\n".join(calls_of(text, reckless)), WIDE).diagnostics]
        assert found.count("GJ707") >= np.count_nonzero(jumps > 1.5 * JUMP), (seed, text)
