"""Simulation of events that no controller package made. Numbers by hand."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.config.machine import Machine
from gusjob.controllers.gus.ranges import PowerMode
from gusjob.kinematics.geometry import NO_ARCS, segments
from gusjob.simulate import simulate
from gusjob.simulate.events import (
    ChannelEvents,
    Events,
    ImmediateAction,
    LaserState,
    LaserSwitchEvents,
    MotionEvents,
    PowerEvents,
    StageEvents,
)

LASER = LaserState(mode=PowerMode.DUTY, carrier_khz=10, on_delay_us=200, off_delay_us=500)


def numbers(*values: int) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    return np.array(values, dtype=np.intp)


def events(**changes: object) -> Events:
    """Two lines of 1000 pulse and a dwell of 5 ms in one stage; the first line is a mark with 40 %.

    At 50 pulse/ms and 5 pulse/ms2 a line takes 30 ms: acceleration, cruise and deceleration take 10 ms each.
    """
    x0, x1 = np.array([0.0, 1000.0, 1000.0]), np.array([1000.0, 1000.0, 2000.0])
    y = np.zeros(3)
    motion = MotionEvents(
        segments=segments(x0, y, x1, y, numbers(), NO_ARCS),
        vel=np.array([50.0, 1.0, 50.0]),
        acc=np.full(3, 5.0),
        vel_end=np.zeros(3),
        dwell=np.array([False, True, False]),
        dwell_ms=np.array([0.0, 5.0, 0.0]),
        line=np.array([10, 20, 30], dtype=np.int32),
        call=np.array([2, 4, 5], dtype=np.int32),
    )
    channel = ChannelEvents(
        channel=0,
        switch=LaserSwitchEvents(
            stage=numbers(0, 0), segment=numbers(0, 1), on=np.array([True, False]), mark_segment=numbers(0, 1)
        ),
        power=PowerEvents(
            stage=numbers(0), segment=numbers(0), low=np.array([40.0]), ratio=np.zeros(1), high=np.array([np.inf])
        ),
        laser_at_end=LASER,
    )
    stage = StageEvents(line=40, lasers=(LASER,), **changes)  # type: ignore[arg-type]  # fields by name
    return Events(name="x", stages=(stage,), stage_first=numbers(0, 3), motion=motion, channels=(channel,))


def test_a_trace_of_events() -> None:
    trace, diagnostics = simulate(events(), Machine())
    assert trace is not None
    assert diagnostics == []
    assert trace.schedule.times_ms == pytest.approx([0, 30, 35, 65])
    assert (trace.line.tolist(), trace.call.tolist(), trace.kind.tolist()) == ([10, 20, 30], [2, 4, 5], [0, 4, 1])
    (channel,) = trace.channels
    assert (channel.emission.start_ms.tolist(), channel.emission.end_ms.tolist()) == ([0.2], [30.5])
    assert channel.emitted.emission_ms == pytest.approx([29.8, 0.5, 0])
    assert channel.emitted.power_ms == pytest.approx([40 * 29.8, 40 * 0.5, 0])


def test_an_immediate_power_before_the_stage_is_replaced_by_a_buffered_one() -> None:
    for where, power in (("at_rest", 40), ("moving", 70)):
        trace, _ = simulate(events(**{where: (ImmediateAction(channel=0, power=70.0),)}), Machine())
        assert trace is not None
        assert trace.channels[0].emitted.power_max[0] == power


def test_a_buffered_switch_comes_after_an_immediate_one_of_a_moving_stage() -> None:
    on = (ImmediateAction(channel=0, on=True, line=40),)
    trace, diagnostics = simulate(events(moving=on), Machine())
    assert trace is not None
    assert not trace.channels[0].emission.on_at_end  # The buffered switch comes later.
    assert diagnostics == []


def test_only_a_listing_is_checked_for_corners_and_field() -> None:
    small = Machine(field_x_mm=(0, 1.5))
    assert simulate(events(), small)[1] == []
    found = simulate(events(), small, is_listing=True)[1]
    assert [(d.rule.code, d.span.line) for d in found] == [("GJ709", 30)]
