"""The planner: corners, forced ends, arcs, rounding, and that nothing asks for what it can't get."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.tools import MARK, diagnostics_in, path_calls, run_job, stream_of

from gusjob.config.machine import Machine


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


def test_short_segments_get_what_length_and_acceleration_give() -> None:
    # 1 mm at 10 pulse/ms2 in front of a stop: sqrt(2*10*1000) = 141 > 100; 0.1 mm: 44.7.
    assert ends("LINE X 50\nLINE X 50.1\n") == pytest.approx([math.sqrt(2000), 0])
    assert ends("LINE X 0.1\nLINE X 50\n") == pytest.approx([math.sqrt(2000), 0])


def test_off_means_stop_and_dwell_and_stage_stop_too() -> None:
    assert ends("LOOKAHEAD OFF\nLINE X 20\nLINE X 50\nLOOKAHEAD\nLINE X 60\nLINE X 70\n") == [0, 0, 100, 0]
    assert ends("LINE X 20\nDWELL 5\nLINE X 50\n") == [0, 0]
    assert ends("LINE X 20\nWAIT\nLINE X 50\n") == [0, 0]
    assert ends("LINE X 20\nLASER POWER 5\nLASER ON\nLINE X 50\nLASER OFF\n") == [100, 0]


def test_a_forced_end_is_kept_and_limits_its_neighbours() -> None:
    assert ends("LOOKAHEAD OFF\nLINE X 20 END 30\nLINE X 50\n") == [30, 0]
    assert ends("LINE X 20 END 30\nLINE Y 50\n") == [30, 0]
    # 0.5 mm in front of END 0 can lose sqrt(2*10*500) = 100.
    assert ends("LINE X 20\nLINE X 20.1 END 0\nLINE X 40\n") == pytest.approx([math.sqrt(2000), 0, 0])
    # The last one may end at speed if that is forced: the calls say so, the interpreter warns.
    assert ends("LINE X 20 END 30\n") == [30]
    assert "GJ706" in run_job(MARK + "LINE X 20 END 30\n").codes()


def test_a_tiny_arc_never_becomes_a_circle() -> None:
    calls = path_calls(MARK + "LINE X 10\nARC CCW X 10.0001 Y 0.0002 R 5\n")
    assert calls[1].startswith("GT_LnXY(1,10000,0,")


@pytest.mark.parametrize("arc", ["X 0 Y -0.0004 I 5 J 0", "X 0.0004 Y 0 I 5 J 0.0001", "X 0.0004 Y 0 R -5"])
def test_a_nearly_full_circle_stays_one(arc: str) -> None:
    """Ends that fall on one pulse: what was meant as nearly a whole turn is a whole turn."""
    for way in ("CW", "CCW"):
        # The first two are nearly full one way round and next to nothing the other.
        ran = run_job(MARK + f"ARC {way} {arc}\n")
        assert ran.column("length_mm") in ([pytest.approx(10 * math.pi, abs=0.01)], [0])
    lengths = [run_job(MARK + f"ARC {way} {arc}\n").column("length_mm")[0] for way in ("CW", "CCW")]
    assert max(lengths) == pytest.approx(10 * math.pi, abs=0.01)


def test_an_arc_smaller_than_a_pulse_is_a_line() -> None:
    calls = path_calls(MARK + "LINE X 1\nARC CW I 0.0004 J 0\nLINE X 2\n")
    assert calls[1].startswith("GT_LnXY(1,1000,0,100,")
    assert "GJ701" not in run_job(MARK + "LINE X 1\nARC CW I 0.0004 J 0\nLINE X 2\n").codes()


def test_the_centre_is_whole_pulses_from_a_whole_start() -> None:
    (_, call) = path_calls(MARK + "LINE X 0.0004\nARC CCW I 3.3336 J 0\n")
    assert call.split(",")[3:5] == ["3334", "0"]


def test_a_radius_just_short_of_half_the_chord_still_reaches() -> None:
    (call,) = path_calls(MARK + "ARC CW X 3.3336 Y 0 R 1.6667\n")
    assert float(call.split(",")[3]) == 1667.0
    assert diagnostics_in(MARK + "ARC CW X 3.3336 Y 0 R 1.6\n") == [(4, "GJ505")]


@pytest.mark.parametrize("seed", range(25))
def test_no_segment_asks_for_what_it_cant_get(seed: int) -> None:
    """Random paths: whatever is planned, the interpreter reaches, and corners keep to TIME * ACC."""
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
