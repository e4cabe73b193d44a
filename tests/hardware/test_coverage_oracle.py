"""The oracle of what was left out and marked twice, on intervals made by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from oracles.coverage import coverage
from support.controller import Floats, Kind, Lit


def line(
    high: float,
    low: float = 0.0,
    *,
    target: tuple[float, float] = (1000.0, 0.0),
    length: float = 1000.0,
    channel: int = 0,
    power: float = 40.0,
    off: float = 0.0,
    ordinal: int | None = None,
) -> Floats:
    """A stretch of a line in x of a length; `off`: how far it is from where that line is."""
    made = np.zeros(len(Lit))
    begin = target[0] - length
    made[[Lit.CHANNEL, Lit.KIND, Lit.X, Lit.Y]] = channel, Kind.LINE, *target
    made[[Lit.LEFT0, Lit.LEFT1, Lit.MS]] = high, low, (high - low) / 50
    made[[Lit.X0, Lit.X1]] = begin + length - high, begin + length - low
    made[[Lit.Y0, Lit.Y1]] = target[1] + off
    made[Lit.POWER_MS] = power * made[Lit.MS]
    made[[Lit.POWER_MIN, Lit.POWER_MAX]] = power
    made[Lit.ORDINAL] = target[0] + target[1] if ordinal is None else ordinal
    return made


def arc(high: float, low: float = 0.0, *, radius: float = 1000.0, centre: tuple[float, float] = (0.0, 0.0)) -> Floats:
    """A stretch of an arc, counter-clockwise, that ends to the right of its centre; distances along this arc."""
    made = np.zeros(len(Lit))
    made[[Lit.KIND, Lit.CX, Lit.CY, Lit.RADIUS]] = Kind.ARC_CENTRE, *centre, radius
    made[[Lit.X, Lit.Y]] = 1000.0, 0.0
    for left, places in ((high, (Lit.X0, Lit.Y0, Lit.LEFT0)), (low, (Lit.X1, Lit.Y1, Lit.LEFT1))):
        angle = -left / radius
        made[list(places)] = centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle), left
    made[[Lit.MS, Lit.POWER_MS]] = 1, 40
    return made


def still(kind: Kind, high: float, low: float = 0.0, *, at: tuple[float, float] = (1000.0, 0.0), on: int = 1) -> Floats:
    """A stretch of a dwell from a time to another before its end, or of emission at rest for that long."""
    made = np.zeros(len(Lit))
    made[[Lit.KIND, Lit.X, Lit.Y, Lit.X0, Lit.Y0, Lit.X1, Lit.Y1]] = kind, *at, *at, *at
    made[[Lit.LEFT0, Lit.LEFT1]] = (high, low) if kind is Kind.DELAY else (0, 0)
    made[[Lit.MS, Lit.POWER_MS, Lit.COMMAND]] = high - low, 40 * (high - low), on
    return made


WHOLE = np.array([line(1000), line(500, target=(1500, 0), length=500), still(Kind.DELAY, 10, at=(1500, 0))])


def test_a_run_covers_itself() -> None:
    found = coverage(WHOLE, WHOLE)
    assert (found.left_out, found.outside, found.burning_ms) == ((), (), 0)
    assert found.doubled.tolist() == [0]


def test_a_piece_that_is_left_out() -> None:
    found = coverage(WHOLE, np.array([line(1000, 620), line(610), *WHOLE[1:]]), [1])
    (gap,) = found.left_out
    assert (gap.target, gap.low, gap.high) == ((1000, 0), 610, 620)
    assert found.left_out_pulse == pytest.approx(10)
    assert "10.00 pulse of LINE to 1000,0 on channel 0, 610.00 to 620.00 before its end" in str(gap)
    assert found.doubled.tolist() == [0, 0]


@pytest.mark.parametrize(("size", "count"), [(0.9, 0), (1.1, 1)])
def test_a_piece_up_to_the_tolerance_is_not_left_out(size: float, count: int) -> None:
    found = coverage(WHOLE, np.array([line(1000, 500 + size), line(500), *WHOLE[1:]]))
    assert len(found.left_out) == count


def test_a_call_that_is_left_out_altogether() -> None:
    found = coverage(WHOLE, WHOLE[[0, 2]])
    assert [(gap.target, gap.size) for gap in found.left_out] == [((1500, 0), 500)]


def test_nothing_but_darkness() -> None:
    found = coverage(WHOLE, WHOLE[:0])
    assert (found.left_out_pulse, found.left_out_ms) == (1500, 10)
    assert coverage(WHOLE[:0], WHOLE[:0]).left_out == ()


def test_doubling_is_counted_by_part() -> None:
    parts = [line(1000, 400), line(500, 300), line(350), *WHOLE[1:]]
    found = coverage(WHOLE, np.array(parts), [1, 2])
    assert found.doubled == pytest.approx([0, 100, 50])
    assert found.left_out == ()


def test_the_same_piece_three_times_is_doubled_twice() -> None:
    found = coverage(WHOLE, np.array([line(1000), line(300, 200), line(300, 200), *WHOLE[1:]]), [2])
    assert found.doubled == pytest.approx([100, 100])


def test_channels_do_not_cover_each_other() -> None:
    whole = np.array([line(1000), line(1000, channel=1)])
    found = coverage(whole, np.array([line(1000), line(1000, 700)]))
    assert [(gap.channel, gap.size) for gap in found.left_out] == [(1, 1000)]
    assert found.doubled == pytest.approx([300])


def test_two_channels_that_double_the_same_piece_of_path_double_it_once() -> None:
    whole = np.array([line(1000), line(1000, channel=1)])
    found = coverage(whole, np.array([*whole, line(300, 100), line(250, 50, channel=1)]), [2])
    assert found.doubled == pytest.approx([0, 250])


def test_emission_before_the_lit_piece_of_a_call_is_outside() -> None:
    """The call is lit from 600 to 200 before its end."""
    whole = np.array([line(600, 200)])
    found = coverage(whole, np.array([line(650, 150)]))
    assert sorted((gap.low, gap.high) for gap in found.outside) == [(150, 199), (601, 650)]
    assert found.outside_pulse == pytest.approx(49 + 49)


def test_emission_on_the_way_to_a_target_of_the_job_is_outside() -> None:
    """A lit jump that ends where a call of the job ends has that call's target, but not its path."""
    found = coverage(WHOLE, np.array([*WHOLE, line(1000, off=20)]))
    assert found.outside_pulse == pytest.approx(1000)
    assert found.doubled == pytest.approx([0])


