"""The remainder of a job from a position: state rebuilt, jump, rest."""

from __future__ import annotations

import random

import numpy as np
import pytest
from support.controller import Row, needs_controller
from support.hardware import (
    MARK_FIRST,
    STATES,
    SYSTEM_2,
    Bench,
    fresh,
    listed,
    zigzag,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.calls import Buffered
from gusjob.controllers.gus.model import simulate_stream
from gusjob.controllers.gus.path_position import PathPosition
from gusjob.controllers.gus.remainder import at_next_motion, remainder_from
from gusjob.frontend import check_text, read_listing

pytestmark = needs_controller


def test_the_lasers_are_rebuilt_at_any_row(gus: Bench) -> None:
    """Power and light of all that is left, whatever was set before: modes, delays, FPK, follow, both channels."""
    stream, machine = stream_of(STATES), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    timed = np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)
    light = [Row.EMISSION0_MS, Row.EMISSION1_MS, Row.POWER0_MS, Row.POWER1_MS]
    for row in range(len(stream.buffered)):
        fresh(gus)
        assert gus.run(stream, machine, begin=PathPosition(row=row)).faults == []
        rows = gus.controller.rows()
        first = int(np.searchsorted(timed, row))
        left = whole[first:]
        rows = rows[len(rows) - len(left) :]
        assert rows[:, [Row.X1, Row.Y1]] == pytest.approx(left[:, [Row.X1, Row.Y1]], abs=1e-6), row
        # In the first motion the light comes later by the delay, and it may start from rest.
        assert (rows[:1, light] > 0).tolist() == (left[:1, light] > 0).tolist(), row
        if len(rows) > 1:
            same_time = np.abs(rows[1:, Row.DURATION_MS] - left[1:, Row.DURATION_MS]) < 1e-6
            assert same_time.all(), row
            assert rows[1:, light] == pytest.approx(left[1:, light], rel=1e-4, abs=1e-3), row
        for channel in (0, 1) if len(left) else ():
            lit, energy = left[0, Row.EMISSION0_MS + channel], left[0, Row.POWER0_MS + channel]
            if lit:
                mean = rows[0, Row.POWER0_MS + channel] / rows[0, Row.EMISSION0_MS + channel]
                assert mean == pytest.approx(energy / lit, rel=0.15), (row, channel)


def test_settings_in_force_are_set_again_in_order(gus: Bench) -> None:
    """Begun at the last row: what the lasers know is what they would know, no more and nothing of the past."""
    stream = stream_of(STATES)
    part = remainder_from(stream, PathPosition(row=int(np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)[-1])))
    set_up = [(c.name, c.args) for c in part.stream.calls if c.at == 0 and c.name != "GT_CrdClear"]
    settings = [(c.name, c.args) for c in stream.calls if c.name not in (
        "GT_CrdClear", "GT_CrdStart", "GT_CrdStatus", "GT_SetCrdPrm", "GT_LaserPrfCmd", "GT_EnaFPK"
    )]  # fmt: skip
    old = next(i for i, (name, _) in enumerate(settings) if name == "GT_SetLevelDelay")
    wanted = settings[:old] + settings[old + 1 :]
    built = [("GT_SetCrdPrm", c.args) for c in stream.calls if c.name == "GT_SetCrdPrm"][-1:]
    assert sorted(map(str, set_up)) == sorted(map(str, wanted + built))
    names = [name for name, _ in set_up]
    assert names.index("GT_LaserPowerMode") < names.index("GT_LaserOutFrq")
    assert names[-1] == "GT_SetCrdPrm"
    assert all(line > 0 for line in part.stream.buffered.line.tolist())
    # In the second stage it is the delays of then, and no call of later.
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.FOLLOW)[0])
    early = [(c.name, c.args) for c in remainder_from(stream, PathPosition(row=row)).stream.calls if c.at == 0]
    assert [args for name, args in early if name == "GT_SetLevelDelay"] == [(30.0, 20.0, 0.0)]
    assert not {"GT_EnaFPK", "GT_DisFPK", "GT_SetLaserDisMode"} & {name for name, _ in early}


def test_a_new_mode_revokes_the_power_and_the_same_one_does_not(gus: Bench) -> None:
    for mode, found in ((1, []), (0, [40.0])):
        stream = listed(
            SYSTEM_2 + zigzag(2) + "GT_BufLaserOff(2,1,0)\nGT_CrdStart(2,2)\nGT_CrdStatus(2,run,segment,1)\n"
            f"GT_LaserPowerMode({mode},100,0,0)\nGT_CrdClear(2,1)\n" + zigzag(2) + "GT_CrdStart(2,2)\n"
        )
        part = remainder_from(stream, PathPosition(row=len(stream.buffered) - 2))
        lead = part.stream.buffered.pick(np.arange(part.lead_rows))
        assert lead.p[lead.kind == Buffered.POWER].tolist() == found
        starts = [(c.name, c.args) for c in part.stream.calls if c.name in ("GT_CrdStart", "GT_CrdClear")]
        assert starts == [("GT_CrdClear", (2.0, 1.0)), ("GT_CrdStart", (2.0, 2.0))]


