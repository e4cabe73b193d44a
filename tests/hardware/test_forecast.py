"""The forecast of a run."""

from __future__ import annotations

import pytest
from support.controller import needs_controller
from support.tools import MARK, stream_of

from gusjob.config.machine import Machine
from gusjob.controllers.gus.model import simulate_stream
from gusjob.hardware.forecast import forecast

pytestmark = needs_controller


def test_the_box_has_each_axis_own_scale() -> None:
    machine = Machine(pulses_per_mm=(1000.0, 500.0))
    stream = stream_of(MARK + "LASER POWER 3\nJUMP X 1 Y 2\nLASER ON\nLINE X 4 Y 8\nLASER OFF\n", machine)
    trace, _ = simulate_stream(stream, machine)
    assert trace is not None
    assert forecast(stream, trace, machine).box_mm == pytest.approx((1, 4, 2, 8))


def test_a_channel_that_changes_its_mode_is_forecast_in_each_unit() -> None:
    text = MARK + "LASER POWER 40\nLASER ON\nLINE X 5\nLASER OFF\nLASER MODE ANALOG MAX 8\nLASER POWER 3\n"
    stream = stream_of(text + "LASER ON\nLINE X 9\nLASER OFF\n")
    trace, _ = simulate_stream(stream, Machine())
    assert trace is not None
    found = {channel.unit: channel.remaining(0)[1] for channel in forecast(stream, trace, Machine()).channels}
    assert found == {"%": 40, "V": 3}
