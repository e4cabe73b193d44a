"""The RTC5's own numbers (manual p. 115, p. 481 f.)."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from msgspec import structs
from oracles import skywriting as ref
from oracles.skywriting import Sky, Step
from support.skywriting import FAST, NEAR, RTC5, case_of, compiled, head, marked, matched, moves_of, must, ran
from support.tools import diagnostics_in

from gusjob.config.machine import Machine
from gusjob.ir.setup import SkyWriting


def test_rtc5_switches() -> None:
    """Timelag 174 us, LaserOnShift -80 (-40 us): on at 134 us behind the start, off at 174 us behind the end."""
    case = must(case_of(marked(head(RTC5), (15000.0, 5000.0))))
    emission, mark = case.trace.channels[0].emission, case.plan.marks[0]
    assert emission.start_ms[0] - case.starts(mark.legs[0]) == pytest.approx(0.134, abs=1e-9)
    assert emission.end_ms[0] - case.over(mark.legs[-1]) == pytest.approx(0.174, abs=1e-3)  # Braking from 90 us on.


@pytest.mark.parametrize("mode", [1, 2, 3])
@pytest.mark.parametrize("acc", [1000.0, 250.0])
def test_rtc5_run_times(mode: int, acc: float) -> None:
    """10 us * Nprev at mark speed before S, 10 us * Npost behind E; beyond that v/a for each acceleration.

    Mode 1 goes there and back: 20 us * Nprev in all, as v/a goes to nothing. It turns at P and Q, and stops at S and E
    before and behind: a motion of length d takes 2*sqrt(d/a) where nothing needs mark speed, a triangle.
    """
    sky = replace(RTC5, mode=mode)
    machine = Machine(lookahead_acc_pulse_per_ms2=1e-6)
    steps = [*marked(head(sky, acc=acc), (15000.0, 5000.0)), Step(op="jump", at=(0.0, 20000.0))]
    plan = ref.planned(steps)
    stream, _ = compiled(ref.job_text(steps), machine)
    ends, times = matched(plan.legs, moves_of(stream)), ran(stream, machine).schedule.times_ms
    mark, ramp = plan.marks[0], FAST / acc
    first, last = ends[mark.legs[0] - 1], ends[mark.legs[-1]]
    begin = ends[mark.legs[0] - (3 if mode == 1 else 2)]
    behind = ends[mark.legs[-1] + (2 if mode == 1 else 1)]
    come, gone = float(times[first + 1] - times[begin + 1]), float(times[behind + 1] - times[last + 1])
    back_in, back_out = (2 * math.sqrt((FAST * t + FAST * ramp / 2) / acc) for t in (0.11, 0.09))
    assert come == pytest.approx(0.11 + ramp + (back_in if mode == 1 else 0.0), abs=2e-3)
    assert gone == pytest.approx(0.09 + ramp + (back_out if mode == 1 else 0.0), abs=2e-3)


def test_rtc5_corner_jump() -> None:
    """In mode 2 the jump at a 90 degree corner is sqrt(ro^2 + ri^2): 0.1421 mm. A GUS adds v^2/2a to ro and ri."""
    for acc in (1000.0, 32000.0):
        machine = Machine(max_acceleration_mm_s2=acc * 1000)
        steps = marked(head(RTC5, acc=acc), (15000.0, 5000.0), (15000.0, 15000.0))
        stream, _ = compiled(ref.job_text(steps), machine)
        plan, moves = ref.planned(steps, acc), moves_of(stream)
        ends = matched(plan.legs, moves)
        number = next(i for i, leg in enumerate(plan.legs) if leg.role == "added")
        ramp = FAST * FAST / (2 * acc)
        ideal = math.hypot(90.0 + ramp, 110.0 + ramp)
        q, p = moves.at[ends[number - 1]], moves.at[ends[number]]
        assert math.dist(q, p) == pytest.approx(ideal, abs=NEAR)
        assert plan.legs[number].way.length == pytest.approx(ideal, rel=1e-12)
    assert math.hypot(90.0, 110.0) == pytest.approx(142.1, abs=0.05)
    # 32000 pulse/ms2 is the most a GUS takes: v^2/2a is 15.6 um there, and the jump 163.9 um.
    assert ideal == pytest.approx(163.9, abs=0.5)


def test_a_shift_is_clipped() -> None:
    """The laser is on no earlier than 10 us * Nprev before S."""
    case = must(case_of(marked(head(replace(RTC5, shift=-400.0)), (15000.0, 5000.0))))
    on = case.trace.channels[0].emission.start_ms[0] - case.starts(case.plan.marks[0].legs[0])
    assert on == pytest.approx(-0.110, abs=1e-9)
    text = ref.job_text(marked(head(replace(RTC5, shift=-400.0)), (15000.0, 5000.0)))
    assert "GJ803" in {code for _, code in diagnostics_in(text)}


def test_auto() -> None:
    """A stored configuration: Timelag 320, 48, 32."""
    case = must(case_of(marked(head(Sky(mode=2, timelag=320.0)), (15000.0, 5000.0))))
    mark = case.plan.marks[0]
    assert (mark.sky.run_in_us, mark.sky.run_out_us) == (480.0, 320.0)
    moves = moves_of(compiled(case.text)[0])
    assert moves.at[case.ends[mark.ins[0] - 1]] == (5000.0 - 980, 5000.0)
    assert moves.at[case.ends[mark.outs[-1]]] == (15000.0 + 820, 5000.0)


def test_timelag_below_a_quarter_us_is_none() -> None:
    sky = SkyWriting(mode=2, timelag_us=0.25, shift_us=0, nprev=1, npost=1, limit=0, limit_given=False)
    lower = structs.replace(sky, timelag_us=0.249)
    assert (sky.lag_us, lower.lag_us, lower.is_on) == (0.25, 0.0, True)
    assert structs.replace(sky, timelag_us=0.125).is_on
    assert not structs.replace(sky, timelag_us=0.124).is_on