def test_settings_of_an_older_mode_are_not_set_again() -> None:
    text = SYSTEM_2.replace("GT_SetCrdPrm", "GT_LaserPowerMode(1,2000,0,0)\nGT_SetPulseWidth(5,0)\nGT_SetCrdPrm", 1)
    part = remainder_from(listed(text + zigzag(3) + "GT_CrdStart(2,2)\n"), PathPosition(row=3))
    names = [call.name for call in part.stream.calls if call.at == 0]
    assert names == ["GT_SetAxisMode", "GT_LaserPowerMode", "GT_SetPulseWidth", "GT_SetCrdPrm", "GT_CrdClear"]


def test_a_laser_switched_on_immediately_is_switched_on_again(gus: Bench) -> None:
    text = SYSTEM_2.replace("GT_BufLaserOn(2,1,0)\n", "") + zigzag(3) + "GT_SetHSIOOpt(1,0)\nGT_CrdStart(2,2)\n"
    later = "GT_CrdStatus(2,run,segment,1)\nGT_SetHSIOOpt(1,0)\nGT_CrdClear(2,1)\n" + zigzag(3)
    stream = listed(text + later + "GT_CrdStart(2,2)\n")
    for row, on in ((5, True), (4, True)):
        part = remainder_from(stream, PathPosition(row=row))
        assert (Buffered.ON in part.stream.buffered.kind[: part.lead_rows].tolist()) == on, row


def test_end_velocities_are_those_that_can_be_reached_from_rest() -> None:
    """Begun 3 pulse before a corner that is passed at full speed: the way is too short for it."""
    stream = stream_of(MARK + "LASER POWER 30\nLASER ON\nLINE X 5\nLINE X 10\nLASER OFF\n")
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.LINE)[0])
    assert stream.buffered.vel_end[row] == 100
    part = remainder_from(stream, PathPosition(row=row, along_pulse=4990.0))
    calls = part.stream.buffered
    assert calls.vel_end[part.lead_rows] == pytest.approx((2 * 10 * 10) ** 0.5, rel=0.02)
    assert calls.vel_end[-2] == 0
    assert stream.buffered.vel_end[row] == 100  # The job's own are not touched.


@pytest.mark.parametrize("arc", ["ARC CCW I 5 J 1", "ARC CW X 8 Y 3 R 6", "ARC CCW X 8 Y 3 R -6"])
def test_a_remainder_of_an_arc_stays_on_the_arc(arc: str) -> None:
    stream = stream_of(MARK + f"JUMP X 1 Y 2\n{arc}\n")
    trace, _ = simulate_stream(stream, Machine())
    assert trace is not None
    row = int(np.flatnonzero(stream.buffered.kind <= Buffered.ARC_RADIUS)[-1])
    laid = trace.segments
    length = float(laid.length[-1])
    for share in (0.1, 0.6, 0.9):
        part = remainder_from(stream, PathPosition(row=row, along_pulse=share * length))
        begun, faults = simulate_stream(part.stream, Machine())
        assert begun is not None
        assert faults == []
        there = begun.segments
        assert float(there.length[-1]) == pytest.approx((1 - share) * length, abs=5)
        middle = laid.points(np.array([len(laid.length) - 1]), np.array([(1 + share) / 2]))
        found = there.points(np.array([len(there.length) - 1]), np.array([0.5]))
        assert np.abs(np.array(middle) - np.array(found)).max() < 2


def test_a_full_circle_that_hardly_began_is_whole() -> None:
    stream = stream_of(MARK + "LASER POWER 9\nLASER ON\nARC CW I 3 J 0\nLASER OFF\n")
    row = int(np.flatnonzero(stream.buffered.kind == Buffered.ARC_CENTRE)[0])
    assert at_next_motion(stream.buffered, PathPosition(row=row, along_pulse=0.3)) == PathPosition(row=row)
    done = at_next_motion(stream.buffered, PathPosition(row=row, along_pulse=2 * np.pi * 3000 - 0.3))
    assert done.row == len(stream.buffered)


def test_a_laser_that_goes_off_next_is_not_switched_on() -> None:
    stream = stream_of(MARK_FIRST + "JUMP X 0 Y 0\nLASER POWER 20\nLASER ON\nLINE X 2\nLASER OFF\n")
    off = int(np.flatnonzero(stream.buffered.kind == Buffered.OFF)[0])
    kinds = remainder_from(stream, PathPosition(row=off)).stream.buffered.kind.tolist()
    assert kinds.index(Buffered.LINE) < kinds.index(Buffered.ON)
    assert kinds.count(Buffered.ON) == 1


