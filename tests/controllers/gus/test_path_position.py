"""Positions on the path."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support.controller import needs_controller
from support.tools import MARK, stream_of

from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.geometry import call_segments
from gusjob.controllers.gus.path_position import PathPosition, PositionRange, TimedPath
from gusjob.controllers.gus.remainder import remainder_from

pytestmark = needs_controller


def path_of(text: str) -> tuple[TimedPath, Stream]:
    stream = stream_of(MARK + text)
    return TimedPath.of(stream.buffered, (0, 0)), stream


def at(row: int, along: float = 0.0) -> PathPosition:
    near: Any = pytest.approx(along)
    return PathPosition(row=row, along_pulse=near)


def test_rewind_by_a_time_and_rounding() -> None:
    route, _ = path_of("LINE X 5\nLINE X 5 Y 5\nDWELL 3\nLINE X 0 Y 5\nLINE X 0 Y 0\n")
    ms = 1 / float(route.calls.vel[0])
    assert route.rewind(PathPosition(row=1, along_pulse=0.0), 10 * ms) == at(0, 4988)
    assert route.rewind(PathPosition(row=1, along_pulse=0.0), 7000 * ms) == at(0)
    assert route.rewind(PathPosition(row=1, along_pulse=4.0), 10 * ms) == at(0, 4992)
    assert route.rewind(PathPosition(row=0), 10 * ms) == at(0)
    assert route.rewind(PathPosition(row=4, along_pulse=100.0), 10 * ms) == at(4, 88)
    # Within a dwell it is not known how long it lasted; its end is a dwell's time after its start.
    assert route.rewind(PathPosition(row=2), 10 * ms) == at(1, 4988)
    assert route.rewind(PathPosition(row=2), 0.0) == at(2)
    assert route.rewind(PathPosition(row=3), 2.9) == at(2)
    assert route.rewind(PathPosition(row=3), 3.0 + 10 * ms) == at(1, 4988)
    # Nor farther than to a row that had certainly been reached.
    assert route.rewind(PathPosition(row=3), 100.0, first=2) == at(2)
    assert route.rewind(PathPosition(row=1, along_pulse=4.0), 10 * ms, first=1) == at(1)


def test_a_row_that_begins_faster_than_its_velocity_is_rewound_at_that_of_the_row_before() -> None:
    route, _ = path_of("LINE X 5 VEL 400\nLINE X 10 VEL 50\n")
    route.calls.vel_end[0] = 400
    assert route.rewind(PathPosition(row=1, along_pulse=2000.0), 1.0) == at(1, 2000 - 400 - 2)


def test_after_a_dwell_the_motion_before_it_gives_the_start() -> None:
    route, _ = path_of("LINE X 5\nDWELL 3\nDWELL 4\nLINE X 5 Y 5\n")
    assert route.locate(4, 4, 5000, 1000) == PositionRange.exactly(at(3, 1000))
    assert route.locate(3, 3, 5000, 1000) == PositionRange.exactly(at(3, 1000))


def test_where_two_calls_fit_the_range_has_both() -> None:
    route, _ = path_of("LINE X 5\nLINE X 0\nLINE X 5\n")
    assert route.locate(2, 2, 2000, 0) == PositionRange(earliest=at(1, 3000), latest=at(2, 2000))
    assert route.locate(2, 2, 2000, 3) is None
    assert route.locate(2, 2, 2000, 1) is not None


@pytest.mark.parametrize("direction", ["CCW", "CW"])
def test_positions_on_an_arc_and_beyond_its_ends(direction: str) -> None:
    """A quarter circle about 0, 0."""
    end = "Y 5" if direction == "CCW" else "Y -5"
    stream = stream_of(MARK + f"JUMP X 5 Y 0\nARC {direction} X 0 {end} R 5\n")
    route = TimedPath.of(stream.buffered, (0, 0))
    number = len(route.timed) - 1
    laid = call_segments(stream.buffered, route.timed, np.zeros(len(route.timed), dtype=np.bool_))
    length, sign = float(laid.length[-1]), 1 if direction == "CCW" else -1
    for share in (0.0, 0.25, 0.7, 1.0):
        turn = sign * share * np.pi / 2
        distance, run, _ = route.nearest(number, 5000 * np.cos(turn), 5000 * np.sin(turn))
        assert distance == pytest.approx(0, abs=1e-6)
        assert run == pytest.approx(share * length, abs=1e-6)
    assert route.nearest(number, 4999, -10 * sign)[1] == 0
    assert route.nearest(number, -10, 4999 * sign)[1] == length


def test_a_position_near_an_arcs_end_is_its_end() -> None:
    """What is left would round to nothing, and an arc that ends where it begins is a full circle."""
    stream = stream_of(MARK + "LASER POWER 9\nLASER ON\nARC CCW X 5 Y 5 I 0 J 5\nLINE X 0\nLASER OFF\n")
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.ARC_CENTRE)[0])
    length = 5000 * np.pi / 2
    for left in (0.0, 0.2, 0.4, 0.6, 0.69, 0.9):
        calls = remainder_from(stream, PathPosition(row=row, along_pulse=length - left)).stream.buffered
        arcs = np.flatnonzero(calls.kind == Buffered.ARC_CENTRE)
        route = TimedPath.of(calls, (0, 0))
        lengths = [route.nearest(int(np.searchsorted(route.timed, at)), 0.0, 0.0)[2] for at in arcs]
        assert max(lengths, default=0.0) < 2, left
    for left in (3.0, 10.0, 5000.0):
        part = remainder_from(stream, PathPosition(row=row, along_pulse=length - left))
        assert (part.stream.buffered.kind == Buffered.ARC_CENTRE).sum() == 1, left


def test_rewind_over_several_segments() -> None:
    text = MARK + "VEL 100\n" + "".join(f"LINE X {i / 10}\n" for i in range(1, 50))
    calls = stream_of(text).buffered  # 100 pulse each, at 100 pulse/ms.
    route = TimedPath.of(calls, (0, 0))
    assert route.rewind(PathPosition(row=20, along_pulse=30), 0.2) == at(20, 8)
    assert route.rewind(PathPosition(row=20, along_pulse=30), 2.5) == at(17, 78)
    assert route.rewind(PathPosition(row=1, along_pulse=30), 9.0) == PathPosition(row=0)
    # Ten rows left the FIFO between two polls: the position determines the row.
    assert route.locate(20, 30, 2450.0, 0.0) == PositionRange.exactly(at(24, 50))
    # A poll that finds the head farther than the rows that had left: the earliest of them.
    assert route.earliest_at(20, 2450.0, 0.0) == at(19)
    assert route.earliest_at(20, 1950.0, 0.0) == at(19, 48)


def test_a_velocity_is_carried_over_rows_that_are_too_short_to_slow_down_in() -> None:
    """From 400 pulse/ms with 10 pulse/ms2: 400, 397.5, ... over rows of 100 pulse whose own velocity is 20."""
    route, _ = path_of("LINE X 5 VEL 400\n" + "".join(f"LINE X {5 + i / 10} VEL 20\n" for i in range(1, 30)))
    route.calls.vel_end[0] = 400
    fastest = [np.sqrt(400**2 - 2 * 10 * 100 * i) for i in range(20)]
    took_ms = sum(100 / v for v in fastest)
    found = route.rewind(PathPosition(row=21), took_ms)
    assert found == at(0, 4998)
    assert route.rewind(PathPosition(row=21), took_ms - 100 / fastest[0]) == at(1, 0) or found.row == 0


def test_a_full_circle_ends_where_it_begins() -> None:
    route, _ = path_of("LINE X 5\nARC CCW I 2 J 0\nLINE X 9\n")
    assert route.locate(2, 2, 5000, 0) == PositionRange(earliest=at(1), latest=at(2))
    assert route.locate(1, 1, 5000, 0, sent=1) == PositionRange.exactly(at(1))  # It was not sent.
    assert route.locate(2, 2, 7000, -2000).earliest.row == 1  # type: ignore[union-attr]