def test_emission_on_a_call_that_the_job_does_not_have_is_outside() -> None:
    found = coverage(WHOLE, np.array([*WHOLE, line(70, target=(4000, 4000), length=70)]))
    assert [(gap.target, gap.size) for gap in found.outside] == [((4000, 4000), 70)]


def test_power_0_is_dark() -> None:
    found = coverage(WHOLE, np.array([line(1000, 500), line(500, power=0), *WHOLE[1:]]))
    assert found.left_out_pulse == 500
    dark = np.array([*WHOLE, line(70, target=(4000, 4000), length=70, power=0)])
    assert coverage(WHOLE, dark).outside == ()


def test_another_power_is_wrong_where_the_power_is_constant() -> None:
    found = coverage(WHOLE, np.array([line(1000, 500), line(500, power=41), *WHOLE[1:]]))
    assert [(gap.target, gap.low, gap.high) for gap in found.wrong_power] == [((1000, 0), 0, 500)]
    assert coverage(WHOLE, WHOLE).wrong_power == ()
    follow = WHOLE.copy()
    follow[0, Lit.POWER_MIN] = 5
    assert coverage(follow, np.array([line(1000, 500), line(500, power=41), *WHOLE[1:]])).wrong_power == ()


def test_an_arc_about_a_rounded_centre_is_the_arc_of_the_job() -> None:
    """A quarter of it about a centre 0.4 pulse to the left: radius and distance are longer in proportion."""
    quarter = 1000 * math.pi / 2
    whole = np.array([arc(2 * quarter)])
    rest = arc(quarter * 1.0004, centre=(-0.4, 0), radius=1000.4)
    found = coverage(whole, np.array([arc(2 * quarter, quarter), rest]), [1])
    assert (found.left_out, found.outside) == ((), ())
    assert found.doubled == pytest.approx([0, 0], abs=1e-6)
    off = arc(quarter, centre=(0, 30))
    assert coverage(whole, np.array([*whole, off])).outside_pulse == pytest.approx(quarter)


def test_a_dwell_is_lit_for_its_time() -> None:
    found = coverage(WHOLE, np.array([*WHOLE[:2], still(Kind.DELAY, 10, 4, at=(1500, 0))]))
    assert found.left_out_ms == pytest.approx(4)
    again = np.array([*WHOLE[:2], still(Kind.DELAY, 10, 4, at=(1500, 0)), still(Kind.DELAY, 9.9, at=(1500, 0))])
    found = coverage(WHOLE, again, [3])
    assert found.left_out == ()
    assert found.doubled_dwell_ms == pytest.approx([0, 5.9])
    assert found.doubled == pytest.approx([0, 0])
    elsewhere = np.array([*WHOLE, still(Kind.DELAY, 3, at=(7, 7))])
    assert coverage(WHOLE, elsewhere).burning_ms == pytest.approx(3)


def test_emission_at_rest_burns_but_for_the_tail_of_an_off_delay() -> None:
    whole = np.array([line(1000), still(Kind.REST, 0.06, on=0)])
    burnt = np.array([line(1000), still(Kind.REST, 0.05, on=0), still(Kind.REST, 9, on=0), still(Kind.REST, 2)])
    assert coverage(whole, burnt).burning_ms == pytest.approx(9 - 0.06 + 2)
    assert coverage(whole, whole).burning_ms == 0
    # A job that burns by itself does so again.
    burning = np.array([line(1000), still(Kind.REST, 5)])
    assert coverage(burning, np.array([*burning, still(Kind.REST, 2)])).burning_ms == pytest.approx(2)


def test_targets_must_be_unique() -> None:
    with pytest.raises(ValueError, match="two calls"):
        coverage(np.array([line(1000, ordinal=1), line(1000, ordinal=2)]), WHOLE)


def test_random_intervals_against_counting() -> None:
    """Distances are whole pulses here, so that each pulse can be counted."""
    chance = np.random.default_rng(3)
    for _ in range(50):
        cuts = np.sort(chance.integers(0, 1000, (12, 2)), axis=1)
        cuts = cuts[cuts[:, 0] < cuts[:, 1]]
        marks = sorted(chance.integers(0, len(cuts) + 1, 2).tolist())
        found = coverage(np.array([line(1000)]), np.array([line(high, low) for low, high in cuts]), marks, 0.0)
        times = np.zeros(1000, dtype=int)
        doubled = [0, 0, 0]
        for i, (low, high) in enumerate(cuts):
            doubled[sum(i >= mark for mark in marks)] += int((times[low:high] > 0).sum())
            times[low:high] += 1
        assert found.left_out_pulse == pytest.approx((times == 0).sum())
        assert found.doubled == pytest.approx(doubled)
