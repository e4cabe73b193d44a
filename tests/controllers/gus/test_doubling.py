"""What a run that continues marks twice, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered, Stream
from gusjob.controllers.gus.doubling import _SLACK_PULSE, before_laser_on, doubling_mm, is_on
from gusjob.controllers.gus.path_position import PathPosition, PositionRange

MACHINE = Machine()
PER_MM = MACHINE.pulses_per_mm[0]


def stream(text: str) -> Stream:
    return stream_of(MARK + "VEL 500\nACC 1000\n" + text, MACHINE)


def motions(made: Stream) -> list[int]:
    return np.flatnonzero(made.buffered.kind < Buffered.DELAY).tolist()


def doubled_pulse(made: Stream, begin: PathPosition, end: PathPosition, machine: Machine = MACHINE) -> float:
    per_mm = min(machine.pulses_per_mm)
    return doubling_mm(made, PositionRange(earliest=begin, latest=end), machine) * per_mm - _SLACK_PULSE


def test_doubling_is_the_length_of_the_marks_between_two_positions() -> None:
    made = stream(
        "LASER POWER 40\nLASER ON\nLINE X 3\nLINE X 3 Y 4\nLASER OFF\nJUMP X 0 Y 0\nLASER ON\nLINE X -2\nLASER OFF\n"
    )
    first, second, jump, last = motions(made)
    begin = PathPosition(row=first, along_pulse=1000)
    for end, length in (
        (PathPosition(row=first, along_pulse=1500), 500),
        (PathPosition(row=second), 2000),
        (PathPosition(row=second, along_pulse=4000), 6000),
        (PathPosition(row=jump, along_pulse=2500), 6000),
        (PathPosition(row=last, along_pulse=700), 6700),
        (PathPosition(row=len(made.buffered)), 8000),
    ):
        assert doubled_pulse(made, begin, end) == pytest.approx(length), end
    assert doubling_mm(made, PositionRange.exactly(begin), MACHINE) == 0
    assert doubled_pulse(made, PathPosition(row=jump), PathPosition(row=jump, along_pulse=900)) == pytest.approx(0)


def test_doubling_counts_the_coarser_axis_and_dwells_have_no_length() -> None:
    made = stream("LASER POWER 40\nLASER ON\nLINE X 3\nDWELL 5\nLINE X 6\nLASER OFF\n")
    first, last = motions(made)
    machine = replace(MACHINE, pulses_per_mm=(PER_MM, PER_MM / 2))
    found = PositionRange(earliest=PathPosition(row=first), latest=PathPosition(row=last, along_pulse=1000))
    assert doubling_mm(made, found, machine) == pytest.approx((4000 + _SLACK_PULSE) / (PER_MM / 2))


def test_an_off_delay_marks_behind_the_end_of_each_mark() -> None:
    made = stream("LASER DELAY ON 20us OFF 60us\nLASER POWER 40\nLASER ON\nLINE X 3\nLASER OFF\nJUMP X 5\n")
    first, jump = motions(made)
    tail = 0.06 * 500
    assert doubled_pulse(made, PathPosition(row=first), PathPosition(row=jump)) == pytest.approx(3000 + tail, abs=0.5)


def test_the_switch_of_each_row() -> None:
    made = stream(
        "LASER POWER 40\nLINE X 1\nLASER ON\nLINE X 3\nLASER OFF\nLINE X 5\n"
        "LASER ON CHANNEL 1\nLINE X 6\nLASER OFF CHANNEL 1\n"
    )
    rows = motions(made)
    assert is_on(made, 0)[rows].tolist() == [False, True, False, False]
    assert is_on(made, 1)[rows].tolist() == [False, False, False, True]


@pytest.mark.parametrize("delay_us", [0, 2000, 60_000])
def test_a_mark_that_continues_begins_earlier_by_its_on_delay(delay_us: int) -> None:
    """From rest: acc t2 / 2, at most vel t; with the acceleration in pulse/ms2."""
    made = stream(f"LASER DELAY ON {delay_us}us OFF {delay_us}us\nLASER POWER 40\nLASER ON\nLINE X 40\nLASER OFF\n")
    (row,) = motions(made)
    acc, vel, ms = float(made.buffered.acc[row]), float(made.buffered.vel[row]), delay_us / 1000
    expected = min(acc * ms**2 / 2, vel * ms)
    found = before_laser_on(made, PathPosition(row=row, along_pulse=39_000.0))
    assert 39_000 - found.along_pulse == pytest.approx(expected)


def test_no_mark_is_moved_back_beyond_its_begin_and_no_jump_at_all() -> None:
    made = stream("LASER DELAY ON 60ms OFF 0us\nLASER POWER 40\nJUMP X 1\nLASER ON\nLINE X 2\nLASER OFF\nJUMP X 9\n")
    jump, mark, last = motions(made)
    assert before_laser_on(made, PathPosition(row=mark, along_pulse=500)) == PathPosition(row=mark)
    for row in (jump, last):
        dark = PathPosition(row=row, along_pulse=500)
        assert before_laser_on(made, dark) == dark


def test_the_switch_of_another_channel_does_not_matter() -> None:
    made = stream(
        "LASER DELAY ON 5ms OFF 5ms\nLASER POWER 40\nLASER ON\nLINE X 2\nLASER ON CHANNEL 1\nLINE X 40\n"
        "LASER OFF CHANNEL 1\nLASER OFF\n"
    )
    row = motions(made)[1]
    acc = float(made.buffered.acc[row])
    found = before_laser_on(made, PathPosition(row=row, along_pulse=5.0))
    assert found.row == motions(made)[0]
    assert 2000 - found.along_pulse + 5 == pytest.approx(acc * 25 / 2)


def test_a_faster_row_before_it_counts_with_its_own_acceleration() -> None:
    made = stream(
        "LASER DELAY ON 3ms OFF 3ms\nLASER POWER 40\nLASER ON\nLINE X 20 ACC 4000\nLINE X 40 ACC 100\nLASER OFF\n"
    )
    first, second = motions(made)
    found = before_laser_on(made, PathPosition(row=second, along_pulse=0.1))
    assert found.row == first
    assert 20_000 - found.along_pulse + 0.1 == pytest.approx(float(made.buffered.acc[first]) * 9 / 2)


@pytest.mark.parametrize(("along", "is_near"), [(1.0, True), (29.0, True), (31.0, False), (2000.0, False)])
def test_emission_after_the_end_of_a_mark_that_ends_at_rest(along: float, is_near: bool) -> None:
    """An off delay of 60 us is 30 pulse at 500 pulse/ms; the run begins again just before the laser is switched off."""
    made = stream("LASER DELAY ON 0us OFF 60us\nLASER POWER 40\nLASER ON\nLINE X 3\nLASER OFF\nJUMP X 3 Y 9\n")
    made.buffered.vel_end[:] = 0
    mark, jump = motions(made)
    position = PathPosition(row=jump, along_pulse=along)
    expected = PathPosition(row=mark, along_pulse=3000 - _SLACK_PULSE) if is_near else position
    assert before_laser_on(made, position) == expected


@pytest.mark.parametrize(("row", "along"), [(0, 2500.0), (1, 5.0)])
def test_emission_after_the_end_of_a_mark_that_ends_in_motion(row: int, along: float) -> None:
    """The run must have the same velocity where the laser is switched off: v2 / 2 acc before it."""
    made = stream("LASER DELAY ON 0us OFF 60us\nLASER POWER 40\nLASER ON\nLINE X 3\nLASER OFF\nJUMP X 9\n")
    rows = motions(made)
    made.buffered.vel_end[rows[0]], made.buffered.acc[rows[0]] = 40.0, 1.0
    found = before_laser_on(made, PathPosition(row=rows[row], along_pulse=along))
    assert found.row == rows[0]
    assert found.along_pulse == pytest.approx(3000 - 40**2 / 2 - _SLACK_PULSE)


def test_doubling_counts_the_longest_off_delay_of_the_job() -> None:
    made = stream(
        "LASER DELAY ON 20us OFF 9ms\nLASER POWER 40\nLASER ON\nLINE X 3\nLASER OFF\nJUMP X 3 Y 9\n"
        "LASER DELAY ON 20us OFF 30us\nLASER ON\nLINE X 5\nLASER OFF\n"
    )
    first, jump, _ = motions(made)
    found = PositionRange(earliest=PathPosition(row=first), latest=PathPosition(row=jump, along_pulse=8000))
    assert doubling_mm(made, found, MACHINE) * PER_MM == pytest.approx(3000 + 9 * 500 + _SLACK_PULSE)
