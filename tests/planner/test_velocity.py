"""End velocities: corners, arcs, stops, forced ends; and that no segment has a velocity that it can't reach."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.tools import MACHINE, MARK, job_of, path_calls, run_job, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.lower import compile_job
from gusjob.frontend import check_text, read_job


def ends(text: str, machine: Machine | None = None) -> list[float]:
    """vel_end of every motion call."""
    calls = path_calls(MARK + text, machine or Machine())
    return [float(c.rstrip(")").split(",")[-2]) for c in calls if "Delay" not in c]


def test_a_right_angle_changes_the_velocity_vector_by_time_times_acc() -> None:
    assert ends("LINE X 50\nLINE Y 50\n") == pytest.approx([5 / math.sqrt(2), 0])
    assert ends("LOOKAHEAD TIME 10\nLINE X 50\nLINE Y 50\n") == pytest.approx([10 / math.sqrt(2), 0])
    assert ends("LOOKAHEAD TIME 10 ACC 3pulse/ms2\nLINE X 50\nLINE Y 50\n") == pytest.approx([30 / math.sqrt(2), 0])
    assert ends("LOOKAHEAD ACC 3000mm/s2\nLINE X 50\nLINE Y 50\n") == pytest.approx([15 / math.sqrt(2), 0])


def test_straight_on_is_not_slowed_and_back_is() -> None:
    assert ends("LINE X 20\nLINE X 50\n") == [100, 0]
    assert ends("LINE X 20\nLINE X 50 VEL 60\n") == [60, 0]
    assert ends("LINE X 20\nLINE X 0\n") == [2.5, 0]


def test_a_tangent_arc_is_not_slowed() -> None:
    found = ends("LINE X 20\nARC CCW X 20 Y 10 I 0 J 5\nLINE X 0\n")
    assert found == pytest.approx([100, 100, 0])


def test_an_arc_stays_within_the_machines_acceleration() -> None:
    slow = Machine(max_acceleration_mm_s2=2000)
    calls = path_calls("VEL 200\nACC 2000\nLINE X 20\nARC CCW X 20 Y 10 I 0 J 5\nLINE X 0\n", slow)
    # v^2/r = 2 pulse/ms2 on 5000 pulse: 100 pulse/ms.
    assert calls[1].split(",")[6] == "100"


def test_short_segments_have_what_length_and_acceleration_allow() -> None:
    # 1 mm at 10 pulse/ms2 in front of a stop: sqrt(2*10*1000) = 141 > 100; 0.1 mm: 44.7.
    assert ends("LINE X 50\nLINE X 50.1\n") == pytest.approx([math.sqrt(2000), 0])
    assert ends("LINE X 0.1\nLINE X 50\n") == pytest.approx([math.sqrt(2000), 0])


def test_lookahead_off_a_dwell_and_a_stage_stop() -> None:
    assert ends("LOOKAHEAD OFF\nLINE X 20\nLINE X 50\nLOOKAHEAD\nLINE X 60\nLINE X 70\n") == [0, 0, 100, 0]
    assert ends("LINE X 20\nDWELL 5\nLINE X 50\n") == [0, 0]
    assert ends("LINE X 20\nWAIT\nLINE X 50\n") == [0, 0]
    assert ends("LINE X 20\nLASER POWER 5\nLASER ON\nLINE X 50\nLASER OFF\n") == [100, 0]


def test_a_forced_end_is_kept_and_limits_its_neighbours() -> None:
    assert ends("LOOKAHEAD OFF\nLINE X 20 END 30\nLINE X 50\n") == [30, 0]
    assert ends("LINE X 20 END 30\nLINE Y 50\n") == [30, 0]
    # 0.5 mm in front of END 0 can lose sqrt(2*10*500) = 100.
    assert ends("LINE X 20\nLINE X 20.1 END 0\nLINE X 40\n") == pytest.approx([math.sqrt(2000), 0, 0])
    # The last one may end at speed if that is forced: the calls have it, the simulator warns.
    assert ends("LINE X 20 END 30\n") == [30]
    assert "GJ706" in run_job(MARK + "LINE X 20 END 30\n").codes()


@pytest.mark.parametrize(("end", "expected"), [(3.5, []), (3.6, ["GJ514"])])
def test_a_right_angle_changes_the_velocity_by_the_root_of_two(end: float, expected: list[str]) -> None:
    """Look-ahead allows 5 ms x 1 pulse/ms2, that is 5 mm/s: 3.535 mm/s through a right angle."""
    source, _ = check_text(f"{MARK}LINE X 5 END {end}\nLINE Y 5\n".encode(), "x.job")
    assert source is not None
    assert [f.rule.code for f in compile_job(read_job(source, MACHINE)[0], MACHINE)[1]] == expected


@pytest.mark.parametrize("seed", range(25))
def test_no_segment_has_a_velocity_that_it_cant_reach(seed: int) -> None:
    """Random paths: the simulator reaches whatever is planned, and corners keep to TIME * ACC."""
    rng = np.random.default_rng(seed)
    n = 300
    lines = [MARK]
    x = y = 0.0
    for _ in range(n):
        step = 10 ** rng.uniform(-3, 1)
        x, y = np.clip(x + rng.normal() * step, -140, 140), np.clip(y + rng.normal() * step, -140, 140)
        kind = rng.integers(0, 10)
        if kind == 0:
            lines.append(f"VEL {10 ** rng.uniform(0, 3.5):.3f}\nACC {10 ** rng.uniform(2, 5.5):.1f}")
        if kind == 1:
            lines.append("DWELL 1")
        if kind == 2:
            radius = 5.0
            lines.append(f"ARC {'CW' if seed % 2 else 'CCW'} X {x:.4f} Y {y:.4f} R {max(radius, 30)}")
        elif kind == 3:
            lines.append(f"JUMP X {x:.4f} Y {y:.4f}")
        else:
            lines.append(f"LINE X {x:.4f} Y {y:.4f}")
    text = "\n".join(lines)
    ran = run_job(text)
    assert not {"GJ704", "GJ705", "GJ706", "GJ701"} & set(ran.codes())
    from gusjob.controllers.gus.model import simulate_stream

    _, found = simulate_stream(stream_of(text), Machine(), is_listing=True)
    assert "GJ707" not in [f.rule.code for f in found]


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("LINE X 20 END 50\nLINE X 40 VEL 50\n", []),
        ("LINE X 20 END 50.1\nLINE X 40 VEL 50\n", [(4, "GJ520")]),
        ("JUMPVEL 50\nLINE X 20 END 50\nJUMP X 40\n", []),
        ("JUMPVEL 50\nLINE X 20 END 50.1\nJUMP X 40\n", [(5, "GJ520")]),
        ("LOOKAHEAD OFF\nLINE X 20 END 50.1\nLINE X 40 VEL 50\n", [(5, "GJ520")]),
        # An END that can't be reached, or at a stop, has a rule of its own.
        ("LINE X 0.001 END 90\nLINE X 40 VEL 50\n", [(4, "GJ506")]),
        ("LINE X 20 END 90\nDWELL 1\nLINE X 40 VEL 50\n", [(4, "GJ510")]),
        # Straight into a circle of 0.1 mm: sqrt(10^6 mm/s2 * 0.1 mm) = 316.2 mm/s.
        ("VEL 1000\nACC 1000000\nLINE X 20 END 316\nARC CCW X 20 Y 0.2 R 0.1\nLINE X 10\n", []),
        ("VEL 1000\nACC 1000000\nLINE X 20 END 317\nARC CCW X 20 Y 0.2 R 0.1\nLINE X 10\n", [(6, "GJ520")]),
    ],
)
def test_a_forced_end_is_not_above_the_next_velocity(path: str, expected: list[tuple[int, str]]) -> None:
    job = job_of(MARK + path)
    _, found = compile_job(job, MACHINE)
    assert [(d.span.line, d.rule.code) for d in found] == expected
    if not expected:
        assert "GJ705" not in run_job(MARK + path).codes()