def test_distance_follow_that_is_off_stays_off(gus: Bench) -> None:
    text = (
        MARK + "LASER DISTANCE REF X 0 Y 0 RATIO X 5 Y 5 MIN 0 MAX 100\nLASER POWER 9\nLASER ON\nLINE X 1\nLASER OFF\n"
    )
    text += "LASER DISTANCE OFF\nLASER ON\nLINE X 2\nLASER OFF\n"
    stream = stream_of(text)
    last = int(np.flatnonzero(stream.buffered.kind == Buffered.LINE)[-1])
    assert gus.run(stream, gus.machine(Machine()), begin=PathPosition(row=last)).faults == []
    row = gus.controller.rows()[-1]
    assert (row[Row.POWER0_MIN], row[Row.POWER0_MAX]) == (9, 9)


def random_job(rng: random.Random) -> str:
    """Marks, jumps, dwells and arcs of two channels at direct powers, in stages."""
    lines = [MARK + "LASER MODE DUTY CARRIER 5 CHANNEL 1\nLASER POWER 5\nLASER POWER 6 CHANNEL 1"]
    for _ in range(rng.randint(3, 9)):
        channel = rng.choice(["", " CHANNEL 1"])
        if rng.random() < 0.3:
            lines.append(f"LASER DELAY ON {rng.randint(0, 90)}us OFF {rng.randint(90, 200)}us{channel}")
        if rng.random() < 0.3:
            lines.append(f"LASER POWER {rng.randint(1, 90)}{rng.choice(['', ' NOW'])}{channel}")
        lines.append(f"JUMP X {rng.randint(-9, 9)} Y {rng.randint(-9, 9)}")
        lines.append(f"LASER ON{channel}")
        for _ in range(rng.randint(1, 4)):
            x, y = rng.randint(10, 90), rng.randint(-90, -10)
            lines.append(
                rng.choice(
                    [f"LINE X {x / 10} Y {y / 10}", f"LASER POWER {rng.randint(1, 90)}{channel}", "DWELL 20",
                     f"ARC CCW I {x / 20} J {y / 20}", f"ARC CW X {x / 10} Y {y / 10} R 40"]
                )
            )  # fmt: skip
        lines.append(f"LINE X {rng.randint(100, 120) / 10} Y {rng.randint(91, 99) / 10}")
        lines.append(f"LASER OFF{channel}")
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("seed", range(25))
def test_any_job_from_any_row(gus: Bench, seed: int) -> None:
    """Each segment behind the place comes as in the whole run: where, lit or dark, at which power."""
    rng = random.Random(seed)
    stream, machine = stream_of(random_job(rng)), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    whole = gus.controller.rows()
    timed = np.flatnonzero(stream.buffered.kind <= Buffered.DELAY)
    for number in rng.sample(range(len(timed)), min(len(timed), 4)):
        gus.controller.reset()
        gus.controller.options(poll_us=40_000, call_us=5)
        begin = PathPosition(row=int(timed[number]), along_pulse=rng.choice([0.0, 0.0, 700.0]))
        if stream.buffered.kind[begin.row] == Buffered.DELAY or whole[number, Row.LENGTH] < 1500:
            begin = PathPosition(row=begin.row)
        assert gus.run(stream, machine, begin=begin).faults == []
        rows = gus.controller.rows()[-(len(whole) - number) :]
        wanted = whole[number:]
        assert rows[:, [Row.X1, Row.Y1]] == pytest.approx(wanted[:, [Row.X1, Row.Y1]], abs=1e-6)
        assert rows[1:, Row.LENGTH] == pytest.approx(wanted[1:, Row.LENGTH], abs=1e-6)
        assert rows[0, Row.LENGTH] == pytest.approx(wanted[0, Row.LENGTH] - begin.along_pulse, abs=6)
        for lit, power in ((Row.EMISSION0_MS, Row.POWER0_MS), (Row.EMISSION1_MS, Row.POWER1_MS)):
            share = rows[:, lit] / rows[:, Row.DURATION_MS] > 0.5
            assert share.tolist() == (wanted[:, lit] / wanted[:, Row.DURATION_MS] > 0.5).tolist()
            mean = rows[share, power] / rows[share, lit]
            assert mean == pytest.approx(wanted[share, power] / wanted[share, lit], rel=1e-6)


def test_a_stage_that_was_started_early_is_started_again() -> None:
    """A listing that starts first and sends then: what is left of it has a start of its own, behind its rows."""
    text = (
        "GT_SetCrdPrm(1,{2,{1,2,0,0,0,0,0,0},10000,1000,0,1,{0,0,0,0,0,0,0,0}})\nGT_CrdClear(1,0)\n"
        "GT_LnXY(1,10,0,50,2,0,0)\nGT_CrdStart(1,0)\nGT_LnXY(1,20,0,50,2,0,0)\nGT_LnXY(1,30,0,50,2,0,0)\n"
        "GT_CrdStatus(1,run,segment,0)\n"
    )
    source, _ = check_text(text.encode(), "early.gts")
    assert source is not None
    part = remainder_from(read_listing(source)[0], PathPosition(row=2))
    behind = [(call.name, call.at) for call in part.stream.calls]
    assert behind[-2:] == [("GT_CrdStart", 2), ("GT_CrdStatus", 2)]
    assert len(part.stream.buffered) == 2  # The way, and the last line.
