"""Whole pulses: arcs that rounding makes tiny, full or short."""

from __future__ import annotations

import math

import pytest
from support.tools import MARK, diagnostics_in, path_calls, run_job


def test_a_tiny_arc_never_becomes_a_circle() -> None:
    calls = path_calls(MARK + "LINE X 10\nARC CCW X 10.0001 Y 0.0002 R 5\n")
    assert calls[1].startswith("GT_LnXY(1,10000,0,")


@pytest.mark.parametrize("arc", ["X 0 Y -0.0004 I 5 J 0", "X 0.0004 Y 0 I 5 J 0.0001", "X 0.0004 Y 0 R -5"])
def test_a_nearly_full_circle_stays_one(arc: str) -> None:
    """Ends that round to one pulse: nearly a whole turn becomes a whole turn."""
    for direction in ("CW", "CCW"):
        # The first two are nearly full in one direction and nearly nothing in the other.
        ran = run_job(MARK + f"ARC {direction} {arc}\n")
        assert ran.column("length_mm") in ([pytest.approx(10 * math.pi, abs=0.01)], [0])
    lengths = [run_job(MARK + f"ARC {direction} {arc}\n").column("length_mm")[0] for direction in ("CW", "CCW")]
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
